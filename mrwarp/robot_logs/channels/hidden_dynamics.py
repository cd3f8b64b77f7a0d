"""Motions of a held robot that its log does not have: links on elastic drives, a base that gives way.

Both are oscillators that the logged motion drives. The torque by which they differ from rigid bodies follows from it,
for each natural frequency; the one that explains the torque that is left is found by a search over frequencies. The
replay then applies that torque, times a size that is 1 where the hypothesis is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.signal import cont2discrete, lfilter
from scipy.stats import norm

from mrwarp.robot_logs.causes.of_hidden import DAMPING, HIGHEST, LOWEST, RIGHT, SHARED, SMOOTHED, STEPS
from mrwarp.robot_logs.channels.joint_torque import JointTorques, torques_along
from mrwarp.robot_logs.replay_model import Hidden, ReplayModel
from mrwarp.robot_logs.robot_log import LogRun, RobotLog


class Oscillator(NamedTuple):
    """A motion that the log does not have."""

    frequency: float
    """Natural frequency [Hz]."""
    torque: tuple[np.ndarray, ...]
    """Torque that it adds to the rigid bodies' at the joints [N·m], for each recording, shape (N, J)."""
    share: float
    """Share of the mismatch that it explains [1]."""


def behind(x: np.ndarray, dt: float, frequency: float) -> np.ndarray:
    """An oscillator of a natural frequency [Hz] that ``x``, (N, ...), drives, at rest at first; of gain 1."""
    w = 2.0 * np.pi * frequency
    found: Any = cont2discrete(([w * w], [1.0, 2.0 * DAMPING * w, w * w]), dt, "foh")  # SciPy types no single form
    return x[:1] + lfilter(np.ravel(found[0]), np.ravel(found[1]), x - x[:1], axis=0)


def with_oscillator(model: ReplayModel, log: RobotLog) -> ReplayModel:
    """The robot with the oscillator that best explains what rigid bodies leave of the commanded torque, if any does."""
    if model.free or not all("q_des" in run.joint for run in log.runs):
        return model
    along = [torques_along(model, log, run, SMOOTHED) for run in log.runs]
    found = [(own, j) for j in range(len(log.joints)) if (own := _elastic(model, log, along, j)) is not None]
    if len(found) > 1:  # drives that all seem elastic have something else in common
        found = []
    if len(log.joints) > 1 and (base := _base(model, log, along)) is not None:
        found.append((base, -1))
    if not found:
        return model
    best, joint = max(found, key=lambda x: x[0].share)
    rivals = tuple(j for _, j in found if j != joint)
    motion = Hidden(joint=joint, frequency=best.frequency, torque=best.torque, share=best.share, rivals=rivals)
    return replace(model, hidden=motion)


def _frequencies(log: RobotLog) -> np.ndarray:
    top = min(HIGHEST, *(0.1 / run.dt for run in log.runs))
    return np.geomspace(LOWEST, max(top, 1.1 * LOWEST), STEPS)


def _inside(best: Oscillator | None, log: RobotLog) -> Oscillator | None:
    """An oscillator whose frequency lies between those that are tried: at their ends it stands for another."""
    tried = _frequencies(log)
    return best if best is not None and tried[0] < best.frequency < tried[-1] else None


def _elastic(model: ReplayModel, log: RobotLog, along: Sequence[JointTorques], j: int) -> Oscillator | None:
    """An elastic drive at joint ``j``, with the encoder at its motor or at its link; None where there is none."""
    rotor = float(model.model.dof_armature[model.v_adr[j]])
    best: Oscillator | None = None
    for frequency in _frequencies(log):
        torque = []
        for run, x in zip(log.runs, along, strict=True):
            link = x.rigid[:, j] - rotor * np.gradient(x.qd[:, j], run.dt)
            more = np.zeros(x.q.shape)
            more[:, j] = behind(link, run.dt, frequency) - link
            torque.append(more)
        size, share, clear = _explained(model, log, along, torque, [j])
        # an encoder at the motor does not see the link's swing, one at the link not the motor's, which leads as much
        if clear and RIGHT[0] < abs(size) < RIGHT[1] and share > (best.share if best else 0.0):
            best = Oscillator(float(frequency), tuple(np.sign(size) * x for x in torque), share)
    return _inside(best, log)


def _base(model: ReplayModel, log: RobotLog, along: Sequence[JointTorques]) -> Oscillator | None:
    """A base that tilts about its origin under the robot's moment; None where it does not."""
    tilts = [_tilted(model, x, run) for x, run in zip(along, log.runs, strict=True)]
    best, joints = None, list(range(len(log.joints)))
    for frequency in _frequencies(log):
        torque = []
        for run, (moment, coupling, lean) in zip(log.runs, tilts, strict=True):
            # the moment's mean is how the base was leveled
            tilt = -behind(moment - moment.mean(axis=0), run.dt, frequency)
            fast = np.gradient(np.gradient(tilt, run.dt, axis=0), run.dt, axis=0)
            torque.append(np.einsum("nja,na->nj", coupling, fast) + np.einsum("nja,na->nj", lean, tilt))
        size, share, clear = _explained(model, log, along, torque, joints)
        if clear and size > 0.0 and share > (best.share if best else 0.0):
            best = Oscillator(float(frequency), tuple(size * x for x in torque), share)
    return _inside(best, log)


def _explained(
    model: ReplayModel,
    log: RobotLog,
    along: Sequence[JointTorques],
    torque: Sequence[np.ndarray],
    joints: Sequence[int],
) -> tuple[float, float, bool]:
    """Common size of a torque at some joints, the share of the rest that it explains, and whether it counts.

    Gains, masses, frictions, offsets and delays of each joint are free; joints count equally. A share counts that is no
    chance, by the number of oscillators that are tried, and no small part. The ends of recordings, where accelerations
    are extrapolated, do not count.
    """
    pairs = []
    for j in joints:
        rows = []
        for run, x, t in zip(log.runs, along, torque, strict=True):
            rate = np.gradient(x.asked[:, j], run.dt)  # with the next one: of a delay, to second order
            late = [rate, np.gradient(rate, run.dt), np.gradient(np.gradient(x.rigid[:, j], run.dt), run.dt)]
            free = [x.gravity[:, j], x.inertial[:, j], x.rubbed[:, j], x.qd[:, j], *late]
            edge, every = min(round(SMOOTHED / run.dt), len(x.q) // 4), np.ones(len(x.q))
            columns = np.stack([*free, every, t[:, j], x.asked[:, j] - x.rigid[:, j]], axis=1)
            rows.append(columns[edge : len(columns) - edge])
        full = np.concatenate(rows)
        others, own = full[:, :-2], full[:, -2:]
        rest = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
        pairs.append(rest / np.sqrt(max(float((rest[:, 1] ** 2).sum()), 1e-300)))
    dots, powers = (np.array([float(p[:, 0] @ p[:, k]) for p in pairs]) for k in (1, 0))
    size = float(dots.sum() / max(powers.sum(), 1e-300))
    each = np.sort(2.0 * size * dots - size**2 * powers)
    share, whole, gain = float(each[-SHARED:].mean()), np.concatenate(pairs), model.settings.gain
    limit = by_chance(whole[:, 0], whole[:, 1], STEPS * (len(log.joints) + 1), gain.chance)
    return size, share, share > gain.part and size * float(dots.sum()) / len(joints) > limit


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
