"""Findings of an entry of the report: figures of the paper next to ours, claims, notes, tables and pictures."""

from __future__ import annotations

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
    error: float = 0.0
    """Standard error next to that of the seeds: what the calibration leaves open of the fitted numbers."""
    error_free: int = 0
    """Degrees of freedom behind it."""
    calibrated: bool = False
    """Whether the paper's figure was used to fit a number of ours."""
    digits: int = 3
    """Digits behind the point."""
    why: str = ""
    """One sentence on a difference beyond its interval."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "seeds", tuple(self.seeds))

    @property
    def figure(self) -> Figure | None:
        """As the rule of :mod:`paper.reproduce.verdicts` reads it; None where the paper gives no figure."""
        if self.paper is None:
            return None
        theirs = {"paper": self.paper.mean, "paper_sd": self.paper.sd, "paper_n": self.paper.n}
        return Figure(**theirs, **{name: getattr(self, name) for name in ("ours", "sd", "n", "error", "error_free")})

    @property
    def differs(self) -> bool:
        """Whether the difference is larger than its interval, see :meth:`Figure.agrees`."""
        return self.figure is not None and not self.figure.agrees()


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
        ours: ``ours``, ``sd``, ``n`` and ``seeds``, see :func:`paper.reproduce.settings.over_seeds`, and ``error``.
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
