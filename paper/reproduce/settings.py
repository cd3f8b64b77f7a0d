"""Every number and policy that changes a result of ``mrwarp reproduce``; several training seeds as one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mrwarp.enums import Coupling
from mrwarp.nn.models import SAMPLES
from mrwarp.nn.network_file import shipped_model
from mrwarp.paper import ROBOTS
from mrwarp.resources import ENERGY, FIRST_SEEDS, plant_of, policy_file
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.rl.policy_file import read_policy
from paper.study.plan import AWARE, CONVENTIONAL, PUBLIC, SEEDS, STUDY, USUAL_HEIGHT

PLANT_TITLES = {"mlp": "MLP", "bouc_wen": "Bouc-Wen", "lstm": "LSTM", "pg_rlstm": "PG-RLSTM"}
"""Torque models as the paper writes them."""


class NotYet(RuntimeError):
    """An input of the experiment is not there yet; the message names it."""


def _of(folder: Path, plant: str, seeds: tuple[int, ...] = FIRST_SEEDS) -> tuple[Path, ...]:
    return tuple(policy_file(folder, plant, seed) for seed in seeds)


def _own(folder: Path, seeds: tuple[int, ...]) -> dict[str, tuple[Path, ...]]:
    """Policies of a folder that were trained on each robot, MR_Go-SAL's with the paper's explicit torque."""
    return {robot: _of(folder, plant_of(robot, Coupling.EXPLICIT), seeds) for robot in ROBOTS}


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Choices of a reproduction; the defaults are those of the report."""

    policies: Mapping[str, tuple[Path, ...]] = field(default_factory=lambda: _own(ENERGY, SEEDS))
    """Policies of each robot's walks, one per training seed; each robot walks with its own, trained in one way,
    MR_Go-SAL's with the paper's explicit torque."""
    impacted: tuple[Path, ...] = field(default_factory=lambda: _of(STUDY, PUBLIC, SEEDS))
    """Policies of MR_Go-SAL under pushes and falling masses, one per training seed, with the gains of their
    training."""
    usual_height: tuple[Path, ...] = field(default_factory=lambda: _of(STUDY, USUAL_HEIGHT, (0, 1)))
    """As ``impacted``, trained with the weight of the trunk's height that all other trainings have."""
    aware: tuple[Path, ...] = field(default_factory=lambda: _of(STUDY, AWARE))
    """Policies of walks without a price on power: the actuator-aware ones of table 2."""
    sticking: tuple[Path, ...] = field(
        default_factory=lambda: _of(ENERGY, plant_of("mr_go_sal", Coupling.CONSTRAINT), SEEDS)
    )
    """Policies of MR_Go-SAL's walks on devices that stick (the constraint coupling), trained with them; at most as many
    as of the robots. MR_Go walks next to them with its first ones."""
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
        counts = {robot: len(self.policies.get(robot, ())) for robot in ROBOTS}
        if min(counts.values()) < 1 or len(set(counts.values())) > 1:
            each = ", ".join(f"{count} for {robot}" for robot, count in counts.items())
            raise ValueError(
                f"policies: {each}; name the same number, one per training seed, for every robot (--policy-ROBOT)"
            )
        if not 1 <= len(self.sticking) <= self.policy_seeds:
            raise ValueError(
                f"sticking: {len(self.sticking)} policies, but {self.policy_seeds} for every robot; name at least one "
                "and at most as many (--policy-sticking)"
            )
        for name in ("impacted", "usual_height", "aware"):
            if not getattr(self, name):
                raise ValueError(f"{name}: name at least one policy (--policy-{name})")
        for name, paths in self._named().items():
            if len(set(paths)) < len(paths):
                raise ValueError(f"{name}: name each policy once; one that counts as two training seeds has no spread")
        if not all(math.isfinite(length) and length > 0.0 for length in (self.distance, self.window)):
            raise ValueError(f"distance = {self.distance} m and window = {self.window} m must be positive and finite")

    def _named(self) -> dict[str, tuple[Path, ...]]:
        """All policies, by what they are called in a refusal."""
        robots = {f"policies of {robot}": paths for robot, paths in self.policies.items()}
        return {**robots, **{name: getattr(self, name) for name in ("sticking", "impacted", "usual_height", "aware")}}

    def files(self) -> tuple[Path, ...]:
        """Every policy that is named, each once."""
        return tuple(dict.fromkeys(path for paths in self._named().values() for path in paths))

    @property
    def policy_seeds(self) -> int:
        """Policies per robot."""
        return len(self.policies[ROBOTS[0]])


def trained_gains(paths: Sequence[Path]) -> tuple[float, float] | None:
    """Kp [N·m/rad] and Kd [N·m·s/rad] that some policies were trained with; None for the asset's.

    Raises:
        ValueError: they were trained with different gains.
    """
    found = {tuple((read_policy(path)[1].get("task") or {}).get("gains") or ()) for path in paths}
    if len(found) > 1:
        raise ValueError(
            f"policies: {', '.join(path.name for path in paths)} were trained with different gains; name policies of "
            "one training"
        )
    gains = found.pop()
    return (float(gains[0]), float(gains[1])) if gains else None


