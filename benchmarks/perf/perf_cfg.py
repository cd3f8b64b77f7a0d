"""Subjects and durations of ``mrwarp perf``: on the CPU and on a GPU."""

from __future__ import annotations

from dataclasses import dataclass, field

import warp as wp

AIMED_AT = (64, 256)
"""Numbers of robots for which limits hold, and whose training is timed."""


@dataclass(frozen=True, kw_only=True)
class PerfCfg:
    """Subjects and durations on a CPU."""

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
    parts: tuple[str, ...] = field(default=("walking", "joint", "training"))
    """Names of the measurements."""

    def __post_init__(self) -> None:
        if not self.num_envs or min(self.num_envs) < 1:
            raise ValueError(f"num_envs = {self.num_envs} must be at least one number, none below 1")
        if self.rounds < 2:
            raise ValueError(f"rounds = {self.rounds} must be at least 2")

    def turns(self, count: int) -> tuple[int, int]:
        """Policy steps per turn, and turns of each variant, with a number of robots."""
        rounds = max(3, self.rounds * 256 // count) if count > 256 else self.rounds
        return self.steps or max(1, 640 // count), rounds

    def estimate(self) -> dict[str, float]:
        """How long each part takes on two idle cores [s]."""
        found = {"start": 10.0}
        if "walking" in self.parts:
            for count in self.num_envs:
                steps, rounds = self.turns(count)
                variants = 27 if count <= self.mjwarp_up_to else 17  # in units of a step of the plain environment
                step = 0.35e-3 + 0.034e-3 * count
                found[f"walking, {count} robots"] = 4.0 + 0.01 * count + (rounds + 1) * steps * variants * step
        if "joint" in self.parts:
            found["joint"] = 2.0 + 0.05 * self.rounds
        if "training" in self.parts and self.updates:
            for count in [count for count in self.num_envs if count in AIMED_AT]:
                found[f"training, {count} robots"] = 1.0 + (self.updates + 2) * (0.03 + 0.0017 * count)
        return found


@dataclass(frozen=True, kw_only=True)
class GpuCfg:
    """Subjects and durations on a GPU."""

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
    """Names of the measurements."""

    def __post_init__(self) -> None:
        if not self.num_envs or min(self.num_envs) < 1:
            raise ValueError(f"num_envs = {self.num_envs} must be at least one number, none below 1")
        if self.rounds < 2 or self.steps < 1:
            raise ValueError(f"rounds = {self.rounds} must be at least 2 and steps = {self.steps} at least 1")
        if not self.parts:
            raise ValueError("parts: choose from walking, joint and training on a GPU")
        if self.device not in {"cpu", *(found.alias for found in wp.get_cuda_devices())}:
            raise ValueError(f"device {self.device!r} is not here; Warp has {', '.join(map(str, wp.get_devices()))}")
