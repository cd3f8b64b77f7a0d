"""Measurements of the simulator's physics, which ``tests/benchmarks/verify`` judges by limits."""
