"""Parts of a task next to robot and physics: commands, ground, noise, differences between robots, rewards.

Loads no engine, so that command lines are read from it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from mrwarp.enums import RANDOMIZATIONS, TERRAINS


@dataclass(frozen=True, kw_only=True)
class CommandCfg:
    """Velocity commands, drawn uniformly."""

    v_x: tuple[float, float] = (0.2, 0.6)
    """Forward speed [m/s]; the paper's 1.5 Hz gait reaches about 0.6 m/s (section 7)."""
    v_y: tuple[float, float] = (0.0, 0.0)
    """Lateral speed [m/s]."""
    yaw_rate: tuple[float, float] = (-0.2, 0.2)
    """Yaw rate [rad/s]."""
    period: float = 5.0
    """Time between new commands [s]."""


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
    """Largest height above or below 0 of rough ground at the last level [m], at points every 0.2 m."""
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


def make_terrain_cfg(kind: str = "rough") -> TerrainCfg | None:
    """A ground of :data:`TERRAINS`, else ValueError; None is the plane."""
    if kind not in TERRAINS:
        raise ValueError(f"terrain = {kind!r} is unknown; choose from {', '.join(TERRAINS)}")
    return TerrainCfg() if kind == "rough" else None


@dataclass(frozen=True, kw_only=True)
class NoiseCfg:
    """Half-widths of the uniform noise on the actor's observations; public quadruped practice."""

    gyro: float = 0.1
    """Angular velocity [rad/s]."""
    gravity: float = 0.03
    """Projected gravity [1]."""
    q: float = 0.01
    """Joint position [rad]."""
    qd: float = 0.5
    """Joint velocity [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class RandomizeCfg:
    """Differences between environments during training. Ranges are multiplied or added as the names say."""

    friction: tuple[float, float] = (0.5, 1.1)
    """Sliding friction of ground and feet [1]."""
    added_mass: tuple[float, float] = (-0.5, 1.0)
    """Mass added to the trunk [kg]."""
    mr_scale: tuple[float, float] = (0.8, 1.2)
    """Factor on the device's B, K0, K1 and T_max, drawn per environment and joint at every reset."""
    gain_scale: tuple[float, float] = (0.9, 1.1)
    """Factor on the motor gains kp and kd, per environment and joint."""
    push_speed: float = 0.3
    """Largest horizontal velocity kick [m/s]."""
    push_interval: float = 6.0
    """Mean time between kicks [s]."""


def make_randomize_cfg(kind: str = "all") -> RandomizeCfg | None:
    """Differences between training environments: a kind of :data:`RANDOMIZATIONS`, else ValueError.

    ``all`` is everything that :class:`RandomizeCfg` has; ``ground`` friction and kicks, what legged_gym randomises by
    default, and nothing of the robot.
    """
    if kind not in RANDOMIZATIONS:
        raise ValueError(f"randomize = {kind!r} is unknown; choose from {', '.join(RANDOMIZATIONS)}")
    if kind == "none":
        return None
    if kind == "ground":
        return RandomizeCfg(added_mass=(0.0, 0.0), mr_scale=(1.0, 1.0), gain_scale=(1.0, 1.0))
    return RandomizeCfg()


@dataclass(frozen=True, kw_only=True)
class RewardCfg:
    """Weights of the reward terms, and the numbers that shape them.

    Example:
        >>> from mrwarp.env.config.mdp_cfg import RewardCfg
        >>> RewardCfg(weights={"tilt": -100.0}).weighing(height=-1.0).weights
        {'tilt': -100.0, 'height': -1.0}

    Raises:
        ValueError: a weight is no finite number.
    """

    weights: Mapping[str, float] = field(default_factory=dict)
    """Weights per second that differ from the terms' own, by name; see :data:`mrwarp.env.rewards.TERMS`. ``power`` is
    per watt."""
    winding_resistance: float = 0.128
    """Phase resistance that the power is computed with [Ohm]; a public motor of this size has 0.105 to 0.13 (see
    ``ElectricalCfg``). Not the calibrated number: the calibration needs trained policies."""
    target_height: float = 0.32
    """Wanted trunk height [m]; the paper's policies walk at 0.328 to 0.334."""
    velocity_width: float = 0.04
    """Squared velocity error at which tracking falls to 1/e [(m/s)^2]."""
    yaw_width: float = 0.1
    """Squared yaw-rate error at which tracking falls to 1/e [(rad/s)^2]."""
    step_height: float = 0.06
    """Clearance of a swinging foot at mid swing [m]."""

    def __post_init__(self) -> None:
        for name, weight in self.weights.items():
            if not math.isfinite(weight):
                raise ValueError(f"reward {name} = {weight} must be finite")

    def weighing(self, **weights: float) -> RewardCfg:
        """A copy with other weights of these terms."""
        return replace(self, weights={**self.weights, **weights})


def read_rewards(words: Iterable[str]) -> RewardCfg:
    """Weights as ``NAME=WEIGHT`` each.

    Raises:
        ValueError: a weight is no number.
    """
    weights = {}
    for word in words:
        name, _, text = word.partition("=")
        try:
            weights[name] = float(text)
        except ValueError:
            raise ValueError(f"{word}: give a term and its weight, such as tilt=-100") from None
    return RewardCfg(weights=weights)
