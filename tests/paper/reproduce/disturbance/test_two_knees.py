"""The model of one degree of freedom: against closed forms, a smaller step, and the paper's row of 0 A."""

import math
import sys
from dataclasses import replace

import pytest

from mrwarp import paper
from mrwarp.params import BoucWenParams
from paper.reproduce import paper_checks
from paper.reproduce.disturbance import two_knees
from paper.reproduce.disturbance.two_knees import Knees, fall


def test_it_stands_without_a_push() -> None:
    """The motors carry the weight where it starts, to a few roundings in each step of half a second."""
    found, rounding = fall(Knees(force=0.0), 0.0), 4.0 * sys.float_info.epsilon * 0.5 / two_knees.STEP
    assert found.height == pytest.approx(Knees().start, abs=rounding) and found.speed < rounding


def test_a_small_push_is_a_spring() -> None:
    """Stiff knees without damping: twice the static way, at the speed of a linear spring.

    To the step's first order, and to how far a lever changes over the way and over the sag that its weight makes.
    """
    knees = Knees(kp=2000.0, kd=0.0, force=20.0, duration=1.0, drag=False)
    theta = 2.0 * math.acos((knees.start - two_knees.SOLE) / (2.0 * two_knees.LINK))
    stiffness = two_knees.LEGS * knees.kp / (two_knees.LINK * math.sin(0.5 * theta)) ** 2
    found = fall(knees, 0.0, step=1e-4)
    way, sag = 2.0 * 20.0 / stiffness, knees.mass * paper.GRAVITY / stiffness
    rel = 1e-4 * math.sqrt(stiffness / knees.mass) + (way + sag) / (two_knees.LINK * math.sin(0.5 * theta))
    assert knees.start - found.height == pytest.approx(way, rel=rel)
    assert found.speed == pytest.approx(20.0 / math.sqrt(stiffness * knees.mass), rel=rel)


def test_the_step_is_fine_enough() -> None:
    """Half of it moves nothing by a tenth of a percent."""
    knees = replace(two_knees.by_zero_row(raw=True, drag=False))
    coarse, fine = (fall(knees, 1.5, step=step) for step in (two_knees.STEP, 0.5 * two_knees.STEP))
    for name in ("height", "speed", "torque"):
        assert getattr(coarse, name) == pytest.approx(getattr(fine, name), rel=1e-3)


def test_torque_is_eq_14() -> None:
    """At the bound of z, the angle itself at -2 rad adds C times 1.5 rad to what the neutral one has."""
    law = BoucWenParams()
    raw, neutral = (two_knees.torque(1.0, -2.0, -3.0, -law.z_bound, raw=raw) for raw in (True, False))
    assert raw - neutral == pytest.approx(1.5 * law.C)
    weak = (law.K0 + law.K1) * law.z_bound / (1.0 + 3.0 * law.alpha)
    q_c = -2.0 - law.q_offset - law.q_center
    assert raw == pytest.approx(-law.D + 3.0 * law.B - law.C * q_c - law.I1 + weak)


@pytest.mark.parametrize(("raw", "drag"), [(False, True), (True, False)])
def test_damping_and_duration_give_the_row_of_0_A(raw: bool, drag: bool) -> None:
    """Both columns, to a percent; nothing above 0 A is looked at."""
    found, row = fall(two_knees.by_zero_row(raw=raw, drag=drag), 0.0), paper.TABLE_4["simulation"][0.0]
    assert found.height == pytest.approx(row["min_height"].mean, rel=0.01)
    assert found.speed == pytest.approx(-row["peak_down_velocity"].mean, rel=0.01)


def test_drag_that_is_absent_at_0_A_makes_the_first_step_the_largest() -> None:
    """Without it steps are even, as K1 I is, to a twentieth of all three; the paper's first is two thirds of them."""
    first = {}
    for drag in (True, False):
        changes = two_knees.changes(two_knees.by_zero_row(raw=True, drag=drag), paper_checks.CURRENTS)
        assert all(height > 0.0 > speed for height, speed, _ in changes)
        first[drag] = changes[0][0] / changes[2][0]
    assert first[True] == pytest.approx(1.0 / 3.0, abs=0.05) and first[False] > 0.6
