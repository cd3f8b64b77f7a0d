"""How a claim of the paper fares: its figures next to ours, and the rule that judges them.

Judged from the figures of ``docs/results/paper.json`` alone; nothing is simulated here and no engine is loaded.
"""

from __future__ import annotations

import enum
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from paper.reproduce.contents import CONTENTS, Mark

NEAR = 0.05
"""Relative difference that still agrees where the paper states no spread."""

LEVEL = 0.95
"""Level of the intervals over training seeds by which a sign or an order is resolved."""

MOST_SEEDS = 10_000
"""Seeds beyond which nobody would count them."""


class Verdict(enum.Enum):
    """How a claim fares."""

    REPRODUCED = "reproduced"
    DIRECTION = "sign agrees, size does not"
    UNRESOLVED = "unresolved"
    NOT = "not reproduced"
    CALIBRATED = "calibrated"
    EXCLUDED = "contradicts the paper itself"


BY_EFFECT = (Verdict.NOT, Verdict.UNRESOLVED, Verdict.DIRECTION, Verdict.REPRODUCED)
"""Verdicts that are counted by effect, the worst first."""


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure of the paper next to ours."""

    paper: float
    paper_sd: float | None = None
    ours: float
    sd: float | None = None
    n: int = 1
    """Seeds or trials that ``sd`` is over."""
    seeds: tuple[float, ...] = ()
    """Ours by seed, where it is kept."""
    digits: int = 3
    calibrated: bool = False

    @property
    def agrees(self) -> bool:
        """Within the joint spread, or 5 % where the paper states none."""
        if self.paper_sd:
            return abs(self.in_sd) <= 1.0
        return abs(self.ours - self.paper) <= NEAR * abs(self.paper)

    @property
    def relative(self) -> float:
        """Ours over the paper's, less 1: positive where ours is further from 0, as :attr:`in_sd`; NaN for a 0."""
        return self.ours / self.paper - 1.0 if self.paper else math.nan

    @property
    def in_sd(self) -> float:
        """The difference in units of the joint spread, the root of the summed squared spreads.

        NaN where the paper states no spread: ours alone is no measure of both.
        """
        if not self.paper_sd:
            return math.nan
        return math.copysign(1.0, self.paper) * (self.ours - self.paper) / math.hypot(self.paper_sd, self.sd or 0.0)

    def minus(self, other: Figure) -> Figure:
        """The difference of two figures, seed by seed where both have the same seeds."""
        paper = self.paper - other.paper
        if len(self.seeds) == len(other.seeds) > 1:
            each = np.subtract(self.seeds, other.seeds)
            return Figure(paper=paper, ours=float(each.mean()), sd=float(each.std(ddof=1)), n=len(each))
        sd = None if self.sd is other.sd is None else math.hypot(self.sd or 0.0, other.sd or 0.0)
        return Figure(paper=paper, ours=self.ours - other.ours, sd=sd, n=min(self.n, other.n))

    def half_width(self, n: int | None = None) -> float:
        """Half of the interval of ours over ``n`` seeds (those that there are), by Student's t; 0 without a spread."""
        n = n or self.n
        return float(stats.t.ppf(0.5 + 0.5 * LEVEL, n - 1)) * self.sd / math.sqrt(n) if self.sd and n > 1 else 0.0

    def sign(self) -> Verdict:
        """Whether ours, an effect, has the paper's sign.

        Its interval leaves out zero on the paper's side (*sign agrees, size does not*), holds both zero and the
        paper's figure (*unresolved*), or leaves out the paper's without being of its sign (*not reproduced*).
        """
        half = self.half_width()
        if self.ours * self.paper > 0.0 and abs(self.ours) > half:
            return Verdict.DIRECTION
        return Verdict.UNRESOLVED if abs(self.ours - self.paper) < half else Verdict.NOT

    def needed(self) -> int:
        """Seeds whose interval, with the spread of ours, cannot hold both zero and the paper's figure."""
        counts = (n for n in range(2, MOST_SEEDS) if self.half_width(n) < 0.5 * abs(self.paper))
        return next(counts, MOST_SEEDS)


