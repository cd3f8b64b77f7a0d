"""The virtual robot: plain MuJoCo at 0.5 ms, elliptic friction cones, joints that give a little, drives as torques.

Nothing here is shared with the replay of the diagnosis but the robot's description: a log of a healthy robot is not
reproduced exactly by it. Joints have an elastic element between motor and link; drives compute their torque at every
step from what the sensors say; MR devices are integrated outside the physics, with eqs. 8, 14, 15 and 18 of the paper
in NumPy.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mrwarp.robot_logs.virtual.described_robot import STEP, Description
from mrwarp.robot_logs.virtual.hidden_effects import Hidden
from mrwarp.runtime import silent

GIVE = 0.008
"""How far a joint's elastic element is wound by the largest torque of its motor [rad]."""

GIVE_DAMPING = 0.05
"""Damping ratio of the rotor on it."""

LATENCY = 0.001
"""Time from reading the sensors to the torque that the command asks for, on a healthy robot [s]."""

STRIBECK_SPEED = 0.15
"""Speed at which Stribeck's friction has faded to 1/e [rad/s]."""

PLAY = " gives"
"""Suffix of the joint between motor and link."""


@dataclass(kw_only=True)
class Command:
    """The controller's commands to the drives; J joints, M devices."""

    q_des: np.ndarray
    """[rad], shape (J,)."""
    kp: np.ndarray
    """[N·m/rad], shape (J,)."""
    kd: np.ndarray
    """[N·m·s/rad], shape (J,)."""
    coil: np.ndarray
    """[A], shape (M,)."""
    hold: np.ndarray
    """Whether each device is asked to hold, shape (M,)."""


@dataclass(kw_only=True)
class _Faults:
    """Hidden effects as numbers per joint or device."""

    joints: int
    devices: int
    strength: np.ndarray = field(init=False)
    cap: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        j, m = self.joints, self.devices
        self.strength, self.cap = np.ones(j), np.full(j, np.inf)
        self.kp, self.kd, self.offset, self.lag, self.stribeck = np.ones(j), np.ones(j), *np.zeros((3, j))
        self.torque_lag, self.command_lag, self.compensated = np.zeros((3, j))
        self.tau_offset, self.tau_gravity = np.zeros((2, j))
        self.tau_gain = np.ones(j)
        self.dead, self.memoryless = np.zeros(m, bool), np.zeros(m, bool)
        self.coil_lag, self.device, self.drag = np.zeros(m), np.ones(m), np.zeros(m)


