"""A robot's file, read: MJCF as MuJoCo compiles it, URDF and USD by Newton's importers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import trimesh
from pxr import Usd, UsdGeom, UsdPhysics
from scipy.spatial.transform import RigidTransform, Rotation

from mrwarp.robots.foreign import (
    Body,
    Coupling,
    ForeignRobot,
    Joint,
    RobotFileError,
    Shape,
    joined,
    prim_names,
)
from mrwarp.robots.newton_robot import add_stage, read_by_newton
from mrwarp.robots.urdf import Meshes, checked_urdf
from mrwarp.run_dir import no_file, one_line
from mrwarp.runtime import silent
from mrwarp.usd.open_stage import SCHEMA, open_stage

SUFFIXES = {".xml": "MJCF", ".mjcf": "MJCF", ".urdf": "URDF", ".usd": "USD", ".usda": "USD", ".usdc": "USD"}
"""What a file holds, by how its name ends."""

GEOMS = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "mesh",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}
"""Kinds of geoms that are taken over, and as what."""

SPLIT = 0.01
"""Share of a body's mass and inertia that each link has which is put between two of its joints."""

STANCES = ("home", "stand", "standing", "default")
"""Names of keyframes that are a stance; without one of them the first is taken."""


def read_robot(path: Path, meshes: Meshes | None = None) -> ForeignRobot:
    """Read a robot's file. A URDF floats, unless its root link is called world.

    Args:
        path: The file.
        meshes: Where a URDF's meshes are, or that all are left out.

    Raises:
        RobotFileError: it cannot be read, has no bodies, two trunks, or a planar base.
        AssetError: as USD it cannot be opened.
    """
    if not path.is_file():
        raise RobotFileError(f"{path}: {no_file(path, 'file')}; name an MJCF (.xml), URDF or USD file")
    kind = SUFFIXES.get(path.suffix.lower())
    if kind is None:
        remedy = (
            f"expand its macros: xacro {path.name} > robot.urdf" if "xacro" in path.suffix else "rename or convert it"
        )
        raise RobotFileError(f"{path}: {path.suffix or 'no ending'} is not {', '.join(SUFFIXES)}; {remedy}")
    meshes = meshes or Meshes()
    if kind == "URDF" or (kind == "MJCF" and b"<robot" in path.read_bytes()[:4096]):
        return _read_urdf(path, meshes)
    return _read_mjcf(path, meshes.skip) if kind == "MJCF" else _read_usd(path)


def _read_urdf(path: Path, meshes: Meshes) -> ForeignRobot:
    urdf = checked_urdf(path, meshes)

    def add(builder: Any) -> None:
        builder.default_shape_cfg.density = 0.0  # a link without inertial has no mass there
        builder.add_urdf(urdf.text, floating=urdf.floating, collapse_fixed_joints=True)

    robot = read_by_newton(path, add)
    pairs = [prim_names(pair) for pair in urdf.mimics.items()]
    robot.couplings += [Coupling(text=f"<mimic> ties {a} to {b}", joints=(a, b)) for a, b in pairs]
    return robot


def _read_usd(path: Path) -> ForeignRobot:
    """A USD file, with the gains of Newton's motors, also beside MR devices, and the stance of an imported robot."""
    stage = open_stage(path)
    if stage.HasAuthoredMetadata("upAxis") and (up := UsdGeom.GetStageUpAxis(stage)) != "Z":
        raise RobotFileError(f"{path}: upAxis is {up}; export it with Z up")
    for name, unit in (("metersPerUnit", "metres"), ("kilogramsPerUnit", "kilograms")):
        if stage.HasAuthoredMetadata(name) and (value := stage.GetMetadata(name)) != 1.0:
            raise RobotFileError(f"{path}: {name} is {value:g}; export it in {unit}")
    _refuse_no_numbers(path, stage)
    _refuse_loops(path, stage)
    motors = [prim for prim in stage.Traverse() if prim.GetTypeName() == "NewtonActuator"]
    names = (("kp", "mr:kp_base"), ("kd", "mr:kd"), ("maxEffort", "mr:tau_limit"))
    drives = {
        prim_names([target.name])[0]: [
            next((v for name in pair if (v := motor.GetAttribute(f"newton:{name}").Get())), None) for pair in names
        ]
        for motor in motors
        for target in motor.GetRelationship("newton:targets").GetTargets()
    }
    homes = {
        prim_names([prim.GetName()])[0]: math.radians(angle)
        for prim in stage.Traverse()
        if prim.IsA(UsdPhysics.Joint) and (angle := prim.GetAttribute("mrwarp:neutral").Get()) is not None
    }
    devices = any(SCHEMA in motor.GetAppliedSchemas() for motor in motors)
    with Usd.EditContext(stage, stage.GetSessionLayer()):  # their numbers are known; Newton refuses other kinds
        for motor in motors:
            motor.SetActive(False)
        if not any(prim.HasAPI(UsdPhysics.ArticulationRootAPI) for prim in stage.Traverse()):
            UsdPhysics.ArticulationRootAPI.Apply(stage.GetDefaultPrim())

    robot = read_by_newton(path, lambda builder: add_stage(builder, stage))
    for joint in robot.joints:
        kp, kd, limit = drives.get(joint.name, (None, None, None))
        joint.kp, joint.kd, joint.torque_limit = kp or joint.kp, kd or joint.kd, limit or joint.torque_limit
        joint.home = homes.get(joint.name)
    if devices:
        robot.notes.append("MR devices were left out: put them on with 'mrwarp robot fit-device'")
    return robot


