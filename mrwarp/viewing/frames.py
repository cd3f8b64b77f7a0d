"""Frames: what is shown of some environments over time, as plain NumPy arrays, and the thread that takes them away."""

from __future__ import annotations

import enum
import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
import warp as wp

from mrwarp.env.sim import ActuatedSim

MOST_TOGETHER = 100
"""Most frames in one batch."""

LIVE_INTERVAL = 0.1
"""Least time between two batches to a viewer [s]."""


class Gate(enum.IntEnum):
    """Which branch of the device is open."""

    OFF = 0
    DYNAMIC = 1
    HOLD = 2


def gate_of(dynamic: np.ndarray, hold: np.ndarray) -> np.ndarray:
    """:class:`Gate` of each device from its two gates."""
    return np.where(dynamic > 0.0, Gate.DYNAMIC, np.where(hold > 0.0, Gate.HOLD, Gate.OFF))


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
        names = [field.name for field in fields(Frames)]
        return Frames(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


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
        import torch  # pictures of a robot that stands do without

        self._shown = torch.tensor(list(shown), device=wp.device_to_torch(sim.device))
        arrays = {
            "qpos": sim.backend.field("qpos"),
            "sensor": sim.backend.field("sensordata"),
            "f_foot": sim.f_foot,
            "vel": sim.root_vel,
            "quat": sim.root_quat,
        }
        arrays |= {name: getattr(actuator, name) for name in ("tau_motor", "tau_mr", "current", "m_dyn", "m_hold")}
        self._views = {name: wp.to_torch(array) for name, array in (arrays | {"ledger": actuator.ledger}).items()}
        self._sensors = (sim.scene.foot_adr[:, None] + np.arange(3)).astype(np.int64)

    def read(self, time: float, v_x_command: Sequence[float] | None = None) -> Frames:
        """The state now.

        Args:
            time: Simulated time [s].
            v_x_command: Commanded forward velocity [m/s], shape (K,).
        """
        now = {name: view[self._shown].cpu().numpy() for name, view in self._views.items()}
        w, x, y, z = now["quat"].T
        yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        # the sensor holds the foot's force on the ground; after a reset it still holds the last episode's
        touching = now["f_foot"][:, : len(self._sensors), None] > 0.0
        command = np.full(len(self._shown), np.nan) if v_x_command is None else np.asarray(v_x_command, dtype=float)
        state = {
            "qpos": now["qpos"].astype(np.float64),
            "v_x": np.cos(yaw) * now["vel"][:, 0] + np.sin(yaw) * now["vel"][:, 1],
            "v_z": now["vel"][:, 2],
            "v_x_command": command,
            "gate": gate_of(now["m_dyn"], now["m_hold"]),
            "foot_force": np.where(touching, -now["sensor"][:, self._sensors], 0.0),
        }
        state |= {name: now[name] for name in ("tau_motor", "tau_mr", "current", "ledger")}
        return Frames(time=np.array([time]), **{name: value[None] for name, value in state.items()})


class FrameStream:
    """Logs frames on a thread of its own, in batches, so that the simulation never waits for a viewer.

    rerun's sinks are asynchronous only up to a quota: behind a viewer that hangs, ``log`` blocks once about 100 MB are
    waiting.

    Args:
        log: What takes the frames, e.g. ``RobotLogger.log``; called on the thread only.
        drop: With a full queue drop frames (live) instead of waiting (file).
        batch: Least number of frames that are logged together, up to MOST_TOGETHER.
        capacity: Longest queue, in frames.

    Attributes:
        dropped: Frames that were dropped.
    """

    def __init__(self, log: Callable[[Frames], None], *, drop: bool, batch: int, capacity: int = 500) -> None:
        self.dropped = 0
        self._log, self._drop, self._batch = log, drop, batch
        self._queue: queue.Queue[Frames | None] = queue.Queue(capacity)
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="frame stream", daemon=True)
        self._thread.start()

    def log(self, frames: Frames) -> None:
        """Queue frames; never blocks when dropping.

        Raises:
            RuntimeError: logging failed earlier, and frames may not be dropped.
        """
        if self._error is not None:
            if not self._drop:
                raise RuntimeError(f"frames cannot be logged: {self._error}") from self._error
            self.dropped += len(frames)
        elif self._drop:
            try:
                self._queue.put_nowait(frames)
            except queue.Full:
                self.dropped += len(frames)
        else:
            self._queue.put(frames)

    def close(self, timeout: float | None = None) -> bool:
        """Log what is queued and end the thread; False if that failed or took longer than ``timeout`` [s]."""
        try:
            self._queue.put(None, timeout=timeout)
        except queue.Full:
            return False
        self._thread.join(timeout)
        return not self._thread.is_alive() and self._error is None

    def _run(self) -> None:
        waiting: list[Frames] = []
        logged = -LIVE_INTERVAL
        while True:
            frames = self._queue.get()
            if frames is not None:
                waiting.append(frames)
            # behind a fast simulation the batches grow: each frame costs less, and leaves the interpreter to others
            rested = not self._drop or time.monotonic() - logged >= LIVE_INTERVAL
            full = len(waiting) >= self._batch and rested and self._queue.empty() or len(waiting) >= MOST_TOGETHER
            if waiting and (frames is None or full):
                try:
                    if self._error is None:
                        self._log(Frames.join(waiting))
                except Exception as error:  # any error: the simulation goes on, or hears of it in log()
                    self._error = error
                waiting, logged = [], time.monotonic()
            if frames is None:
                return
