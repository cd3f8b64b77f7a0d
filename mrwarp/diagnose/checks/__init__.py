"""Whether a recording can be judged: faults of its channels, spikes and shifts of calibration."""
