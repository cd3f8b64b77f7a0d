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
"""A window whose mismatch is this many times the median one is left out: a fall, a hand that touched the robot."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Quadratic forms of W windows in the P parameters, about the origin of the parameters."""

    a: np.ndarray
    """Information, shape (W, P, P)."""
    b: np.ndarray
    """Score at the origin, shape (W, P)."""
    c: np.ndarray
    """Weighted squared mismatch at the origin, shape (W,)."""
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
    prior: np.ndarray,
    log: Callable[[str], None],
) -> Evidence:
    """Replay all windows at ``theta`` and around it.

    Args:
        model: The robot.
        groups: Windows, see :func:`mrwarp.robot_logs.windows.cut_windows`.
        parameters: P parameters.
        theta: Values about which derivatives are taken, shape (P,).
        prior: Precision of a robot's parameters about the origin, by which the channels' weights are found, (P, P).
        log: Told of progress.
    """
    found = [_derivatives(model, windows, parameters, theta, log) for windows in groups]
    names = list(found[0][0])
    sigma = {name: _rms([r[name] for r, _, _ in found]) for name in names}
    a = b = c = np.zeros(0)
    keep = np.ones(0, dtype=bool)
    for round_ in range(ROUNDS):
        pieces = [_reduced(r, j, z, sigma) for r, j, z in found]
        a, b, c = (np.concatenate([p[i] for p in pieces]) for i in range(3))
        b, c = b + a @ theta, c + 2.0 * b @ theta + np.einsum("wij,i,j->w", a, theta, theta)
        keep = _usable(a, b, c, prior)
        if round_ == ROUNDS - 1:
            break
        best = np.linalg.solve(a[keep].sum(axis=0) + prior, b[keep].sum(axis=0))
        left, first = [], 0
        for r, j, z in found:
            count = len(next(iter(r.values())))
            left.append(_left(r, j, z, sigma, best - theta, keep[first : first + count]))
            first += count
        sigma = {name: _rms([x[name] for x in left]) for name in names}
    run = np.concatenate([w.run for w in groups])
    samples = sum(int(np.prod(next(iter(r.values())).shape[:2])) for r, _, _ in found)
    a, b, c, run = a[keep], b[keep], c[keep], run[keep]
    return Evidence(
        a=a, b=b, c=c, scale=_overstated(a, b, prior), sigma=sigma, run=run, samples=samples, lost=int((~keep).sum()),
        starts=tuple(z for _, _, z in found), keep=keep,
    )  # fmt: skip


def replayed(
    evidence: Evidence, model: ReplayModel, groups: Sequence[Windows], parameters: list[Parameter], theta: np.ndarray
) -> float:
    """Weighted squared mismatch at parameters, as the replay has it: what :meth:`Evidence.at` foretells [1]."""
    total, first = 0.0, 0
    for windows, z in zip(groups, evidence.starts, strict=True):
        count = windows.count
        changes = Hypotheses.of(parameters, np.tile(theta, (count, 1)), model)
        start = np.zeros((count, len(nuisances(model))))
        left = mismatch(windows.measured, Replay(model, windows).run(changes, np.arange(count), start))
        for w in np.flatnonzero(evidence.keep[first : first + count]).tolist():
            r = np.concatenate([(left[n][w] / evidence.sigma[n]).ravel() for n in left])
            if not np.isfinite(r).all():
                return np.inf
            zw = np.concatenate([(z[n][:, w] / evidence.sigma[n]).reshape(len(z[n]), -1) for n in left], axis=1)
            zw = zw.astype(float)
            total += r @ r - (zw @ r) @ np.linalg.solve(zw @ zw.T + np.eye(len(zw)) / START_SPREAD**2, zw @ r)
        first += count
    return float(total)


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
    model: ReplayModel, groups: Sequence[Windows], parameters: list[Parameter], theta: np.ndarray, prior: np.ndarray,
    low: np.ndarray, high: np.ndarray, log: Callable[[str], None], *, steps: int = 4,
) -> np.ndarray:  # fmt: skip
    """Likeliest parameters within bounds, by damped Gauss-Newton steps that the replay itself confirms; shape (P,)."""
    damping = 1e-3
    for _ in range(steps):
        evidence = gather(model, groups, parameters, theta, prior, log)
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
            return theta
        theta, damping = new, max(damping / 10.0, 1e-6)
        if here - there < CONVERGED:
            break
    return theta


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


def _usable(a: np.ndarray, b: np.ndarray, c: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Windows whose mismatch at the best parameters is of the usual size."""
    best = np.linalg.solve(a.sum(axis=0) + prior, b.sum(axis=0))
    left = c - 2.0 * b @ best + np.einsum("wij,i,j->w", a, best, best)
    return np.isfinite(left) & (left < WORST**2 * np.median(left))


def _overstated(a: np.ndarray, b: np.ndarray, prior: np.ndarray) -> float:
    """How much larger the scores' spread over windows is than their information says, in the median [1]."""
    total = a.sum(axis=0)
    best = np.linalg.solve(total + prior, b.sum(axis=0))
    scores = b - a @ best
    known = np.diag(total) > 1e-9 * np.diag(total).max()
    ratio = (scores**2).sum(axis=0)[known] / np.diag(total)[known]
    return float(max(np.median(ratio), 1.0))
