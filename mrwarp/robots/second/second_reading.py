"""A robot's file read a second time: by MuJoCo's compilers where they read it, else by :mod:`body_sum`."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mrwarp.env.sim_model import named
from mrwarp.paper import GRAVITY
from mrwarp.robots.foreign import ForeignRobot, prim_names
from mrwarp.robots.mjcf import strip
from mrwarp.robots.second.body_sum import GROUND, Tree, urdf_tree, usd_tree
from mrwarp.runtime import silent, unwarned
from mrwarp.usd.converted import convert_stage
from mrwarp.usd.open_stage import keep_fixed_joints, open_stage

Dynamics = Callable[[Mapping[str, float]], tuple[np.ndarray, np.ndarray]]
"""Mass matrix and weight at angles by joint, in the world's axes; six rows of the root come first where it floats."""

STEP = 1e-4
"""Step of the derivatives of a motor's torque [rad, rad/s]."""

FAR = 1e6
"""A command that no actuator follows: it gives its limit."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Numbers of a robot by one reading."""

    by: str
    """Who read it."""
    joints: tuple[str, ...]
    """Joints that move, in the order of the rows."""
    dynamics: Dynamics
    limits: Mapping[str, tuple[float, float] | None]
    """[rad] or [m]; None: there are none."""
    torque: Mapping[str, float] = field(default_factory=dict)
    """Largest torque of a joint's motors [N·m], where there is one."""
    gains: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Kp and Kd of a joint's motors [N·m/rad, N·m·s/rad], where they hold an angle."""
    armature: Mapping[str, float] = field(default_factory=dict)
    """Rotor inertia at the joint [kg·m²], where the format has one."""


def second_reading(robot: ForeignRobot) -> Reading:
    """The file of a robot that was imported, without the code that read it first.

    Raises:
        ValueError: nobody but the first reading can read it.
    """
    path = robot.path
    if path.suffix.lower() in (".usd", ".usda", ".usdc"):
        return _usd(robot)
    if path.suffix.lower() == ".urdf" or b"<robot" in path.read_bytes()[:4096]:
        return _urdf(robot)
    with silent(), unwarned():
        spec = mujoco.MjSpec.from_file(str(path))
        strip(spec, robot.skip_meshes)
        for actuator in spec.actuators:  # their histories are empty: they would answer with 0
            actuator.delay, actuator.nsample = 0.0, 0
        model = spec.compile()
        if robot.floating and not any(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
            mover = next(i for i in range(1, model.nbody) if model.body_jntnum[i])
            top = spec.body(model.body(_top(model, mover)).name)
            top.add_freejoint()
            for key in list(spec.keys):
                spec.delete(key)
            model = spec.compile()
    return mujoco_reading(model, robot, by="MuJoCo", names=None, motors=True)


def _top(model: mujoco.MjModel, body: int) -> int:
    while model.body_parentid[body]:
        body = int(model.body_parentid[body])
    return body


def mujoco_reading(
    model: mujoco.MjModel,
    robot: ForeignRobot,
    *,
    by: str,
    names: Mapping[int, str] | None,
    motors: bool = False,
    tilted: bool = True,
) -> Reading:
    """A MuJoCo model.

    Args:
        model: The model.
        robot: Whether it floats, and the inertias that were replaced on purpose.
        by: Who read it.
        names: Joint by number; None: by the model's own names, as USD takes them.
        motors: Whether its actuators are the robot's.
        tilted: Whether the root may be placed with its z not upwards, which the import makes upright.
    """
    free = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE]
    if names is None:
        own = [j for j in range(model.njnt) if j not in free]
        names = dict(zip(own, prim_names([model.joint(j).name or f"joint_{j}" for j in own]), strict=True))
    root = int(model.jnt_bodyid[free[0]]) if free else 0
    placed = Rotation.from_quat(model.body_quat[root], scalar_first=True) if free else Rotation.identity()
    turn = placed if tilted and placed.as_matrix()[2, 2] <= 1.0 - 1e-6 else Rotation.identity()
    rigid = copy.copy(model)
    rigid.dof_armature[:], rigid.actuator_armature[:], rigid.tendon_armature[:] = 0.0, 0.0, 0.0
    labels = dict(
        zip(
            prim_names([model.body(i).name or f"body_{i}" for i in range(model.nbody)]), range(model.nbody), strict=True
        )
    )
    for name, change in robot.replaced.items():
        if name in labels:
            _add_inertia(rigid, labels[name], change)
    torque, gains = _motors(model, names) if motors else ({}, {})
    return Reading(
        by=by,
        joints=tuple(names.values()),
        dynamics=partial(_dynamics, rigid, names, robot.floating, turn),
        limits={
            name: (float(model.jnt_range[j, 0]), float(model.jnt_range[j, 1])) if model.jnt_limited[j] else None
            for j, name in names.items()
        },
        torque=torque,
        gains=gains,
        armature={name: _armature(model, j) for j, name in names.items()} if motors or by == "written" else {},
    )


