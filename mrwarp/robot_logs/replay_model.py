"""The robot of a log as a MuJoCo model whose joints are driven as the log's drives were."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import warp as wp

from mrwarp.env.sim_model import build_scene
from mrwarp.kernels.mr_joint import JointParams
from mrwarp.params import MrParams
from mrwarp.robot_logs.described.logged_part import check_joints, floor_height, hold, let_float, motors, name_all
from mrwarp.robot_logs.robot_log import LogError, RobotLog, reads_torque
from mrwarp.run_dir import no_file, one_line
from mrwarp.runtime import silent
from mrwarp.sysid.settings import Settings
from mrwarp.usd.asset import ROBOT_SUFFIXES, load_robot

NO_LIMIT = 1e6
"""Limit of a drive whose description has none [N·m]."""

LONGEST_STEP = 0.0011
"""Longest physics step of a replay [s]: a longer one answers noticeably later than the robot."""

LONGEST_DELAY = 0.03
"""Time before a window from which a replay knows commands [s]."""

LEVEL = 0.002
"""Feet that are no further than this above the lowest one bear load, where the log has no forces of feet [m]: one that
is about to land moves at the robot's speed."""

FEWEST_LEGS = 4
"""Limbs from which a URDF, in which no base floats, is taken as a robot with legs: tables have one or two arms."""

STIFF_FRICTION = ([0.01, 1.0], [0.9999, 0.9999, 0.001, 0.5, 2.0])
"""solref and solimp of dry friction: MuJoCo's own let a joint creep below some 0.1 rad/s as if it were viscous."""

NO_SLIP = 5
"""Iterations of MuJoCo's solver against slip. Without it feet that stick creep under what legs press them sideways, so
that the legs of a robot on four feet relax within a window, as those of a real one do not. Longer steps, those of
derivatives, have as many in a second: by one, derivatives of a walk and of squats are as near to those of steps of 1 ms
as by five, in two thirds of the time."""


@dataclass(frozen=True, kw_only=True)
class Devices:
    """MR devices of M joints."""

    joint: np.ndarray
    """Place of each among the log's joints, shape (M,)."""
    values: dict[str, np.ndarray]
    """Parameters by name, shape (M,)."""

    def __bool__(self) -> bool:
        return len(self.joint) > 0

    def structs(self, device: Any = "cpu") -> wp.array:
        """The parameters as kernels read them, on a Warp device, shape (M,), or (1,) of zeros where there are none."""
        record = np.dtype(JointParams.numpy_dtype())  # pyright: ignore[reportCallIssue,reportArgumentType]
        found = np.zeros(max(len(self.joint), 1), dtype=record)
        for name in self.values.keys() & JointParams.vars.keys():
            found[name] = self.values[name]
        return wp.array(found, dtype=JointParams, device=device)

    def of_joints(self, name: str, joints: int) -> np.ndarray:
        """A parameter of the device of each joint, 0 where there is none; shape (J,)."""
        found = np.zeros(joints)
        if self:
            found[self.joint] = self.values[name]
        return found


class Hidden(NamedTuple):
    """A motion that a log does not have: that of a link on an elastic drive, or of a base that gives way."""

    joint: int
    """The drive's joint, -1 of the base."""
    frequency: float
    """[Hz]"""
    torque: tuple[np.ndarray, ...]
    """Torque that it adds to the rigid bodies' at the joints [N·m], for each recording, shape (N, J)."""
    share: float = 0.0
    """Part of what rigid bodies leave of the commanded torque that it explains [1]."""
    rivals: tuple[int, ...] = ()
    """Joints, and -1 for the base, of motions that explain nearly as much."""


