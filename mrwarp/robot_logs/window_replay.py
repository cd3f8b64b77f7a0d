"""Simulations of windows of a log under hypotheses: one environment is one hypothesis in one window."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import mujoco.batch
import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from mrwarp.robot_logs.causes import Parameter
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.windows import Windows, turn_between, turned

CHUNK = 192
"""Environments that run at once."""

STRIBECK_SPEED = 0.15
"""Speed at which Stribeck's friction has faded [rad/s]."""

_COLUMNS = {"delay": 1, "com": 3, "tilt": 2, "bias": 3, "mu": 1, "slope": 2, "stiffness": 1}


@dataclass
class Hypotheses:
    """Changes to the robot, for E environments; see :data:`mrwarp.robot_logs.causes.Field`."""

    fields: dict[str, np.ndarray]
    """By name, shape (E, columns)."""

    @classmethod
    def of(cls, parameters: list[Parameter], theta: np.ndarray, model: ReplayModel) -> Hypotheses:
        """Of values of the parameters, shape (E, P)."""
        count, joints, bodies = len(theta), len(model.joints), model.model.nbody
        sizes = _COLUMNS | {"mass": bodies}
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
    """Steps windows under hypotheses, many at once."""

    def __init__(self, model: ReplayModel, windows: Windows, threads: int = 0) -> None:
        self.model, self.windows = model, windows
        spec = model.spec.copy()
        spec.option.timestep = windows.h
        self.mj = spec.compile()
        self.mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET | mujoco.mjtDisableBit.mjDSBL_ISLAND)
        self.batch = mujoco.batch.Batch(self.mj, CHUNK, threads)
        self.steps = 0
        """Physics steps so far."""

    def run(self, changes: Hypotheses, window: np.ndarray, start: np.ndarray) -> dict[str, np.ndarray]:
        """Readings that the simulation predicts.

        Args:
            changes: What is changed, E rows.
            window: Window of each environment, shape (E,).
            start: Changes of its start, see :func:`nuisances`, shape (E, Z).

        Returns:
            By channel, shape (E, S, C).
        """
        parts: dict[str, list[np.ndarray]] = {}
        for first in range(0, len(window), CHUNK):
            rows = slice(first, min(first + CHUNK, len(window)))
            for name, values in self._chunk(changes, window, start, rows):
                parts.setdefault(name, []).append(values)
        return {name: np.concatenate(values) for name, values in parts.items()}

    def _chunk(
        self, changes: Hypotheses, window: np.ndarray, start: np.ndarray, rows: slice
    ) -> Iterator[tuple[str, np.ndarray]]:
        w, m, mj, windows = window[rows], self.model, self.mj, self.windows
        count, joints = len(w), len(self.model.joints)

        def field(name: str, columns: int = joints) -> np.ndarray:
            return changes.get(name, columns, rows)

        ids = np.arange(count)
        kp = windows.kp[w] * (1.0 + field("kp"))
        kd = windows.kd[w] * (1.0 + field("kd"))
        strength = 1.0 + field("strength")
        offset = field("offset")
        self._set("dof_frictionloss", ids, m.v_adr, np.maximum(mj.dof_frictionloss[m.v_adr] + field("friction"), 0.0))
        self._set("dof_damping", ids, m.v_adr, np.maximum(mj.dof_damping[m.v_adr] + field("damping"), 0.0))
        self._set("dof_armature", ids, m.v_adr, np.maximum(mj.dof_armature[m.v_adr] + field("armature"), 1e-5))
        gain, bias = self.batch.expand("actuator_gainprm"), self.batch.expand("actuator_biasprm")
        gain[:count, :, 0] = strength
        bias[:count, :, 1], bias[:count, :, 2] = -strength * kp, -strength * kd
        self._masses(field("mass", mj.nbody), field("com", 3), ids)
        if not m.free:
            self._lean(field("slope", 2), ids)
        if m.free:
            self._ground(field("mu", 1), field("stiffness", 1), ids)

        # commands: later by the delay, between steps in proportion
        parts = windows.feed[:, w]
        feed = (1.0 + field("kp"))[:, None] * parts[0] + (1.0 + field("kd"))[:, None] * parts[1] + parts[2]
        late = np.clip(field("delay", 1)[:, 0] / windows.h, -1.0, windows.before - 1.0)
        whole = np.floor(late).astype(int)
        at = windows.before + np.arange(windows.steps)[None] - whole[:, None]
        top = windows.before + windows.steps - 1
        share = (late - whole)[:, None, None]
        feed = (1.0 - share) * feed[ids[:, None], np.minimum(at, top)] + share * feed[
            ids[:, None], np.minimum(at - 1, top)
        ]
        control = np.zeros((count, windows.steps, mj.nu + mj.nv))
        control[:, :, : mj.nu] = feed + (kp * (field("shift") - offset))[:, None]
        control[:, :, mj.nu + m.v_adr] = self._beside(windows.motion[w], field("stribeck"), field("lag"), strength * kd)

        self._begin(w, start[rows], offset, field("slope", 2), ids)
        spec = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
        with np.errstate(all="ignore"):
            out = self.batch.rollout(windows.steps, control, spec, record=("qpos", "qvel"), ids=ids)
        self.steps += count * windows.steps
        pos = np.concatenate([self._pos0[:, None], out["qpos"]], axis=1)
        vel = np.concatenate([self._vel0[:, None], out["qvel"]], axis=1)
        yield from self._read(w, pos, vel, field, feed, kp, kd, strength, offset)

    def _set(self, name: str, ids: np.ndarray, columns: np.ndarray, values: np.ndarray) -> None:
        self.batch.expand(name)[np.ix_(ids, columns)] = values

    def _masses(self, mass: np.ndarray, com: np.ndarray, ids: np.ndarray) -> None:
        """Masses with inertias in proportion; the trunk's centre of mass."""
        mj = self.mj
        new = np.maximum(mj.body_mass + mass, 1e-4)
        factor = np.where(mj.body_mass > 0.0, new / np.maximum(mj.body_mass, 1e-9), 1.0)
        self.batch.expand("body_mass")[: len(ids)] = np.where(mj.body_mass > 0.0, new, mj.body_mass)
        self.batch.expand("body_inertia")[: len(ids)] = mj.body_inertia * factor[:, :, None]
        self.batch.expand("body_ipos")[: len(ids)] = mj.body_ipos
        self.batch.expand("body_ipos")[: len(ids), self.model.trunk] += com
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

    def _ground(self, mu: np.ndarray, stiffness: np.ndarray, ids: np.ndarray) -> None:
        """Friction and stiffness of every contact."""
        friction = self.batch.expand("geom_friction")
        friction[: len(ids)] = self.mj.geom_friction
        friction[: len(ids), :, 0] *= np.maximum(1.0 + mu, 0.02)
        solref = self.batch.expand("geom_solref")
        solref[: len(ids)] = self.mj.geom_solref
        solref[: len(ids), :, 0] = np.where(
            self.mj.geom_solref[:, 0] > 0.0, self.mj.geom_solref[:, 0] / np.sqrt(np.maximum(1.0 + stiffness, 0.05)),
            self.mj.geom_solref[:, 0],
        )  # fmt: skip

    def _beside(self, motion: np.ndarray, stribeck: np.ndarray, lag: np.ndarray, kd: np.ndarray) -> Any:
        """Torques that follow from the logged motion: shape (E, K, J)."""
        if not stribeck.any() and not lag.any():
            return 0.0
        size = motion / STRIBECK_SPEED
        torque = -stribeck[:, None] * np.exp(-(size**2)) * np.tanh(8.0 * size)
        for e, j in zip(*np.nonzero(lag), strict=True):
            torque[e, :, j] += kd[e, j] * (
                motion[e, :, j] - _lagged(motion[e, :, j], float(lag[e, j]) / self.windows.h)
            )
        return torque

    def _begin(self, w: np.ndarray, start: np.ndarray, offset: np.ndarray, slope: np.ndarray, ids: np.ndarray) -> None:
        m, windows, joints = self.model, self.windows, len(self.model.joints)
        pos, vel = np.tile(self.mj.qpos0, (len(ids), 1)), np.zeros((len(ids), self.mj.nv))
        if m.free:
            root = windows.root[w]
            pos[:, :7], vel[:, :6] = root[:, :7], root[:, 7:]
            extra = start[:, 2 * joints :]
            pos[:, 2] += extra[:, 0]
            pos[:, 3:7] = turned(pos[:, 3:7], np.concatenate([extra[:, 1:3], np.zeros((len(ids), 1))], axis=1))
            vel[:, :3] += extra[:, 3:6]
            # a slope of the ground turns gravity's direction: the robot begins turned, on level ground
            lean = np.concatenate([slope, np.zeros((len(ids), 1))], axis=1)
            pos[:, 3:7] = turned(pos[:, 3:7], lean)
        pos[:, m.q_adr] = windows.q[w] - offset + start[:, :joints]
        vel[:, m.v_adr] = windows.qd[w] + start[:, joints : 2 * joints]
        self._pos0, self._vel0 = pos, vel
        self.batch.bind("qpos")[ids] = pos
        self.batch.bind("qvel")[ids] = vel
        self.batch.bind("qacc_warmstart")[ids] = 0.0

    def _read(self, w, pos, vel, field, feed, kp, kd, strength, offset) -> Iterator[tuple[str, np.ndarray]]:  # noqa: ANN001
        m, windows = self.model, self.windows
        low, share = (x[w] for x in windows.nearest)
        rows = np.arange(len(w))[:, None]

        def at_samples(x: np.ndarray) -> np.ndarray:
            s = share[..., None]
            return (1.0 - s) * x[rows, low] + s * x[rows, low + 1]

        joints = pos[:, :, m.q_adr] + offset[:, None]
        for name in windows.measured:
            if name == "q":
                yield name, at_samples(joints)
            elif name == "qd":
                found, lag = at_samples(vel[:, :, m.v_adr]), field("lag")
                if lag.any():
                    step = float(np.median(np.diff(windows.t[0])))
                    for e, j in zip(*np.nonzero(lag), strict=True):
                        found[e, :, j] = _lagged(found[e, :, j], lag[e, j] / step)
                yield name, found
            elif name == "tau":
                ask = (
                    np.concatenate([feed[:, :1], feed], axis=1)
                    - kp[:, None] * joints
                    - kd[:, None] * vel[:, :, m.v_adr]
                )
                yield name, at_samples(strength[:, None] * ask)
            elif name == "gyro":
                yield name, at_samples(vel[:, :, 3:6]) + field("bias", 3)[:, None]
            elif name == "quat":
                tilt = field("tilt", 2) - field("slope", 2)
                lean = np.concatenate([tilt, np.zeros((len(w), 1))], axis=1)[:, None]
                yield name, turned(pos[rows, low + (share > 0.5), 3:7], lean)
            elif name == "pos":
                yield name, at_samples(pos[:, :, :3])
            elif name == "vel":
                yield name, at_samples(vel[:, :, :3])


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
