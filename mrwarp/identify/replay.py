"""Replay: the torque of recorded motion by the simulator's own kernels, for many parameter sets in one launch.

All parameters are in the inner units of the data set (:mod:`mrwarp.identify.dataset`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import warp as wp

from mrwarp.effects.catalogue import SLOTS
from mrwarp.effects.replay_kernel import BASE, extended_replay_kernel
from mrwarp.identify.dataset import Dataset, Motion, Scales
from mrwarp.kernels.joint_params import JointParams
from mrwarp.kernels.replay_kernel import Extension, replay_kernel
from mrwarp.recording.load import Recording

_RECORD: np.dtype = np.dtype(JointParams.numpy_dtype())  # pyright: ignore[reportCallIssue,reportArgumentType]
_EXTENSION: np.dtype = np.dtype(Extension.numpy_dtype())  # pyright: ignore[reportCallIssue,reportArgumentType]
_BATCH = 16_000_000
"""Samples times candidates of one launch: bounds the memory of its output to 64 MB."""


class Replay:
    """Samples on a device, ready to be simulated with many parameter sets.

    Args:
        samples: The recorded motion.
        exact: Step z by its closed form; False: the paper's Euler step.
        substeps: Parts of each sampling step, through interpolated velocity. 0: the simulator's own step,
            which holds the newest velocity. A simulated velocity is the mean over its step, a measured one is not:
            so 0 suits simulated motion and 1 or more suits measured motion.
        device: Warp device.
    """

    def __init__(self, samples: Dataset, *, exact: bool = True, substeps: int = 2, device: str = "cpu") -> None:
        self.samples = samples
        self.exact, self.substeps, self.device = exact, substeps, device
        s = samples
        self._arrays = [wp.array(x.astype(np.float32), dtype=float, device=device) for x in (s.q, s.qd, s.current)]
        self._arrays.append(wp.array(s.start.astype(np.int32), dtype=int, device=device))
        self._arrays.append(wp.array(s.dt.astype(np.float32), dtype=float, device=device))

    def torque(self, candidates: Sequence[Mapping[str, float]]) -> np.ndarray:
        """Simulated torque, float32, shape (C, N), of parameter sets given in inner units; what is not named is 0."""
        num, size = len(self.samples.q), len(candidates)
        tau = np.empty((size, num), dtype=np.float32)
        step = max(1, _BATCH // num)
        for at in range(0, size, step):
            rows, extension = _rows(candidates[at : at + step])
            out = wp.empty((len(rows), num), dtype=float, device=self.device)
            params = wp.array(rows, dtype=JointParams, device=self.device)
            extensions = wp.array(extension, dtype=Extension, device=self.device)
            wp.launch(
                replay_kernel,
                dim=(len(rows), len(self.samples.dt)),
                inputs=[params, extensions, int(self.exact), self.substeps, *self._arrays],
                outputs=[out],
                device=self.device,
            )
            tau[at : at + step] = out.numpy()
        return tau


class EffectReplay:
    """Motion on a device, ready to be simulated with many rows of parameters (:mod:`mrwarp.identify.parameters`)."""

    def __init__(self, motion: Motion, *, device: str = "cpu", threads: int = 1) -> None:
        self.motion, self.device, self.threads = motion, device, threads
        m = motion
        self._arrays = [_array(x, device) for x in (m.q, m.qd, m.qdd, m.current, m.time, m.slid_time, m.heat)]
        self._arrays.append(wp.array(m.start.astype(np.int32), dtype=int, device=device))
        begin = np.zeros(len(m.dt)) if m.begin is None else m.begin
        self._arrays += [_array(m.dt, device), _array(begin, device)]

    def torque(self, rows: np.ndarray) -> np.ndarray:
        """Simulated torque, float32, shape (C, N), of rows of inner parameters, shape (C, WIDTH)."""
        rows = np.atleast_2d(rows)
        tau = np.empty((len(rows), len(self.motion.q)), dtype=np.float32)
        threads = 1 if len(rows) == 1 else self.threads
        cuts = np.linspace(0, len(rows), threads + 1).astype(int)
        parts = [slice(a, b) for a, b in zip(cuts[:-1], cuts[1:], strict=True)]
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda part: self._launch(rows[part], tau[part]), parts))
        return tau

    def _launch(self, rows: np.ndarray, tau: np.ndarray) -> None:
        trajectories = len(self.motion.dt)
        base, values = (_array(part, self.device) for part in np.split(rows, [len(BASE)], axis=1))
        memory = wp.zeros((len(rows) * trajectories, SLOTS), dtype=float, device=self.device)
        out = wp.array(tau, dtype=float, device=self.device, copy=False)
        wp.launch(
            extended_replay_kernel,
            dim=(len(rows), trajectories),
            inputs=[base, values, *self._arrays],
            outputs=[memory, out],
            device=self.device,
        )
        if self.device != "cpu":
            tau[:] = out.numpy()


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
    scales = Scales.of(recording)
    samples = Dataset.of(recording, scales)
    inner = {name: value / scales.factor(name) for name, value in values.items() if name in JointParams.vars}
    inner["q_neutral"] = 0.0
    tau = Replay(samples, exact=exact, substeps=substeps).torque([inner])[0].astype(float) * scales.torque
    return [tau[part] for part in samples.parts]


def _rows(candidates: Sequence[Mapping[str, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Parameter and extension structs of the candidates, each of shape (C,)."""
    rows, extension = np.zeros(len(candidates), dtype=_RECORD), np.zeros(len(candidates), dtype=_EXTENSION)
    rows["z_max"] = np.inf
    for k, values in enumerate(candidates):
        for name, value in values.items():
            (rows if name in JointParams.vars else extension)[name][k] = value
    return rows, extension


def _array(x: np.ndarray, device: str) -> wp.array:
    return wp.array(np.ascontiguousarray(x, dtype=np.float32), dtype=float, device=device)
