"""Torques of a held robot's joints along its log: what commands ask for, what was read, what rigid bodies need."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.signal import savgol_filter

from mrwarp.robot_logs.causes.of_channels import STANDSTILL
from mrwarp.robot_logs.causes.places import turns
from mrwarp.robot_logs.replay_model import ReplayModel, bias_torque
from mrwarp.robot_logs.robot_log import LogRun, RobotLog


@dataclass(frozen=True, kw_only=True)
class JointTorques:
    """Torques along one recording, N samples of J joints, all smoothed by the same filter."""

    q: np.ndarray
    """[rad], shape (N, J)."""
    qd: np.ndarray
    """[rad/s], shape (N, J)."""
    rubbed: np.ndarray
    """Dry friction of 1 N·m, which changes its sign within :data:`STANDSTILL`, shape (N, J)."""
    gravity: np.ndarray
    """Torque that holds the described links at rest [N·m], shape (N, J)."""
    inertial: np.ndarray
    """Torque of their accelerations, with rotors, and of Coriolis forces [N·m], shape (N, J)."""
    asked: np.ndarray
    """Torque that commands ask for [N·m], shape (N, J)."""
    read: np.ndarray
    """Torque channel [N·m], shape (N, J); NaN for a joint that lacks it."""

    @property
    def rigid(self) -> np.ndarray:
        """Torque that the described rigid bodies need [N·m], shape (N, J)."""
        return self.gravity + self.inertial


def gain_along(log: RobotLog, run: LogRun, name: str) -> np.ndarray:
    """A drive's gain, ``kp`` or ``kd``, in each row as logged, else the log's own; 0 where neither is known, (N, J)."""
    own = np.broadcast_to(np.nan_to_num(getattr(log, name)), run.joint["q"].shape)
    return np.where(np.isfinite(run.joint[name]), run.joint[name], own) if name in run.joint else own


def asked_torque(log: RobotLog, run: LogRun, speed: np.ndarray) -> np.ndarray:
    """Torque that a recording's rows ask for at the measured angle and speed [N·m], shape (N, J)."""
    joint = run.joint
    ask = np.nan_to_num(joint.get("tau_ff", np.zeros(joint["q"].shape)))
    if "q_des" in joint:
        kp, kd = (gain_along(log, run, name) for name in ("kp", "kd"))
        rate = np.nan_to_num(joint.get("qd_des", 0.0)) - speed
        ask = ask + kp * np.nan_to_num(joint["q_des"] - joint["q"]) + kd * rate
    return ask


def gravity_along(model: ReplayModel, q: np.ndarray) -> np.ndarray:
    """Torque that holds a held robot's described links at angles ``q``, [rad] (N, J), at rest [N·m], (N, J)."""
    data, at = mujoco.MjData(model.model), (model.q_adr, model.v_adr)
    return np.array([bias_torque(model.model, data, *at, row, 0.0) for row in q]).reshape(q.shape)


def torques_along(model: ReplayModel, log: RobotLog, run: LogRun, seconds: float) -> JointTorques:
    """Torques along a recording, of signals smoothed over ``seconds``."""
    q, t = run.joint["q"], run.t
    width = min(2 * max(round(0.5 * seconds / run.dt), 2) + 1, 2 * ((run.samples - 1) // 2) + 1)

    def smooth(x: np.ndarray, deriv: int = 0) -> np.ndarray:
        return np.asarray(savgol_filter(x, width, 3, deriv=deriv, delta=float(t[-1] / (len(t) - 1)), axis=0))

    angle, speed, acceleration = smooth(q), smooth(q, 1), smooth(q, 2)
    gravity, inertial = np.zeros(q.shape), np.zeros(q.shape)
    data, product, whole = mujoco.MjData(model.model), np.zeros(model.model.nv), np.zeros(model.model.nv)
    for k in range(len(q)):
        bias = bias_torque(model.model, data, model.q_adr, model.v_adr, angle[k], speed[k])
        whole[model.v_adr] = acceleration[k]
        mujoco.mj_makeM(model.model, data)
        mujoco.mj_mulM(model.model, data, product, whole)
        gravity[k] = bias_torque(model.model, data, model.q_adr, model.v_adr, angle[k], 0.0)
        inertial[k] = bias - gravity[k] + product[model.v_adr]
    blank = np.full(q.shape, np.nan)
    return JointTorques(
        q=angle,
        qd=speed,
        rubbed=np.tanh(speed / (STANDSTILL * turns(model))),
        gravity=gravity,
        inertial=inertial,
        asked=smooth(asked_torque(log, run, _speed(run, smooth(q, 1)))),
        read=smooth(run.joint["tau"]) if "tau" in run.joint else blank,
    )


def _speed(run: LogRun, by_angle: np.ndarray) -> np.ndarray:
    """Speed that a drive reads [rad/s], (N, J): as logged, else that of the angle."""
    logged = run.joint.get("qd")
    return by_angle if logged is None else np.where(np.isfinite(logged), logged, by_angle)
