"""Which causes stand out: forward selection among numbers that all may be a little off, as on every healthy robot.

Every parameter has a normal prior with the spread of healthy robots. A fault hypothesis moves parameters
beyond that along a direction: its score is that of the marginal likelihood for an added mean along it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mrwarp.robot_logs.causes.cause import NUISANCE
from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.causes.robot_causes import CATALOGUE, DRIVE, ORDINARY
from mrwarp.robot_logs.likelihood import Likelihood
from mrwarp.sysid.jackknife import jackknife, student
from mrwarp.sysid.least_squares import minimum_within
from mrwarp.sysid.left_out import in_a_row, one_step
from mrwarp.sysid.plant import Listed
from mrwarp.sysid.stepwise import searched


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """A fault hypothesis, a cause at a place: equal changes, in steps, of one parameter or of a group."""

    cause: str
    where: str
    members: tuple[int, ...]
    """Parameters."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """A hypothesis that stands out."""

    hypothesis: Hypothesis
    z: float
    """Standard score when it was chosen."""
    alternatives: tuple[Hypothesis, ...]


@dataclass(frozen=True, kw_only=True)
class Posterior:
    """Parameters after a selection."""

    mean: np.ndarray
    """Shape (P,)."""
    covariance: np.ndarray
    """Shape (P, P)."""
    precision: np.ndarray
    """Of the prior, without hypotheses that are free, shape (P, P)."""
    unbounded: np.ndarray
    """Mean, were there no bounds, shape (P,)."""
    robust: np.ndarray
    """Variance by the spread of the scores over windows, shape (P,)."""
    by_part: np.ndarray
    """Standard deviation over parts of the log, shape (P,)."""
    parts: int
    """How many these are."""


def hypotheses_of(parameters: Sequence[Parameter]) -> list[Hypothesis]:
    """Single parameters, and all joints at once."""
    found = [Hypothesis(cause=p.cause, where=p.where, members=(k,)) for k, p in enumerate(parameters)]
    by_cause: dict[tuple[str, str], list[int]] = {}
    for k, p in enumerate(parameters):
        by_cause.setdefault((p.cause, p.name), []).append(k)
    for (cause, _), members in by_cause.items():
        if parameters[members[0]].declared.shared and len(members) > 1:
            found.append(Hypothesis(cause=cause, where="robot", members=tuple(members)))
    return found


def payload_of(parameters: Sequence[Parameter]) -> list[Hypothesis]:
    """Numbers that a weight on the trunk changes: mass, and its centre forwards and sideways; empty for a fixed base.

    Where the weight sits near a hip, one number nearly says the same: a heavier hip.
    """
    singles = (Hypothesis(cause=p.cause, where=p.where, members=(k,)) for k, p in enumerate(parameters))
    return [d for d in singles if (p := parameters[d.members[0]]).name in p.declared.payload]


def healthy(parameters: Sequence[Parameter]) -> np.ndarray:
    """Precision of healthy robots about their description, shape (P, P)."""
    return prior_of(parameters, [])


def wider_than(d: Hypothesis, free: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Causes that a hypothesis's numbers have a part in, in addition to their own: Kp of all joints for that of one."""
    return [x for x in free if set(d.members) < set(x.members)]


def common(d: Hypothesis, free: Sequence[Hypothesis], x: np.ndarray) -> float:
    """Shared part of a hypothesis's number and those of all joints, where that is a cause, too; else 0."""
    wide = [k for y in wider_than(d, free) for k in own_members(y, free)]
    return float(np.mean(x[wide])) if wide else 0.0


def own_members(d: Hypothesis, free: Sequence[Hypothesis]) -> list[int]:
    """Numbers whose mean is a hypothesis's size: those that no other cause moves alone."""
    alone = {k for y in free for k in y.members if y != d and len(y.members) == 1}
    return [k for k in d.members if k not in alone] or list(d.members)


def vector(hypothesis: Hypothesis, parameters: Sequence[Parameter]) -> np.ndarray:
    """The change that a hypothesis makes, in steps of its members; shape (P,)."""
    found = np.zeros(len(parameters))
    for k in hypothesis.members:
        found[k] = abs(parameters[k].step)
    return found


