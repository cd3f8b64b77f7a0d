"""Baseline and extended model of a diagnosis, run along other recordings of the same device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mrwarp.identify.dataset import Motion, Scales
from mrwarp.identify.replay import EffectReplay
from mrwarp.recording.load import Recording

if TYPE_CHECKING:
    from mrwarp.diagnose.choice import Choice
    from mrwarp.diagnose.engine import Engine


@dataclass(frozen=True, kw_only=True)
class Predictor:
    """Two rows of parameters in inner units: baseline and extended model."""

    rows: np.ndarray
    """Shape (2, WIDTH)."""
    scales: Scales
    resistance: float
    under_way: bool = False
    """Whether trajectories that begin in motion are taken as cut out of a longer motion."""
    ahead: float = 0.0
    """Samples by which the torque is logged ahead of the motion."""
    rests: bool = False
    """Whether the joint is held still where it seems to rest."""

    @classmethod
    def of(cls, engine: Engine, choice: Choice) -> Predictor:
        """The models of a search."""
        rows = np.stack(
            [
                fit.coordinates.row(fit.x)
                for fit in (choice.stated(engine, choice.base), choice.stated(engine, choice.final))
            ]
        )
        motion = engine.motion
        return cls(
            rows=rows, scales=motion.scales, resistance=motion.resistance, under_way=motion.begin is not None,
            ahead=motion.ahead, rests=motion.kinematics.rests,
        )  # fmt: skip

    def torque(self, recording: Recording) -> np.ndarray:
        """Torque of both models along all trajectories end to end, shape (2, N) [unit of the recording]."""
        motion = Motion.of(recording, self.scales, resistance=self.resistance, rests=self.rests)
        if self.ahead:
            motion = motion.later(self.ahead)
        if self.under_way:
            motion = motion.under_way()
        return EffectReplay(motion).torque(self.rows).astype(float) * self.scales.torque
