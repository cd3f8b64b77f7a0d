"""Entries that read pushes and falling masses, on made-up trials."""

from pathlib import Path

import matplotlib.axes
import numpy as np
import pytest

from mrwarp import paper
from mrwarp.reproduce import impact_results, impacts, table4
from mrwarp.reproduce.cache import Job
from mrwarp.reproduce.comparison import Findings
from mrwarp.reproduce.impact_results import fig6, fig7
from mrwarp.reproduce.settings import Settings
from mrwarp.trials.impact import ImpactTrace
from mrwarp.trials.impact_figures import threshold_variants
from mrwarp.usd.robot import CURRENT_GROUPS, LEGS

TRIALS = 6
"""Two of each of three policies."""


def pushed(level: float = 1.1, stance: str = "FR-RL") -> impacts.Pushes:
    """Pushes whose cells are the paper's times ``level``, SAL off as its 0 A."""
    theirs, adopted = paper.TABLE_4["simulation"], impacts.Reading(kp=16.0, kd=0.1, stance=stance)
    currents = (0.0, 0.0, *CURRENT_GROUPS[1:])
    cells = {cell: np.tile([[level * theirs[amps][cell].mean] for amps in currents], TRIALS) for cell in impacts.CELLS}
    onset = np.full(TRIALS, impacts.START)
    results = [
        impacts.PushResult(reading=reading, onset=onset, cells=cells, policies=3)
        for reading in impacts.variations(adopted)
    ]
    grid = [impacts.GridCell(reading=adopted, duration=0.2, lift=0.1, onset=0.33, drop=0.15, speed=0.7, score=0.0,
                             fell=0.0)]  # fmt: skip
    shape = (5, TRIALS, 5, 4)
    torque = np.zeros(shape) + np.arange(1.0, 5.0)
    torque[-1] *= 0.9
    fell = np.zeros((5, TRIALS), dtype=bool)
    trace = {"t": np.arange(5.0), "tau_motor": torque, "m_dyn": np.ones(shape), "fell": fell}
    return impacts.Pushes(grid=grid, readings=results, traces={"eq. 14": trace, "required": trace})


def dropped() -> impacts.Drops:
    """Falling masses: policies differ by 1, the trials of each by 0.1."""
    values = np.tile([0.0, 1.0, 2.0, 0.1, 1.1, 2.1], (4, 1))
    figures = {name: values.copy() for name in (*impacts.CELLS, *LEGS)} | {"fell": np.zeros_like(values, dtype=bool)}
    return impacts.Drops(figures=dict.fromkeys(impacts.DROPS, figures), policies=3)


def made(entry, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, found: impacts.Pushes) -> Findings:
    """What an entry finds in these pushes and falling masses."""
    monkeypatch.setattr(impacts, "read_pushes", lambda job: found)
    monkeypatch.setattr(impacts, "read_drops", lambda job: dropped())
    return entry(Job(settings=Settings(), out=tmp_path))


def test_figure6_reads_the_leg_that_is_loaded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The adopted push meets FR and RL, the mirror image of the paper's FL and RR; rows and a note say so."""
    found = made(fig6, monkeypatch, tmp_path, pushed())
    ours = {row.condition: row.ours for row in found.rows}
    assert ours["FR for the paper's FL, mean, 1.5 A"] == pytest.approx(0.9 * (1 + LEGS.index("FR")))
    assert ours["RL for the paper's RR, peak, 1.5 A"] == pytest.approx(0.9 * (1 + LEGS.index("RL")))
    assert ours["RL for the paper's RR, peak, 0 to 1.5 A"] == pytest.approx(-10.0)
    assert "while FR and RL stand, the paper's while FL and RR do" in found.notes[1]
    assert not any("phase" in row.why for row in found.rows)


@pytest.mark.parametrize(
    ("phases", "legs"),
    [(impacts.FL_RR_STANCE, {"FL": "FL", "RR": "RR"}), (impacts.FR_RL_STANCE, {"FL": "FR", "RR": "RL"}),
     ((0.1, 0.3), {"FL": "FL", "RR": "RR"}), ((0.25, 0.75), {"FL": "FL"}), (None, {"FL": "FL", "RR": "RR"})],
)  # fmt: skip
def test_legs_follow_from_the_phases(phases: tuple[float, float] | None, legs: dict[str, str]) -> None:
    """The leg at the same end of the pair that stands; phases over both stances leave the paper's."""
    assert {leg: impact_results.same_load(leg, phases) for leg in legs} == legs


