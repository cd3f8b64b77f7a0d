"""A robot whose root stands still, with each current at once: its joints follow a motion, or it is pushed.

An arm is pushed at its last link; a leg on a rail at its carriage, which slides while the foot stands on the ground.

Joints without a foot have no gates: their devices get the current, damp while they turn and hold where they are slow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import warp as wp

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.enums import Coupling, ZStep
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.env.sim import ActuatedSim
from mrwarp.env.sim_model import Scene, build_scene
from mrwarp.paper import GRAVITY
from mrwarp.runtime import panels
from mrwarp.usd.asset import RobotAsset

AMPLITUDE, FREQUENCY = 0.3, 0.5
"""Motion of every joint about the neutral stance, where its limits allow it [rad, Hz]; neighbours a quarter shifted."""

SETTLE = 2.0
"""Time to come to rest before a push [s]."""


@dataclass(frozen=True, kw_only=True)
class ArmTrace:
    """Motion of an arm with C currents; J joints, T samples at 200 Hz."""

    t: np.ndarray
    """Time [s], shape (T,); of a push, since it began."""
    q_des: np.ndarray
    """Targets [rad], shape (T, J)."""
    q: np.ndarray
    """Angles [rad], shape (C, T, J)."""
    qd: np.ndarray
    """Speeds [rad/s], shape (C, T, J)."""
    tau_motor: np.ndarray
    """Torques of the motors [N·m], shape (C, T, J)."""
    end: np.ndarray
    """Centre of mass of the last link, or of the carriage on a rail [m], shape (C, T, 3)."""


def has_rail(asset: RobotAsset) -> bool:
    """Whether it slides on a rail."""
    return bool(asset.stage.GetPrimAtPath(asset.stage.GetDefaultPrim().GetPath().AppendChild("rails")))


def is_arm(asset: RobotAsset) -> bool:
    """Whether a robot has no legs to walk with."""
    return not asset.layout.legs


def rails(model: mujoco.MjModel) -> list[int]:
    """The joints that slide: those of a rail, the last one bears the carriage."""
    return [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE]


def watched(model: mujoco.MjModel) -> int:
    """The body that is pushed and followed: the carriage, else the last link."""
    return int(model.jnt_bodyid[rails(model)[-1]]) if rails(model) else model.nbody - 1


def on_the_ground(scene: Scene) -> np.ndarray:
    """The neutral stance, shape (nq,); a rail that is not level is moved until the lowest shape touches the ground."""
    model, data = scene.model, mujoco.MjData(scene.model)
    data.qpos[scene.q_adr] = scene.layout.default_q
    mujoco.mj_kinematics(model, data)
    for j in rails(model):
        up = float(data.xaxis[j, 2])
        solid = (model.geom_contype | model.geom_conaffinity).astype(bool)
        moving = [g for g in np.flatnonzero(solid) if model.body_weldid[model.geom_bodyid[g]]]
        if abs(up) > 0.5 and moving:
            lowest = min(data.geom_xpos[g, 2] - _below(model, int(g), data.geom_xmat[g, 6:]) for g in moving)
            data.qpos[model.jnt_qposadr[j]] -= lowest / up
            break
    return data.qpos.copy()


def _below(model: mujoco.MjModel, geom: int, up: np.ndarray) -> float:
    """How far a shape reaches below its centre [m]; ``up``: the vertical in its frame, shape (3,)."""
    size, kind = model.geom_size[geom], model.geom_type[geom]
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return float(size[0] + abs(up[2]) * size[1])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return float(size[0] * np.hypot(up[0], up[1]) + abs(up[2]) * size[1])
    centre, half = np.split(model.geom_aabb[geom], 2)
    return float(np.abs(up) @ half - up @ centre)


def default_push(asset: RobotAsset) -> tuple[float, float, float]:
    """The weight of what moves [N], world frame: down on a rail's carriage, across an arm's last link.

    An arm that hangs down or stands up does not move when it is pushed along itself, so it is pushed in the direction
    in which that link's centre of mass is accelerated most: the largest axis of ``J M^-1 J^T``, downwards or forwards.
    """
    if has_rail(asset):
        return 0.0, 0.0, -weight(asset)
    scene = build_scene(asset, dt=0.005, ground=False)
    model, data = scene.model, mujoco.MjData(scene.model)
    data.qpos[scene.q_adr] = scene.layout.default_q
    mujoco.mj_forward(model, data)
    jacobian, solved = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacBodyCom(model, data, jacobian, None, watched(model))
    mujoco.mj_solveM(model, data, solved, jacobian)
    axis = np.linalg.eigh(jacobian @ solved.T)[1][:, -1]
    largest = float(axis[np.argmax(np.abs(axis))])
    axis = axis * (-np.sign(axis[2]) if abs(axis[2]) > 0.1 else np.sign(largest))
    x, y, z = (weight(asset) * axis).tolist()
    return x, y, z


def sine(scene: Scene) -> Callable[[float], np.ndarray]:
    """Targets [rad], shape (J,), at a time [s]: a sine at every joint."""
    neutral = np.array(scene.layout.default_q)
    joints = scene.model.dof_jntid[scene.v_adr]
    low, high = scene.model.jnt_range[joints].T
    free = ~scene.model.jnt_limited[joints].astype(bool)
    room = np.where(free, AMPLITUDE, np.minimum(high - neutral, neutral - low))
    amplitude = np.clip(0.9 * room, 0.0, AMPLITUDE)
    begin = 0.5 * np.pi * np.arange(len(neutral))
    return lambda t: neutral + amplitude * (np.sin(2.0 * np.pi * FREQUENCY * t + begin) - np.sin(begin) * np.exp(-t))


def move(
    asset: RobotAsset,
    currents: Sequence[float],
    *,
    seconds: float,
    coupling: Coupling = Coupling.CONSTRAINT,
    z_step: ZStep = ZStep.EXACT,
    target: Callable[[Scene], Callable[[float], np.ndarray]] | None = None,
    force: Sequence[float] | None = None,
    duration: float = 0.2,
) -> tuple[Scene, ArmTrace]:
    """Let it follow its targets, or push it while it keeps its stance.

    Args:
        asset: The arm, or the leg on a rail.
        currents: Current of the devices in each copy [A].
        seconds: Time that is recorded [s].
        coupling: How the devices act.
        z_step: Step of the hysteresis state.
        target: Targets over time; None keeps the neutral stance, :data:`SETTLE` before the record begins.
        force: Push at the last link's or the carriage's centre of mass [N], world frame; None is no push.
        duration: How long the push lasts [s].
    """
    scene = build_scene(asset, dt=0.005, coupling=coupling, ground=has_rail(asset))
    sim = ActuatedSim(scene, SimCfg(num_envs=len(currents)), MrActuatorCfg(coupling=coupling, z_step=z_step))
    count, neutral = len(currents), np.array(scene.layout.default_q)
    qpos = np.tile(on_the_ground(scene), (count, 1))
    sim.reset(None, wp.array(qpos, dtype=float), None)
    sim.current_e.assign(np.array(currents, dtype=np.float32))
    at = target(scene) if target else lambda _: neutral
    body = watched(scene.model)
    last = scene.model.body(body).name
    data, rows = mujoco.MjData(scene.model), []

    def step(t: float) -> np.ndarray:
        wanted = at(t)
        sim.q_des.assign(np.tile(wanted, (count, 1)).astype(np.float32))
        sim.step()
        return wanted

    if target is None:
        for _ in range(round(SETTLE / 0.005)):
            step(0.0)
    steps, pushed = round(seconds / 0.005), round(duration / 0.005)
    for k in range(steps):
        if force is not None and k in (0, pushed):
            sim.sim.push(last, np.tile(np.array(force) * (k == 0), (count, 1)))
        wanted = step((k + 1) * 0.005)
        ends = []
        for state in sim.sim.backend.field("qpos").numpy():
            data.qpos[:] = state
            mujoco.mj_kinematics(scene.model, data)
            mujoco.mj_comPos(scene.model, data)
            ends.append(data.xipos[body].copy())
        state = (sim.sim.q, sim.sim.qd, sim.actuator.tau_motor)
        rows.append((wanted, *(array.numpy().copy() for array in state), np.array(ends)))
    q_des, *others = (np.array(values) for values in zip(*rows, strict=True))
    q, qd, tau, end = (np.swapaxes(values, 0, 1) for values in others)
    t = (1 + np.arange(steps)) * 0.005
    return scene, ArmTrace(t=t, q_des=q_des, q=q, qd=qd, tau_motor=tau, end=end)


def weight(asset: RobotAsset) -> float:
    """Weight of what moves [N]."""
    model = build_scene(asset, dt=0.005, ground=False).model
    return GRAVITY * float(model.body_mass[model.body_dofnum[model.body_weldid] > 0].sum())


def figures(scene: Scene, trace: ArmTrace, currents: Sequence[float]) -> list[dict[str, Any]]:
    """Of each current: the last link's largest way and speed, and of each joint error, speed and torque."""
    way = np.linalg.norm(trace.end - trace.end[:, :1], axis=-1)
    speed = np.linalg.norm(np.diff(trace.end, axis=1), axis=-1) / (trace.t[1] - trace.t[0])
    error = trace.q - trace.q_des
    names = scene.joints
    return [
        {
            "current": current,
            "end_way": float(way[i].max()),
            "end_speed": float(speed[i].max()),
            "q_rmse": dict(zip(names, np.sqrt((error[i] ** 2).mean(0)).tolist(), strict=True)),
            "peak_speed": dict(zip(names, np.abs(trace.qd[i]).max(0).tolist(), strict=True)),
            "peak_motor_torque": dict(zip(names, np.abs(trace.tau_motor[i]).max(0).tolist(), strict=True)),
        }
        for i, current in enumerate(currents)
    ]