@dataclass(frozen=True, kw_only=True)
class ReplayModel:
    """A compiled model and where the log's J joints sit in it."""

    path: Path
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    joints: tuple[str, ...]
    q_adr: np.ndarray
    """Address of each joint in qpos; shape (J,)."""
    v_adr: np.ndarray
    """Address of each joint in qvel; shape (J,)."""
    slides: np.ndarray
    """Whether each joint slides, with lengths [m] and forces [N] for angles and torques, shape (J,)."""
    free: bool
    """Whether the trunk floats; then its pose is the first 7 of qpos."""
    legged: bool
    """Whether the robot could walk: its description floats, or is a URDF, which does not say so, with many limbs."""
    trunk: int
    """Body that floats, or that the first joints hang on."""
    feet: tuple[int, ...]
    """Shapes that can touch the ground at the ends of the legs; empty for a fixed base."""
    prefix: str
    """Newton's prefix of the names of a USD file's bodies."""
    devices: Devices
    limited: np.ndarray
    """Whether the description knows a limit of each joint's torque, shape (J,)."""
    asked: np.ndarray
    """Largest torque that the log asks of each joint, up to the description's limit [N·m], shape (J,)."""
    reach: np.ndarray
    """Distance from each body's joint to the furthest of what hangs on it [m], shape (B,)."""
    device: str
    """Warp device on which it is replayed."""
    weight: np.ndarray
    """Largest torque of gravity at each joint of a robot that is held, along the log [N·m], shape (J,); else 0."""
    floor: float
    """Height of the floor [m]."""
    sink: np.ndarray
    """Depth to which feet sink into the ground when one of them bears the robot, two, …, [m], shape (F,)."""
    beyond: Mapping[str, float] = field(default_factory=dict)
    """Torque that the log reads of joints whose description limits it to less [N·m]: they have no limit here."""
    held: tuple[str, ...] = ()
    """Joints that the log does not have and a drive holds: they do not move."""
    hidden: Hidden | None = None
    """A motion that may explain what rigid bodies do not."""
    settings: Settings = field(default_factory=Settings)
    """Numbers by which its log is judged."""
    engines: dict = field(default_factory=dict)
    """Engines in use, see :class:`mrwarp.robot_logs.window_replay.Replay`."""
    compiled: dict[float, mujoco.MjModel] = field(default_factory=dict)
    """Models by physics step [s], see :meth:`at_step`."""

    def at_step(self, h: float) -> mujoco.MjModel:
        """The model with physics steps of ``h`` [s], the same object each time."""
        if h not in self.compiled:
            spec = self.spec.copy()
            spec.option.timestep = h
            spec.option.noslip_iterations = round(spec.option.noslip_iterations * min(1.0, LONGEST_STEP / h))
            self.compiled[h] = mj = spec.compile()
            # else a centre of mass at a body's or shape's origin is taken to be there, though it is moved later
            for frames in (mj.body_sameframe, mj.geom_sameframe, mj.site_sameframe):
                frames[:] = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)
        return self.compiled[h]

    def body_name(self, body: int) -> str:
        """Name of a body, of a USD file its prim's."""
        return self.model.body(body).name.removeprefix(self.prefix)

    @property
    def moving(self) -> list[int]:
        """Bodies that the log's joints move."""
        found = []
        for i in range(1, self.model.nbody):
            if self.model.body_mass[i] > 0.0 and self._hinged_above(i):
                found.append(i)
        return found

    @property
    def limbs(self) -> dict[str, str]:
        """First body of the limb that each joint and each moving body belongs to, by their names."""
        mj = self.model
        found = {self.body_name(b): self.body_name(self._hinged_above(b)[-1]) for b in self.moving}
        own = [self.body_name(int(mj.jnt_bodyid[np.flatnonzero(mj.jnt_dofadr == v)[0]])) for v in self.v_adr]
        return found | {joint: found[body] for joint, body in zip(self.joints, own, strict=True) if body in found}

    def _hinged_above(self, body: int) -> list[int]:
        """Bodies with a hinge on the way from a body to the world, itself the first."""
        found = []
        while body:
            first, count = self.model.body_jntadr[body], self.model.body_jntnum[body]
            if any(self.model.jnt_type[first + k] == mujoco.mjtJoint.mjJNT_HINGE for k in range(count)):
                found.append(body)
            body = int(self.model.body_parentid[body])
        return found


