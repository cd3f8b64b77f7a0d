"""The motion behind a log: angle and velocity channel brought together, and whether the velocity lags behind.

The hysteresis follows the *path* of the joint: noise of a velocity channel, summed up as path while the joint rests,
would wear its stress away, and a loop that is steeper in one direction makes a steady pull of it. So angle and velocity
are smoothed together, by the least squares of a joint whose jerk is white noise (a Kalman smoother written as one
banded system), without any phase. Where the joint rests, the velocity is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter, savgol_filter

from mrwarp.recording.load import Recording, Trajectory
from mrwarp.sysid.settings import Reading, Settings

_BANDWIDTHS = (25.0, 50.0, 100.0)
"""Bandwidths of the smoother [Hz], narrowest first: wider where the angle holds more motion and the rate allows it."""
_CERTAIN = 1e4
"""Weight of a velocity that is known, over all others."""
_LAG_STEPS = 4
"""Steps of the fit of the lag; the first takes it as small against the motion's periods."""

_WINDOW = 0.1
"""Standstill: time in which nothing moves beyond the noise [s], and at least ten samples."""
_EDGE = 0.03
"""Time at each end of a rest in which nobody knows whether the joint moves already, or still [s]."""
_SPREAD = 0.25
"""Time over which the smoother spreads a step of the acceleration to each side, in periods of its bandwidth."""
_SCATTER = 1.8
"""Largest standard deviation of a resting angle over that of its noise; 1.73 for a reading that flips by one step."""
_STEPS, _ON_GRID = 10, 0.1
"""Changes between readings at rest that give the step of the angle's encoder, and by how much nine in ten of
them may differ from whole steps."""
_T = 3.0
"""Standard errors by which the halves of a rest, or its velocity and 0, may differ."""


@dataclass(frozen=True)
class Kinematics:
    """Motion of all trajectories end to end; float64, shape (N,), units of the recording."""

    qd: np.ndarray
    """Velocity as logged, without its noise: it still lags if the channel does."""
    qdd: np.ndarray
    """Its derivative."""
    velocity_lag: float
    """Time constant by which the velocity channel lags behind the angle [s]; 0 if none can be shown."""
    velocity_lag_error: float
    """Its standard error [s]; infinity where there is no velocity channel."""
    rests: bool = False
    """Whether the joint was held still where it seems to rest."""
    uncertain: np.ndarray | None = None
    """Whether a sample is at the edge of such a rest, shape (N,); None: none is."""
    still: np.ndarray | None = None
    """Whether it is inside one, shape (N,); None: none is."""
    smoothing: float = 1.0
    """Divisor of the smoother's bandwidth."""
    reversing: np.ndarray | None = None
    """Whether a sample is so near a start, a stop or a reversal that an acceleration which jumps there is not known,
    shape (N,); None: none is."""
    one_sided: np.ndarray | None = None
    """Whether a sample is so near an end of its run that the smoother sees one side of it only, shape (N,); there an
    acceleration is not known. None: none is."""
    settings: Settings = field(default_factory=Settings)
    """Rules by which the log was read."""


def reconstruct(
    recording: Recording, *, rests: bool = True, smoothing: float = 1.0, settings: Settings | None = None
) -> Kinematics:
    """Smooth the motion of a recording; with ``rests``, nothing moves where it changes by no more than its noise.

    The bandwidth that the angle asks for is divided by ``smoothing``. ``settings`` say what rests, and what a lag is;
    None: the defaults.
    """
    settings = settings or Settings()
    runs = recording.trajectories
    sigma_q = angle_noise(runs)
    sigma_v, lag, error = float("inf"), 0.0, float("inf")
    of_speed = [run for run in runs if run.q_integrated]
    if not any(run.qd_derived for run in runs):
        sigma_v = float(np.median([_velocity_noise(run) for run in runs]))
    if not of_speed and np.isfinite(sigma_v):
        lag, error = _lag_of(recording, sigma_q)
        if lag < settings.gain.clear_t * error or lag < 1e-4:
            lag = 0.0
    qd, qdd, uncertain, still, reversing, one_sided = [], [], [], [], [], []
    known_q, known_v = sigma_q, sigma_v
    for run in runs:
        # an integrated angle knows nothing that the velocity does not
        sigma_q = float("inf") if run.q_integrated else known_q
        sigma_v = min(known_v, _velocity_noise(run)) if run.q_integrated else known_v
        bandwidth = _bandwidth(run, sigma_q, sigma_v, lag, settings.gain.half) / smoothing
        v = _without_lag(run, sigma_v, lag, bandwidth)
        known, at_edge = None, np.zeros(len(run.q), dtype=bool)
        if rests:
            known, at_edge = known_velocity(run, sigma_q, sigma_v, settings.reading.rest)
        still.append(np.zeros(len(run.q), dtype=bool) if known is None else np.isfinite(known))
        uncertain.append(at_edge)
        v, a = smooth(run.q, v, run.dt, sigma_q, sigma_v, bandwidth, known)
        _without_overshoot(v, at_edge, round(_EDGE / run.dt))
        reach, place = round(_SPREAD / bandwidth / run.dt), np.arange(len(v))
        reversing.append(near_reversals(v, still[-1], reach))
        one_sided.append((place < reach) | (place >= len(v) - reach))
        if lag > 0.0:
            late = lagged(v, lag, run.dt)
            v, a = late, (v - late) / lag
        qd.append(v)
        qdd.append(a)
    rested = np.concatenate(still)
    return Kinematics(
        qd=np.concatenate(qd),
        qdd=np.concatenate(qdd),
        velocity_lag=lag,
        velocity_lag_error=error,
        rests=bool(rested.any()),
        uncertain=np.concatenate(uncertain),
        still=rested,
        smoothing=smoothing,
        reversing=np.concatenate(reversing),
        one_sided=np.concatenate(one_sided),
        settings=settings,
    )


