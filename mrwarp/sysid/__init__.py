"""From bench data to a joint model: recordings, virtual bench, replay through the kernels, identification."""
