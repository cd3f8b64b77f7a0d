"""Motions of a held robot that its log does not have: links on elastic drives, a base that gives way.

Both are oscillators that the logged motion drives. The torque by which they differ from rigid bodies follows from it,
for each natural frequency; the one that explains the torque that is left is found by a search over frequencies. The
replay then applies that torque, times a size that is 1 where the hypothesis is right.

Noise of encoders is in the logged motion and in the torque that is left, too, so that it passes for an oscillator.
Targets have none of it: an oscillator also has to explain that torque by its answer to the targets.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from scipy.linalg import orth
from scipy.signal import cont2discrete, lfilter
from scipy.stats import norm

from mrwarp.robot_logs.causes.of_hidden import DAMPING, HIGHEST, LOWEST, RIGHT, SHARED, SMOOTHED, STEPS
from mrwarp.robot_logs.channels.joint_torque import JointTorques, gain_along, torques_along
from mrwarp.robot_logs.replay_model import LONGEST_STEP, Hidden, ReplayModel
from mrwarp.robot_logs.robot_log import LogRun, RobotLog

Torques = Callable[[float], list[np.ndarray]]
"""Torque that an oscillator of a natural frequency [Hz] adds to the rigid bodies' at the joints [N·m], for each
recording, shape (N, J)."""


def behind(x: np.ndarray, dt: float, frequency: float) -> np.ndarray:
    """An oscillator of a natural frequency [Hz] that ``x``, (N, ...), drives, at rest at first; of gain 1."""
    w = 2.0 * np.pi * frequency
    found: Any = cont2discrete(([w * w], [1.0, 2.0 * DAMPING * w, w * w]), dt, "foh")  # SciPy types no single form
    return x[:1] + lfilter(np.ravel(found[0]), np.ravel(found[1]), x - x[:1], axis=0)


def with_oscillator(model: ReplayModel, log: RobotLog) -> ReplayModel:
    """The robot with the oscillator that best explains what rigid bodies leave of the commanded torque, if any does."""
    if model.free or not all("q_des" in run.joint for run in log.runs):
        return model
    count = len(log.joints)
    along = [torques_along(model, log, run, SMOOTHED) for run in log.runs]
    tried = [_best(model, log, along, j) for j in (*range(count), *([-1] if count > 1 else []))]
    seen, found = [own for own in tried if own is not None], []
    if seen:
        runs = [answered(model, log, run, x) for run, x in zip(log.runs, along, strict=True)]
        answer = [torques_along(model, log, run, SMOOTHED) for run in runs]
        found = [own for own in seen if _follows(model, log, along, answer, own)]
    if sum(own.joint >= 0 for own in found) > 1:  # drives that all seem elastic have something else in common
        found = [own for own in found if own.joint < 0]
    if not found:
        return model
    # one oscillator follows from the targets: which it is, one says that explains more, though too little of it follows
    most = max(own.share for own in found)
    found += [own for own in seen if own.share > most and all(own is not x for x in found)]
    best = max(found, key=lambda own: own.share)
    return replace(model, hidden=best._replace(rivals=tuple(own.joint for own in found if own is not best)))


def answered(model: ReplayModel, log: RobotLog, run: LogRun, along: JointTorques) -> LogRun:
    """A recording as the described robot answers its targets: with other angles, without speeds, noise and torques."""
    step = run.dt / np.ceil(run.dt / LONGEST_STEP)
    mj = copy.copy(model.at_step(step))
    data, q = mujoco.MjData(mj), np.zeros(along.q.shape)
    data.qpos[model.q_adr], data.qvel[model.v_adr] = along.q[0], along.qd[0]
    drives = [mj.actuator(f"drive {joint}").id for joint in model.joints]
    target, known = np.nan_to_num(run.joint["q_des"]), np.isfinite(run.joint["q_des"])
    kp, kd = known * gain_along(log, run, "kp"), gain_along(log, run, "kd")
    given = kp * target + sum(
        gain * np.nan_to_num(run.joint.get(name, 0.0)) for name, gain in (("qd_des", kd), ("tau_ff", 1.0))
    )
    steps = np.round(np.diff(run.t, prepend=0.0) / step).astype(int)
    for k in range(run.samples):
        mujoco.mj_step(mj, data, steps[k])
        q[k], data.ctrl[drives] = data.qpos[model.q_adr], given[k]
        mj.actuator_biasprm[drives, 1], mj.actuator_biasprm[drives, 2] = -kp[k], -kd[k]
    return replace(run, joint={name: x for name, x in run.joint.items() if name not in ("qd", "tau")} | {"q": q})


def _frequencies(log: RobotLog) -> np.ndarray:
    top = min(HIGHEST, *(0.1 / run.dt for run in log.runs))
    return np.geomspace(LOWEST, max(top, 1.1 * LOWEST), STEPS)


def _best(model: ReplayModel, log: RobotLog, along: Sequence[JointTorques], j: int) -> Hidden | None:
    """An elastic drive at joint ``j``, with the encoder at its motor or its link, or for -1 a base that gives way.

    None where there is none, or its frequency is the first or last that is tried: it stands for another.
    """
    best, torques, tried = None, _torques(model, log, along, j), _frequencies(log)
    for frequency in tried.tolist():
        torque = torques(frequency)
        size, share, clear = _explained(model, log, along, torque, j)
        # an encoder at the motor does not see the link's swing, one at the link not the motor's, which leads as much
        right = size > 0.0 if j < 0 else RIGHT[0] < abs(size) < RIGHT[1]
        if clear and right and share > max(model.settings.gain.part, best.share if best else 0.0):
            scale = size if j < 0 else np.sign(size)
            best = Hidden(joint=j, frequency=frequency, torque=tuple(scale * x for x in torque), share=share)
    return best if best is not None and tried[0] < best.frequency < tried[-1] else None


def _follows(
    model: ReplayModel,
    log: RobotLog,
    along: Sequence[JointTorques],
    answer: Sequence[JointTorques],
    found: Hidden,
) -> bool:
    """Whether an oscillator explains more than chance would by what the described robot's ``answer`` drives of it."""
    driven = _torques(model, log, answer, found.joint)(found.frequency)
    size, _, clear = _explained(model, log, along, found.torque, found.joint, (answer, driven))
    return clear and size > 0.0


