"""The evidence of what a plant lacks: named causes and nameless structure compete by one marginal likelihood.

In unit of chance ``t`` (a run, a window) the mismatch is

    r_t = J_t d + F_t (w + o_t) + e_t

with the changes ``d`` of a model's numbers (unit-information prior, of which only the half that is possible counts
where a number has a sign), the sizes ``w`` of nameless smooth functions (normal, one variance for each group: automatic
relevance), what these have of their own in each unit, ``o_t`` (normal, one variance for each group: a wrong law errs in
each run in its own way), and noise ``e_t`` of a variance of its own in each unit. All but the variances is integrated
out in closed form; these are the likeliest (empirical Bayes; Kennedy and O'Hagan 2001 for the discrepancy, MacKay 1992
for the updates).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import get_lapack_funcs
from scipy.special import log_ndtr

from mrwarp.sysid.least_squares import RANK


@dataclass(frozen=True, kw_only=True)
class Signals:
    """Gram matrices of each unit's [derivatives, nameless functions, forms, mismatch], shape (T, M, M).

    The *forms* are what the laws of a model's causes may have wrong: functions along what a cause bears, of known size.
    """

    grams: np.ndarray
    counts: np.ndarray
    """Independent samples of each unit, shape (T,)."""
    live: Sequence[int]
    """The derivatives that count, of P."""
    group: np.ndarray
    """Group of each nameless function, shape (K,)."""
    forms: np.ndarray
    """Prior variance of each form's size, shape (F,)."""
    room: np.ndarray
    """How far each live number is above the least that it may be, shape (nb,); infinite where it may be anything."""

    @property
    def first(self) -> int:
        """Column of the first nameless function."""
        return self.grams.shape[1] - 1 - len(self.forms) - len(self.group)

    @property
    def columns(self) -> list[int]:
        """The live derivatives, the functions and the mismatch."""
        return [*self.live, *range(self.first, self.first + len(self.group)), self.grams.shape[1] - 1]


@dataclass(frozen=True, kw_only=True)
class Discrepancy:
    """Variances of the nameless functions and of the noise."""

    common: np.ndarray
    """Variance of a function's size, by group, shape (G,)."""
    own: np.ndarray
    """Variance of what it has of its own in a unit, by group, shape (G,)."""
    scale: np.ndarray
    """Variance of the noise in each unit, in the signals' units, shape (T,)."""

    def reduced(self, s: Signals) -> np.ndarray:
        """Gram matrices whose nameless own parts and noise are integrated out, shape (T, M, M)."""
        grams = s.grams / self.scale[:, None, None]
        at = s.first + np.flatnonzero(self.own[s.group] > 0.0)
        if not len(at):
            return grams
        taken = _root(grams[:, at[:, None], at], self.own[s.group[at - s.first]]) @ grams[:, at]
        return grams - taken.swapaxes(-1, -2) @ taken


@dataclass(frozen=True, kw_only=True)
class Posterior:
    """A model's evidence, and what it says of its numbers."""

    log: float
    """Logarithm of the marginal likelihood, but for what all models of the data share."""
    mean: np.ndarray
    """Changes of the live derivatives' numbers, then sizes of the active functions."""
    covariance: np.ndarray


