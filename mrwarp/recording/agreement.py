"""Angle against velocity against time: one reading of the three decides units, factors and signs.

The angle's change over some samples is the velocity's integral over them, with any noise of either. A declaration that
is offered as a remedy was tried: the data that it makes of these pass the same checks.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mrwarp.recording.data import RecordingError, Repair, Trajectory
from mrwarp.recording.differentiate import differentiate
from mrwarp.recording.units import CONVERSIONS, PER, Units

SAME = 0.1
"""Largest difference of dq/dt from ``qd``, as a share, that nobody needs to know: filters of drives leave less."""
OTHER = 2.0
"""Factor between dq/dt and ``qd`` from which the two are not used together."""
_CERTAIN = 0.9
"""Least correlation of both over the span where they agree best, from which their factor is known."""
_SPANS = (1, 2, 4, 8, 16, 32, 64, 128)
"""Samples over which changes are compared: noise of either needs a longer one, a swing a shorter one."""
_EXACT = 0.03
"""Share by which a single unit may miss a factor that two units explain."""
_SLOW = 10.0
"""Sampling rate [Hz] below which it is the stamps that are likely in another unit."""
_FEWEST = 4
"""Such spans that a run must hold."""
_RATES = (2.0, 2e7)
"""Sampling rates [Hz] of loggers; a unit of time that gives another one is not offered."""
_STEPS = (256, 2**32)
"""Fewest and most counts of an encoder in a turn."""


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How dq/dt stands to the velocity that was logged, over all runs."""

    factor: float
    """dq/dt over ``qd``; negative where their signs differ."""
    constant: bool
    """Whether the runs, or the halves of one, have the same factor."""
    runs: int
    """Runs that move enough to show it."""

    @property
    def same(self) -> bool:
        """Whether the two are one quantity in one unit."""
        return self.factor > 0.0 and abs(float(np.log(self.factor))) < np.log1p(SAME)


