"""The walking task's arithmetic as batched kernels, one thread per environment: gait, derived state, rewards, sight."""