def learned(
    s: Signals, least: float, start: Discrepancy | None = None, *, rounds: int = 25, still: float = 0.05
) -> Discrepancy:
    """The likeliest variances with every group in.

    Args:
        s: Signals of a model.
        least: The noise's least variance, in the signals' units.
        start: Variances of another model to begin from.
        rounds: Most updates.
        still: Change of the variances' logarithms with which they end.
    """
    columns, nb, groups = s.columns, len(s.live), int(s.group.max(initial=-1)) + 1
    grams = np.ascontiguousarray(s.grams[:, columns][:, :, columns])
    power = float(grams[:, -1, -1].sum() / s.counts.sum())
    small = 1e-7 * max(power, 1e-300)  # it is nothing
    common, own = np.full(groups, 1e-3 * power), np.full(groups, 1e-3 * power)
    scale = np.maximum(grams[:, -1, -1] / s.counts, least)
    if start is not None:
        common, own, scale = start.common, np.maximum(start.own, 10.0 * small), start.scale
    for _ in range(rounds):
        part = np.flatnonzero(own[s.group] > small)
        at, group = nb + part, s.group[part]
        cross = grams[:, at] / scale[:, None, None]
        root = _root(cross[:, :, at], own[group])
        taken = root @ cross
        flat = taken.reshape(-1, taken.shape[-1])
        x, covariance, _ = _solved(np.tensordot(1.0 / scale, grams, 1) - flat.T @ flat, nb, 1.0 / common[s.group])
        y = np.append(-x, 1.0)
        mean = np.einsum("tkl,tk->tl", root, taken @ y)
        shrunk = 1.0 - (root**2).sum(axis=1) / own[group]
        known = _by_group(1.0 - np.diag(covariance)[nb:] / common[s.group], s.group, groups)
        fresh = _by_group(x[nb:] ** 2, s.group, groups) / np.maximum(known, 1e-6)
        seen = _by_group(shrunk.sum(axis=0), group, groups)
        mine = _by_group((mean**2).sum(axis=0), group, groups) / np.maximum(seen, 1e-6)
        sizes = np.repeat(y[None], len(grams), axis=0)
        sizes[:, at] -= mean
        left = np.einsum("ti,ti->t", sizes, np.einsum("tij,tj->ti", grams, sizes))
        scale = np.maximum(left / np.maximum(s.counts - shrunk.sum(axis=1), 0.1 * s.counts), least)
        fresh, mine = np.maximum(fresh, small), np.where(mine > small, mine, 0.0)
        alive = (mine > 0.0) & (own > 0.0)
        change = np.abs(np.log(np.append(fresh / common, mine[alive] / own[alive]))).max(initial=0.0)
        common, own = fresh, mine
        if change < still:
            break
    return Discrepancy(common=common, own=own, scale=scale)


def _by_group(x: np.ndarray, group: np.ndarray, groups: int) -> np.ndarray:
    """Sums over the functions of each group, shape (G,)."""
    return np.bincount(group, x, groups)


def left_over(s: Signals, d: Discrepancy) -> tuple[np.ndarray, np.ndarray]:
    """Likeliest changes of the live derivatives' numbers, shape (nb,), and sizes of all functions, shape (T, K)."""
    whole = d.reduced(s)[:, s.columns][:, :, s.columns]
    nb = len(s.live)
    x, _, _ = _solved(whole.sum(axis=0), nb, 1.0 / np.maximum(d.common[s.group], 1e-300))
    at = s.first + np.flatnonzero(d.own[s.group] > 0.0)
    sizes = np.repeat(x[None, nb:], len(s.grams), axis=0)
    if len(at):
        here = s.grams[:, at] / d.scale[:, None, None]
        root = _root(here[:, :, at], d.own[s.group[at - s.first]])
        pull = root @ (here[:, :, s.columns] @ np.append(-x, 1.0))[..., None]
        sizes[:, at - s.first] += (root.swapaxes(-1, -2) @ pull)[..., 0]
    return x[:nb], sizes


