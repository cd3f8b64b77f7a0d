"""Simulations of windows of a log under changes of the robot: one environment is one row of a batch in one window."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mrwarp.enums import BackendKind
from mrwarp.robot_logs.causes.cause import Replayed
from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.causes.places import PLACES, turns
from mrwarp.robot_logs.causes.robot_causes import ACTING, READS
from mrwarp.robot_logs.replay_engine import ReplayEngine
from mrwarp.robot_logs.replay_model import ReplayModel, Stance
from mrwarp.robot_logs.windows import Windows, mismatch, product, quaternion, side_by_side, turned
from mrwarp.runtime import core_count

CHUNK, WORKERS = 400, 2
"""Environments that run at once in one thread of a CPU, and threads."""

GPU_CHUNK = 8192
"""Environments that run at once on a GPU: fewer leave it idle, more save nothing."""

GPU_LEAST = 256
"""Fewest environments for which a GPU makes room: so many take the time of one."""

FEW_PER_CORE = 50
"""Environments that a core of a CPU steps in the time in which a GPU steps a thousand: 0.9 ms (H100, a quadruped)."""

T = TypeVar("T")


@dataclass
class ParameterBatch:
    """Changes to the robot, for E environments; see :mod:`mrwarp.robot_logs.causes`."""

    fields: dict[str, np.ndarray]
    """By name, shape (E, columns)."""

    @classmethod
    def of(cls, parameters: list[Parameter], theta: np.ndarray, model: ReplayModel) -> ParameterBatch:
        """Of values of the parameters, shape (E, P)."""
        fields = {p.field: np.zeros((len(theta), PLACES[p.declared.place].columns(model))) for p in parameters}
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
    turn = turns(model)
    return np.concatenate([0.002 * turn, 0.05 * turn, [0.002, 0.005, 0.005, 0.03, 0.03, 0.03] if model.free else []])


class Replay:
    """Steps windows under the changes of a batch, many at once.

    On a CPU robots are shared out to :data:`WORKERS` threads: while one of them prepares or reads its own in Python,
    the engine steps another's. A model on a GPU has few robots stepped on the CPU, too.

    Attributes:
        at_once: Robots that keep it busy.

    Args:
        model: The robot.
        windows: What it is replayed along.
        kind: Engine of all robots; None takes the model's device.
    """

    def __init__(self, model: ReplayModel, windows: Windows, *, kind: BackendKind | None = None) -> None:
        own, batch, warp = model.at_step(windows.h), BackendKind.MJBATCH, BackendKind.MJWARP
        self.model, self.windows = model, windows
        few = [] if kind is warp else [_Stepper(model, windows, own, batch, k) for k in range(WORKERS)]
        on_gpu = kind is warp or (kind is None and model.device != "cpu")
        self._many = [_Stepper(model, windows, own, warp, 0)] if on_gpu else few
        self._few = few or self._many
        self.at_once = GPU_CHUNK if on_gpu else CHUNK

    def run(self, changes: ParameterBatch, window: np.ndarray, start: np.ndarray) -> dict[str, np.ndarray]:
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

    def left(self, changes: ParameterBatch, window: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Measured minus predicted, all channels of an environment side by side, shape (E, N); arguments as above."""
        measured = self.windows.measured

        def row(found: dict[str, np.ndarray], w: np.ndarray) -> np.ndarray:
            return side_by_side(mismatch({name: x[w] for name, x in measured.items()}, found)).astype(np.float32)

        return np.concatenate(self._chunks(changes, window, start, row))

    def _chunks(
        self,
        changes: ParameterBatch,
        window: np.ndarray,
        start: np.ndarray,
        made: Callable[[dict[str, np.ndarray], np.ndarray], T],
    ) -> list[T]:
        """Function of the readings and windows of each chunk, in its thread."""
        many = len(window) > FEW_PER_CORE * core_count()
        steppers, most = (self._many, self.at_once) if many else (self._few, CHUNK)
        workers = len(steppers)
        size = min(most, -(-len(window) // workers))
        chunks = [slice(first, min(first + size, len(window))) for first in range(0, len(window), size)]
        for k, x in enumerate(chunks):
            steppers[k % workers].make_room(size, x.stop - x.start)

        def work(k: int) -> list[T]:
            own = chunks[k::workers]
            return [made(dict(steppers[k].chunk(changes, window, start, x)), window[x]) for x in own]

        with ThreadPoolExecutor(workers) as pool:
            found = list(pool.map(work, range(workers)))
        return [found[k % workers][k // workers] for k in range(len(chunks))]


class _Stepper:
    """Steps the robots of one thread, a chunk at once."""

    def __init__(self, model: ReplayModel, windows: Windows, mj: mujoco.MjModel, kind: BackendKind, own: int) -> None:
        self.model, self.windows, self.mj, self._kind, self._own = model, windows, mj, kind, own
        self.engine: ReplayEngine
        self._stance, self._plain, self._moved = Stance(model, copy.copy(mj)), {}, {}
        self._coils: dict[bytes, np.ndarray] = {}

    def make_room(self, robots: int, count: int) -> None:
        """Take an engine for so many robots, the model's of that size where there is one; ``count`` of them run."""
        robots = 1 << (robots - 1).bit_length()
        if self._kind is BackendKind.MJWARP:
            robots = max(GPU_LEAST, robots)
        key = self._kind, self._own, self.windows.h, robots
        if key not in self.model.engines:
            threads = max(core_count() // WORKERS, 1)
            self.model.engines[key] = ReplayEngine(self.model, self.mj, robots, kind=self._kind, threads=threads)
        self.engine = self.model.engines[key]
        self.engine.load(self.windows)
        self.engine.prepare(count)

    def chunk(
        self, changes: ParameterBatch, window: np.ndarray, start: np.ndarray, rows: slice
    ) -> Iterator[tuple[str, np.ndarray]]:
        w, m, mj, windows, engine = window[rows], self.model, self.mj, self.windows, self.engine
        count, joints = len(w), len(self.model.joints)

        def field(name: str, columns: int = joints) -> np.ndarray:
            return changes.get(name, columns, rows)

        ids, kp, kd = np.arange(count), 1.0 + field("kp"), 1.0 + field("kd")
        strength, latency = 1.0 + field("strength") + field("scale", 1), field("latency", 1)
        damping = np.maximum(mj.dof_damping[m.v_adr] + field("damping"), 0.0)
        self._set("dof_damping", ids, m.v_adr, damping)
        # damping at the end of a step instead of along it acts as an inertia of half of it: without it, steps of 5 ms
        # and of 1 ms would disagree on a small joint's inertia
        late_damping = 0.5 * windows.h * (strength * windows.kd[w] * kd + damping)
        # a drive that answers what it read a little earlier: -kd*qd(t - x) is -kd*qd + x*kd*qdd, and so for the angle
        rotor = mj.dof_armature[m.v_adr] + field("armature") - late_damping - latency * strength * windows.kd[w] * kd
        self._set("dof_armature", ids, m.v_adr, np.maximum(rotor, 1e-5))
        engine.of_model("actuator_gainprm")[:count, :, 0] = strength
        self._bodies(field("mass", mj.nbody), field("length", mj.nbody), field("com", 3), ids)
        slope = field("slope", 2)
        if m.free:
            self._ground(field("give", 1), field("foot", len(m.feet)), ids)
            engine.of_model("opt.gravity")[:count] = _rotation(slope).inv().apply(mj.opt.gravity)
        else:
            self._lean(slope, ids)
        engine.state("qfrc_applied")[:count] = field("push", mj.nv)
        replayed = Replayed(
            robot=m, model=lambda name: engine.of_model(name)[:count], state=lambda name: engine.state(name)[:count]
        )
        for cause, acts in ACTING:
            acts(replayed, field(cause.field, PLACES[cause.place].columns(m)))
        lag, sluggish, smoothed = (np.maximum(field(name), 0.0) for name in ("lag", "torque_lag", "command_lag"))
        coil_lag = m.devices.of_joints("coil_time_constant", joints)
        engine.window[:count] = w
        # commands reach no further than those that were cut out around the window
        engine.delay[:count] = np.clip(field("delay", 1)[:, 0] / windows.h, 1.0 - windows.before, windows.before - 1.0)
        engine.latency[:count] = latency[:, 0]
        for name, values in {
            "kp": kp,
            "kd": kd,
            "strength": strength,
            "shift": field("shift") - field("offset"),
            "faded": lag / (lag + windows.h),  # late by the lag at any step
            "gravity": field("gravity"),
            "hidden": field("elastic") + field("rocking", 1),
            "sluggish": sluggish / (sluggish + windows.h),
            "smoothed": smoothed / (smoothed + windows.h),
            "dry": np.maximum(mj.dof_frictionloss[m.v_adr] + field("friction"), 0.0),
            "stribeck": field("stribeck"),
            "alive": np.maximum(1.0 + field("coil"), 0.0),
            "device": 1.0 + field("device"),
            "drag": field("drag"),
            "lag": np.maximum(coil_lag + field("coil_lag"), 0.0),
        }.items():
            engine.drives[name][:count] = values
        self._begin(w, start[rows], field, ids)
        with np.errstate(all="ignore"):
            pos, vel, torque = engine.run(count)
            yield from self._read(w, pos, vel, torque, field)

    def _set(self, name: str, ids: np.ndarray, columns: np.ndarray, values: np.ndarray) -> None:
        self.engine.of_model(name)[np.ix_(ids, columns)] = values

    def _bodies(self, mass: np.ndarray, length: np.ndarray, com: np.ndarray, ids: np.ndarray) -> None:
        """Masses with inertias in proportion; longer links; the trunk's centre of mass."""
        mj, count = self.mj, len(ids)
        new = np.maximum(mj.body_mass + mass, 1e-4)
        factor = np.where(mj.body_mass > 0.0, new / np.maximum(mj.body_mass, 1e-9), 1.0)
        self.engine.of_model("body_mass")[:count] = np.where(mj.body_mass > 0.0, new, mj.body_mass)
        self.engine.of_model("body_inertia")[:count] = mj.body_inertia * factor[:, :, None]
        self.engine.of_model("body_ipos")[:count] = mj.body_ipos
        self.engine.of_model("body_ipos")[:count, self.model.trunk] += com
        for body in np.flatnonzero(length.any(axis=0)):
            far = 1.0 + length[:, body, None] / self.model.reach[body]
            for name, members in (("body_pos", mj.body_parentid == body), ("geom_pos", mj.geom_bodyid == body)):
                for k in np.flatnonzero(members):
                    self.engine.of_model(name)[:count, k] = getattr(mj, name)[k] * far
            self.engine.longer.add(int(body))
        for body in [x for x in self.engine.longer if not length[:, x].any()]:
            for name, members in (("body_pos", mj.body_parentid == body), ("geom_pos", mj.geom_bodyid == body)):
                self.engine.of_model(name)[:count, members] = getattr(mj, name)[members]
        self.engine.set_const(len(ids))

    def _lean(self, slope: np.ndarray, ids: np.ndarray) -> None:
        """A fixed robot that is not mounted level: every body at the world's root is turned about its origin."""
        roots = np.flatnonzero(self.mj.body_parentid == 0)[1:]
        pos, quat = self.engine.of_model("body_pos"), self.engine.of_model("body_quat")
        lean = Rotation.from_rotvec(np.concatenate([slope, np.zeros((len(ids), 1))], axis=1))
        for body in roots:
            own = Rotation.from_quat(np.roll(self.mj.body_quat[body], -1))
            pos[: len(ids), body] = lean.apply(self.mj.body_pos[body])
            quat[: len(ids), body] = np.roll((lean * own).as_quat(), 1, axis=-1)

    def _ground(self, give: np.ndarray, foot: np.ndarray, ids: np.ndarray) -> None:
        """How much every contact gives, and each foot."""
        solref = self.engine.of_model("geom_solref")
        solref[: len(ids)] = self.mj.geom_solref
        solref[: len(ids), :, 0] = np.where(
            self.mj.geom_solref[:, 0] > 0.0,
            self.mj.geom_solref[:, 0] * np.sqrt(np.maximum(1.0 + give, 0.05)),
            self.mj.geom_solref[:, 0],
        )
        if foot.any():  # a contact's time constant is the mean of its two shapes'
            own = solref[: len(ids), self.model.feet, 0]
            softer = np.maximum(2.0 * np.sqrt(np.maximum(1.0 + foot, 0.05)) - 1.0, 0.05)
            solref[: len(ids), self.model.feet, 0] = np.where(own > 0.0, softer, 1.0) * own

    def _begin(self, w: np.ndarray, start: np.ndarray, field: Callable[..., np.ndarray], ids: np.ndarray) -> None:
        """Put robots where windows begin: as what was read truly was under each change, on feet that bear load."""
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
        self.engine.state("qpos")[ids] = self._later(pos, vel, 0.5 * windows.h)
        self.engine.state("qvel")[ids] = vel
        self.engine.state("qacc_warmstart")[ids] = 0.0

    def _stand(self, pos: np.ndarray, vel: np.ndarray, w: np.ndarray, field: Callable[..., np.ndarray]) -> None:
        """Move trunks of robots that stand otherwise than described: height and speed follow from their feet."""
        m, windows = self.model, self.windows
        length = field("length", self.mj.nbody)
        changes = np.concatenate(
            [length, field("offset"), field("slope", 2), field("tilt", 2), field("bias", 3)], axis=1
        )
        for e in np.flatnonzero(changes.any(axis=1)):
            known = int(w[e]), changes[e].tobytes()
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
        after the velocities: read as of the same instant, the robot would answer half a step early.
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
        along = np.clip((windows.t[w] - clock.T[:, :, None]) / windows.h, 0.0, windows.steps - 1e-9)
        below = along.astype(int)

        def at_samples(x: np.ndarray, group: int = 0) -> np.ndarray:
            share = (along[group] - below[group])[..., None]
            return (1.0 - share) * x[rows, below[group]] + share * x[rows, below[group] + 1]

        early = -0.5 * windows.h  # see _later
        for name in windows.measured:
            if name == "q":
                moved = early * at_samples(vel[:, :, m.v_adr])
                yield name, at_samples(pos[:, :, m.q_adr]) + moved + field("offset")[:, None]
            elif name == "qd":
                found, lag = at_samples(vel[:, :, m.v_adr]), field("lag")
                step = float(np.median(np.diff(windows.t[0])))
                yield name, _lagged(found, lag / step) if lag.any() else found
            elif name == "tau":
                yield name, read_torque(at_samples(torque), windows.gravity_read[w], field)
            elif name == "current":
                yield name, self._currents(w, field)
            elif name == "gyro":
                rate = _rotation(field("tilt", 2)).inv()
                turned_ = np.einsum("eij,esj->esi", rate.as_matrix(), at_samples(vel[:, :, 3:6], 1))
                yield name, turned_ + field("bias", 3)[:, None]
            elif name == "quat":
                found = turned(at_samples(pos[:, :, 3:7], 1), early * at_samples(vel[:, :, 3:6], 1))
                found = found / np.maximum(np.linalg.norm(found, axis=-1, keepdims=True), 1e-9)
                tilt, slope = field("tilt", 2), field("slope", 2)
                if tilt.any():
                    found = turned(found, _flat(tilt)[:, None])
                yield name, product(quaternion(_flat(slope))[:, None], found) if slope.any() else found
            elif name == "pos":
                yield name, at_samples(pos[:, :, :3]) + early * at_samples(vel[:, :, :3])
            elif name == "vel":
                yield name, at_samples(vel[:, :, :3])

    def _currents(self, w: np.ndarray, field: Callable[..., np.ndarray]) -> np.ndarray:
        """Coil currents at the samples [A], shape (E, S, J): they follow from rows of commands and no physics step."""
        m, windows, at = self.model, self.windows, self.model.devices.joint
        if not m.devices:
            return np.zeros((len(w), windows.t.shape[1], len(m.joints)))
        alive = np.maximum(1.0 + field("coil")[:, at], 0.0)
        lag = np.maximum(m.devices.values["coil_time_constant"] + field("coil_lag")[:, at], 0.0)
        changes = np.concatenate([w[:, None], alive, lag, field("delay", 1), field("clock", 2)[:, :1]], axis=1)
        found = np.zeros((len(w), windows.t.shape[1], len(m.joints)))
        for e in range(len(w)):
            if (known := changes[e].tobytes()) not in self._coils:
                rows, begins, late = windows.coil_rows[w[e]][:, at], windows.coil_t[w[e]], field("delay", 1)[e, 0]
                t = windows.t[w[e]] - field("clock", 2)[e, 0]
                self._coils[known] = _coil_current(
                    alive[e] * rows, begins + late, windows.start_coil[w[e]][at], t, lag[e]
                )
            found[e][:, at] = self._coils[known]
        return found


def read_torque(torque: np.ndarray, gravity: np.ndarray, field: Callable[[str], np.ndarray]) -> np.ndarray:
    """Readings of the torque channel, of drives' torques and those of gravity, shapes (E, S, J)."""
    return torque + sum(field(cause.field)[:, None] * reads(torque, gravity) for cause, reads in READS)


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


def _flat(lean: np.ndarray) -> np.ndarray:
    """Rotation vectors about x and y, shape (E, 3)."""
    return np.concatenate([lean, np.zeros((len(lean), 1))], axis=1)


def _rotation(lean: np.ndarray) -> Rotation:
    return Rotation.from_rotvec(_flat(lean))


def _quat(quat: np.ndarray) -> Rotation:
    return Rotation.from_quat(np.roll(quat, -1, axis=-1))


def _lagged(x: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """First-order lag of ``steps`` samples, (E, J), of (E, S, J), settled at the first; a negative one leads."""
    left = np.exp(-1.0 / np.maximum(np.abs(steps), 1e-3))
    late = x.copy()
    for k in range(1, x.shape[1]):
        late[:, k] += left * (late[:, k - 1] - x[:, k])
    return np.where(steps[:, None] < 0.0, 2.0 * x - late, late)
