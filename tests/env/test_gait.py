"""The gait clock and the feet: diagonal trot, swing profile, and forward kinematics against MuJoCo."""

import math

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

from mrwarp.env import gait
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.sim import robot_scene
from mrwarp.env.sim_model import Scene
from mrwarp.env.vec_env import WalkEnv
from mrwarp.usd.robot import LEGS, TROT_PHASE

STEP_HEIGHT = 0.06

EPS = float(np.finfo(np.float32).eps)
ARC_TOLERANCE = (np.pi + 3.0) * EPS * STEP_HEIGHT
"""Half a rounding each of pi and of pi*s, up to pi; two of the sine, one of its product with the height [m]."""

FK_TOLERANCE = 1e-6
"""Lengths of 0.4 m in float32 (2.4e-8 m) after some twenty roundings, with margin [m]."""


@wp.kernel
def leg_phase_kernel(
    offsets: wp.array[float],
    clock_in: wp.array[float],
    legs_out: wp.array2d[float],
    stance_out: wp.array2d[wp.bool],
):
    """Phase of every leg, and whether the clock wants it on the ground."""
    i, leg = wp.tid()
    legs_out[i, leg] = gait.leg_phase(clock_in[i], offsets[leg])
    stance_out[i, leg] = gait.leg_phase(clock_in[i], offsets[leg]) < 0.5


@wp.kernel
def clearance_kernel(height: float, legs_in: wp.array2d[float], clearance_out: wp.array2d[float]):
    """Wanted clearance of every leg."""
    i, leg = wp.tid()
    clearance_out[i, leg] = gait.swing_clearance(legs_in[i, leg], height)


@wp.kernel
def foot_height_kernel(
    legs: gait.Legs,
    q_in: wp.array2d[float],
    root_z_in: wp.array[float],
    up_in: wp.array[wp.vec3],
    height_out: wp.array2d[float],
):
    """Height of every foot."""
    i, leg = wp.tid()
    height_out[i, leg] = gait.foot_height(legs, leg, q_in, i, root_z_in[i], up_in[i])


@wp.kernel
def foot_point_kernel(legs: gait.Legs, q_in: wp.array2d[float], point_out: wp.array2d[wp.vec3]):
    """Centre of every foot."""
    i, leg = wp.tid()
    point_out[i, leg] = gait.foot_point(legs, leg, q_in, i)


