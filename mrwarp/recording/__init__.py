"""Bench recordings: reading, checking and writing."""
