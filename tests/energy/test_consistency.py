"""The paper's own numbers: each way of reconciling them really does, and the holding bound in a worked case."""

import pytest

from mrwarp import paper
from mrwarp.energy import consistency


@pytest.mark.parametrize("speed", [0.2, 0.3, 0.5])
def test_each_reconciliation_makes_the_ratios_equal(speed: float) -> None:
    """Walking slower, a load past the meter, a gauge's exponent: the energy ratio becomes the depletion ratio."""
    ratio = paper.MISSION_DEPLETION["mr_go_sal"][0] / paper.MISSION_DEPLETION["mr_go"][0]
    before = consistency.mission_energy("mr_go", speed)
    after = consistency.mission_energy("mr_go_sal", speed)
    slower = consistency.walking_speed("mr_go_sal", ratio * before)
    assert consistency.mission_energy("mr_go_sal", slower) / before == pytest.approx(ratio)
    hours = (300.0 / speed + 600.0) / 3600.0
    hidden = consistency.hidden_load("mr_go", "mr_go_sal", speed) * hours
    assert (after + hidden) / (before + hidden) == pytest.approx(ratio)
    exponent = consistency.gauge_exponent("mr_go", "mr_go_sal", speed)
    assert (after / before) ** exponent == pytest.approx(ratio)


def test_the_papers_ratios() -> None:
    """Walking power falls to 0.726, depletion only to 0.885; more than 2.5 standard deviations at any speed."""
    found = consistency.check()
    assert found["walking_power_ratio"] == pytest.approx(295.4 / 407.0)
    assert found["depletion_ratio"] == pytest.approx(52.5 / 59.3)
    assert all(row["deviation_in_sd"] > 2.5 for row in found["by_speed"])


def test_table_6_gives_the_abstracts_reductions() -> None:
    """20.2, 21.3, 25.4 and 24.9 %."""
    found = consistency.check()["cot_reduction"]
    assert [round(100.0 * value, 1) for value in found.values()] == [20.2, 21.3, 25.4, 24.9]


def test_holding_bound_in_a_worked_case() -> None:
    """Four calves held half of the time: each saves 4*(40/4) W while it is held, in all 80 W; mass counts squared."""
    assert consistency.holding_bound(0.5, 12.0, standing=40.0, reference=12.0) == pytest.approx(80.0)
    assert consistency.holding_bound(0.5, 24.0, standing=40.0, reference=12.0) == pytest.approx(320.0)


def test_holding_bound_of_the_papers_robots() -> None:
    """Its Go1 stood with an arm of 2.8 kg and 39.8 W more than its MR_Go; held for 27.4 % of a walk: 31.7 W."""
    assert consistency.STANDING == pytest.approx(39.8)
    assert consistency.STANDING_MASS == pytest.approx(14.77, abs=0.01)
    bounds = consistency.paper_bounds("hardware")
    assert [round(row["bound"], 1) for row in bounds] == [31.7, 23.4, 55.6, 46.3]


def test_power_of_a_row_is_eq_21_backwards() -> None:
    """Go1 at 0.28 m/s: 4.297*12*9.81*0.28 W; and hips and thighs complete the mean over all motors."""
    assert paper.TABLE_6["go1", 0, 0.3].power == pytest.approx(4.297 * 12.0 * 9.81 * 0.28)
    for robot, rise in paper.MISSION_RISE.items():
        calf = rise["calf_walking"] + rise["calf_standby"]
        assert (4.0 * calf + 8.0 * paper.proximal_rise(robot)) / 12.0 == pytest.approx(rise["all"])