class Results:
    """Figures of a whole report, as :mod:`paper.reproduce.pages` keeps them.

    Args:
        parts: By entry: ``rows``, ``claims``, ``claim_ids``, ``reasons`` and ``tables``.
    """

    def __init__(self, parts: Mapping[str, Any]) -> None:
        self.parts = parts
        self.whole: Mapping[str, Any] | None = None  # what a run of all of them took, where one was measured

    def row(self, part: str, condition: str, quantity: str) -> Figure:
        """One row of an entry.

        Raises:
            KeyError: there is no such row, or the paper has no figure for it.
        """
        for row in self.parts[part]["rows"]:
            if (row["condition"], row["quantity"]) == (condition, quantity) and row["paper"] is not None:
                ours = math.nan if row["ours"] is None else row["ours"]
                spread = {"paper_sd": row["paper"]["sd"], "sd": row["sd"], "seeds": tuple(row.get("seeds", ()))}
                kept = {"digits": row["digits"], "calibrated": row["calibrated"], "n": max(row["n"], 1)}
                return Figure(paper=row["paper"]["mean"], ours=ours, **spread, **kept)
        raise KeyError(f"{part}: no row {condition!r}, {quantity!r}")

    def holds(self, part: str, claim: str) -> bool:
        """Whether the entry's claim of this identifier holds.

        Raises:
            KeyError: there is none.
        """
        ids = self.parts[part].get("claim_ids", {})
        if claim not in ids:
            raise KeyError(f"{part}: no claim {claim!r}")
        return self.parts[part]["claims"][ids[claim]]

    def table(self, part: str, name: str) -> Mapping[str, Any]:
        """The entry's table of this identifier.

        Raises:
            KeyError: there is none.
        """
        for table in self.parts[part]["tables"]:
            if table.get("id") == name:
                return table
        raise KeyError(f"{part}: no table {name!r}")


@dataclass(frozen=True)
class Measure:
    """The figures that a claim is judged by."""

    part: str
    """Entry that has them."""
    figures: Callable[[Results], Sequence[Figure]]
    """Reads them."""

    def __call__(self, found: Results) -> list[Figure]:
        """The figures of a report."""
        return list(self.figures(found))


def rows(part: str, quantity: str, *conditions: str) -> Measure:
    """Rows of one quantity."""
    return Measure(part, lambda found: [found.row(part, condition, quantity) for condition in conditions])


def change(part: str, quantity: str, *pairs: tuple[str, str], absolute: bool = False, paired: bool = False) -> Measure:
    """Changes [%] from the first to the second condition of each pair, with the spread of a ratio.

    ``absolute`` drops the sign of the figures before. Where the same trials are ``paired``, ours is the mean of each
    seed's own change; without figures by seed it has no spread, as a ratio's is that of independent trials.
    """

    def ratio(
        before: float, after: float, sd_before: float | None, sd_after: float | None
    ) -> tuple[float, float | None]:
        before, after = (abs(before), abs(after)) if absolute else (before, after)
        if sd_before is None or sd_after is None:
            return 100.0 * (after / before - 1.0), None
        spread = math.hypot(sd_after / before, sd_before * after / before**2)
        return 100.0 * (after / before - 1.0), 100.0 * spread

    def measure(found: Results) -> list[Figure]:
        figures = []
        for first, second in pairs:
            a, b = found.row(part, first, quantity), found.row(part, second, quantity)
            theirs, theirs_sd = ratio(a.paper, b.paper, a.paper_sd, b.paper_sd)
            ours, sd = ratio(a.ours, b.ours, *((None, None) if paired else (a.sd, b.sd)))
            if paired and len(a.seeds) == len(b.seeds) > 1:
                each = 100.0 * (np.divide(b.seeds, a.seeds) - 1.0)
                ours, sd = float(each.mean()), float(each.std(ddof=1))
            figures.append(Figure(paper=theirs, paper_sd=theirs_sd, ours=ours, sd=sd, digits=1, n=min(a.n, b.n)))
        return figures

    return Measure(part, measure)


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One claim of the paper."""

    id: str
    """Identifier, of its own; what stands before a slash is the physical effect, which other claims are about too."""
    place: str
    """Table, figure or section."""
    says: str
    """The claim, with the unit of its figures."""
    measure: Measure | None = None
    """Its figures; None where the paper gives none."""
    effect: bool = False
    """Whether the figures are changes, whose sign is the claim; else their order is."""
    holds: tuple[tuple[str, str], ...] = ()
    """Entry and identifier of its claims that have to hold as well."""
    excluded: bool = False
    """Whether the paper's own figures contradict each other here."""
    why: str = ""
    """One sentence on what the comparison means, where its entry has no :attr:`reason` with figures of the run."""

    @property
    def entry(self) -> str:
        """Entry that shows it; empty where the paper's figures speak alone."""
        return self.measure.part if self.measure else self.holds[0][0] if self.holds else ""

    @property
    def about(self) -> str:
        """The physical effect."""
        return self.id.partition("/")[0]

    def reason(self, found: Results) -> str:
        """One sentence on what the comparison means: the entry's, with figures of its run, or else :attr:`why`."""
        return found.parts.get(self.entry, {}).get("reasons", {}).get(self.id, self.why)


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A claim with its figures and its verdict."""

    claim: Claim
    figures: Sequence[Figure]
    verdict: Verdict
    mark: Mark
    needed: int | None = None
    """Seeds that would resolve it, of one that is unresolved."""
    why: str = ""
    """See :meth:`Claim.reason`."""

    @property
    def largest(self) -> float:
        """Largest relative difference of its figures that were not used to calibrate; 0 without any."""
        return max((abs(f.relative) for f in self.figures if not f.calibrated and f.paper), default=0.0)


def mark_of(entry: str) -> Mark:
    """Knowledge of the paper's figures when an entry was made; without an entry nothing was tuned in view."""
    return CONTENTS[entry].mark if entry in CONTENTS else Mark.PREDICTED


