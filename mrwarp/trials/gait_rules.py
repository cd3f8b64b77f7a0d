"""Rules of a gait that figures can rest on: attitude, left against right; written before any was trained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch

from mrwarp.env.vec_env import WalkEnv


@dataclass(frozen=True, kw_only=True)
class Rules:
    """Limits of a policy that tables can rest on, at 0.5 m/s on flat ground."""

    tilt_rms: float = 1.0
    """Largest RMS of roll and pitch together [deg]: one leg of a pair with 0.4 m between them stands 7 mm higher than
    the other."""
    lean: float = 0.5
    """Largest mean roll or pitch [deg]: half of what the RMS may be."""
    sides: float = 0.05
    """Largest difference of the mean calf torque of left and right legs, as a share of their mean: gaits with a clock
    are mirror images of themselves half a stride later, so all of it is a fault."""


def broken(figures: Mapping[str, float], rules: Rules | None = None) -> list[str]:
    """Rules that a policy does not keep, by the name of the figure; a figure that was not measured breaks none.

    Args:
        figures: ``tilt_rms``, ``roll`` and ``pitch`` [deg], ``sides`` [%], ``fell`` (share).
        rules: The limits.
    """
    rules = rules or Rules()
    limits = {"tilt_rms": rules.tilt_rms, "roll": rules.lean, "pitch": rules.lean, "sides": 100.0 * rules.sides}
    limits["fell"] = 0.0
    return [name for name, limit in limits.items() if abs(figures.get(name, 0.0)) > limit]


class PostureMeter:
    """Attitude of the trunk, and mean torques of left and right legs, over steps of a walk.

    Args:
        env: The environments.
    """

    def __init__(self, env: WalkEnv) -> None:
        self._env, soles = env, env.sim.scene.soles[:, 1]
        self._watched = list(env.sim.scene.watched)
        self._left, self._right = (np.flatnonzero(side).tolist() for side in (soles > 0.0, soles < 0.0))
        self._attitude: list[torch.Tensor] = []
        self._torque: list[torch.Tensor] = []

    def add(self) -> None:
        """Add the policy step that has just been simulated."""
        g = self._env.gravity
        roll, pitch = torch.atan2(-g[:, 1], -g[:, 2]), torch.asin(g[:, 0].clamp(-1.0, 1.0))
        self._attitude.append(torch.rad2deg(torch.stack([roll, pitch])))
        self._torque.append(self._env.view(self._env.actuator.tau_motor)[:, self._watched].abs())

    def figures(self, rows: torch.Tensor) -> dict[str, float]:
        """``tilt_rms``, ``roll``, ``pitch`` [deg] and ``sides`` [%] of some environments, bool of shape (E,)."""
        attitude = torch.stack(self._attitude)[:, :, rows]
        roll, pitch = attitude.mean((0, 2)).tolist()
        found = {"tilt_rms": float(attitude.square().sum(1).mean().sqrt()), "roll": roll, "pitch": pitch}
        if self._left and self._right and len(self._watched) == len(self._left) + len(self._right):
            torque = torch.stack(self._torque)[:, rows].mean((0, 1))
            left, right = float(torque[self._left].mean()), float(torque[self._right].mean())
            found["sides"] = 200.0 * (left - right) / max(left + right, 1e-9)
        return found