def _torques(model: ReplayModel, log: RobotLog, along: Sequence[JointTorques], j: int) -> Torques:
    """Of an elastic drive at joint ``j``, or for -1 of a base that tilts about its origin under the robot's moment."""
    if j < 0:
        tilts = [(run.dt, *_tilted(model, x, run)) for x, run in zip(along, log.runs, strict=True)]
        return lambda frequency: [_tilting(*tilt, frequency) for tilt in tilts]
    rotor, own = float(model.model.dof_armature[model.v_adr[j]]), np.arange(len(model.joints)) == j
    links = [x.rigid[:, j] - rotor * np.gradient(x.qd[:, j], r.dt) for x, r in zip(along, log.runs, strict=True)]
    pairs = [(link[:, None], run.dt) for link, run in zip(links, log.runs, strict=True)]
    return lambda frequency: [own * (behind(link, dt, frequency) - link) for link, dt in pairs]


def _tilting(dt: float, moment: np.ndarray, coupling: np.ndarray, lean: np.ndarray, frequency: float) -> np.ndarray:
    """Torque at joints [N·m], (N, J), by a base that tilts at a natural frequency [Hz], see :func:`_tilted`."""
    # the moment's mean is how the base was leveled
    tilt = -behind(moment - moment.mean(axis=0), dt, frequency)
    fast = np.gradient(np.gradient(tilt, dt, axis=0), dt, axis=0)
    return np.einsum("nja,na->nj", coupling, fast) + np.einsum("nja,na->nj", lean, tilt)


def _explained(
    model: ReplayModel,
    log: RobotLog,
    along: Sequence[JointTorques],
    torque: Sequence[np.ndarray],
    joint: int,
    by: tuple[Sequence[JointTorques], Sequence[np.ndarray]] | None = None,
) -> tuple[float, float, bool]:
    """Size of a torque at a joint, all for -1, the share of the rest that it explains, and whether that is no chance.

    Gains, masses, frictions, offsets and delays of each joint are free; joints count equally. How many oscillators are
    tried counts. With ``by``, torques and the oscillator's of another motion, only what follows from that motion
    explains: its columns are the instruments of two-stage least squares (Theil 1953).
    """
    pairs, count = [], len(log.joints)
    joints = range(count) if joint < 0 else [joint]
    for j in joints:
        full = _columns(log, along, torque, j)
        others, own = full[:, :-2], full[:, -2:]
        rest = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
        if by is not None:
            basis = _instruments(log, *by, j)
            seen = basis.T @ full[:, :-1]
            fit = np.linalg.lstsq(seen[:, :-1], seen[:, -1], rcond=None)[0]
            rest[:, 0] = basis @ (seen[:, -1] - seen[:, :-1] @ fit)
        pairs.append(rest / np.sqrt(max(float((rest[:, 1] ** 2).sum()), 1e-300)))
    dots, powers = (np.array([float(p[:, 0] @ p[:, k]) for p in pairs]) for k in (1, 0))
    size = float(dots.sum() / max(powers.sum(), 1e-300))
    each = np.sort(2.0 * size * dots - size**2 * powers)
    whole = np.concatenate(pairs)
    limit = by_chance(whole[:, 0], whole[:, 1], STEPS * (count + 1), model.settings.gain.chance)
    return size, float(each[-SHARED:].mean()), size * float(dots.sum()) / len(joints) > limit


