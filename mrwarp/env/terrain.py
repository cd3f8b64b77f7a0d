"""Terrain: one height field of tiles that get harder by level, and the curriculum that moves environments over it.

The layout is public quadruped practice (legged_gym): tiles are ordered by level of difficulty and by kind, and all
environments share the one field. Level 0 is flat. Kinds are rough ground, and pyramids of slopes and of steps, seen
from their top and from their bottom; every tile ends at height 0, so that neighbours fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
import warp as wp

from mrwarp.env.task_kernels.curriculum import course_kernel
from mrwarp.env.task_kernels.ground import ground_kernel
from mrwarp.kernels.launch import record

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv

KINDS = ("rough", "slope_down", "step_up", "rough", "slope_up", "step_down")
"""Kind of each column of tiles; ``up`` and ``down`` are what a robot does that walks from the middle outwards."""

UNDER_ROBOT = 0.4
"""Half the edge of the square that a standing robot's feet are in [m]."""


@dataclass(frozen=True, kw_only=True)
class TerrainCfg:
    """Tiles and curriculum. The hardest level is mild: a 1.5 Hz trot lifts its feet by 0.06 m."""

    levels: int = 6
    """Levels of difficulty; the first is flat."""
    tile: float = 8.0
    """Edge of a tile [m]."""
    cell: float = 0.1
    """Spacing of the heights [m]."""
    border: float = 10.0
    """Flat ground around the tiles [m]: an episode from the middle of the last tile ends on it."""
    platform: float = 1.0
    """Half the edge of the flat middle of a pyramid [m]."""
    roughness: float = 0.03
    """Largest height above or below 0 of rough ground at the last level [m], at points 0.2 m apart."""
    slope: float = 0.2
    """Steepest slope at the last level [1]."""
    step: float = 0.05
    """Highest step at the last level [m]."""
    tread: float = 0.5
    """Length of a step [m]."""
    up_at: float = 0.8
    """A robot goes up a level when it ends a whole episode having walked more than this share of what was commanded."""
    down_at: float = 0.5
    """It goes down when it walked less than this share, or fell."""
    curriculum: bool = True
    """Begin at level 0 and move; False spreads the environments over all levels and leaves them there."""
    seed: int = 0
    """Seed of the rough ground: the same field for every training."""

    def __post_init__(self) -> None:
        if self.levels < 2:
            raise ValueError(f"levels = {self.levels} must be at least 2")
        if not 0.0 < self.cell <= 0.25 * self.platform:
            raise ValueError(
                f"cell = {self.cell} m must be positive and at most a quarter of platform = {self.platform} m"
            )
        if self.tile < 4.0 * self.platform:
            raise ValueError(f"tile = {self.tile} m must be at least four times platform = {self.platform} m")
        if not 0.0 <= self.down_at <= self.up_at:
            raise ValueError(f"need 0 <= down_at <= up_at, got {self.down_at} and {self.up_at}")


@dataclass(frozen=True, kw_only=True)
class Field:
    """Heights on a square grid, centred on the world's origin."""

    heights: np.ndarray
    """[m], float32, shape (rows along y, columns along x)."""
    cell: float
    """Spacing [m]."""
    origins: np.ndarray
    """Middle of each tile (x, y), and the highest ground under a robot there [m], float32, (levels, kinds, 3)."""

    @property
    def half(self) -> tuple[float, float]:
        """Half the extent along x and y [m]."""
        rows, columns = self.heights.shape
        return 0.5 * self.cell * (columns - 1), 0.5 * self.cell * (rows - 1)


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


class Terrain:
    """Where each environment stands on the field, and how high the ground is below it.

    Args:
        cfg: Tiles and curriculum.
        num_envs: Number of environments E.
        device: Device of the tensors.
        seed: Seed of the tiles that the environments get.

    Attributes:
        field: The heights.
        origins: Middle of each tile (x, y) and the highest ground there [m], shape (levels, kinds, 3).
        level, kind: Tile of each environment, int64, shape (E,).
        walked, commanded: Way along the heading in this episode, and what was commanded [m], shape (E,).
    """

    STATE = ("level", "kind", "walked", "commanded")
    """Names of the tensors that a resumed run needs."""

    def __init__(self, cfg: TerrainCfg, num_envs: int, device: torch.device, *, seed: int) -> None:
        self.cfg, self.field = cfg, make_field(cfg)
        self._heights = torch.from_numpy(self.field.heights).to(device)
        self.origins = torch.from_numpy(self.field.origins).to(device)
        # permuted, so that tiles do not follow the currents' groups
        place = torch.from_numpy(np.random.default_rng(seed).permutation(num_envs)).to(device)
        self.kind = place % len(KINDS)
        tiles = cfg.levels * len(KINDS)
        spread = place // len(KINDS) % cfg.levels if num_envs >= tiles else place * cfg.levels // num_envs
        self._first = torch.zeros_like(place) if cfg.curriculum else spread
        self.level = self._first.clone()
        self.walked, self.commanded = (torch.zeros(num_envs, device=device) for _ in range(2))

    def record(self, env: WalkEnv, mask: wp.array) -> wp.Launch:
        """What writes ``env.ground`` and ``env.foot_ground`` where the mask, bool (E,), is set."""
        sim = env.sim
        return record(
            ground_kernel,
            dim=env.num_envs,
            inputs=[wp.from_torch(self._heights), self.field.cell, mask, sim.root_pos, sim.root_quat, sim.q],
            outputs=[wp.from_torch(env.ground), wp.from_torch(env.foot_ground)],
            device=sim.device,
        )

    def record_course(self, env: WalkEnv, flags: wp.array) -> wp.Launch:
        """What counts the way of a policy step and chooses the levels of the episodes that begin.

        Args:
            env: The environment.
            flags: Which episodes end, and how, see ``task_kernels.ends``, shape (4, E).
        """
        cfg = self.cfg
        return record(
            course_kernel,
            dim=len(self.level),
            inputs=[
                cfg.levels, int(cfg.curriculum), cfg.up_at, cfg.down_at, env.cfg.step_dt,
                *map(wp.from_torch, (env.key, env.body_velocity, env.command)), flags,
            ],
            outputs=[*map(wp.from_torch, (self.level, self.walked, self.commanded))],
            device=flags.device,
        )  # fmt: skip

    def restart(self) -> None:
        """Every environment at its first level, without a way behind it."""
        self.level.copy_(self._first)
        self.walked.zero_()
        self.commanded.zero_()