class TrueRobot:
    """A simulated robot with hidden effects; J joints, M devices, L legs.

    Args:
        description: The robot; its specification is copied.
        hidden: Effects.
        fixed: The trunk is held in the air, level, and touches nothing.
        rng: Draws the gusts of wind and the session's offsets.
        session: Largest offset between command and joint, and of an encoder, in this session [rad].
    """

    def __init__(
        self,
        description: Description,
        hidden: list[Hidden],
        *,
        fixed: bool,
        rng: np.random.Generator,
        session: float = 0.004,
    ) -> None:
        self.description, self.fixed = description, fixed
        self.hidden = {h.cause: [x for x in hidden if x.cause == h.cause] for h in hidden}
        joints = len(description.joints)
        self.faults = self._faults(joints)
        # half of what differs from session to session is the encoder's zero, half the drive's
        draws = (
            np.clip(rng.normal(0.0, 0.5 * session, (2, joints)), -session, session)
            if session
            else np.zeros((2, joints))
        )
        self.encoder_zero, self.drive_zero = 0.7 * draws
        self.model = self._compiled()
        self.data = mujoco.MjData(self.model)
        ids = [self.model.joint(name).id for name in description.joints]
        self.q_adr, self.v_adr = self.model.jnt_qposadr[ids], self.model.jnt_dofadr[ids]
        self.trunk = self.model.body(description.trunk).id
        self.feet = np.array([self.model.geom(name).id for name in description.feet], dtype=int)
        self.friction = self.model.dof_frictionloss[self.v_adr].copy()
        self._pending: deque[tuple[float, Command]] = deque()
        self._command: Command | None = None
        self._gusts = np.cumsum(rng.uniform(2.0, 5.0, 400))
        d = description.devices
        self._slot = np.array([x.joint for x in d], dtype=int)
        values = [x.params.to_dict() for x in d]
        self._p = {name: np.array([v[name] for v in values]) for name in values[0]} if d else {}
        self.reset()

    def _faults(self, joints: int) -> _Faults:
        names, devices = self.description.joints, [self.description.joints[d.joint] for d in self.description.devices]
        found = _Faults(joints=joints, devices=len(devices))
        arrays = {
            "motor_strength": found.strength, "torque_limit": found.cap, "kp": found.kp, "kd": found.kd,
            "encoder_offset": found.offset, "velocity_lag": found.lag, "stribeck": found.stribeck,
            "torque_lag": found.torque_lag, "command_lag": found.command_lag, "gravity_compensation": found.compensated,
            "torque_channel_offset": found.tau_offset, "torque_channel_gain": found.tau_gain,
            "torque_channel_gravity": found.tau_gravity,
        }  # fmt: skip
        of_devices = {
            "coil_dead": found.dead, "hysteresis_law": found.memoryless, "coil_lag": found.coil_lag,
            "device_strength": found.device, "device_drag": found.drag,
        }  # fmt: skip
        for cause, array in arrays.items():
            for h in self.hidden.get(cause, []):
                array[names.index(h.where)] = h.value
        for cause, array in of_devices.items():
            for h in self.hidden.get(cause, []):
                array[devices.index(h.where)] = h.value
        return found

    def _one(self, cause: str) -> tuple[float, ...] | None:
        return self.hidden[cause][0].values if cause in self.hidden else None

    def _compiled(self) -> mujoco.MjModel:
        """The model with what needs other bodies or joints; numbers of the compiled model are set afterwards."""
        spec, d = self.description.spec.copy(), self.description
        for item in [*spec.actuators, *spec.sensors, *spec.keys]:
            spec.delete(item)
        if self.fixed:
            for joint in [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]:
                spec.delete(joint)
        spec.option.timestep, spec.option.cone = STEP, mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICIT
        spec.option.impratio, spec.option.iterations, spec.option.ls_iterations = 10.0, 30, 60
        if self.fixed:
            spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        else:
            self._ground(spec)
        armature = self._armature()
        soft = self._soft(spec)
        for k, name in enumerate(d.joints):
            self._flexible(spec, name, armature[k], d.limit[k], soft.get(name))
        for h in self.hidden.get("link_length", []):
            _lengthen(spec.body(h.where), h.value)
        if (tail := self._one("tail_weight")) is not None:
            _hang_tail(spec.body(d.trunk), tail[0])
        with silent():
            model = spec.compile()
        self._numbers(model, armature)
        return model

    def _armature(self) -> np.ndarray:
        own = {joint.name: float(joint.armature) for joint in self.description.spec.joints}
        found = np.array([own[name] for name in self.description.joints])
        for h in self.hidden.get("rotor_inertia", []):
            found[self.description.joints.index(h.where)] += h.value
        return np.maximum(found, 1e-5)

    def _ground(self, spec: mujoco.MjSpec) -> None:
        """A plane that every foot touches, and nothing else does."""
        for geom in list(spec.worldbody.geoms):
            spec.delete(geom)
        slope = self._one("ground_slope") or (0.0, 0.0)
        turn = np.roll(Rotation.from_euler("xyz", [*slope, 0.0]).as_quat(), 1)
        plane = spec.worldbody.add_geom(
            name="true ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[100.0, 100.0, 1.0], quat=turn
        )
        plane.contype, plane.conaffinity = 1, 0
        for geom in spec.geoms:
            if geom.name != plane.name:
                geom.contype, geom.conaffinity = 0, int(geom.name in self.description.feet)

    def _soft(self, spec: mujoco.MjSpec) -> dict[str, float]:
        """Stiffness of elastic drives by joint [N·m/rad]; a base that gives way gets two hinges on springs."""
        rigid, d = spec.copy().compile(), self.description
        data, column = mujoco.MjData(rigid), np.zeros(rigid.nv)
        ids = [rigid.joint(name).id for name in d.joints]
        data.qpos[rigid.jnt_qposadr[ids]] = d.neutral
        mujoco.mj_forward(rigid, data)
        found = {}
        for h in self.hidden.get("series_elasticity", []):
            v = rigid.jnt_dofadr[rigid.joint(h.where).id]
            mujoco.mj_mulM(rigid, data, column, np.eye(rigid.nv)[v])
            found[h.where] = float(column[v] - rigid.dof_armature[v]) * (2.0 * np.pi * h.value) ** 2
        if (rocks := self._one("base_compliance")) is not None:
            if d.trunk == "world" or not self.fixed:
                raise ValueError("--hide base_compliance: for a held robot whose first link is no part of the world")
            arms = data.xipos[1:] - data.xpos[rigid.body(d.trunk).id]
            inertia = float((rigid.body_mass[1:, None] * arms**2).sum() + rigid.body_inertia[1:, 0].sum())
            for k in range(2):
                hinge = spec.body(d.trunk).add_joint(name=f"base about {'xy'[k]}", axis=np.eye(3)[k])
                hinge.stiffness[0] = inertia * (2.0 * np.pi * rocks[0]) ** 2
                hinge.damping[0] = 0.1 * inertia * 2.0 * np.pi * rocks[0]
        return found

    def _flexible(
        self, spec: mujoco.MjSpec, name: str, armature: float, limit: float, soft: float | None = None
    ) -> None:
        """A second joint behind the motor's, about the same axis: an elastic element, or play between stops."""
        motor = spec.joint(name)
        half = next((h.value for h in self.hidden.get("backlash", []) if h.where == name), 0.0)
        stiffness = soft or max(limit, 1e-3) / GIVE
        if armature < 1e-4 or stiffness / armature > (0.5 / STEP) ** 2:
            if not half and not soft:
                return  # a rotor as light as this would need a finer step
            armature = 1e-3
            motor.armature = armature
        give = motor.parent.add_joint(name=name + PLAY, type=motor.type, axis=motor.axis, pos=motor.pos)
        give.damping[0] = 2.0 * GIVE_DAMPING * np.sqrt(stiffness * armature)
        if half:
            give.limited, give.range = mujoco.mjtLimited.mjLIMITED_TRUE, [-half, half]
            give.solref_limit = [-stiffness / armature, -2.0 * 0.3 * np.sqrt(stiffness / armature)]
        else:
            give.stiffness[0] = stiffness

    def _numbers(self, model: mujoco.MjModel, armature: np.ndarray) -> None:
        d = self.description
        v = model.jnt_dofadr[[model.joint(name).id for name in d.joints]]
        model.dof_armature[v] = armature
        for cause, array in (("coulomb_friction", model.dof_frictionloss), ("viscous_friction", model.dof_damping)):
            for h in self.hidden.get(cause, []):
                array[v[d.joints.index(h.where)]] += h.value
        # dry friction and brakes that creep at less than 1 mrad/s under the robot's weight
        model.dof_solref[v], model.dof_solimp[v] = (0.008, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)
        for cause in ("trunk_mass", "link_mass"):
            for h in self.hidden.get(cause, []):
                body = model.body(h.where).id
                mass = model.body_mass[body] + h.value
                if mass <= 0.0:
                    raise ValueError(
                        f"--hide {cause}={h.value:g}: {h.where} has {model.body_mass[body]:.3g} kg; take less away"
                    )
                model.body_inertia[body] *= mass / model.body_mass[body]
                model.body_mass[body] = mass
        for frames in (model.body_sameframe, model.geom_sameframe, model.site_sameframe):
            frames[:] = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)  # else a centre at the origin stays there
        for h in self.hidden.get("link_com", []):
            body = model.body(h.where).id
            model.body_ipos[body] += np.array(h.values) / model.body_mass[body]
        if (com := self._one("trunk_com")) is not None:
            model.body_ipos[model.body(d.trunk).id] += com
        if not self.fixed:
            touching = [model.geom(name).id for name in (*d.feet, "true ground")]
            model.geom_solref[touching] = (0.012, 1.1)
            model.geom_solimp[touching, :3] = (0.9, 0.98, 0.002)
            factor = (self._one("ground_stiffness") or (1.0,))[0]
            model.geom_solref[touching, 0] /= np.sqrt(factor)
            for h in self.hidden.get("soft_foot", []):
                foot = model.geom(d.feet[list(d.places.legs).index(h.where)]).id
                model.geom_solref[foot, 0] /= np.sqrt(h.value)
                model.geom_priority[foot] += 1
            model.geom_friction[touching, 0] = model.geom_friction[touching[:-1], 0].max()
            if (mu := self._one("ground_friction")) is not None:
                model.geom_friction[touching, 0] = mu[0]
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def reset(self) -> None:
        """Rest in the neutral pose; the soles of a robot that is not fixed touch the ground."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[self.q_adr] = self.description.neutral
        if not self.fixed:
            self.data.qpos[:7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
            mujoco.mj_kinematics(self.model, self.data)
            soles = self.data.geom_xpos[self.feet, 2] - self.model.geom_size[self.feet, 0]
            slope = self._one("ground_slope") or (0.0, 0.0)
            self.data.qpos[2] = -float(soles.min()) + 0.3 * float(np.abs(slope).sum())
        mujoco.mj_forward(self.model, self.data)
        m = len(self.description.devices)
        self.z, self.current, self.coil = np.zeros(m), np.zeros(m), np.zeros(m)
        self.speed = np.zeros(len(self.description.joints))
        self.torque = np.zeros(len(self.description.joints))
        self.target = np.full(len(self.description.joints), np.nan)
        self._pending.clear()
        self._command = None

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.data.time)

    @property
    def q(self) -> np.ndarray:
        """Readings of the encoders at the motors [rad]."""
        return self.data.qpos[self.q_adr] + self.faults.offset + self.encoder_zero

    @property
    def gravity(self) -> np.ndarray:
        """Torque of gravity at the joints, by its own links, as if nothing touched them [N·m], shape (J,)."""
        model, still = self.model, mujoco.MjData(self.model)
        still.qpos[:] = self.data.qpos
        mujoco.mj_kinematics(model, still)
        mujoco.mj_comPos(model, still)
        found = np.zeros(model.nv)
        mujoco.mj_rne(model, still, 0, found)
        return found[self.v_adr]

    @property
    def torque_reading(self) -> np.ndarray:
        """Reading of the torque channel [N·m], shape (J,)."""
        f = self.faults
        weight = f.tau_gravity * self.gravity if f.tau_gravity.any() else 0.0
        return f.tau_gain * self.torque + f.tau_offset + weight

    def foot_forces(self) -> np.ndarray:
        """Norm of the contact force of each foot [N], shape (L,)."""
        found, wrench = np.zeros(len(self.feet)), np.zeros(6)
        for k in range(self.data.ncon):
            mujoco.mj_contactForce(self.model, self.data, k, wrench)
            geoms = self.data.contact.geom[k]
            found[np.isin(self.feet, geoms)] += float(np.linalg.norm(wrench[:3]))
        return found

    def send(self, command: Command) -> None:
        """Give a command; it acts after the robot's latency."""
        late = LATENCY + (self._one("command_delay") or (0.0,))[0]
        self._pending.append((self.time + late - 0.25 * STEP, command))
        if self._command is None:
            self._command = command

    def advance(self, seconds: float) -> None:
        """Simulate, under the commands that were sent."""
        for _ in range(round(seconds / STEP)):
            while self._pending and self._pending[0][0] <= self.time:
                self._command = self._pending.popleft()[1]
            self._step()

    def _step(self) -> None:
        c, f, model, data = self._command, self.faults, self.model, self.data
        assert c is not None
        qd = data.qvel[self.v_adr]
        self.speed += _share(f.lag) * (qd - self.speed)
        self.target = np.where(np.isnan(self.target), c.q_des, self.target)
        self.target += _share(f.command_lag) * (c.q_des - self.target)
        error = self.target - self.q + self.drive_zero
        torque = f.kp * c.kp * error - f.kd * c.kd * self.speed
        if f.compensated.any():
            torque = torque + f.compensated * self.gravity
        limit = self.description.limit
        torque = np.clip(f.strength * np.clip(torque, -limit, limit), -f.cap, f.cap)
        self.torque = self.torque + _share(f.torque_lag) * (torque - self.torque)
        data.qfrc_applied[self.v_adr] = self.torque
        dry = self.friction + f.stribeck * np.exp(-((qd / STRIBECK_SPEED) ** 2))
        if len(self._slot):
            dry[self._slot] += self._device_bound(c, qd[self._slot])
        model.dof_frictionloss[self.v_adr] = dry
        self._outside()
        mujoco.mj_step(model, data)

    def _device_bound(self, c: Command, qd: np.ndarray) -> np.ndarray:
        """Largest torque that each device bears [N·m]: eqs. 14 and 15, and eq. 18 while it holds."""
        p, f = self._p, self.faults
        constant = p["coil_time_constant"] + f.coil_lag
        share = np.where(constant > 0.0, 1.0 - np.exp(-STEP / np.maximum(constant, 1e-6)), 1.0)
        self.coil += share * (np.where(f.dead, 0.0, c.coil) - self.coil)
        amps = self.coil
        u, rate = self.z, p["beta"] * np.abs(qd) + p["gamma"] * qd * np.sign(self.z)
        self.z = (u + STEP * qd) / (1.0 + STEP * rate)  # implicit: stable for any speed
        bound = 1.0 / (p["beta"] + p["gamma"])
        memory = np.where(f.memoryless, bound * 2.0 / np.pi * np.arctan(qd / 0.1), self.z)
        q_c = self.data.qpos[self.q_adr[self._slot]] - p["q_neutral"] - p["q_offset"] - p["q_center"]
        gain = (p["K0"] + f.device * p["K1"] * amps) / (1.0 + p["alpha"] * np.abs(qd))
        sliding = p["D"] + p["B"] * qd + p["C"] * q_c + p["I1"] * amps + gain * memory
        ratio = (amps / p["K"]) ** p["n"]
        held = np.where(c.hold, f.device * p["T_max"] * ratio / (1.0 + ratio), 0.0)
        return np.maximum(np.abs(sliding), held) + f.drag

    def _outside(self) -> None:
        """Forces that no catalogue holds."""
        body = (
            self.trunk
            if not self.fixed
            else int(self.model.jnt_bodyid[self.model.joint(self.description.joints[-1]).id])
        )
        force = np.zeros(3)
        if (pull := self._one("cable_pull")) is not None:
            # anchored 1.2 m over and 0.5 m behind the start; slack below 1.2 m, all of its force 0.5 m beyond
            line = np.array([-0.5, 0.0, 1.2]) - self.data.xpos[body]
            length = float(np.linalg.norm(line))
            force += pull[0] * float(np.clip((length - 1.2) / 0.5, 0.0, 1.5)) * line / length
        if (wind := self._one("wind")) is not None:
            k = int(np.searchsorted(self._gusts, self.time))
            begun = self._gusts[k - 1] if k else 0.0
            if k % 2 == 0:
                force[1] -= wind[0] * np.sin(np.pi * (self.time - begun) / (self._gusts[k] - begun)) ** 2
        if force.any():
            self.data.xfrc_applied[body, :3] = force


