"""Terrain: one height field of tiles that get harder by level, and the curriculum that moves environments over it.

The layout is public quadruped practice (legged_gym): tiles are ordered by level of difficulty and by kind, and all
environments share the one field. Level 0 is flat. Kinds are rough ground, and pyramids of slopes and of steps, seen
from their top and from their bottom; every tile ends at height 0, so that neighbours fit.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

import numpy as np
import torch
import warp as wp

from mrwarp.env.config.mdp_cfg import TerrainCfg
from mrwarp.env.gait import Legs, foot_point
from mrwarp.env.rng import LEVEL, draw, place
from mrwarp.env.state import WalkState
from mrwarp.env.terminations import DONE, TIME_OUT
from mrwarp.kernels.launch import Launch, record
from mrwarp.usd.converted import Field

KINDS = ("rough", "slope_down", "step_up", "rough", "slope_up", "step_down")
"""Kind of each column of tiles; ``up`` and ``down`` are what a robot does that walks from the middle outwards."""

UNDER_ROBOT = 0.4
"""Half the edge of the square that a standing robot's feet are in [m]."""


def make_field(cfg: TerrainCfg) -> Field:
    """The height field of a configuration: levels along x, kinds along y."""
    rng = np.random.default_rng(cfg.seed)
    size, border = round(cfg.tile / cfg.cell), round(cfg.border / cfg.cell)
    heights = np.zeros((len(KINDS) * size + 2 * border + 1, cfg.levels * size + 2 * border + 1), dtype=np.float32)
    origins = np.zeros((cfg.levels, len(KINDS), 3), dtype=np.float32)
    reach = round(UNDER_ROBOT / cfg.cell)
    half = 0.5 * cfg.cell * np.array([heights.shape[1] - 1, heights.shape[0] - 1])
    for level in range(cfg.levels):
        for k, kind in enumerate(KINDS):
            row, column = border + k * size, border + level * size
            tile = _tile(kind, level / (cfg.levels - 1), cfg, size, rng)
            heights[row : row + size + 1, column : column + size + 1] = tile
            middle = size // 2
            origins[level, k, :2] = cfg.cell * (np.array([column, row]) + middle) - half
            origins[level, k, 2] = tile[middle - reach : middle + reach + 1, middle - reach : middle + reach + 1].max()
    return Field(heights=heights, cell=cfg.cell, origins=origins)


