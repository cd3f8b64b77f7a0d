"""Entries that read falling masses, on made-up trials."""

from pathlib import Path

import matplotlib.axes
import numpy as np
import pytest

from mrwarp.usd.robot import LEGS
from paper.reproduce.cache import Job
from paper.reproduce.comparison import BRAKE
from paper.reproduce.disturbance import drop_trials
from paper.reproduce.disturbance.drop_trials import COLUMNS, DROPS
from paper.reproduce.disturbance.fig7 import fig7
from paper.reproduce.disturbance.table5 import table5
from paper.reproduce.settings import Settings
from paper.study.plan import AWARE, CONVENTIONAL


def dropped() -> drop_trials.Drops:
    """Falling masses: policies differ by 1, the trials of each by 0.1; a device takes a tenth."""
    values = np.tile([1.0, 2.0, 3.0, 1.1, 2.1, 3.1], (7, 1))
    names = ("min_height", "peak_down_velocity", "acceleration", *LEGS)

    def some(settings: int) -> dict[str, np.ndarray]:
        changed = values[:settings].copy()
        changed[1:] *= 0.9
        return {name: changed for name in names} | {"fell": np.zeros_like(changed, dtype=bool)}

    struck = {f"{training}, {drop.name}": some(2) for training in (CONVENTIONAL, AWARE) for drop in COLUMNS}
    return drop_trials.Drops(
        figures={drop.name: some(4) for drop in DROPS},
        bound=some(7),
        struck=struck,
        policies=3,
        trained=3,
    )


def test_bars_show_the_spread_of_the_rows(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Three policies at 1.05, 2.05 and 3.05: mean 2.05 and SD 1, not the 0.82 of the six trials together."""
    drawn, real = [], matplotlib.axes.Axes.bar

    def spy(axes, x, y, *args, **kwargs):
        drawn.append((y[0], kwargs["yerr"][0]))
        return real(axes, x, y, *args, **kwargs)

    monkeypatch.setattr(matplotlib.axes.Axes, "bar", spy)
    monkeypatch.setattr(drop_trials, "read", lambda job: dropped())
    found = fig7(Job(settings=Settings(), out=tmp_path))
    row = next(row for row in found.rows if row.condition.startswith("FR, 0 A"))
    assert (row.ours, row.sd, row.n) == (pytest.approx(2.05), pytest.approx(1.0), 3)
    assert drawn.count(pytest.approx((row.ours, row.sd))) == len(COLUMNS)
    assert all(found.claims.values()) and len(found.claims) == len(DROPS)


def test_table5_has_two_columns(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Every configuration with the paper's torque and with the constraint; SAL takes its tenth of both trainings."""
    monkeypatch.setattr(drop_trials, "read", lambda job: dropped())
    found = table5(Job(settings=Settings(), out=tmp_path))
    ours = {(row.condition, row.quantity): row.ours for row in found.rows}
    for column in ("", BRAKE):
        off, on = (
            ours[f"C: {AWARE}, SAL off{column}", "mean |a_z - g|"],
            ours[f"D: {AWARE}, SAL on{column}", "mean |a_z - g|"],
        )
        assert on == pytest.approx(0.9 * off)
        assert found.claims[f"SAL lowers |a_z - g| of both{column}"]