def leg_phases(clock: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Phase of every leg and wanted stance, shape (N, 4), of clock phases (N,)."""
    legs, stance = torch.full((len(clock), 4), torch.nan), torch.zeros(len(clock), 4, dtype=torch.bool)
    wp.launch(
        leg_phase_kernel,
        legs.shape,
        [wp.array(TROT_PHASE, dtype=float, device="cpu"), clock],
        [legs, stance],
        device="cpu",
    )
    return legs, stance


def clearances(legs: torch.Tensor) -> torch.Tensor:
    """Wanted clearance [m] of legs (N, 4)."""
    found = torch.full_like(legs, torch.nan)
    wp.launch(clearance_kernel, legs.shape, [STEP_HEIGHT, legs], [found], device="cpu")
    return found


def foot_heights(legs: gait.Legs, q: np.ndarray, root_z: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Height of every foot [m], shape (N, 4), of joints (N, 12), trunk heights (N,) and verticals (N, 3)."""
    found = wp.full((len(q), 4), float("nan"), dtype=float, device="cpu")
    inputs = [
        legs, wp.array(q, dtype=float, device="cpu"), wp.array(root_z, dtype=float, device="cpu"),
        wp.array(up, dtype=wp.vec3, device="cpu"),
    ]  # fmt: skip
    wp.launch(foot_height_kernel, found.shape, inputs, [found], device="cpu")
    return found.numpy()


@pytest.fixture(scope="module")
def scene() -> Scene:
    """The robot as MuJoCo sees it."""
    return robot_scene()


@pytest.fixture()
def clock() -> torch.Tensor:
    """A fine clock over one cycle, without the exact switching instants."""
    return (torch.arange(400) + 0.5) / 400


def test_leg_phase_is_a_diagonal_trot(clock: torch.Tensor) -> None:
    """FL goes with RR, FR with RL, and the pairs are half a cycle shifted."""
    legs, _ = leg_phases(clock)
    assert legs.shape == (400, 4) and float(legs.min()) >= 0.0 and float(legs.max()) < 1.0
    fl, fr, rl, rr = (legs[:, LEGS.index(leg)] for leg in ("FL", "FR", "RL", "RR"))
    assert torch.equal(fl, rr) and torch.equal(fr, rl) and torch.equal(fl, clock)
    half = torch.remainder(fl - fr, 1.0)
    torch.testing.assert_close(half, torch.full_like(half, 0.5), rtol=0.0, atol=1e-6)  # two float32 roundings near 1


def test_clock_wants_exactly_one_diagonal_pair_on_the_ground(clock: torch.Tensor) -> None:
    """At any instant two feet stand, a diagonal pair, and each foot stands half of the time."""
    _, stance = leg_phases(clock)
    assert stance.dtype == torch.bool
    assert bool((stance.sum(1) == 2).all())
    assert torch.equal(stance[:, 0], stance[:, 3]) and torch.equal(stance[:, 1], stance[:, 2])
    assert stance.sum(0).tolist() == [200] * 4


def test_swing_clearance_is_zero_in_stance_and_a_half_sine_in_swing(clock: torch.Tensor) -> None:
    """Exactly 0 on the ground; h*sin(pi*s) over the swing with its top at mid swing."""
    legs, stance = leg_phases(clock)
    clearance = clearances(legs)
    assert bool((clearance[stance] == 0.0).all())
    swing = 2.0 * legs[~stance].double().numpy() - 1.0
    expected = STEP_HEIGHT * np.sin(np.pi * swing)
    np.testing.assert_allclose(clearance[~stance].numpy(), expected, rtol=0.0, atol=ARC_TOLERANCE)
    top = clearances(torch.tensor([[0.75]]))
    assert float(top) == pytest.approx(STEP_HEIGHT, abs=ARC_TOLERANCE)


@pytest.mark.parametrize("planar", [1, 0])
def test_feet_are_where_mujocos_kinematics_puts_them(scene: Scene, planar: int) -> None:
    """Lowest point and place of each foot for random joints, trunk poses, any attitude, against ``mj_kinematics``.

    Both by the closed form and joint by joint.
    """
    legs = gait.legs_of(scene)
    assert legs.planar == 1
    legs.planar = planar
    model, data, rng = scene.model, mujoco.MjData(scene.model), np.random.default_rng(0)
    names = [model.geom(i).name for i in range(model.ngeom)]
    feet = [next(i for i, name in enumerate(names) if f"/{leg}_foot" in name) for leg in LEGS]
    count = 50
    q = np.stack([rng.uniform(model.jnt_range[1:, 0], model.jnt_range[1:, 1]) for _ in range(count)])
    quat = rng.normal(size=(count, 4))
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    root_z = rng.uniform(0.1, 0.6, size=count)
    expected, up, points = np.empty((count, 4)), np.empty((count, 3)), np.empty((count, 4, 3))
    for k in range(count):
        data.qpos[:3], data.qpos[3:7] = (0.3, -0.2, root_z[k]), quat[k]
        data.qpos[scene.q_adr] = q[k]
        mujoco.mj_kinematics(model, data)
        expected[k] = data.geom_xpos[feet, 2] - model.geom_size[feet, 0]
        up[k] = data.xmat[1].reshape(3, 3)[2]
        points[k] = (data.geom_xpos[feet] - data.xpos[1]) @ data.xmat[1].reshape(3, 3)
    found = foot_heights(legs, q, root_z, up)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=FK_TOLERANCE)
    centres = wp.full((count, 4), wp.vec3(float("nan")), dtype=wp.vec3, device="cpu")
    inputs = [legs, wp.array(q, dtype=float, device="cpu")]
    wp.launch(foot_point_kernel, centres.shape, inputs, [centres], device="cpu")
    np.testing.assert_allclose(centres.numpy(), points, rtol=0.0, atol=FK_TOLERANCE)


def test_env_clock_runs_at_the_gait_frequency() -> None:
    """1.5 Hz at 20 ms steps: 0.03 cycles per step, and after 2 s, three cycles, the clock is where it was."""
    env = WalkEnv(TaskCfg(num_envs=3, seed=1))
    start = env.phase.clone()
    env.step(torch.zeros(3, 12))
    first = torch.remainder(env.phase - start, 1.0)
    torch.testing.assert_close(first, torch.full_like(first, 0.03), rtol=0.0, atol=2e-7)  # float32 near 1
    for _ in range(99):
        env.step(torch.zeros(3, 12))
    assert bool((env.phase >= 0.0).all()) and bool((env.phase < 1.0).all())
    angle = 2.0 * math.pi * (env.phase - start)
    torch.testing.assert_close(torch.cos(angle), torch.ones(3), rtol=0.0, atol=1e-6)
    torch.testing.assert_close(
        torch.sin(angle), torch.zeros(3), rtol=0.0, atol=6e-5
    )  # 100 roundings of 6e-8, times 2pi
