"""Domain randomisation: ranges, masks, and that each draw reaches the physics or the actuator it is meant for."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mrwarp.actuator import brake_constraint
from mrwarp.enums import Coupling
from mrwarp.env import events
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.mdp_cfg import RandomizeCfg
from mrwarp.env.rng import STEP
from mrwarp.env.vec_env import WalkEnv
from mrwarp.kernels.mr_joint import FIELDS
from mrwarp.usd.robot import CALVES, JOINTS

NUM_ENVS = 64
CALF = [JOINTS.index(name) for name in CALVES]
PLAIN = [i for i in range(len(JOINTS)) if i not in CALF]

FLOAT32 = 4.0 * float(np.finfo(np.float32).eps)
"""Relative error of a product or sum of up to four float32 numbers: half a rounding of each, of each operation."""


def make_env(cfg: RandomizeCfg | None, num_envs: int = NUM_ENVS, coupling: Coupling = Coupling.CONSTRAINT) -> WalkEnv:
    """Environments without observation noise and pushes, unless ``cfg`` says so."""
    return WalkEnv(replace(TaskCfg(num_envs=num_envs, seed=4, coupling=coupling), noise=None, randomize=cfg))


def push(env: WalkEnv) -> None:
    """Kick the trunks as a policy step does."""
    for launch in env._push:
        launch()


@pytest.fixture(scope="module")
def drawn() -> WalkEnv:
    """Randomised environments; tests only read them."""
    return make_env(RandomizeCfg(push_speed=0.0))


@pytest.fixture(scope="module")
def nominal() -> WalkEnv:
    """Environments of the nominal robot; tests only read them."""
    return make_env(None, num_envs=2)


def model_field(env: WalkEnv, name: str) -> np.ndarray:
    """Values of a model field per environment, as the engine steps them."""
    return env.sim.backend.expand(name).numpy()


def assert_fills(values: np.ndarray, low: float, high: float) -> None:
    """All values lie in the range, and 64 or more draws reach into its outer tenths (missed with 1e-3 at most)."""
    slack = FLOAT32 * max(abs(low), abs(high))
    assert values.min() >= low - slack and values.max() <= high + slack
    assert values.min() < low + 0.1 * (high - low) and values.max() > high - 0.1 * (high - low)


def test_friction_reaches_every_geom(drawn: WalkEnv, nominal: WalkEnv) -> None:
    """Sliding friction of ground, feet and links is the draw, one per environment; torsion and rolling stay."""
    friction = model_field(drawn, "geom_friction")
    assert_fills(friction[:, 0, 0], 0.5, 1.1)
    assert (friction[..., 0] == friction[:, :1, 0]).all()
    np.testing.assert_array_equal(friction[..., 1:], drawn.sim.scene.model.geom_friction[None, :, 1:].repeat(64, 0))
    np.testing.assert_array_equal(friction[:, 0, 0].astype(np.float32), drawn.privileged[:, 0].numpy())
    np.testing.assert_array_equal(model_field(nominal, "geom_friction")[0], nominal.sim.scene.model.geom_friction)


def test_trunk_mass_reaches_the_model(drawn: WalkEnv) -> None:
    """Trunk and total mass grow by the draw, the trunk's inertia in proportion; other bodies stay."""
    model = drawn.sim.scene.model
    added = drawn.privileged[:, 1].double().numpy()
    assert_fills(added, -0.5, 1.0)
    mass, inertia = model_field(drawn, "body_mass"), model_field(drawn, "body_inertia")
    np.testing.assert_allclose(mass.sum(1), model.body_mass.sum() + added, rtol=FLOAT32)
    np.testing.assert_allclose(mass[:, 1], model.body_mass[1] + added, rtol=FLOAT32)
    np.testing.assert_array_equal(mass[:, 2:], np.tile(model.body_mass[2:], (NUM_ENVS, 1)))
    ratio = mass[:, 1] / model.body_mass[1]
    np.testing.assert_allclose(inertia[:, 1], model.body_inertia[1] * ratio[:, None], rtol=FLOAT32)
    np.testing.assert_array_equal(inertia[:, 2:], np.tile(model.body_inertia[2:], (NUM_ENVS, 1, 1)))


