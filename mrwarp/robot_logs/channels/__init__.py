"""Checks of a log's channels against the robot and each other, before anything is fitted."""
