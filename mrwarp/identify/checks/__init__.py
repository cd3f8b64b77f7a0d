"""Checks of recordings: one description of all runs, and reasons why a model explains nothing."""