def prior_of(parameters: Sequence[Parameter], free: Sequence[Hypothesis]) -> np.ndarray:
    """Precision of healthy robots, and of faults along ``free``, shape (P, P)."""
    same = {x.cause for x in free if x.where == "robot"}  # as the torque scale of a session
    known = same | {name for name in DRIVE if same.issuperset(CATALOGUE[name].made_of or [name])}
    covariance = np.diag([(1e-3 * p.spread if p.declared.of_all in known else p.spread) ** 2 for p in parameters])
    for x in free:
        d = vector(x, parameters)
        covariance = covariance + np.outer(d, d) * _fault(x, parameters) ** 2
    return np.linalg.inv(covariance)


def bounds_of(parameters: Sequence[Parameter]) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest change of each number that a robot can have, shapes (P,): a coil can be without current."""
    return (
        np.array([max(p.lowest, p.declared.least_share - 1.0) if p.relative else p.lowest for p in parameters]),
        np.array([p.highest for p in parameters]),
    )


def bounds_without(parameters: Sequence[Parameter], causes: Sequence[Hypothesis]) -> tuple[np.ndarray, np.ndarray]:
    """Posterior with ``causes`` held to the range of healthy robots."""
    low, high = bounds_of(parameters)
    for k in (k for d in causes for k in d.members):
        low[k], high[k] = parameters[k].usual
    return low, high


def posterior(likelihood: Likelihood, parameters: Sequence[Parameter], free: Sequence[Hypothesis]) -> Posterior:
    """Parameters with the prior of healthy robots, and that of faults along ``free``."""
    q = prior_of(parameters, free)
    a, b = likelihood.normal_equations()
    spread = np.linalg.inv(a + q)
    mean, _ = minimum_within(a + q, b, *bounds_of(parameters))
    each = spread @ ((likelihood.score - likelihood.information @ mean) / likelihood.scale).T
    own = np.einsum("pq,qr,rp->p", spread, q, spread)
    count = likelihood.settings.robot.parts
    folds = in_a_row(len(likelihood.square), count)
    parts = one_step(likelihood, folds, mean, spread / likelihood.scale)
    return Posterior(
        mean=mean,
        covariance=spread,
        precision=q,
        unbounded=spread @ b,
        robust=(each**2).sum(axis=1) + own,
        by_part=np.diag(jackknife(parts)) + own,
        parts=count,
    )


def _fault(hypothesis: Hypothesis, parameters: Sequence[Parameter]) -> float:
    """Standard deviation of a fault along a hypothesis, in steps."""
    return float(np.mean([parameters[k].fault / abs(parameters[k].step) for k in hypothesis.members]))


def _least(hypotheses: Sequence[Hypothesis], parameters: Sequence[Parameter]) -> np.ndarray:
    """Smallest size of each of D hypotheses that counts as a fault, in steps, shape (D,)."""
    return np.array([min(parameters[k].least / abs(parameters[k].step) for k in d.members) for d in hypotheses])


@dataclass(frozen=True, kw_only=True)
class Scores:
    """Explained mismatch by a fault along each of D hypotheses."""

    z: np.ndarray
    """Standard score."""
    size: np.ndarray
    """In steps."""
    odds: np.ndarray
    """Logarithm of how much likelier a fault of the usual sizes makes the log."""


def scores(now: Posterior, hypotheses: Sequence[Hypothesis], parameters: Sequence[Parameter]) -> Scores:
    """Scores of all hypotheses in addition to those that are free."""
    d = np.stack([vector(x, parameters) for x in hypotheses], axis=1)
    qd = now.precision @ d
    score = qd.T @ now.mean
    information = np.einsum("pd,pd->d", d, qd) - np.einsum("pd,pq,qd->d", qd, now.covariance, qd)
    known = information > 1e-9 * np.einsum("pd,pd->d", d, qd)
    information = np.where(known, information, np.inf)
    z = score / np.sqrt(information)
    room = np.where(known, information, 0.0) * np.array([_fault(x, parameters) ** 2 for x in hypotheses])
    return Scores(z=z, size=score / information, odds=0.5 * (z**2 * room / (1.0 + room) - np.log1p(room)))


def select(
    likelihood: Likelihood, parameters: Sequence[Parameter], confirmed: Sequence[Hypothesis] = ()
) -> list[Found]:
    """Causes that stand out, the clearest first; then :data:`ORDINARY` ones that the description has wrong.

    Causes that do not recur over windows are taken out again, the least certain first. ``confirmed`` are causes with
    which a fit by the replay needed no other of the same drive.
    """
    return searched(RobotSearch(likelihood, parameters, confirmed))


def scored(likelihood: Likelihood, parameters: Sequence[Parameter], hypotheses: Sequence[Hypothesis]) -> list[Found]:
    """Hypotheses that are as large as a fault, with the standard score of each alone."""
    if not hypotheses:
        return []
    now = scores(posterior(likelihood, parameters, []), hypotheses, parameters)
    large = np.flatnonzero(np.abs(now.size) >= _least(hypotheses, parameters)).tolist()
    return [Found(hypothesis=hypotheses[k], z=float(now.z[k]), alternatives=()) for k in large]


class Standing(NamedTuple):
    """A hypothesis next to causes that were found."""

    hypothesis: Hypothesis
    z: float
    odds: float


class RobotSearch(Listed[Found]):
    """A robot's log as a plant: its models are lists of causes, judged by the marginal likelihood."""

    def __init__(
        self, likelihood: Likelihood, parameters: Sequence[Parameter], confirmed: Sequence[Hypothesis]
    ) -> None:
        self.likelihood, self.parameters, self.confirmed = likelihood, parameters, confirmed
        self.settings, self.base = likelihood.settings.robot, list[Found]()
        self.hypotheses = [d for d in hypotheses_of(parameters) if d.cause not in (*ORDINARY, NUISANCE)]
        self.tests = (self.recurs,)

    def candidates(self, found: list[Found]) -> list[Standing]:
        """Hypotheses of possible sizes, the likeliest first, if that one is likely enough."""
        settings, p, free = self.settings, self.parameters, [f.hypothesis for f in found]
        if len(found) >= settings.most:
            return []
        least = _least(self.hypotheses, p)
        joints = np.array([len(d.members) for d in self.hypotheses])
        now = scores(posterior(self.likelihood, p, free), self.hypotheses, p)
        share = now.z**2 * self.likelihood.scale / (self.likelihood.samples * joints)
        allowed = np.array([d not in free and not _spanned(d, free) for d in self.hypotheses])
        allowed &= _possible(now.size, self.hypotheses, p)
        odds = np.where(allowed & (np.abs(now.size) >= least) & (share >= settings.share), now.odds, -np.inf)
        if not odds.max() > settings.odds:
            return []
        order = [k for k in np.argsort(-odds, kind="stable") if odds[k] > -np.inf]
        return [Standing(self.hypotheses[k], float(now.z[k]), float(odds[k])) for k in order]

    def grown(self, found: list[Found], candidates: Sequence[Standing]) -> list[Found]:
        """The likeliest cause more, with those that would do as well; or a weight on the trunk in its place."""
        settings, free, best = self.settings, [f.hypothesis for f in found], candidates[0]
        if payload := _payload(best.hypothesis, free, self.likelihood, self.parameters):
            return [*found, *payload]
        now = posterior(self.likelihood, self.parameters, [*free, best.hypothesis])
        rest = scores(now, [c.hypothesis for c in candidates], self.parameters).odds
        least = best.odds - self.likelihood.settings.odds.rival
        near = [
            c.hypothesis
            for c, left in zip(candidates, rest, strict=True)
            if c.odds > least and left < settings.odds and c.hypothesis.cause != best.hypothesis.cause
        ]
        return [*found, Found(hypothesis=best.hypothesis, z=best.z, alternatives=tuple(near[: settings.rivals]))]

    def settled(self, found: list[Found]) -> list[Found]:
        """One cause of a drive in place of two; and what the description has wrong in any case."""
        wrong = _described_wrong(self.likelihood, self.parameters, [f.hypothesis for f in found])
        found = _simplest_drive([*found, *wrong], self.likelihood, self.parameters, self.confirmed)
        return [_with_rivals(f, found, self.likelihood, self.parameters) for f in found]

    def recurs(self, found: list[Found]) -> list[float]:
        """How certain causes are with windows as the units."""
        free = [f.hypothesis for f in found]
        now = posterior(self.likelihood, self.parameters, free)
        return [_recurrence(d, now, self.parameters, free) / self.settings.recurrence for d in free]


