"""Measured motion, current and torque as every fit takes them: one immutable data set.

A :class:`Dataset` lays the trajectories of a recording end to end and divides them by scales of the recording, so that
float32 kernels, search ranges and steps are the same for a 26 N·m joint and a 2 kN damper ("normalised units"). Time
stays in seconds. A :class:`Motion` is a data set whose motion was reconstructed from its log, with what effects need.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import lfilter

from mrwarp.effects.law import Ranges
from mrwarp.effects.replay_kernel import HEAT_TIMES
from mrwarp.identify.kinematics import Kinematics, reconstruct
from mrwarp.recording.blocks import is_cut
from mrwarp.recording.data import is_load, quantity, session_clock
from mrwarp.recording.load import Recording
from mrwarp.sysid.settings import Settings

_SETTLED = 4.0
"""Yield travels after which the unknown initial z is forgotten to exp(-4) = 2 %."""
_STRETCH = 3.0
"""Shortest stretch that is taken of a longer trajectory [s]."""
_GOLDEN = 0.618
"""The golden section."""
_SAME_RATE = 0.01
"""Relative difference of two sampling steps up to which they are one rate: clocks differ by less."""
MOVING = 0.05
"""Part of the typical speed above which the joint moves, and of the largest input from which it steps."""
_WHOLE = 0.95
"""Part of a turn that counts as a whole one."""

DIMENSIONS: dict[str, tuple[int, int, int]] = {
    **dict.fromkeys(("q_neutral", "q_offset", "q_center", "z_max"), (1, 0, 0)),
    **dict.fromkeys(("alpha", "beta", "gamma"), (-1, 0, 0)),
    **dict.fromkeys(("B", "C", "K0", "B_direction"), (-1, 0, 1)),
    **dict.fromkeys(("K1", "B_current", "B_direction_current"), (-1, -1, 1)),
    "D": (0, 0, 1),
    "I1": (0, -1, 1),
}
"""Powers of the scales (q, current, torque) in each parameter; the others carry none of them, or only seconds."""


def sample_noise(samples: Dataset, x: np.ndarray) -> float:
    """Standard deviation of what changes from sample to sample: noise that is white is no less.

    From third differences, in which a smooth motion's share is small, by their median.
    """
    bends = np.concatenate([np.diff(x[part], 3) for part in samples.parts])
    return float(1.4826 * np.median(np.abs(bends)) / np.sqrt(20.0))


def rms(x: np.ndarray) -> float:
    """Root of the mean square of all values."""
    return float(np.sqrt(np.mean(x**2)))


def parts_of(start: np.ndarray) -> list[slice]:
    """Slices between the first samples of trajectories laid end to end and the end of the last, shape (T + 1,)."""
    return [slice(int(a), int(b)) for a, b in zip(start[:-1], start[1:], strict=True)]


def of_commonest_rate(dt: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Whether each trajectory has the sampling rate of most samples, bool, shape (T,).

    ``dt`` are the sampling steps, shape (T,), ``start`` the first samples and the end of the last, shape (T + 1,).
    """
    near = np.abs(dt / dt[:, None] - 1.0) < _SAME_RATE
    return near[int(np.argmax(near @ np.diff(start)))]