def test_trunk_mass_is_what_the_feet_carry() -> None:
    """Standing robots press on the ground with their own weight: the engine steps the mass that was drawn."""
    env = make_env(RandomizeCfg(friction=(1.0, 1.0), added_mass=(-0.5, 3.0), gain_scale=(1.0, 1.0), push_speed=0.0), 8)
    for _ in range(150):
        env.step(torch.zeros(8, 12))
    weight = 9.81 * (env.sim.scene.model.body_mass.sum() + env.privileged[:, 1].double().numpy())
    load = env.f_foot.sum(1).double().numpy()
    # norms of the foot forces: up to 5 % more than their vertical parts, as the stance spreads the feet a little
    assert ((load > 0.995 * weight) & (load < 1.05 * weight)).all(), load / weight
    assert np.corrcoef(load, weight)[0, 1] > 0.99


@pytest.mark.parametrize("coupling", list(Coupling))
def test_mass_leaves_the_brakes_creep_alone(coupling: Coupling) -> None:
    """MuJoCo's constants follow the mass, but a brake's regularisation stays that of ``brake_constraint``."""
    env = make_env(RandomizeCfg(push_speed=0.0), 8, coupling)
    model, dofs = env.sim.scene.model, env.sim.scene.v_adr
    invweight = model_field(env, "dof_invweight0")
    wanted = {
        Coupling.CONSTRAINT: np.full((8, 4), brake_constraint.invweight(env.sim.dt)),
        Coupling.EXPLICIT: np.tile(model.dof_invweight0[dofs[CALF]], (8, 1)),
    }[coupling]
    # without a brake the constant depends weakly on the trunk: 20 % more trunk mass is far less than 5 % at the calf
    tolerance = {Coupling.CONSTRAINT: 1e-12, Coupling.EXPLICIT: 0.05}[coupling]
    np.testing.assert_allclose(invweight[:, dofs[CALF]], wanted, rtol=tolerance)
    # what follows from the trunk's mass has been recomputed: a heavier trunk, a smaller inverse weight
    assert np.corrcoef(invweight[:, 0], env.privileged[:, 1].numpy())[0, 1] < -0.9


def test_gains_scale_alike_for_plain_and_mr_joints(drawn: WalkEnv, nominal: WalkEnv) -> None:
    """kp by one factor and kd by another per joint; on MR joints the device's gains follow the same factor."""
    ours, theirs = drawn.actuator, nominal.actuator
    kp = ours.kp.numpy() / theirs.kp.numpy()[:1]
    kd = ours.kd.numpy() / theirs.kd.numpy()[:1]
    assert_fills(kp, 0.9, 1.1)
    assert_fills(kd, 0.9, 1.1)
    assert abs(np.corrcoef(kp.ravel(), kd.ravel())[0, 1]) < 0.15  # four standard deviations of 768 independent pairs
    for name, scale in (("kp_base", kp), ("kp_low", kp), ("kd", kd)):
        ratio = ours.param(name).numpy() / theirs.param(name).numpy()[:1]
        np.testing.assert_allclose(ratio, scale[:, CALF], rtol=FLOAT32, err_msg=name)
    np.testing.assert_array_equal(ours.tau_limit.numpy(), np.tile(theirs.tau_limit.numpy()[:1], (NUM_ENVS, 1)))


def test_gains_reach_the_motor_torque() -> None:
    """At rest the motor torque is kp*(q_des - q) with the drawn gain, on plain and on MR joints (gates closed)."""
    env = make_env(RandomizeCfg(push_speed=0.0), 8)
    env.qd.zero_()
    env.f_foot.zero_()  # no foot on the ground: the holding gate stays closed, kp is the full one
    env.q.copy_(env.default_q)
    env.q_des.copy_(env.default_q + 0.05)
    env.actuator.step()
    kp = env.view(env.actuator.kp).clone()
    kp[:, CALF] = env.view(env.actuator.param("kp_base"))
    error = env.q_des - env.q
    # the difference of angles of order one is known to 1e-7 rad, of 0.05 rad
    torch.testing.assert_close(env.view(env.actuator.tau_motor), kp * error, rtol=1e-5, atol=0.0)


def test_device_parameters_are_drawn_in_their_range(drawn: WalkEnv, nominal: WalkEnv) -> None:
    """B, K0, K1 and T_max vary per environment and joint around the nominal value; the rest does not vary."""
    for name in events.SCALED:
        ratio = drawn.actuator.param(name).numpy() / nominal.actuator.param(name).numpy()[:1]
        assert_fills(ratio, 0.8, 1.2)
        assert len(np.unique(ratio)) > 250, name  # 256 draws
    scaled = {*events.SCALED, "kp_base", "kp_low", "kd"}
    for name in set(FIELDS) - scaled:
        values = drawn.actuator.param(name).numpy()
        assert (values == values[0]).all(), name


