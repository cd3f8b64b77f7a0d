"""Entries that read pushes, on made-up trials."""

from pathlib import Path

import numpy as np
import pytest

from mrwarp import paper
from mrwarp.trials.impact_figures import threshold_variants
from mrwarp.usd.robot import CURRENT_GROUPS, LEGS
from paper.reproduce.cache import Job
from paper.reproduce.comparison import Findings
from paper.reproduce.disturbance import drop_trials, push_entries, push_rule, table4
from paper.reproduce.disturbance.push_rule import JOINT, LITERAL, PAIR
from paper.reproduce.settings import Settings
from tests.paper.reproduce.disturbance.test_drop_trials import trace
from tests.paper.reproduce.disturbance.test_table5 import dropped

TRIALS = 6
"""Two of each of three policies."""


def pushed(torque: np.ndarray | None = None, level: float = 1.1) -> push_rule.Pushes:
    """Pushes whose cells are the paper's times ``level``; motor torques (C, N, T, L) with the gate open throughout."""
    theirs = paper.TABLE_4["simulation"]
    cells = {
        cell: np.tile([[level * theirs[amps][cell].mean] for amps in CURRENT_GROUPS], TRIALS)
        for cell in push_rule.CELLS
    }
    results = [
        push_rule.PushResult(reading=reading, onset=np.full(TRIALS, 0.33), cells=cells, policies=3)
        for reading in push_rule.READINGS
    ]
    shape = (4, TRIALS, 5, 4)
    if torque is None:
        torque = np.ones(shape)
        torque[-1] *= 0.9
    series = {
        "t": np.arange(5.0), "tau_motor": torque, "m_dyn": np.ones(shape), "fell": np.zeros((4, TRIALS), dtype=bool),
        "height": np.ones(shape[:3]), "f_foot": np.ones(shape),
    }  # fmt: skip
    zeros = [push_rule.ZeroRow(duration=0.3, onset=0.33, **push_rule.papers_zero())]
    return push_rule.Pushes(
        zeros=zeros,
        durations=[{cell: np.ones(3) for cell in push_rule.CELLS}],
        results=results,
        traces={LITERAL.name: series, JOINT.name: series},
    )


def made(entry, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, found: push_rule.Pushes) -> Findings:
    """Findings of an entry in these pushes and falling masses."""
    monkeypatch.setattr(push_rule, "read", lambda job: found)
    monkeypatch.setattr(drop_trials, "read", lambda job: dropped())
    return entry(Job(settings=Settings(), out=tmp_path))


def test_figure6_is_a_ratio_of_means(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A push whose motor hardly worked without current outweighs no other: 10.1 N·m to 9.05 are -10 %, not +845 %."""
    torque = np.ones((4, TRIALS, 5, 4))
    torque[0, :3], torque[-1, :3] = 20.0, 17.0
    torque[0, 3:], torque[-1, 3:] = 0.1, 1.09
    found = made(push_entries.fig6, monkeypatch, tmp_path, pushed(torque))
    ours = {row.condition: row.ours for row in found.rows}
    for leg in PAIR:
        for kind in ("mean", "peak"):
            assert ours[f"{leg}, {kind}, 0 to 1.5 A"] == pytest.approx(100.0 * (18.09 / 20.1 - 1.0))
    assert all(found.claims.values()) and f"FL, mean, 1.5 A{JOINT.column}" in ours


def test_the_first_opening_ends_when_the_gate_closes() -> None:
    """Later openings and trials whose gate stays closed do not count."""
    gate = np.array([[0, 1, 1, 0, 1], [0, 0, 0, 0, 0], [1, 0, 1, 1, 1]], dtype=bool)
    first = push_entries.first_opening(gate)
    assert first.astype(int).tolist() == [[0, 1, 1, 0, 0], [0, 0, 0, 0, 0], [1, 0, 0, 0, 0]]
    found = push_entries.while_open(np.tile(np.arange(5.0), (3, 1)), first)
    np.testing.assert_allclose(found["mean"], [1.5, np.nan, 0.0])
    np.testing.assert_allclose(found["peak"], [2.0, np.nan, 0.0])
    np.testing.assert_allclose(push_entries.policy_means(np.array([1.0, np.nan, 3.0, np.nan]), 2), [2.0, np.nan])


def test_table4_has_two_columns_and_every_effect(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Cells 10 % too high keep the paper's changes; the row of 0 A is calibrated, those above are not."""
    found = made(table4.compute, monkeypatch, tmp_path, pushed())
    rows = {(row.condition, row.quantity): row for row in found.rows}
    for reading in push_rule.READINGS:
        effect = rows[f"1.5 A against 0 A{reading.column}", "change of minimum height"]
        assert effect.ours == pytest.approx(paper.IMPACT_CHANGE["min_height"]["push"], abs=0.06)
    for column in ("", JOINT.column):
        assert rows[f"push, 0 A{column}", "minimum height"].calibrated
        assert not rows[f"push, 1.5 A{column}", "minimum height"].calibrated
        assert rows[f"push, 1.5 A{column}", "minimum height"].ours == pytest.approx(1.1 * 0.2124)
    assert all(found.claims.values())
    for table in found.tables:
        assert {len(row) for row in table.rows} == {len(table.head)}


def test_the_lowest_point_is_that_of_the_stance() -> None:
    """Two of three pushes are lower in a later stance; in the first the swinging pair bears a quarter of the load."""
    series = {
        "t": np.array([0.1, 0.2, 0.3, 0.6]),
        "height": np.array([[[0.3, 0.2, 0.25, 0.1], [0.3, 0.2, 0.25, 0.15], [0.3, 0.25, 0.2, 0.3]]]),
        "f_foot": np.zeros((1, 3, 4, len(LEGS))),
    }
    for k, leg in enumerate(LEGS):
        series["f_foot"][0, 0, 1, k] = series["f_foot"][0, 1, 1, k] = 30.0 if leg in PAIR else 10.0
        series["f_foot"][0, 2, 2, k] = 30.0 if leg in PAIR else 10.0
    found = table4.lowest_point(series)
    assert found == {"time": pytest.approx(0.7 / 3.0), "caught": pytest.approx(0.25), "later": pytest.approx(2.0 / 3.0)}


def test_sensitivity_is_over_seeds() -> None:
    """Policies whose drop and torques shrink by 10, 20 and 30 %: each its own, however many trials each had."""
    count = len(threshold_variants(1.5))
    share = np.tile([0.9, 0.8, 0.7], 4)
    drop = np.where(np.arange(count)[:, None] == 0, 0.1, 0.1 * share)
    height = np.stack([np.full_like(drop, 0.3), 0.3 - drop], axis=2)
    shape = (count, 12, 2)
    pushes = trace(shape, height=height, tau_motor=drop[..., None, None] + np.zeros((*shape, len(LEGS))))
    for entries in push_entries.by_seed(pushes, 3).values():
        for entry in entries:
            for quantity in push_entries.REDUCED:
                assert entry[quantity] == pytest.approx([10.0, 20.0, 30.0])
    single = push_entries.by_seed(pushes, 1)["f_th"][0]
    assert single["drop"] == pytest.approx([20.0]) and single["peak"] == pytest.approx([20.0])
