"""Sets of causes: grown one by one, and the least certain one taken out until all that stay are certain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

T = TypeVar("T")
State = TypeVar("State")


def grown(state: State, better: Callable[[State], State | None]) -> State:
    """Forward search: a state as long as there is a better one, with one cause more."""
    while (more := better(state)) is not None:
        state = more
    return state


def eliminated(
    items: Sequence[T],
    certainty: Callable[[list[T]], Sequence[float]],
    *,
    together: Callable[[list[T]], list[T]] = lambda weakest: weakest[:1],
) -> tuple[list[T], list[T]]:
    """Backward elimination: the least certain cause goes and the others are judged without it, until all are certain.

    Args:
        items: The causes.
        certainty: Of each of the causes that are left, in what is needed of it: from 1 on it stays.
        together: Which go at a time, of those that are not certain, the least certain first.

    Returns:
        Causes that stay, and those that went, in the order in which they did.
    """
    kept, gone = list(items), list[T]()
    while kept:
        certain = certainty(kept)
        order = sorted(range(len(kept)), key=lambda k: certain[k])
        weakest = [kept[k] for k in order if not certain[k] >= 1.0]
        if not weakest:
            break
        for one in together(weakest):
            kept.remove(one)
            gone.append(one)
    return kept, gone
