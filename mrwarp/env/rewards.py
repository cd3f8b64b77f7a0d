"""Rewards: velocity tracking, clocked gait, posture, effort and smoothness, and their weighted sum.

A term is a function with its weight next to it. To add one, write it here under :func:`term`; the kernel, ``RewardCfg``
and the command line (``--reward NAME=WEIGHT``) take it from the list.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
import warp as wp

from mrwarp.env.config.mdp_cfg import RewardCfg
from mrwarp.env.gait import Legs, foot_height, swing_clearance
from mrwarp.env.state import WalkState
from mrwarp.kernels.launch import Launch, record_per_env


@dataclass(frozen=True, kw_only=True)
class RewardTerm:
    """A term of the reward."""

    value: Any
    """Its value of an environment, a Warp function of what a term sees and the environment."""
    weight: float
    """Weight for the shipped robot, per second."""
    scale: Callable[[Any], float]
    """Unit of the term for a robot of another size, from its :class:`mrwarp.env.natural_units.Scales`."""

    @property
    def says(self) -> str:
        """One line on the term, with its unit."""
        return " ".join((self.value.func.__doc__ or "").split())


TERMS: dict[str, RewardTerm] = {}
"""All terms by name, in the order of the kernel."""


def term(*, weight: float, scale: Callable[[Any], float] = lambda by: 1.0) -> Callable[[Any], Any]:
    """List a Warp function ``f(s: Seen, env: int) -> float`` as a term, under its name; see :class:`RewardTerm`."""

    def listed(value: Any) -> Any:
        TERMS[value.key] = RewardTerm(value=value, weight=weight, scale=scale)
        return value

    return listed


def check(cfg: RewardCfg) -> None:
    """Refuse weights of terms that are not there.

    Raises:
        ValueError: there is no such term; the message lists those that are.
    """
    for name in cfg.weights:
        if name not in TERMS:
            raise ValueError(f"reward {name!r} is unknown; choose from {', '.join(TERMS)}")


def weight(cfg: RewardCfg, name: str) -> float:
    """Weight of a term, per second."""
    return cfg.weights.get(name, TERMS[name].weight)


def flat(cfg: RewardCfg) -> dict[str, float]:
    """All weights by term, then the numbers that shape them."""
    shapes = {name: value for name, value in vars(cfg).items() if name != "weights"}
    return {**{name: weight(cfg, name) for name in TERMS}, **shapes}


@wp.struct
class Seen:
    """All that a term may read, after a policy step; shapes by environments E, joints J, actions A, legs L."""

    velocity_width: float
    yaw_width: float
    step_height: float
    target_height: float
    step_dt: float
    """Policy step [s]; the four before are those of :class:`RewardCfg`."""
    legs: Legs
    default_q: wp.array[float]
    """Neutral stance [rad], shape (J,)."""
    body_velocity: wp.array2d[float]
    """In the heading frame [m/s], shape (E, 3)."""
    command: wp.array2d[float]
    """v_x, v_y [m/s] and yaw rate [rad/s], shape (E, 3)."""
    height: wp.array[float]
    """Of the trunk over the ground [m], shape (E,)."""
    root_pos: wp.array2d[float]
    root_vel: wp.array2d[float]
    root_ang: wp.array2d[float]
    """Trunk's place [m], velocity [m/s] and angular velocity [rad/s], shapes (E, 3)."""
    gravity: wp.array2d[float]
    """Gravity's direction in the trunk frame, shape (E, 3)."""
    q: wp.array2d[float]
    qd: wp.array2d[float]
    last_qd: wp.array2d[float]
    """Joint angles [rad], velocities and those of the policy step before [rad/s], shapes (E, J)."""
    action: wp.array2d[float]
    last_action: wp.array2d[float]
    """Shapes (E, A)."""
    effort: wp.array[float]
    """Squared motor torques, averaged over the torque steps [(N·m)^2], shape (E,)."""
    power: wp.array[float]
    """Electrical power [W], shape (E,)."""
    foot_ground: wp.array2d[float]
    """Height of the ground below each foot [m], shape (E, L)."""
    leg_phase: wp.array2d[float]
    clock_match: wp.array2d[wp.bool]
    """Phase of each leg, and whether its contact is what the gait clock wants, shapes (E, L)."""


@wp.func
def tracking(squared_error: float, width: float) -> float:
    """exp(-error^2/width): 1 on target, 1/e where the squared error is the width."""
    return wp.exp(-squared_error / width)


@wp.func
def square_to(values: wp.array2d[float], wanted: wp.array2d[float], env: int) -> float:
    """Squared distance of an environment's values from what is wanted of it."""
    total = float(0.0)
    for k in range(values.shape[1]):
        difference = values[env, k] - wanted[env, k]
        total += difference * difference
    return total


@term(weight=2.0)
@wp.func
def track_velocity(s: Seen, env: int) -> float:
    """exp(-|v_xy - command|^2 / width)."""
    error_x = s.body_velocity[env, 0] - s.command[env, 0]
    error_y = s.body_velocity[env, 1] - s.command[env, 1]
    return tracking(error_x * error_x + error_y * error_y, s.velocity_width)


@term(weight=0.5)
@wp.func
def track_yaw(s: Seen, env: int) -> float:
    """exp(-(yaw rate - command)^2 / width)."""
    error = s.root_ang[env, 2] - s.command[env, 2]
    return tracking(error * error, s.yaw_width)


