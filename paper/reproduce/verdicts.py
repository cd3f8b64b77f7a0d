"""How a claim of the paper fares: its figures next to ours, and the rule that judges them.

The paper's figures are means with a spread, as ours are: both enter with their standard errors, and a claim's rows are
tested together. Judged from the figures of ``docs/results/paper.json`` alone; nothing is simulated here.
"""

from __future__ import annotations

import enum
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import stats

LEVEL = 0.95
"""Level of the intervals of all rows of a claim together (Bonferroni): each row's is that much wider."""

STATED = 0.05
"""Relative standard error of a figure that the paper states without a spread: what a claim on it can mean."""

WIDE = {"effect": 0.5, "level": 0.25}
"""Half width of a difference, relative to the paper's figure, beyond which agreement says nothing of the size: half of
an effect is as near to none as to all of it; a level, which nothing compares with zero, is held to half of that."""

MOST_SEEDS = 10_000
"""Seeds beyond which nobody would count them."""


class Verdict(enum.Enum):
    """How a claim fares."""

    REPRODUCED = "reproduced"
    WORDS = "as the paper says, without a figure"
    SIGN = "sign agrees, size not resolved"
    DIRECTION = "sign agrees, size does not"
    UNRESOLVED = "not resolved"
    NOT = "not reproduced"
    CALIBRATED = "calibrated"
    EXCLUDED = "contradicts the paper itself"


BY_EFFECT = (*list(Verdict)[5::-1],)
"""Verdicts that are counted by effect, the worst first."""