def _columns(log: RobotLog, along: Sequence[JointTorques], torque: Sequence[np.ndarray], j: int) -> np.ndarray:
    """Columns free at a joint, then a torque, then what rigid bodies leave of the commanded one [N·m]; shape (N, 10).

    The ends of recordings, where accelerations are extrapolated, are left out.
    """
    rows = []
    for run, x, t in zip(log.runs, along, torque, strict=True):
        rate = np.gradient(x.asked[:, j], run.dt)  # with the next one: of a delay, to second order
        late = [rate, np.gradient(rate, run.dt), np.gradient(np.gradient(x.rigid[:, j], run.dt), run.dt)]
        free = [x.gravity[:, j], x.inertial[:, j], x.rubbed[:, j], x.qd[:, j], *late]
        edge, every = min(round(SMOOTHED / run.dt), len(x.q) // 4), np.ones(len(x.q))
        columns = np.stack([*free, every, t[:, j], x.asked[:, j] - x.rigid[:, j]], axis=1)
        rows.append(columns[edge : len(columns) - edge])
    return np.concatenate(rows)


def _instruments(log: RobotLog, along: Sequence[JointTorques], torque: Sequence[np.ndarray], j: int) -> np.ndarray:
    """Orthonormal basis of what follows from a motion at a joint, shape (N, K).

    A torque's first and second derivatives let the oscillator answer with another phase than along that motion.
    """
    ways = [list(torque)]
    for _ in range(2):
        ways.append([np.gradient(x, run.dt, axis=0) for x, run in zip(ways[-1], log.runs, strict=True)])
    free, *more = (_columns(log, along, way, j)[:, :-1] for way in ways)
    every = np.column_stack([free, *(x[:, -1] for x in more)])
    return orth(every / np.maximum(np.linalg.norm(every, axis=0), 1e-300))


def by_chance(x: np.ndarray, y: np.ndarray, tried: int, chance: float) -> float:
    """Share of the squares of a series, (N,), that an independent one explains in one of so many tries, by this chance.

    The variance of their correlation is the sum of the products of their autocorrelations over N (Bartlett 1935), here
    by their spectra: neighbouring samples are no news.
    """
    powers = [np.abs(np.fft.rfft(z, 2 * len(z))) ** 2 for z in (x, y)]
    shared = float(np.mean(powers[0] * powers[1]) / max(float(powers[0].mean() * powers[1].mean()), 1e-300))
    return float(norm.isf(0.5 * chance / tried)) ** 2 * max(shared, 1.0) / len(x)


def _tilted(model: ReplayModel, x: JointTorques, run: LogRun) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Moment that the robot asks of its base, and torques at joints by a tilt of it, both about x and y.

    Returns:
        Moment [N·m], shape (N, 2); torque by the tilt's acceleration [kg·m²] and by its angle [N·m/rad], (N, J, 2).
    """
    mj, data, count = model.model, mujoco.MjData(model.model), len(x.q)
    faster = np.gradient(x.qd, run.dt, axis=0)
    moment, (coupling, lean) = np.zeros((count, 2)), np.zeros((2, count, len(model.joints), 2))
    origin = mj.body_pos[model.trunk] if model.trunk else np.zeros(3)
    shift, turn = np.zeros((3, mj.nv)), np.zeros((3, mj.nv))
    axes = np.eye(3)[:2]
    bodies = [b for b in model.moving if mj.body_mass[b] > 0.0]
    for k in range(count):
        data.qpos[:] = mj.qpos0
        data.qpos[model.q_adr] = x.q[k]
        mujoco.mj_kinematics(mj, data)
        mujoco.mj_comPos(mj, data)
        for b in bodies:
            mujoco.mj_jacBodyCom(mj, data, shift, turn, b)
            own, spin = shift[:, model.v_adr], turn[:, model.v_adr]
            arm, mass = data.xipos[b] - origin, mj.body_mass[b]
            frame = data.ximat[b].reshape(3, 3)
            inertia = frame @ (mj.body_inertia[b][:, None] * frame.T)
            moved = np.cross(axes, arm)  # acceleration by a tilt's, (2, 3)
            part = mass * own.T @ moved.T + spin.T @ inertia @ axes.T  # (J, 2)
            coupling[k] += part
            weight = mass * mj.opt.gravity
            moment[k] += faster[k] @ part - np.cross(arm, weight)[:2]
            # of a tilted robot gravity is turned the other way
            lean[k] += own.T @ np.cross(axes, weight).T
    return moment, coupling, lean
