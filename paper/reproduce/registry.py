"""All experiments and all claims of the paper, collected from the files that :mod:`paper.reproduce.contents` names."""

from __future__ import annotations

from importlib import import_module

from paper.reproduce.cache import Experiment
from paper.reproduce.contents import CONTENTS, SIMULATIONS
from paper.reproduce.verdicts import Claim, Judged, Results, judge

_MODULES = dict.fromkeys((*SIMULATIONS.values(), *(entry.module for entry in CONTENTS.values())))

_FILES = [import_module(f"paper.reproduce.{module}") for module in _MODULES]

_MADE: dict[str, Experiment] = {experiment.name: experiment for file in _FILES for experiment in file.EXPERIMENTS}

CATALOGUE = {name: _MADE[name] for name in (*SIMULATIONS, *CONTENTS)}
"""Experiments by name, each after what it needs."""

CONTRADICTIONS = (
    Claim(
        id="paper.holding_capacity",
        place="Section 2.2",
        says="holding capacity of 26.15 N·m at 1.5 A; eq. 18 at 1.5 A",
        excluded=True,
        why="Eq. 18 with the paper's own numbers gives 25.4 N·m; we take the equation.",
    ),
    Claim(
        id="paper.deceleration",
        place="Table 5, row D; table 4",
        says="|a_z - g| of 0.852 m/s² over 0.1 s next to a peak velocity of 0.428 m/s",
        excluded=True,
        why="0.852 m/s² over 0.1 s allow 0.085 m/s.",
    ),
    Claim(
        id="paper.activation",
        place="Section 6.4",
        says="20 to 25 % in each condition, and a longer activation gives a larger reduction",
        excluded=True,
        why="The second longest activation (27.4 %) has the least reduction, less than the shortest.",
    ),
    Claim(
        id="paper.charge",
        place="Figure 10",
        says="powers of MR_Go-SAL at 0.73 of MR_Go's next to 0.885 of its charge",
        excluded=True,
        why="At equal speeds the paper's powers deplete 45 points, not 52.5 ± 2.0.",
    ),
)
"""Claims that the paper's own figures contradict; no entry shows them."""

_SHOWN: list[Claim] = [claim for file in _FILES for claim in getattr(file, "CLAIMS", ())]

CLAIMS = (*sorted(_SHOWN, key=lambda claim: list(CONTENTS).index(claim.entry)), *CONTRADICTIONS)
"""All claims: by entry, in the order of the report, then those within the paper."""


def judge_all(found: Results) -> list[Judged]:
    """All claims whose entries were made."""
    return [judge(claim, found) for claim in CLAIMS if not claim.entry or claim.entry in found.parts]