def _refuse_no_numbers(path: Path, stage: Usd.Stage) -> None:
    """Name the attribute that is no number: Newton takes a default in its place, or the NaN."""
    for prim in stage.Traverse():
        for attribute in prim.GetAuthoredAttributes():
            if attribute.GetName().startswith(("physics:", "xformOp:", "drive:")):
                value = attribute.Get()
                numbers = np.array([value.real, *value.imaginary] if hasattr(value, "imaginary") else value).ravel()
                if numbers.dtype.kind == "f" and np.isnan(numbers).any():
                    raise RobotFileError(
                        f"{path}: {prim.GetPath()}: {attribute.GetName()} is no number; correct it there"
                    )


def _refuse_loops(path: Path, stage: Usd.Stage) -> None:
    """Name the joint that ties bodies which are tied already: Newton names none."""
    group: dict[str, str] = {}
    for prim in (prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Joint)):
        made = UsdPhysics.Joint(prim)
        ends = [str((rel.GetTargets() or [""])[0]) for rel in (made.GetBody0Rel(), made.GetBody1Rel())]
        if not made.GetJointEnabledAttr().Get():
            continue
        first, second = (group.setdefault(end, end) for end in ends)
        if first == second:
            between = " and ".join(end.rpartition("/")[2] or "the world" for end in ends)
            raise RobotFileError(
                f"{path}: joint {prim.GetName()} closes a loop between {between}; open it there: only trees of bodies "
                "are simulated"
            )
        group = {end: first if own == second else own for end, own in group.items()}


def _read_mjcf(path: Path, skip_meshes: bool) -> ForeignRobot:
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)  # else it writes MUJOCO_LOG.TXT
    try:
        with silent():
            spec = mujoco.MjSpec.from_file(str(path))
            _strip(spec, skip_meshes)
            model = spec.compile()
    except Exception as error:  # ValueError of the compiler, but also of what reads meshes
        text = one_line(error)
        remedy = "correct it there"
        if "Error opening file" in text:
            remedy = "put it there" if "'include'" in text else "put it there, or say --skip-meshes"
        raise RobotFileError(f"{path}: MuJoCo cannot read it ({text}); {remedy}") from None
    finally:
        mujoco.set_mju_user_warning(None)
    if any("NaN" in text for text in warned):  # it stands for a default there
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        line = next((k for k, text in enumerate(lines, 1) if re.search(r"\bnan\b", text, re.IGNORECASE)), None)
        where = f", line {line}" if line else " or a file that it includes"
        raise RobotFileError(f"{path}{where}: a value is NaN; write a number in its place")
    return _Compiled(path, model).robot()


def _strip(spec: mujoco.MjSpec, meshes: bool) -> None:
    """Take out what is not read, whether its files are there or not: textures, height fields, meshes if asked."""
    for geom in list(spec.geoms):
        if geom.hfieldname or (meshes and geom.meshname):
            spec.delete(geom)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for element in (*spec.textures, *spec.hfields, *(spec.meshes if meshes else ())):
        spec.delete(element)


