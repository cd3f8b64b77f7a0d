"""What a log says of every number: derivatives of the replays, freed of what is unknown about each window's start.

Around a robot ``theta`` the mismatch of window w is ``r_w - J_w*(change) - Z_w*(start)``. The start is eliminated with
its prior, channels weigh by what is left in them, and what remains is a quadratic form per window: the unit by which
evidence is counted, because samples of a window are not independent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mrwarp.robot_logs.causes import Parameter
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.window_replay import Hypotheses, Replay, mismatch, nuisances
from mrwarp.robot_logs.windows import Windows

START_SPREAD = 1.0
"""Standard deviation of a window's start, in the steps of :func:`mrwarp.robot_logs.window_replay.nuisances`."""

DERIVATIVE_STEP = 0.0051
"""Longest physics step of the replays from which derivatives are taken [s]; mismatches are those of the fine step."""

CENTRAL = ("kp", "kd", "strength", "mass", "armature")
"""Fields with central derivatives: a factor on all torques and masses changes nothing, but their curvature would."""

CENTRAL_SHARE = 0.1
"""Their steps, in the parameters' own."""

ROUNDS = 4
"""Times that channels are weighed anew by what is left in them."""

CONVERGED = 2.0
"""Gain of a step, in units of twice the logarithm of a likelihood, below which a fit ends."""

WORST = 4.0
"""A window whose mismatch is this many times the median one is left out: a fall, a hand that touched the robot. Others
count less, the more is left in them than in the median one: small errors of some grow to large ones."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Quadratic forms of W windows in the P parameters, about the origin of the parameters."""

    a: np.ndarray
    """Information, shape (W, P, P)."""
    b: np.ndarray
    """Score at the origin, shape (W, P)."""
    c: np.ndarray
    """Weighted squared mismatch at the origin, shape (W,)."""
    weight: np.ndarray
    """By which each window counts in these, shape (W,)."""
    scale: float
    """Factor by which information is overstated, samples being correlated and the simulation never quite right."""
    sigma: dict[str, np.ndarray]
    """What is left in each channel, by name, shape (C,)."""
    run: np.ndarray
    """Run of each window, shape (W,)."""
    samples: int
    """Readings of all windows that count."""
    lost: int
    """Windows left out."""
    starts: tuple[dict[str, np.ndarray], ...] = ()
    """Derivatives by the windows' start, of each group by channel, shape (Z, W, S, C)."""
    keep: np.ndarray
    """Whether each window of the groups counts."""

    def at(self, theta: np.ndarray) -> float:
        """Weighted squared mismatch at parameters, as the derivatives have it [1]."""
        a, b = self.a.sum(axis=0), self.b.sum(axis=0)
        return float(self.c.sum() - 2.0 * b @ theta + theta @ a @ theta)


def gather(
    model: ReplayModel,
    groups: Sequence[Windows],
    parameters: list[Parameter],
    theta: np.ndarray,
    log: Callable[[str], None],
) -> Evidence:
    """Replay all windows at ``theta`` and around it.

    Channels and windows are weighed by what is left in them when every number may be a fault: by what a healthy robot
    would leave, a fault would hide itself behind the low weight of the channel in which it shows.

    Args:
        model: The robot.
        groups: Windows, see :func:`mrwarp.robot_logs.windows.cut_windows`.
        parameters: P parameters.
        theta: Values about which derivatives are taken, shape (P,).
        log: Told of progress.
    """
    found = [_derivatives(model, windows, parameters, theta, log) for windows in groups]
    names = list(found[0][0])
    sigma = {name: _rms([r[name] for r, _, _ in found]) for name in names}
    a = b = c = weight = np.zeros(0)
    keep = np.ones(0, dtype=bool)
    prior = np.diag([1.0 / (p.spread**2 + p.fault**2) for p in parameters])
    for round_ in range(ROUNDS):
        pieces = [_reduced(r, j, z, sigma) for r, j, z in found]
        a, b, c = (np.concatenate([p[i] for p in pieces]) for i in range(3))
        b, c = b + a @ theta, c + 2.0 * b @ theta + np.einsum("wij,i,j->w", a, theta, theta)
        best, weight, keep = _weighed(a, b, c, prior)
        if round_ == ROUNDS - 1:
            break
        left, first = [], 0
        for r, j, z in found:
            count = len(next(iter(r.values())))
            left.append(_left(r, j, z, sigma, best - theta, keep[first : first + count]))
            first += count
        sigma = {name: _rms([x[name] for x in left]) for name in names}
    run = np.concatenate([w.run for w in groups])
    samples = sum(int(np.prod(next(iter(r.values())).shape[:2])) for r, _, _ in found)
    weight = weight[keep]
    a, b, c, run = weight[:, None, None] * a[keep], weight[:, None] * b[keep], weight * c[keep], run[keep]
    return Evidence(
        a=a, b=b, c=c, weight=weight, scale=_overstated(a, b, prior), sigma=sigma, run=run, samples=samples,
        lost=int((~keep).sum()), starts=tuple(z for _, _, z in found), keep=keep,
    )  # fmt: skip


