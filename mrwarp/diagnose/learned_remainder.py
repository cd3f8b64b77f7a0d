"""What a diagnosis leaves for the learned model: a PG-RLSTM on top of the baseline and one on top of the extension."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mrwarp.diagnose.result import Diagnosis
from mrwarp.identify import learn
from mrwarp.identify.dataset import rms
from mrwarp.nn.training import FitCfg, History
from mrwarp.nn.windows import split
from mrwarp.recording.load import RecordingError

RECIPE = FitCfg(epochs=10, windows_per_epoch=8192, validation_windows=4096, patience=10)
"""Enough to compare two residuals; ``mrwarp learn`` trains one in full."""


@dataclass(frozen=True, kw_only=True)
class LeftToLearn:
    """Both trainings; torque in the recording's units."""

    target: tuple[float, float]
    """RMS of what the learned model must add to the baseline, and to the extension, over all trajectories."""
    physical: tuple[float, float]
    """RMSE of baseline and extension alone on the trajectories that validate the trainings."""
    with_learned: tuple[float, float]
    """The same with the learned residual."""
    held_out: tuple[str, ...]
    """Those trajectories."""
    recipe: FitCfg

    @property
    def less(self) -> float:
        """How much smaller the target is with the extension [1]."""
        return 1.0 - self.target[1] / self.target[0] if self.target[0] > 0.0 else 0.0

    def to_dict(self) -> dict[str, Any]:
        """Plain values for ``result.json``."""
        return {**asdict(self), "less": self.less}


def left_to_learn(
    diagnosis: Diagnosis, *, recipe: FitCfg = RECIPE, progress: Callable[[str], None] = lambda text: None
) -> LeftToLearn:
    """Train a residual by one recipe on what each of the two physical models leaves.

    The physical models were fitted on all trajectories; they have few numbers.

    Raises:
        RecordingError: the trajectories are too short, too few or of several rates for windows.
        KeyboardInterrupt: a training was stopped.
    """
    recording, traces = diagnosis.recording, diagnosis.traces
    where = recording.source or "recording"
    if traces is None:
        raise RecordingError(
            f"{where}: without a verdict there is nothing to learn on top of; make the recording named"
        )
    learn.sampling_interval(recording)
    window = learn.SAMPLES["pg_rlstm"]
    usable = [k for k, run in enumerate(recording.trajectories) if len(run.t) >= window]
    held = [usable[k] for k in split(len(usable), recipe.seed, learn.VALIDATION)[1]] if len(usable) > 1 else []
    target, physical, with_learned = [], [], []
    for name, torque in (("baseline", traces.baseline), ("extension", traces.extended)):

        def report(history: History, cfg: FitCfg, name: str = name) -> None:
            progress(
                f"learning what the {name} leaves: epoch {history.epoch[-1]} of {cfg.epochs}, "
                f"validation {history.validation_rmse[-1]:.4g}"
            )

        known = [torque[part] for part in traces.parts]
        learned = learn.learn(recording, kind="pg_rlstm", baseline=known, cfg=recipe, report=report)
        if learned.history.stopped == "interrupted":
            raise KeyboardInterrupt
        rest = traces.torque - torque
        target.append(rms(rest))
        physical.append(rms(np.concatenate([rest[traces.parts[k]][window - 1 :] for k in held])))
        with_learned.append(float(learned.figures["validation_rmse"]))
    return LeftToLearn(
        target=(target[0], target[1]),
        physical=(physical[0], physical[1]),
        with_learned=(with_learned[0], with_learned[1]),
        held_out=tuple(recording.trajectories[k].id for k in held),
        recipe=recipe,
    )
