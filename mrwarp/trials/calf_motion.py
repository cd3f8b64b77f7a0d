"""Calf motion of the simulated robot walking with a policy, as the virtual bench may replay it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from scipy.interpolate import CubicHermiteSpline

from mrwarp.env.cfg import make_walk_cfg
from mrwarp.trials.walking import make_env
from mrwarp.usd.robot import CALVES, DEFAULT_POSE, JOINTS

_SPEEDS = (0.2, 0.3, 0.4, 0.5, 0.6)
"""Commanded forward speeds [m/s], one robot each."""
_WARMUP = 2.0
"""Walking time before the recording begins [s]."""


def calf_motion(actor: Callable, name: str, *, seconds: float, dt: float, seed: int = 0) -> list[np.ndarray]:
    """Calf angles about the neutral stance [rad], each of shape (T,).

    Args:
        actor: The policy as a function of observations.
        name: What the policy is called in messages.
        seconds: Walking time that is recorded [s].
        dt: Time between two values [s], a part of the control step.
        seed: Seed of the initial poses.

    Raises:
        ValueError: a robot fell.
    """
    env = make_env(make_walk_cfg(seed=seed), len(_SPEEDS), seed)
    command = torch.zeros(len(_SPEEDS), 3, device=env.device)
    command[:, 0] = torch.tensor(_SPEEDS, device=env.device)
    calves = [JOINTS.index(joint) for joint in CALVES]
    env.set_command(command)
    obs = env.get_observations()
    states, step_dt = [], env.cfg.step_dt
    with torch.no_grad():
        for step in range(round(_WARMUP / step_dt) + round(seconds / step_dt)):
            obs, _, done, _ = env.step(actor(obs))
            env.set_command(command)
            if bool(done.any()):
                raise ValueError(f"{name}: the robot fell after {step * step_dt:.1f} s; use a policy that walks")
            if step >= round(_WARMUP / step_dt):
                states.append([x[:, calves].flatten().cpu().numpy() for x in (env.q, env.qd)])
    q, qd = np.array(states).transpose(1, 2, 0)
    t = np.arange(q.shape[1]) * step_dt
    fine = np.arange((len(t) - 1) * round(step_dt / dt)) * dt
    return list(CubicHermiteSpline(t, q - DEFAULT_POSE["calf"], qd, axis=1)(fine))
