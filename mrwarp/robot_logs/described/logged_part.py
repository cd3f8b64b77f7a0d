"""Of a described scene the robot of a log: its trunk and its floor, joints that move, and what their motors give."""

from __future__ import annotations

import copy
import difflib
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

from mrwarp.actuator.joint_motors import rotor, torque_range
from mrwarp.robot_logs.robot_log import LogError

TURNING = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
"""Kinds of joints that a log can have."""


def name_all(spec: mujoco.MjSpec) -> None:
    """Name bodies and joints that have no name as :mod:`mrwarp.robots.mjcf` does: places go by names."""
    for kind, parts in (("body", spec.bodies), ("joint", spec.joints)):
        for k, part in enumerate(parts):
            part.name = part.name or f"{kind}_{k}"


def check_joints(path: Path, logged: Sequence[str], known: Sequence[str]) -> None:
    """Refuse a log with joints that are not among those ``known``."""
    for joint in logged:
        if joint not in known:
            near = difflib.get_close_matches(joint, known, 1)
            hint = f"; is it {near[0]}?" if near else "; name the log's joints as the robot does, in joints of a map"
            raise LogError(f"{path}: the log's joint {joint} is not among the robot's ({', '.join(known)}){hint}")


def let_float(path: Path, spec: mujoco.MjSpec, logged: Sequence[str]) -> None:
    """Let the body that bears the log's joints float, alone: what else floats in a scene is no part of the robot.

    Raises:
        LogError: several bodies bear them, or one that a joint ties to the world.
    """
    tops = {top.name: top for top in (_above(spec.joint(joint).parent)[-1] for joint in logged)}
    if len(tops) > 1:
        raise LogError(f"{path}: the log's joints are on {', '.join(tops)}; the log says base = free: name one robot's")
    (trunk,) = tops.values()
    for body in [x for x in spec.worldbody.bodies if x.name != trunk.name]:
        if any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in body.joints):
            spec.delete(body)
    kinds = [joint.type for joint in trunk.joints]
    if not kinds:
        trunk.add_freejoint()
    elif kinds != [mujoco.mjtJoint.mjJNT_FREE]:
        joint = trunk.joints[0].name
        raise LogError(f"{path}: {joint} ties {trunk.name} to the world; the log says base = free: correct either")


def _above(body: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    """A body and those that bear it, but for the world."""
    found = []
    while body.parent is not None:
        found.append(body)
        body = body.parent
    return found


def hold(spec: mujoco.MjSpec, logged: Sequence[str], drives: Iterable[str]) -> tuple[str, ...]:
    """Take out joints that are not ``logged`` and that a drive holds, with all that ties them; returns their names.

    A description that names no drive, as a URDF, has one at each joint. Joints without a drive are passive, as springs
    and casters. What a constraint or a tendon ties together moves if the log has one of it, and is held by one drive.
    """
    targets = {drive.target for drive in spec.actuators} | set(drives)
    own = {joint.name for joint in spec.joints if joint.type in TURNING}
    groups = [({name}, []) for name in own]
    for part, tied in _ties(spec):
        tied = tied & own
        joined = [group for group in groups if group[0] & tied]
        groups = [group for group in groups if not group[0] & tied]
        groups.append((tied.union(*(x for x, _ in joined)), [part, *(y for _, parts in joined for y in parts)]))
    held: set[str] = set()
    for names, parts in groups:
        driven = not targets or targets & {*names, *(part.name for part in parts)}
        if names and driven and names.isdisjoint(logged):
            held |= names
            for part in parts:
                spec.delete(part)
    found = [joint for joint in spec.joints if joint.name in held]
    order = tuple(joint.name for joint in found)
    for joint in found:
        spec.delete(joint)
    return order


def _ties(spec: mujoco.MjSpec) -> Iterator[tuple[mujoco.MjsTendon | mujoco.MjsEquality, set[str]]]:
    """Tendons and constraints, each with the joints that it ties; of bodies and sites those between them."""
    by_tendon: dict[str, set[str]] = {}
    for tendon in spec.tendons:
        parts = [wrap.target for wrap in tendon.path if wrap.target is not None]
        bodies = [part.parent for part in parts if not isinstance(part, mujoco.MjsJoint)]
        own = {part.name for part in parts if isinstance(part, mujoco.MjsJoint)} | _between(bodies)
        by_tendon[tendon.name] = by_tendon.get(tendon.name, set()) | own
        yield tendon, own
    for tie in spec.equalities:
        ends = [name for name in (tie.name1, tie.name2) if name]
        if tie.type == mujoco.mjtEq.mjEQ_JOINT:
            yield tie, set(ends)
        elif tie.type == mujoco.mjtEq.mjEQ_TENDON:
            yield tie, set().union(*(by_tendon.get(name, set()) for name in ends))
        elif tie.type in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            sites = tie.objtype == mujoco.mjtObj.mjOBJ_SITE
            yield tie, _between([spec.site(name).parent if sites else spec.body(name) for name in ends])


def _between(bodies: Sequence[mujoco.MjsBody]) -> set[str]:
    """Joints by which some of several bodies, or the world, move against others; one body alone moves against it."""
    ways = [{joint.name for body in _above(own) for joint in body.joints} for own in bodies]
    ways += [set()] * (len(ways) == 1)
    return set().union(*ways).difference(set.intersection(*ways)) if ways else set()


def motors(model: mujoco.MjModel, logged: Sequence[str]) -> tuple[dict[str, list[float]], dict[str, float]]:
    """By joint the range of the motors' torque where they have one [N·m], and their rotors' inertia [kg·m²]."""
    ids = {name: model.joint(name).id for name in logged}
    ranges = {name: list(torque_range(model, j)) for name, j in ids.items()}
    limited = {name: ends for name, ends in ranges.items() if all(map(math.isfinite, ends))}
    return limited, {name: rotor(model, j) for name, j in ids.items()}


def floor_height(model: mujoco.MjModel) -> float | None:
    """Height of what stands still under the body that floats [m]; None: there is nothing to stand on."""
    bare, data = copy.copy(model), mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    still = touches & (model.body_weldid[model.geom_bodyid] == 0)
    bare.geom_group[:], bare.geom_matid[:], bare.geom_rgba[:, 3] = ~still, -1, 1.0  # no ray sees what is transparent
    trunk = int(model.jnt_bodyid[np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)[0]])
    above, ground = data.xpos[trunk] + [0.0, 0.0, model.stat.extent], np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
    far = mujoco.mj_ray(bare, data, above, np.array([0.0, 0.0, -1.0]), ground, 1, -1, np.zeros(1, dtype=np.int32))
    return float(above[2] - far) if far >= 0.0 else None