def near_reversals(qd: np.ndarray, still: np.ndarray, reach: int) -> np.ndarray:
    """Whether fewer than ``reach`` samples lie between a sample and a start, a stop or a reversal, shape (N,).

    Where a drive sets the torque, dry friction makes the acceleration of a joint jump there.
    """
    direction = np.where(still, 0.0, np.sign(qd))
    near = np.zeros(len(qd), dtype=bool)
    for k in np.flatnonzero(np.diff(direction)) + 1:
        near[max(k - reach, 0) : k + reach] = True
    return near


def _without_lag(run: Trajectory, sigma_v: float, lag: float, bandwidth: float) -> np.ndarray:
    """The velocity channel without its lag, shape (N,)."""
    if lag <= 0.0:
        return run.qd
    return run.qd + lag * smooth(run.q * 0.0 + np.nan, run.qd, run.dt, float("inf"), sigma_v, bandwidth)[1]


def _bandwidth(run: Trajectory, sigma_q: float, sigma_v: float, lag: float, less: float) -> float:
    """Bandwidth for a trajectory [Hz]: a bang-bang drive or a chirp needs more than a swing.

    What the smoother leaves beyond a channel's noise may be motion, and was where a wider one leaves clearly ``less``.
    """
    best, half_of_nyquist = _BANDWIDTHS[0], round(0.25 / run.dt, 3)  # a wider smoother follows the noise
    left = _left(run, sigma_q, sigma_v, lag, best)
    for bandwidth in _BANDWIDTHS[1:]:
        if (less * left < 1.0).all() or bandwidth > half_of_nyquist:
            break
        wider = _left(run, sigma_q, sigma_v, lag, bandwidth)
        if ((less * left >= 1.0) & (wider < less * left)).any():  # vibration above one band shows in the next only
            best, left = bandwidth, wider
    return best


def _left(run: Trajectory, sigma_q: float, sigma_v: float, lag: float, bandwidth: float) -> np.ndarray:
    """RMS of the smoother's rest over the noise: of the angle without slow drifts, and at the sharpest, shape (2,).

    The latter is of the velocity, or of the angle where there is no velocity: a joint that turns round at once does so
    in a small part of its run, but play and dry friction show there. What is left of an angle at a corner lasts for a
    period of the bandwidth.
    """
    channel = _without_lag(run, sigma_v, lag, bandwidth)
    v, _ = smooth(run.q, channel, run.dt, sigma_q, sigma_v, bandwidth)
    width = 2 * max(5, int(_WINDOW / run.dt)) + 1
    rest = run.q - np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1])) * run.dt])
    rest = (rest - uniform_filter1d(rest, width)) / sigma_q
    sharp = (v - channel) / sigma_v
    if np.isinf(sigma_v):
        sharp, width = rest, 2 * round(0.5 / bandwidth / run.dt) + 1
    return np.array([rest.std(), np.sqrt(np.percentile(uniform_filter1d(sharp**2, width), 95))])


