"""Power and torque of motors while walking: where the power of table 6 and the torque of figures 8 and 11 come from."""
