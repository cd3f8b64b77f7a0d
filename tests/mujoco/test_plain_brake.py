"""The brake in plain MuJoCo: it holds, slips where it must, does no positive work, and falls as a free joint at 0 A."""

import mujoco
import numpy as np
import pytest

from mrwarp.actuator import brake_constraint
from mrwarp.model_file import FittedOn, Model, Parameter, make_effect
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
    for wrong in ("1", None, True, 1j, [1.0], np.ones(2)):
        with pytest.raises(TypeError, match="give one number"):
            brake.step(wrong)
    data.qvel[0] = np.inf
    with pytest.raises(ValueError, match="velocity = inf is no finite number"):
        brake.step(1.0)
    assert model.dof_frictionloss[0] == before > 1.0


LOADED = """<mujoco><compiler angle="radian"/><option timestep="{dt}"/><worldbody>
<geom type="plane" size="9 9 1" pos="0 0 -3"/>{arms}
<body name="free" pos="0 0 -2.95"><freejoint/><geom size="0.06" mass="1"/></body>
<body pos="0 3 0"><joint name="lead" axis="0 1 0"/><geom size="0.05" pos="0.1 0 0" mass="0.2"/></body>
<body pos="0 4 0"><joint name="follower" axis="0 1 0" damping="0.1"/><geom size="0.05" pos="0.1 0 0" mass="0.2"/></body>
</worldbody>
<tendon><fixed name="cord" limited="true" range="-0.1 0.1" frictionloss="0.05"><joint joint="lead" coef="1"/></fixed>
</tendon>
<equality><joint joint1="lead" joint2="follower"/></equality>
<actuator><motor joint="arm0" gear="40" ctrlrange="-1 1"/></actuator></mujoco>"""
HANGING = """<body pos="0 {y} 0"><joint name="arm{k}" axis="0 1 0" range="-1 1" limited="true"/>
<inertial pos="0.3 0 0" mass="{mass}" diaginertia="1e-3 1e-3 1e-3"/></body>"""
ROTOR = Model(
    parameters={
        name: Parameter(value=value, unit=MrParams.spec(name).unit) for name, value in MrParams() if name != "q_neutral"
    },
    fitted_on=FittedOn(source="test", trajectories=1, samples=50, rate=200.0),
    effects=(make_effect("rotor_inertia", {"inertia": 0.02}),),
)
"""The paper's device with a rotor that makes the constructor recompute what MuJoCo derived from the inertia."""


def loaded_arms(count: int, load: float = 7.0) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Level arms that bear a load [N·m], in a model with contacts, limits, an equality, a tendon and a geared motor."""
    arms = "".join(HANGING.format(k=k, y=0.2 * k, mass=load / (9.81 * 0.3)) for k in range(count))
    model = mujoco.MjModel.from_xml_string(LOADED.format(dt=DT, arms=arms))
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("device", [None, ROTOR], ids=["paper", "rotor"])
@pytest.mark.parametrize("count", [2, 4, 12])
def test_each_of_several_brakes_holds(count: int, device: Model | None) -> None:
    """One after another, the last after steps: each arm creeps by 1e-5 rad/s per N·m, and the pose stays."""
    model, data = loaded_arms(count)
    data.qpos[:count] = 0.05
    brakes = [Brake(model, data, f"arm{k}", device) for k in range(count - 1)]
    np.testing.assert_array_equal(data.qpos[:count], 0.05)
    last = None
    for k in range(300):
        if k == 100:
            data.qpos[count - 1], data.qvel[count - 1] = 0.05, 0.0
            last = Brake(model, data, f"arm{count - 1}", device)
            assert data.qpos[0] == pytest.approx(0.05, abs=1e-3)
        for brake in [*brakes, *([last] if last else [])]:
            brake.step(1.5)
        mujoco.mj_step(model, data)
    load = 7.0 * np.cos(0.05)
    np.testing.assert_allclose(np.abs(data.qvel[:count]), load * brake_constraint.CREEP, rtol=0.02)
    np.testing.assert_allclose([brake.torque for brake in brakes], -load, rtol=1e-3)


def test_constants_that_somebody_recomputes_or_sets_stay() -> None:
    """A later mj_setConst does not soften the brakes; the constructor changes what follows from the inertia alone."""
    model, data = loaded_arms(2)
    model.dof_invweight0[model.joint("lead").dofadr[0]] = 7.0  # somebody's own choice
    before = {name: getattr(model, name).copy() for name in ("dof_M0", "dof_invweight0", "body_invweight0")}
    brakes = [Brake(model, data, "arm0", ROTOR), Brake(model, data, "arm1", ROTOR)]
    own = [model.joint(f"arm{k}").dofadr[0] for k in range(2)]
    np.testing.assert_allclose(model.dof_M0[own], before["dof_M0"][own] + 0.02)
    np.testing.assert_array_equal(np.delete(model.dof_invweight0, own), np.delete(before["dof_invweight0"], own))
    assert model.dof_invweight0[model.joint("lead").dofadr[0]] == 7.0
    fresh, _ = loaded_arms(2)
    fresh.dof_armature[own] += 0.02
    mujoco.mj_setConst(fresh, mujoco.MjData(fresh))
    np.testing.assert_allclose(model.body_invweight0, fresh.body_invweight0, rtol=1e-12)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    for _ in range(100):
        for brake in brakes:
            brake.step(1.5)
        mujoco.mj_step(model, data)
    assert np.abs(data.qvel[own]).max() < 1e-4


def test_another_brake_at_a_joint_takes_the_place_of_the_first() -> None:
    """Friction and armature are those of the joint and one device; reset leaves the joint its own friction."""
    model, data = arm()
    model.dof_frictionloss[0] = 0.5
    Brake(model, data, "knee", ROTOR).step(1.5)
    second = Brake(model, data, "knee", ROTOR)
    second.step(1.5)
    assert model.dof_armature[0] == pytest.approx(0.02)
    assert model.dof_frictionloss[0] == pytest.approx(0.5 + second.bound)
    mujoco.mj_step(model, data)
    assert second.torque == pytest.approx(-9.81 * 0.3 * second.bound / (0.5 + second.bound), rel=1e-3)
    second.reset()
    assert model.dof_frictionloss[0] == 0.5 and second.bound == second.torque == 0.0
    model.opt.timestep = 2 * DT
    with pytest.raises(ValueError, match="timestep is 0.004 s, the brake was made for 0.002 s"):
        second.step(1.0)


def test_the_torque_is_what_the_solver_gave() -> None:
    """Sliding it is the bound against the velocity; the joint's equation of motion gives the same."""
    model, data = arm(mass=3.0)
    brake = Brake(model, data, "knee")
    inertia = 3.0 * 0.3**2
    for k in range(60):
        brake.step(0.1)
        before, angle = data.qvel[0], data.qpos[0]
        mujoco.mj_step(model, data)
        weight = 3.0 * 9.81 * 0.3 * np.cos(angle)
        wanted = inertia * (data.qvel[0] - before) / DT - weight
        assert brake.torque == pytest.approx(wanted, rel=1e-3, abs=1e-3 * weight)
        if k > 40:
            assert brake.torque == pytest.approx(-np.sign(data.qvel[0]) * brake.bound, rel=1e-6)
