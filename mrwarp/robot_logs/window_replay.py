"""Simulations of windows of a log under hypotheses: one environment is one hypothesis in one window."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import mujoco
import mujoco.batch
import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from mrwarp.env.backend import new_batch
from mrwarp.robot_logs.causes import Parameter
from mrwarp.robot_logs.replay_model import ReplayModel, Stance
from mrwarp.robot_logs.windows import Windows, turn_between, turned

CHUNK, WORKERS = 400, 2
"""Environments that run at once in one thread, and threads."""

STRIBECK_SPEED = 0.15
"""Speed at which Stribeck's friction has faded [rad/s]."""

T = TypeVar("T")

_COLUMNS = {
    "delay": 1, "latency": 1, "com": 3, "tilt": 2, "bias": 3, "mu": 1, "slope": 2, "give": 1, "clock": 2, "pull": 2,
    "scale": 1,
}  # fmt: skip


@dataclass
class Hypotheses:
    """Changes to the robot, for E environments; see :data:`mrwarp.robot_logs.causes.Field`."""

    fields: dict[str, np.ndarray]
    """By name, shape (E, columns)."""

    @classmethod
    def of(cls, parameters: list[Parameter], theta: np.ndarray, model: ReplayModel) -> Hypotheses:
        """Of values of the parameters, shape (E, P)."""
        count, joints, bodies = len(theta), len(model.joints), model.model.nbody
        sizes = _COLUMNS | {"mass": bodies, "length": bodies, "foot": len(model.feet)}
        fields = {p.field: np.zeros((count, sizes.get(p.field, joints))) for p in parameters}
        for k, p in enumerate(parameters):
            fields[p.field][:, p.index] += theta[:, k]
        return cls(fields)

    def get(self, name: str, columns: int, rows: slice) -> np.ndarray:
        """A field's rows; zeros where no parameter speaks of it."""
        return self.fields[name][rows] if name in self.fields else np.zeros((rows.stop - rows.start, columns))


def nuisances(model: ReplayModel) -> np.ndarray:
    """Steps of what is not known of a window's start: angles, velocities; with a free trunk height, tilt, velocity.

    Shape (Z,): J times [rad], J times [rad/s], then [m], roll and pitch [rad], three [m/s].
    """
    joints = len(model.joints)
    return np.concatenate(
        [np.full(joints, 0.002), np.full(joints, 0.05), [0.002, 0.005, 0.005, 0.03, 0.03, 0.03] if model.free else []]
    )


