"""Questions that the method asks of a plant, be it joint or robot.

A class that answers them is searched by :mod:`mrwarp.sysid.stepwise`.

A *model* is the plant with the causes that it names, at its best numbers; how these are fitted is the plant's matter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic, Protocol, TypeVar

Model = TypeVar("Model")
Candidate = TypeVar("Candidate")
Cause = TypeVar("Cause")

Certainty = Callable[[Model], Sequence[float]]
"""Of each cause of a model, in what is needed of it: from 1 on it stays."""


class Named(Protocol[Model, Cause]):
    """Models that name causes."""

    def causes(self, model: Model, /) -> Sequence[Cause]:
        """The causes of a model that a search has added to it."""
        ...

    def without(self, model: Model, cause: Cause, /) -> Model:
        """The model without one of them."""
        ...


class Plant(Named[Model, Cause], Protocol[Model, Candidate, Cause]):
    """Possible faults of a plant, and the tests of a cause."""

    @property
    def base(self) -> Model:
        """The model that a search begins with: it names no cause."""
        ...

    def candidates(self, model: Model, /) -> Sequence[Candidate]:
        """Causes beyond a model that are physically possible and would explain enough, by a first look; best first."""
        ...

    def grown(self, model: Model, candidates: Sequence[Candidate], /) -> Model | None:
        """The model with one of these causes more, or those it is part of; None where none is worth its place."""
        ...

    def settled(self, model: Model, /) -> Model:
        """The causes as the plant reads them once all are found, such as one in place of two that say as much."""
        ...

    @property
    def tests(self) -> Sequence[Certainty[Model]]:
        """Tests that each cause of a model has to pass next to the others, one after the other."""
        ...


class Listed(Generic[Cause]):
    """Models that are the lists of their causes."""

    def causes(self, model: list[Cause], /) -> list[Cause]:
        """All of them."""
        return model

    def without(self, model: list[Cause], cause: Cause, /) -> list[Cause]:
        """The others."""
        return [x for x in model if x is not cause]
