"""Replay: the torque of recorded motion by the simulator's own laws, for many parameter sets in one launch.

All parameters are in the normalised units of the data set (:mod:`mrwarp.identify.dataset`). A parameter set is a row:
the laws of eqs. 14 and 15, then the numbers of all effects (:data:`WIDTH` values).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import warp as wp

from mrwarp.effects.catalogue import COLUMNS, NULLS, SLOTS
from mrwarp.effects.replay_kernel import BASE, HEAT_TIMES, effect_replay_kernel, replay_kernel
from mrwarp.identify.dataset import Dataset, Motion
from mrwarp.recording.load import Recording

WIDTH = len(BASE) + COLUMNS
"""Length of a row."""
_OFFSETS = ("q_neutral", "q_offset", "q_center")
_KEPT = 16_000_000
"""Samples times rows whose torque is kept, 64 MB: of the last Jacobians, which fits ask for again where only weights
changed, and of points whose loss was looked at first."""
_BATCH = 16_000_000
"""Samples times rows of one launch: bounds the memory of its output to 64 MB."""


def null_row() -> np.ndarray:
    """A row at which no effect acts, z has no limit and eq. 14 gives no torque, shape (WIDTH,)."""
    row = np.concatenate([np.zeros(len(BASE)), NULLS])
    row[BASE.index("z_max")] = np.inf
    return row


def row_of(values: Mapping[str, float]) -> np.ndarray:
    """The row of named parameters of the laws; what is not named is null, shape (WIDTH,)."""
    row = null_row()
    for name, value in values.items():
        if name in _OFFSETS:
            row[BASE.index("q_zero")] += value
        else:
            row[BASE.index(name)] = value
    return row


class Replay:
    """A data set on a device, ready to be simulated with many parameter sets.

    Args:
        samples: The recorded motion.
        exact: Step z by its closed form; False: the paper's Euler step.
        substeps: Parts of each sampling step, through interpolated velocity. 0: the simulator's own step,
            which holds the newest velocity. A simulated velocity is the mean over its step, a measured one is not:
            so 0 suits simulated motion and 1 or more suits measured motion.
        device: Warp device.
        threads: CPU threads.
    """

    def __init__(
        self, samples: Dataset, *, exact: bool = True, substeps: int = 2, device: str = "cpu", threads: int = 1
    ) -> None:
        self.samples, self.exact, self.substeps = samples, exact, substeps
        self.device, self.threads = device, threads
        self._kernel, self._states = replay_kernel, 0
        self._record([np.empty(0)] * 3, np.empty((len(HEAT_TIMES), 0)), None, np.zeros(len(samples.dt)), np.empty(0))

    def torque(self, rows: np.ndarray | Sequence[Mapping[str, float]]) -> np.ndarray:
        """Simulated torque, float32, shape (C, N), of rows of shape (C, WIDTH) or of named parameters of the laws."""
        if not isinstance(rows, np.ndarray):
            rows = np.stack([row_of(values) for values in rows])
        rows = np.atleast_2d(rows)
        # rows differ in what they cost: more parts than threads
        count = max(-(-len(rows) * len(self.samples.q) // _BATCH), min(4 * self.threads, len(rows)))
        tau = np.empty((len(rows), len(self.samples.q)), dtype=np.float32)
        cuts = np.linspace(0, len(rows), count + 1).astype(int)
        parts = [slice(a, b) for a, b in zip(cuts[:-1], cuts[1:], strict=True)]
        with ThreadPoolExecutor(self.threads) as pool:
            list(pool.map(lambda part: self._launch(rows[part], tau[part]), parts))
        return tau

    def _record(
        self,
        motion: Sequence[np.ndarray],
        heat: np.ndarray,
        temperature: np.ndarray | None,
        begin: np.ndarray,
        middle: np.ndarray,
    ) -> None:
        """Put the arrays of the samples on the device."""
        s = self.samples
        self._arrays: list[wp.array | None] = [self._array(x) for x in (s.q, s.qd, s.current, *motion, heat)]
        self._arrays.append(None if temperature is None else self._array(temperature))
        self._arrays.append(wp.array(s.start.astype(np.int32), dtype=int, device=self.device))
        self._arrays += [self._array(x) for x in (s.dt, begin, middle)]

    def _launch(self, rows: np.ndarray, tau: np.ndarray) -> None:
        trajectories = len(self.samples.dt)
        base, values = (self._array(part) for part in np.split(rows, [len(BASE)], axis=1))
        memory = wp.zeros((len(rows) * trajectories, self._states), dtype=float, device=self.device)
        out = wp.array(tau, dtype=float, device=self.device, copy=False)
        wp.launch(
            self._kernel,
            dim=(len(rows), trajectories),
            inputs=[base, values, int(self.exact), self.substeps, *self._arrays],
            outputs=[memory, out],
            device=self.device,
        )
        if self.device != "cpu":
            tau[:] = out.numpy()

    def _array(self, x: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(x, dtype=np.float32), dtype=float, device=self.device)


class EffectReplay(Replay):
    """Motion on a device, ready to be simulated with effects (rows of :mod:`mrwarp.identify.parameters`)."""

    def __init__(self, motion: Motion, *, device: str = "cpu", threads: int = 1) -> None:
        super().__init__(motion, device=device, threads=threads)
        self.motion = motion
        self._kernel, self._states = effect_replay_kernel, SLOTS
        begin = np.zeros(len(motion.dt)) if motion.begin is None else motion.begin
        self._record(
            (motion.qdd, motion.time, motion.slid_time), motion.heat, motion.temperature, begin, motion.middles
        )
        self._kept: dict[bytes, np.ndarray] = {}

    def torque(self, rows: np.ndarray | Sequence[Mapping[str, float]]) -> np.ndarray:
        """As of :class:`Replay`; rows that were asked for shortly before are not simulated again."""
        if not isinstance(rows, np.ndarray) or rows.size * len(self.samples.q) > _KEPT * WIDTH // 4:
            return super().torque(rows)  # many rows at once, as of a screening, come once
        rows = np.atleast_2d(rows)
        keys = [row.tobytes() for row in rows.astype(np.float32)]
        new = {key: i for i, key in enumerate(keys) if key not in self._kept}
        found = dict(zip(new, super().torque(rows[list(new.values())]), strict=True)) if new else {}
        found = {key: found[key] if key in found else self._kept.pop(key) for key in dict.fromkeys(keys)}
        self._kept |= found  # the newest last
        while len(self._kept) * len(self.samples.q) > _KEPT:
            del self._kept[next(iter(self._kept))]
        return np.stack([found[key] for key in keys])


def simulate(
    values: Mapping[str, float], recording: Recording, *, exact: bool = True, substeps: int = 2
) -> list[np.ndarray]:
    """Torque [unit of the recording] that eqs. 14 and 15 give along each trajectory; ``q_neutral`` is 0 on a bench.

    Args:
        values: Parameters in the units of the recording; those that are missing are 0.
        recording: The motion.
        exact: As in :class:`Replay`.
        substeps: As in :class:`Replay`.
    """
    samples = Dataset.of(recording)
    scales = samples.scales
    known = {"q_offset", "q_center", *BASE}
    inner = {name: value / scales.factor(name) for name, value in values.items() if name in known}
    tau = Replay(samples, exact=exact, substeps=substeps).torque([inner])[0].astype(float) * scales.torque
    return [tau[part] for part in samples.parts]
