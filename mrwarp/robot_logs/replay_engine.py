"""Robots that are stepped together along windows of a log: by MuJoCo on a CPU, by MuJoCo-Warp on a GPU."""

from __future__ import annotations

import mujoco
import numpy as np
import warp as wp

from mrwarp.enums import BackendKind
from mrwarp.env.backend import MjBatchBackend, MjWarpBackend
from mrwarp.kernels.launch import Launch, StepGraph, record
from mrwarp.robot_logs.drive_kernel import Commands, Drives, begin_kernel, drive_kernel, next_kernel, record_kernel
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.robot_log import LogError
from mrwarp.robot_logs.windows import Windows

CONTACTS = 48
"""Contact points for which a GPU has room, by robot."""


class ReplayEngine:
    """E separate robots, with their drives and devices, and a record of K steps.

    Attributes:
        robots: E.
        longer: Bodies of which some robot's link is longer than described.
        drives: By name, see :class:`mrwarp.robot_logs.drive_kernel.Drives`, shape (E, J); written before :meth:`run`.
        window: Window of each robot, shape (E,).
        delay: Delay of its commands [steps], shape (E,).
        latency: Delay of what its drives read [s], shape (E,).

    Args:
        model: The robot.
        mj: The same, compiled for the windows' physics step.
        robots: E.
        kind: Engine; a GPU's own is MuJoCo-Warp.
        threads: Of a CPU.
    """

    def __init__(self, model: ReplayModel, mj: mujoco.MjModel, robots: int, *, kind: BackendKind, threads: int) -> None:
        self.robots, self._mj, self._path = robots, mj, model.path
        self.longer: set[int] = set()
        self.device = wp.get_device(model.device if kind is BackendKind.MJWARP else "cpu")
        if kind is BackendKind.MJBATCH:
            self.backend = MjBatchBackend(mj, robots, threads=threads)
        else:
            rows = mj.nv + 2 * mj.njnt + 4 * CONTACTS
            self.backend = MjWarpBackend(mj, robots, device=model.device, contacts=CONTACTS, constraints=rows)
        joints = len(model.joints)
        self.drives = {name: np.zeros((robots, joints), dtype=np.float32) for name in Drives.vars}
        self.window, self.delay, self.latency = np.zeros(robots, dtype=int), np.zeros(robots), np.zeros(robots)
        slot = np.full(joints, -1)
        slot[model.devices.joint] = np.arange(len(model.devices.joint))
        self._joints = [self._array(x, int) for x in (model.q_adr, model.v_adr, slot)]
        self._devices = model.devices.structs(self.device)
        self._step, (self._at, self._whole) = self._array(np.zeros(1), int), (self._room(int) for _ in range(2))
        self._share, self._latency = self._room(float), self._room(float)
        self._own, self._commands = Drives(), Commands()
        self._windows: Windows | None = None
        self._shape: tuple[int, ...] = ()
        for name in Drives.vars:
            setattr(self._own, name, self._room(float, joints))
        self._states = [self._room(float, joints) for _ in range(5)]
        self._rows: dict[str, tuple[wp.array, np.ndarray]] = {}
        self._record: list[wp.array] = []
        self._graphs: dict[int, tuple[Launch, StepGraph, Launch]] = {}
        self._count = robots

    def state(self, name: str) -> np.ndarray:
        """A field of the state, to be written before :meth:`run`, shape (E, ...)."""
        return self._values(name, self.backend.field)

    def of_model(self, name: str) -> np.ndarray:
        """A field of the model, to be written before :meth:`run`, shape (E, ...)."""
        return self._values(f"model.{name}", lambda _: self.backend.expand(name))

    def load(self, windows: Windows) -> None:
        """Take the commands of windows, all of the step for which the model was compiled."""
        if self._windows is windows:
            return
        parts = dict(zip(("ask_kp", "ask_kd", "ask"), windows.feed, strict=True))
        parts |= {
            name: getattr(windows, name) for name in ("kp", "kd", "coil", "start_coil", "memory", "gravity", "hidden")
        }
        shape = windows.steps, *windows.kp.shape
        if shape != self._shape:
            self._shape = shape
            self._graphs.clear()
            for name, values in parts.items():
                setattr(self._commands, name, wp.empty(values.shape, dtype=float, device=self.device))
            sizes = self._mj.nq, self._mj.nv, len(self._joints[0])
            real = self.backend.field("qpos").dtype
            self._record = [
                wp.zeros((self.robots, windows.steps + 1, n), dtype=real, device=self.device) for n in sizes
            ]
        for name, values in parts.items():
            getattr(self._commands, name).assign(np.ascontiguousarray(values, dtype=np.float32))
        self._windows = windows

    def set_const(self, count: int) -> None:
        """Have masses and inertias of the first ``count`` robots take effect."""
        self._upload()
        if isinstance(self.backend, MjBatchBackend):
            self.backend.batch.set_const(np.arange(count))
        else:
            self.backend.set_const()

    def run(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Step the first ``count`` robots along their windows.

        Returns:
            Positions (count, K + 1, nq), velocities (count, K + 1, nv), and torques of the drives (count, K + 1, J) in
            the step before; they hold until the next run.

        Raises:
            LogError: contacts had no room on a GPU.
        """
        assert self._windows is not None
        self._upload()
        begin, graph, end = self.prepare(count)
        self._step.zero_()
        begin()
        for _ in range(self._windows.steps):
            graph.run()
        end()
        if isinstance(self.backend, MjWarpBackend) and self._dropped():
            raise LogError(
                f"{self._path}: the robot touches something at more points than a GPU has room for; take --device cpu"
            )
        pos, vel, torque = (x[:count].numpy() for x in self._record)
        torque[:, 0] = torque[:, 1]
        return pos, vel, torque

    def prepare(self, count: int) -> tuple[Launch, StepGraph, Launch]:
        """Have the launches ready by which so many robots run: Warp loads modules, which no two threads may do at once.

        Returns:
            Those before, in and after the steps.
        """
        self._count = count if isinstance(self.backend, MjBatchBackend) else self.robots
        if self._count not in self._graphs:
            self._graphs[self._count] = self._recorded(self._count)
        return self._graphs[self._count]

    def _recorded(self, robots: int) -> tuple[Launch, StepGraph, Launch]:
        assert self._windows is not None
        v_adr = self._joints[1]
        joints = (robots, v_adr.shape[0])
        q, v, force, ctrl = (self.backend.field(name) for name in ("qpos", "qvel", "qfrc_actuator", "ctrl"))
        bias, loss = self._plain("actuator_biasprm"), self._plain("dof_frictionloss")
        h, about = self._windows.h, [self._devices, self._commands]
        begin = record(begin_kernel, joints, [v_adr, self._commands, self._at, v], self._states[:3])
        seen = record(record_kernel, robots, [v_adr, self._step, q, v, force], self._record)
        drive = record(
            drive_kernel,
            joints,
            [
                h,
                self._windows.before,
                *self._joints,
                *about,
                self._own,
                self._step,
                self._at,
                self._whole,
                self._share,
                self._latency,
                q,
                v,
            ],
            [*self._states, ctrl, bias, loss],
        )
        on = record(next_kernel, 1, [1], [self._step])
        # capturing is not for threads, and a CPU gains nothing by it
        return begin, StepGraph([seen, drive, self._physics, on], self.device, eager=self.device.is_cpu), seen

    def _dropped(self) -> bool:
        """Whether a contact or a row of a constraint had no room."""
        return bool((self.backend.overflow.numpy() & self.backend.overflow_mask).any())

    def _physics(self) -> None:
        if isinstance(self.backend, MjBatchBackend):
            self.backend.batch.step(np.arange(self._count))
        else:
            self.backend.step()

    def _values(self, key: str, get) -> np.ndarray:  # noqa: ANN001
        if key not in self._rows:
            array = get(key)
            if isinstance(self.backend, MjWarpBackend):
                self._graphs.clear()  # a model's field may have got rows just now
            self._rows[key] = array, array.numpy()
        return self._rows[key][1]

    def _upload(self) -> None:
        """Have what was written reach the device; on a CPU fields are written where they are."""
        whole = np.floor(self.delay)
        small = (self._at, self.window), (self._whole, whole), (self._share, self.delay - whole)
        for array, values in (*small, (self._latency, self.latency)):
            array.assign(values)
        for name, values in self.drives.items():
            getattr(self._own, name).assign(values)
        if not isinstance(self.backend, MjBatchBackend):
            for array, values in self._rows.values():
                array.assign(values)

    def _plain(self, name: str) -> wp.array:
        """A field of the model as plain numbers."""
        array, shape = self.backend.expand(name), self.of_model(name).shape
        if array.shape == shape:
            return array
        return wp.array(ptr=array.ptr, dtype=float, shape=shape, device=self.device, copy=False)

    def _room(self, dtype: type, *shape: int) -> wp.array:
        return wp.zeros((self.robots, *shape), dtype=dtype, device=self.device)

    def _array(self, values: np.ndarray, dtype: type) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)