def _share(lag: np.ndarray) -> np.ndarray:
    """Share of a change that a first-order lag of these time constants [s] follows in a step; shapes (J,)."""
    return np.where(lag > 0.0, 1.0 - np.exp(-STEP / np.maximum(lag, 1e-6)), 1.0)


def _lengthen(body: mujoco.MjsBody, by: float) -> None:
    """Move what hangs on a body, and its shapes, outwards along the line to the furthest of them."""
    places = [np.array(x.pos) for x in [*body.bodies, *body.geoms]]
    far = max(places, key=lambda p: float(np.linalg.norm(p)))
    length = float(np.linalg.norm(far))
    if length + by <= 0.0:
        raise ValueError(f"--hide link_length={by:g}: {body.name} is {length:.3g} m long; take less away")
    for item in [*body.bodies, *body.geoms]:
        item.pos = np.array(item.pos) * (1.0 + by / length)


def _hang_tail(trunk: mujoco.MjsBody, mass: float) -> None:
    """A weight on a string of 0.12 m at the rear end of the trunk."""
    reach = max((float(-g.pos[0] + g.size[0]) for g in trunk.geoms), default=0.2)
    tail = trunk.add_body(name="tail weight", pos=[-reach - 0.05, 0.0, 0.0])
    tail.mass, tail.ipos, tail.inertia = mass, [0.0, 0.0, -0.12], [1e-4 * mass + 1e-6] * 3
    tail.explicitinertial = True
    for axis in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):
        tail.add_joint(name=f"tail about {'xy'[int(axis[1])]}", axis=axis, damping=[2e-3 * mass, 0.0, 0.0])
