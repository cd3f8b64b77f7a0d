"""What a reproduction is run with; every number that changes a result stands here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch

from mrwarp.choices import Coupling
from mrwarp.paper import ROBOTS
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.study.plan import AWARE, ENERGY, HIGH_PRICE, PUBLIC, SEEDS, STUDY, plant_of, policy_file


def _own(folder: Path, coupling: Coupling = Coupling.EXPLICIT) -> dict[str, tuple[Path, ...]]:
    """Policies of a folder that were trained on each robot, MR_Go-SAL's with devices that act so."""
    plants = {robot: plant_of(robot, coupling) for robot in ROBOTS}
    return {robot: tuple(policy_file(folder, plant, seed) for seed in SEEDS) for robot, plant in plants.items()}


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Choices of a reproduction; the defaults are those of the report."""

    policies: Mapping[str, tuple[Path, ...]] = field(default_factory=lambda: _own(ENERGY))
    """Policies of each robot's walks, one per training seed; each robot walks with its own, trained alike, MR_Go-SAL's
    with the paper's explicit torque."""
    impacted: tuple[Path, ...] = field(default_factory=lambda: tuple(policy_file(STUDY, PUBLIC, n) for n in SEEDS))
    """Policies of MR_Go-SAL under pushes and falling masses, trained with the public gains."""
    aware: tuple[Path, ...] = field(default_factory=lambda: tuple(policy_file(STUDY, AWARE, n) for n in SEEDS))
    """Policies under pushes and falling masses with the asset's gains, and of walks without a price on power: the
    actuator-aware ones of table 2."""
    sticking: tuple[Path, ...] = field(default_factory=lambda: _own(ENERGY, Coupling.CONSTRAINT)["mr_go_sal"])
    """Policies of MR_Go-SAL's walks on devices that stick, trained with them; as many as of the robots."""
    high: Mapping[str, tuple[Path, ...]] = field(default_factory=lambda: _own(HIGH_PRICE))
    """As ``policies``, trained with a high price on power."""
    rollouts: int = 3
    """Rollouts per policy, paper section 6.2."""
    distance: float = 30.0
    """Walked distance of tables 6 and 7 [m]."""
    window: float = 10.0
    """Simulated distance of each walk of the mission [m]."""
    impacts: int = 12
    """Impacts per policy and current."""
    seed: int = 0
    """Seed of poses and gait phases."""
    threads: int = 0
    """CPU threads; 0 = all. The figures are the same for any number."""

    def __post_init__(self) -> None:
        for robot in ROBOTS:
            if not self.policies.get(robot):
                raise ValueError(f"policies: name at least one for {robot}")
        counts = {len(self.policies[robot]) for robot in ROBOTS}
        if len(counts) > 1:
            raise ValueError(
                "policies: " + ", ".join(f"{len(self.policies[robot])} for {robot}" for robot in ROBOTS)
                + "; name the same number, one per training seed, for every robot (--policy-ROBOT)"
            )  # fmt: skip
        if counts != {len(self.sticking)}:
            raise ValueError(
                f"sticking: {len(self.sticking)} policies, but {self.policy_seeds} for every robot; name as many "
                "(--policy-sticking)"
            )
        numbers = {len(self.high.get(robot, ())) for robot in ROBOTS}
        if len(numbers) > 1 or 0 in numbers:
            raise ValueError("high: name the same number of policies, at least one, for every robot")
        if not self.impacted or len(self.impacted) != len(self.aware):
            counts = f"{len(self.impacted)} and {len(self.aware)}"
            raise ValueError(f"impacted and aware need the same number of policies, at least one; got {counts}")
        if min(self.rollouts, self.impacts) < 1:
            raise ValueError(f"rollouts = {self.rollouts} and impacts = {self.impacts} must be at least 1")
        if not all(math.isfinite(length) and length > 0.0 for length in (self.distance, self.window)):
            raise ValueError(f"distance = {self.distance} m and window = {self.window} m must be positive and finite")

    def struck(self, gains: tuple[float, float] | None) -> Ensemble:
        """Policies for pushes and falling masses on robots with these gains; None is the asset's.

        Raises:
            PolicyError: a file cannot be used.
        """
        return Ensemble(self.aware if gains is None else self.impacted)

    @property
    def policy_seeds(self) -> int:
        """Policies per robot."""
        return len(self.policies[ROBOTS[0]])


class Ensemble:
    """Several policies as one: row i of a batch is driven by policy ``i % n``.

    Args:
        paths: The policies, one per seed; a batch repeats them over its trials.

    Raises:
        PolicyError: a file cannot be used.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._policies = [OnnxPolicy(path) for path in paths]

    def __call__(self, obs) -> torch.Tensor:
        """Actions (E, 12)."""
        n = len(self._policies)
        if n == 1:
            return self._policies[0](obs)
        rows = obs["actor"] if not isinstance(obs, torch.Tensor) else obs
        actions = torch.empty(len(rows), 12, device=rows.device)
        for k, policy in enumerate(self._policies):
            actions[k::n] = policy(rows[k::n])
        return actions


def ensembles(settings: Settings) -> dict[str, Ensemble]:
    """The policies of each robot; robots with the same files share one object, and so one evaluation.

    Raises:
        PolicyError: a file cannot be used.
    """
    made: dict[tuple[Path, ...], Ensemble] = {}
    for paths in settings.policies.values():
        if tuple(paths) not in made:
            made[tuple(paths)] = Ensemble(paths)
    return {robot: made[tuple(paths)] for robot, paths in settings.policies.items()}
