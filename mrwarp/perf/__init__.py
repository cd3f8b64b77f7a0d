"""Benchmarks: what a step costs, part by part, against plain physics in the same run, and whether that got worse."""