def posterior(
    s: Signals, total: np.ndarray, active: Collection[int], start: np.ndarray, *, rounds: int = 25, still: float = 0.05
) -> Posterior:
    """Evidence of a model with some nameless groups.

    Args:
        s: Signals of the model.
        total: Their :meth:`Discrepancy.reduced` Gram matrix, summed over the units.
        active: The groups.
        start: Variance by group from which the likeliest is looked for.
        rounds: Most updates of them.
        still: Change of their logarithms with which they end.
    """
    nb, use = len(s.live), [k for k, g in enumerate(s.group) if g in active]
    columns = [*s.live, *(s.first + k for k in use), *range(s.first + len(s.group), total.shape[0])]
    gram, group = total[np.ix_(columns, columns)], s.group[use]
    number, variance = float(s.counts.sum()), np.maximum(start, 1e-12).copy()
    for _ in range(rounds if use else 1):
        x, covariance, logdet = _solved(gram, nb, 1.0 / np.append(variance[group], s.forms))
        change = 0.0
        for g in active:
            mine = nb + np.flatnonzero(group == g)
            if not len(mine):
                continue
            known = len(mine) - float(np.trace(covariance[np.ix_(mine, mine)])) / variance[g]
            fresh = float(np.clip((x[mine] ** 2).sum() / max(known, 1e-6), 1e-12, 1e12))
            change = max(change, abs(np.log(fresh / variance[g])))
            variance[g] = fresh
        if change < still:
            break
    quadratic = float(gram[-1, -1] - x @ gram[:-1, -1])
    base = gram[:nb, :nb] + RANK * np.diag(np.diag(gram[:nb, :nb]))
    prior = (
        np.linalg.slogdet(base)[1] - nb * np.log(number) - float(np.log(variance[group]).sum() + np.log(s.forms).sum())
    )
    log = 0.5 * float(prior - quadratic - logdet)
    spread = np.sqrt(np.diag(covariance)[:nb])
    possible = float((log_ndtr((s.room + x[:nb]) / spread) + np.log(2.0))[np.isfinite(s.room)].sum())
    return Posterior(log=log + possible, mean=x, covariance=covariance)


def showing(s: Signals, d: Discrepancy, active: Collection[int]) -> np.ndarray:
    """Chi-squared by which effects that are put into the data would show, each a cause of one number, shape (F + 1,).

    The effects stand in place of the forms and of the mismatch. What the model's numbers and the nameless groups would
    take up of them counts for nothing. A cause of one number has log odds of half of that less half of log N.
    """
    total, nb = d.reduced(s).sum(axis=0), len(s.live)
    use = [k for k, g in enumerate(s.group) if g in active]
    taken, last = [*s.live, *(s.first + k for k in use)], s.first + len(s.group)
    precision = 1.0 / np.maximum(d.common[s.group[use]], 1e-300)
    found = []
    for column in range(last, total.shape[0]):
        gram = total[np.ix_([*taken, column], [*taken, column])]
        x, _, _ = _solved(gram, nb, precision)
        found.append(max(float(gram[-1, -1] - x @ gram[:-1, -1]), 0.0))
    return np.array(found)


def correlation(units: Sequence[np.ndarray], window: float = 5.0) -> float:
    """Samples of noise that count as one, by its integrated autocorrelation within units, 1 or more.

    The sum ends after so many correlation times (Sokal's ``window``).

    A smooth function meets the noise's power at low frequencies, which is so many times that of white noise.
    """
    sums = np.zeros(max(map(len, units)))
    for x in units:
        power = np.abs(np.fft.rfft(x - x.mean(), 2 * len(x))) ** 2
        sums[: len(x)] += np.fft.irfft(power)[: len(x)]
    times = 1.0 + 2.0 * np.cumsum(sums[1:] / max(float(sums[0]), 1e-300))
    ends = np.flatnonzero(np.arange(1, len(sums)) > window * times)
    return float(max(1.0, times[ends[0]] if len(ends) else times.max(initial=1.0)))


def _root(grams: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Roots R of the covariance R'R of sizes with these prior variances, (n,), by Gram matrices in the prior's units.

    Both of shape (T, n, n).
    """
    d = np.sqrt(variance)
    root = np.linalg.cholesky(grams * np.outer(d, d) + np.eye(len(d)))
    (inverted,) = get_lapack_funcs(("trtri",), (root,))
    for x in root if len(d) else ():
        x[:] = inverted(x, lower=1)[0] * d
    return root


def _solved(gram: np.ndarray, free: int, precision: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Posterior mean, covariance and log determinant of the information, of columns the first of which are free."""
    information = gram[:-1, :-1].copy()
    information[np.arange(free, len(information)), np.arange(free, len(information))] += precision
    d = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(d, d) + RANK * np.eye(len(d))
    covariance = np.linalg.inv(scaled) / np.outer(d, d)
    logdet = float(np.linalg.slogdet(scaled)[1] + 2.0 * np.log(d).sum())
    return covariance @ gram[:-1, -1], covariance, logdet