def _with_rivals(f: Found, found: list[Found], likelihood: Likelihood, parameters: Sequence[Parameter]) -> Found:
    """A cause with those of its declared rivals as alternatives with which the log is nearly as likely in its place."""
    own, others = f.hypothesis, [x.hypothesis for x in found if x is not f]
    names = CATALOGUE[own.cause].rivals
    rivals = [d for d in hypotheses_of(parameters) if d.cause in names and d not in others and _overlap(d, own)]
    if not rivals:
        return f
    a, b = likelihood.normal_equations()

    def unlikely(free: Hypothesis) -> float:
        low, high = bounds_without(parameters, [] if free is own else [own])
        q = prior_of(parameters, [*others, free])
        x, _ = minimum_within(a + q, b, low, high)
        return float(x @ (a + q) @ x - 2.0 * b @ x)

    here = unlikely(own)
    near = [d for d in rivals if 0.5 * (unlikely(d) - here) < likelihood.settings.odds.rival]
    return replace(f, alternatives=tuple(dict.fromkeys([*f.alternatives, *near])))


def _overlap(d: Hypothesis, own: Hypothesis) -> bool:
    """Whether two hypotheses are of the same place, or one of them of the robot."""
    return d.where == own.where or "robot" in (d.where, own.where)


def _simplest_drive(
    found: list[Found], likelihood: Likelihood, parameters: Sequence[Parameter], confirmed: Sequence[Hypothesis]
) -> list[Found]:
    """One cause of a drive in place of two that say as much: Kp alone is also a stronger motor with a lower Kd.

    Where the replay has shown which of a drive's causes it is, that one stands: derivatives trade one for another.
    """
    for place in dict.fromkeys(f.hypothesis.where for f in found if f.hypothesis.cause in DRIVE):
        pair = [f for f in found if f.hypothesis.cause in DRIVE and f.hypothesis.where == place]
        size = len(pair[0].hypothesis.members)
        rest = [f for f in found if f not in pair]
        others = [f.hypothesis for f in rest]
        alone = [
            d for d in hypotheses_of(parameters) if d.cause in DRIVE and d.where == place and len(d.members) == size
        ]
        sure = [d for d in alone if d in confirmed]
        if not alone or (len(pair) == 1 and (len(sure) != 1 or pair[0].hypothesis in sure)):
            continue
        if len(sure) == 1:
            best = sure[0]
        else:
            both = _log_marginal([*others, *(f.hypothesis for f in pair)], likelihood, parameters)
            each = [_log_marginal([*others, d], likelihood, parameters) for d in alone]
            best = alone[int(np.argmax(each))]
            if max(each) <= both - likelihood.settings.robot.odds:  # the second one earns what a cause has to
                continue
        now = scores(posterior(likelihood, parameters, others), [best], parameters)
        found = [*rest, Found(hypothesis=best, z=float(now.z[0]), alternatives=())]
    return sorted(found, key=lambda f: f.hypothesis.cause in ORDINARY)


