"""Meter: what motors, devices and gates do in every torque step, summed per environment."""

from __future__ import annotations

import numpy as np
import torch

from mrwarp.energy.power import JointLoad
from mrwarp.env.vec_env import WalkEnv
from mrwarp.usd.robot import JOINTS

BIN = 0.5
"""Width of the bins of the torque distributions [N·m]."""

RANGE = 40.0
"""Torques beyond this count into the outermost bins [N·m]; the calf's limit is 35.55."""

SHOWN = tuple(JOINTS.index(f"FR_{segment}") for segment in ("hip", "thigh", "calf"))
"""Joints whose torque distribution is kept, figure 8(c)."""


class JointMeter:
    """Counts the torque steps of the environments that are switched on; one of ``env.substep_hooks``.

    Args:
        env: The environments.

    Attributes:
        on: Environments that are counted, bool, shape (E,); write it between policy steps.
        seconds: Counted time [s], shape (E,).
        hold, dynamic: Share of that time with open gates, shape (E, M).
        counts: Torque steps by motor torque of the :data:`SHOWN` joints, shape (E, 3, bins).
    """

    def __init__(self, env: WalkEnv) -> None:
        actuator, self._dt = env.actuator, env.sim.dt
        self._qd, self._tau = env.qd, env.view(actuator.tau_motor)
        self._mr = list(actuator.mr_joints)
        self._device = {
            name: env.view(getattr(actuator, name)) for name in ("tau_mr", "current", "m_hold", "m_dyn")
        }  # fmt: skip
        self._resistance = env.view(actuator.param("coil_resistance"))
        self._current_e = env.current_e
        shape, double = (env.num_envs, env.num_actions), torch.float64
        self.on = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)
        self._sums = {
            name: torch.zeros(*shape, dtype=double, device=env.device) for name in ("square", "speed", "out", "in")
        }  # fmt: skip
        self._sums |= {
            name: torch.zeros(env.num_envs, len(self._mr), dtype=double, device=env.device)
            for name in ("coil", "friction", "hold", "dynamic")
        }
        self.counts = torch.zeros(env.num_envs, len(SHOWN), round(2.0 * RANGE / BIN), device=env.device)
        self._steps = torch.zeros(env.num_envs, dtype=double, device=env.device)
        env.substep_hooks.append(self.count)

    @torch.no_grad()
    def count(self) -> None:
        """Add the torque step that has just been simulated: its torques over the motion that it ended with."""
        on = self.on.to(torch.float64).unsqueeze(1)
        power = self._tau * self._qd
        self._steps += on[:, 0]
        self._sums["square"] += on * self._tau.square()
        self._sums["speed"] += on * self._qd.abs()
        self._sums["out"] += on * power.clamp(min=0.0)
        self._sums["in"] += on * (-power).clamp(min=0.0)
        bins = ((self._tau[:, SHOWN] + RANGE) / BIN).long().clamp(0, self.counts.shape[2] - 1)
        self.counts.scatter_add_(2, bins.unsqueeze(2), on.float().unsqueeze(2).expand(-1, len(SHOWN), 1))
        if self._mr:
            device = self._device
            self._sums["coil"] += on * self._resistance * device["current"].square()
            self._sums["friction"] += on * (-device["tau_mr"] * self._qd[:, self._mr])
            self._sums["hold"] += on * device["m_hold"]
            # without current the dynamic gate does nothing but keep the drag
            self._sums["dynamic"] += on * device["m_dyn"] * (self._current_e > 0.0).unsqueeze(1)

    def clear(self) -> None:
        """Forget what was counted."""
        for total in (*self._sums.values(), self.counts, self._steps):
            total.zero_()

    @property
    def seconds(self) -> np.ndarray:
        """Counted time [s], shape (E,)."""
        return self._steps.cpu().numpy() * self._dt

    def joint_load(self) -> JointLoad:
        """Means over the counted time, shapes (E, J) and (E, M)."""
        return JointLoad(
            torque_square=self._mean("square"), speed=self._mean("speed"), work_out=self._mean("out"),
            work_in=self._mean("in"), coil=self._mean("coil"), friction=self._mean("friction"),
        )  # fmt: skip

    @property
    def hold(self) -> np.ndarray:
        """Share of the counted time with the holding gate open, shape (E, M)."""
        return self._mean("hold")

    @property
    def dynamic(self) -> np.ndarray:
        """Share of the counted time with the dynamic gate open and current to use, shape (E, M)."""
        return self._mean("dynamic")

    def _mean(self, name: str) -> np.ndarray:
        return (self._sums[name] / self._steps.clamp(min=1.0).unsqueeze(1)).cpu().numpy()
