"""A robot's MJCF, as MuJoCo compiles it."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import trimesh
from scipy.spatial.transform import RigidTransform, Rotation

from mrwarp.actuator.joint_motors import force_range
from mrwarp.robots.foreign import (
    NO_LIMITS,
    Body,
    Coupling,
    ForeignRobot,
    Joint,
    Keyframe,
    RobotFileError,
    Shape,
    joined,
    prim_names,
)
from mrwarp.robots.guesses import Guess, Subject, some
from mrwarp.run_dir import one_line
from mrwarp.runtime import silent

GEOMS = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "mesh",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}
"""Kinds of geoms that are taken over, and as what."""

KINDS = {
    mujoco.mjtJoint.mjJNT_HINGE: "hinge",
    mujoco.mjtJoint.mjJNT_SLIDE: "slide",
    mujoco.mjtJoint.mjJNT_BALL: "ball",
    mujoco.mjtJoint.mjJNT_FREE: "free",
}
"""Kinds of joints by the field's words."""


SPLIT = 1e-6
"""Share of a body's mass and inertia that each link has which is put between two of its joints: less than the numbers
of a written robot are exact to, and enough for a body."""

UNEVEN = "ranges of actuators that are not symmetric were taken as such, by their larger end"

AWAY = "gains that drive away were left out"

SHARED = "actuators that share a joint were added up"

EQUAL = 1e-9
"""Share of a number that is rounding."""

STANCES = ("home", "stand", "standing", "default")
"""Names of keyframes that are a stance, tried before others."""


def read_mjcf(path: Path, skip_meshes: bool, base: str | None) -> ForeignRobot:
    """Read an MJCF.

    Args:
        path: The file.
        skip_meshes: Whether all meshes are left out.
        base: One of :data:`BASES` in place of what the file says; None: a free joint lets it float.

    Raises:
        RobotFileError: MuJoCo cannot compile it, a value is NaN, there are two trunks or none, or the base slides.
    """
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)  # else it writes MUJOCO_LOG.TXT
    try:
        with silent(), warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            spec = mujoco.MjSpec.from_file(str(path))
            strip(spec, skip_meshes)
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
    robot = _Compiled(path, model, base).robot()
    texts = dict.fromkeys(" ".join(str(warning.message).split()) for warning in caught)
    robot.notes += [Guess(subject=Subject.OMITTED, text=f"MuJoCo reads the file, and warns: {text}") for text in texts]
    return robot