def _log_marginal(free: Sequence[Hypothesis], likelihood: Likelihood, parameters: Sequence[Parameter]) -> float:
    """Logarithm of the marginal likelihood, but for a constant."""
    q = prior_of(parameters, free)
    a, b = likelihood.normal_equations()
    more = np.linalg.slogdet(q)[1] - np.linalg.slogdet(a + q)[1]
    return float(0.5 * (b @ np.linalg.solve(a + q, b) + more))


def estimate(k: int, now: Posterior, parameters: Sequence[Parameter]) -> tuple[float, float]:
    """Mean and standard deviation of one number by the log alone, without its prior."""
    variance = now.covariance[k, k]
    known = max(1.0 / variance - now.precision[k, k], 1e-3 / variance)
    mean = max(now.unbounded[k] / variance / known, parameters[k].lowest)
    return float(mean), float(max(1.0 / np.sqrt(known), np.sqrt(now.robust[k])))


def sizes(
    equations: tuple[np.ndarray, np.ndarray],
    parameters: Sequence[Parameter],
    free: Sequence[Hypothesis],
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Changes by which the extended robot fits best, shape (P,): causes and session's offsets, else as described.

    ``equations`` are of :meth:`~mrwarp.robot_logs.likelihood.Likelihood.normal_equations`.
    """
    named = {k for d in free for k in d.members}
    indices = [k for k, p in enumerate(parameters) if k in named or p.is_nuisance]
    own = [replace(d, members=tuple(indices.index(k) for k in d.members)) for d in free]
    a, b = equations
    found = np.zeros(len(parameters))
    if indices:
        q = prior_of([parameters[k] for k in indices], own)
        found[indices], _ = minimum_within(a[np.ix_(indices, indices)] + q, b[indices], low[indices], high[indices])
    return found


def half_width(
    members: Sequence[int],
    size: float,
    now: Posterior,
    parameters: Sequence[Parameter],
    *,
    wider: float = 1.0,
    lone: float,
) -> float:
    """Half of the 95 % interval about ``size``, the mean of a hypothesis's ``members``.

    Its square is the sum of three: of the widest by the model, over windows and over parts, ``wider`` times as wide,
    by Student's t of parts minus one, for windows in a row err together and a log has few parts; and of how much the
    number moves when all others may be off as on healthy robots, and when nothing else is off, ``lone``: these errors
    of the description have nothing to do with noise. Over parts it is the cluster-robust one (Cameron and Miller,
    J. Human Resources 50, 2015, sections II and VI).
    """
    k = members[0]
    mean, sd = float(now.mean[list(members)].mean()), float(np.sqrt(max(now.covariance[k, k], now.robust[k])))
    if len(members) == 1:
        mean, sd = estimate(k, now, parameters)
    over_parts = student(0.95, now.parts - 1) * np.sqrt(now.by_part[k])
    statistical = wider * max(student(0.95, now.parts - 1) * sd, over_parts)
    return float(np.sqrt(statistical**2 + (mean - size) ** 2 + (lone - size) ** 2))


def _recurrence(d: Hypothesis, now: Posterior, parameters: Sequence[Parameter], free: Sequence[Hypothesis]) -> float:
    """Size of a cause in standard deviations that count windows as the units; 0 where it may be too small to count."""
    members = own_members(d, free)
    k = members[0]
    p, mean, sd = parameters[k], now.mean[members].mean(), np.sqrt(max(now.covariance[k, k], now.robust[k]))
    if len(members) == 1:
        mean, sd = estimate(k, now, parameters)
    own = mean - common(d, free, now.mean)
    size = abs(own - float(np.clip(own, *p.usual)))
    return float(size / sd) if size - 1.96 * sd >= p.least else 0.0


def _payload(
    best: Hypothesis, free: Sequence[Hypothesis], likelihood: Likelihood, parameters: Sequence[Parameter]
) -> list[Found]:
    """A weight on the trunk in place of a link's mass, where it makes the log likelier; empty where it does not."""
    parts = payload_of(parameters)
    if not CATALOGUE[best.cause].or_payload or not parts or any(d in free for d in parts):
        return []
    if _log_marginal([*free, *parts], likelihood, parameters) < _log_marginal([*free, best], likelihood, parameters):
        return []
    found = []
    for d in parts:
        others = [*free, *(x for x in parts if x != d)]
        now = scores(posterior(likelihood, parameters, others), [d], parameters)
        if now.odds[0] > likelihood.settings.robot.odds:
            found.append(Found(hypothesis=d, z=float(now.z[0]), alternatives=()))
    return found


def _possible(size: np.ndarray, hypotheses: Sequence[Hypothesis], parameters: Sequence[Parameter]) -> np.ndarray:
    """Whether a robot can be changed by a size in steps along each hypothesis, shape (D,)."""
    found = np.ones(len(hypotheses), dtype=bool)
    for k, d in enumerate(hypotheses):
        for m in d.members:
            p, change = parameters[m], size[k] * abs(parameters[m].step)
            found[k] &= p.lowest <= change <= p.highest
    return found


def _spanned(hypothesis: Hypothesis, free: Sequence[Hypothesis]) -> bool:
    """Whether a hypothesis follows from two that are free."""
    if hypothesis.cause not in DRIVE:
        return False
    others = {d.cause for d in free if d.cause in DRIVE and (d.where in ("robot", hypothesis.where))}
    return len(others - {hypothesis.cause}) == 2


def _described_wrong(
    likelihood: Likelihood, parameters: Sequence[Parameter], free: Sequence[Hypothesis]
) -> list[Found]:
    """Numbers of ordinary causes that the log excludes, without their priors."""
    now, found, settings = posterior(likelihood, parameters, free), [], likelihood.settings.robot
    for k, p in enumerate(parameters):
        if p.cause not in ORDINARY:
            continue
        variance = now.covariance[k, k]
        known = 1.0 / variance - now.precision[k, k]
        if known <= 1e-6 / p.spread**2:
            continue
        size = max(now.unbounded[k] / variance / known, p.lowest)
        beyond = size - float(np.clip(size, *p.usual))
        z = beyond * np.sqrt(known)
        if (
            abs(z) > settings.ordinary_z
            and abs(beyond) >= p.least
            and z**2 * likelihood.scale >= settings.share * likelihood.samples
        ):
            own = Hypothesis(cause=p.cause, where=p.where, members=(k,))
            same = [d for d in hypotheses_of(parameters) if d.cause == p.declared.looks_like and d.where == p.where]
            found.append(Found(hypothesis=own, z=float(z), alternatives=tuple(same) if beyond > 0.0 else ()))
    return sorted(found, key=lambda f: -abs(f.z))
