"""Electrical model: closed forms of each part, linearity, refusals, cost of transport."""

import numpy as np
import pytest

from mrwarp.energy.power import (
    ElectricalCfg,
    JointLoad,
    battery_power,
    copper_factor,
    cost_of_transport,
    motor_heat,
)
from mrwarp.usd.robot import CALF_COLUMNS, CALVES, JOINTS


def a_use(
    *, square: float = 0.0, speed: float = 0.0, out: float = 0.0, back: float = 0.0, coil: float = 0.0, devices: int = 4
) -> JointLoad:
    """One value for every joint and device."""
    return JointLoad(
        torque_square=np.full(12, square),
        speed=np.full(12, speed),
        work_out=np.full(12, out),
        work_in=np.full(12, back),
        coil=np.full(devices, coil),
        friction=np.zeros(devices),
    )


def test_a_robot_at_rest_draws_electronics_and_idle_controllers() -> None:
    """No torque, no motion: electronics, and four controllers where there are devices."""
    cfg = ElectricalCfg(electronics=40.0, controller_idle=0.5)
    assert battery_power(a_use(devices=0), cfg).total == pytest.approx(40.0)
    assert battery_power(a_use(), cfg).total == pytest.approx(42.0)


def test_copper_loss_is_three_halves_r_i_squared() -> None:
    """One joint at 6 N·m with Kt = 0.6 N·m/A: 10 A peak, 1.5*0.2*100 = 30 W; a calf with gear 1.5 has 1/2.25 of it."""
    cfg = ElectricalCfg(electronics=0.0, winding_resistance=0.2, torque_constant=0.6, calf_gear=1.5)
    loss = copper_factor(cfg) * 36.0
    calves = [JOINTS.index(name) for name in CALVES]
    assert tuple(calves) == CALF_COLUMNS
    np.testing.assert_allclose(np.delete(loss, calves), 30.0)
    np.testing.assert_allclose(loss[calves], 30.0 / 2.25)


def test_warm_windings_lose_more() -> None:
    """100 K at 0.00393 1/K: 39.3 % more copper loss, and nothing else changes."""
    cfg = ElectricalCfg(copper_coefficient=0.00393)
    joints = a_use(square=4.0, out=1.0)
    cold, warm = battery_power(joints, cfg), battery_power(joints, cfg, 100.0)
    assert warm.copper == pytest.approx(1.393 * cold.copper)
    assert warm.total - cold.total == pytest.approx(0.393 * cold.copper)


def test_drive_friction_is_lost_by_turning_with_any_load() -> None:
    """12 joints at 2 rad/s and 0.5 N·m: 12 W, with torque or without; its heat adds to the motors' copper loss."""
    cfg = ElectricalCfg(electronics=0.0, controller_idle=0.0, drive_friction=0.5)
    for square in (0.0, 9.0):
        power = battery_power(a_use(square=square, speed=2.0), cfg)
        assert power.drive_friction == pytest.approx(12.0)
        assert power.total == pytest.approx(12.0 + power.copper)
    assert motor_heat(a_use(square=9.0, speed=2.0), cfg).sum() == pytest.approx(power.total)
    assert battery_power(a_use(square=9.0), cfg).drive_friction == 0.0


def test_gears_lose_both_ways() -> None:
    """12 joints that give 9 W and take back 10 W at eta 0.9: 120 W drawn, rho*108 W returned."""
    cfg = ElectricalCfg(electronics=0.0, controller_idle=0.0, gear_efficiency=0.9, regeneration=0.5)
    power = battery_power(a_use(out=9.0, back=10.0), cfg)
    assert power.mechanical == pytest.approx(120.0)
    assert power.regenerated == pytest.approx(-54.0)
    assert power.total == pytest.approx(66.0)


def test_what_a_joint_gives_and_takes_back_never_gains() -> None:
    """For any efficiency and share, a cycle that returns what it was given costs power."""
    for eta in (0.75, 0.9, 0.98):
        for rho in (0.0, 0.5, 1.0):
            cfg = ElectricalCfg(electronics=0.0, controller_idle=0.0, gear_efficiency=eta, regeneration=rho)
            assert battery_power(a_use(out=5.0, back=5.0), cfg).total > 0.0


def test_parts_add_up_and_leading_axes_stay() -> None:
    """The total is the sum of the parts for a batch of uses."""
    generator = np.random.default_rng(0)
    joints = JointLoad(
        **{
            name: generator.uniform(
                0.0, 10.0, (5, 12 if name in ("torque_square", "speed", "work_out", "work_in") else 4)
            )
            for name in ("torque_square", "speed", "work_out", "work_in", "coil", "friction")
        }
    )
    power = battery_power(joints, ElectricalCfg())
    assert power.total.shape == (5,)
    np.testing.assert_allclose(power.total, sum(power.parts().values()))
    np.testing.assert_allclose(battery_power(joints[2], ElectricalCfg()).total, power.total[2])


def test_only_resistance_over_constant_squared_acts() -> None:
    """Twice the torque constant with four times the resistance is the same robot."""
    one = ElectricalCfg(torque_constant=0.46, winding_resistance=0.1)
    other = ElectricalCfg(torque_constant=0.69, winding_resistance=0.225)
    np.testing.assert_allclose(copper_factor(one), copper_factor(other))


def test_cost_of_transport_is_eq_21() -> None:
    """P/(m g v): 117.72 W, 12 kg, 0.5 m/s gives 2; a robot that stands has no finite one to speak of."""
    assert cost_of_transport(117.72, 12.0, 0.5) == pytest.approx(2.0)
    assert cost_of_transport(100.0, 12.0, 0.0) > 1e6