def agreement(parts: Sequence[Trajectory]) -> Agreement | None:
    """How dq/dt stands to ``qd``; None where no run has both and moves so that they follow each other."""
    both = [run for run in parts if not (run.qd_derived or run.q_integrated)]
    found = [x for run in both if (x := _factor(run.q, run.qd, run.dt))]
    if not found:
        return None
    energy = np.array([x[1] for x in found])
    order = np.argsort([x[0] for x in found])
    at = int(np.searchsorted(np.cumsum(energy[order]), 0.5 * energy.sum()))
    middle = float(found[int(order[min(at, len(order) - 1)])][0])
    halves = [
        x[0]
        for run in both
        for half in (slice(0, len(run.q) // 2), slice(len(run.q) // 2, None))
        if (x := _factor(run.q[half], run.qd[half], run.dt))
    ]
    near = np.abs(np.array([x[0] for x in found] + halves) / middle - 1.0) < SAME
    return Agreement(factor=middle, constant=bool(near.mean() > _CERTAIN), runs=len(found))


def _factor(q: np.ndarray, qd: np.ndarray, dt: float) -> tuple[float, float] | None:
    """dq/dt over ``qd`` of one run, and the energy of its velocity; None where they do not follow each other."""
    path, best = np.concatenate([[0.0], np.cumsum(0.5 * dt * (qd[1:] + qd[:-1]))]), (0.0, 0.0)
    for span in (span for span in _SPANS if _FEWEST * span < len(q)):
        dq, dp = q[span:] - q[:-span], path[span:] - path[:-span]
        sizes = float(dq @ dq), float(dp @ dp)
        if min(sizes) <= 0.0:
            continue
        correlation = float(dq @ dp) / float(np.sqrt(sizes[0]) * np.sqrt(sizes[1]))
        if abs(correlation) > abs(best[0]):
            best = correlation, float(np.sqrt(sizes[0] / sizes[1])) * float(np.sign(correlation))
    return (best[1], float(qd @ qd) * dt) if abs(best[0]) > _CERTAIN else None


def applied(parts: Sequence[Trajectory], units: Units, declared: Units) -> list[Trajectory]:
    """Runs in ``units`` as they are with other declarations; what was derived or integrated is so again."""
    one = np.ones(1)
    columns = ("t", "q", "qd", "current", "torque")
    now = {units.names.get(key, key): key for key in columns}
    of = {key: now.get(declared.names.get(key, key), key) for key in columns}  # two names may be exchanged
    factor = {key: float(declared.convert(key, one)[0] / units.convert(of[key], one)[0]) for key in columns}
    found = []
    for run in parts:
        changed = replace(run, **{key: getattr(run, of[key]) * factor[key] for key in columns})
        if run.qd_derived:
            changed = replace(changed, qd=differentiate(changed.q, changed.dt, run.qd_half))
        if run.q_integrated:
            changed = replace(changed, q=run.q * factor["qd"] * factor["t"])
        found.append(changed)
    return found


def tried(
    proposals: Sequence[Mapping[str, Any]],
    parts: Sequence[Trajectory],
    units: Units,
    wrong: Callable[[Sequence[Trajectory], Units], object],
) -> list[dict[str, Any]]:
    """Those declarations, as contents of a ``units.json``, that make data consistent.

    Args:
        proposals: Declarations, in addition to those that are there.
        parts: The data, as they are now.
        units: Their units.
        wrong: The checks: what is wrong with runs in units; false where nothing is.
    """
    passed = []
    for proposal in proposals:
        try:
            declared = units.declaring(proposal)
        except RecordingError:
            continue
        if not wrong(applied(parts, units, declared), declared):
            passed.append(declared.content({}))
    return passed


def proposals(parts: Sequence[Trajectory], units: Units, found: Agreement) -> list[dict[str, Any]]:
    """Declarations that would explain a factor between dq/dt and ``qd``, the likeliest first: units, then a scale.

    One column in another unit comes before two, and one that no file names before one that is declared.
    """
    named = [(_miss(found.factor, ratio), cost, x) for ratio, cost, x in _units(units, parts)]
    # two units that explain a factor exactly are likelier than one that nearly does
    named.sort(key=lambda entry: entry[1] + entry[0] / _EXACT)
    near = [x for miss, _, x in named if miss < np.log1p(SAME)]
    if per := _counts(parts, units, found.factor):
        near.append({"q": "counts", next(iter(PER)): per, "qd": units.declared["qd"]})
    scaled = {key: units.scale.get(key, 1.0) for key in ("q", "qd")}
    size = float(f"{found.factor:.4g}") if abs(abs(found.factor) - 1.0) > SAME else float(np.sign(found.factor))
    scales = [
        {"scale": {"qd": float(f"{scaled['qd'] * size:.4g}")}},
        {"scale": {"q": float(f"{scaled['q'] / size:.4g}")}},
    ]
    if found.factor < 0.0:  # the torque resists the right one of two opposite velocities
        takes = sum(float(run.torque @ run.qd) for run in parts)
        scales = scales[1:] if takes > 0.0 else scales[:1]
    return [*near, *scales]


def _miss(factor: float, ratio: float) -> float:
    """Distance of a factor from a ratio, as a logarithm; infinite where the factor is negative."""
    return abs(float(np.log(factor / ratio))) if factor > 0.0 else np.inf


def _units(units: Units, parts: Sequence[Trajectory]) -> Iterator[tuple[float, int, dict[str, Any]]]:
    """Factors of dq/dt over ``qd`` that other units of t, q and qd would show, what speaks against them, and they."""
    known = {key: {} for key in ("t", "q", "qd")}
    for key, others in known.items():
        now = float(units.convert(key, np.ones(1))[0])
        for unit, (factor, base) in CONVERSIONS[key].items():
            scaled = factor * units.scale.get(key, 1.0) / now
            if base == units.base(key) and scaled not in others.values():
                others[unit] = scaled
    rate = float(np.median([1.0 / run.dt for run in parts]))
    for t_unit, t in known["t"].items():
        if t != 1.0 and not _RATES[0] < rate / t < _RATES[1]:
            continue
        for q_unit, q in known["q"].items():
            for qd_unit, qd in known["qd"].items():
                changed = {"t": (t_unit, t), "q": (q_unit, q), "qd": (qd_unit, qd)}
                others = [key for key, (_, factor) in changed.items() if factor != 1.0]
                if not 0 < len(others) < 3:
                    continue
                cost = len(others) + 3 * len(units.given.intersection(others)) + 2 * (rate > _SLOW and t != 1.0)
                cost += rate <= _SLOW and t == 1.0
                content = {key: changed[key][0] for key in others}
                if {"q", "qd"} & set(others):
                    content |= {key: changed[key][0] for key in ("q", "qd") if key in others}
                    content |= {key: units.declared[key] for key in ("q", "qd") if key not in others}
                yield t * qd / q, cost, content


def _counts(parts: Sequence[Trajectory], units: Units, factor: float) -> int:
    """Encoder counts in a turn, where whole numbers stand for an angle and a factor shows how many; else 0."""
    per = float(factor * 2.0 * np.pi)
    whole = all(np.array_equal(run.q, np.rint(run.q)) for run in parts)
    return round(per) if "q" not in units.given and whole and _STEPS[0] <= per <= _STEPS[1] else 0


def factor_note(label: str, parts: Sequence[Trajectory], units: Units) -> list[Repair]:
    """A note where dq/dt is ``qd`` times a factor that is small enough to go on; with what makes them one."""
    found = agreement(parts)
    if found is None or found.same:
        return []
    text = f"dq/dt is {found.factor:.3g} times qd"
    if found.constant:
        of = "the run" if found.runs == 1 else f"all {found.runs} runs that move"
        text += f" in {of}, as of two shafts with a gear between them, or a wrong scale; both are used as they are"
        for remedy in tried(proposals(parts, units, found)[-2:], parts, units, lambda runs, _: not_one(runs)):
            right = "the angle" if remedy["scale"].get("q") == units.scale.get("q") else "the velocity"
            text += f"; if {right} is the joint's, declare {json.dumps(remedy, ensure_ascii=False)} in units.json"
    else:
        text += " in the middle, and differs between runs or within one: leave the column qd out, then it is derived"
    return [Repair(trajectory=label, kind="factor", count=len(parts), text=text)]


def exchanged(parts: Sequence[Trajectory]) -> bool:
    """Whether the angle is the derivative of the velocity, as where two columns are swapped."""
    found = agreement([replace(run, q=run.qd, qd=run.q) for run in parts])
    return found is not None and found.same


def not_one(parts: Sequence[Trajectory]) -> bool:
    """Whether dq/dt and ``qd`` follow each other with a factor."""
    found = agreement(parts)
    return found is not None and not found.same
