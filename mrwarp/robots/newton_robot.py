"""URDF and USD robots as Newton's importers read them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from mrwarp.robots.foreign import (
    NO_LIMITS,
    SHAPES,
    Body,
    Coupling,
    ForeignRobot,
    Joint,
    RobotFileError,
    Shape,
    prim_names,
)
from mrwarp.robots.guesses import Guess, Subject, some
from mrwarp.run_dir import one_line
from mrwarp.runtime import quiet_libraries, silent, unwarned

KINDS = {"REVOLUTE": "hinge", "PRISMATIC": "slide"}
"""Kinds of joints by the field's words; others keep Newton's, in small letters."""


def read_by_newton(path: Path, add: Callable[[Any], Any], base: str | None) -> ForeignRobot:
    """Read a URDF or USD file.

    Args:
        path: The file.
        add: Puts its content into a builder.
        base: One of :data:`BASES`, in place of what the file says.

    Raises:
        RobotFileError: it cannot be read, has no bodies or two trunks, or joins the world by a joint.
    """
    import newton  # it takes seconds to load

    quiet_libraries(gpu=False, networks=False)
    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    try:
        with silent(), unwarned():
            add(builder)
    except Exception as error:  # importers raise many types for a file that is no robot
        text = one_line(error)
        more = ", or say --skip-meshes" if text.startswith("Mesh file") else ""
        raise RobotFileError(f"{path}: Newton cannot read it ({text}); correct it there{more}") from None
    return _robot(path, builder, base)


def add_stage(builder: Any, stage: Any) -> None:
    """Put a USD stage into a builder, with the numbers of Newton's, MuJoCo's and PhysX's attributes.

    Fixed joints stay, against what its scene may say: Newton 1.8 merges inertias wrongly.
    """
    from newton import usd  # it takes seconds to load

    resolvers = [usd.SchemaResolverNewton(), usd.SchemaResolverMjc(), usd.SchemaResolverPhysx()]
    builder.add_usd(stage, schema_resolvers=resolvers)


def _robot(path: Path, builder: Any, base: str | None) -> ForeignRobot:
    """The builder's content, with the links on fixed joints as parts of those that bear them."""
    from newton import JointType

    fixed = {i for i, kind in enumerate(builder.joint_type) if kind == JointType.FIXED}
    scenery = _scenery(builder, fixed)
    if len(scenery) == len(builder.body_label):
        raise RobotFileError(f"{path}: there is no body that could move; is it a robot's file?")
    merged = {builder.joint_child[i] for i in fixed if builder.joint_parent[i] >= 0} | scenery
    bodies = [
        Body(
            name=name,
            mass=float(builder.body_mass[i]),
            com=np.array(builder.body_com[i], dtype=float),
            inertia=np.array(builder.body_inertia[i], dtype=float).reshape(3, 3),
        )
        for i, name in enumerate(_names(builder.body_label, merged))
    ]
    names = _names(builder.joint_label, fixed)
    labels = [label.rpartition("/")[2] for label in builder.joint_label]
    root, floating, joints, couplings = None, True, [], []
    for i, number in enumerate(builder.joint_type):
        kind = JointType(number)
        parent, child = builder.joint_parent[i], builder.joint_child[i]
        if child in scenery:
            continue
        if builder.joint_articulation[i] < 0 and kind not in (JointType.PRISMATIC, JointType.FIXED):
            ends = " and ".join(bodies[k].name if k >= 0 else "the world" for k in (parent, child))
            couplings.append(Coupling(text=f"joint {labels[i]} closes a loop between {ends}"))
        elif parent < 0:
            if root is not None:
                raise RobotFileError(f"{path}: {bodies[root].name} and {bodies[child].name} are two trunks; remove one")
            root, floating = child, base == "free" or (base is None and kind == JointType.FREE)
            if kind in (JointType.REVOLUTE, JointType.PRISMATIC):
                if base == "free":
                    raise RobotFileError(
                        f"{path}: --base free: {labels[i]} joins {bodies[child].name} to the world, so that no base is "
                        "left to float; put a body between them there, or leave --base out"
                    )
                floating = False
                root = len(bodies)
                bodies.append(Body(name="base", mass=0.0, com=np.zeros(3), inertia=np.zeros((3, 3))))
                joints.append(_joint(builder, i, root, child, names[i]))
            elif kind not in (JointType.FREE, JointType.FIXED):
                raise RobotFileError(
                    f"{path}: {labels[i]} joins the world by a {KINDS.get(kind.name, kind.name.lower())} joint; "
                    "only floating robots, arms with a hinge there and legs on a rail are imported"
                )
        else:
            joints.append(_joint(builder, i, parent, child, names[i]))
    if root is None:
        raise RobotFileError(f"{path}: no body is the root of the others; is it a robot's file?")
    shapes, notes = _shapes(builder)
    moving = {joint.name for joint in joints if joint.kind != "fixed"}
    renamed = [f"{old} is {new}" for old, new in zip(labels, names, strict=True) if new in moving and old != new]
    if renamed:
        notes.append(Guess(subject=Subject.OMITTED, text=f"names that USD takes: {some(renamed)}"))
    whole = root < len(builder.body_q)  # else it is the world, and has no place
    placed = _transform(builder.body_q[root]).rotation if whole else Rotation.identity()
    robot = ForeignRobot(
        path=path,
        name=prim_names([path.stem])[0],
        bodies=bodies,
        joints=_in_order(joints, root),
        shapes=[shape for shape in shapes if shape.body not in scenery],
        root=root,
        floating=floating,
        base_said="user" if base else "file",
        couplings=couplings,
        notes=notes,
    )
    return robot.fixed({joint.name: 0.0 for joint in joints if joint.kind == "fixed"}).upright(placed)