class _Compiled:
    """A compiled model as bodies between which joints are: bodies without a joint belong to the one before them."""

    def __init__(self, path: Path, model: mujoco.MjModel) -> None:
        self.path, self.model = path, model
        self.labels = [model.body(i).name or f"body_{i}" for i in range(model.nbody)]
        self.joint_labels = [model.joint(i).name or f"joint_{i}" for i in range(model.njnt)]
        self.paired = {*model.pair_geom1, *model.pair_geom2}
        self.root, self.floating = self._root()
        # body that each belongs to, and its place there; -1: scenery
        self.owner = np.full(model.nbody, -1)
        self.place = [RigidTransform.identity()] * model.nbody
        for i in range(model.nbody):
            parent = model.body_parentid[i]
            if i == self.root or (model.body_jntnum[i] and self.owner[parent] >= 0):
                self.owner[i] = i
            elif i:
                self.owner[i] = self.owner[parent]
                self.place[i] = self.place[parent] * _transform(model.body_pos[i], model.body_quat[i])

    def _root(self) -> tuple[int, bool]:
        """The body that floats; else the world, of which the base is a part."""
        model = self.model
        free = [int(model.jnt_bodyid[j]) for j in range(model.njnt) if self._kind(j) == mujoco.mjtJoint.mjJNT_FREE]
        anchored = [
            i for i in range(1, model.nbody) if model.body_jntnum[i] and not model.body_weldid[model.body_parentid[i]]
        ]
        if not anchored:
            raise RobotFileError(f"{self.path}: there is no body that could move; is it a robot's file?")
        if free and len(anchored) > 1:
            first, second = (self.labels[i] for i in sorted(anchored, key=lambda i: i not in free)[:2])
            raise RobotFileError(f"{self.path}: {first} and {second} are two trunks; remove one")
        return (free[0], True) if free else (0, False)

    def _kind(self, joint: int) -> mujoco.mjtJoint:
        return mujoco.mjtJoint(self.model.jnt_type[joint])

    def robot(self) -> ForeignRobot:
        """Bodies, joints, shapes, couplings and notes.

        Between the joints of one body links are put that have a part of its mass.

        Raises:
            RobotFileError: the base slides.
        """
        model = self.model
        own = [i for i in range(model.nbody) if self.owner[i] == i]
        number = {body: k for k, body in enumerate(own)}
        labels = [self.labels[i] for i in own]
        if not self.floating:  # the root is what bears the first moving body
            bearer = int(model.body_parentid[own[1]])
            labels[0] = self.labels[bearer] if bearer else "base"
        moving = {i: self._joints_of(i) for i in own if i != self.root}
        links = {j: (len(own) + k, i) for k, (i, j) in enumerate((i, j) for i in moving for j in moving[i][:-1])}
        labels += [f"{self.labels[i]}_{self.joint_labels[j]}" for j, (_, i) in links.items()]
        bodies = [self._body(i, name) for i, name in zip(own, prim_names(labels), strict=False)]
        for name, (_, i) in zip(prim_names(labels)[len(own) :], links.values(), strict=True):
            body = bodies[number[i]]
            bodies.append(replace(body, name=name, mass=SPLIT * body.mass, inertia=SPLIT * body.inertia))
        for i, found in moving.items():
            left, body = 1.0 - SPLIT * (len(found) - 1), bodies[number[i]]
            bodies[number[i]] = replace(body, mass=left * body.mass, inertia=left * body.inertia)
        order = [j for found in moving.values() for j in found]
        names = dict(zip(order, prim_names([self.joint_labels[j] for j in order]), strict=True))
        by_joint: dict[int, Joint] = {}
        for i, found in moving.items():
            parent = number[int(self.owner[model.body_parentid[i]])]
            for j in found:
                child = links[j][0] if j in links else number[i]
                by_joint[j] = self._joint(j, parent, child, names[j])
                parent = child
        joints = list(by_joint.values())
        shapes = [s for g in range(model.ngeom) if (s := self._shape(g, number)) is not None]
        notes = [*self._actuators(by_joint), *self._key(by_joint), *self._left_out(by_joint)]
        if several := [self.labels[i] for i, found in moving.items() if found[1:]]:
            more = " and others" if several[3:] else ""
            notes.append(
                f"links of {SPLIT:.0%} of the body's mass were put between the joints of {', '.join(several[:3])}{more}"
            )
        placed = Rotation.from_quat(model.body_quat[self.root], scalar_first=True)
        return ForeignRobot(
            path=self.path,
            name=prim_names([self.path.stem])[0],
            bodies=bodies,
            joints=joints,
            shapes=shapes,
            root=number[self.root],
            floating=self.floating,
            couplings=list(self._couplings(by_joint)),
            notes=notes,
        ).upright(placed if self.floating else Rotation.identity())

    def _body(self, i: int, name: str) -> Body:
        """A body with all that is welded to it."""
        body = Body(name=name, mass=0.0, com=np.zeros(3), inertia=np.zeros((3, 3)))
        for k in range(1, self.model.nbody):
            if self.owner[k] == i:
                axes = _transform(self.model.body_ipos[k], self.model.body_iquat[k])
                turn = axes.rotation.as_matrix()
                part = Body(
                    name=name,
                    mass=float(self.model.body_mass[k]),
                    com=axes.translation,
                    inertia=turn @ np.diag(self.model.body_inertia[k]) @ turn.T,
                )
                body = joined(body, part, self.place[k])
        return body

    def _joints_of(self, i: int) -> range:
        """A body's joints, from the one before it on.

        Raises:
            RobotFileError: it is a base that slides.
        """
        first = int(self.model.body_jntadr[i])
        found = range(first, first + int(self.model.body_jntnum[i]))
        slides = any(self._kind(j) != mujoco.mjtJoint.mjJNT_HINGE for j in found)
        if found[1:] and slides and not self.model.body_parentid[i]:
            raise RobotFileError(
                f"{self.path}: body {self.labels[i]} has {len(found)} joints, "
                f"{', '.join(self.joint_labels[j] for j in found)}; put a <freejoint/> in their place"
            )
        return found

    def _joint(self, j: int, parent: int, child: int, name: str) -> Joint:
        model, i = self.model, int(self.model.jnt_bodyid[j])
        before = int(model.body_parentid[i])
        anchor, axis = RigidTransform.from_translation(model.jnt_pos[j]), np.array(model.jnt_axis[j])
        kind, dof, rest = self._kind(j), int(model.jnt_dofadr[j]), float(model.qpos0[model.jnt_qposadr[j]])
        in_parent = anchor
        if j == model.body_jntadr[i]:
            in_parent = self.place[before] * _transform(model.body_pos[i], model.body_quat[i]) * anchor
        if kind == mujoco.mjtJoint.mjJNT_HINGE:
            in_parent = in_parent * RigidTransform.from_rotation(Rotation.from_rotvec(-rest * axis))
        elif kind == mujoco.mjtJoint.mjJNT_SLIDE:
            in_parent = in_parent * RigidTransform.from_translation(-rest * axis)
        low, high = (float(x) for x in model.jnt_range[j])
        forced = bool(model.jnt_actfrclimited[j])
        return Joint(
            name=name,
            kind=KINDS[kind],
            parent=parent,
            child=child,
            in_parent=in_parent,
            in_child=anchor,
            axis=axis / np.linalg.norm(axis),
            limits=(low, high) if model.jnt_limited[j] and low < high else None,
            armature=float(model.dof_armature[dof]),
            kd=float(model.dof_damping[dof]) or None,
            torque_limit=float(np.abs(model.jnt_actfrcrange[j]).max()) if forced else None,
        )

    def _actuators(self, joints: dict[int, Joint]) -> Iterator[str]:
        """Take gains and torque limits from the actuators."""
        model, others = self.model, []
        for k in range(model.nu):
            joint = joints.get(int(model.actuator_trnid[k, 0]))
            if model.actuator_trntype[k] != mujoco.mjtTrn.mjTRN_JOINT or joint is None:
                others.append(model.actuator(k).name or f"actuator_{k}")
                continue
            gear, bias = abs(float(model.actuator_gear[k, 0])), model.actuator_biasprm[k]
            affine = model.actuator_biastype[k] == mujoco.mjtBias.mjBIAS_AFFINE
            stiff, damped = affine and bias[1] < 0.0, affine and bias[2] < 0.0
            if stiff:
                joint.kp = float(-bias[1]) * gear**2
            if damped:
                joint.kd = (joint.kd or 0.0) + float(-bias[2]) * gear**2
            joint.armature += float(model.actuator_armature[k]) * gear**2
            limit = None
            if model.actuator_forcelimited[k]:
                limit = float(np.abs(model.actuator_forcerange[k]).max()) * gear
            elif model.actuator_ctrllimited[k] and not affine:
                limit = float(np.abs(model.actuator_ctrlrange[k]).max() * abs(model.actuator_gainprm[k, 0])) * gear
            if limit is not None:
                joint.torque_limit = min(limit, joint.torque_limit or limit)
        if others:
            yield f"actuators of tendons and sites were left out: {', '.join(others[:4])}"

    def _key(self, joints: dict[int, Joint]) -> Iterator[str]:
        """Take the angles of the keyframe that is a stance, else of the first."""
        names = [self.model.key(k).name for k in range(self.model.nkey)]
        if not names:
            return
        key = next((names.index(name) for name in STANCES if name in names), 0)
        for j, joint in joints.items():
            joint.home = float(self.model.key_qpos[key, self.model.jnt_qposadr[j]])
        if names[1:]:
            yield f"the stance is keyframe {names[key] or key} of {', '.join(n or '(no name)' for n in names[:6])}"

    def _left_out(self, joints: dict[int, Joint]) -> Iterator[str]:
        model = self.model
        if springs := [joint.name for j, joint in joints.items() if model.jnt_stiffness[j] > 0.0]:
            yield f"springs of joints were left out: {', '.join(springs[:4])}"
        if model.ntendon:
            yield f"{model.ntendon} tendons were left out"
        renamed = [
            f"{label} is {joint.name}" for j, joint in joints.items() if (label := self.joint_labels[j]) != joint.name
        ]
        if renamed:
            yield f"names that USD takes: {', '.join(renamed[:4])}{' and others' if renamed[4:] else ''}"

    def _shape(self, g: int, number: dict[int, int]) -> Shape | None:
        model, body, kind = self.model, int(self.model.geom_bodyid[g]), mujoco.mjtGeom(self.model.geom_type[g])
        if self.owner[body] < 0 or body == 0 or kind not in GEOMS:
            return None
        points = faces = None
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.mesh(model.geom_dataid[g])
            vertices, triangles = int(mesh.vertadr[0]), int(mesh.faceadr[0])
            points = np.array(model.mesh_vert[vertices : vertices + int(mesh.vertnum[0])], dtype=float)
            faces = np.array(model.mesh_face[triangles : triangles + int(mesh.facenum[0])])
        elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            ball: Any = trimesh.creation.icosphere(subdivisions=2)
            points, faces = np.array(ball.vertices) * model.geom_size[g], np.array(ball.faces)
        return Shape(
            kind=GEOMS[kind],
            body=number[self.owner[body]],
            pose=self.place[body] * _transform(model.geom_pos[g], model.geom_quat[g]),
            size=np.array(model.geom_size[g]),
            collides=bool(model.geom_contype[g] or model.geom_conaffinity[g] or g in self.paired),
            friction=float(model.geom_friction[g, 0]),
            points=points,
            faces=faces,
        )

    def _bears(self, joint: int, body: int) -> bool:
        """Whether a joint lies between the root and a body."""
        while body and body != self.model.jnt_bodyid[joint]:
            body = int(self.model.body_parentid[body])
        return bool(body)

    def _couplings(self, joints: dict[int, Joint]) -> Iterator[Coupling]:
        """What ties bodies or joints together beside the tree."""
        model = self.model
        for k in range(model.neq):
            if not model.eq_active0[k]:
                continue
            kind, ends = mujoco.mjtEq(model.eq_type[k]), [int(model.eq_obj1id[k]), int(model.eq_obj2id[k])]
            tag = kind.name.removeprefix("mjEQ_").lower()
            if kind == mujoco.mjtEq.mjEQ_JOINT:
                tied = [joints[j].name for j in ends if j in joints]
                yield Coupling(text=f"<{tag}> ties {' to '.join(tied)}", joints=tuple(tied))
            elif kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
                bodies = model.eq_objtype[k] == mujoco.mjtObj.mjOBJ_BODY
                found = ends if bodies else [int(model.site_bodyid[i]) for i in ends]
                between = " and ".join(self.labels[i] for i in found)
                ways = [{j: joint.name for j, joint in joints.items() if self._bears(j, body)} for body in found]
                names = tuple(name for j, name in (ways[0] | ways[1]).items() if (j in ways[0]) != (j in ways[1]))
                yield Coupling(text=f"<{tag}> closes a loop between {between}", joints=names, loop=True)
            else:
                yield Coupling(text=f"an equality <{tag}> ties bodies together")


KINDS = {
    mujoco.mjtJoint.mjJNT_HINGE: "hinge",
    mujoco.mjtJoint.mjJNT_SLIDE: "slide",
    mujoco.mjtJoint.mjJNT_BALL: "ball",
    mujoco.mjtJoint.mjJNT_FREE: "free",
}
"""Kinds of joints by the field's words."""


def _transform(pos: np.ndarray, quat: np.ndarray) -> RigidTransform:
    """MuJoCo's position and quaternion, whose real part comes first."""
    return RigidTransform.from_components(pos, Rotation.from_quat(quat, scalar_first=True))