class Replay:
    """Steps windows under hypotheses, many at once.

    Robots are shared out to :data:`WORKERS` threads: while one of them prepares or reads its own in Python, the engine
    steps another's.
    """

    def __init__(self, model: ReplayModel, windows: Windows) -> None:
        spec = model.spec.copy()
        spec.option.timestep = windows.h
        mj = spec.compile()
        mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET | mujoco.mjtDisableBit.mjDSBL_ISLAND)
        self.model, self.windows = model, windows
        self._steppers = [_Stepper(model, windows, copy.copy(mj)) for _ in range(WORKERS)]

    def run(self, changes: Hypotheses, window: np.ndarray, start: np.ndarray) -> dict[str, np.ndarray]:
        """Readings that the simulation predicts.

        Args:
            changes: What is changed, E rows.
            window: Window of each environment, shape (E,).
            start: Changes of its start, see :func:`nuisances`, shape (E, Z).

        Returns:
            By channel, shape (E, S, C).
        """
        parts = self._chunks(changes, window, start, lambda found, _: found)
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def left(self, changes: Hypotheses, window: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Measured minus predicted, all channels of an environment side by side, shape (E, N); arguments as above."""
        measured = self.windows.measured

        def row(found: dict[str, np.ndarray], w: np.ndarray) -> np.ndarray:
            return side_by_side(mismatch({name: x[w] for name, x in measured.items()}, found)).astype(np.float32)

        return np.concatenate(self._chunks(changes, window, start, row))

    def _chunks(
        self, changes: Hypotheses, window: np.ndarray, start: np.ndarray,
        made: Callable[[dict[str, np.ndarray], np.ndarray], T],
    ) -> list[T]:  # fmt: skip
        """What is made of the readings and windows of each chunk, in its thread."""
        size = min(CHUNK, -(-len(window) // WORKERS))
        chunks = [slice(first, min(first + size, len(window))) for first in range(0, len(window), size)]

        def work(k: int) -> list[T]:
            readings = ((dict(self._steppers[k].chunk(changes, window, start, x)), x) for x in chunks[k::WORKERS])
            return [made(found, window[x]) for found, x in readings]

        with ThreadPoolExecutor(WORKERS) as pool:
            found = list(pool.map(work, range(WORKERS)))
        return [found[k % WORKERS][k // WORKERS] for k in range(len(chunks))]


class _Stepper:
    """Steps the robots of one thread, :data:`CHUNK` at once."""

    def __init__(self, model: ReplayModel, windows: Windows, mj: mujoco.MjModel) -> None:
        self.model, self.windows, self.mj = model, windows, mj
        self.batch = self._batch(1)
        self._longer: set[int] = set()
        self._stance, self._plain, self._moved = Stance(model, copy.copy(mj)), {}, {}
        self._coils: dict[bytes, np.ndarray] = {}

    def _batch(self, robots: int) -> mujoco.batch.Batch:
        return new_batch(self.mj, robots, max((os.cpu_count() or 1) // WORKERS, 1))

    def chunk(
        self, changes: Hypotheses, window: np.ndarray, start: np.ndarray, rows: slice
    ) -> Iterator[tuple[str, np.ndarray]]:
        w, m, mj, windows = window[rows], self.model, self.mj, self.windows
        count, joints, begin = len(w), len(self.model.joints), self.windows.before
        if count > self.batch.nsim:
            self.batch, self._longer = self._batch(count), set()

        def field(name: str, columns: int = joints) -> np.ndarray:
            return changes.get(name, columns, rows)

        ids = np.arange(count)
        more, kd = 1.0 + field("kp"), windows.kd[w] * (1.0 + field("kd"))
        strength, offset, lag = 1.0 + field("strength") + field("scale", 1), field("offset"), field("lag")
        dry = np.maximum(mj.dof_frictionloss[m.v_adr] + field("friction"), 0.0)
        self._set("dof_damping", ids, m.v_adr, np.maximum(mj.dof_damping[m.v_adr] + field("damping"), 0.0))
        # damping at the end of a step instead of along it acts as an inertia of half of it: without it, steps of 5 ms
        # and of 1 ms would disagree on a small joint's inertia
        late_damping = 0.5 * windows.h * (strength * kd + np.maximum(mj.dof_damping[m.v_adr] + field("damping"), 0.0))
        # a drive that answers what it read a little earlier: -kd*qd(t - x) is -kd*qd + x*kd*qdd, and so for the angle
        latency = field("latency", 1)
        rotor = mj.dof_armature[m.v_adr] + field("armature") - late_damping - latency * strength * kd
        self._set("dof_armature", ids, m.v_adr, np.maximum(rotor, 1e-5))
        limits = self._limits(w, field("limit"))
        gain, bias = self.batch.expand("actuator_gainprm"), self.batch.expand("actuator_biasprm")
        gain[:count, :, 0] = strength
        self.batch.expand("actuator_forcerange")[:count] = limits
        self._bodies(field("mass", mj.nbody), field("length", mj.nbody), field("com", 3), ids)
        slope = field("slope", 2)
        if m.free:
            self._ground(field("mu", 1), field("give", 1), field("foot", len(m.feet)), ids)
            self.batch.expand("opt.gravity")[:count] = _rotation(slope).inv().apply(mj.opt.gravity)
        else:
            self._lean(slope, ids)

        def late(x: np.ndarray) -> np.ndarray:
            return _delayed(x, field("delay", 1)[:, 0] / windows.h, begin, windows.steps)

        parts = windows.feed[:, w]
        ask = late(more[:, None] * parts[0] + (1.0 + field("kd"))[:, None] * parts[1] + parts[2])
        kp = late(more[:, None] * windows.kp[w])
        outer = self.batch.bind("qfrc_applied")
        outer[:count] = field("push", mj.nv)
        if m.free:
            root = int(mj.jnt_dofadr[mj.body_jntadr[m.trunk]])
            outer[:count, root : root + 2] += field("pull", 2)
        device = _Devices(m, field) if m.devices else None
        coil = late(windows.coil[w])[:, :, m.devices.joint] if m.devices else None
        if device is not None and coil is not None:
            middle = 0.5 * (
                m.devices.values["kp_base"] + m.devices.values["kp_low"]
            )  # eq. 9: the low gain while it holds
            device.begin(windows.start_coil[w][:, m.devices.joint], windows.past[w][:, :, m.devices.joint], windows.h)
        self._begin(w, start[rows], field, ids)
        q, v = self.batch.bind("qpos"), self.batch.bind("qvel")
        ctrl, loss = self.batch.bind("ctrl"), self.batch.expand("dof_frictionloss")
        force = self.batch.bind("qfrc_actuator")
        pos, vel = np.empty((count, windows.steps + 1, mj.nq)), np.empty((count, windows.steps + 1, mj.nv))
        torque = np.zeros((count, windows.steps + 1, joints))
        stribeck, shift = field("stribeck"), field("shift") - offset
        slow = v[:count][:, m.v_adr].copy()
        faded = np.maximum(lag, 0.0) / (np.maximum(lag, 0.0) + windows.h)  # late by the lag at any step
        with np.errstate(all="ignore"):
            for k in range(windows.steps):
                pos[:, k], vel[:, k] = q[:count], v[:count]
                speed = vel[:, k][:, m.v_adr]
                slow = speed + faded * (slow - speed)
                bias[:count, :, 1] = -strength * kp[:, k]
                bias[:count, :, 2] = -strength * (kd - latency * kp[:, k])
                ctrl[:count] = ask[:, k] + kp[:, k] * shift + kd * (speed - slow)
                bound = dry + stribeck * np.exp(-((speed / STRIBECK_SPEED) ** 2))
                if device is not None and coil is not None:
                    hold = kp[:, k][:, m.devices.joint] < middle * more[:, m.devices.joint]
                    at = pos[:, k][:, m.q_adr[m.devices.joint]]
                    bound[:, m.devices.joint] += device.bound(
                        coil[:, k], at, speed[:, m.devices.joint], hold, windows.h
                    )
                loss[np.ix_(ids, m.v_adr)] = np.maximum(bound, 0.0)
                self.batch.step(ids)
                torque[:, k + 1] = force[:count][:, m.v_adr]  # what a row reads acted before the row's command
        pos[:, -1], vel[:, -1], torque[:, 0] = q[:count], v[:count], torque[:, 1]
        yield from self._read(w, pos, vel, torque, field)

    def _limits(self, w: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Range of each drive's torque, shape (E, J, 2): a lower limit counts from the most that was asked for."""
        low, high = self.mj.actuator_forcerange[:, 0], self.mj.actuator_forcerange[:, 1]
        own = np.where(change < 0.0, self.model.asked * (1.0 + change), np.inf)
        return np.stack([np.maximum(low, -own), np.minimum(high, own)], axis=-1)

    def _set(self, name: str, ids: np.ndarray, columns: np.ndarray, values: np.ndarray) -> None:
        self.batch.expand(name)[np.ix_(ids, columns)] = values

    def _bodies(self, mass: np.ndarray, length: np.ndarray, com: np.ndarray, ids: np.ndarray) -> None:
        """Masses with inertias in proportion; longer links; the trunk's centre of mass."""
        mj, count = self.mj, len(ids)
        new = np.maximum(mj.body_mass + mass, 1e-4)
        factor = np.where(mj.body_mass > 0.0, new / np.maximum(mj.body_mass, 1e-9), 1.0)
        self.batch.expand("body_mass")[:count] = np.where(mj.body_mass > 0.0, new, mj.body_mass)
        self.batch.expand("body_inertia")[:count] = mj.body_inertia * factor[:, :, None]
        self.batch.expand("body_ipos")[:count] = mj.body_ipos
        self.batch.expand("body_ipos")[:count, self.model.trunk] += com
        for body in np.flatnonzero(length.any(axis=0)):
            far = 1.0 + length[:, body, None] / self.model.reach[body]
            for name, members in (("body_pos", mj.body_parentid == body), ("geom_pos", mj.geom_bodyid == body)):
                for k in np.flatnonzero(members):
                    self.batch.expand(name)[:count, k] = getattr(mj, name)[k] * far
            self._longer.add(int(body))
        for body in [x for x in self._longer if not length[:, x].any()]:
            for name, members in (("body_pos", mj.body_parentid == body), ("geom_pos", mj.geom_bodyid == body)):
                self.batch.expand(name)[:count, members] = getattr(mj, name)[members]
        self.batch.set_const(ids)

    def _lean(self, slope: np.ndarray, ids: np.ndarray) -> None:
        """A fixed robot that is not mounted level: every body at the world's root is turned about its origin."""
        roots = np.flatnonzero(self.mj.body_parentid == 0)[1:]
        pos, quat = self.batch.expand("body_pos"), self.batch.expand("body_quat")
        lean = Rotation.from_rotvec(np.concatenate([slope, np.zeros((len(ids), 1))], axis=1))
        for body in roots:
            own = Rotation.from_quat(np.roll(self.mj.body_quat[body], -1))
            pos[: len(ids), body] = lean.apply(self.mj.body_pos[body])
            quat[: len(ids), body] = np.roll((lean * own).as_quat(), 1, axis=-1)

    def _ground(self, mu: np.ndarray, give: np.ndarray, foot: np.ndarray, ids: np.ndarray) -> None:
        """Friction of every contact, and how much it gives; beside that, how much each foot does."""
        friction = self.batch.expand("geom_friction")
        friction[: len(ids)] = self.mj.geom_friction
        friction[: len(ids), :, 0] *= np.maximum(1.0 + mu, 0.02)
        solref = self.batch.expand("geom_solref")
        solref[: len(ids)] = self.mj.geom_solref
        solref[: len(ids), :, 0] = np.where(
            self.mj.geom_solref[:, 0] > 0.0, self.mj.geom_solref[:, 0] * np.sqrt(np.maximum(1.0 + give, 0.05)),
            self.mj.geom_solref[:, 0],
        )  # fmt: skip
        if foot.any():  # a contact's time constant is the mean of its two shapes'
            own = solref[: len(ids), self.model.feet, 0]
            softer = np.maximum(2.0 * np.sqrt(np.maximum(1.0 + foot, 0.05)) - 1.0, 0.05)
            solref[: len(ids), self.model.feet, 0] = np.where(own > 0.0, softer, 1.0) * own

    def _begin(self, w: np.ndarray, start: np.ndarray, field: Callable[..., np.ndarray], ids: np.ndarray) -> None:
        """Put robots where windows begin: as what was read truly was under each hypothesis, on feet that bear load."""
        m, windows, joints = self.model, self.windows, len(self.model.joints)
        pos, vel = np.tile(self.mj.qpos0, (len(ids), 1)), np.zeros((len(ids), self.mj.nv))
        pos[:, m.q_adr] = windows.q[w] - field("offset")
        vel[:, m.v_adr] = windows.qd[w]
        if m.free:
            root, slope, tilt = windows.root[w], _rotation(field("slope", 2)), _rotation(field("tilt", 2))
            pos[:, :7], vel[:, :6] = root[:, :7], root[:, 7:]
            # the inertial sensor sits askew on the trunk, and gravity askew on the ground that the world's axes follow
            lean = slope.inv() * _quat(pos[:, 3:7]) * tilt.inv()
            pos[:, 3:7] = np.roll(lean.as_quat(), 1, axis=-1)
            vel[:, 3:6] = tilt.apply(vel[:, 3:6] - field("bias", 3))
            self._stand(pos, vel, w, field)
            extra = start[:, 2 * joints :]
            pos[:, 2] += extra[:, 0]
            pos[:, 3:7] = np.roll((_quat(pos[:, 3:7]) * _rotation(extra[:, 1:3])).as_quat(), 1, axis=-1)
            vel[:, :3] += extra[:, 3:6]
        pos[:, m.q_adr] += start[:, :joints]
        vel[:, m.v_adr] += start[:, joints : 2 * joints]
        self.batch.bind("qpos")[ids] = self._later(pos, vel, 0.5 * windows.h)
        self.batch.bind("qvel")[ids] = vel
        self.batch.bind("qacc_warmstart")[ids] = 0.0

    def _stand(self, pos: np.ndarray, vel: np.ndarray, w: np.ndarray, field: Callable[..., np.ndarray]) -> None:
        """Move trunks of robots that stand otherwise than the described one: how high and fast it is, its feet tell."""
        m, windows = self.model, self.windows
        length = field("length", self.mj.nbody)
        told = np.concatenate([length, field("offset"), field("slope", 2), field("tilt", 2), field("bias", 3)], axis=1)
        for e in np.flatnonzero(told.any(axis=1)):
            known = int(w[e]), told[e].tobytes()
            if known not in self._moved:
                self._moved[known] = self._other_stance(pos[e], vel[e], known[0], length[e])
            height, speed = self._moved[known]
            if "pos" not in windows.measured:
                pos[e, 2] += height
            if "vel" not in windows.measured:
                vel[e, :3] += speed
        if "pos" not in windows.measured:
            bearing = windows.loaded[w]
            count = np.maximum(bearing.sum(axis=1), 1)
            give = np.maximum(field("give", 1), -0.95)
            soft = (1.0 + give) * np.where(bearing, np.maximum(field("foot", len(m.feet)), -0.95), 0.0)
            pos[:, 2] -= m.sink[count - 1] * (give[:, 0] + soft.sum(axis=1) / count)

    def _other_stance(
        self, pos: np.ndarray, vel: np.ndarray, window: int, length: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """By how much higher [m] and faster [m/s] a trunk is at a window's start than the described robot's."""
        longer = [int(body) for body in np.flatnonzero(length)]
        for body in longer:
            self._reach(self._stance.mj, body, float(length[body]))
        height, speed = self._stance.trunk(pos, vel, self.windows.loaded[window])
        for body in longer:
            self._reach(self._stance.mj, body, 0.0)
        plain = self._described(window)
        return height - plain[0], speed - plain[1]

    def _described(self, window: int) -> tuple[float, np.ndarray]:
        """Height and velocity of the described robot's trunk at a window's start, by that sample alone."""
        if window not in self._plain:
            m, windows = self.model, self.windows
            pos, vel = self.mj.qpos0.copy(), np.zeros(self.mj.nv)
            pos[3:7], vel[3:6] = windows.root[window, 3:7], windows.root[window, 10:]
            pos[m.q_adr], vel[m.v_adr] = windows.q[window], windows.qd[window]
            self._plain[window] = self._stance.trunk(pos, vel, windows.loaded[window])
        return self._plain[window]

    def _reach(self, mj: mujoco.MjModel, body: int, length: float) -> None:
        """Put what hangs on a body as far out as on a link that is longer by ``length`` [m]."""
        far = 1.0 + length / self.model.reach[body]
        for name, members in (("body_pos", mj.body_parentid == body), ("geom_pos", mj.geom_bodyid == body)):
            getattr(mj, name)[members] = far * getattr(self.mj, name)[members]

    def _later(self, pos: np.ndarray, vel: np.ndarray, seconds: float) -> np.ndarray:
        """Positions ``seconds`` on at the same speeds; shapes (..., nq), (..., nv).

        The engine's semi-implicit Euler steps are leapfrog ones, of second order, where positions are those half a step
        after the velocities beside them: read as of the same instant, the robot would answer half a step early.
        """
        m, found = self.model, pos.copy()
        found[..., m.q_adr] += seconds * vel[..., m.v_adr]
        if m.free:
            found[..., :3] += seconds * vel[..., :3]
            found[..., 3:7] = turned(pos[..., 3:7], seconds * vel[..., 3:6])
        return found

    def _read(self, w, pos, vel, torque, field) -> Iterator[tuple[str, np.ndarray]]:  # noqa: ANN001
        m, windows = self.model, self.windows
        clock, rows = field("clock", 2), np.arange(len(w))[:, None]
        pos = self._later(pos, vel, -0.5 * windows.h)

        def at_samples(x: np.ndarray, group: int = 0) -> np.ndarray:
            along = np.clip((windows.t[w] - clock[:, group, None]) / windows.h, 0.0, windows.steps - 1e-9)
            low = along.astype(int)
            s = (along - low)[..., None]
            return (1.0 - s) * x[rows, low] + s * x[rows, low + 1]

        for name in windows.measured:
            if name == "q":
                yield name, at_samples(pos[:, :, m.q_adr] + field("offset")[:, None])
            elif name == "qd":
                found, lag = at_samples(vel[:, :, m.v_adr]), field("lag")
                step = float(np.median(np.diff(windows.t[0])))
                for e, j in zip(*np.nonzero(lag), strict=True):
                    found[e, :, j] = _lagged(found[e, :, j], lag[e, j] / step)
                yield name, found
            elif name == "tau":
                yield name, at_samples(torque)
            elif name == "current":
                yield name, self._currents(w, field)
            elif name == "gyro":
                rate = _rotation(field("tilt", 2)).inv()
                found = at_samples(vel[:, :, 3:6], 1)
                turned_ = np.einsum("eij,esj->esi", rate.as_matrix(), found)
                yield name, turned_ + field("bias", 3)[:, None]
            elif name == "quat":
                found = at_samples(pos[:, :, 3:7], 1)
                found = found / np.maximum(np.linalg.norm(found, axis=-1, keepdims=True), 1e-9)
                tilt, slope = field("tilt", 2), field("slope", 2)
                if tilt.any():
                    found = turned(found, _flat(tilt)[:, None])
                if slope.any():
                    lean = Rotation.from_rotvec(np.repeat(_flat(slope), found.shape[1], axis=0))
                    leant = lean * _quat(found.reshape(-1, 4))
                    found = np.roll(leant.as_quat(), 1, axis=-1).reshape(found.shape)
                yield name, found
            elif name in ("pos", "vel"):
                yield name, at_samples((pos if name == "pos" else vel)[:, :, :3])

    def _currents(self, w: np.ndarray, field: Callable[..., np.ndarray]) -> np.ndarray:
        """Coil currents at the samples [A], shape (E, S, J): they follow from rows of commands and no physics step."""
        m, windows, at = self.model, self.windows, self.model.devices.joint
        if not m.devices:
            return np.zeros((len(w), windows.t.shape[1], len(m.joints)))
        alive = np.maximum(1.0 + field("coil")[:, at], 0.0)
        lag = np.maximum(m.devices.values["coil_time_constant"] + field("coil_lag")[:, at], 0.0)
        told = np.concatenate([w[:, None], alive, lag, field("delay", 1), field("clock", 2)[:, :1]], axis=1)
        found = np.zeros((len(w), windows.t.shape[1], len(m.joints)))
        for e in range(len(w)):
            if (known := told[e].tobytes()) not in self._coils:
                rows, begins, late = windows.coil_rows[w[e]][:, at], windows.coil_t[w[e]], field("delay", 1)[e, 0]
                t = windows.t[w[e]] - field("clock", 2)[e, 0]
                self._coils[known] = _coil_current(
                    alive[e] * rows, begins + late, windows.start_coil[w[e]][at], t, lag[e]
                )
            found[e][:, at] = self._coils[known]
        return found


class _Devices:
    """MR devices beside the physics: coil, hysteresis and the torque that each bears; M devices, E environments."""

    def __init__(self, model: ReplayModel, field: Callable[..., np.ndarray]) -> None:
        d, at = model.devices, model.devices.joint
        self.p = d.values
        self.alive, self.strength = 1.0 + field("coil")[:, at], 1.0 + field("device")[:, at]
        self.lag = np.maximum(d.values["coil_time_constant"] + field("coil_lag")[:, at], 0.0)
        self.drag = field("drag")[:, at]

    def begin(self, coil: np.ndarray, past: np.ndarray, h: float) -> None:
        """Coil current (E, M) and the motion before, (E, K, M), by which the hysteresis begins."""
        self.coil = coil.copy()
        self.z = np.zeros_like(coil)
        for k in range(past.shape[1]):
            self._turn(past[:, k], h)

    def _turn(self, qd: np.ndarray, h: float) -> None:
        """Eq. 15 with the new z in its linear terms: stable for any speed."""
        rate = self.p["beta"] * np.abs(qd) + self.p["gamma"] * qd * np.sign(self.z)
        self.z = (self.z + h * qd) / np.maximum(1.0 + h * rate, 0.1)

    def bound(self, coil: np.ndarray, q: np.ndarray, qd: np.ndarray, hold: np.ndarray, h: float) -> np.ndarray:
        """Largest torque of each device [N·m], eqs. 14, 15 and, while it holds, 18; shape (E, M)."""
        p, want = self.p, np.maximum(self.alive, 0.0) * coil
        self.coil = want + np.where(self.lag > 0.0, np.exp(-h / np.maximum(self.lag, 1e-6)), 0.0) * (self.coil - want)
        self._turn(qd, h)
        amps = np.maximum(self.coil, 0.0)
        at = q - p["q_neutral"] - p["q_offset"] - p["q_center"]
        gain = (p["K0"] + self.strength * p["K1"] * amps) / (1.0 + p["alpha"] * np.abs(qd))
        sliding = np.abs(p["D"] + p["B"] * qd + p["C"] * at + p["I1"] * amps + gain * self.z)
        ratio = (amps / p["K"]) ** p["n"]
        held = np.where(hold, self.strength * p["T_max"] * ratio / (1.0 + ratio), 0.0)
        return np.maximum(sliding, held) + self.drag


def _coil_current(
    asked: np.ndarray, begins: np.ndarray, start: np.ndarray, t: np.ndarray, lag: np.ndarray
) -> np.ndarray:
    """Current of M coils [A] at times ``t``, (S, M), that are ``start`` at 0 and follow commands with time constants.

    Commands (R, M) are each held until the next begins, the first since ever; times (R,) and (S,) [s], ``start`` and
    ``lag`` (M,).
    """
    tau, limits = np.maximum(lag, 1e-6), (np.append(-np.inf, begins[1:]), np.append(begins[1:], np.inf))
    since = [t[:, None] - np.clip(x, 0.0, np.maximum(t, 0.0)[:, None]) for x in limits]  # (S, R)
    share = np.exp(-since[1][:, :, None] / tau) - np.exp(-since[0][:, :, None] / tau)
    return np.einsum("srm,rm->sm", share, asked) + np.exp(-t[:, None] / tau) * start


def _delayed(x: np.ndarray, steps: np.ndarray, before: int, count: int) -> np.ndarray:
    """What was asked for ``steps`` earlier, between steps in proportion: (E, K + 2*M, J) to (E, K, J)."""
    late = np.clip(steps, 1.0 - before, before - 1.0)
    whole = np.floor(late).astype(int)
    share, ids = (late - whole)[:, None, None], np.arange(len(x))[:, None]
    at, top = before + np.arange(count)[None] - whole[:, None], x.shape[1] - 1
    return (1.0 - share) * x[ids, np.clip(at, 0, top)] + share * x[ids, np.clip(at - 1, 0, top)]


def _flat(lean: np.ndarray) -> np.ndarray:
    """Rotation vectors about x and y, shape (E, 3)."""
    return np.concatenate([lean, np.zeros((len(lean), 1))], axis=1)


def _rotation(lean: np.ndarray) -> Rotation:
    return Rotation.from_rotvec(_flat(lean))


def _quat(quat: np.ndarray) -> Rotation:
    return Rotation.from_quat(np.roll(quat, -1, axis=-1))


def _lagged(x: np.ndarray, steps: float) -> np.ndarray:
    """First-order lag of ``steps`` samples, settled at the first; a negative one leads."""
    if steps < 0.0:
        return x - (_lagged(x, -steps) - x)
    a = float(np.exp(-1.0 / max(steps, 1e-3)))
    return np.asarray(lfilter([1.0 - a], [1.0, -a], x, zi=[a * x[0]])[0])


def mismatch(measured: dict[str, np.ndarray], predicted: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Measured minus predicted by channel, shape (E, S, C); orientations as rotation vectors."""
    return {
        name: turn_between(predicted[name], values) if name == "quat" else values - predicted[name]
        for name, values in measured.items()
    }


def side_by_side(x: dict[str, np.ndarray]) -> np.ndarray:
    """All channels of each of E windows in one row, (E, N)."""
    return np.concatenate([values.reshape(len(values), -1) for values in x.values()], axis=1)
