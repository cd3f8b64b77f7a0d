"""Whether a recording can be judged: faults of its channels, and spikes."""
