"""The policy's observations: layout, derived quantities, only real sensors for the actor, and bounded noise."""

from dataclasses import replace

import numpy as np
import torch

from mrwarp.env import observations
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.mdp_cfg import NoiseCfg
from mrwarp.env.rng import SEED, STEP
from mrwarp.env.vec_env import WalkEnv

SLICES = {
    "gyro": slice(0, 3), "gravity": slice(3, 6), "command": slice(6, 9), "q": slice(9, 21), "qd": slice(21, 33),
    "action": slice(33, 45), "clock": slice(45, 47),
}  # fmt: skip
"""Where each term stands in the actor's observation."""

ROUNDING = (2.0 * np.pi + 2.0) * float(np.finfo(np.float32).eps)
"""Numbers of order one to two float32 roundings; the clock's angle, up to 2*pi, to half a one of pi and of itself."""


def make_env(noise: NoiseCfg | None = None, num_envs: int = 6, steps: int = 12) -> WalkEnv:
    """Environments in the middle of a movement."""
    env = WalkEnv(replace(TaskCfg(num_envs=num_envs, seed=2), noise=noise))
    generator = torch.Generator().manual_seed(0)
    for _ in range(steps):
        env.step(torch.rand(num_envs, 12, generator=generator) - 0.5)
    return env


def rotations(quat: torch.Tensor) -> np.ndarray:
    """Rotation matrices (body to world) of quaternions (w, x, y, z)."""
    w, x, y, z = quat.double().numpy().T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def test_actor_terms_add_up_to_47() -> None:
    """The table of terms, which policies carry as metadata, describes the layout."""
    assert sum(observations.actor_terms(12).values()) == 47
    widths = {name: part.stop - part.start for name, part in SLICES.items()}
    assert list(widths.items()) == list(observations.actor_terms(12).items())


def test_actor_layout_without_noise() -> None:
    """Each column is the quantity that the table names, in its unit and scale."""
    env = make_env()
    obs = env.get_observations()["actor"]
    assert obs.shape == (6, 47) and obs.dtype == torch.float32
    angle = 2 * np.pi * env.phase.double().numpy()
    expected = {
        "gyro": env.root_ang.numpy(),
        "gravity": -rotations(env.root_quat)[:, 2, :],
        "command": env.command.numpy(),
        "q": env.q.double().numpy() - np.tile([0.0, 0.8, -1.5], 4),
        "qd": 0.05 * env.qd.double().numpy(),
        "action": env.action.numpy(),
        "clock": np.stack([np.sin(angle), np.cos(angle)], axis=1),
    }
    for name, part in SLICES.items():
        np.testing.assert_allclose(obs[:, part].numpy(), expected[name], rtol=0, atol=ROUNDING, err_msg=name)


def test_gravity_and_heading_velocity_for_any_attitude() -> None:
    """Gravity is -z of the world in the trunk's axes; the velocity is turned by the yaw alone."""
    env = make_env(num_envs=32, steps=1)
    rng = np.random.default_rng(3)
    quat = rng.normal(size=(32, 4))
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    velocity = rng.normal(size=(32, 3))
    env.root_quat.copy_(torch.tensor(quat))
    env.root_vel.copy_(torch.tensor(velocity))
    env._update_derived()
    rotation = rotations(env.root_quat)
    np.testing.assert_allclose(env.gravity.numpy(), -rotation[:, 2, :], rtol=0, atol=ROUNDING)
    forward = rotation[:, :2, 0] / np.linalg.norm(rotation[:, :2, 0], axis=1, keepdims=True)
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    expected = np.stack([(velocity[:, :2] * forward).sum(1), (velocity[:, :2] * left).sum(1), velocity[:, 2]], axis=1)
    np.testing.assert_allclose(env.body_velocity.numpy(), expected, rtol=0, atol=1e-5)  # atan2 near steep pitch


