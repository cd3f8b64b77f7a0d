"""Frames: what is shown of some environments over time, copied out of the simulator as plain NumPy arrays."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
import warp as wp

from mrwarp.env.sim import ActuatedSim


class Gate(enum.IntEnum):
    """Which branch of the device is open."""

    OFF = 0
    DYNAMIC = 1
    HOLD = 2


@dataclass(frozen=True, kw_only=True)
class Frames:
    """T instants of K environments with J joints, M devices and L feet; torques are those of the last torque step."""

    time: np.ndarray
    """Simulated time [s], shape (T,)."""
    qpos: np.ndarray
    """Positions in MuJoCo's layout, shape (T, K, nq)."""
    v_x: np.ndarray
    """Forward velocity in the heading frame [m/s], shape (T, K)."""
    v_z: np.ndarray
    """Vertical velocity [m/s], shape (T, K)."""
    v_x_command: np.ndarray
    """Commanded forward velocity [m/s], NaN without a command, shape (T, K)."""
    tau_motor: np.ndarray
    """Motor torques [N·m], shape (T, K, J)."""
    tau_mr: np.ndarray
    """Device torques [N·m], shape (T, K, M)."""
    current: np.ndarray
    """Coil currents [A], shape (T, K, M)."""
    gate: np.ndarray
    """:class:`Gate` of each device, shape (T, K, M)."""
    foot_force: np.ndarray
    """Force of the ground on each foot, world frame [N], shape (T, K, L, 3)."""
    ledger: np.ndarray
    """Energy ledger, entries of ``mrwarp.kernels.ledger`` [J], shape (T, K, J, 7)."""

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, instants: slice | np.ndarray) -> Frames:
        """Some of the instants."""
        return Frames(**{field.name: getattr(self, field.name)[instants] for field in fields(self)})

    @staticmethod
    def join(parts: Sequence[Frames]) -> Frames:
        """Put frames of the same environments one after the other."""
        if len(parts) == 1:
            return parts[0]
        return Frames(
            **{field.name: np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Frames)}
        )


class FrameReader:
    """Copies the shown environments' state out of a running simulation.

    Args:
        robot: The simulation.
        shown: Environments to show, by index; length K.

    Raises:
        ValueError: an index is out of range, or the robot has no floating base.
    """

    def __init__(self, robot: ActuatedSim, shown: Sequence[int]) -> None:
        sim, actuator = robot.sim, robot.actuator
        if not sim.scene.floating:
            raise ValueError("only a robot with a floating base can be shown, this scene has none")
        if not shown or min(shown) < 0 or max(shown) >= sim.num_envs:
            raise ValueError(f"environments {list(shown)} must lie in 0..{sim.num_envs - 1}")
        self._shown = torch.tensor(list(shown), device=wp.device_to_torch(sim.device))
        self._views = {
            name: wp.to_torch(array)
            for name, array in {
                "qpos": sim.backend.field("qpos"),
                "sensor": sim.backend.field("sensordata"),
                "f_foot": sim.f_foot,
                "vel": sim.root_vel,
                "quat": sim.root_quat,
                "tau_motor": actuator.tau_motor,
                "tau_mr": actuator.tau_mr,
                "current": actuator.current,
                "m_dyn": actuator.m_dyn,
                "m_hold": actuator.m_hold,
                "ledger": actuator.ledger,
            }.items()
        }
        self._sensors = (sim.scene.foot_adr[:, None] + np.arange(3)).astype(np.int64)

    def read(self, time: float, v_x_command: Sequence[float] | None = None) -> Frames:
        """The state now.

        Args:
            time: Simulated time [s].
            v_x_command: Commanded forward velocity [m/s], shape (K,).
        """
        now = {name: view[self._shown].cpu().numpy() for name, view in self._views.items()}
        num_shown = len(self._shown)
        w, x, y, z = now["quat"].T
        yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        v_x = np.cos(yaw) * now["vel"][:, 0] + np.sin(yaw) * now["vel"][:, 1]
        # the sensor holds the foot's force on the ground; after a reset it still holds the last episode's
        force = np.where(now["f_foot"][:, : len(self._sensors), None] > 0.0, -now["sensor"][:, self._sensors], 0.0)
        gate = np.where(now["m_dyn"] > 0.0, Gate.DYNAMIC, np.where(now["m_hold"] > 0.0, Gate.HOLD, Gate.OFF))
        command = np.full(num_shown, np.nan) if v_x_command is None else np.asarray(v_x_command, dtype=np.float64)
        return Frames(
            time=np.array([time]),
            qpos=now["qpos"].astype(np.float64)[None],
            v_x=v_x[None],
            v_z=now["vel"][:, 2][None],
            v_x_command=command[None],
            tau_motor=now["tau_motor"][None],
            tau_mr=now["tau_mr"][None],
            current=now["current"][None],
            gate=gate[None],
            foot_force=force[None],
            ledger=now["ledger"][None],
        )
