"""Cost of a step, part by part, and whether it grew."""
