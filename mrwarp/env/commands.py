"""Velocity commands: v_x, v_y and yaw rate."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
import warp as wp

from mrwarp.env.rng import COMMAND, between, place
from mrwarp.env.state import WalkState
from mrwarp.kernels.launch import Launch, record


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


@wp.kernel(enable_backward=False)
def command_kernel(
    # parameters: policy steps between two commands, 0 = they are held; least and largest command, shape (3,) [m/s, m/s,
    # rad/s]
    period: int,
    low: wp.array[float],
    high: wp.array[float],
    # in, shapes (2,), (E,) [policy steps], (E,)
    key_in: wp.array[wp.int64],
    episode_length_in: wp.array[wp.int64],
    mask_in: wp.array[wp.bool],
    # out, shape (E, 3) [m/s, m/s, rad/s]
    command_out: wp.array2d[float],
):
    """Draw a new command where an episode begins (the mask), and every ``period`` steps of an episode."""
    env = wp.tid()
    due = mask_in[env]
    if period > 0:
        step = int(episode_length_in[env])
        due = due or (step > 0 and step % period == 0)
    if due:
        begin = place(key_in, env, COMMAND)
        for k in range(3):
            command_out[env, k] = between(low[k], high[k], begin, k)


def draw_commands(s: WalkState, cfg: CommandCfg, step_dt: float, begins: wp.array) -> Launch:
    """What draws a command for every new episode, and every ``period`` at the same step of all; never if infinite.

    Args:
        s: The task's arrays.
        cfg: Ranges and period.
        step_dt: Policy step [s].
        begins: Environments whose episode begins, bool, shape (E,).
    """
    ranges = zip(cfg.v_x, cfg.v_y, cfg.yaw_rate, strict=True)
    low, high = (torch.tensor(side, device=s.command.device) for side in ranges)
    period = max(round(cfg.period / step_dt), 1) if math.isfinite(cfg.period) else 0
    return record(command_kernel, len(s.command), [period, low, high, s.key, s.episode_length_buf, begins], [s.command])
