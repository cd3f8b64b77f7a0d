"""The brake in plain MuJoCo: it holds, slips where it must, does no positive work, and falls as a free joint at 0 A."""

import mujoco
import numpy as np
import pytest

from mrwarp.mujoco import Brake
from mrwarp.params import MrParams

DT = 0.002
ARM = """<mujoco><option timestep="{dt}"/><worldbody><body>
<joint name="knee" axis="0 1 0"/><joint name="rail" type="slide" axis="0 1 0"/>
<geom type="box" size="0.01 0.01 0.01" pos="0.3 0 0" mass="{mass}"/></body></worldbody></mujoco>"""


def arm(mass: float = 1.0, dt: float = DT) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A mass on a level arm of 0.3 m."""
    model = mujoco.MjModel.from_xml_string(ARM.format(mass=mass, dt=dt))
    return model, mujoco.MjData(model)


def yield_torque(current: float) -> float:
    """Eq. 18 [N·m]."""
    hold = MrParams().hold
    return hold.T_max * current**hold.n / (hold.K**hold.n + current**hold.n)


@pytest.mark.parametrize(("share", "current"), [(0.3, 0.5), (0.9, 0.5), (0.3, 1.5)])
def test_a_held_joint_creeps_less_than_is_stated(share: float, current: float) -> None:
    """1e-5 rad/s per N·m; under 30 % of the largest bound of the paper's device less than 1e-4 rad/s."""
    mass = share * yield_torque(current) / (9.81 * 0.3)
    model, data = arm(mass)
    brake = Brake(model, data, "knee")
    for _ in range(500):
        brake.step(current)
        mujoco.mj_step(model, data)
    creep = abs(data.qvel[0])
    assert creep == pytest.approx(1e-5 * share * yield_torque(current), rel=0.05)
    assert brake.bound == pytest.approx(yield_torque(current), rel=1e-3)
    assert share > 0.3 or creep < 1e-4


def test_it_slips_above_its_yield_torque_and_takes_energy_only() -> None:
    """At 130 % the arm falls, slower than free, and the brake's work is never positive."""
    current = 0.3
    mass = 1.3 * yield_torque(current) / (9.81 * 0.3)
    angles = []
    for used in (current, None):
        model, data = arm(mass)
        brake = Brake(model, data, "knee") if used is not None else None
        for _ in range(150):
            if brake is not None:
                brake.step(used)
            before = data.qvel[0]
            mujoco.mj_step(model, data)
            if brake is not None and data.nefc:
                assert data.qfrc_constraint[0] * data.qvel[0] <= 1e-9 + 1e-6 * abs(before)
        angles.append(data.qpos[0])
    assert 0.05 < angles[0] < angles[1]


def test_a_device_without_current_has_its_drag_alone() -> None:
    """0 A: the arm swings through, and what it loses is the drag of eq. 14 at 0 A over its path, within 5 %."""
    params = MrParams().replace(C=0.0, K0=0.0, K1=0.0, I1=0.0, B=0.0, D=0.05)
    model, data = arm(dt=0.0005)
    brake = Brake(model, data, "knee", params)
    path = 0.0
    for _ in range(2000):
        brake.step(0.0)
        mujoco.mj_step(model, data)
        path += abs(data.qvel[0]) * 0.0005
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    lost = -float(np.sum(data.energy))
    assert path > 2.0
    assert lost == pytest.approx(0.05 * path, rel=0.05)


def test_a_joint_that_is_none_is_refused() -> None:
    """Unknown names list the model's; a slide is no hinge."""
    model, data = arm()
    with pytest.raises(ValueError, match="'elbow'.*choose from 'knee', 'rail'"):
        Brake(model, data, "elbow")
    with pytest.raises(ValueError, match="is no hinge"):
        Brake(model, data, "rail")


def test_a_current_that_is_none_is_refused_and_a_negative_one_holds() -> None:
    """NaN changes nothing in the model; the size of a negative current holds the arm."""
    model, data = arm()
    brake = Brake(model, data, "knee", "paper")
    for _ in range(200):
        brake.step(-1.0)
        mujoco.mj_step(model, data)
    assert abs(data.qvel[0]) < 1e-4
    before = model.dof_frictionloss[0]
    with pytest.raises(ValueError, match="current = nan is no finite number"):
        brake.step(float("nan"))
    data.qvel[0] = np.inf
    with pytest.raises(ValueError, match="velocity = inf is no finite number"):
        brake.step(1.0)
    assert model.dof_frictionloss[0] == before > 1.0
