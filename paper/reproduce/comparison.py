"""Findings of an entry of the report: figures of the paper next to ours, claims, notes, tables and pictures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypedDict

import numpy as np

from mrwarp import paper
from mrwarp.paper import PaperValue
from paper.reproduce.verdicts import Figure

CELLS = tuple(paper.condition_name(*cell) for cell in paper.TABLE_7)
"""Conditions of tables 6 and 7."""

BRAKE = "; brake constraint"
"""End of the conditions in which the devices act as a brake that sticks, next to those with the paper's torque."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One figure of the paper next to ours."""

    condition: str
    """Condition, e.g. ``MR_Go-SAL, 3 kg, 0.3 m/s``."""
    quantity: str
    """Measured quantity."""
    unit: str
    """Unit; empty for a pure number."""
    paper: PaperValue | None
    """None where the paper gives no figure."""
    ours: float
    """Mean."""
    sd: float | None = None
    """Its sample standard deviation over seeds or trials; None for one value."""
    n: int = 1
    """Seeds or trials."""
    seeds: Sequence[float] = ()
    """The figure of each of these, in their order, where they are kept."""
    calibrated: bool = False
    """Whether the paper's figure was used to fit a number of ours."""
    digits: int = 3
    """Digits behind the point."""
    why: str = ""
    """One sentence on a difference beyond the joint spread."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "seeds", tuple(self.seeds))

    @property
    def figure(self) -> Figure | None:
        """As the rule of :mod:`paper.reproduce.verdicts` reads it; None where the paper gives no figure."""
        if self.paper is None:
            return None
        return Figure(paper=self.paper.mean, paper_sd=self.paper.sd, ours=self.ours, sd=self.sd, n=self.n)

    @property
    def differs(self) -> bool:
        """Whether the difference exceeds the joint spread, or 5 % where the paper states none."""
        return self.figure is not None and not self.figure.agrees


def compare(
    condition: str,
    quantity: tuple[str, str, int],
    theirs: PaperValue | float,
    ours: Mapping[str, Any],
    why: str = "",
    *,
    calibrated: bool = False,
) -> Comparison:
    """A row of the report.

    Args:
        condition: What was done.
        quantity: What was measured, its unit, and digits behind the point.
        theirs: The paper's figure; a number has no spread.
        ours: ``ours``, ``sd``, ``n`` and ``seeds``, see :func:`over_seeds`.
        why: Why they differ.
        calibrated: Whether the paper's figure was used to fit a number of ours.
    """
    name, unit, digits = quantity
    value = theirs if isinstance(theirs, PaperValue) else PaperValue(mean=theirs)
    shown = {"condition": condition, "quantity": name, "unit": unit, "digits": digits, "why": why}
    return Comparison(**shown, paper=value, calibrated=calibrated, **ours)


@dataclass(frozen=True, kw_only=True)
class TextTable:
    """A further table: rows of text."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    id: str = ""
    """By which a page finds it in its entry; empty where none asks for it."""


@dataclass(frozen=True, kw_only=True)
class Findings:
    """Findings of an experiment; plain values throughout."""

    rows: Sequence[Comparison] = ()
    claims: Mapping[str, bool] = field(default_factory=dict)
    """Each claim of the paper as a sentence, and whether ours agrees."""
    claim_ids: Mapping[str, str] = field(default_factory=dict)
    """Sentence of each claim by its identifier, by which it is found; see :func:`identified`."""
    reasons: Mapping[str, str] = field(default_factory=dict)
    """One sentence on a claim of :data:`paper.reproduce.registry.CLAIMS` by its identifier, with this run's figures."""
    notes: Sequence[str] = ()
    """Sentences with the evidence behind the rows."""
    tables: Sequence[TextTable] = ()
    pictures: Mapping[str, str] = field(default_factory=dict)
    """File in the experiment's folder to caption."""
    figures: Mapping[str, Any] = field(default_factory=dict)
    """Everything else that was computed."""

    def __post_init__(self) -> None:
        for name in ("rows", "notes", "tables"):
            object.__setattr__(self, name, tuple(getattr(self, name)))


class Identified(TypedDict):
    """Two fields of :class:`Findings`."""

    claims: dict[str, bool]
    claim_ids: dict[str, str]


def identified(*claims: tuple[str, str, bool | np.bool_]) -> Identified:
    """``claims`` and ``claim_ids`` of :class:`Findings` from identifiers, sentences, and whether they hold."""
    return {
        "claims": {text: bool(holds) for _, text, holds in claims},
        "claim_ids": {name: text for name, text, _ in claims},
    }


def seeds_of(trials: np.ndarray, policies: int) -> np.ndarray | None:
    """Seed of each trial, of which number i was walked by policy ``i % policies``; None with a single policy.

    A single policy's trials are the only repetitions there are. Of several policies one may be all that arrived: its
    trials are still one seed.
    """
    return np.asarray(trials) % policies if policies > 1 else None


def over_seeds(values: np.ndarray, seeds: np.ndarray | None = None) -> dict[str, Any]:
    """``ours``, ``sd``, ``n`` and ``seeds`` of a :class:`Comparison`; rollouts are averaged within each seed first.

    Section 6.2 does so.

    Args:
        values: One per rollout; NaN where there is no figure, which counts as no rollout.
        seeds: Seed of each rollout, see :func:`seeds_of`; None takes every rollout as its own.
    """
    values = np.asarray(values, dtype=float)
    there = ~np.isnan(values)
    values = values[there]
    if seeds is not None:
        seeds = np.asarray(seeds)[there]
        values = np.array([values[seeds == seed].mean() for seed in np.unique(seeds)])
    if not len(values):
        return {"ours": math.nan, "sd": None, "n": 0, "seeds": ()}
    sd = float(values.std(ddof=1)) if len(values) > 1 else None
    return {"ours": float(values.mean()), "sd": sd, "n": len(values), "seeds": tuple(values.tolist())}
