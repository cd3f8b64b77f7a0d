"""Terrain: the field's shape, its height under a point, the curriculum, and robots that stand on it."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

from mrwarp.env.backend import BackendKind
from mrwarp.env.cfg import TaskCfg, make_play_cfg
from mrwarp.env.config.mdp_cfg import TerrainCfg
from mrwarp.env.sim import robot_scene
from mrwarp.env.terminations import DONE, TIME_OUT
from mrwarp.env.terrain import KINDS, Terrain, ground_height, make_field
from mrwarp.env.vec_env import WalkEnv
from mrwarp.usd.robot import STAND_HEIGHT


@pytest.fixture
def terrain() -> Terrain:
    """Twelve environments on the default field."""
    return Terrain(TerrainCfg(), 12, seed=0)


@wp.kernel
def height_kernel(heights: wp.array2d[float], cell: float, points_in: wp.array2d[float], height_out: wp.array[float]):
    """Height of the ground at each point."""
    i = wp.tid()
    height_out[i] = ground_height(heights, cell, points_in[i, 0], points_in[i, 1])


def heights(terrain: Terrain, points: np.ndarray) -> np.ndarray:
    """Height of the ground [m], shape (N,), at points (N, 2)."""
    found = wp.full(len(points), float("nan"), dtype=float, device="cpu")
    field, at = (wp.array(a, dtype=float, device="cpu") for a in (terrain.field.heights, points))
    wp.launch(height_kernel, len(points), [field, terrain.field.cell, at], [found], device="cpu")
    return found.numpy()


def rough_cfg(num_envs: int, **changes: object) -> TaskCfg:
    """The training task on the field, with changes."""
    return replace(TaskCfg(num_envs=num_envs, terrain="rough", seed=3), **changes)


def test_field_is_flat_at_level_zero_and_at_every_edge_and_as_steep_as_configured() -> None:
    """Level 0 and the tiles' borders are at 0; the last level has the slope, the steps and the roughness asked for."""
    cfg = TerrainCfg()
    field = make_field(cfg)
    size, border = round(cfg.tile / cfg.cell), round(cfg.border / cfg.cell)
    inner = field.heights[border:-border, border:-border]
    assert not field.heights[:border].any() and not field.heights[:, :border].any()
    assert not inner[::size].any() and not inner[:, ::size].any()
    assert not inner[:, : size + 1].any()
    last = {kind: inner[k * size : (k + 1) * size + 1, -size - 1 :] for k, kind in enumerate(KINDS)}
    inside = 0.5 * cfg.tile - cfg.platform
    assert last["slope_down"].max() == pytest.approx(cfg.slope * inside, rel=1e-6)
    assert last["slope_up"].min() == pytest.approx(-cfg.slope * inside, rel=1e-6)
    rise = np.diff(last["step_up"], axis=1)
    assert np.unique(np.abs(rise).round(6)).tolist() == pytest.approx([0.0, cfg.step])
    assert 0.9 * cfg.roughness < np.abs(last["rough"]).max() <= cfg.roughness


def test_height_is_that_of_the_surface_that_mujoco_collides_with(terrain: Terrain) -> None:
    """At 500 random points, against a ray from above, on all kinds of tiles; float32 of heights up to 0.6 m."""
    model = robot_scene(ground=terrain.field).model
    data = mujoco.MjData(model)
    data.qpos[2] = 50.0
    mujoco.mj_forward(model, data)
    points = np.random.default_rng(0).uniform(-1.0, 1.0, size=(500, 2)) * np.array(terrain.field.half)
    geom, down = np.zeros(1, np.int32), np.array([0.0, 0.0, -1.0])
    expected = [5.0 - mujoco.mj_ray(model, data, np.array([x, y, 5.0]), down, None, 1, -1, geom) for x, y in points]
    np.testing.assert_allclose(heights(terrain, points), expected, rtol=0.0, atol=1e-5)
    assert np.ptp(expected) > 0.5  # the points saw hills and pits


def test_height_beyond_the_field_and_for_nan_is_a_number(terrain: Terrain) -> None:
    """A robot that is lost gets the edge's height; one without a position must not stop the batch."""
    far = np.array([1e6, -1e6, np.nan, np.inf])
    assert np.isfinite(heights(terrain, np.stack([far, far[::-1]], axis=1))).all()
    assert heights(terrain, np.stack([far[:2], far[:2]], axis=1)).tolist() == [0.0, 0.0]


def end_episodes(terrain: Terrain, s: Any, done: torch.Tensor, time_outs: torch.Tensor) -> None:
    """A policy step at rest, without a command, after which the episodes of a mask end."""
    s.flags[DONE], s.flags[TIME_OUT] = done, time_outs
    terrain.curriculum(s, 0.02)()


def walkers(count: int) -> Any:
    """The arrays that the curriculum reads and writes: robots at rest, without a command."""
    still, way = torch.zeros(2, count, 3), torch.zeros(2, count)
    return SimpleNamespace(
        key=torch.zeros(2, dtype=torch.int64),
        body_velocity=still[0],
        command=still[1],
        flags=torch.zeros(4, count, dtype=torch.bool),
        level=torch.zeros(count, dtype=torch.int64),
        walked=way[0],
        commanded=way[1],
    )


