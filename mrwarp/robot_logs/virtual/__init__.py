"""A virtual robot whose logs have a known truth: another engine path than the replay of the diagnosis."""
