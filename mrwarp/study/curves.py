"""Figure 5: reward over the trainings, mean and spread over seeds, from the training records."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mrwarp.study.plan import AWARE, CONVENTIONAL, SEEDS, STUDY, check_seeds, record_file

TITLES = {CONVENTIONAL: "baseline Go1 policy", AWARE: "MRA-SAL policy"}
"""Names of figure 5's curves."""

COLOURS = ("#b4451f", "#1f6fb4", "#3a8f3a", "#7a4fa3", "#555555")
"""Of the curves in their order; a sixth begins anew."""


class RecordError(ValueError):
    """A training record cannot be used; the message names the file and the remedy."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Reward per second over the updates of one plant's trainings."""

    plant: str
    """Plant of the trainings."""
    update: np.ndarray
    """PPO updates, shape (n,)."""
    reward: np.ndarray
    """Reward per second, shape (seeds, n)."""

    @property
    def mean(self) -> np.ndarray:
        """Mean over seeds, shape (n,)."""
        return self.reward.mean(axis=0)

    @property
    def sd(self) -> np.ndarray:
        """Sample standard deviation over seeds, 0 for one, shape (n,)."""
        return self.reward.std(axis=0, ddof=1) if len(self.reward) > 1 else np.zeros(self.reward.shape[1])


def figure5(
    folder: Path = STUDY, *, plants: Sequence[str] = (CONVENTIONAL, AWARE), seeds: Sequence[int] = SEEDS
) -> dict[str, Curve]:
    """Read the learning curves.

    Args:
        folder: Training records.
        plants: Which trainings.
        seeds: Their seeds.

    Returns:
        One curve per plant.

    Raises:
        RecordError: a record is missing or damaged, or records differ in length.
        ValueError: a seed is named twice.
    """
    check_seeds(seeds)
    return {plant: _curve(folder, plant, seeds) for plant in plants}


def plot(curves: dict[str, Curve], path: Path) -> None:
    """Draw the curves with bands of one standard deviation.

    Args:
        curves: What :func:`figure5` read.
        path: PNG to write.
    """
    figure = Figure(figsize=(7, 4.2), layout="constrained")
    axes = figure.subplots()
    for (plant, curve), colour in zip(curves.items(), cycle(COLOURS), strict=False):
        axes.plot(curve.update, curve.mean, color=colour, label=TITLES.get(plant, plant), linewidth=1.4)
        axes.fill_between(curve.update, curve.mean - curve.sd, curve.mean + curve.sd, color=colour, alpha=0.2)
    axes.set_xlabel("PPO update")
    axes.set_ylabel("reward [1/s]")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=120)


def _curve(folder: Path, plant: str, seeds: Sequence[int]) -> Curve:
    updates, rewards = [], []
    for seed in seeds:
        path = record_file(folder, plant, seed)
        try:
            curve = json.loads(path.read_text())["curve"]
            updates.append(np.asarray(curve["iteration"], dtype=float))
            rewards.append(np.asarray(curve["reward"], dtype=float))
        except FileNotFoundError as error:
            raise RecordError(f"{path}: no such record; 'mrwarp study train' and 'collect' make it") from error
        except (ValueError, KeyError, TypeError) as error:
            raise RecordError(f"{path}: no training record ({error!r}); collect it again") from error
    if any(len(update) != len(updates[0]) or not np.array_equal(update, updates[0]) for update in updates):
        raise RecordError(f"{folder}: records of {plant} differ in length; train all with the same --iterations")
    return Curve(plant=plant, update=updates[0], reward=np.stack(rewards))
