"""The torque that joints with a device need to stand, to trot and under a push, next to what the device bears."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mrwarp.env.sim_model import Scene
from mrwarp.model_file import Effect
from mrwarp.paper import GRAVITY
from mrwarp.params import MrParams
from mrwarp.usd.asset import JointActuator
from mrwarp.usd.robot import MASS

PUSH = 100.0
"""Push down on the trunk of a robot of :data:`mrwarp.usd.robot.MASS` [N], as 'mrwarp impact' gives it."""

SWITCHES = 4.0
"""Switches of a device's gates in a stride without chatter: each of the two opens and closes once."""


@dataclass(frozen=True, kw_only=True)
class Need:
    """Torques of one joint with a device [N·m]."""

    joint: str
    standing: float
    """On all legs, at rest in the neutral stance."""
    trotting: float
    """On the legs of half a gait alone, whichever need more."""
    pushed: float
    """On those legs under the push."""
    holds: float
    """Most that the device holds, eq. 18 at its largest current."""
    slides: float
    """Torque of the slow sliding device at that current."""


def needs(scene: Scene) -> list[Need]:
    """Statics of the neutral stance: gravity, and feet that bear the weight as evenly as balance allows.

    Nothing for a robot that does not stand on legs, or without devices.
    """
    devices = [(j, a.mr, a.effects) for j, a in enumerate(scene.actuators) if a.mr is not None]
    if not devices or not scene.layout.legs or not scene.floating:
        return []
    push = PUSH * float(scene.model.body_mass.sum()) / MASS
    phases = np.array([leg.phase % 1.0 for leg in scene.layout.legs])
    halves = [np.flatnonzero((phases < 0.5) == early) for early in (True, False)]
    everyone = np.arange(len(phases))
    standing = _torques(scene, everyone, 0.0)
    trotting, pushed = (
        np.max([_torques(scene, feet, extra) for feet in halves if len(feet)], axis=0) for extra in (0.0, push)
    )
    return [
        Need(
            joint=scene.actuators[j].joint,
            standing=float(standing[j]),
            trotting=float(trotting[j]),
            pushed=float(pushed[j]),
            holds=float(mr.hold.yield_torque(mr.coil.current_max)),
            slides=slides(mr, effects),
        )
        for j, mr, effects in devices
    ]


def slides(mr: MrParams, effects: Sequence[Effect]) -> float:
    """Torque of a device that slides slowly at its largest current [N·m]."""
    top = mr.coil.current_max
    u = next((effect.values["u"] for effect in effects if effect.name == "current_saturation"), 0.0)
    return mr.bouc_wen.sliding_torque(float(np.tanh(u * top) / u) if u else top)


def need_lines(scene: Scene) -> Iterator[str]:
    """For a user: a line per kind of device with the largest needs of its joints; a warning where it is too weak."""
    found: dict[tuple[float, float], list[Need]] = {}
    for need in needs(scene):
        found.setdefault((need.holds, need.slides), []).append(need)
    for (holds, slow), group in found.items():
        joints = ", ".join(need.joint for need in group)
        standing, trotting, pushed = (max(getattr(n, x) for n in group) for x in ("standing", "trotting", "pushed"))
        yield (
            f"{joints}: the joint needs {standing:.3g} N·m to stand, {trotting:.3g} N·m on half of the legs, "
            f"{pushed:.3g} N·m there under a push; the device holds {holds:.3g} N·m and slides at {slow:.3g} N·m"
        )
        if holds < trotting:
            yield (
                f"warning: {joints}: the device holds less than the joint needs while walking: it slips, its gates "
                "open and close many times a stride, and the motor bears the rest"
            )


def chatter(actuators: Sequence[JointActuator], switches: float, stride: float) -> str:
    """Warning for gates that switch more than twice as often as a gait asks for; else empty.

    Args:
        actuators: The robot's joints.
        switches: Mean switches of a device's gates per second [1/s].
        stride: Strides per second [1/s].
    """
    asked = SWITCHES * stride
    if not any(a.mr for a in actuators) or not switches > 2.0 * asked:
        return ""
    return (
        f"warning: the gates of a device switch {switches:.3g} times per second, a gait of {stride:.3g} Hz asks for "
        f"{asked:.3g}: the device slips out of its hold, or the thresholds of eqs. 5 and 8 do not fit the robot"
    )


def _torques(scene: Scene, feet: np.ndarray, push: float) -> np.ndarray:
    """Size of each joint's torque with the weight, and a push down on the trunk, on these feet [N·m], shape (J,)."""
    model, data = scene.model, mujoco.MjData(scene.model)
    data.qpos[:] = model.qpos0
    data.qpos[:3] = 0.0
    data.qpos[scene.q_adr] = scene.layout.default_q
    mujoco.mj_forward(model, data)
    mass, com = float(model.body_mass.sum()), data.subtree_com[0]
    centre = (GRAVITY * mass * com[:2] + push * data.qpos[:2]) / (GRAVITY * mass + push)
    points = scene.soles[feet]
    balance = np.stack([np.ones(len(points)), points[:, 0] - centre[0], points[:, 1] - centre[1]])
    wanted, even = np.array([GRAVITY * mass + push, 0.0, 0.0]), np.full(len(points), 1.0)
    even *= wanted[0] / len(points)
    forces = even + np.linalg.lstsq(balance, wanted - balance @ even, rcond=None)[0]
    torque, jacobian = data.qfrc_bias.copy(), np.zeros((3, model.nv))
    for foot, point, force in zip(scene.feet[feet], points, forces, strict=True):
        mujoco.mj_jac(model, data, jacobian, None, point, model.geom_bodyid[foot])
        torque -= force * jacobian[2]
    return np.abs(torque[scene.v_adr])