def test_table4_shows_the_effect_against_both_references(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Cells 10 % too high keep the paper's changes; the row of 0 A is calibrated, those above are not."""
    found = made(table4.compute, monkeypatch, tmp_path, pushed())
    rows = {(row.condition, row.quantity): row for row in found.rows}
    for against in ("SAL off", "0 A, gates open"):
        row = rows[f"1.5 A against {against}: {impacts.variations(pushed().adopted.reading)[0].name}",
                   "change of minimum height"]  # fmt: skip
        assert row.ours == pytest.approx(paper.IMPACT_CHANGE["min_height"]["push"], abs=0.06)
    assert rows["push, 0 A", "minimum height"].calibrated and not rows["push, 1.5 A", "minimum height"].calibrated
    assert rows["push, 1.5 A", "minimum height"].ours == pytest.approx(1.1 * 0.2124)
    assert "the six simulation cells above 0 A lie within 5 % (0 do)" in found.claims
    assert made(table4.compute, monkeypatch, tmp_path, pushed(1.0)).claims[
        "the six simulation cells above 0 A lie within 5 % (6 do)"
    ]
    for table in found.tables:
        assert {len(row) for row in table.rows} == {len(table.head)}


@pytest.mark.parametrize(("entry", "method"), [(table4.compute, "errorbar"), (fig7, "bar")])
def test_bars_show_the_spread_of_the_rows(entry, method: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Three policies at 0.05, 1.05 and 2.05: mean 1.05 and SD 1, not the 0.82 of the six trials together."""
    drawn, real = [], getattr(matplotlib.axes.Axes, method)

    def spy(axes, x, y, *args, **kwargs):
        drawn.append((y, args[0] if args and method == "errorbar" else kwargs.get("yerr")))
        return real(axes, x, y, *args, **kwargs)

    monkeypatch.setattr(matplotlib.axes.Axes, method, spy)
    found = made(entry, monkeypatch, tmp_path, pushed())
    row = next(row for row in found.rows if "drop of" in row.condition or entry is fig7)
    bars = [(y[0], sd[0]) for y, sd in drawn if np.isclose(y, 1.05).all()]
    assert bars == [pytest.approx((row.ours, row.sd))] * (6 if entry is table4.compute else 12)
    assert (row.ours, row.sd, row.n) == (pytest.approx(1.05), pytest.approx(1.0), 3)


def test_masses_that_miss_leave_no_figure() -> None:
    """Neither a torque of 0 nor one of the walk; those and the fallen robots are counted in notes."""
    steps = np.zeros((1, 3, 40, 4))
    height = np.full((1, 3, 40), 0.3)
    trace = ImpactTrace(
        t=0.005 * np.arange(1.0, 41.0), height=height, velocity=np.zeros_like(height), tau_motor=steps + 2.0,
        tau_mr=steps, current=steps, m_dyn=steps, m_hold=steps, f_foot=steps, q=steps, qd=steps,
        qpos=np.zeros((1, 40, 19)), ledger=np.zeros((1, 3, 7)), fell=np.array([[False, True, False]]),
        contact=np.array([[0.02, 0.02, np.nan]]),
    )  # fmt: skip
    found = impacts.measured(trace)
    for name in (*impacts.CELLS, "acceleration", *LEGS):
        assert np.isnan(found[name]).tolist() == [[False, False, True]]
    assert found["FR"][0, :2] == pytest.approx(2.0)
    assert impacts.lost([found]) == [
        "1 of 3 masses missed the robot and leave no figure.",
        "1 of 3 falling masses brought the trunk below 0.1 m; their figures count.",
    ]
    assert impacts.lost([{**found, "min_height": height[..., 0], "fell": trace.fell & False}]) == []


def test_sensitivity_is_over_seeds() -> None:
    """Policies whose drop shrinks by 10, 20 and 30 %: 20 % with SD 10 over three, however many trials each had."""
    count = len(threshold_variants(1.5))
    share = np.tile([0.9, 0.8, 0.7], 4)
    drop = np.where(np.arange(count)[:, None] == 0, 0.1, 0.1 * share)
    height = np.stack([np.full_like(drop, 0.3), 0.3 - drop], axis=2)
    blank = np.zeros((count, 12, 2, 4))
    trace = ImpactTrace(
        t=np.array([0.005, 0.01]), height=height, velocity=np.zeros_like(height),
        tau_motor=drop[..., None, None] + blank, tau_mr=blank, current=blank, m_dyn=blank, m_hold=blank, f_foot=blank,
        q=blank, qd=blank, qpos=np.zeros((count, 2, 19)), ledger=np.zeros((count, 12, 7)),
        fell=np.zeros((count, 12), dtype=bool), contact=np.zeros((count, 12)),
    )  # fmt: skip
    for entries in impact_results.by_seed(trace, 3).values():
        for entry in entries:
            for quantity in impact_results.REDUCED:
                cell = entry[quantity]
                assert (cell["ours"], cell["sd"], cell["n"]) == (pytest.approx(20.0), pytest.approx(10.0), 3)
    single = impact_results.by_seed(trace, 1)["f_th"][0]["drop"]
    assert (single["ours"], single["n"]) == (pytest.approx(20.0), 12)
    assert single["sd"] == pytest.approx(float(np.std(100.0 * (1.0 - share), ddof=1)))


def test_papers_changes_are_those_of_its_cells() -> None:
    """The abstract's percentages follow from table 4 to their last digit, and those of COT from table 6."""
    for cell, change in paper.IMPACT_CHANGE.items():
        for kind, source in (("push", "simulation"), ("drop", "hardware")):
            rows = paper.TABLE_4[source]
            assert 100.0 * (rows[1.5][cell].mean / rows[0.0][cell].mean - 1.0) == pytest.approx(change[kind], abs=0.06)
    keys = [key[1:] for key in paper.TABLE_6 if key[0] == "mr_go"]
    lower = [1.0 - paper.TABLE_6["mr_go_sal", *key].cot / paper.TABLE_6["mr_go", *key].cot for key in keys]
    assert (min(lower), max(lower)) == pytest.approx(paper.COT_REDUCTION, abs=5e-4)
