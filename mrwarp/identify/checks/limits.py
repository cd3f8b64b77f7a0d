"""Numbers of a fit that are given, or kept within bounds, by the names under which ``mrwarp fit`` prints them."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Annotated

from mrwarp.options import option_types as opt
from mrwarp.runtime import closest

Ends = tuple[float, float]
"""Least and largest value; the same twice for one that is given."""

_SLOPES = ("alpha", "beta", "B", "K0", "K1")
"""Numbers of eqs. 14 and 15 that are never negative."""


def bound_of(text: str) -> tuple[str, Ends]:
    """A name and its bounds, such as ``C=0:2``; an end that is left out is infinite."""
    name, _, ends = text.partition("=")
    low, colon, high = ends.partition(":")
    if not (name and colon and (low or high)):
        raise ValueError(f"{text!r} is not NAME=LOW:HIGH, such as C=0:2 or B=0.1:")
    try:
        return name, (opt.number(low) if low else -math.inf, opt.number(high) if high else math.inf)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Numbers that are given, and bounds of others, in the units of the recording.

    Raises:
        ValueError: a number is limited twice, has no room between its bounds, or a sign that it cannot have.
    """

    fix: Annotated[tuple[tuple[str, float], ...], opt.some(opt.assignment, "NAME=VALUE")] = ()
    """numbers that are given, not fitted, by the names and in the units that fit prints, such as C=0"""
    bound: Annotated[tuple[tuple[str, Ends], ...], opt.some(bound_of, "NAME=LOW:HIGH")] = ()
    """numbers that stay within bounds, such as C=0:2; an end may be left out, as in B=0.1:"""

    def __post_init__(self) -> None:
        names = [name for name, _ in (*self.fix, *self.bound)]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"{name} is given {names.count(name)} times by --fix and --bound; give it once")
        for name, (low, high) in self.bound:
            if not low < high:
                raise ValueError(f"--bound {name}={low:g}:{high:g}: the upper bound must be larger than the lower one")
        for name, (_, high) in self.ends.items():
            if name in _SLOPES and (high < 0.0 or name == "beta" and high <= 0.0):
                raise ValueError(f"{name} <= {high:g} is not possible; it is {'above 0' if name == 'beta' else '>= 0'}")
        if "gamma" in self.ends and "beta" in self.ends and self.ends["beta"][1] <= self.least_gamma:
            raise ValueError(
                f"gamma of at least {self.least_gamma:g} in size next to beta of at most {self.ends['beta'][1]:g}: "
                "beta must be larger than the size of gamma; else the hysteresis would give energy"
            )

    @property
    def given(self) -> dict[str, float]:
        """The numbers that are not fitted."""
        return dict(self.fix)

    @property
    def ends(self) -> dict[str, Ends]:
        """Both ends of each number, twice the same of one that is given."""
        return {name: (value, value) for name, value in self.fix} | dict(self.bound)

    @property
    def least_gamma(self) -> float:
        """Least size of gamma within its bounds."""
        return least_size(self.ends.get("gamma", (0.0, 0.0)))

    def check(self, known: Collection[str]) -> None:
        """Refuse a name that a fit does not have.

        Raises:
            ValueError: with the names that it has.
        """
        for option, pairs in (("fix", self.fix), ("bound", self.bound)):
            for name, _ in pairs:
                if name not in known:
                    near, names = closest(name, known), ", ".join(known)
                    raise ValueError(f"--{option} {name}: this fit has no such number; {near}choose from {names}")


def least_size(ends: Ends) -> float:
    """Least size of a number between two ends."""
    return 0.0 if ends[0] <= 0.0 <= ends[1] else min(abs(ends[0]), abs(ends[1]))