def _tile(kind: str, difficulty: float, cfg: TerrainCfg, size: int, rng: np.random.Generator) -> np.ndarray:
    """Heights of one tile [m], shape (size + 1, size + 1), 0 along its edge."""
    axis = np.abs(np.arange(size + 1) - 0.5 * size) * cfg.cell
    from_middle = np.maximum(axis[:, None], axis[None, :])
    from_edge = 0.5 * cfg.tile - from_middle
    if kind == "rough":
        coarse = rng.uniform(-1.0, 1.0, size=(size // 2 + 1, size // 2 + 1))
        fine = np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1)[: size + 1, : size + 1]
        return difficulty * cfg.roughness * np.where(from_edge > 0.5 * cfg.cell, fine, 0.0)
    inside = np.minimum(from_edge, 0.5 * cfg.tile - cfg.platform)
    sign = -1.0 if kind.endswith("up") else 1.0  # a robot in a pit walks up
    if kind.startswith("slope"):
        return sign * difficulty * cfg.slope * inside
    # the first tread begins one inside the edge; rounding keeps cells off the risers' own positions
    return sign * difficulty * cfg.step * np.floor(inside / cfg.tread + 1e-6)


@wp.func
def grid_place(x: float, half: float, cell: float, points: int) -> float:
    """Place of a coordinate on a grid's axis, in cells, kept inside the grid; 0 for NaN."""
    place = (x + half) / cell
    return wp.where(place >= 0.0, wp.min(place, float(points) - 1.001), 0.0)


@wp.func
def ground_height(heights: wp.array2d[float], cell: float, x: float, y: float) -> float:
    """Height of the ground at a point of the world [m]; beyond the field, and for NaN, that of its edge.

    The field is centred, rows run along y. Each cell is the two triangles that MuJoCo makes of it: split from its
    least to its greatest corner.
    """
    rows, columns = heights.shape[0], heights.shape[1]
    u = grid_place(x, 0.5 * cell * float(columns - 1), cell, columns)
    v = grid_place(y, 0.5 * cell * float(rows - 1), cell, rows)
    column, row = int(u), int(v)
    u -= float(column)
    v -= float(row)
    here, right = heights[row, column], heights[row, column + 1]
    above, beyond = heights[row + 1, column], heights[row + 1, column + 1]
    if u >= v:
        return here + u * (right - here) + v * (beyond - right)
    return here + v * (above - here) + u * (beyond - above)


@wp.kernel(enable_backward=False)
def ground_kernel(
    # parameters: legs; heights [m], shape (rows, columns); their spacing [m]
    legs: Legs,
    heights: wp.array2d[float],
    cell: float,
    # in, shapes (E,), (E, 3) [m], (E, 4), (E, J) [rad]
    mask_in: wp.array[wp.bool],
    root_pos_in: wp.array2d[float],
    root_quat_in: wp.array2d[float],
    q_in: wp.array2d[float],
    # out, shapes (E,), (E, L) [m]
    ground_out: wp.array[float],
    foot_ground_out: wp.array2d[float],
):
    """Height of the ground below the trunk and below each foot."""
    env = wp.tid()
    if not mask_in[env]:
        return
    x, y = root_pos_in[env, 0], root_pos_in[env, 1]
    ground_out[env] = ground_height(heights, cell, x, y)
    # Warp's quaternions end with the real part
    turn = wp.quat(root_quat_in[env, 1], root_quat_in[env, 2], root_quat_in[env, 3], root_quat_in[env, 0])
    for leg in range(foot_ground_out.shape[1]):
        foot = wp.quat_rotate(turn, foot_point(legs, leg, q_in, env))
        foot_ground_out[env, leg] = ground_height(heights, cell, x + foot[0], y + foot[1])


@wp.kernel(enable_backward=False)
def curriculum_kernel(
    # parameters: levels; 1 = levels change; shares of the commanded path above and below which they do; policy step [s]
    levels: int,
    curriculum: int,
    up_at: float,
    down_at: float,
    step_dt: float,
    # in, shapes (2,), (E, 3) [m/s], (E, 3) [m/s, m/s, rad/s], (4, E)
    key_in: wp.array[wp.int64],
    body_velocity_in: wp.array2d[float],
    command_in: wp.array2d[float],
    flags_in: wp.array2d[wp.bool],
    # out, shapes (E,), (E,) [m] twice
    level_out: wp.array[wp.int64],
    walked_out: wp.array[float],
    commanded_out: wp.array[float],
):
    """Count a step's path; up a level after most of the command, down after little or a fall, any past the last."""
    env = wp.tid()
    walked = walked_out[env] + body_velocity_in[env, 0] * step_dt
    commanded = commanded_out[env] + command_in[env, 0] * step_dt
    if flags_in[DONE, env]:
        if curriculum == 1:
            level, share = int(level_out[env]), walked / wp.max(commanded, 1.0e-3)
            if not flags_in[TIME_OUT, env] or share < down_at:
                level = wp.max(level - 1, 0)
            elif share > up_at:
                level += 1
            if level >= levels:
                level = wp.min(int(float(levels) * draw(place(key_in, env, LEVEL), 0)), levels - 1)
            level_out[env] = wp.int64(level)
    walked_out[env] = walked
    commanded_out[env] = commanded


class Terrain:
    """The field, and the tile on which each environment begins.

    Args:
        cfg: Tiles and curriculum.
        num_envs: Number of environments E.
        seed: Seed of the tiles that the environments get.

    Attributes:
        field: The heights.
        origins: Middle of each tile (x, y) and the highest ground there [m], shape (levels, kinds, 3).
        level, kind: First tile of each environment, int64, shape (E,).
    """

    def __init__(self, cfg: TerrainCfg, num_envs: int, *, seed: int) -> None:
        self.cfg, self.field = cfg, make_field(cfg)
        self.origins = torch.from_numpy(self.field.origins)
        # permuted, so that tiles do not follow the currents' groups
        place = np.random.default_rng(seed).permutation(num_envs)
        self.kind = place % len(KINDS)
        tiles = cfg.levels * len(KINDS)
        spread = place // len(KINDS) % cfg.levels if num_envs >= tiles else place * cfg.levels // num_envs
        self.level = np.zeros_like(place) if cfg.curriculum else spread

    def restart(self, s: WalkState) -> None:
        """Every environment at its first tile, without a path behind it."""
        s.level.copy_(torch.from_numpy(self.level))
        s.kind.copy_(torch.from_numpy(self.kind))
        s.walked.zero_()
        s.commanded.zero_()

    def heights(self, s: WalkState, legs: Legs, mask: wp.array) -> Launch:
        """Launch that writes the height of the ground below trunk and feet where the mask, bool (E,), is set."""
        heights = torch.from_numpy(self.field.heights).to(s.q.device)
        return record(
            ground_kernel,
            len(s.q),
            [legs, heights, self.field.cell, mask, s.root_pos, s.root_quat, s.q],
            [s.ground, s.foot_ground],
        )

    def curriculum(self, s: WalkState, step_dt: float) -> Launch:
        """Launch that counts the path of a policy step [s], and chooses the levels of the episodes that begin."""
        cfg = self.cfg
        return record(
            curriculum_kernel,
            len(s.level),
            [
                *(cfg.levels, int(cfg.curriculum), cfg.up_at, cfg.down_at, step_dt),
                *(s.key, s.body_velocity, s.command, s.flags),
            ],
            [s.level, s.walked, s.commanded],
        )