def strip(spec: mujoco.MjSpec, meshes: bool) -> None:
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

    def __init__(self, path: Path, model: mujoco.MjModel, base: str | None) -> None:
        self.path, self.model, self.base = path, model, base
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
        """The body that floats, or would; else the world, of which the base is a part."""
        model = self.model
        free = [int(model.jnt_bodyid[j]) for j in range(model.njnt) if self._kind(j) == mujoco.mjtJoint.mjJNT_FREE]
        anchored = [
            i for i in range(1, model.nbody) if model.body_jntnum[i] and not model.body_weldid[model.body_parentid[i]]
        ]
        if not anchored:
            raise RobotFileError(f"{self.path}: there is no body that could move; is it a robot's file?")
        tops = {self._top(i) for i in anchored}
        if len(tops) > 1 and (free or self.base == "free"):
            first, second = (self.labels[i] for i in sorted(tops, key=lambda i: i not in free)[:2])
            raise RobotFileError(f"{self.path}: {first} and {second} are two trunks; remove one")
        if not free and self.base == "free":
            (top,) = tops
            if self.model.body_jntnum[top]:
                joint = self.joint_labels[self.model.body_jntadr[top]]
                raise RobotFileError(
                    f"{self.path}: --base free: {joint} joins {self.labels[top]} to the world, so that no base is left "
                    "to float; put a body between them there, or leave --base out"
                )
            return top, True
        return (free[0], self.base != "fixed") if free else (0, False)

    def _top(self, body: int) -> int:
        """The body of the world that bears a body, or is it."""
        while self.model.body_parentid[body]:
            body = int(self.model.body_parentid[body])
        return body

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
        if not self.root:  # the root is what bears the first moving body
            bearer = int(model.body_parentid[own[1]])
            labels[0] = self.labels[bearer] if bearer else "base"
        moving = {i: self._joints_of(i) for i in own if i != self.root}
        links = {j: (len(own) + k, i) for k, (i, j) in enumerate((i, j) for i in moving for j in moving[i][:-1])}
        labels += [f"{self.labels[i]}_{self.joint_labels[j]}" for j, (_, i) in links.items()]
        bodies = [self._body(i, name) for i, name in zip(own, prim_names(labels), strict=False)]
        for name, (_, i) in zip(prim_names(labels)[len(own) :], links.values(), strict=True):
            body = bodies[number[i]]
            bodies.append(replace(body, name=name, mass=SPLIT * body.mass, inertia=_split(body)))
        for i, found in moving.items():
            share, body = len(found) - 1, bodies[number[i]]
            left = (1.0 - SPLIT * share) * body.mass
            bodies[number[i]] = replace(body, mass=left, inertia=body.inertia - share * _split(body))
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
        notes = [*self._actuators(by_joint), *self._left_out(by_joint)]
        if several := [self.labels[i] for i, found in moving.items() if found[1:]]:
            more = " and others" if several[3:] else ""
            notes.append(
                f"links of a millionth of the body's mass were put between the joints of {', '.join(several[:3])}{more}"
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
            base_said="user" if self.base else "file" if self.root else "",
            couplings=list(self._couplings(by_joint)),
            keyframes=self._keyframes(by_joint),
            notes=[Guess(subject=Subject.OMITTED, text=text) for text in notes],
        ).upright(placed if self.root else Rotation.identity())

    def _body(self, i: int, name: str) -> Body:
        """A body with all that is welded to it."""
        body = Body(name=name, mass=0.0, com=np.zeros(3), inertia=np.zeros((3, 3)))
        bearing = {self._top(j) for j in range(1, self.model.nbody) if self.model.body_jntnum[j]}
        for k in range(1, self.model.nbody):
            if self.owner[k] == i and self._top(k) in bearing:  # else it is scenery
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
            limits=(low, high) if model.jnt_limited[j] and 0.0 < high - low <= NO_LIMITS else None,
            armature=float(model.dof_armature[dof]),
            kd=float(model.dof_damping[dof]) or None,
            torque_limit=float(np.abs(model.jnt_actfrcrange[j]).max()) if forced else None,
        )

    def _actuators(self, joints: dict[int, Joint]) -> Iterator[str]:
        """Take gains and torque limits from the actuators; notes on what of them is left out."""
        model, others, left = self.model, [], {}
        for j, joint in joints.items():
            low, high = model.jnt_actfrcrange[j]
            if model.jnt_actfrclimited[j] and _uneven(low, high):
                left.setdefault(UNEVEN, []).append(f"{low:g} to {high:g} of {joint.name}")
        driving: dict[int, list[int]] = {}
        for k in range(model.nu):
            j = int(model.actuator_trnid[k, 0])
            if model.actuator_trntype[k] == mujoco.mjtTrn.mjTRN_JOINT and j in joints:
                driving.setdefault(j, []).append(k)
            else:
                others.append(self._actuator_label(k))
        for j, own in driving.items():
            joint = joints[j]
            self._add_up(joint, own)
            found = [part for k in own for part in self._left_of(k, joint)]
            if own[1:]:
                self._check_sum(joint, own, found)
                found.append((SHARED, " and ".join(map(self._actuator_label, own))))
            for kind, text in found:
                left.setdefault(kind, []).append(f"{text} of {joint.name}")
        yield from (f"{text}: {', '.join(names)}" for text, names in left.items())
        if others:
            yield f"actuators of tendons and sites were left out: {', '.join(others[:4])}"

    def _actuator_label(self, k: int) -> str:
        return self.model.actuator(k).name or f"actuator_{k}"

    def _add_up(self, joint: Joint, own: Sequence[int]) -> None:
        """Give a joint the sum of its actuators: rotors, gains if one of them holds an angle, torque limits."""
        model, kp, kd, most = self.model, 0.0, 0.0, 0.0
        for k in own:
            gear, bias = abs(float(model.actuator_gear[k, 0])), model.actuator_biasprm[k]
            joint.armature += float(model.actuator_armature[k]) * gear**2
            most += max(map(abs, force_range(model, k))) * gear
            if model.actuator_biastype[k] == mujoco.mjtBias.mjBIAS_AFFINE:
                kp += max(0.0, -float(bias[1])) * gear**2
                kd += max(0.0, -float(bias[2])) * gear**2
        if kp:
            joint.kp, joint.kd = kp, (joint.kd or 0.0) + kd or None
        most = min(most, joint.torque_limit or math.inf)
        joint.torque_limit = most if math.isfinite(most) else None

    def _check_sum(self, joint: Joint, own: Sequence[int], left: Sequence[tuple[str, str]]) -> None:
        """Refuse actuators of one joint whose torques and gains do not add up to those of one motor.

        Raises:
            RobotFileError: they turn it in opposite directions, or one has an asymmetric range or drives away.
        """
        names = " and ".join(map(self._actuator_label, own))
        turns = [self.model.actuator_gear[k, 0] * self.model.actuator_gainprm[k, 0] for k in own]
        faults = {UNEVEN: "the range of one is", AWAY: "the gains of one drive away:"}
        bad = [f"{faults[kind]} {text}" for kind, text in left if kind in faults]
        if min(turns) < 0.0 < max(turns):
            bad.append(f"they turn it by {', '.join(f'{turn:g}' for turn in turns)} for a command of 1")
        if bad:
            raise RobotFileError(
                f"{self.path}: joint {joint.name} has the actuators {names}, which do not add up to one motor: "
                f"{bad[0]}; write one actuator in their place"
            )

    def _left_of(self, k: int, joint: Joint) -> Iterator[tuple[str, str]]:
        """Parts of a joint's actuator that no drive has, by kind, each with its value."""
        model, gear = self.model, float(self.model.actuator_gear[k, 0])
        bias, gain = (x[k] for x in (model.actuator_biasprm, model.actuator_gainprm))
        if model.actuator_gaintype[k] == mujoco.mjtGain.mjGAIN_DCMOTOR:
            yield "the back-EMF of DC motors was left out", f"{gain[1] ** 2 / gain[0] * gear**2:.3g} N·m·s/rad"
            return
        affine = model.actuator_biastype[k] == mujoco.mjtBias.mjBIAS_AFFINE
        servo = affine and bias[1] < 0.0
        if affine and bias[2] and joint.kp is None:
            yield "the gains of velocity actuators were left out", f"{-bias[2] * gear**2:.3g} N·m·s/rad"
        if affine and bias[0]:
            yield "constant torques of actuators were left out", f"{bias[0] * gear:.3g} N·m"
        if servo and abs(gain[0] + bias[1] * gear) > EQUAL * abs(bias[1] * gear):
            one, other = gain[0] * gear, -bias[1] * gear**2
            yield "commands of servos were taken as angles", f"{one:.4g} for a command, {other:.4g} for an angle"
        if affine and (bias[1] > 0.0 or (servo and bias[2] > 0.0)):
            yield AWAY, f"{bias[1]:.3g} and {bias[2]:.3g}"
        own, plain = mujoco.mjtGain(model.actuator_gaintype[k]), mujoco.mjtBias(model.actuator_biastype[k])
        if own != mujoco.mjtGain.mjGAIN_FIXED or plain not in (
            mujoco.mjtBias.mjBIAS_NONE,
            mujoco.mjtBias.mjBIAS_AFFINE,
        ):
            names = " and ".join(kind.name.removeprefix("mj").lower() for kind in (own, plain))
            yield "laws of actuators were left out", names
        low, high = model.actuator_ctrlrange[k]
        if affine and model.actuator_ctrllimited[k] and not np.allclose((low, high), joint.limits or np.nan):
            yield "ranges of commands were left out", f"{low:g} to {high:g}"
        if not affine and model.actuator_ctrllimited[k] and _uneven(low, high):
            yield UNEVEN, f"{low:g} to {high:g}"
        low, high = model.actuator_forcerange[k]
        if model.actuator_forcelimited[k] and _uneven(low, high):
            yield UNEVEN, f"{low:g} to {high:g}"

    def _keyframes(self, joints: dict[int, Joint]) -> list[Keyframe]:
        """The file's keyframes, first the one that is called a stance; its angles are the joints' home."""
        model, up = self.model, np.array([0.0, 0.0, 1.0])
        drawn = Rotation.from_quat(model.body_quat[self.root], scalar_first=True) if self.root else Rotation.identity()
        found = []
        for k in range(model.nkey):
            qpos, lean = model.key_qpos[k], 0.0
            if self.root:
                first = int(model.body_jntadr[self.root])
                free = first >= 0 and self._kind(first) == mujoco.mjtJoint.mjJNT_FREE
                at = int(model.jnt_qposadr[first]) + 3 if free else 0
                placed = Rotation.from_quat(qpos[at : at + 4], scalar_first=True) if free else drawn
                lean = float(np.arccos(np.clip((placed * drawn.inv()).apply(up) @ up, -1.0, 1.0)))
            angles = {joint.name: float(qpos[model.jnt_qposadr[j]]) for j, joint in joints.items()}
            found.append(Keyframe(name=model.key(k).name or f"number {k}", angles=angles, lean=lean))
        ranks = {name: k for k, name in enumerate(STANCES)}
        found.sort(key=lambda key: ranks.get(key.name, len(STANCES)))
        for joint in joints.values() if found else ():
            joint.home = found[0].angles[joint.name]
        return found

    def _left_out(self, joints: dict[int, Joint]) -> Iterator[str]:
        model = self.model
        geoms = [(model.geom(g).name or self.labels[body], body, g) for g, body in enumerate(model.geom_bodyid)]
        scene = [name for name, body, _ in geoms if body == 0 or self.owner[body] < 0]
        if scene:
            yield f"shapes of the scene were left out: {some(scene)}"
        kinds = [mujoco.mjtGeom(kind) for kind in model.geom_type]
        if strange := [name for name, _, g in geoms if name not in scene and kinds[g] not in GEOMS]:
            yield f"shapes of other kinds were left out: {some(strange)}"
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
        """Ties of bodies or joints in addition to the tree."""
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


def _split(body: Body) -> np.ndarray:
    """Inertia of a link between two joints of a body.

    It is equal about all axes, for Newton adds to moments near 0. That of a flat body is flat, as is what remains.
    """
    first, second, most = np.linalg.eigvalsh(body.inertia)
    flat = first + second - most < 10.0 * SPLIT * most
    return SPLIT * body.inertia if flat else SPLIT * most * np.eye(3)


def _uneven(low: float, high: float) -> bool:
    """Whether a range is not symmetric about zero."""
    return abs(low + high) > EQUAL * max(abs(low), abs(high))


def _transform(pos: np.ndarray, quat: np.ndarray) -> RigidTransform:
    """MuJoCo's position and quaternion, whose real part comes first."""
    return RigidTransform.from_components(pos, Rotation.from_quat(quat, scalar_first=True))