def test_curriculum_moves_those_that_are_reset_by_how_far_they_walked(terrain: Terrain) -> None:
    """Up after 0.9 of the way, stay at 0.7, down at 0.3 and after a fall, never below 0; others stay where they are."""
    s = walkers(12)
    s.level.fill_(2)
    s.level[5] = 0
    s.commanded.fill_(8.0)
    s.walked.copy_(8.0 * torch.tensor([0.9, 0.7, 0.3, 0.9, 0.9, 0.3] + [0.9] * 6))
    mask = torch.tensor([True] * 4 + [False] + [True] + [False] * 6)
    end_episodes(terrain, s, mask, mask & (torch.arange(12) != 3))
    assert s.level[:6].tolist() == [3, 2, 1, 1, 2, 0]


def test_a_robot_begins_in_the_middle_of_its_tile() -> None:
    """Where each level and kind has its middle, 0.01 m over the stance on the highest ground there."""
    env = WalkEnv(make_play_cfg(rough_cfg(36)))
    assert env.terrain is not None
    middle = env.terrain.field.origins[env.arrays.level.numpy(), env.arrays.kind.numpy()]
    expected = middle + np.array([0.0, 0.0, STAND_HEIGHT + 0.01], dtype=np.float32)
    np.testing.assert_allclose(env.root_pos.numpy(), expected, rtol=1e-6)
    assert np.ptp(middle[:, 2]) > 0.1


def test_curriculum_counts_the_path_of_every_step(terrain: Terrain) -> None:
    """Speed and its command times the step, for all, whether their episodes end or not."""
    speed, command = (torch.rand(12, 3, generator=torch.Generator().manual_seed(k)) for k in (0, 1))
    s = walkers(12)
    s.body_velocity.copy_(speed)
    s.command.copy_(command)
    curriculum = terrain.curriculum(s, 0.02)
    for _ in range(3):
        curriculum()
    torch.testing.assert_close(s.walked, 0.06 * speed[:, 0])
    torch.testing.assert_close(s.commanded, 0.06 * command[:, 0])


def test_curriculum_sends_those_that_passed_the_last_level_to_any() -> None:
    """Levels of 600 robots that pass the last one are drawn from all of them equally, and none is beyond."""
    terrain, s = Terrain(TerrainCfg(), 600, seed=0), walkers(600)
    s.level.fill_(terrain.cfg.levels - 1)
    s.commanded.fill_(1.0)
    s.walked.fill_(1.0)
    everyone = torch.ones(600, dtype=torch.bool)
    end_episodes(terrain, s, everyone, everyone)
    counts = torch.bincount(s.level)
    # 100 each, within five standard deviations of 9.1
    assert len(counts) == terrain.cfg.levels and bool((abs(counts - 100) < 46).all())


def test_play_task_spreads_over_all_levels_and_kinds_and_stays_there() -> None:
    """Without the curriculum 36 environments stand on 36 tiles, and episodes end without moving them."""
    cfg = make_play_cfg(rough_cfg(36, episode_seconds=0.1))
    env = WalkEnv(cfg)
    assert env.terrain is not None
    tiles = set(zip(env.arrays.level.tolist(), env.arrays.kind.tolist(), strict=True))
    assert len(tiles) == 36
    before = env.arrays.level.clone()
    for _ in range(6):
        env.step(torch.zeros(36, 12))
    assert torch.equal(env.arrays.level, before)


def test_robots_stand_on_every_tile() -> None:
    """After 0.6 s at zero action: no fall, feet that carry load within 12 mm of the ground, trunks about 0.3 m over it.

    12 mm: a sphere of 23 mm rests next to, not on, the point right below its centre where the ground is steep.
    """
    env = WalkEnv(make_play_cfg(rough_cfg(36)))
    assert env.terrain is not None
    for _ in range(30):
        env.step(torch.zeros(36, 12))
        assert not bool(env.fallen.any())
    model, batch = env.sim.scene.model, env.sim.backend.field("qpos").numpy()
    feet = [i for i in range(model.ngeom) if "_foot" in model.geom(i).name]
    lowest, data = np.empty((36, 4)), mujoco.MjData(model)
    for k in range(36):
        data.qpos[:] = batch[k]
        mujoco.mj_kinematics(model, data)
        lowest[k] = data.geom_xpos[feet, 2] - model.geom_size[feet, 0]
    clearance = torch.from_numpy(lowest) - env.arrays.foot_ground
    loaded = env.f_foot > env.contact_force
    assert float(loaded.float().mean()) > 0.7
    assert float(clearance[loaded].abs().max()) < 0.012
    assert bool(((env.height - STAND_HEIGHT).abs() < 0.08).all())
    assert int(env.sim.unsolved.numpy().sum()) <= 0.005 * 30 * 4 * 36


@pytest.mark.slow
def test_both_engines_let_a_robot_stand_on_steps() -> None:
    """Half a second at zero action on the hardest tiles: trunk heights of the engines agree within 5 mm.

    Contacts are chaotic, so no rounding bounds them: MuJoCo's soft contact lets a foot in by some millimetres
    (solimp's width is 1 mm, a foot bears 30 N), and the engines may rest a foot on either side of an edge by as much.
    """
    heights = []
    for backend in (BackendKind.MJBATCH, BackendKind.MJWARP):
        cfg = make_play_cfg(TaskCfg(num_envs=6, terrain="rough", backend=backend))
        env = WalkEnv(replace(cfg, terrain=TerrainCfg(levels=2, curriculum=False)))
        for _ in range(25):
            env.step(torch.zeros(6, 12))
        assert not bool(env.fallen.any())
        assert env.nan_guard.warnings().overflow == 0
        heights.append(env.height.clone())
    torch.testing.assert_close(heights[0], heights[1], rtol=0.0, atol=5e-3)