def _add_inertia(model: mujoco.MjModel, body: int, change: np.ndarray) -> None:
    axes = Rotation.from_quat(model.body_iquat[body], scalar_first=True).as_matrix()
    moments, axes = np.linalg.eigh(axes @ np.diag(model.body_inertia[body]) @ axes.T + change)
    model.body_inertia[body] = moments
    axes = axes * np.sign(np.linalg.det(axes))
    model.body_iquat[body] = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _armature(model: mujoco.MjModel, joint: int) -> float:
    own = [k for k in range(model.nu) if model.actuator_trntype[k] == 0 and model.actuator_trnid[k, 0] == joint]
    geared = sum(float(model.actuator_armature[k]) * float(model.actuator_gear[k, 0]) ** 2 for k in own)
    return float(model.dof_armature[model.jnt_dofadr[joint]]) + geared


def _dynamics(
    model: mujoco.MjModel, names: Mapping[int, str], floating: bool, turn: Rotation, q: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """See :data:`Dynamics`."""
    data, matrix, weight = mujoco.MjData(model), np.zeros((model.nv, model.nv)), np.zeros(model.nv)
    rows = []
    for j in range(model.njnt):
        if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE:
            at, dof = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
            data.qpos[at : at + 3], data.qpos[at + 3 : at + 7] = 0.0, turn.as_quat(scalar_first=True)
            rows = [*range(dof, dof + 6)] if floating else []
    for j, name in names.items():
        data.qpos[model.jnt_qposadr[j]] = q.get(name, 0.0)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    model.opt.gravity[:] = 0.0, 0.0, -GRAVITY
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_makeM(model, data)
    mujoco.mj_fullM(model, data, matrix)
    mujoco.mj_comVel(model, data)
    mujoco.mj_rne(model, data, 0, weight)
    change = np.eye(model.nv)
    if rows:  # MuJoCo's rates of a root are in its own axes
        change[np.ix_(rows[3:], rows[3:])] = turn.as_matrix().T
    rows += [int(model.jnt_dofadr[j]) for j in names]
    return (change.T @ matrix @ change)[np.ix_(rows, rows)], (change.T @ weight)[rows]


def _motors(model: mujoco.MjModel, names: Mapping[int, str]) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Torque limits and gains of the motors on joints, by trying them out."""
    torque, gains, bare = {}, {}, copy.copy(model)
    bare.actuator_forcelimited[:] = bare.jnt_actfrclimited[:] = 0
    own = list(names)
    at, dof = model.jnt_qposadr[own], model.jnt_dofadr[own]
    driven = {int(model.actuator_trnid[k, 0]) for k in range(model.nu) if model.actuator_trntype[k] == 0}

    def forces(tried: mujoco.MjModel, command: float, rate: float = 0.0, step: float = 0.0) -> np.ndarray:
        data = mujoco.MjData(tried)
        data.qpos[at] += step
        data.qvel[dof] = rate
        data.ctrl[:], data.act[:] = command, command
        mujoco.mj_fwdPosition(tried, data)
        mujoco.mj_fwdVelocity(tried, data)
        mujoco.mj_fwdActuation(tried, data)
        return data.qfrc_actuator[dof]

    most = np.maximum(np.abs(forces(model, FAR)), np.abs(forces(model, -FAR)))
    stiff = 0.5 * (forces(bare, 0.0, step=-STEP) - forces(bare, 0.0, step=STEP)) / STEP
    damped = 0.5 * (forces(bare, 0.0, rate=-STEP) - forces(bare, 0.0, rate=STEP)) / STEP + model.dof_damping[dof]
    for k, (j, name) in enumerate(names.items()):
        if j in driven and 0.0 < most[k] < FAR:
            torque[name] = float(most[k])
        if j in driven and stiff[k] > 0.0:
            gains[name] = float(stiff[k]), float(damped[k])
    return torque, gains


def _urdf(robot: ForeignRobot) -> Reading:
    root = ET.fromstring(robot.path.read_bytes())
    tree = urdf_tree(root)
    torque = {_one(tie.name): tie.torque for tie in tree.ties if tie.torque is not None}
    for link in root.iterfind("link"):
        for part in [part for part in link if part.tag != "inertial"]:
            link.remove(part)
    if robot.floating and tree.root != GROUND:
        _float(root, tree.root)
    try:
        with silent(), unwarned():
            model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    except ValueError:  # as of a mimic on a fixed joint, or moments that are too exact
        return _tree_reading(tree, robot, "sums over the bodies", torque)
    read = mujoco_reading(model, robot, by="MuJoCo", names=None)
    return Reading(**{**vars(read), "torque": torque})


def _float(root: ET.Element, trunk: str) -> None:
    """Put a floating joint under the trunk, which MuJoCo would weld to the world, where the ground bears it."""
    borne = [joint for joint in root.iterfind("joint") if joint.find("child").get("link") == trunk]  # type: ignore[union-attr]
    for joint in borne:
        root.remove(joint)
    for link in [link for link in root.iterfind("link") if link.get("name") == GROUND]:
        root.remove(link)
    ET.SubElement(root, "link", name="mrwarp_ground")
    joint = ET.SubElement(root, "joint", name="mrwarp_floating", type="floating")
    joint.extend(origin for own in borne for origin in own.iterfind("origin"))
    ET.SubElement(joint, "parent", link="mrwarp_ground")
    ET.SubElement(joint, "child", link=trunk)


def _one(name: str) -> str:
    return prim_names([name])[0]


def _usd(robot: ForeignRobot) -> Reading:
    stage = open_stage(robot.path)
    tree = usd_tree(stage)
    if tree is not None:
        return _tree_reading(tree, robot, "sums over the bodies", {})
    keep_fixed_joints(stage)
    with silent(), unwarned():
        _, model = convert_stage(stage, ground=False)
    names = by_label(model, [*(joint.name for joint in robot.joints), *robot.held])
    return mujoco_reading(model, robot, by="MuJoCo as Newton converts it", names=names)


def by_label(model: mujoco.MjModel, names: Sequence[str]) -> dict[int, str]:
    """Joints of a model that Newton converted, by number: its labels are paths that end in the names."""
    labels = [model.joint(j).name for j in range(model.njnt)]
    ends = [name for name in names if any(label.endswith(name) for label in labels)]  # else it is welded
    found = {named(labels, name, "joint"): name for name in ends}
    free = mujoco.mjtJoint.mjJNT_FREE
    return {j: found.get(j, str(labels[j])) for j in range(model.njnt) if model.jnt_type[j] != free}


def _tree_reading(tree: Tree, robot: ForeignRobot, by: str, torque: Mapping[str, float]) -> Reading:
    moving = [tie for tie in tree.ties if tie.kind != "fixed"]
    names = dict(zip((tie.name for tie in moving), prim_names([tie.name for tie in moving]), strict=True))
    turn = tree.placed if tree.placed.as_matrix()[2, 2] <= 1.0 - 1e-6 else Rotation.identity()
    for path, link in tree.links.items():
        if (name := _one(path.rpartition("/")[2])) in robot.replaced:
            link.inertia = link.inertia + robot.replaced[name]
    back = {own: name for name, own in names.items()}

    def dynamics(q: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        return tree.dynamics({back[name]: value for name, value in q.items() if name in back}, robot.floating, turn)

    return Reading(
        by=by,
        joints=tuple(names.values()),
        dynamics=dynamics,
        limits={names[tie.name]: tie.limits for tie in moving},
        torque=torque,
    )
