"""The virtual robot: plain MuJoCo at 0.5 ms, elliptic friction cones, joints that give a little, drives as torques.

Nothing here is shared with the replay of the diagnosis but the robot's description: a log of a healthy robot is not
reproduced exactly by it. Joints have an elastic element between motor and link; drives compute their torque at every
step from what the sensors say; MR devices are integrated outside the physics, with eqs. 8, 14, 15 and 18 of the paper
in NumPy.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mrwarp.env.natural_units import Scales, scales
from mrwarp.env.sim_model import build_scene, shape_name
from mrwarp.params import MrParams
from mrwarp.robot_logs.robot_log import LogError
from mrwarp.robot_logs.virtual.hidden_effects import Hidden, Places
from mrwarp.run_dir import no_file, one_line
from mrwarp.runtime import silent
from mrwarp.usd.asset import ROBOT_SUFFIXES, load_robot
from mrwarp.usd.robot import Layout

STEP = 0.0005
"""Physics step [s]."""

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


@dataclass(frozen=True, kw_only=True)
class Device:
    """An MR device at a joint."""

    joint: int
    """Place on the joint axis."""
    leg: int
    params: MrParams


@dataclass(kw_only=True)
class Description:
    """Content of a robot's file."""

    path: Path
    spec: mujoco.MjSpec
    joints: tuple[str, ...]
    kp: np.ndarray
    """[N·m/rad], shape (J,)."""
    kd: np.ndarray
    """[N·m·s/rad], shape (J,)."""
    limit: np.ndarray
    """Largest torque [N·m], shape (J,)."""
    neutral: np.ndarray
    """Stance, or the pose about which a fixed robot moves [rad], shape (J,)."""
    trunk: str
    layout: Layout | None = None
    devices: tuple[Device, ...] = ()
    feet: tuple[str, ...] = ()
    """Shape of each leg's foot."""
    scales: Scales = field(default_factory=Scales)
    """Size of a robot on legs relative to the shipped one's."""

    @property
    def places(self) -> Places:
        """Places in which effects can be hidden."""
        legs = {leg.name: leg.joints for leg in self.layout.legs} if self.layout else {}
        bodies = tuple(b.name for b in self.spec.bodies if b.name not in ("world", self.trunk))
        devices = tuple(self.joints[d.joint] for d in self.devices)
        return Places(joint=self.joints, device=devices, body=bodies, trunk=self.trunk, legs=legs)


def describe(robot: str) -> Description:
    """Read a shipped robot, the USD file of an imported one, or an MJCF or URDF of a robot on a fixed base.

    Raises:
        LogError: it cannot be read, or has no driven joint.
    """
    path = Path(robot)
    if path.suffix in ROBOT_SUFFIXES or robot in ("mr_go", "go1"):
        return _described_usd(robot)
    if not path.is_file():
        raise LogError(
            f"{path}: {no_file(path, 'robot')}; name mr_go, go1, a .usda file of 'mrwarp robot import', "
            "or the MJCF or URDF of an arm"
        )
    try:
        with silent():
            spec = mujoco.MjSpec.from_file(str(path))
            model = spec.compile()
    except Exception as error:  # MuJoCo raises several types
        raise LogError(f"{path}: MuJoCo cannot read it ({one_line(error)}); correct it there") from None
    if any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints):
        raise LogError(f"{path}: its base floats; bring it in with 'mrwarp robot import' and name the .usda file")
    return _described_arm(path, spec, model)


def _described_usd(robot: str) -> Description:
    asset = load_robot(robot=robot)
    kept: list[mujoco.MjSpec] = []
    with silent():
        scene = build_scene(asset, dt=STEP, ground=False, edit=lambda spec: kept.append(spec.copy()))
    spec, layout = kept[0], asset.layout
    drives = asset.actuators
    root = next((b.name.removesuffix(layout.trunk) for b in spec.bodies if b.name.endswith(f"_{layout.trunk}")), "")
    for body in spec.bodies:  # Newton joins USD paths with underscores
        if body.name != "world":
            body.name = body.name.removeprefix(root)
    for exclude in list(spec.excludes):  # by the bodies' old names; only feet touch anything here
        spec.delete(exclude)
    for joint in spec.joints:
        joint.name = next((a.joint for a in drives if joint.name.endswith("_" + a.joint)), joint.name)
    feet = tuple(next(g.name for g in spec.geoms if shape_name(g.name) == leg.foot) for leg in layout.legs)
    floats = (j.parent.name for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE)
    trunk = next(floats, None) or _bearer(spec.joint(drives[0].joint)).name
    legs = [next((k for k, leg in enumerate(layout.legs) if a.joint in leg.joints), 0) for a in drives]
    return Description(
        path=Path(robot),
        spec=spec,
        joints=tuple(a.joint for a in drives),
        kp=np.array([a.kp for a in drives]),
        kd=np.array([a.kd for a in drives]),
        limit=np.array([a.tau_limit for a in drives]),
        neutral=np.array([layout.neutral[a.joint] for a in drives]),
        trunk=trunk,
        feet=feet,
        layout=layout if feet else None,
        scales=scales(scene) if feet else Scales(),
        devices=tuple(Device(joint=j, leg=legs[j], params=a.mr) for j, a in enumerate(drives) if a.mr is not None),
    )


