"""Two strides of one calf at 200 Hz: contact, velocity, gates and torques, as in figures 8(a) and (b)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from mrwarp.env.vec_env import WalkEnv
from mrwarp.usd.robot import JOINTS, LEGS, leg_of

JOINT = "FR_calf"
"""The calf that is recorded, the paper's."""

STRIDES = 2
"""Strides that are kept, the first after the warm-up."""

CHANNELS = ("f_foot", "q_des", "q", "qd", "tau_motor", "tau_mr", "current", "m_hold", "m_dyn")
"""What is recorded [N, rad, rad, rad/s, N·m, N·m, A, 1, 1]."""


@dataclass(frozen=True, kw_only=True)
class GaitTrace:
    """The recorded calf of one robot."""

    t: np.ndarray
    """Time [s], shape (T,)."""
    values: dict[str, np.ndarray]
    """Every channel of :data:`CHANNELS` by name, shape (T,); a robot without devices has no ``tau_mr`` and so on."""


class TraceRecorder:
    """Records the calf of some environments after every torque step; one of ``env.substep_hooks``.

    Args:
        env: The environments.
        shown: Which of them, by index.

    Attributes:
        on: Whether to record; it stops by itself after :data:`STRIDES`.
    """

    def __init__(self, env: WalkEnv, shown: Sequence[int]) -> None:
        self.on = False
        self._dt, rows = env.sim.dt, list(shown)
        joint, leg = JOINTS.index(JOINT), LEGS[leg_of(JOINT)]
        self._length = round(STRIDES / env.cfg.gait_frequency / env.sim.dt)
        column = {"f_foot": LEGS.index(leg), "q_des": joint, "q": joint, "qd": joint, "tau_motor": joint}
        arrays = {"f_foot": env.f_foot, "q_des": env.q_des, "q": env.q, "qd": env.qd,
                  "tau_motor": env.view(env.actuator.tau_motor)}  # fmt: skip
        if joint in env.actuator.mr_joints:
            slot = env.actuator.mr_joints.index(joint)
            for name in ("tau_mr", "current", "m_hold", "m_dyn"):
                column[name], arrays[name] = slot, env.view(getattr(env.actuator, name))
        self._read = {name: (arrays[name], column[name]) for name in CHANNELS if name in arrays}
        self._rows = torch.tensor(rows, device=env.device)
        self._samples: list[dict[str, np.ndarray]] = []
        env.substep_hooks.append(self.count)

    def count(self) -> None:
        """Keep the torque step that has just been simulated."""
        if self.on and len(self._samples) < self._length:
            self._samples.append({
                name: array[self._rows, column].cpu().numpy().copy() for name, (array, column) in self._read.items()
            })  # fmt: skip

    def trace(self, index: int) -> GaitTrace:
        """What was recorded of the ``index``-th shown environment."""
        t = np.arange(len(self._samples)) * self._dt
        return GaitTrace(t=t, values={
            name: np.array([sample[name][index] for sample in self._samples]) for name in self._read
        })  # fmt: skip