def smooth(
    q: np.ndarray,
    qd: np.ndarray,
    dt: float,
    sigma_q: float,
    sigma_v: float,
    bandwidth: float = _BANDWIDTHS[0],
    known: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and acceleration of one trajectory, shape (N,) each.

    Args:
        q: Angle.
        qd: Velocity.
        dt: Sampling interval [s].
        sigma_q: Standard deviation of the angle's noise; infinite: the angle is ignored.
        sigma_v: Standard deviation of the velocity's noise; infinite: the velocity is ignored.
        bandwidth: Above that the motion holds nothing and its noise all [Hz].
        known: Velocity where it is known, shape (N,), NaN elsewhere.
    """
    omega = 2.0 * np.pi * bandwidth
    # states x, v*dt, a*dt^2; white jerk of the intensity that gives the bandwidth
    by_q = omega**6 * sigma_q**2 * dt if np.isfinite(sigma_q) else 0.0
    by_v = omega**4 * sigma_v**2 * dt if np.isfinite(sigma_v) else 0.0
    jerk = max(by_q, by_v) * dt**5
    step = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    spread = np.array([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1.0]])
    inverse = np.linalg.inv(spread) / jerk
    count = len(qd)
    weight = np.array([0.0 if np.isinf(sigma_q) else sigma_q**-2, 0.0 if np.isinf(sigma_v) else (sigma_v * dt) ** -2])
    measured = np.diag([*weight, 0.0])
    ahead = step.T @ inverse @ step
    diagonal = np.broadcast_to(measured + ahead + inverse, (count, 3, 3)).copy()
    diagonal[0] = measured + ahead
    diagonal[-1] = measured + inverse
    sure = np.zeros(count, dtype=bool) if known is None else np.isfinite(known)
    certain = (_CERTAIN * np.abs(diagonal).max(axis=(1, 2)))[sure]
    diagonal[sure, 1, 1] += certain
    neighbour = -step.T @ inverse
    band = np.zeros((6, 3 * count))
    for i in range(3):
        for j in range(3):
            if j >= i:
                band[5 - (j - i), j::3] = diagonal[:, i, j]
            offset = 3 + j - i
            if offset <= 5:
                band[5 - offset, 3 + j :: 3] = neighbour[i, j]
    right = np.zeros((count, 3))
    if weight[0] > 0.0:
        right[:, 0] = weight[0] * (q - q[0])
    if weight[1] > 0.0:
        right[:, 1] = weight[1] * qd * dt
    if weight[0] == 0.0:
        band[5, 0] += inverse[0, 0]  # the angle's origin is free
    if known is not None:
        right[sure, 1] += certain * known[sure] * dt
    scale = band[5].max()
    state = solveh_banded(band / scale, right.ravel() / scale).reshape(count, 3)
    return state[:, 1] / dt, state[:, 2] / dt**2


def _lag_of(recording: Recording, sigma_q: float) -> tuple[float, float]:
    """Time constant of the velocity channel against the angle, and its standard error over trajectories [s]."""
    runs = recording.trajectories
    motions = [smooth(run.q, run.qd, run.dt, sigma_q, float("inf")) for run in runs]
    lag, error = 0.0, float("inf")
    for _ in range(_LAG_STEPS):  # Gauss-Newton: dv/dT = -a, both behind the lag
        late = [(lagged(v, lag, run.dt), lagged(a, lag, run.dt)) for run, (v, a) in zip(runs, motions, strict=True)]
        inner = slice(20, -20)
        miss = [((v - run.qd) * a)[inner].sum() for run, (v, a) in zip(runs, late, strict=True)]
        top, bottom = np.array(miss), np.array([(a**2)[inner].sum() for _, a in late])
        if bottom.sum() <= 0.0:
            return 0.0, float("inf")
        step = float(top.sum() / bottom.sum())
        error = float(np.sqrt(((top - step * bottom) ** 2).sum()) / bottom.sum())
        lag = max(lag + step, 0.0)
    return lag, max(error, 2e-5)


def lagged(x: np.ndarray, time_constant: float, dt: float) -> np.ndarray:
    """First-order lag that starts settled, exact for a signal that is linear between its samples."""
    if time_constant <= 0.0:
        return x
    keep = np.exp(-dt / time_constant)
    ramp = time_constant * (1.0 - keep) / dt
    return np.asarray(lfilter([1.0 - ramp, ramp - keep], [1.0, -keep], x, zi=[ramp * x[0]])[0])


def angle_noise(runs: Sequence[Trajectory]) -> float:
    """Noise of the angle: that of the median run, at least that of its encoder's step where half of them show it."""
    by_step = [noise for run in runs if (noise := _step_noise(run)) > 0.0]
    least = float(np.median(by_step)) if 2 * len(by_step) >= len(runs) else 0.0
    return max(least, float(np.median([_angle_noise(run) for run in runs])))


def _angle_noise(run: Trajectory) -> float:
    """Noise of the angle: what a cubic over nine samples leaves, at least what its steps make."""
    steps = np.abs(np.diff(run.q))
    steps = steps[steps > 1e-9 * max(float(np.ptp(run.q)), 1e-300)]
    quantum = float(steps.min()) / np.sqrt(12.0) if len(steps) else 0.0
    rest = run.q - savgol_filter(run.q, 9, 3)
    robust = 1.4826 * float(np.median(np.abs(rest)))
    typical = float(np.ptp(run.q)) * 1e-6
    return max(robust, min(quantum, float(rest.std()) + typical), typical, 1e-12)


def _step_noise(run: Trajectory) -> float:
    """Noise by the step between the readings at which the angle stands; 0 where these are on no grid.

    A log that was resampled has more values in between, and bends less at a step.
    """
    least = 1e-9 * max(float(np.ptp(run.q)), 1e-300)
    stands = np.abs(np.diff(run.q)) <= least
    steps = np.abs(np.diff(run.q[1:-1][stands[1:] & stands[:-1]]))
    steps = steps[steps > least]
    if len(steps) < _STEPS:
        return 0.0
    counts = steps / steps.min()
    if np.percentile(np.abs(counts - np.round(counts)), 90) > _ON_GRID:
        return 0.0
    left = float((run.q - savgol_filter(run.q, 9, 3)).std())
    return min(float(steps.min()) / np.sqrt(12.0), 2.0 * left)


def _velocity_noise(run: Trajectory) -> float:
    """Noise of the velocity: what a cubic over nine samples leaves."""
    rest = run.qd - savgol_filter(run.qd, 9, 3)
    return max(1.4826 * float(np.median(np.abs(rest))), 1e-5 * float(np.abs(run.qd).max()), 1e-12)


def known_velocity(
    run: Trajectory, sigma_q: float, sigma_v: float, shortest: float = Reading.rest
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity where a joint rests: 0, or the slope of the angle where it creeps.

    Returns:
        The velocity, NaN where it is not known, and whether a sample is at the edge of a rest; both of shape (N,).
    """
    size, edge = len(run.q), round(_EDGE / run.dt)
    known, uncertain = np.full(size, np.nan), np.zeros(size, dtype=bool)
    for part in resting(run.q, run.qd, run.dt, sigma_q, sigma_v, shortest):
        begin = part.start + edge if part.start else 0
        end = part.stop - edge if part.stop < size else size
        t = (np.arange(end - begin) - 0.5 * (end - begin - 1)) * run.dt
        slope, error = float(t @ run.q[begin:end] / (t @ t)), sigma_q / float(np.sqrt(t @ t))
        known[begin:end] = slope if abs(slope) > _T * error else 0.0
        uncertain[part.start : begin] = uncertain[end : part.stop] = True
    return known, uncertain


def _without_overshoot(v: np.ndarray, at_edge: np.ndarray, count: int) -> None:
    """Take from a velocity, shape (N,), what turns round at the edges of a rest, in place.

    The angle rests there within its noise: it is the smoother that swings through, and dry friction would keep the sign
    of that swing for as long as the joint rests. ``count`` samples outside of an edge say which way the joint moves.
    """
    changes = np.flatnonzero(np.diff(at_edge, prepend=False, append=False)).reshape(-1, 2)
    for begin, end in changes:
        before, after = v[max(begin - count, 0) : begin], v[end : end + count]
        outside = max(before, after, key=lambda x: float(np.abs(x).max(initial=0.0)))
        inside = v[begin:end]
        inside[inside * outside.sum() < 0.0] = 0.0


def resting(
    q: np.ndarray, qd: np.ndarray, dt: float, sigma_q: float, sigma_v: float, shortest: float = Reading.rest
) -> list[slice]:
    """Stretches of a trajectory whose angle and velocity change by no more than their noise.

    ``sigma_q`` and ``sigma_v`` are the standard deviations of their noise; the velocity is not looked at where the
    latter is infinite. ``dt`` is the sampling interval [s], ``shortest`` the least time at rest [s].
    """
    half = max(5, round(0.5 * _WINDOW / dt))
    width = 2 * half
    if len(q) < width:
        return []
    x = q - q.mean()
    sums, squares = (np.concatenate([[0.0], np.cumsum(y)]) for y in (x, x**2))
    mean = (sums[width:] - sums[:-width]) / width
    scatter = np.sqrt(np.maximum((squares[width:] - squares[:-width]) / width - mean**2, 0.0))
    halves = (sums[half:] - sums[:-half]) / half
    drift = np.abs(halves[half:] - halves[:-half])
    still = (scatter < _SCATTER * sigma_q) & (drift < _T * sigma_q * np.sqrt(2.0 / half))
    if np.isfinite(sigma_v):
        path = np.concatenate([[0.0], np.cumsum(qd)])
        # a channel without a reading of 0 stands at half a step to either side of it
        steps = np.abs(np.diff(qd))
        half_step = 0.5 * float(steps[steps > 0.0].min(initial=np.inf)) if (steps > 0.0).any() else 0.0
        still &= np.abs(path[width:] - path[:-width]) < (_T * sigma_v + 1.01 * half_step * np.sqrt(width)) * np.sqrt(
            width
        )
    inside = np.convolve(still, np.ones(width)) > 0.5  # every sample of a window that is still
    edges = np.flatnonzero(np.diff(inside, prepend=False, append=False))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2) if (b - a) * dt > shortest]