def _bearer(joint: mujoco.MjsJoint) -> mujoco.MjsBody:
    """The body before that of a joint."""
    return joint.parent.parent


def _described_arm(path: Path, spec: mujoco.MjSpec, model: mujoco.MjModel) -> Description:
    """An arm whose joints are driven by its position actuators, else with gains by the inertia that each moves."""
    hinge = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]
    if not hinge:
        raise LogError(f"{path}: there is no hinge that could be driven; name another robot")
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    inertia = model.dof_M0
    kp, kd, limit, neutral = (np.zeros(len(hinge)) for _ in range(4))
    for k, j in enumerate(hinge):
        v, q = int(model.jnt_dofadr[j]), int(model.jnt_qposadr[j])
        own = [
            a
            for a in range(model.nu)
            if model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT and model.actuator_trnid[a, 0] == j
        ]
        kp[k] = 60.0 * inertia[v]  # without a gain: a drive of some 8 rad/s, well damped
        kd[k], limit[k] = 2.0 * np.sqrt(kp[k] * inertia[v]), 0.6 * kp[k] + np.abs(data.qfrc_bias[v]) * 2.0
        for a in own:
            if model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_AFFINE and model.actuator_gainprm[a, 0] > 0.0:
                kp[k], kd[k] = model.actuator_gainprm[a, 0], max(-model.actuator_biasprm[a, 2], 0.0)
                kd[k] = kd[k] or 2.0 * np.sqrt(kp[k] * inertia[v])
            if model.actuator_forcelimited[a]:
                limit[k] = abs(model.actuator_forcerange[a, 1])
            elif model.actuator_ctrllimited[a] and model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE:
                limit[k] = abs(model.actuator_gainprm[a, 0] * model.actuator_ctrlrange[a, 1])
        if model.jnt_actfrclimited[j]:
            limit[k] = min(limit[k], abs(model.jnt_actfrcrange[j, 1]))
        low, high = model.jnt_range[j] if model.jnt_limited[j] else (-np.pi, np.pi)
        neutral[k] = float(np.clip(data.qpos[q], low + 0.2 * (high - low), high - 0.2 * (high - low)))
    return Description(
        path=path,
        spec=spec,
        joints=tuple(model.joint(j).name for j in hinge),
        kp=kp,
        kd=kd,
        limit=limit,
        neutral=neutral,
        trunk=model.body(int(model.body_parentid[model.jnt_bodyid[hinge[0]]])).name,
    )


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
        give = [mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, name + PLAY) for name in description.joints]
        self.link_adr = np.array([self.model.jnt_dofadr[g] if g >= 0 else -1 for g in give])
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
        for k, name in enumerate(d.joints):
            self._flexible(spec, name, armature[k], d.limit[k])
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

    def _flexible(self, spec: mujoco.MjSpec, name: str, armature: float, limit: float) -> None:
        """A second joint behind the motor's, about the same axis: an elastic element, or play between stops."""
        motor = spec.joint(name)
        half = next((h.value for h in self.hidden.get("backlash", []) if h.where == name), 0.0)
        stiffness = max(limit, 1e-3) / GIVE
        if armature < 1e-4 or stiffness / armature > (0.5 / STEP) ** 2:
            if not half:
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
        lag = np.where(f.lag > 0.0, 1.0 - np.exp(-STEP / np.maximum(f.lag, 1e-6)), 1.0)
        self.speed += lag * (qd - self.speed)
        error = c.q_des - self.q + self.drive_zero
        torque = f.kp * c.kp * error - f.kd * c.kd * self.speed
        limit = self.description.limit
        self.torque = np.clip(f.strength * np.clip(torque, -limit, limit), -f.cap, f.cap)
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
