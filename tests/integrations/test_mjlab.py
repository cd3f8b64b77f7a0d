"""The actuator of mjlab, in mjlab's own environment: `make test-mjlab`; skipped elsewhere."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mjlab", reason="mjlab has an environment of its own: make test-mjlab")

import mujoco  # noqa: E402
import torch  # noqa: E402

# pyright: reportMissingImports=false
from mjlab.entity import EntityArticulationInfoCfg, EntityCfg  # noqa: E402
from mjlab.envs import ManagerBasedRlEnv  # noqa: E402
from mjlab.managers.event_manager import RecomputeLevel  # noqa: E402
from mjlab.rl import RslRlVecEnvWrapper  # noqa: E402
from mjlab.scene import Scene, SceneCfg  # noqa: E402
from mjlab.sim.sim import MujocoCfg, Simulation, SimulationCfg  # noqa: E402
from mjlab.tasks.registry import list_tasks, load_env_cfg, load_rl_cfg, load_runner_cls  # noqa: E402

from mrwarp.actuator import brake_constraint  # noqa: E402
from mrwarp.enums import Coupling  # noqa: E402
from mrwarp.integrations.mjlab import MrJointActuator, MrJointActuatorCfg, brakes  # noqa: E402
from mrwarp.integrations.mjlab.joint_actuator import mr_actuators  # noqa: E402
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
    sim.expand_model_fields(brakes.model_fields)  # as an environment does for its startup event
    (actuator,) = scene["robot"].actuators
    actuator.prepare_brake()
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


@pytest.mark.parametrize("recomputed", [False, True])
def test_a_held_joint_creeps_less_than_a_ten_thousandth(recomputed: bool) -> None:
    """At 30 % of the largest bound of the paper's device, also after an event changed masses: 1e-5 rad/s per N·m."""
    scene, sim, actuator = arms(current=1.5)
    hold = MrParams().hold
    bound = hold.T_max * 1.5**hold.n / (hold.K**hold.n + 1.5**hold.n)
    if recomputed:
        sim.recompute_constants(RecomputeLevel.set_const)
    scene["robot"].set_joint_effort_target(torch.full((4, 1), 0.3 * bound - 2.0 * 9.81 * 0.2))
    swing(scene, sim, 60)
    assert float(actuator.brake_bound[0, 0]) == pytest.approx(bound, rel=1e-3)
    creep = scene["robot"].data.joint_vel.abs()
    np.testing.assert_allclose(creep, 0.3 * bound * 1e-5, rtol=0.03)
    assert float(creep.max()) < 1e-4


def test_a_brake_without_its_event_says_so() -> None:
    """Else all environments would share one bound."""
    scene, _, actuator = arms()
    actuator._own_friction = None
    with pytest.raises(RuntimeError, match="elbow need a startup event"):
        scene.write_data_to_sim()


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


def test_mjlabs_go1_trains_on_mr_calves(tmp_path: Path) -> None:
    """The task of the entry point: PPO updates change the policy, gates and brakes work in each environment.

    Its startup event ``base_com`` changes masses, after which mjlab derives the friction's regularisation again.
    """
    name = "Mrwarp-Velocity-Flat-MR-Go1"
    assert name in list_tasks()
    cfg, ppo = load_env_cfg(name), load_rl_cfg(name)
    cfg.scene.num_envs, cfg.seed = 4, 1
    ppo.num_steps_per_env, ppo.logger = 12, "tensorboard"
    env = ManagerBasedRlEnv(cfg, device="cpu")
    (calves,) = mr_actuators(env)
    seen = []
    env.recorder_manager.record_post_step = lambda: seen.append((calves.foot_load.clone(), calves.brake_bound.clone()))
    runner = load_runner_cls(name)(RslRlVecEnvWrapper(env), asdict(ppo), str(tmp_path), "cpu")
    before = torch.cat([x.flatten() for x in runner.alg.get_policy().parameters()]).clone()
    runner.learn(num_learning_iterations=2)
    after = torch.cat([x.flatten() for x in runner.alg.get_policy().parameters()])
    assert bool(after.isfinite().all()) and not torch.equal(before, after)
    load, bound = (torch.stack(x) for x in zip(*seen, strict=True))
    assert len(load) == 24 and bool((load > 5.0).any()) and bool((load == 0.0).any())
    assert 1.0 < float(bound.max()) < 30.0 and float(bound.std(dim=1).max()) > 0.1
    dofs = calves._dofs
    torch.testing.assert_close(
        calves._field("dof_invweight0")[:, dofs], torch.full((4, 4), brake_constraint.invweight(0.005))
    )
    assert env.sim.wp_model.opt.ls_iterations == 30  # mjlab's 20 let a held joint drift
    env.close()