def replay_model(path: Path, log: RobotLog, device: str = "cpu") -> ReplayModel:
    """Read a robot (MJCF, URDF, USD, or the name of a shipped one) and drive its joints as the log says.

    On a GPU, a Warp ``device``, MuJoCo-Warp replays it.

    Raises:
        LogError: it cannot be read, or lacks a joint of the log.
    """
    spec, drives, params, prefix = _spec(path)
    name_all(spec)
    for item in [*spec.sensors, *spec.keys]:
        spec.delete(item)
    roots = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    floats = bool(roots)
    check_joints(path, log.joints, [joint.name for joint in spec.joints])
    if log.base == "fixed":
        for joint in roots:
            spec.delete(joint)
    else:
        let_float(path, spec, log.joints)
    own, rotors = motors(described := _compiled(spec, path), log.joints)
    far = 1.0 + Settings().gain.half  # a drive at its limit reads it, by a channel whose gain may be off
    limits = {joint: max(map(abs, ends)) for joint, ends in own.items()}
    beyond = {joint: most for joint, most in _read(log).items() if most > far * limits.get(joint, np.inf)}
    for joint in beyond:
        del own[joint]
        spec.joint(joint).actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    held, limits = hold(spec, log.joints, drives), own | drives
    _drive(spec, log, limits, rotors)
    floor = floor_height(described) if log.base == "free" else None
    if log.base == "free" and floor is None:
        ground = spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50.0, 50.0, 1.0])
        ground.contype, ground.conaffinity = 2**31 - 1, int(not drives)  # of a USD file the feet alone touch it
    for joint in spec.joints:
        joint.solref_friction, joint.solimp_friction = STIFF_FRICTION
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    if log.base == "fixed":
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    else:
        spec.option.noslip_iterations = NO_SLIP
    model = _compiled(spec, path)
    ids = [model.joint(joint).id for joint in log.joints]
    free = bool((model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).any())
    trunk = int(model.jnt_bodyid[int(np.argmax(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE))]) if free else 0
    if not free:
        trunk = int(model.body_parentid[model.jnt_bodyid[ids[0]]])
    found = ReplayModel(
        path=path,
        spec=spec,
        model=model,
        joints=log.joints,
        q_adr=model.jnt_qposadr[ids],
        v_adr=model.jnt_dofadr[ids],
        slides=model.jnt_type[ids] == mujoco.mjtJoint.mjJNT_SLIDE,
        free=free,
        legged=free or floats,
        trunk=trunk,
        feet=_feet(model) if free else (),
        prefix=prefix,
        devices=_devices(log, params),
        limited=np.array([joint in limits for joint in log.joints]),
        asked=np.minimum(_asked(log), model.actuator_forcerange[:, 1]),
        reach=_reach(model),
        device=device,
        weight=np.zeros(len(ids)) if free else _weight(model, log, model.jnt_qposadr[ids], model.jnt_dofadr[ids]),
        floor=floor or 0.0,
        sink=_sink(model, _feet(model), floor or 0.0) if free else np.zeros(0),
        beyond=beyond,
        held=held,
    )
    many = path.suffix == ".urdf" and len(set(found.limbs.values())) >= FEWEST_LEGS
    return replace(found, legged=True) if many else found