@term(weight=1.5)
@wp.func
def contact_clock(s: Seen, env: int) -> float:
    """Share of feet whose contact is what the gait clock wants, minus a half."""
    total = float(0.0)
    for leg in range(s.clock_match.shape[1]):
        total += wp.where(s.clock_match[env, leg], 1.0, 0.0)
    return total / float(s.clock_match.shape[1]) - 0.5


@term(weight=-30.0, scale=lambda by: by.length**2)
@wp.func
def swing_height(s: Seen, env: int) -> float:
    """Squared error of the swinging feet's clearance over the ground [m^2], summed."""
    up = -wp.vec3(s.gravity[env, 0], s.gravity[env, 1], s.gravity[env, 2])
    total = float(0.0)
    for leg in range(s.leg_phase.shape[1]):
        phase = s.leg_phase[env, leg]
        if phase >= 0.5:
            height = foot_height(s.legs, leg, s.q, env, s.root_pos[env, 2], up)
            error = height - s.foot_ground[env, leg] - swing_clearance(phase, s.step_height)
            total += error * error
    return total


@term(weight=-40.0, scale=lambda by: by.length**2)
@wp.func
def height(s: Seen, env: int) -> float:
    """Squared error of the trunk's height over the ground [m^2]."""
    z = s.height[env]
    return (z - s.target_height) * (z - s.target_height)


@term(weight=-3.0)
@wp.func
def tilt(s: Seen, env: int) -> float:
    """Squared horizontal part of the projected gravity."""
    return s.gravity[env, 0] * s.gravity[env, 0] + s.gravity[env, 1] * s.gravity[env, 1]


@term(weight=-1.0, scale=lambda by: by.speed**2)
@wp.func
def bounce(s: Seen, env: int) -> float:
    """Squared vertical speed [(m/s)^2]."""
    return s.root_vel[env, 2] * s.root_vel[env, 2]


@term(weight=-0.05, scale=lambda by: by.time**-2)
@wp.func
def roll_pitch_rate(s: Seen, env: int) -> float:
    """Squared roll and pitch rates [(rad/s)^2]."""
    return s.root_ang[env, 0] * s.root_ang[env, 0] + s.root_ang[env, 1] * s.root_ang[env, 1]


@term(weight=-0.15)
@wp.func
def posture(s: Seen, env: int) -> float:
    """Squared distance of all joints from the neutral stance [rad^2]."""
    total = float(0.0)
    for joint in range(s.q.shape[1]):
        total += (s.q[env, joint] - s.default_q[joint]) * (s.q[env, joint] - s.default_q[joint])
    return total


@term(weight=-1.0)
@wp.func
def hip_posture(s: Seen, env: int) -> float:
    """Squared distance of hips, which turn about x, from the stance [rad^2]: legs stay under the body."""
    total = float(0.0)
    for joint in range(s.q.shape[1]):
        if s.legs.hips[joint] == 1.0:
            total += (s.q[env, joint] - s.default_q[joint]) * (s.q[env, joint] - s.default_q[joint])
    return total


@term(weight=-3e-4, scale=lambda by: by.torque**2)
@wp.func
def effort(s: Seen, env: int) -> float:
    """Squared motor torques [(N·m)^2], averaged over the torque steps."""
    return s.effort[env]


@term(weight=-0.02)
@wp.func
def action_rate(s: Seen, env: int) -> float:
    """Squared change of the action."""
    return square_to(s.action, s.last_action, env)


@term(weight=-1e-7, scale=lambda by: by.time**-4)
@wp.func
def joint_acceleration(s: Seen, env: int) -> float:
    """Squared joint acceleration over the policy step [(rad/s^2)^2]."""
    return square_to(s.qd, s.last_qd, env) / (s.step_dt * s.step_dt)


@term(weight=0.0, scale=lambda by: by.torque / by.time)
@wp.func
def power(s: Seen, env: int) -> float:
    """Electrical power of motors and coils [W]: copper loss, mechanical power, coil loss."""
    return s.power[env]


_TERMS = list(TERMS.values())

SOURCES: int = zlib.crc32(Path(__file__).read_bytes()) // 2
"""Checksum of this file: Warp does not see that a term, which a static loop picks, was edited."""


@wp.kernel(enable_backward=False)
def rewards_kernel(
    # parameters: environments of a thread have this stride; weights in the order of TERMS, shape (T,)
    rows: int,
    weights: wp.array[float],
    # in
    seen: Seen,
    # out, shapes (E, T), (E,)
    terms_out: wp.array2d[float],
    total_out: wp.array[float],
):
    """All terms, and their weighted sum over one policy step."""
    first = wp.tid()
    wp.static(SOURCES)
    for env in range(first, seen.q.shape[0], rows):
        total = float(0.0)
        for k in range(wp.static(len(_TERMS))):
            value = wp.static(_TERMS[k].value)(seen, env)
            terms_out[env, k] = value
            total += weights[k] * value
        total_out[env] = total * seen.step_dt


def reward(s: WalkState, cfg: RewardCfg, step_dt: float, legs: Legs) -> Launch:
    """Launch of all terms, ``s.terms``, and their weighted sum over a policy step of ``step_dt`` [s], ``s.total``."""
    seen = Seen()
    seen.legs, seen.step_dt = legs, step_dt
    for name in ("velocity_width", "yaw_width", "step_height", "target_height"):
        setattr(seen, name, getattr(cfg, name))
    arrays = [name for name in Seen.vars if hasattr(s, name)]
    for name in arrays:
        setattr(seen, name, wp.from_torch(getattr(s, name)))
    weights = torch.tensor([weight(cfg, name) for name in TERMS], device=s.q.device)
    return record_per_env(rewards_kernel, len(s.q), [weights, seen], [s.terms, s.total])
