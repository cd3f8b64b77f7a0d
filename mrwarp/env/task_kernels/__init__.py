"""The walking task as batched kernels: random draws, gait, derived state, rewards, ends and begins, sight."""