def half_width(parts: Sequence[tuple[float, float]], tests: int = 1) -> float:
    """Half of the interval of a sum of independent figures at :data:`LEVEL` for so many tests together.

    By Student's t with Welch's and Satterthwaite's degrees of freedom; 0 without any error.

    Args:
        parts: Standard error and its degrees of freedom, of each part.
        tests: Tests that share the level (Bonferroni).
    """
    if (whole := _sum(parts)) is None:
        return 0.0
    error, free = whole
    quantile = 1.0 - 0.5 * (1.0 - LEVEL) / tests
    return error * float(stats.norm.ppf(quantile) if math.isinf(free) else stats.t.ppf(quantile, free))


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure of the paper next to ours."""

    paper: float
    paper_sd: float | None = None
    paper_n: int | None = None
    """Repetitions behind the paper's spread; None where it does not say: then the spread stands for the error."""
    ours: float
    sd: float | None = None
    n: int = 1
    """Seeds or trials that ``sd`` is over."""
    seeds: tuple[float, ...] = ()
    """Ours by seed, where it is kept."""
    error: float = 0.0
    """Standard error of ours next to that of the seeds, as by fitted numbers."""
    error_free: int = 0
    """Degrees of freedom behind it."""
    digits: int = 3
    calibrated: bool = False
    joined: tuple[tuple[float, float] | None, tuple[float, float] | None] = (None, None)
    """Standard error and its degrees of freedom that several rows have together, the paper's and ours, see :func:`pool`
    and :meth:`minus`; None where the row's own count."""

    @property
    def theirs(self) -> list[tuple[float, float]]:
        """Standard error of the paper's figure and its degrees of freedom, for :func:`half_width`."""
        if self.joined[0]:
            return [self.joined[0]]
        if not self.paper_sd:
            return [(STATED * abs(self.paper), math.inf)]
        n = self.paper_n
        return [(self.paper_sd / math.sqrt(n), n - 1) if n and n > 1 else (self.paper_sd, math.inf)]

    def own(self, n: int | None = None) -> list[tuple[float, float]]:
        """Standard errors of ours over ``n`` seeds, or those that there are: of the seeds, and of fitted numbers."""
        n = n or self.n
        found = [(self.sd / math.sqrt(n), float(n - 1))] if self.sd and n > 1 else []
        if self.joined[1]:
            error, free = self.joined[1]
            found = [(error * math.sqrt(self.n / n), free * (n - 1) / max(self.n - 1, 1))]
        return [*found, (self.error, float(self.error_free))]

    @property
    def relative(self) -> float:
        """Ours over the paper's, less 1: positive where ours is further from 0; NaN for a 0."""
        return self.ours / self.paper - 1.0 if self.paper else math.nan

    @property
    def in_errors(self) -> float:
        """The difference over the standard error of both, positive where ours is further from 0."""
        error = math.sqrt(sum(e**2 for e, _ in [*self.theirs, *self.own()]))
        return math.copysign(1.0, self.paper) * (self.ours - self.paper) / error if error else math.nan

    def reach(self, tests: int = 1, n: int | None = None) -> float:
        """Half width of the difference of both."""
        return half_width([*self.theirs, *self.own(n)], tests)

    def agrees(self, tests: int = 1) -> bool:
        """Whether the difference of both is within its interval; a figure that is not there does not agree."""
        return abs(self.ours - self.paper) <= self.reach(tests)

    def wide(self, kind: str, tests: int = 1) -> bool:
        """Whether that interval is too wide for agreement to say anything, see :data:`WIDE`."""
        return self.reach(tests) > WIDE[kind] * abs(self.paper)

    def minus(self, other: Figure) -> Figure:
        """The difference of two figures, seed by seed where both have the same seeds and that spreads less.

        Errors by fitted numbers move both figures together and are left out.
        """
        one, two = self.joined[0], other.joined[0]
        theirs = (math.hypot(one[0], two[0]), one[1]) if one and two else _sum([*self.theirs, *other.theirs])
        own = _sum([*self.own()[:-1], *other.own()[:-1]])
        n = max(self.n, other.n)
        ours = self.ours - other.ours
        if len(self.seeds) == len(other.seeds) > 1:
            each = np.subtract(self.seeds, other.seeds)
            paired = (float(each.std(ddof=1)) / math.sqrt(len(each)), float(len(each) - 1))
            ours, own = float(each.mean()), min(own or paired, paired, key=lambda part: half_width([part]))
        return Figure(paper=self.paper - other.paper, ours=ours, n=n, joined=(theirs, own))

    @property
    def one_value(self) -> bool:
        """Whether ours is a single value whose spread nobody knows."""
        return self.sd is None and self.joined[1] is None and not self.error

    def stated(self, tests: int = 1) -> bool:
        """Whether the paper's figure, an effect, is clear of zero by its own spread."""
        return abs(self.paper) > half_width(self.theirs, tests)

    def sign(self, tests: int = 1) -> Verdict:
        """Whether ours, an effect, has the paper's sign.

        *Not resolved*: the paper's interval holds zero, ours has no spread, or its interval neither leaves out zero on
        the paper's side nor the paper's figure, which would be *not reproduced*.
        """
        if not self.stated(tests) or self.one_value:
            return Verdict.UNRESOLVED
        if self.ours * self.paper > 0.0 and abs(self.ours) > half_width(self.own(), tests):
            return Verdict.SIGN
        return Verdict.UNRESOLVED if self.agrees(tests) else Verdict.NOT

    def needed(self, tests: int = 1) -> int | None:
        """Seeds whose interval, with the spread of ours, cannot hold both zero and the paper's figure.

        None where the paper's own spread decides, or what the seeds do not narrow.
        """
        if not self.stated(tests) or self.one_value:
            return None
        clear = 0.5 * abs(self.paper)
        if half_width(self.own(MOST_SEEDS), tests) > clear and self.error:
            return None
        counts = (n for n in range(2, MOST_SEEDS) if half_width(self.own(n), tests) < clear)
        return next(counts, MOST_SEEDS)


