"""Readings of the push and figures of the drop: closed forms on made-up numbers."""

import numpy as np
import pytest

from mrwarp import paper
from mrwarp.params import BoucWenParams, HoldParams
from mrwarp.reproduce import impacts, table4
from mrwarp.reproduce.impacts import Pushes
from mrwarp.reproduce.settings import Settings
from mrwarp.trials.impact import ImpactTrace
from mrwarp.usd.robot import CURRENT_GROUPS


def test_yield_reading_slides_at_the_yield_torque() -> None:
    """At the bound of z the sliding torque K1*I*z is eq. 18's, at any speed."""
    reading = next(r for r in impacts.READINGS if r.torque == "yield")
    law = HoldParams()
    for variant in impacts.config(reading, Settings()).variants[1:]:
        sliding = variant.params["K1"] * variant.current * BoucWenParams().z_bound
        wanted = law.T_max * variant.current**law.n / (law.K**law.n + variant.current**law.n)
        assert sliding == pytest.approx(wanted)
        assert variant.params["alpha"] == 0.0


def test_low_gain_reading_opens_the_gate_at_zero_current() -> None:
    """Its 0 A setting has a current that holds less than a millionth of what the loaded calf needs."""
    reading = next(r for r in impacts.READINGS if r.soft_at_zero)
    first = impacts.config(reading, Settings()).variants[0].current
    law = HoldParams()
    assert 0.0 < law.T_max * (first / law.K) ** law.n < 1e-5


def test_mismatch_is_zero_at_the_papers_row_alone() -> None:
    """Relative squares: 10 % off in one cell is 0.01."""
    row = paper.TABLE_4["simulation"][0.0]
    exact = {cell: np.array([row[cell].mean, 1.1 * row[cell].mean]) for cell in impacts.CELLS}
    exact["peak_down_velocity"][1] = row["peak_down_velocity"].mean
    np.testing.assert_allclose(impacts.mismatch(exact), [0.0, 0.01], atol=1e-12)


def test_undamped_speed_is_that_of_an_integrated_spring() -> None:
    """Stepped finely, the spring that 100 N press down by 0.15 m falls at that speed at most."""
    k = 2.0 * 100.0 / 0.15
    x, v, peak, lowest, dt = 0.0, 0.0, 0.0, 0.0, 1e-5
    for _ in range(60_000):
        v += dt * (100.0 - k * x) / 12.6
        x += dt * v
        peak, lowest = max(peak, v), max(lowest, x)
    assert lowest == pytest.approx(0.15, rel=1e-3)
    assert impacts.undamped_speed(0.15) == pytest.approx(peak, rel=1e-3)


def test_names_tell_the_readings_apart() -> None:
    """Each stands once, and the adopted one is among them."""
    names = [reading.name for reading in impacts.READINGS]
    assert len(set(names)) == len(names)
    assert impacts.ADOPTED in impacts.READINGS


def test_drop_is_measured_from_the_contact_on() -> None:
    """A torque that is 2 before the contact and 6 N·m after it has the mean 6; the trunk decelerates by 3 m/s^2."""
    t = np.arange(1, 81) * 0.005
    contact = np.array([[0.1, 0.2]])
    after = t > contact[..., None]
    legs = np.where(after, 6.0, 2.0)[..., None] * np.ones(4)
    velocity = np.where(after, -3.0 * (t - contact[..., None]), 0.0)
    trace = ImpactTrace(
        t=t, height=0.3 + np.zeros((1, 2, 80)), velocity=velocity, tau_motor=legs, tau_mr=legs, current=legs,
        m_dyn=legs, m_hold=legs, f_foot=legs, q=legs, qd=legs, qpos=np.zeros((1, 80, 19)), ledger=np.zeros((1, 2, 7)),
        fell=np.zeros((1, 2), dtype=bool), contact=contact,
    )  # fmt: skip
    found = impacts.measured(trace)
    np.testing.assert_allclose(found["FR"], 6.0)
    np.testing.assert_allclose(found["acceleration"], 3.0, rtol=1e-6)
    np.testing.assert_allclose(found["peak_down_velocity"], -3.0 * (t[-1] - contact))


def test_table_of_readings_has_a_line_each_and_the_papers_first() -> None:
    """Cells, changes and the worst prediction as text."""
    row = paper.TABLE_4["simulation"]
    cells = {cell: np.array([[1.05 * row[amps][cell].mean] for amps in CURRENT_GROUPS]) for cell in impacts.CELLS}
    cells["min_height"][3] = cells["min_height"][0]
    entries = [impacts.ReadingResult(reading=r.name, duration=0.2, cells=cells) for r in impacts.READINGS]
    found = Pushes(readings=entries, trace={}, policies=1)
    table = table4.table(found)
    assert len(table.rows) == len(impacts.READINGS) + 1
    assert {len(row) for row in table.rows} == {len(table.head)}
    assert table.rows[0][2 : 2 + len(CURRENT_GROUPS)] == ["0.1851", "0.2030", "0.2072", "0.2124"]
    assert table.rows[1][-4:] == ["+0.0 %", "-19.3 %", "8 %", "no"]
