"""The log and its simulation before and after: every window replayed with the description, and with the causes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrwarp.robot_logs.robot_verdict import RobotDiagnosis
from mrwarp.robot_logs.window_replay import ParameterBatch, Replay, nuisances
from mrwarp.robot_logs.windows import Windows, mismatch

UNITS = {
    "q": "rad", "qd": "rad/s", "tau": "N·m", "quat": "rad", "gyro": "rad/s", "acc": "m/s²", "pos": "m", "vel": "m/s",
    "foot": "N", "current": "A",
}  # fmt: skip
"""Unit of each channel's mismatch; of an orientation the angle of the rotation between."""


@dataclass(frozen=True, kw_only=True)
class Compared:
    """W windows of S samples; J joints."""

    windows: Windows
    offset: np.ndarray
    """When each window begins on a time line that puts all recordings end to end [s], shape (W,)."""
    before: Mapping[str, np.ndarray]
    """Channels that the description predicts, shape (W, S, C)."""
    after: Mapping[str, np.ndarray]
    """Simulated with the named causes."""

    @property
    def time(self) -> np.ndarray:
        """Time of each sample on that line [s], shape (W, S)."""
        return self.offset[:, None] + self.windows.t

    def left(self, after: bool) -> dict[str, np.ndarray]:
        """Measured minus predicted by channel, shape (W, S, C); 0 where there is no number."""
        found = mismatch(self.windows.measured, dict(self.after if after else self.before))
        return {name: np.nan_to_num(x) for name, x in found.items()}


def compare(d: RobotDiagnosis) -> list[Compared]:
    """Replay every window twice, both with the session's offsets; one entry per group of windows."""
    plain = np.array([d.session.get(p.where, 0.0) if p.field == "shift" else 0.0 for p in d.parameters])
    plain = plain if d.setup is None else plain + d.setup
    begins = np.cumsum([0.0, *(run.t[-1] for run in d.log.runs)])
    found = []
    for windows in d.windows:
        replay, every = Replay(d.model, windows), np.arange(windows.count)
        start = np.zeros((windows.count, len(nuisances(d.model))))
        both = [
            replay.run(ParameterBatch.of(list(d.parameters), np.tile(theta, (windows.count, 1)), d.model), every, start)
            for theta in (plain, plain + d.theta)
        ]
        offset = np.array([begins[r] + d.log.runs[r].t[s] for r, s in zip(windows.run, windows.start, strict=True)])
        found.append(Compared(windows=windows, offset=offset, before=both[0], after=both[1]))
    return found


def joint_windows(compared: list[Compared]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """When windows begin [s], shape (W,), in order; RMS error of the angles before and after [rad], shapes (W, J)."""
    time = np.concatenate([c.offset for c in compared])
    order = np.argsort(time)
    before, after = (
        np.concatenate([np.sqrt((c.left(k)["q"] ** 2).mean(axis=1)) for c in compared])[order] for k in (False, True)
    )
    return time[order], before, after
