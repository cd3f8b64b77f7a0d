"""Virtual torque bench: recordings with known truth."""
