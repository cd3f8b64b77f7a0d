"""The actuator of mjlab, in mjlab's own environment: `make test-mjlab`; skipped elsewhere."""

import numpy as np
import pytest

pytest.importorskip("mjlab", reason="mjlab has an environment of its own: make test-mjlab")

import mujoco  # noqa: E402
import torch  # noqa: E402
from mjlab.entity import EntityArticulationInfoCfg, EntityCfg  # noqa: E402  # pyright: ignore[reportMissingImports]
from mjlab.scene import Scene, SceneCfg  # noqa: E402  # pyright: ignore[reportMissingImports]
from mjlab.sim.sim import MujocoCfg, Simulation, SimulationCfg  # noqa: E402  # pyright: ignore[reportMissingImports]

from mrwarp.enums import Coupling  # noqa: E402
from mrwarp.integrations.mjlab import MrJointActuator, MrJointActuatorCfg  # noqa: E402
from mrwarp.params import MrParams  # noqa: E402

ARM = """
<mujoco><compiler angle="radian"/><worldbody><body name="base"><geom size="0.02" mass="1" contype="0" conaffinity="0"/>
  <body name="arm"><joint name="elbow" axis="0 1 0"/>
    <inertial pos="0.2 0 0" mass="2" diaginertia="0.02 0.02 0.02"/></body></body></worldbody></mujoco>
"""
CURRENTS = (0.0, 0.5, 1.0, 1.5)


def arms(dt: float = 0.005, **cfg) -> tuple[Scene, Simulation, MrJointActuator]:  # noqa: ANN003
    """Four pendulums that begin level, their motors off unless an argument says otherwise."""
    motor = {"stiffness": 0.0, "damping": 0.0, "effort_limit": 30.0, **cfg}
    entity = EntityCfg(
        spec_fn=lambda: mujoco.MjSpec.from_string(ARM),
        articulation=EntityArticulationInfoCfg(actuators=(MrJointActuatorCfg(target_names_expr=("elbow",), **motor),)),
    )
    scene = Scene(SceneCfg(num_envs=4, entities={"robot": entity}), "cpu")
    sim = Simulation(num_envs=4, cfg=SimulationCfg(mujoco=MujocoCfg(timestep=dt)), model=scene.compile(), device="cpu")
    scene.initialize(sim.mj_model, sim.model, sim.data)
    (actuator,) = scene["robot"].actuators
    return scene, sim, actuator


def swing(scene: Scene, sim: Simulation, steps: int) -> torch.Tensor:
    """Angles [rad] after some steps."""
    for _ in range(steps):
        scene.write_data_to_sim()
        sim.step()
        scene.update(sim.mj_model.opt.timestep)
    return scene["robot"].data.joint_pos[:, 0].clone()


@pytest.mark.parametrize("coupling", list(Coupling))
def test_more_current_swings_less(coupling: Coupling) -> None:
    """Without current the arm falls in half a second; a torque damps it by the current, a brake of 0.5 A holds it."""
    scene, sim, actuator = arms(coupling=coupling)
    actuator.current[:] = torch.tensor(CURRENTS)[:, None]
    angles = swing(scene, sim, 100)
    assert float(angles[0]) > 1.0
    if coupling is Coupling.CONSTRAINT:
        assert float(angles[1:].abs().max()) < 1e-3
    else:
        assert bool((angles[:-1] > angles[1:]).all())


def test_a_brake_holds_what_it_can_and_yields_to_more() -> None:
    """3.92 N·m of weight rest on 1.5 A, whose yield torque is eq. 18's; the arm does not creep."""
    scene, sim, actuator = arms()
    actuator.current[:] = 1.5
    angles = swing(scene, sim, 200)
    assert float(angles.abs().max()) < 1e-3
    assert float(actuator.brake_bound[0, 0]) > 2.0 * 9.81 * 0.2
    actuator.current[:] = 0.0
    assert float(swing(scene, sim, 100).min()) > 0.5


def test_sliding_torque_grows_with_the_current_as_eq_14_says() -> None:
    """At constant speed 1 A adds K1*z/(1 + alpha*|qd|), with eq. 15's z = 1/(beta + gamma) within its bound."""
    p, dt, qd, torques = MrParams().bouc_wen, 0.005, 2.0, []
    for current in (0.0, 1.0):
        scene, _, actuator = arms(coupling=Coupling.EXPLICIT, current=current)
        cmd = actuator.get_command(scene["robot"].data)
        for k in range(200):
            cmd.pos[:], cmd.vel[:] = k * qd * dt, qd
            tau = actuator.compute(cmd).clone()
        assert tau.shape == (4, 1) and float(tau.std()) == 0.0
        torques.append(float(tau[0, 0]))
    z = min(1.0 / (p.beta + p.gamma), p.z_max)
    assert torques[1] - torques[0] == pytest.approx(-(p.K1 * z / (1.0 + p.alpha * qd) + p.I1), rel=1e-4)


def test_reset_forgets_in_the_named_environments_alone() -> None:
    """The coil's and the hysteresis' state of others stay as they were, to the bit."""
    scene, sim, actuator = arms(current=1.0)
    swing(scene, sim, 20)
    before = actuator._joints.state()
    actuator.reset(torch.tensor([1, 3]))
    after = actuator._joints.state()
    for name in ("z", "coil"):
        assert not after[name][[1, 3]].any()
        np.testing.assert_array_equal(after[name][[0, 2]], before[name][[0, 2]])


def test_the_motor_follows_its_command() -> None:
    """Kp, Kd and the limit are the configuration's: 10 N·m/rad on an error of 0.3 rad, and no more than 2 N·m."""
    scene, _, actuator = arms(stiffness=10.0, damping=1.0, effort_limit=2.0, coupling=Coupling.CONSTRAINT)
    cmd = actuator.get_command(scene["robot"].data)
    cmd.position_target[:], cmd.pos[:], cmd.vel[:] = torch.tensor([[0.1], [0.3], [-0.1], [0.0]]), 0.0, 0.0
    np.testing.assert_allclose(actuator.compute(cmd)[:, 0], [1.0, 2.0, -1.0, 0.0], atol=1e-6)
