"""Identification of a joint from recordings."""
