"""Which causes stand out: forward selection among numbers that all may be a little off, as on every healthy robot.

Every parameter has a normal prior with the spread of healthy robots. A cause is a direction in which the parameters
are moved beyond that: its score is that of the marginal likelihood for an added mean along the direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrwarp.robot_logs.causes import ORDINARY, SESSION, Parameter
from mrwarp.robot_logs.evidence import Evidence

NAMED_ODDS = 12.0
"""Least logarithm of the odds of a cause: some 200 are looked at, and one log of a hundred may speak of one wrongly."""

ORDINARY_Z = 4.5
"""Least standard score of a number that the description has wrong."""

RIVAL_ODDS = 4.5
"""Causes whose odds are nearer than this to the best one's, and vanish with it, are alternatives."""

LEAST_SHARE = 0.03
"""Least squared mismatch that a cause explains, in units of what every reading of its joints is left with."""


MOST = 8
"""Most causes beside :data:`mrwarp.robot_logs.causes.ORDINARY` that one log tells apart."""


@dataclass(frozen=True, kw_only=True)
class Direction:
    """A cause at a place: equal changes, in steps, of one parameter or of a group."""

    cause: str
    where: str
    members: tuple[int, ...]
    """Parameters."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """A direction that stands out."""

    direction: Direction
    z: float
    """Standard score when it was chosen."""
    alternatives: tuple[Direction, ...]


@dataclass(frozen=True, kw_only=True)
class Posterior:
    """Parameters after a selection."""

    mean: np.ndarray
    """Shape (P,)."""
    covariance: np.ndarray
    """Shape (P, P)."""
    precision: np.ndarray
    """Of the prior, without what was released, shape (P, P)."""


def directions_of(parameters: Sequence[Parameter]) -> list[Direction]:
    """Single parameters, and all joints or bodies at once."""
    found = [Direction(cause=p.cause, where=p.where, members=(k,)) for k, p in enumerate(parameters)]
    by_cause: dict[tuple[str, str], list[int]] = {}
    for k, p in enumerate(parameters):
        by_cause.setdefault((p.cause, p.name), []).append(k)
    for (cause, _), members in by_cause.items():
        if len({parameters[k].where for k in members}) > 2:
            found.append(Direction(cause=cause, where="robot", members=tuple(members)))
    return found


def healthy(parameters: Sequence[Parameter]) -> np.ndarray:
    """Precision of healthy robots about their description, shape (P, P)."""
    return np.diag([1.0 / p.spread**2 for p in parameters])


def vector(direction: Direction, parameters: Sequence[Parameter]) -> np.ndarray:
    """The change that a direction makes, in steps of its members; shape (P,)."""
    found = np.zeros(len(parameters))
    for k in direction.members:
        found[k] = abs(parameters[k].step)
    return found


def posterior(evidence: Evidence, parameters: Sequence[Parameter], released: Sequence[Direction]) -> Posterior:
    """Parameters with the prior of healthy robots, and that of faults along ``released``."""
    covariance = np.diag([p.spread**2 for p in parameters])
    for x in released:
        d = vector(x, parameters)
        covariance = covariance + np.outer(d, d) * _fault(x, parameters) ** 2
    q = np.linalg.inv(covariance)
    a, b = evidence.a.sum(axis=0) / evidence.scale, evidence.b.sum(axis=0) / evidence.scale
    spread = np.linalg.inv(a + q)
    return Posterior(mean=spread @ b, covariance=spread, precision=q)


def _fault(direction: Direction, parameters: Sequence[Parameter]) -> float:
    """Standard deviation of a fault along a direction, in steps."""
    return float(np.mean([parameters[k].fault / abs(parameters[k].step) for k in direction.members]))


@dataclass(frozen=True, kw_only=True)
class Scores:
    """What a fault along each of D directions would explain."""

    z: np.ndarray
    """Standard score."""
    size: np.ndarray
    """In steps."""
    odds: np.ndarray
    """Logarithm of how much likelier a fault of the usual sizes makes the log."""


def scores(now: Posterior, directions: Sequence[Direction], parameters: Sequence[Parameter]) -> Scores:
    """Scores of all directions beside what is released already."""
    d = np.stack([vector(x, parameters) for x in directions], axis=1)
    qd = now.precision @ d
    score = qd.T @ now.mean
    information = np.einsum("pd,pd->d", d, qd) - np.einsum("pd,pq,qd->d", qd, now.covariance, qd)
    known = information > 1e-9 * np.einsum("pd,pd->d", d, qd)
    information = np.where(known, information, np.inf)
    z = score / np.sqrt(information)
    room = np.where(known, information, 0.0) * np.array([_fault(x, parameters) ** 2 for x in directions])
    return Scores(z=z, size=score / information, odds=0.5 * (z**2 * room / (1.0 + room) - np.log1p(room)))


def select(evidence: Evidence, parameters: Sequence[Parameter], *, most: int = MOST) -> list[Found]:
    """Causes that stand out, the clearest first; then :data:`ORDINARY` ones that the description has wrong."""
    directions, found = [d for d in directions_of(parameters) if d.cause not in (*ORDINARY, SESSION)], []
    least = np.array([min(parameters[k].least / abs(parameters[k].step) for k in d.members) for d in directions])
    joints = np.array([len(d.members) for d in directions])
    while len(found) < most:
        released = [f.direction for f in found]
        now = scores(posterior(evidence, parameters, released), directions, parameters)
        share = now.z**2 * evidence.scale / (evidence.samples * joints)
        free = np.array([d not in released and not _spanned(d, released) for d in directions])
        free &= _possible(now.size, directions, parameters)
        odds = np.where(free & (np.abs(now.size) >= least) & (share >= LEAST_SHARE), now.odds, -np.inf)
        best = int(np.argmax(odds))
        if not odds[best] > NAMED_ODDS:
            break
        rest = scores(posterior(evidence, parameters, [*released, directions[best]]), directions, parameters)
        near = [
            k
            for k in range(len(directions))
            if odds[k] > odds[best] - RIVAL_ODDS
            and rest.odds[k] < NAMED_ODDS
            and directions[k].cause != directions[best].cause
        ]
        near.sort(key=lambda k: -odds[k])
        alternatives = tuple(directions[k] for k in near[:4])
        found.append(Found(direction=directions[best], z=float(now.z[best]), alternatives=alternatives))
    return found + _described_wrong(evidence, parameters, [f.direction for f in found])


def _possible(size: np.ndarray, directions: Sequence[Direction], parameters: Sequence[Parameter]) -> np.ndarray:
    """Whether a robot can be changed by a size in steps along each direction, shape (D,)."""
    found = np.ones(len(directions), dtype=bool)
    for k, d in enumerate(directions):
        for m in d.members:
            p, change = parameters[m], size[k] * abs(parameters[m].step)
            found[k] &= p.lowest <= change <= p.highest
    return found


DRIVE = ("kp", "kd", "motor_strength")
"""A drive's torque is a line in Kp and Kd: a factor on all of it is both, so no more than two of the three are told."""