def _scenery(builder: Any, fixed: Collection[int]) -> set[int]:
    """Bodies that are fixed to the world and bear nothing that moves."""
    held = {-1}
    for _ in fixed:
        held |= {builder.joint_child[i] for i in fixed if builder.joint_parent[i] in held}
    bears = {builder.joint_parent[i] for i in range(len(builder.joint_type)) if i not in fixed}
    for _ in fixed:
        bears |= {builder.joint_parent[i] for i in fixed if builder.joint_child[i] in bears}
    return held - bears - {-1}


def _in_order(joints: Sequence[Joint], root: int) -> list[Joint]:
    """Joints from the root on, a limb after the other, so that parents come first."""
    below: dict[int, list[Joint]] = {}
    for joint in sorted(joints, key=lambda joint: joint.child):
        below.setdefault(joint.parent, []).append(joint)
    found, left = [], below.pop(root, [])[::-1]
    while left:
        found.append(left.pop())
        left += below.pop(found[-1].child, [])[::-1]
    return [*found, *(joint for own in below.values() for joint in own)]


def _names(labels: Sequence[str], last: Collection[int]) -> list[str]:
    """Names from Newton's labels, which are paths: the last part, or as much as distinguishes them.

    Args:
        labels: Newton's labels.
        last: Those that are merged, so that the others' names come first.
    """
    short = [label.rstrip("/").rpartition("/")[2] for label in labels]
    often = Counter(name for k, name in enumerate(short) if k not in last)
    order = sorted(range(len(labels)), key=lambda k: k in last)
    names = prim_names([short[k] if often[short[k]] == 1 and k not in last else labels[k] for k in order])
    return [name for _, name in sorted(zip(order, names, strict=True))]


def _joint(builder: Any, i: int, parent: int, child: int, name: str) -> Joint:
    from newton import JointType

    kind = JointType(builder.joint_type[i])
    dof = min(builder.joint_qd_start[i], len(builder.joint_axis) - 1)
    low, high = float(builder.joint_limit_lower[dof]), float(builder.joint_limit_upper[dof])
    effort, kp, kd = (
        float(values[dof]) for values in (builder.joint_effort_limit, builder.joint_target_ke, builder.joint_target_kd)
    )
    axis = np.array(builder.joint_axis[dof], dtype=float)
    return Joint(
        name=name,
        kind=KINDS.get(kind.name, kind.name.lower()),
        parent=parent,
        child=child,
        in_parent=_transform(builder.joint_X_p[i]),
        in_child=_transform(builder.joint_X_c[i]),
        axis=axis / max(float(np.linalg.norm(axis)), 1e-9),
        limits=(low, high) if low < high and high - low <= NO_LIMITS else None,
        armature=float(builder.joint_armature[dof]),
        kp=kp or None,
        kd=kd or None,
        torque_limit=effort if 0.0 < effort < 1e5 else None,
    )


def _shapes(builder: Any) -> tuple[list[Shape], list[Guess]]:
    from newton import GeoType, ShapeFlags

    shapes, left_out = [], 0
    for i, number in enumerate(builder.shape_type):
        kind = GeoType(number).name.lower()
        flags = int(builder.shape_flags[i])
        collides, visible = bool(flags & ShapeFlags.COLLIDE_SHAPES), bool(flags & ShapeFlags.VISIBLE)
        if builder.shape_body[i] < 0 or not (collides or visible):
            continue
        if kind not in SHAPES:
            left_out += 1
            continue
        mesh: Any = builder.shape_source[i] if kind == "mesh" else None
        shapes.append(
            Shape(
                kind=kind,
                body=builder.shape_body[i],
                pose=_transform(builder.shape_transform[i]),
                size=np.array(builder.shape_scale[i], dtype=float),
                collides=collides,
                friction=float(builder.shape_material_mu[i]),
                points=None if mesh is None else np.array(mesh.vertices, dtype=float) * builder.shape_scale[i],
                faces=None if mesh is None else np.array(mesh.indices).reshape(-1, 3),
            )
        )
    text = f"{left_out} shapes of other kinds were left out"
    return shapes, [Guess(subject=Subject.OMITTED, text=text)] if left_out else []


def _transform(value: Any) -> RigidTransform:
    """A Warp transform: position, then quaternion with the real part last."""
    numbers = np.array(value, dtype=float)
    return RigidTransform.from_components(numbers[:3], Rotation.from_quat(numbers[3:]))
