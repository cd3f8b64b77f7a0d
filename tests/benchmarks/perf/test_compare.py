"""The regression check: ratios, never seconds; a slowed ratio fails, noise does not; bad files are refused."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.perf.compare import LEAST_TOLERANCE, CompareError, compare, load_ratios


def ratios(**medians: float) -> dict[str, Any]:
    """Ratios with quartiles 2 % around their medians."""
    return {name: {"median": m, "low": 0.98 * m, "high": 1.02 * m, "error": 0.0} for name, m in medians.items()}


def test_equal_runs_have_no_regression() -> None:
    """Every ratio that both have is compared, others are not."""
    rows = compare(ratios(a=1.1, b=2.0, old=3.0), ratios(a=1.1, b=2.0, new=3.0))
    assert [row.name for row in rows] == ["a", "b"] and not any(row.regressed for row in rows)


def test_a_slowed_ratio_is_found_and_a_faster_one_is_fine() -> None:
    """Half as much again is a regression; within the least tolerance is not; faster never is."""
    rows = compare(ratios(slow=1.1, noise=1.1, fast=1.1), ratios(slow=1.65, noise=1.19, fast=0.5))
    assert [row.regressed for row in rows] == [True, False, False]
    assert all(row.tolerance == LEAST_TOLERANCE for row in rows)


def test_tolerance_grows_with_the_spread() -> None:
    """A ratio whose quartiles differ by 30 % in one run and by 40 % in the other may be half as large again."""
    before = {"a": {"median": 1.0, "low": 0.9, "high": 1.2}}
    now = {"a": {"median": 1.49, "low": 1.49 * 0.8, "high": 1.49 * 1.2}}
    (row,) = compare(before, now)
    assert row.tolerance == pytest.approx(0.5) and not row.regressed
    now["a"]["median"] = 1.6
    now["a"]["low"], now["a"]["high"] = 1.6 * 0.8, 1.6 * 1.2
    assert compare(before, now)[0].regressed


def test_a_machine_twice_as_slow_is_no_regression(tmp_path: Path) -> None:
    """Seconds in the file play no part."""
    path = tmp_path / "result.json"
    path.write_text(json.dumps({"ratios": ratios(a=1.1), "walking": {"64": {"seconds": 1.0}}}))
    assert not compare(load_ratios(path), ratios(a=1.1))[0].regressed


@pytest.mark.parametrize(
    "text",
    [
        "no json",
        "[]",
        "{}",
        '{"ratios": {}}',
        '{"ratios": {"a": 1.0}}',
        '{"ratios": {"a": {"median": 1.0}}}',
        '{"ratios": {"a": {"median": -1.0, "low": 1.0, "high": 1.0}}}',
        '{"ratios": {"a": {"median": true, "low": 1.0, "high": 1.0}}}',
    ],
)
def test_a_file_that_is_no_result_is_refused(tmp_path: Path, text: str) -> None:
    """One line that names the file and what to give instead."""
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(CompareError, match="other.json") as error:
        load_ratios(path)
    assert "\n" not in str(error.value) and "perf" in str(error.value)