@dataclass(frozen=True, kw_only=True)
class Scales:
    """Size of one inner unit: motion [rad or m], current [A], torque [N·m or N]."""

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
class Dataset:
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
    known: np.ndarray | None = None
    """False where the torque is unknown, as its sensor was at the end of its range, or a spike; (N,); None: nowhere."""
    cut: bool = False
    """Whether the trajectories are blocks of longer ones, so that any of them may begin under way."""

    @classmethod
    def of(cls, recording: Recording, scales: Scales | None = None) -> Dataset:
        """The samples as recorded, in normalised units of ``scales`` (None: those of the recording)."""
        runs, scales = recording.trajectories, scales or Scales.of(recording)
        return Dataset(
            q=np.concatenate([run.q for run in runs]) / scales.q,
            qd=np.concatenate([run.qd for run in runs]) / scales.q,
            current=np.concatenate([run.current for run in runs]) / scales.current,
            torque=np.concatenate([run.torque for run in runs]) / scales.torque,
            start=np.concatenate([[0], np.cumsum([len(run.t) for run in runs])]),
            dt=np.array([run.dt for run in runs]),
            scales=scales,
            known=np.concatenate([run.known for run in runs]) if any(run.lost is not None for run in runs) else None,
            cut=is_cut(recording),
        )

    @property
    def counts(self) -> np.ndarray:
        """Weight 1 where the torque was measured, else 0; shape (N,)."""
        return np.ones(len(self.q)) if self.known is None else self.known.astype(float)

    @property
    def parts(self) -> list[slice]:
        """The samples of each trajectory."""
        return parts_of(self.start)

    def settled(self, rate: float) -> np.ndarray:
        """Weight 0 while the unknown initial z still shows, at most a tenth of each trajectory; else 1; shape (N,).

        A stretch out of the middle of a trajectory may begin with any z: there it is at most the half.

        Args:
            rate: How fast z forgets along the path, beta plus or minus gamma, the slower [1/inner unit of q].
        """
        part_of = 2 if self.cut or getattr(self, "middle", None) is not None else 10
        weight = self.counts
        for part, dt in zip(self.parts, self.dt, strict=True):
            path = np.cumsum(np.abs(self.qd[part])) * dt
            first = min(int(np.searchsorted(path, _SETTLED / rate)), (part.stop - part.start) // part_of)
            weight[part.start : part.start + first] = 0.0
        return weight

    def subset(self, limit: int, seed: int) -> Dataset:
        """At most about ``limit`` samples: a stretch of each of up to 24 trajectories spread over current and speed."""
        if len(self.q) <= limit:
            return self
        parts = self.parts
        order = sorted(
            range(len(parts)), key=lambda k: (np.abs(self.current[parts[k]]).mean(), self.qd[parts[k]].std())
        )
        chosen = [order[i] for i in np.unique(np.linspace(0, len(order) - 1, min(24, len(order))).astype(int))]
        length = max(50, limit // len(chosen))
        rng = np.random.default_rng(seed)
        index = []
        for k in chosen:
            spare = max(0, parts[k].stop - parts[k].start - length)
            first = parts[k].start + int(rng.integers(spare + 1))
            index.append(np.arange(first, min(first + length, parts[k].stop)))
        pick = np.concatenate(index)
        start = np.concatenate([[0], np.cumsum([len(i) for i in index])])
        arrays = {name: getattr(self, name)[pick] for name in ("q", "qd", "current", "torque")}
        known = None if self.known is None else self.known[pick]
        return Dataset(**arrays, start=start, dt=self.dt[chosen], scales=self.scales, known=known, cut=self.cut)


@dataclass(frozen=True, kw_only=True)
class Motion(Dataset):
    """A data set with its reconstructed motion and further signals for effects; normalised units, float64."""

    qdd: np.ndarray
    """Acceleration by zero-phase local polynomials, shape (N,)."""
    time: np.ndarray
    """Time in the session [s], or in each trajectory where these share no clock, shape (N,)."""
    slid_time: np.ndarray
    """Time counted by the path length slid, as long as the longest, shape (N,)."""
    heat: np.ndarray
    """Heat stored since then for each of ``HEAT_TIMES``, shape (len(HEAT_TIMES), N)."""
    ranges: Ranges
    kinematics: Kinematics
    temperature: np.ndarray | None = None
    """Logged temperature [degC], shape (N,); None: none that changes."""
    resistance: float = 0.0
    """Coil resistance for the computed heat [Ohm]."""
    begin: np.ndarray | None = None
    """Direction in which the joint had slid before the first sample of each trajectory: -1, 1, or 0 for a device at
    rest without stress; None: 0 for all; shape (T,)."""
    middle: np.ndarray | None = None
    """Middle of the angles of each trajectory, shape (T,); None: of the samples that are here."""
    ahead: float = 0.0
    """Samples by which the motion was shifted because the torque is logged ahead of it."""
    medians: int = 1
    """Samples over which the current is a median, because its sensor is noisy."""

    @classmethod
    def of(
        cls,
        recording: Recording,
        scales: Scales | None = None,
        *,
        resistance: float = 0.0,
        rests: bool = False,
        smoothing: float = 1.0,
        settings: Settings | None = None,
    ) -> Motion:
        """Reconstruct the motion of a recording.

        Args:
            recording: Measured runs.
            scales: Units inside; None: those of the recording.
            resistance: Coil resistance for the heat [Ohm].
            rests: Whether the joint is held still where it seems to rest.
            smoothing: Divisor of the smoother's bandwidth.
            settings: Rules by which a log is read; None: the defaults.
        """
        data = Dataset.of(recording, scales)
        kinematics = reconstruct(recording, rests=rests, smoothing=smoothing, settings=settings)
        scales = data.scales
        data = dataclasses.replace(data, qd=kinematics.qd / scales.q)
        clock = session_clock(recording)
        alone, begins = clock is None, np.zeros(len(data.dt)) if clock is None else clock
        time = np.concatenate(
            [run.t - run.t[0] + begin for run, begin in zip(recording.trajectories, begins, strict=True)]
        )
        power = np.abs(data.torque * data.qd)
        power += resistance * data.current**2 * scales.current**2 / (scales.torque * scales.q)
        speed = np.abs(data.qd)
        fast = float(np.percentile(speed, 95)) or 1.0
        of_runs = [float(np.percentile(speed[part], 95)) for part in data.parts]
        logged = [run.temperature for run in recording.trajectories if run.temperature is not None]
        temperature = np.concatenate(logged) if len(logged) == len(data.dt) and np.ptp(np.concatenate(logged)) else None
        ranges = Ranges(
            q=float(np.ptp(data.q)) or 1.0,
            qd=fast,
            slow=float(np.percentile([v for v in of_runs if v > MOVING * fast], 25)) if speed.any() else fast,
            current=float(np.abs(data.current).max()) or 1.0,
            torque=float(data.torque.std()) or 1.0,
            dt=float(np.median(data.dt)),
            session=float(time.max()) or 1.0,
            temperature=0.0 if temperature is None else float(temperature.mean()),
            radian=1.0 / scales.q if recording.units["q"] == "rad" else 0.0,
            turns=_turns(float(np.ptp(data.q)) * scales.q) if recording.units["q"] == "rad" else 0.0,
            load=is_load(recording.units),
            carried=is_load(recording.units) and quantity("current", recording.units) != "pressure",
            drive=quantity("torque", recording.units) in ("motor current", "motor voltage"),
        )
        slid = _slid(data, time, alone=alone)
        return cls(
            **vars(data),
            qdd=kinematics.qdd / scales.q,
            time=time,
            slid_time=slid * time.max() / max(float(slid.max()), 1e-12),
            heat=np.stack([_heat(power, time, data, tau, alone=alone) for tau in HEAT_TIMES]),
            ranges=ranges,
            kinematics=kinematics,
            temperature=temperature,
            resistance=resistance,
        )

    @property
    def middles(self) -> np.ndarray:
        """Middle of the angles of each trajectory, shape (T,)."""
        if self.middle is not None:
            return self.middle
        return np.array([0.5 * (self.q[part].min() + self.q[part].max()) for part in self.parts])

    @property
    def uncertain(self) -> np.ndarray:
        """Samples for which it is unknown whether the joint moves, bool, shape (N,)."""
        uncertain = self.kinematics.uncertain
        return np.zeros(len(self.qdd), dtype=bool) if uncertain is None else uncertain

    @property
    def rests(self) -> list[slice]:
        """Stretches in which the joint is held still."""
        still = self.kinematics.still
        if still is None:
            return []
        firsts = np.isin(np.arange(len(still)), self.start)
        begins = np.flatnonzero(still & (firsts | ~np.roll(still, 1)))
        ends = np.flatnonzero(still & np.roll(firsts | ~still, -1)) + 1
        return [slice(int(a), int(b)) for a, b in zip(begins, ends, strict=True)]

    def quieter(self, width: int) -> Motion:
        """The motion with medians over ``width`` samples of the current."""
        medians = [median_filter(self.current[part], width, mode="nearest") for part in self.parts]
        return dataclasses.replace(self, current=np.concatenate(medians), medians=width)

    def later(self, shift: float) -> Motion:
        """The motion that was ``shift`` samples later; the last sample of a trajectory is held."""
        shifted = {name: getattr(self, name).copy() for name in ("q", "qd", "qdd")}
        for part in self.parts:
            at = np.arange(part.stop - part.start)
            for x in shifted.values():
                x[part] = np.interp(at + shift, at, x[part])
        return dataclasses.replace(self, **shifted, ahead=self.ahead + shift)

    def stretches(self, limit: int, fewest: int | None = None) -> Motion:
        """At most about ``limit`` samples: of each trajectory one stretch, elsewhere in it from one to the next.

        A stretch begins while the joint moves, and goes on to: its first tenth holds at least half of the path that a
        tenth may hold, so that its hysteresis is known before the first rest. What depends on the past (heat, path,
        time in the session) is that of the whole recording.

        Args:
            limit: Samples, more where the shortest stretches (3 s) are together.
            fewest: Trajectories to which their number may fall then, taken evenly; None: all stay.
        """
        share, taken = limit / len(self.q), []
        if share >= 1.0:
            return self
        sizes = np.diff(self.start)
        lengths = np.minimum(sizes, np.maximum(np.round(share * sizes), np.round(_STRETCH / self.dt)).astype(int))
        chosen = np.arange(len(sizes))
        if fewest is not None:
            count = max(int(len(sizes) * limit / lengths.sum()), fewest)
            # by steps of the golden section no regular order of the trajectories is met twice at the same place
            chosen = np.sort(np.argsort(_GOLDEN * chosen % 1.0)[:count])
        for k in chosen:
            part, size, length = self.parts[k], int(sizes[k]), int(lengths[k])
            first = part.start + int((_GOLDEN * k % 1.0) * (size - length))
            speed = np.abs(self.qd[part])
            path = np.concatenate([[0.0], np.cumsum(speed)])
            ahead = path[length // 10 : length // 10 + size - length + 1] - path[: size - length + 1]
            moves = speed[: size - length + 1] > MOVING * self.ranges.qd
            begins = np.flatnonzero(moves & (2.0 * ahead > ahead.max()))
            if len(begins):
                first = part.start + int(begins[np.argmin(np.abs(begins + part.start - first))])
            taken.append(np.arange(first, first + length))
        at, k = np.concatenate(taken), self.kinematics
        masks = ("uncertain", "still", "reversing", "one_sided")
        known = {name: None if (x := getattr(k, name)) is None else x[at] for name in masks}
        return dataclasses.replace(
            self,
            **{name: getattr(self, name)[at] for name in ("q", "qd", "qdd", "current", "torque", "time", "slid_time")},
            known=None if self.known is None else self.known[at],
            dt=self.dt[chosen],
            begin=None if self.begin is None else self.begin[chosen],
            middle=self.middles[chosen],
            heat=self.heat[:, at],
            temperature=None if self.temperature is None else self.temperature[at],
            start=np.cumsum([0, *(len(stretch) for stretch in taken)]),
            kinematics=dataclasses.replace(k, qd=k.qd[at], qdd=k.qdd[at], **known),
        )

    def under_way(self) -> Motion:
        """The motion with trajectories that begin while the joint moves taken as cut out of a longer motion."""
        first = self.qd[self.start[:-1]]
        begin = np.where(np.abs(first) > MOVING * self.ranges.qd, np.sign(first), 0.0)
        return dataclasses.replace(self, begin=begin)


def _turns(way: float) -> float:
    """Full turns within a range of angles [rad]; a sweep over one turn may end a little short of it."""
    return float(way // (_WHOLE * 2.0 * np.pi))


def _slid(data: Dataset, time: np.ndarray, *, alone: bool) -> np.ndarray:
    """Path length slid since the session began, or ``alone`` since each trajectory did, shape (N,)."""
    out, before, parts = np.empty_like(time), 0.0, data.parts
    for k in np.argsort(time[data.start[:-1]], kind="stable"):
        part = parts[k]
        path = (0.0 if alone else before) + np.cumsum(np.abs(data.qd[part])) * data.dt[k]
        out[part], before = path, float(path[-1])
    return out


def _heat(power: np.ndarray, time: np.ndarray, data: Dataset, time_constant: float, *, alone: bool) -> np.ndarray:
    """Solution of ``ds/dt = power - s/T`` through the session, rests included, or ``alone`` from each start; (N,)."""
    out, parts = np.empty_like(power), data.parts
    stored, end = 0.0, 0.0
    for k in np.argsort(time[data.start[:-1]], kind="stable"):
        part, dt = parts[k], data.dt[k]
        stored *= 0.0 if alone else np.exp(-max(0.0, time[part.start] - end) / time_constant)
        keep = np.exp(-dt / time_constant)
        heat, _ = lfilter([dt], [1.0, -keep], power[part], zi=[keep * stored])
        out[part] = heat
        stored, end = float(heat[-1]), float(time[part.stop - 1])
    return out