class Ensemble:
    """Several policies as one: row i of a batch is driven by policy ``i % n``."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._policies = [OnnxPolicy(path) for path in paths]

    def __len__(self) -> int:
        """Number of policies."""
        return len(self._policies)

    def __call__(self, obs) -> torch.Tensor:
        """Actions (E, 12)."""
        n = len(self)
        rows = obs["actor"] if not isinstance(obs, torch.Tensor) else obs
        actions = torch.empty(len(rows), 12, device=rows.device)
        for k, policy in enumerate(self._policies):
            actions[k::n] = policy(rows[k::n])
        return actions


def ensembles(policies: Mapping[str, Sequence[Path]]) -> dict[str, Ensemble]:
    """Policies of each robot; robots with the same files share one object, and so one evaluation."""
    made = {paths: Ensemble(paths) for paths in {tuple(paths) for paths in policies.values()}}
    return {robot: made[tuple(paths)] for robot, paths in policies.items()}


def study_files(
    plants: Sequence[str], file: Callable[[Path, str, int], Path] = policy_file, *, folder: Path = STUDY
) -> list[Path]:
    """Policies of some trainings of the study, all seeds of each, or another ``file``, such as ``record_file``.

    Raises:
        NotYet: one is not there.
    """
    paths = [file(folder, plant, seed) for plant in plants for seed in SEEDS]
    if missing := [path.name for path in paths if not path.is_file()]:
        raise NotYet(
            f"no policies yet: {len(missing)} of {len(paths)} files are not in {folder.name}, e.g. {missing[0]}; "
            "'mrwarp study train' and 'mrwarp study collect' make them"
        )
    return paths


def networks(kinds: Iterable[str]) -> list[Path]:
    """Shipped networks of some torque models, in their order; those that learn nothing have none.

    Raises:
        NotYet: one is not there.
    """
    found = {kind: shipped_model(kind) for kind in kinds if kind in SAMPLES}
    if missing := [kind for kind, path in found.items() if path is None]:
        raise NotYet(f"no trained network for {', '.join(missing)}; run 'mrwarp reproduce fig4 --train'")
    return [Path(path) for path in found.values() if path is not None]


TRAININGS = (CONVENTIONAL, AWARE)
"""Plants of tables 2, 4 and 5 and figure 5."""

IMPACTS = ("impacted", "usual_height", "impacts", "seed")
"""Settings that pushes and falling masses depend on."""


def impacts_time(seconds: float) -> Callable[[Settings], float]:
    """Time of impacts [s], of which the report has 12 for each of five policies."""
    return lambda settings: seconds * (0.15 + 0.85 * len(settings.impacted) * settings.impacts / 60.0)


def walks_time(seconds: float, length: str, usual: float) -> Callable[[Settings], float]:
    """Time of walks [s], of which the report has three for each of five policies; ``length`` is their setting."""
    return lambda settings: (
        seconds * (0.1 + 0.9 * settings.policy_seeds * settings.rollouts / 15.0 * getattr(settings, length) / usual)
    )


def rollouts_time(settings: Settings) -> float:
    """Time of table 2 or 3 [s], which have three rollouts of each policy by either torque."""
    return 6.0 + 3.0 * settings.rollouts


def seeds_of(trials: np.ndarray, policies: int) -> np.ndarray | None:
    """Seed of each trial, of which number i was walked by policy ``i % policies``; None with a single policy.

    A single policy's trials are the only repetitions there are. Of several policies one may be all that arrived: its
    trials are still one seed.
    """
    return np.asarray(trials) % policies if policies > 1 else None


def over_seeds(values: np.ndarray, seeds: np.ndarray | None = None) -> dict[str, Any]:
    """``ours``, ``sd``, ``n`` and ``seeds`` of a :class:`Comparison`; rollouts are averaged within each seed first.

    Section 6.2 does so.

    Args:
        values: One per rollout; NaN where there is no figure, which counts as no rollout.
        seeds: Seed of each rollout, see :func:`seeds_of`; None takes every rollout as its own.
    """
    values = np.asarray(values, dtype=float)
    there = ~np.isnan(values)
    values = values[there]
    if seeds is not None:
        seeds = np.asarray(seeds)[there]
        values = np.array([values[seeds == seed].mean() for seed in np.unique(seeds)])
    if not len(values):
        return {"ours": math.nan, "sd": None, "n": 0, "seeds": ()}
    sd = float(values.std(ddof=1)) if len(values) > 1 else None
    return {"ours": float(values.mean()), "sd": sd, "n": len(values), "seeds": tuple(values.tolist())}
