"""Trials of a policy: the walking gate, walks, missions, impacts."""
