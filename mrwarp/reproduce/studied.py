"""The study's policies and training records and the shipped networks, for the entries that need them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from mrwarp.nn import network_file as model_file
from mrwarp.nn.models import SAMPLES
from mrwarp.reproduce.experiment import NotYet
from mrwarp.study.plan import MODELS, SEEDS, STUDY, policy_file, record_file

PLANT_TITLES = {"mlp": "MLP", "bouc_wen": "Bouc-Wen", "lstm": "LSTM", "pg_rlstm": "PG-RLSTM"}
"""Torque models as the paper writes them."""

METRICS = {
    "v_x_rmse": ("v_x RMSE", "m/s", 4), "v_x_bias": ("v_x bias", "m/s", 4), "height": ("mean CoM height", "m", 4),
    "height_rmse": ("CoM-z RMSE", "m", 4), "tilt_rms": ("roll-pitch RMS", "deg", 3),
    "yaw_rate_rmse": ("yaw-rate RMSE", "rad/s", 4),
}  # fmt: skip
"""Title, unit and digits of the study's metrics."""


def policies(plants: Sequence[str] = MODELS) -> list[Path]:
    """Policies of some trainings, all seeds of each.

    Raises:
        NotYet: one is not there.
    """
    return _present([policy_file(STUDY, plant, seed) for plant in plants for seed in SEEDS])


def records(plants: Sequence[str]) -> list[Path]:
    """Training records, likewise.

    Raises:
        NotYet: one is not there.
    """
    return _present([record_file(STUDY, plant, seed) for plant in plants for seed in SEEDS])


def networks(kinds: Iterable[str]) -> list[Path]:
    """Shipped networks of some torque models, in their order; those that learn nothing have none.

    Raises:
        NotYet: one is not there.
    """
    found = {kind: model_file.shipped_model(kind) for kind in kinds if kind in SAMPLES}
    if missing := [kind for kind, path in found.items() if path is None]:
        raise NotYet(f"no trained network for {', '.join(missing)}; run 'mrwarp reproduce fig4 --train'")
    return [Path(path) for path in found.values() if path is not None]


def _present(paths: list[Path]) -> list[Path]:
    missing = [path.name for path in paths if not path.is_file()]
    if missing:
        raise NotYet(
            f"no policies yet: {len(missing)} of {len(paths)} files are not in {STUDY.name}, e.g. {missing[0]}; "
            "'mrwarp study train' and 'mrwarp study collect' make them"
        )
    return paths