def _sum(parts: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """Standard error of a sum of independent parts and its degrees of freedom, as :func:`half_width` has them."""
    variances = [(error**2, free) for error, free in parts if error > 0.0]
    if not variances:
        return None
    total, rest = sum(v for v, _ in variances), sum(v**2 / free for v, free in variances)
    return math.sqrt(total), total**2 / rest if rest else math.inf


def pool(figures: Sequence[Figure]) -> list[Figure]:
    """A claim's rows with the paper's spread of all of them, where these do not differ beyond chance.

    Three repetitions know a spread badly; rows of one quantity know it together. By Bartlett's test of equal spreads.
    """
    known = [(f.paper_sd, f.paper_n) for f in figures if f.paper_sd and f.paper_n and f.paper_n > 1]
    if len(known) < max(len(figures), 2):
        return list(figures)
    variances, frees = np.transpose([(sd**2, n - 1.0) for sd, n in known])
    rest = frees.sum()
    joint = float(frees @ variances) / rest
    scale = 1.0 + ((1.0 / frees).sum() - 1.0 / rest) / (3.0 * (len(known) - 1))
    unequal = (rest * math.log(joint) - float(frees @ np.log(variances))) / scale
    if unequal > stats.chi2.ppf(LEVEL, len(known) - 1):
        return list(figures)
    errors = [(math.sqrt(joint / n), float(rest)) for _, n in known]
    return [replace(figure, joined=(error, None)) for figure, error in zip(figures, errors, strict=True)]


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
                theirs = {f"paper_{name}": row["paper"].get(name) for name in ("sd", "n")}
                kept = {name: row.get(name, 0) for name in ("sd", "error", "error_free", "digits", "calibrated")}
                more = {"seeds": tuple(row.get("seeds", ())), "n": max(row["n"], 1)}
                return Figure(paper=row["paper"]["mean"], ours=ours, **theirs, **kept, **more)
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
            n = min((n for n in (a.paper_n, b.paper_n) if n), default=None)
            papers = {"paper": theirs, "paper_sd": theirs_sd, "paper_n": n}
            figures.append(Figure(**papers, ours=ours, sd=sd, digits=1, n=min(a.n, b.n)))
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
    needed: int | None = None
    """Seeds that would resolve it, of one that is not resolved; None where seeds alone would not."""
    why: str = ""
    """See :meth:`Claim.reason`."""


def judge(claim: Claim, found: Results) -> Judged:
    """The verdict, by rule.

    A claim's direction is the sign of its effects, or else of the differences between its levels that the paper
    separates, each tested by the standard errors of both with as many tests as the claim has rows
    (:meth:`Figure.sign`); and the claims of its entry. *Not reproduced*: one of these is excluded, or a lone level,
    which has no direction, disagrees. *Not resolved*: nothing is excluded, but an interval is too wide to decide, the
    paper's own among them. *Sign agrees*: all have the paper's direction; the size *does not* where a figure disagrees,
    and is *not resolved* where an interval is wide (:data:`WIDE`). *Reproduced*: every figure agrees as well. What has
    no figure is not reproduced but *as the paper says*. Calibrated figures take no part.
    """
    figures = claim.measure(found) if claim.measure else []
    free = [figure for figure in figures if not figure.calibrated]
    verdict, needed = _verdict(claim, found, free) if free or not figures else (Verdict.CALIBRATED, None)
    return Judged(claim=claim, figures=figures, verdict=verdict, needed=needed, why=claim.reason(found))


def _verdict(claim: Claim, found: Results, figures: Sequence[Figure]) -> tuple[Verdict, int | None]:
    """Verdict of a claim by its figures, none of which is calibrated, and the seeds that would resolve it."""
    if claim.excluded:
        return Verdict.EXCLUDED, None
    rows, figures = len(figures), pool(figures)
    pairs = [] if claim.effect else [a.minus(b) for a, b in itertools.combinations(figures, 2)]
    tests = list(figures) if claim.effect else [pair for pair in pairs if pair.stated(rows)]
    signs = [test.sign(rows) for test in tests]
    agree = all(figure.agrees(rows) for figure in figures)
    without_direction = bool(figures) and not tests and not claim.holds
    if Verdict.NOT in signs or (without_direction and not agree):
        return Verdict.NOT, None
    if open_ones := [test for test, sign in zip(tests, signs, strict=True) if sign is Verdict.UNRESOLVED]:
        needed = [test.needed(rows) for test in open_ones]
        return Verdict.UNRESOLVED, None if None in needed else max(n for n in needed if n)
    if not all(found.holds(part, name) for part, name in claim.holds):
        return Verdict.NOT, None
    if not figures:
        return Verdict.WORDS, None
    if not agree:
        return Verdict.DIRECTION, None
    if not any(figure.wide("effect" if claim.effect else "level", rows) for figure in figures):
        return Verdict.REPRODUCED, None
    return (Verdict.UNRESOLVED if without_direction else Verdict.SIGN), None


def by_effect(judged: Sequence[Judged]) -> dict[Verdict, int]:
    """How many physical effects have which verdict.

    An effect counts once, by the worst verdict of its claims. Calibrated claims, and those that exclude each other, are
    none of these.
    """
    worst: dict[str, Verdict] = {}
    for each in judged:
        if each.verdict in BY_EFFECT:
            about = each.claim.about
            worst[about] = min(worst.get(about, each.verdict), each.verdict, key=BY_EFFECT.index)
    return {verdict: sum(found is verdict for found in worst.values()) for verdict in BY_EFFECT[::-1]}
