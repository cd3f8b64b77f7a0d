"""Predictions are frozen once, by the stated rule, and a miss is reported."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from paper.reproduce import pages, predictions
from paper.reproduce.predictions import Known, Prediction, between, interval
from paper.reproduce.verdicts import Results

WIDE = Prediction(condition="5 kg", quantity="COT", unit="", digits=2, centre=3.0, half_width=0.5)
"""2.5 to 3.5: a third of its value."""

NARROW = replace(WIDE, half_width=0.3)


def test_interval_is_students_over_seeds() -> None:
    """t of 90 % with two degrees of freedom is 2.92; new seeds add their own scatter."""
    known = Known(mean=1.0, sd=0.3, n=3)
    rel = 0.5e-5 / 2.91999  # half of the quantile's last digit
    assert interval(known) == pytest.approx(2.91999 * 0.3 / math.sqrt(3.0), rel=rel)
    assert interval(known, 5) == pytest.approx(2.91999 * 0.3 * math.sqrt(1.0 / 3.0 + 1.0 / 5.0), rel=rel)


def test_lines_carry_mean_and_spread() -> None:
    """Beyond the second point its own spread counts more."""
    known = between(Known(mean=1.0, sd=0.1, n=5), Known(mean=4.0, sd=0.1, n=3), 5.0 / 3.0)
    assert (known.mean, known.n) == (pytest.approx(6.0), 3)
    assert known.sd == pytest.approx(0.1 * math.hypot(2.0 / 3.0, 5.0 / 3.0))


def test_the_rule_covers_every_part_and_is_frozen_once(tmp_path: Path) -> None:
    """From the committed figures; a second freeze is refused, what was written is what is read."""
    found = Results(pages.read()["parts"])
    predictions.write(found, tmp_path)
    assert predictions.read(tmp_path) == predictions.freeze(found)
    assert not any(each.condition.startswith(predictions.WITHDRAWN) for each in predictions.read(tmp_path))
    with pytest.raises(ValueError, match="is frozen"):
        predictions.write(found, tmp_path)
    keys = [(each.condition, each.quantity) for each in predictions.read()]
    assert len(keys) == len(set(keys)) == 40
    assert all(each.half_width > 0.0 for each in predictions.read())


def test_what_is_no_longer_made_is_withdrawn() -> None:
    """It neither counts nor waits."""
    gone = replace(NARROW, condition=f"{predictions.WITHDRAWN[0]} 50 N, 0 A")
    found = predictions.findings([(NARROW, 3.2), (gone, None)])
    assert found.tables[0].rows[1][-1] == "withdrawn"
    title = found.tables[0].title
    assert "1 of 1 hit their 90 % interval" in title and "not run yet" not in title


def test_misses_are_reported() -> None:
    """Outside, and where no robot arrived."""
    found = predictions.findings([(NARROW, 3.2), (NARROW, 3.6), (NARROW, math.nan), (NARROW, None)])
    assert [row[-1] for row in found.tables[0].rows] == ["hit", "missed", "missed", "not run yet"]
    assert "1 of 3 hit their 90 % interval" in found.tables[0].title and "1 are not run yet" in found.tables[0].title
    assert list(found.claims.values()) == [False]


def test_a_wide_interval_is_said_to_prove_little() -> None:
    """One of a third of its value, or about zero, next to one of a fifth; a miss stays a miss."""
    about_zero = replace(WIDE, centre=0.0, half_width=0.01)
    found = predictions.findings([(WIDE, 3.4), (WIDE, 3.6), (about_zero, 0.0), (NARROW, 3.2), (NARROW, 3.4)])
    assert [row[-1] for row in found.tables[0].rows] == [
        "hit, proves little",
        "missed",
        "hit, proves little",
        "hit",
        "missed",
    ]
    assert "3 intervals are wider than 25 %" in found.tables[0].title
    assert "of the 2 others 1 hit" in found.tables[0].title
