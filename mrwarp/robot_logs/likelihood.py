"""A log's quadratic likelihood in every number: derivatives of replays, without the unknown start of each window.

Around a robot ``theta`` the mismatch of window w is ``r_w - J_w*(change) - Z_w*(start)``. The start is eliminated with
its prior, channels weigh by what is left in them, and what remains is a quadratic form per window: the unit by which
evidence is counted, because samples of a window are not independent.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.slopes import Slopes, best_start, completed
from mrwarp.robot_logs.window_replay import ParameterBatch, Replay, nuisances
from mrwarp.robot_logs.windows import Windows, mismatch, side_by_side
from mrwarp.sysid.least_squares import Rules, minimise
from mrwarp.sysid.pieces import Pieces, Quadratic, about_origin
from mrwarp.sysid.settings import Settings

CURRENT = "current"
"""Channel of the coils' currents."""

LEAST_LEFT = {"q": 3e-4, "quat": 5e-4}
"""Least that counts as left in a channel of a robot on its feet [rad]: no simulation of standing feet is better, and of
a robot at rest smaller errors would be blamed on causes."""


@dataclass(frozen=True, kw_only=True)
class Likelihood(Pieces):
    """Quadratic likelihood: forms of W windows in the P parameters, about the origin of the parameters."""

    weight: np.ndarray
    """By which each window counts in these, shape (W,)."""
    scale: float
    """Factor by which information is overstated, samples being correlated and the simulation never quite right."""
    sigma: dict[str, np.ndarray]
    """Rest of each channel, by name, shape (C,)."""
    run: np.ndarray
    """Run of each window, shape (W,)."""
    samples: int
    """Readings of all windows, of those that repeat each other as of one."""
    lost: int
    """Windows left out."""
    slopes: tuple[Slopes, ...] = ()
    """Derivatives of each group's windows, those too that do not count."""
    rows: tuple[np.ndarray, ...] = ()
    """Mismatch of each group's windows where derivatives were taken, by the windows' own steps, (W, N)."""
    keep: np.ndarray
    """Whether each window of the groups counts."""
    settings: Settings = field(default_factory=Settings)
    """Numbers by which it is judged."""

    def at(self, theta: np.ndarray) -> float:
        """Weighted squared mismatch at parameters, as the derivatives have it [1]."""
        return float(self.left(theta).sum())

    def normal_equations(self) -> tuple[np.ndarray, np.ndarray]:
        """Information, (P, P), and score, (P,), of all windows, in units of a logarithm of a likelihood."""
        information, score = self.sums()
        return information / self.scale, score / self.scale

    def sized(self, x: np.ndarray, members: Sequence[int], low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Parameters with ``members`` as many times as large as the derivatives ask for, within bounds; shapes (P,)."""
        part = np.zeros(len(x))
        part[members] = x[members]
        whole, score = self.sums()
        rest, new = x - part, x.copy()
        information = part @ whole @ part
        times = part @ (score - whole @ rest) / information if information > 0.0 else 1.0
        new[members] = np.clip(times * x[members], low[members], high[members])
        return new

    def of(self, indices: Sequence[int]) -> Likelihood:
        """The likelihood of some of the parameters, the others as described."""
        k = list(indices)
        return replace(
            self,
            information=self.information[:, k][:, :, k],
            score=self.score[:, k],
            slopes=tuple(replace(x, j=x.j[:, k], about=x.about[k]) for x in self.slopes),
        )


def gather(
    model: ReplayModel,
    groups: Sequence[Windows],
    parameters: list[Parameter],
    theta: np.ndarray,
    log: Callable[[str], None],
    *,
    known: Likelihood | None = None,
) -> Likelihood:
    """Replay all windows at ``theta`` and around it.

    Channels and windows are weighed by what is left in them when every number may be a fault: by what a healthy robot
    would leave, a fault would hide itself behind the low weight of the channel in which it shows. Currents weigh by
    what is left when they alone are fitted: no step of the robot changes them, and its mismatch may forbid their cause.

    Args:
        model: The robot.
        groups: Windows, see :func:`mrwarp.robot_logs.windows.cut_windows`.
        parameters: P parameters.
        theta: Values about which derivatives are taken, shape (P,).
        log: Called with the progress.
        known: Likelihood of some of the windows with derivatives about the same ``theta``, which are kept.
    """
    have = known.slopes if known else ()
    slopes = [completed(have, model, windows, parameters, theta, log) for windows in groups]
    rows = [_mismatch(Replay(model, w), parameters, np.tile(theta, (w.count, 1)), np.arange(w.count)) for w in groups]
    broke = ~np.concatenate([np.isfinite(x.base + r).all(axis=1) for x, r in zip(slopes, rows, strict=True)])
    rows = [np.nan_to_num(x, posinf=0.0, neginf=0.0) for x in rows]
    alone = _currents_alone(slopes, rows)
    least = LEAST_LEFT if model.free else {}

    def left(rows: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
        return {name: np.maximum(x, least.get(name, 0.0)) for name, x in (_rms(slopes, rows) | alone).items()}

    sigma = left(rows)
    prior = np.diag([1.0 / (p.spread**2 + p.fault**2) for p in parameters])
    distinct = np.concatenate([w.distinct for w in groups])
    pieces, weight, keep = Pieces.of_grams(np.zeros((0, 1, 1))), np.zeros(0), np.ones(0, dtype=bool)
    rounds = model.settings.robot_fit.rounds
    for round_ in range(rounds):
        forms = [x.reduced(r, sigma) for x, r in zip(slopes, rows, strict=True)]
        a, b, c = (np.concatenate([form[i] for form in forms]) for i in range(3))
        c[broke] = np.inf
        pieces = about_origin(Pieces(information=a, score=b, square=c), theta)
        best, weight, keep = _weighed(pieces, prior, distinct, model.settings)
        if round_ == rounds - 1:
            break
        counts = np.split(keep, np.cumsum([w.count for w in groups])[:-1])
        sigma = left([_left(*x, sigma, best - theta) for x in zip(slopes, rows, counts, strict=True)])
    run = np.concatenate([w.run for w in groups])
    samples = round(sum(w.t.shape[1] * w.distinct.sum() for w in groups))
    weight = (weight * distinct)[keep]
    pieces = pieces.some(keep).times(weight)
    return Likelihood(
        **vars(pieces),
        weight=weight,
        scale=_overstated(pieces, prior),
        sigma=sigma,
        run=run[keep],
        samples=samples,
        lost=int((~keep).sum()),
        slopes=tuple(slopes),
        rows=tuple(rows),
        keep=keep,
        settings=model.settings,
    )


def replayed(
    likelihood: Likelihood,
    model: ReplayModel,
    groups: Sequence[Windows],
    parameters: list[Parameter],
    theta: np.ndarray,
) -> tuple[float, Likelihood]:
    """Weighted squared mismatch at parameters, as the replay has it: the value that :meth:`Likelihood.at` predicts [1].

    Steps are those of the derivatives where the robot is held, see :func:`_nearby`.

    Returns:
        It, and the likelihood about ``theta`` with the slopes and weights of ``likelihood``.
    """
    score, total = [], []
    every = np.tile(theta, (len(likelihood.square), 1))
    kept = _kept(likelihood, model, groups, parameters, every, nearby=not model.free)
    for slopes, (own, left) in zip(likelihood.slopes, kept, strict=True):
        sigma = slopes.scale(likelihood.sigma)
        for w, r in zip(own, left, strict=True):
            r, z = r / sigma, slopes.z[w] / sigma
            solved = best_start(z, r)
            clean = (r - solved @ z) / sigma
            score.append(slopes.j[w] @ clean.astype(np.float32))
            total.append(r @ r - (z @ r) @ solved)
    b, c = likelihood.weight[:, None] * np.array(score, dtype=float), likelihood.weight * np.array(total)
    if not np.isfinite(c).all():
        return np.inf, likelihood
    moved = about_origin(replace(likelihood, score=b, square=c), theta)
    return float(c.sum()), moved


def losses(
    likelihood: Likelihood,
    model: ReplayModel,
    groups: Sequence[Windows],
    parameters: list[Parameter],
    theta: np.ndarray,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Rest of each window that counts, by the replay.

    Args:
        likelihood: Weights, derivatives by the windows' start, and which of the groups' windows count.
        model: The robot.
        groups: The windows of ``likelihood``.
        parameters: P parameters.
        theta: Values for each of the W windows that count, shape (W, P).

    Returns:
        Weighted squared mismatch from the best start [1], shape (W,), infinite where the replay broke; and by channel
        the mean square of the mismatch from the logged start, in the channel's unit squared, (W, C) without columns
        that the log does not have.
    """
    totals, squares = [], {}
    for windows, slopes, (own, left) in zip(
        groups, likelihood.slopes, _kept(likelihood, model, groups, parameters, theta), strict=True
    ):
        zero = mismatch(windows.measured, windows.measured)
        for name, x in slopes.channels(left):
            read = np.isfinite(zero[name]).any(axis=(0, 1))
            squares.setdefault(name, []).append((x**2).mean(axis=1)[:, read])
        sigma = slopes.scale(likelihood.sigma)
        for w, r in zip(own, left / sigma, strict=True):
            if not np.isfinite(r).all():
                totals.append(np.inf)
                continue
            z = slopes.z[w] / sigma
            totals.append(r @ r - (z @ r) @ best_start(z, r))
    return np.array(totals), {name: np.concatenate(x) for name, x in squares.items()}


def left_by_each(
    likelihood: Likelihood,
    model: ReplayModel,
    groups: Sequence[Windows],
    parameters: list[Parameter],
    thetas: np.ndarray,
    *,
    every: int = 1,
) -> np.ndarray:
    """Weighted squared mismatch of H robots, (H, P), as the replay has it; in units of a likelihood, shape (H,).

    All of them are replayed at once, and those that break are infinitely far off. Of every so many windows that count
    one stands for all. Where the robot is held, or ``every`` is not 1, steps are those of the derivatives, see
    :func:`_nearby`.
    """
    found, first, done = np.zeros(len(thetas)), 0, 0
    for windows, slopes, rows in zip(groups, likelihood.slopes, likelihood.rows, strict=True):
        own = np.flatnonzero(likelihood.keep[first : first + windows.count])
        first += windows.count
        if not len(own):
            continue
        weight = likelihood.weight[done : done + len(own) : every]
        done += len(own)
        own, sigma = own[::every], slopes.scale(likelihood.sigma)
        robots = np.repeat(thetas, len(own), axis=0)
        where = np.tile(own, len(thetas))
        if model.free and every == 1:
            left = _mismatch(Replay(model, windows), parameters, robots, where) / sigma
        else:
            left = _nearby(model, slopes, rows, parameters, robots, where) / sigma
        for k, w in enumerate(own):
            z, r = slopes.z[w] / sigma, left[k :: len(own)]
            whole = np.asarray(np.isfinite(r).all(axis=1))
            r = np.where(whole[:, None], r, 0.0)
            start = best_start(z, r.T)
            loss = (r**2).sum(axis=1) - ((r @ z.T) * start.T).sum(axis=1)
            found += every * weight[k] * np.where(whole, loss, np.inf)
    return found / likelihood.scale


def _kept(
    likelihood: Likelihood,
    model: ReplayModel,
    groups: Sequence[Windows],
    parameters: list[Parameter],
    theta: np.ndarray,
    *,
    nearby: bool = False,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Of each group the windows that count, and their mismatch (W, N) at ``theta``, (W, P); 0 without a reading."""
    first = done = 0
    for windows, slopes, rows in zip(groups, likelihood.slopes, likelihood.rows, strict=True):
        own = np.flatnonzero(likelihood.keep[first : first + windows.count])
        first += windows.count
        left = np.zeros((0, slopes.j.shape[-1]))
        if len(own):
            each = theta[done : done + len(own)]
            if nearby:
                left = _nearby(model, slopes, rows, parameters, each, own)
            else:
                left = _mismatch(Replay(model, windows), parameters, each, own)
        yield own, left
        done += len(own)


def fit(
    model: ReplayModel,
    groups: Sequence[Windows],
    parameters: list[Parameter],
    theta: np.ndarray,
    likelihood: Likelihood | None,
    prior: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    log: Callable[[str], None],
    *,
    steps: int = 8,
    renew: int | None = None,
) -> tuple[np.ndarray, Likelihood, bool]:
    """Likeliest parameters within bounds, by damped Gauss-Newton steps that the replay itself confirms.

    Derivatives and weights stay those of ``likelihood``, about ``theta`` where it is given, while steps gain what they
    promise; ``renew`` times they are taken again, None takes the settings'. Returned are parameters, shape (P,), the
    likelihood about them, and whether its derivatives are of there, or of a step of each number around: they are
    differences over that step.
    """

    def quadratic(theta: np.ndarray, seen: Likelihood, loss: float) -> Quadratic:
        a, b = seen.normal_equations()
        value = loss / seen.scale + theta @ prior @ theta
        return Quadratic(float(value), a + prior, b - (a + prior) @ theta, seen)

    def about(theta: np.ndarray) -> Quadratic:
        new = gather(model, groups, parameters, theta, log)
        return quadratic(theta, new, new.at(theta))

    def holds(x: np.ndarray, near: Likelihood) -> bool:
        return all(bool((np.abs(x - own.about) <= step).all()) for own in near.slopes)

    def seen(theta: np.ndarray, here: Quadratic) -> Quadratic:
        log(f"replay {next(looks)}")
        near.append(holds(theta, here.content))
        loss, moved = replayed(here.content, model, groups, parameters, theta)
        return quadratic(theta, moved, loss)

    settings, looks, step = model.settings.robot_fit, itertools.count(1), np.abs([p.step for p in parameters])
    near: list[bool] = []
    rules = Rules(
        iterations=settings.trials * steps,
        steps=steps,
        damping=1e-3,
        increase=10.0,
        most=30.0,
        least=1e-6,
        predicted=lambda promised, loss: promised < settings.converged,
        gained=lambda gain, loss: gain < settings.converged,
        stale=lambda gain, promised: settings.converged <= gain < settings.trusted * promised and not near[-1],
        renewals=settings.renewals if renew is None else renew,
        lets_go=True,
    )
    start = None if likelihood is None else quadratic(theta, likelihood, likelihood.at(theta))
    found = minimise(about, theta, low, high, rules=rules, seen=seen, start=start)
    return found.x, found.quadratic.content, found.fresh or holds(found.x, found.quadratic.content)


def _mismatch(replay: Replay, parameters: list[Parameter], theta: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Mismatch of some windows, (E,), at parameters (E, P): shape (E, N), 0 where there is no reading."""
    start = np.zeros((len(own), len(nuisances(replay.model))))
    seen = {name: x[own] for name, x in replay.windows.measured.items()}
    left = mismatch(seen, replay.run(ParameterBatch.of(parameters, theta, replay.model), own, start))
    return side_by_side(
        {name: np.where(np.isnan(zero), 0.0, left[name]) for name, zero in mismatch(seen, seen).items()}
    )


def _nearby(
    model: ReplayModel,
    slopes: Slopes,
    rows: np.ndarray,
    parameters: list[Parameter],
    theta: np.ndarray,
    own: np.ndarray,
) -> np.ndarray:
    """As :func:`_mismatch`, by the steps of the derivatives: up to five times as long, in a fifth of the time.

    For searches about a robot that is held, and for screening: on feet long steps err by as much as a small cause
    changes. Where the derivatives were taken, the windows' own steps leave ``rows`` and these the slopes' base, (W, N).
    Their difference corrects what these leave elsewhere, so that both agree there.
    """
    return _mismatch(Replay(model, slopes.windows), parameters, theta, own) + (rows - slopes.base)[own]


def _rms(slopes: Sequence[Slopes], rows: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Root mean square by channel over the middle of the windows, shape (C,), of mismatches (W, N)."""
    found: dict[str, list[np.ndarray]] = {}
    for own, row in zip(slopes, rows, strict=True):
        for name, x in own.channels(row):
            found.setdefault(name, []).append((x**2).mean(axis=1))
    return {name: _middle(np.concatenate(x)) for name, x in found.items()}


def _currents_alone(slopes: Sequence[Slopes], rows: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Rest of coil currents, shape (C,), by the numbers with which they alone agree best; empty without."""
    if not slopes or CURRENT not in slopes[0].layout:
        return {}
    squares = []
    by_parameter, read = (
        [dict(own.channels(x))[CURRENT] for own, x in zip(slopes, values, strict=True)]
        for values in ([own.j for own in slopes], rows)
    )
    columns = read[0].shape[-1]
    best = np.zeros((by_parameter[0].shape[1], columns))
    for c in range(columns):
        j = np.concatenate([x[..., c].swapaxes(1, 2).reshape(-1, x.shape[1]) for x in by_parameter])
        shown = np.flatnonzero(j.any(axis=0))
        if len(shown):
            best[shown, c] = np.linalg.lstsq(j[:, shown], np.concatenate([x[..., c].ravel() for x in read]))[0]
    for x, r in zip(by_parameter, read, strict=True):
        squares.append(((r - np.einsum("wpsc,pc->wsc", x, best)) ** 2).mean(axis=1))
    return {CURRENT: _middle(np.concatenate(squares))}


def _middle(squares: np.ndarray) -> np.ndarray:
    """Root of the mean of all but the largest tenth, by column; (W, C) to (C,)."""
    counts = squares <= np.quantile(squares, 0.9, axis=0)
    return np.sqrt(np.maximum(np.where(counts, squares, 0.0).sum(axis=0) / counts.sum(axis=0), 1e-16))


def _left(slopes: Slopes, rows: np.ndarray, keep: np.ndarray, sigma: dict, change: np.ndarray) -> np.ndarray:
    """Mismatch that is left at a change of the parameters and the best starts of windows that count, (W, N)."""
    scale, found = slopes.scale(sigma), []
    for w in np.flatnonzero(keep).tolist():
        rest, z = (rows[w] - change @ slopes.j[w]) / scale, slopes.z[w] / scale
        found.append(scale * (rest - best_start(z, rest) @ z))
    return np.array(found).reshape(-1, rows.shape[1])


def _weighed(
    pieces: Pieces, prior: np.ndarray, distinct: np.ndarray, settings: Settings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Best parameters, (P,); weights of windows, (W,); and whether the mismatch of each there is of the usual size.

    ``distinct`` is each window's share of those that repeat each other; weights are without it.
    """
    keep, weight = np.isfinite(pieces.square), np.ones(len(pieces.square))
    best = np.zeros(len(prior))
    for _ in range(settings.robot_fit.rounds):
        own = weight * keep * distinct
        information = np.einsum("w,wpq->pq", own, pieces.information)
        best = np.linalg.solve(information + prior, own @ pieces.score)
        left = pieces.left(best)
        usual = float(np.median(left))
        keep = np.isfinite(left) & (left < settings.robot.worst**2 * usual)
        weight = np.minimum(usual / np.maximum(left, 1e-12), 1.0)
    return best, weight, keep


def _overstated(pieces: Pieces, prior: np.ndarray) -> float:
    """How much larger the scores' spread over windows is than their information says, in the median [1]."""
    total, score = pieces.sums()
    scores = pieces.score - pieces.information @ np.linalg.solve(total + prior, score)
    known = np.diag(total) > 1e-9 * np.diag(total).max()
    ratio = (scores**2).sum(axis=0)[known] / np.diag(total)[known]
    return float(max(np.median(ratio), 1.0))