def lines(rows: Sequence[dict[str, Any]], what: str = "last link") -> list[str]:
    """A line per current."""
    return [
        f"{row['current']:g} A: {what} {1e3 * row['end_way']:.1f} mm, {row['end_speed']:.3f} m/s; "
        + ", ".join(f"{joint} {row['q_rmse'][joint]:.4f} rad RMS" for joint in row["q_rmse"])
        for row in rows
    ]


def picture(scene: Scene, trace: ArmTrace, currents: Sequence[float], path: Path, title: str) -> None:
    """Angle and motor torque of every joint with every current, as PNG."""
    figure, axes = panels((10, 1.2 + 2.0 * len(scene.joints)), len(scene.joints), 2, sharex=True)
    for k, (name, (angle, torque)) in enumerate(zip(scene.joints, axes, strict=True)):
        angle.plot(trace.t, trace.q_des[:, k], color="0.4", linestyle="--", label="target")
        for i, current in enumerate(currents):
            angle.plot(trace.t, trace.q[i, :, k], label=f"{current:.4g} A")
            torque.plot(trace.t, trace.tau_motor[i, :, k])
        angle.set_ylabel(f"{name} [rad]")
        torque.set_ylabel("motor torque [N·m]")
    axes[0][0].legend(fontsize=8)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=110)