def _drive(spec: mujoco.MjSpec, log: RobotLog, limits: dict, rotors: dict) -> None:
    """Drives with the log's gains in place of all that the robot has; by joint their torques and rotors' inertias."""
    for item in list(spec.actuators):
        spec.delete(item)
    for k, joint in enumerate(log.joints):
        spec.joint(joint).armature += rotors[joint]
        drive = spec.add_actuator(name=f"drive {joint}", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        drive.gaintype, drive.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        drive.gainprm[0] = 1.0
        drive.biasprm[1], drive.biasprm[2] = -float(log.kp[k]), -float(log.kd[k])
        drive.ctrllimited = False
        drive.forcelimited, drive.forcerange = True, limits.get(joint, [-NO_LIMIT, NO_LIMIT])


def _devices(log: RobotLog, params: dict[str, MrParams]) -> Devices:
    at = [k for k, joint in enumerate(log.joints) if joint in params]
    values = [params[log.joints[k]].to_dict() for k in at]
    names = values[0] if values else {}
    return Devices(joint=np.array(at, dtype=int), values={name: np.array([v[name] for v in values]) for name in names})


def _asked(log: RobotLog) -> np.ndarray:
    """Largest torque asked for: all but a thousandth of the samples ask for less; shape (J,)."""
    found = np.full(len(log.joints), 1e-3)
    for run in log.runs:
        joint = run.joint
        ask = np.nan_to_num(joint.get("tau_ff", joint.get("tau", np.zeros(joint["q"].shape))))
        if "q_des" in joint:
            speed = np.nan_to_num(joint.get("qd", np.zeros(joint["q"].shape)))
            kp, kd = (np.nan_to_num(joint.get(name, gain)) for name, gain in (("kp", log.kp), ("kd", log.kd)))
            ask = np.nan_to_num(joint.get("tau_ff", 0.0)) + kp * np.nan_to_num(joint["q_des"] - joint["q"]) - kd * speed
        found = np.maximum(found, np.quantile(np.abs(ask), 0.999, axis=0))
    return found


def bias_torque(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    q_adr: np.ndarray,
    v_adr: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray | float,
) -> np.ndarray:
    """Torque of gravity and Coriolis forces at a state of the joints [N·m], shape (J,); ``data`` is then at it."""
    data.qpos[:], data.qvel[:], found = model.qpos0, 0.0, np.zeros(model.nv)
    data.qpos[q_adr], data.qvel[v_adr] = q, qd
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    mujoco.mj_rne(model, data, 0, found)
    return found[v_adr]


def _weight(
    model: mujoco.MjModel, log: RobotLog, q_adr: np.ndarray, v_adr: np.ndarray, rows_of_each: int = 200
) -> np.ndarray:
    """Largest torque of gravity at each joint along the log [N·m], shape (J,), by some rows of each recording."""
    data = mujoco.MjData(model)
    rows = (q for run in log.runs for q in run.joint["q"][:: max(1, run.samples // rows_of_each)])
    return np.max([np.abs(bias_torque(model, data, q_adr, v_adr, q, 0.0)) for q in rows], axis=0)


def _read(log: RobotLog) -> dict[str, float]:
    """Torque that each joint's motor gave by the log, but for a hundredth of the rows, which may be noise [N·m]."""
    rows = [np.abs(run.joint["tau"]) for run in log.runs if reads_torque(log, run)]
    if not rows:
        return {}
    most = np.quantile(np.nan_to_num(np.concatenate(rows)), 0.99, axis=0)
    return dict(zip(log.joints, most.tolist(), strict=True))


def _reach(model: mujoco.MjModel) -> np.ndarray:
    found = np.full(model.nbody, 1e-3)
    for k in range(1, model.nbody):
        own = [*model.body_pos[model.body_parentid == k], *model.geom_pos[model.geom_bodyid == k]]
        found[k] = max([1e-3, *(float(np.linalg.norm(p)) for p in own)])
    return found


def _sink(model: mujoco.MjModel, feet: tuple[int, ...], floor: float) -> np.ndarray:
    """Depth at which the first foot's contact bears the weight, half of it, …, by inverse dynamics at rest, (F,)."""
    data, wrench, shapes = mujoco.MjData(model), np.zeros(6), _shapes(model, feet[0])
    robot = int(model.body_rootid[model.geom_bodyid[feet[0]]])  # a table in the scene weighs nothing on them
    weight = -model.opt.gravity[2] * model.body_subtreemass[robot] / np.arange(1, len(feet) + 1)

    def borne(depth: float) -> float:
        mujoco.mj_resetData(model, data)
        mujoco.mj_kinematics(model, data)
        data.qpos[2] += floor - _sole(model, data, shapes)[2] - depth
        data.qacc[:] = 0.0
        mujoco.mj_inverse(model, data)
        found = 0.0
        for c in range(data.ncon):
            if not set(data.contact[c].geom).isdisjoint(shapes):
                mujoco.mj_contactForce(model, data, c, wrench)
                found += wrench[0]
        return found

    deepest = 0.02
    while borne(deepest) < weight[0] and deepest < model.stat.extent:
        deepest *= 2.0
    depths = deepest * np.linspace(0.005, 1.0, 200)
    return np.interp(weight, np.maximum.accumulate([borne(depth) for depth in depths]), depths)


def _shapes(mj: mujoco.MjModel, foot: int) -> list[int]:
    """Shapes that can touch the ground of the body that a foot's shape belongs to."""
    touches = (mj.geom_contype != 0) | (mj.geom_conaffinity != 0)
    return np.flatnonzero(touches & (mj.geom_bodyid == mj.geom_bodyid[foot])).tolist()


def _sole(mj: mujoco.MjModel, data: mujoco.MjData, shapes: list[int]) -> np.ndarray:
    """Lowest point of a foot's shapes in the world [m], shape (3,), where ``data`` has them."""
    points = [
        data.geom_xpos[g] + data.geom_xmat[g].reshape(3, 3) @ _furthest(mj, g, -data.geom_xmat[g][6:]) for g in shapes
    ]
    return min(points, key=lambda point: point[2])


def _furthest(mj: mujoco.MjModel, geom: int, way: np.ndarray) -> np.ndarray:
    """Point of a shape that lies furthest along a unit vector, both in the shape's axes, shapes (3,)."""
    kind, size = mj.geom_type[geom], mj.geom_size[geom]
    ends, across = np.sign(way), np.array([way[0], way[1], 0.0])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        first, count = (int(x[mj.geom_dataid[geom]]) for x in (mj.mesh_vertadr, mj.mesh_vertnum))
        corners = mj.mesh_vert[first : first + count]
        return corners[np.argmax(corners @ way)].astype(float)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return size * ends
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return size[0] * across / max(float(np.linalg.norm(across)), 1e-12) + [0.0, 0.0, size[1] * ends[2]]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return size[0] * way + [0.0, 0.0, size[1] * ends[2]]
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return size**2 * way / float(np.linalg.norm(size * way))
    return size[0] * way


class Stance:
    """A robot on its feet: how high its trunk is, and how fast, if feet that bear load stay where they are."""

    def __init__(self, model: ReplayModel, mj: mujoco.MjModel) -> None:
        self.model, self.mj, self.data = model, mj, mujoco.MjData(mj)
        self.feet = list(model.feet)
        self.shapes = [_shapes(mj, foot) for foot in self.feet]
        self.jacobian, self.turn = np.zeros((3, mj.nv)), np.zeros((3, mj.nv))

    def soles(self, qpos: np.ndarray) -> np.ndarray:
        """Lowest point of each foot, shape (F, 3), at joints' angles and the trunk's orientation, from its origin."""
        self.data.qpos[:], self.data.qpos[:3] = qpos, 0.0
        mujoco.mj_kinematics(self.mj, self.data)
        mujoco.mj_comPos(self.mj, self.data)
        return np.array([_sole(self.mj, self.data, shapes) for shapes in self.shapes])

    def trunk(self, qpos: np.ndarray, qvel: np.ndarray, loaded: np.ndarray) -> tuple[float, np.ndarray]:
        """Height [m] and velocity [m/s] of the trunk, by the mean of the feet that bear load, (F,); else the lowest."""
        height, steady = self.by_feet(qpos, qvel, loaded)
        return height, np.mean(steady, axis=0)

    def by_feet(self, qpos: np.ndarray, qvel: np.ndarray, loaded: np.ndarray) -> tuple[float, np.ndarray]:
        """Height [m], and what each of these feet says of the trunk's velocity [m/s], shape (feet that stand, 3)."""
        soles, self.data.qvel[:] = self.soles(qpos), qvel
        self.data.qvel[:3] = 0.0
        standing = loaded if loaded.any() else soles[:, 2] < soles[:, 2].min() + LEVEL
        steady = []
        for f in np.flatnonzero(standing):
            body = int(self.mj.geom_bodyid[self.feet[f]])
            mujoco.mj_jac(self.mj, self.data, self.jacobian, self.turn, soles[f], body)
            steady.append(-self.jacobian @ self.data.qvel)
        height = self.model.floor - float(soles[standing, 2].mean() + self.model.sink[standing.sum() - 1])
        return height, np.array(steady)


def _spec(path: Path) -> tuple[mujoco.MjSpec, dict[str, list[float]], dict[str, MrParams], str]:
    """The file's model, ranges of torques that stand elsewhere, devices by joint, prefix of the bodies' names."""
    if path.suffix in ROBOT_SUFFIXES or not path.suffix:
        asset = load_robot(robot=str(path)) if path.suffix else load_robot(robot=path.name)
        kept: list[mujoco.MjSpec] = []
        build_scene(asset, dt=0.001, ground=False, edit=lambda spec: kept.append(spec.copy()))
        for joint in kept[0].joints:
            joint.name = next((a.joint for a in asset.actuators if joint.name.endswith("_" + a.joint)), joint.name)
        limits = {a.joint: [-a.tau_limit, a.tau_limit] for a in asset.actuators}
        return (
            kept[0],
            limits,
            {a.joint: a.mr for a in asset.actuators if a.mr is not None},
            (f"_{asset.stage.GetDefaultPrim().GetName()}_"),
        )
    if not path.is_file():
        raise LogError(f"{path}: {no_file(path, 'robot')}; --robot names an MJCF (.xml), URDF or USD file")
    try:
        return read_spec(path), {}, {}, ""
    except Exception as error:  # MuJoCo raises several types
        raise LogError(f"{path}: MuJoCo cannot read it ({one_line(error)}); correct it there") from None


def read_spec(path: Path) -> mujoco.MjSpec:
    """An MJCF or URDF as MuJoCo reads it, but for a URDF's fixed links without inertial: those have no mass.

    MuJoCo gives their shapes the density of water: those of a Go2's calves would weigh 0.19 kg.
    """
    with silent():
        spec = mujoco.MjSpec.from_file(str(path))
    if path.suffix == ".urdf":
        for body in (x for x in spec.bodies if not x.explicitinertial and not x.joints):
            for geom in body.geoms:
                geom.density = 0.0
    return spec


def _compiled(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    with silent():
        with contextlib.suppress(Exception):
            return spec.compile()
        for geom in [g for g in spec.geoms if g.type == mujoco.mjtGeom.mjGEOM_MESH]:
            spec.delete(geom)  # files of meshes that are not here, most often
        for mesh in list(spec.meshes):
            spec.delete(mesh)
        try:
            return spec.compile()
        except Exception as error:
            raise LogError(f"{path}: MuJoCo cannot simulate it ({one_line(error)}); correct it there") from None


def _feet(model: mujoco.MjModel) -> tuple[int, ...]:
    """Of each body at the end of a leg, the colliding shape that hangs lowest at the model's own pose."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    shaped = set(model.geom_bodyid[touches & (model.body_weldid[model.geom_bodyid] != 0)].tolist())
    above: set[int] = set()
    for body in shaped:
        while body:
            body = int(model.body_parentid[body])
            above.add(body)
    found = []
    for body in sorted(shaped - above):
        shapes = [g for g in np.flatnonzero(touches).tolist() if model.geom_bodyid[g] == body]
        found.append(min(shapes, key=lambda g: data.geom_xpos[g, 2] - model.geom_rbound[g]))
    return tuple(found)
