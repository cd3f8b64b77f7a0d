"""What a diagnosis foretells of recordings that took no part in it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mrwarp.diagnose.result import Diagnosis
from mrwarp.identify.damper import prediction_errors, undo_moving_average
from mrwarp.recording.load import Recording, RecordingError, check_same_units

MODELS = ("baseline", "extended")


def predicted_errors(
    diagnosis: Diagnosis, recording: Recording, *, averaged: float = 0.0, progress: Callable[[str], None] | None = None
) -> dict[str, dict[str, dict[str, float]]]:
    """RMSE over standard deviation by reading of the motion, by model, by trajectory.

    Args:
        diagnosis: With a verdict.
        recording: Of the same device, in the same units.
        averaged: Moving average [s] that its q and torque passed before they were published; then the simulated torque
            passes the same, and the motion is taken as published and again with its average undone.
        progress: Told what is being done.

    Raises:
        RecordingError: the diagnosis has no verdict, or the units differ.
    """
    if diagnosis.predictor is None:
        raise RecordingError(f"{recording.source}: a diagnosis without a verdict foretells nothing; leave it out")
    check_same_units(recording, diagnosis.recording)
    told = progress or (lambda text: None)
    told(f"predicting {len(recording.trajectories)} trajectories of {recording.source}")
    readings = {"": recording} if averaged == 0.0 else {
        "motion as published": recording, "average of the motion undone": undo_moving_average(recording, averaged)
    }  # fmt: skip
    cuts = np.cumsum([len(run.t) for run in recording.trajectories])[:-1]
    found = {}
    for name, motion in readings.items():
        torque = diagnosis.predictor.torque(motion)
        found[name] = {
            model: prediction_errors(motion, np.split(tau, cuts), averaged)
            for model, tau in zip(MODELS, torque, strict=True)
        }
    return found


def summary(found: dict[str, dict[str, dict[str, float]]]) -> dict[str, Any]:
    """Mean over the trajectories by reading and model, and in how many of them the extension is better."""
    out = {}
    for name, models in found.items():
        before, after = (np.array(list(models[model].values())) for model in MODELS)
        out[name] = {
            "baseline": float(before.mean()), "extended": float(after.mean()), "better": int((after < before).sum()),
            "trajectories": len(before),
        }  # fmt: skip
    return out