def test_a_reset_redraws_only_masked_devices() -> None:
    """Masked environments get another device, the others keep every bit of theirs."""
    env = make_env(RandomizeCfg(push_speed=0.0), 6)
    before = env.actuator.state()["params"]
    mask = torch.tensor([False, True, False, False, True, False])
    env.key[STEP] += 1  # as after a step: in the same one the same devices would be drawn again
    env._reset(mask)
    after = env.actuator.state()["params"]
    np.testing.assert_array_equal(after[~mask.numpy()], before[~mask.numpy()])
    columns = [FIELDS.index(name) for name in events.SCALED]
    assert (after[mask.numpy()][..., columns] != before[mask.numpy()][..., columns]).all()
    others = [i for i in range(len(FIELDS)) if i not in columns]
    np.testing.assert_array_equal(after[..., others], before[..., others])


def test_resets_do_not_compound(nominal: WalkEnv) -> None:
    """A hundred resets later the factors are still those of the nominal device."""
    env = make_env(RandomizeCfg(push_speed=0.0), 8)
    everyone = torch.ones(8, dtype=torch.bool)
    for _ in range(100):
        env.key[STEP] += 1
        env._reset(everyone)
    for name in events.SCALED:
        ratio = env.actuator.param(name).numpy() / nominal.actuator.param(name).numpy()[:1]
        assert ratio.min() >= 0.8 * (1 - FLOAT32) and ratio.max() <= 1.2 * (1 + FLOAT32), name


def test_push_kicks_only_the_horizontal_speed() -> None:
    """Kicks change the trunk's horizontal velocity, by no more than the cfg says, and nothing else."""
    env = make_env(RandomizeCfg(push_speed=0.3, push_interval=0.02), 256)  # one kick per step on average: always
    before = {name: env.view(env.sim.backend.field(name)).clone() for name in ("qpos", "qvel", "qfrc_applied")}
    push(env)
    kick = env.qvel - before["qvel"]
    assert float(kick[:, :2].abs().max()) <= 0.3 + 1e-7
    assert bool((kick[:, :2] != 0.0).all())
    assert_fills(kick[:, :2].numpy(), -0.3, 0.3)
    assert torch.equal(kick[:, 2:], torch.zeros_like(kick[:, 2:]))
    for name in ("qpos", "qfrc_applied"):
        assert torch.equal(env.view(env.sim.backend.field(name)), before[name])


def test_push_rate_is_that_of_the_interval() -> None:
    """A mean time of 6 s between kicks: 1/300 per step of 20 ms; 76,800 draws know it to 6 %."""
    env = make_env(RandomizeCfg(push_speed=0.3, push_interval=6.0), 256)
    steps, kicks = 300, 0
    for _ in range(steps):
        env.qvel[:, :2] = 0.0
        env.key[STEP] += 1
        push(env)
        kicks += int((env.qvel[:, 0] != 0.0).sum())
    expected = steps * 256 * 0.02 / 6.0
    assert abs(kicks - expected) <= 4 * expected**0.5


@pytest.mark.parametrize("cfg", [None, RandomizeCfg(push_speed=0.0)])
def test_push_can_be_switched_off(cfg: RandomizeCfg | None) -> None:
    """Without randomisation, or with a kick of 0 m/s, nothing moves."""
    env = make_env(cfg, 4)
    velocity = env.qvel.clone()
    for _ in range(20):
        env.key[STEP] += 1
        push(env)
    assert torch.equal(env.qvel, velocity)


def test_nominal_robot_without_randomisation(nominal: WalkEnv) -> None:
    """None leaves every environment the asset's robot, and says so to the critic."""
    assert not nominal.privileged.any()
    params = nominal.actuator.state()["params"]
    np.testing.assert_array_equal(params[1], params[0])
    for slot, joint in enumerate(CALF):
        mr = nominal.sim.scene.actuators[joint].mr
        assert mr is not None
        wanted = np.array([dict(mr)[name] for name in FIELDS], dtype=np.float32)
        np.testing.assert_array_equal(params[0, slot], wanted)
    np.testing.assert_array_equal(model_field(nominal, "body_mass")[1], nominal.sim.scene.model.body_mass)


def test_robot_without_devices_is_randomised_too() -> None:
    """Gains, mass and friction of a robot with plain motors vary; there is no device to vary."""
    cfg = replace(TaskCfg(num_envs=8, actuator="none"), randomize=RandomizeCfg())
    env = WalkEnv(cfg)
    assert env.actuator.mr_joints == ()
    assert len(np.unique(env.actuator.kp.numpy()[:, PLAIN[0]])) == 8
    env._reset(torch.ones(8, dtype=torch.bool))
    env.step(torch.zeros(8, 12))
    assert bool(torch.isfinite(env.q).all())
