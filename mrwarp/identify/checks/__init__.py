"""What recordings are checked by: one description of all runs, and reasons why a model explains nothing."""
