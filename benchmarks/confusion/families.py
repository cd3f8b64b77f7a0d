"""Families of cases: which effect, size, noise and rendering the case of an index has."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from benchmarks.confusion import bench, foreign, mechanics, outside
from benchmarks.confusion.case import Case, JointCase, make_case, make_foreign, make_joint
from benchmarks.confusion.effects import CALIBRATION, PAIRS, SINGLE, UNCATALOGUED
from benchmarks.confusion.motion import joined

OTHER_LAWS = {"foreign": foreign, "outside": outside, "mechanics": mechanics}
"""Families of devices that follow other laws than eqs. 14 and 15: published ones, ones in no list of laws, none."""

FAMILIES = (
    "single",
    "none",
    "uncatalogued",
    "pairs",
    "background",
    "calibration",
    "other",
    "foreign",
    "outside",
    "mechanics",
    "bench",
)
"""Families by name."""

ASKED = ("size", "noise", "base_spread", "truth_rate", "motion")
"""Settings of all data sets of a plan that go to the case as they are."""

READ: dict[str, tuple[str, ...]] = {
    "foreign": ("size", "joined"),
    "outside": ("size", "joined"),
    "mechanics": (),
    "bench": ("size",),
}
"""Which of them, and whether sessions are joined, a family reads that has the rest of its own; others read all."""

SEED_STEP = 100_003
"""Case ``index`` of a suite with seed S has the seed S*100003 + index."""

VARIANTS: dict[str, dict[str, Any]] = {
    "linear": {"linear": True},
    "voltage": {"voltage": True},
    "without velocity": {"velocity": False},
    "100 Hz": {"rate": 100.0},
    "1 kHz": {"rate": 1000.0},
    "3 kHz": {"rate": 3000.0},
    "trajectory clock": {"session_clock": False},
    "linear, voltage, without velocity, 1 kHz": {"linear": True, "voltage": True, "velocity": False, "rate": 1000.0},
}
"""Other recordings, for the family "other"."""

_NONE = [
    (noise, size, spread)
    for spread in (0.02, 0.2)
    for size in ("large", "small")
    for noise in ("realistic", "harsh", "clean")
]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Families of cases of a suite."""

    family: str
    level: float = 0.4
    """Level of each effect; in the families of :data:`OTHER_LAWS` its share of the torque's RMS."""
    seed: int = 0
    size: str | None = None
    """Size of all data sets; None: large, in the family "none" both in turn."""
    noise: str | None = None
    """Noise of all data sets; None: realistic, in the family "none" all in turn."""
    base_spread: float | None = None
    """Spread of all coefficients; None: 0.02, in the family "none" 0.02 and 0.2 in turn."""
    truth_rate: float | None = None
    """Lowest rate at which the truth is stepped [1/s]; None: 2 kHz."""
    motion: str | None = None
    """Motion of all data sets, of :data:`~benchmarks.confusion.motion.MOTIONS`; None: mixed."""
    strengths: tuple[tuple[str, float], ...] = ()
    """Effects of the family "single" that are hidden together, each with its typical strength, in place of ``kinds``
    and ``level``; empty: one at a time, by level."""
    joined: bool = False
    """Whether each session is recorded as one run, its trajectories one after another without a stop."""
    kinds: tuple[str, ...] = ()
    """Only these effects (a pair as ``a+b``); empty for all."""

    def __post_init__(self) -> None:
        if self.family not in FAMILIES:
            raise ValueError(f"family = {self.family!r} is unknown; one of {', '.join(FAMILIES)}")
        given = [name for name in ASKED if getattr(self, name) is not None] + ["joined"] * self.joined
        if own := [name for name in given if name not in READ.get(self.family, given)]:
            raise ValueError(f"family {self.family!r} has its own {', '.join(own)}; leave out what says otherwise")
        if self.strengths and (self.family != "single" or self.kinds):
            raise ValueError("strengths are of family 'single' and say which effects there are; leave out kinds")
        unknown = ({name for name, _ in self.strengths} | set(self.kinds)) - set(self._known())
        if unknown:
            raise ValueError(f"kind {min(unknown)!r} is not in family {self.family!r}; of {', '.join(self._known())}")

    def _known(self) -> list[str]:
        kinds = {"uncatalogued": UNCATALOGUED, "calibration": CALIBRATION, "none": ("none",), "bench": bench.EFFECTS}
        kinds |= {family: laws.HIDDEN for family, laws in OTHER_LAWS.items()}
        if self.family == "pairs":
            return ["+".join(pair) for pair in PAIRS]
        return list(kinds.get(self.family, SINGLE))

    def arguments(self, index: int) -> dict[str, Any]:
        """Keyword arguments of :func:`~benchmarks.confusion.case.make_case` for the case ``index``."""
        kinds = [kind for kind in self._known() if not self.kinds or kind in self.kinds]
        kind, turn = kinds[index % len(kinds)], index // len(kinds)
        if self.strengths:
            kind = "+".join(name for name, _ in self.strengths)
        out: dict[str, Any] = {"kind": tuple(kind.split("+")) if "+" in kind else kind, "level": self.level}
        out["seed"] = self.seed * SEED_STEP + index
        asked = {name: value for name in ASKED if (value := getattr(self, name)) is not None}
        if self.family in OTHER_LAWS:
            laws = OTHER_LAWS[self.family].LAWS
            return {"kind": kind, "law": laws[index % len(laws)], "share": self.level, "seed": out["seed"], **asked}
        if self.family == "bench":
            return {"kind": kind, "seed": out["seed"], **asked}
        if self.family == "none":
            out["noise"], out["size"], out["base_spread"] = _NONE[index % len(_NONE)]
        elif self.family == "background":
            out["background"] = UNCATALOGUED[(turn + index % len(kinds)) % len(UNCATALOGUED)]
        elif self.family == "other":
            # what cannot show: a velocity's lag without one, a drift from run to run without a clock that runs on
            needs = {"velocity_lag": "velocity", "wear": "session_clock", "temperature_drift": "session_clock"}.get(
                kind
            )
            names = [name for name, variant in VARIANTS.items() if needs is None or variant.get(needs, True)]
            out |= VARIANTS[names[(turn + index % len(kinds)) % len(names)]]
        return {**out, **asked, **({"strengths": dict(self.strengths)} if self.strengths else {})}

    def make(self, index: int) -> Case | JointCase:
        """Make the case ``index``."""
        if self.family == "bench":
            return bench.make_session(**self.arguments(index))
        if self.family == "mechanics":
            return make_joint(**self.arguments(index))
        made = make_foreign if self.family in OTHER_LAWS else make_case
        case = made(**self.arguments(index))
        return replace(case, motion=joined(case.motion)) if self.joined else case
