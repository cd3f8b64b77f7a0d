"""Turns interleave, medians and their spread, ratios round by round."""

import numpy as np
import pytest

from benchmarks.perf.timing import Spread, interleave, ratio

EPS = 4.0 * float(np.finfo(float).eps)
"""Of a ratio of two products, at its quartiles."""


def test_turns_interleave_and_warm_up_is_not_counted() -> None:
    """A B A B ..., one value per part and counted round."""
    order: list[str] = []

    def turn(name: str, seconds: float):
        def run() -> dict[str, float]:
            order.append(name)
            return {"step": seconds, "half": seconds / 2}

        return run

    times = interleave({"a": turn("a", 1.0), "b": turn("b", 3.0)}, rounds=3, warmup=2)
    assert order == ["a", "b"] * 5
    assert times == {"a.step": [1.0] * 3, "a.half": [0.5] * 3, "b.step": [3.0] * 3, "b.half": [1.5] * 3}


def test_ratio_is_taken_round_by_round() -> None:
    """A machine that slows down by and by, or in single rounds, for both equally, changes no ratio."""
    slow = np.array([1.0, 1.1, 5.0, 1.2, 9.0])
    found = ratio({"a": list(3.0 * slow), "b": list(2.0 * slow)}, "a", "b")
    assert found.median == pytest.approx(1.5) and found.high - found.low == pytest.approx(0.0, abs=EPS)


def test_spread_of_known_values() -> None:
    """Quartiles of 0, 1, ..., 100, and the notch of a box plot."""
    found = Spread.of(range(101))
    assert (found.low, found.median, found.high) == (25.0, 50.0, 75.0)
    assert found.error == pytest.approx(1.57 * 50.0 / 101**0.5)