def test_actor_sees_no_privileged_quantity() -> None:
    """Speed, height, contact forces, friction, mass, device, torques and currents change; the actor's bits do not."""
    env = make_env()
    actor, critic = env.get_observations()["actor"], env.get_observations()["critic"]
    env.root_vel.add_(1.3)
    env.root_pos.add_(0.2)
    env._update_derived()
    env.f_foot.mul_(2.0).add_(7.0)
    env.current_e.add_(0.4)
    env.privileged.add_(0.3)
    env.effort.add_(11.0)
    env.sim.set_friction(np.full(env.num_envs, 0.11))
    env.sim.rescale_mass("trunk", np.full(env.num_envs, 6.6))
    device = env.actuator
    for name in ("B", "K0", "K1", "T_max", "kp_base"):
        env.view(device.param(name)).mul_(1.7)
    for array in (device.kp, device.z, device.current, device.m_dyn, device.m_hold, device.tau_motor, device.tau_mr):
        env.view(array).add_(0.5)
    assert torch.equal(env.get_observations()["actor"], actor)
    changed = (env.get_observations()["critic"] != critic).all(0)
    # velocity 3, height 1, foot forces 4, current I_e 1, motor torques 12, friction and mass 2, gates 8, currents 4
    assert int(changed.sum()) == 35
    assert not bool(changed[:47].any())


def test_noise_is_bounded_by_the_cfg_and_fills_its_range() -> None:
    """Uniform noise: never beyond the half-width, nearly reaching it, without bias; none on command, action, clock."""
    noise = NoiseCfg(gyro=0.1, gravity=0.03, q=0.01, qd=0.5)
    env = make_env(noise)
    clean = env.get_observations()["critic"][:, :47]
    seen = []
    for _ in range(200):
        env.key[STEP] += 1  # the draws of another policy step
        seen.append(env.get_observations()["actor"])
    draws = torch.stack(seen).double() - clean.double()
    width = {"gyro": 0.1, "gravity": 0.03, "q": 0.01, "qd": 0.5 * observations.QD_SCALE}
    for name, half in width.items():
        error = draws[:, :, SLICES[name]]
        assert float(error.abs().max()) <= half + ROUNDING, name
        # 3600 or more draws: the largest misses the half-width by 1 % with a chance of 2e-16
        assert float(error.abs().max()) >= 0.99 * half, name
        # five standard deviations of the mean of n uniform draws
        assert abs(float(error.mean())) <= 5 * half / (3 * error.numel()) ** 0.5, name
    for name in ("command", "action", "clock"):
        assert float(draws[:, :, SLICES[name]].abs().max()) == 0.0, name


def test_noise_is_off_with_none() -> None:
    """Without noise the actor's observation depends on no draw, and is the critic's beginning."""
    env = make_env(noise=None)
    first = env.get_observations()["actor"]
    env.key[STEP] += 1
    assert torch.equal(first, env.get_observations()["actor"])
    assert torch.equal(first, env.get_observations()["critic"][:, :47])


def test_noise_belongs_to_the_policy_step() -> None:
    """Looking twice shows the same noise; the next step, another environment and another seed have their own."""
    env = make_env(NoiseCfg())
    first = env.get_observations()["actor"]
    assert torch.equal(first, env.last_observations["actor"])
    assert torch.equal(first, env.get_observations()["actor"])
    noise = first - env.get_observations()["critic"][:, :47]
    assert len(noise[:, 0].unique()) == len(noise)
    for entry in (STEP, SEED):
        env.key[entry] += 1
        other = env.get_observations()["actor"]
        assert bool((other[:, :6] != first[:, :6]).all())


def test_critic_layout() -> None:
    """After the 47 clean columns: velocity, height, foot forces, I_e, torques, friction and mass, gates, currents."""
    env = make_env()
    rest = env.get_observations()["critic"][:, 47:]
    device = env.actuator
    parts = [
        env.body_velocity, env.root_pos[:, 2:], 0.02 * env.f_foot, env.current_e[:, None],
        0.05 * env.view(device.tau_motor), env.privileged, env.view(device.m_dyn), env.view(device.m_hold),
        env.view(device.current),
    ]  # fmt: skip
    assert torch.equal(rest, torch.cat(parts, dim=1))
