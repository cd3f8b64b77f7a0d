"""Policies of several training seeds as one, and the study's files and shipped networks that entries need."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import torch

from mrwarp.nn.models import SAMPLES
from mrwarp.nn.network_file import shipped_model
from mrwarp.reproduce.cache import NotYet
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.study.plan import SEEDS, STUDY, policy_file

PLANT_TITLES = {"mlp": "MLP", "bouc_wen": "Bouc-Wen", "lstm": "LSTM", "pg_rlstm": "PG-RLSTM"}
"""Torque models as the paper writes them."""


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
        rows = obs["actor"] if not isinstance(obs, torch.Tensor) else obs
        actions = torch.empty(len(rows), 12, device=rows.device)
        for k, policy in enumerate(self._policies):
            actions[k::n] = policy(rows[k::n])
        return actions


def ensembles(policies: Mapping[str, Sequence[Path]]) -> dict[str, Ensemble]:
    """Policies of each robot; robots with the same files share one object, and so one evaluation."""
    made = {paths: Ensemble(paths) for paths in {tuple(paths) for paths in policies.values()}}
    return {robot: made[tuple(paths)] for robot, paths in policies.items()}


def study_files(plants: Sequence[str], file: Callable[[Path, str, int], Path] = policy_file) -> list[Path]:
    """Policies of some trainings of the study, all seeds of each.

    Args:
        plants: The trainings.
        file: Which of a training's files, such as ``record_file``.

    Raises:
        NotYet: one is not there.
    """
    paths = [file(STUDY, plant, seed) for plant in plants for seed in SEEDS]
    if missing := [path.name for path in paths if not path.is_file()]:
        raise NotYet(
            f"no policies yet: {len(missing)} of {len(paths)} files are not in {STUDY.name}, e.g. {missing[0]}; "
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
