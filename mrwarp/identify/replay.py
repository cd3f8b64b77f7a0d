"""Replay: the torque of recorded motion by the simulator's own kernels, for many parameter sets in one launch.

Inside, motion, current and torque are divided by scales of the recording, so that float32 kernels, search ranges and
steps are the same for a 26 N·m joint and a 2 kN damper. Time stays in seconds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import warp as wp

from mrwarp.kernels.joint_params import JointParams
from mrwarp.kernels.replay_kernel import Extension, replay_kernel
from mrwarp.recording.load import Recording

_RECORD: np.dtype = np.dtype(JointParams.numpy_dtype())  # pyright: ignore[reportCallIssue,reportArgumentType]
_EXTENSION: np.dtype = np.dtype(Extension.numpy_dtype())  # pyright: ignore[reportCallIssue,reportArgumentType]
_BATCH = 16_000_000
"""Samples times candidates of one launch: bounds the memory of its output to 64 MB."""

_SETTLED = 4.0
"""Yield travels after which the unknown initial z is forgotten to exp(-4) = 2 %."""

DIMENSIONS: dict[str, tuple[int, int, int]] = {
    "q_neutral": (1, 0, 0), "q_offset": (1, 0, 0), "q_center": (1, 0, 0), "z_max": (1, 0, 0),
    "D": (0, 0, 1), "B": (-1, 0, 1), "C": (-1, 0, 1), "I1": (0, -1, 1), "K0": (-1, 0, 1), "K1": (-1, -1, 1),
    "alpha": (-1, 0, 0), "beta": (-1, 0, 0), "gamma": (-1, 0, 0),
    "B_current": (-1, -1, 1), "B_direction": (-1, 0, 1), "B_direction_current": (-1, -1, 1),
}  # fmt: skip
"""Powers of the scales (q, current, torque) in each parameter; the others carry none of them, or only seconds."""


@dataclass(frozen=True, kw_only=True)
class Scales:
    """What one unit inside means outside: motion [rad or m], current [A], torque [N·m or N]."""

    q: float = 1.0
    current: float = 1.0
    torque: float = 1.0

    @classmethod
    def of(cls, recording: Recording) -> Self:
        """Robust scales: median amplitude of the trajectories, largest current, 95th percentile of the torque."""
        runs = recording.trajectories
        amplitude = float(np.median([0.5 * np.ptp(np.percentile(run.q, (1, 99))) for run in runs]))
        largest = max(float(np.abs(run.current).max()) for run in runs)
        torque = np.concatenate([run.torque for run in runs])
        spread = float(np.percentile(np.abs(torque - np.median(torque)), 95))
        return cls(q=amplitude or 1.0, current=largest or 1.0, torque=spread or 1.0)

    def factor(self, name: str) -> float:
        """Factor from the inner value of a parameter to the outer one."""
        q, current, torque = DIMENSIONS.get(name, (0, 0, 0))
        return self.q**q * self.current**current * self.torque**torque


@dataclass(frozen=True, kw_only=True)
class Samples:
    """The samples of all trajectories end to end, divided by ``scales``; float64, shape (N,)."""

    q: np.ndarray
    qd: np.ndarray
    current: np.ndarray
    torque: np.ndarray
    start: np.ndarray
    """First sample of each trajectory and the end of the last one, shape (T + 1,)."""
    dt: np.ndarray
    """Sampling step of each trajectory [s], shape (T,)."""
    scales: Scales

    @classmethod
    def of(cls, recording: Recording, scales: Scales) -> Self:
        """Lay the trajectories of a recording end to end."""
        runs = recording.trajectories
        lengths = [len(run.t) for run in runs]
        return cls(
            q=np.concatenate([run.q for run in runs]) / scales.q,
            qd=np.concatenate([run.qd for run in runs]) / scales.q,
            current=np.concatenate([run.current for run in runs]) / scales.current,
            torque=np.concatenate([run.torque for run in runs]) / scales.torque,
            start=np.concatenate([[0], np.cumsum(lengths)]),
            dt=np.array([run.dt for run in runs]),
            scales=scales,
        )

    @property
    def parts(self) -> list[slice]:
        """The samples of each trajectory."""
        return parts_of(self.start)

    def settled(self, rate: float) -> np.ndarray:
        """Weight 0 while the unknown initial z still shows, at most a tenth of each trajectory; else 1; shape (N,).

        Args:
            rate: How fast z forgets along the way, beta plus or minus gamma, the slower [1/inner unit of q].
        """
        weight = np.ones(len(self.q))
        for part, dt in zip(self.parts, self.dt, strict=True):
            way = np.cumsum(np.abs(self.qd[part])) * dt
            first = min(int(np.searchsorted(way, _SETTLED / rate)), (part.stop - part.start) // 10)
            weight[part.start : part.start + first] = 0.0
        return weight


def parts_of(start: np.ndarray) -> list[slice]:
    """Slices between the first samples of trajectories laid end to end and the end of the last, shape (T + 1,)."""
    return [slice(int(a), int(b)) for a, b in zip(start[:-1], start[1:], strict=True)]


def rms(x: np.ndarray) -> float:
    """Root of the mean square of all values."""
    return float(np.sqrt(np.mean(x**2)))


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

    def __init__(self, samples: Samples, *, exact: bool = True, substeps: int = 2, device: str = "cpu") -> None:
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
    samples = Samples.of(recording, scales)
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
