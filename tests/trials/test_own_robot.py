"""Energy of a robot of one's own: Go1's model in the robot's units, and what the currents change."""

import numpy as np
import pytest

from mrwarp.energy.power import GO1_LIMIT, ElectricalCfg, JointLoad, battery_power
from mrwarp.env.natural_units import Scales
from mrwarp.trials import own_robot


def load(torque: float, speed: float, work: float, joints: int = 3) -> JointLoad:
    """Identical joints, one device."""
    return JointLoad(
        torque_square=np.full(joints, torque**2),
        speed=np.full(joints, speed),
        work_out=np.full(joints, work),
        work_in=np.full(joints, 0.3 * work),
        coil=np.full(1, 0.1 * work),
        friction=np.zeros(1),
    )


def test_a_robot_as_go1_but_larger_uses_power_in_proportion() -> None:
    """Eight times the mass and twice the length: torques x 16, times x root 2, powers x 16/root 2; limits too."""
    by, cfg = Scales(length=2.0, mass=8.0), ElectricalCfg(calf_gear=1.0)
    power = 16.0 / np.sqrt(2.0)
    assert by.power == pytest.approx(power)
    small = battery_power(load(5.0, 2.0, 4.0), cfg).total
    large = load(16.0 * 5.0, 2.0 / np.sqrt(2.0), power * 4.0)
    own = battery_power(own_robot.as_go1(large, np.full(3, 16.0 * GO1_LIMIT), by), cfg).total
    assert own == pytest.approx(small)


def test_a_motor_at_its_limit_loses_what_go1s_does_at_its_own() -> None:
    """Go1's own calf: 1.5 times the limit by a gear of 1.5, as the calibrated model has it."""
    cfg, limits = ElectricalCfg(), np.array([23.7, 23.7, 35.55] * 4)
    joints = load(7.0, 1.0, 0.0, joints=12)
    own = battery_power(own_robot.as_go1(joints, limits, Scales()), ElectricalCfg(calf_gear=1.0)).copper
    assert own == pytest.approx(float(battery_power(joints, cfg).copper))


def test_what_a_current_changes_stands_beside_none() -> None:
    """Relative change at the same load and command; nothing where nobody arrived."""
    rows = [
        {"payload": 0.0, "command": 0.5, "current": current, "cot": {"mean": cot, "sd": 0.0}, "trials": trials}
        for current, cot, trials in ((0.0, 0.5, 3), (1.0, 0.45, 3), (1.5, 0.0, 0))
    ]
    (change,) = own_robot.savings(rows)
    assert change["current"] == 1.0 and change["cot_change"] == pytest.approx(-0.1)
    assert own_robot.figures(rows[:2])["cot_change"] == pytest.approx(-0.1)
    assert own_robot.figures(rows)["cot_on"] is None
