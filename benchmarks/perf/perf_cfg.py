"""What ``mrwarp perf`` measures, and how long: on the CPU and on a GPU."""

from __future__ import annotations

from dataclasses import dataclass, field

import warp as wp


@dataclass(frozen=True, kw_only=True)
class PerfCfg:
    """What is measured, and how long."""

    num_envs: tuple[int, ...] = (1, 4, 16, 64, 256, 1024, 4096)
    """Numbers of robots."""
    rounds: int = 30
    """Turns of each variant with up to 256 robots; fewer with more, at least three."""
    mjwarp_up_to: int = 256
    """Largest number of robots for which MuJoCo-Warp is stepped too: on a CPU it is slow."""
    updates: int = 12
    """Training updates; 0 leaves training out."""
    threads: int = 0
    """CPU threads of the simulation; 0 = all."""
    steps: int = 0
    """Policy steps per turn; 0 takes about 640 robot steps."""
    parts: tuple[str, ...] = field(default=("walking", "joint", "lstm", "training"))
    """What is measured."""

    def __post_init__(self) -> None:
        if not self.num_envs or min(self.num_envs) < 1:
            raise ValueError(f"num_envs = {self.num_envs} must be at least one number, none below 1")
        if self.rounds < 2:
            raise ValueError(f"rounds = {self.rounds} must be at least 2")


@dataclass(frozen=True, kw_only=True)
class GpuCfg:
    """What is measured, and how long."""

    device: str = "cuda:0"
    """Warp device."""
    num_envs: tuple[int, ...] = (16, 64, 256, 1024, 4096, 16384, 65536)
    """Numbers of robots."""
    rounds: int = 10
    """Turns of each variant."""
    steps: int = 10
    """Policy steps per turn."""
    eager_up_to: int = 4096
    """Largest number of robots that are stepped without a graph too."""
    updates: int = 12
    """Training updates; 0 leaves training out."""
    parts: tuple[str, ...] = ("walking", "joint", "training")
    """What is measured."""

    def __post_init__(self) -> None:
        if not self.num_envs or min(self.num_envs) < 1:
            raise ValueError(f"num_envs = {self.num_envs} must be at least one number, none below 1")
        if self.rounds < 2 or self.steps < 1:
            raise ValueError(f"rounds = {self.rounds} must be at least 2 and steps = {self.steps} at least 1")
        if not self.parts:
            raise ValueError("parts: choose from walking, joint and training on a GPU")
        if self.device not in {"cpu", *(found.alias for found in wp.get_cuda_devices())}:
            raise ValueError(f"device {self.device!r} is not here; Warp has {', '.join(map(str, wp.get_devices()))}")
