"""Replay of recorded motion with every effect of the catalogue, for many parameter sets in one launch.

As in :mod:`mrwarp.identify.replay`, motion, current and torque are divided by scales of the recording.
"""

from __future__ import annotations

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import warp as wp
from scipy.signal import lfilter

from mrwarp.diagnose.effect_kernels import BASE, HEAT_TIMES, extended_replay_kernel
from mrwarp.diagnose.kinematics import Kinematics, reconstruct
from mrwarp.effects.catalogue import COLUMNS, NULLS, SLOTS
from mrwarp.effects.law import Ranges
from mrwarp.identify.replay import Samples, Scales
from mrwarp.recording.load import Recording

_MOVING = 0.05
"""Part of the typical speed above which the joint moves."""
WIDTH = len(BASE) + COLUMNS
"""Length of a row: the parameters of eqs. 14 and 15, then those of all effects."""


def null_row() -> np.ndarray:
    """A row at which no effect acts and eq. 14 gives no torque, shape (WIDTH,)."""
    return np.concatenate([np.zeros(len(BASE)), NULLS])


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Samples with what the effects need besides; inner units, float64."""

    samples: Samples
    qdd: np.ndarray
    """Acceleration by zero-phase local polynomials, shape (N,)."""
    time: np.ndarray
    """Time in the session [s], shape (N,)."""
    slid_time: np.ndarray
    """Time in the session counted by the way slid, as long as the session, shape (N,)."""
    heat: np.ndarray
    """Heat stored for each of ``HEAT_TIMES``, shape (len(HEAT_TIMES), N)."""
    ranges: Ranges
    kinematics: Kinematics
    resistance: float = 0.0
    """Coil resistance that the heat is reckoned with [Ohm]."""
    begin: np.ndarray | None = None
    """Direction in which the joint had slid before the first sample of each trajectory: -1, 1, or 0 for a device at
    rest without stress; None: 0 for all; shape (T,)."""

    ahead: float = 0.0
    """Samples by which the motion was shifted because the torque is logged ahead of it."""

    @property
    def doubtful(self) -> np.ndarray:
        """Samples of which nobody knows whether the joint moves, bool, shape (N,)."""
        doubtful = self.kinematics.doubtful
        return np.zeros(len(self.qdd), dtype=bool) if doubtful is None else doubtful

    def later(self, shift: float) -> Motion:
        """The motion that was ``shift`` samples later; the last sample of a trajectory is held."""
        s = self.samples
        q, qd, qdd = s.q.copy(), s.qd.copy(), self.qdd.copy()
        for part in s.parts:
            at = np.arange(part.stop - part.start)
            for x in (q, qd, qdd):
                x[part] = np.interp(at + shift, at, x[part])
        return dataclasses.replace(
            self, samples=dataclasses.replace(s, q=q, qd=qd), qdd=qdd, ahead=self.ahead + shift
        )  # fmt: skip

    def under_way(self) -> Motion:
        """The same motion with trajectories that begin while the joint moves cut out of a longer motion."""
        first = self.samples.qd[self.samples.start[:-1]]
        begin = np.where(np.abs(first) > _MOVING * self.ranges.qd, np.sign(first), 0.0)
        return dataclasses.replace(self, begin=begin)

    @classmethod
    def of(
        cls, recording: Recording, scales: Scales | None = None, *, resistance: float = 0.0, rests: bool = False
    ) -> Motion:
        """Prepare a recording.

        Args:
            recording: Measured runs.
            scales: Units inside; None: those of the recording.
            resistance: Coil resistance for the heat [Ohm].
            rests: Whether the joint is held still where it seems to rest.
        """
        scales = scales or Scales.of(recording)
        samples = Samples.of(recording, scales)
        kinematics = reconstruct(recording, rests=rests)
        samples = dataclasses.replace(samples, qd=kinematics.qd / scales.q)
        qdd = kinematics.qdd / scales.q
        clock = session_clock(recording)
        time = np.concatenate(
            [run.t - run.t[0] + begin for run, begin in zip(recording.trajectories, clock, strict=True)]
        )
        power = np.abs(samples.torque * samples.qd)
        power += resistance * samples.current**2 * scales.current**2 / (scales.torque * scales.q)
        speed = float(np.percentile(np.abs(samples.qd), 95)) or 1.0
        ranges = Ranges(
            q=float(np.ptp(samples.q)) or 1.0, qd=speed, current=float(np.abs(samples.current).max()) or 1.0,
            torque=float(samples.torque.std()) or 1.0, dt=float(np.median(samples.dt)),
            session=float(time.max()) or 1.0,
        )  # fmt: skip
        heat = np.stack([_heat(power, time, samples, tau) for tau in HEAT_TIMES])
        slid = _slid(samples, time)
        slid_time = slid * time.max() / max(float(slid.max()), 1e-12)
        return cls(
            samples=samples,
            qdd=qdd,
            time=time,
            slid_time=slid_time,
            heat=heat,
            ranges=ranges,
            kinematics=kinematics,
            resistance=resistance,
        )


def session_clock(recording: Recording) -> np.ndarray:
    """Time at which each trajectory starts [s], shape (T,).

    From the recorded times where they go on from one trajectory to the next; where all start alike, trajectories are
    taken as run one after the other in their order.
    """
    starts = np.array([run.t[0] for run in recording.trajectories])
    lengths = np.array([run.t[-1] - run.t[0] + run.dt for run in recording.trajectories])
    order = np.argsort(starts, kind="stable")
    apart = np.all(starts[order][1:] >= (starts + lengths)[order][:-1] - 1e-6)
    if len(starts) > 1 and apart:
        return starts - starts.min()
    return np.concatenate([[0.0], np.cumsum(lengths)[:-1]])


class ExtendedReplay:
    """Motion on a device, ready to be simulated with many rows of parameters."""

    def __init__(self, motion: Motion, *, device: str = "cpu", threads: int = 1) -> None:
        self.motion, self.device, self.threads = motion, device, threads
        s = motion.samples
        self._arrays = [_array(x, device) for x in (s.q, s.qd, motion.qdd, s.current, motion.time, motion.slid_time)]
        self._arrays.append(wp.array(motion.heat.astype(np.float32), dtype=float, device=device))
        self._arrays.append(wp.array(s.start.astype(np.int32), dtype=int, device=device))
        begin = np.zeros(len(s.dt)) if motion.begin is None else motion.begin
        self._arrays += [_array(s.dt, device), _array(begin, device)]

    def torque(self, rows: np.ndarray) -> np.ndarray:
        """Simulated torque, float32, shape (C, N), of rows of inner parameters, shape (C, WIDTH)."""
        rows = np.atleast_2d(rows)
        size, num = len(rows), len(self.motion.samples.q)
        tau = np.empty((size, num), dtype=np.float32)
        if self.threads == 1 or size == 1:
            self._launch(rows, tau)
            return tau
        cuts = np.linspace(0, size, self.threads + 1).astype(int)
        with ThreadPoolExecutor(self.threads) as pool:
            list(
                pool.map(
                    lambda ab: self._launch(rows[ab[0] : ab[1]], tau[ab[0] : ab[1]]),
                    zip(cuts[:-1], cuts[1:], strict=True),
                )
            )
        return tau

    def _launch(self, rows: np.ndarray, tau: np.ndarray) -> None:
        trajectories = len(self.motion.samples.dt)
        base = wp.array(np.ascontiguousarray(rows[:, : len(BASE)], dtype=np.float32), dtype=float, device=self.device)
        values = wp.array(np.ascontiguousarray(rows[:, len(BASE) :], dtype=np.float32), dtype=float, device=self.device)
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


def _array(x: np.ndarray, device: str) -> wp.array:
    return wp.array(x.astype(np.float32), dtype=float, device=device)


def _slid(samples: Samples, time: np.ndarray) -> np.ndarray:
    """Way slid since the session began, shape (N,)."""
    out, before = np.empty_like(time), 0.0
    for k in np.argsort([time[part.start] for part in samples.parts], kind="stable"):
        part = samples.parts[k]
        way = before + np.cumsum(np.abs(samples.qd[part])) * samples.dt[k]
        out[part], before = way, float(way[-1])
    return out


def _heat(power: np.ndarray, time: np.ndarray, samples: Samples, time_constant: float) -> np.ndarray:
    """Solution of ``ds/dt = power - s/T`` through the session, rests included, shape (N,)."""
    out = np.empty_like(power)
    stored, end = 0.0, 0.0
    order = np.argsort([time[part.start] for part in samples.parts], kind="stable")
    for k in order:
        part, dt = samples.parts[k], samples.dt[k]
        stored *= np.exp(-max(0.0, time[part.start] - end) / time_constant)
        keep = np.exp(-dt / time_constant)
        heat, _ = lfilter([dt], [1.0, -keep], power[part], zi=[keep * stored])
        out[part] = heat
        stored, end = float(heat[-1]), float(time[part.stop - 1])
    return out
