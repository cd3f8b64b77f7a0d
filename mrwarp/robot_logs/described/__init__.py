"""The robot of a log as its file describes it."""