def judge(claim: Claim, found: Results) -> Judged:
    """The verdict, by rule.

    A claim's direction is the sign of its effects, or else of the differences between its levels that the paper
    separates by more than their spread, each with its interval over seeds (:meth:`Figure.sign`); and the claims of its
    entry. *Not reproduced*: one of these is excluded, or a lone level, which has no direction, disagrees.
    *Unresolved*: nothing is excluded, but an interval is too wide to decide. *Sign agrees, size does not*: all have
    the paper's direction. *Reproduced*: every figure agrees as well. Calibrated figures take no part.
    """
    figures = claim.measure(found) if claim.measure else []
    free = [figure for figure in figures if not figure.calibrated]
    verdict, needed = _verdict(claim, found, free) if free or not figures else (Verdict.CALIBRATED, None)
    mark = mark_of(claim.entry)
    if verdict is Verdict.CALIBRATED:
        mark = Mark.CALIBRATED
    return Judged(claim=claim, figures=figures, verdict=verdict, mark=mark, needed=needed, why=claim.reason(found))


def _verdict(claim: Claim, found: Results, figures: Sequence[Figure]) -> tuple[Verdict, int | None]:
    """Verdict of a claim by its figures, none of which is calibrated, and the seeds that would resolve it."""
    if claim.excluded:
        return Verdict.EXCLUDED, None
    tests = figures if claim.effect else [a.minus(b) for a, b in itertools.combinations(figures, 2) if _apart(a, b)]
    signs = [test.sign() for test in tests]
    agree = all(figure.agrees for figure in figures)
    without_direction = bool(figures) and not tests and not claim.holds
    if Verdict.NOT in signs or (without_direction and not agree):
        return Verdict.NOT, None
    if open_ones := [test for test, sign in zip(tests, signs, strict=True) if sign is Verdict.UNRESOLVED]:
        return Verdict.UNRESOLVED, max(test.needed() for test in open_ones)
    if not all(found.holds(part, name) for part, name in claim.holds):
        return Verdict.NOT, None
    return (Verdict.REPRODUCED if agree else Verdict.DIRECTION), None


def _apart(a: Figure, b: Figure) -> bool:
    """Whether two of the paper's figures differ by more than their spread."""
    spread = math.hypot(a.paper_sd or 0.0, b.paper_sd or 0.0) or NEAR * max(abs(a.paper), abs(b.paper))
    return abs(a.paper - b.paper) > spread


def by_effect(judged: Sequence[Judged]) -> dict[Mark, dict[Verdict, int]]:
    """How many physical effects have which verdict, by what was known of them.

    An effect counts once, by the worst verdict of its claims. Calibrated claims, and those that exclude each other, are
    none of these.
    """
    worst: dict[tuple[Mark, str], Verdict] = {}
    for each in judged:
        if each.verdict in BY_EFFECT:
            effect = each.mark, each.claim.about
            worst[effect] = min(worst.get(effect, each.verdict), each.verdict, key=BY_EFFECT.index)
    return {
        mark: {verdict: sum(of is mark and v is verdict for (of, _), v in worst.items()) for verdict in BY_EFFECT[::-1]}
        for mark in (Mark.IN_VIEW, Mark.PREDICTED)
    }