def _spanned(direction: Direction, released: Sequence[Direction]) -> bool:
    """Whether a direction follows from two that are released."""
    if direction.cause not in DRIVE:
        return False
    others = {d.cause for d in released if d.cause in DRIVE and (d.where in ("robot", direction.where))}
    return len(others - {direction.cause}) == 2


def _described_wrong(evidence: Evidence, parameters: Sequence[Parameter], released: Sequence[Direction]) -> list[Found]:
    """Numbers of ordinary causes that the log excludes, without their priors."""
    now, found = posterior(evidence, parameters, released), []
    for k, p in enumerate(parameters):
        if p.cause not in ORDINARY:
            continue
        variance = now.covariance[k, k]
        known = 1.0 / variance - now.precision[k, k]
        if known <= 1e-6 / p.spread**2:
            continue
        size = now.mean[k] / variance / known
        beyond = size - float(np.clip(size, *p.usual))
        z = beyond * np.sqrt(known)
        if abs(z) > ORDINARY_Z and abs(beyond) >= p.least and z**2 * evidence.scale >= LEAST_SHARE * evidence.samples:
            found.append(
                Found(direction=Direction(cause=p.cause, where=p.where, members=(k,)), z=float(z), alternatives=())
            )
    return sorted(found, key=lambda f: -abs(f.z))
