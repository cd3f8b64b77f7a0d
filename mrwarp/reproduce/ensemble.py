"""Policies of several training seeds as one, each driving its share of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from mrwarp.reproduce.settings import Settings
from mrwarp.rl.policy import OnnxPolicy


class Ensemble:
    """Several policies as one: row i of a batch is driven by policy ``i % n``.

    Args:
        paths: The policies, one per seed; a batch repeats them over its trials.

    Raises:
        PolicyError: a file cannot be used.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._policies = [OnnxPolicy(path) for path in paths]

    def __len__(self) -> int:
        """Number of policies."""
        return len(self._policies)

    def __call__(self, obs) -> torch.Tensor:
        """Actions (E, 12)."""
        n = len(self)
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