def replayed(
    evidence: Evidence, model: ReplayModel, groups: Sequence[Windows], parameters: list[Parameter], theta: np.ndarray
) -> float:
    """Weighted squared mismatch at parameters, as the replay has it: what :meth:`Evidence.at` foretells [1]."""
    left, _ = losses(evidence, model, groups, parameters, np.tile(theta, (len(evidence.c), 1)))
    return float(evidence.weight @ left)


def losses(
    evidence: Evidence, model: ReplayModel, groups: Sequence[Windows], parameters: list[Parameter], theta: np.ndarray
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """What the replay leaves of each window that counts.

    Args:
        evidence: Weights, derivatives by the windows' start, and which of the groups' windows count.
        model: The robot.
        groups: The windows of ``evidence``.
        parameters: P parameters.
        theta: Values for each of the W windows that count, shape (W, P).

    Returns:
        Weighted squared mismatch beside the best start [1], shape (W,), infinite where the replay broke; and by channel
        the mean square of the mismatch from the logged start, in the channel's unit squared, (W, C) without columns
        that the log does not have.
    """
    totals, squares, first, done = [], {}, 0, 0
    for windows, z in zip(groups, evidence.starts, strict=True):
        own = np.flatnonzero(evidence.keep[first : first + windows.count])
        first += windows.count
        if not len(own):
            continue
        changes = Hypotheses.of(parameters, theta[done : done + len(own)], model)
        start = np.zeros((len(own), len(nuisances(model))))
        seen = {name: x[own] for name, x in windows.measured.items()}
        left = mismatch(seen, Replay(model, windows).run(changes, own, start))
        for name, zero in mismatch(seen, seen).items():
            read = np.isfinite(zero)
            left[name] = np.where(read, left[name], 0.0)  # joints without a device have no current
            squares.setdefault(name, []).append((left[name] ** 2).mean(axis=1)[:, read.any(axis=(0, 1))])
        for i, w in enumerate(own.tolist()):
            r = np.concatenate([(left[n][i] / evidence.sigma[n]).ravel() for n in left])
            if not np.isfinite(r).all():
                totals.append(np.inf)
                continue
            zw = np.concatenate([(z[n][:, w] / evidence.sigma[n]).reshape(len(z[n]), -1) for n in left], axis=1)
            zw = zw.astype(float)
            totals.append(r @ r - (zw @ r) @ np.linalg.solve(zw @ zw.T + np.eye(len(zw)) / START_SPREAD**2, zw @ r))
        done += len(own)
    return np.array(totals), {name: np.concatenate(x) for name, x in squares.items()}


def within(
    information: np.ndarray, score: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Minimum of ``x.information.x/2 - score.x`` within bounds, and whether each number is held at one; shapes (P,)."""
    free = np.ones(len(score), dtype=bool)
    x = np.zeros(len(score))
    for _ in range(30):
        if free.any():
            rest = score[free] - information[np.ix_(free, ~free)] @ x[~free]
            x[free] = np.linalg.solve(information[np.ix_(free, free)], rest)
        out = free & ((x < low) | (x > high))
        x = np.clip(x, low, high)
        if out.any():
            free &= ~out
            continue
        pull = score - information @ x  # a number that is held, but drawn inwards, is let go
        inwards = ~free & (low < high) & np.where(x <= low, pull > 1e-9, pull < -1e-9)
        if not inwards.any():
            break
        free |= inwards
    return x, ~free


def fit(
    model: ReplayModel, groups: Sequence[Windows], parameters: list[Parameter], theta: np.ndarray,
    evidence: Evidence | None, prior: np.ndarray, low: np.ndarray, high: np.ndarray, log: Callable[[str], None], *,
    steps: int = 4,
) -> tuple[np.ndarray, Evidence]:  # fmt: skip
    """Likeliest parameters within bounds, by damped Gauss-Newton steps that the replay itself confirms.

    ``evidence`` is that about ``theta``, where it is known; returned are parameters, shape (P,), and that about them.
    """
    damping = 1e-3
    evidence = evidence or gather(model, groups, parameters, theta, log)
    for _ in range(steps):
        a, b = evidence.a.sum(axis=0) / evidence.scale, evidence.b.sum(axis=0) / evidence.scale
        here = evidence.at(theta) / evidence.scale + theta @ prior @ theta
        there = np.inf
        for _ in range(5):
            more = damping * np.diag(np.diag(a + prior))
            new, _ = within(a + prior + more, b + more @ theta, low, high)
            there = replayed(evidence, model, groups, parameters, new) / evidence.scale + new @ prior @ new
            if there < here:
                break
            damping *= 10.0
        if not there < here:
            break
        theta, damping = new, max(damping / 10.0, 1e-6)
        evidence = gather(model, groups, parameters, theta, log)
        if here - there < CONVERGED:
            break
    return theta, evidence


def _derivatives(model, windows, parameters, theta, log) -> tuple[dict, dict, dict]:  # noqa: ANN001
    """Mismatch (W, S, C), derivatives by parameter (P, W, S, C) and by start (Z, W, S, C), by channel, float32."""
    times = max(1, int(np.floor(DERIVATIVE_STEP / windows.h + 1e-6)))
    fine, replay = Replay(model, windows), Replay(model, windows.coarse(times))
    count, steps = windows.count, nuisances(model)
    every, rest = np.arange(count), np.zeros((count, len(steps)))

    def run(values: np.ndarray, start: np.ndarray, by: Replay = replay) -> dict[str, np.ndarray]:
        return by.run(Hypotheses.of(parameters, np.tile(values, (count, 1)), model), every, start)

    base = run(theta, rest)
    r = {name: x.astype(np.float32) for name, x in mismatch(windows.measured, run(theta, rest, fine)).items()}
    j = {name: np.zeros((len(parameters), *x.shape), dtype=np.float32) for name, x in r.items()}
    z = {name: np.zeros((len(steps), *x.shape), dtype=np.float32) for name, x in r.items()}
    for k, p in enumerate(parameters):
        if k % 10 == 0:
            log(f"replaying {count} windows: {p.cause} ({k} of {len(parameters)})")
        step = (CENTRAL_SHARE if p.field in CENTRAL else 1.0) * p.step
        ahead, behind = theta.copy(), theta.copy()
        ahead[k] += step
        behind[k] -= step if p.field in CENTRAL else 0.0
        for name, x in mismatch(run(ahead, rest), run(behind, rest) if p.field in CENTRAL else base).items():
            j[name][k] = x / (ahead[k] - behind[k])
    for k, step in enumerate(steps):
        start = rest.copy()
        start[:, k] = step
        for name, x in mismatch(run(theta, start), base).items():
            z[name][k] = x  # per step
    for values in (*r.values(), *j.values(), *z.values()):
        np.nan_to_num(values, copy=False, posinf=0.0, neginf=0.0)
    return r, j, z


def _rms(values: list[np.ndarray]) -> np.ndarray:
    """Root mean square by channel over the middle of the windows, shape (C,)."""
    squares = np.concatenate([(x.astype(float) ** 2).mean(axis=1) for x in values])
    limit = np.quantile(squares, 0.9, axis=0)
    return np.sqrt(
        np.maximum(np.where(squares <= limit, squares, 0.0).sum(axis=0) / (squares <= limit).sum(axis=0), 1e-16)
    )


def _reduced(r: dict, j: dict, z: dict, sigma: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Quadratic forms of a group's windows about its theta: shapes (W, P, P), (W, P), (W,)."""
    first = next(iter(r.values()))
    count, params = first.shape[0], next(iter(j.values())).shape[0]
    a, b, c = np.zeros((count, params, params)), np.zeros((count, params)), np.zeros(count)
    for w in range(count):
        rw, jw, zw = _window(r, j, z, sigma, w)
        start = zw @ zw.T + np.eye(len(zw)) / START_SPREAD**2
        solved = np.linalg.solve(start, np.column_stack([zw @ jw.T, zw @ rw]))
        a[w] = jw @ jw.T - (zw @ jw.T).T @ solved[:, :-1]
        b[w] = jw @ rw - (zw @ jw.T).T @ solved[:, -1]
        c[w] = rw @ rw - (zw @ rw) @ solved[:, -1]
    return a, b, c


def _window(r: dict, j: dict, z: dict, sigma: dict, w: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    parts = [(r[n][w] / sigma[n], j[n][:, w] / sigma[n], z[n][:, w] / sigma[n]) for n in r]
    rw = np.concatenate([p[0].ravel() for p in parts]).astype(float)
    jw = np.concatenate([p[1].reshape(len(p[1]), -1) for p in parts], axis=1).astype(float)
    zw = np.concatenate([p[2].reshape(len(p[2]), -1) for p in parts], axis=1).astype(float)
    return rw, jw, zw


def _left(r: dict, j: dict, z: dict, sigma: dict, change: np.ndarray, keep: np.ndarray) -> dict[str, np.ndarray]:
    """Mismatch that is left at a change of the parameters and the best starts, windows that count."""
    found = {name: [] for name in r}
    for w in np.flatnonzero(keep).tolist():
        rw, jw, zw = _window(r, j, z, sigma, w)
        rest = rw - change @ jw
        rest = rest - np.linalg.solve(zw @ zw.T + np.eye(len(zw)) / START_SPREAD**2, zw @ rest) @ zw
        at = 0
        for name in r:
            shape = r[name][w].shape
            size = int(np.prod(shape))
            found[name].append(rest[at : at + size].reshape(shape) * sigma[name])
            at += size
    return {name: np.array(values) for name, values in found.items()}


def _weighed(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, prior: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Best parameters, (P,); by which each window counts, (W,); and whether its mismatch there is of the usual size."""
    keep, weight = np.isfinite(c), np.ones(len(c))
    best = np.zeros(len(prior))
    for _ in range(ROUNDS):
        own = weight * keep
        best = np.linalg.solve(np.einsum("w,wpq->pq", own, a) + prior, own @ b)
        left = c - 2.0 * b @ best + np.einsum("wij,i,j->w", a, best, best)
        usual = float(np.median(left))
        keep = np.isfinite(left) & (left < WORST**2 * usual)
        weight = np.minimum(usual / np.maximum(left, 1e-12), 1.0)
    return best, weight, keep


def _overstated(a: np.ndarray, b: np.ndarray, prior: np.ndarray) -> float:
    """How much larger the scores' spread over windows is than their information says, in the median [1]."""
    total = a.sum(axis=0)
    best = np.linalg.solve(total + prior, b.sum(axis=0))
    scores = b - a @ best
    known = np.diag(total) > 1e-9 * np.diag(total).max()
    ratio = (scores**2).sum(axis=0)[known] / np.diag(total)[known]
    return float(max(np.median(ratio), 1.0))
