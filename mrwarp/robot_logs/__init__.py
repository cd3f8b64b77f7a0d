"""Logs of whole robots: read, recorded, replayed against the simulation, and diagnosed."""
