"""Chains of a robot's joints: which reach the ground, which have one build, and which stand on their far end."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.optimize import minimize

from mrwarp.robots.foreign import ForeignRobot, Joint, RobotFileError
from mrwarp.robots.guesses import Guess, Subject, some
from mrwarp.robots.surfaces import SOLE, lowest, surface

GROUND_SHARE, LEVEL_SHARE = 0.15, 0.05
"""Ends of chains that lie this share of the height above the lowest one still reach the ground: hanging with all joints
at 0, and in a keyframe, where feet are level."""

EQUAL, EQUAL_MASS = 0.02, 0.2
"""Chains whose lengths differ by no more than this share have one build; legs do, a tail or one arm is not. Where one
of them is a leg, so are those whose masses differ by no more than the second share."""

KNEES = 0.75
"""A leg stands on its far end if what touches the ground lies at this share of its reach or further: a knee lies at
about half of it, the heel of a long foot at 0.8 or more."""

Path = list[Joint]
"""Joints from the root to a body."""


def chains(robot: ForeignRobot) -> list[Path]:
    """Joints from the root to every last body."""
    parents = {joint.child: joint for joint in robot.joints}
    inner = {joint.parent for joint in robot.joints}
    found = []
    for joint in robot.joints:
        if joint.child in inner:
            continue
        chain = [joint]
        while chain[0].parent in parents:
            chain.insert(0, parents[chain[0].parent])
        found.append(chain)
    return found


def named_paths(robot: ForeignRobot, feet: Sequence[str]) -> list[Path]:
    """Joints from the root to bodies by name.

    Raises:
        RobotFileError: there is no such body at a joint.
    """
    known = {robot.bodies[j.child].name: chain[: k + 1] for chain in chains(robot) for k, j in enumerate(chain)}
    if unknown := [name for name in feet if name not in known]:
        raise RobotFileError(
            f"{robot.path}: --feet {unknown[0]} is no body at a joint; choose among {', '.join(known)}"
        )
    return [known[name] for name in feet]


def hanging(
    robot: ForeignRobot, pose: Mapping[str, float], share: float, *, twins: bool = False
) -> tuple[list[Path], list[Guess]]:
    """Joints to the bodies that reach the ground in a pose, of chains of one build if there are such, and notes.

    Args:
        robot: The robot.
        pose: Angles [rad]; joints that are not named are at 0.
        share: How far above the lowest an end may lie, as a share of the height.
        twins: Whether what is built as a leg is one wherever its end lies.
    """
    poses, found = robot.poses(pose), chains(robot)
    lows = [[lowest(robot, joint.child, poses)[2] for joint in chain] for chain in found]
    floor = min((min(low) for low in lows), default=0.0)
    if not floor < min(-0.02 * max(map(length, found), default=0.0), lowest(robot, robot.root, poses)[2]):
        return [], []  # the trunk would lie on the ground
    # a leg ends at its first body that is on the ground: toes are part of the foot
    ends = [next((k for k, z in enumerate(low) if z < min(low) + SOLE), 0) for low in lows]
    near = [chain[: k + 1] for chain, low, k in zip(found, lows, ends, strict=True) if min(low) < (1.0 - share) * floor]
    paths = _by_body(near)
    legs = [path for path in paths if sum(same_build(path, other) for other in paths) > 1] or paths
    if twins and len(legs) > 1:
        legs = _by_body([*legs, *left_out(robot, legs)])
    notes = []
    if alone := [robot.bodies[path[-1].child].name for path in paths if path not in legs]:
        text = f"{some(alone)} hangs as low as the feet, but no other is like it: it counts as no leg"
        notes.append(Guess(subject=Subject.LEGS, text=text))
    return legs, notes


def _by_body(paths: Sequence[Path]) -> list[Path]:
    """Each path once, in the file's order of joints."""
    return list({path[-1].child: path for path in paths}.values())


def left_out(robot: ForeignRobot, legs: Sequence[Path]) -> list[Path]:
    """Chains that are built and weigh as one of the legs, and are none of them."""
    own = {joint.child for path in legs for joint in path}
    model = legs[0] if legs else []
    others = [chain[: len(model)] for chain in chains(robot) if len(chain) >= len(model)]
    mass = _mass(robot, model)
    return [
        other
        for other in _by_body(others)
        if other[-1].child not in own
        and same_build(other, model)
        and abs(_mass(robot, other) - mass) <= EQUAL_MASS * max(_mass(robot, other), mass)
    ]


def _mass(robot: ForeignRobot, path: Sequence[Joint]) -> float:
    return sum(robot.bodies[joint.child].mass for joint in path)


def length(path: Sequence[Joint]) -> float:
    """Distance along a path's joints [m]; offsets of the first are the trunk's."""
    return sum(float(np.linalg.norm((j.in_child.inv() * k.in_parent).translation)) for j, k in itertools.pairwise(path))


def same_build(a: Sequence[Joint], b: Sequence[Joint]) -> bool:
    """Whether two paths have equally many joints at equal distances."""
    return len(a) == len(b) and abs(length(a) - length(b)) <= EQUAL * max(length(a), length(b))


def limbs(robot: ForeignRobot) -> list[Path]:
    """The most numerous chains of one build that hang from the root itself, one of each first joint."""
    own = list({chain[0].name: chain for chain in chains(robot)}.values())
    return max(([other for other in own if same_build(chain, other)] for chain in own), key=len, default=[])


def reaching(robot: ForeignRobot) -> tuple[list[Path], dict[str, float]]:
    """Where nothing hangs: the most numerous chains of one build that reach down, and the angles that stretch them."""
    found = chains(robot)
    kinds = [[other for other in found if same_build(chain, other)] for chain in found]
    legs = max(kinds, key=len, default=[])
    pose: dict[str, float] = {}
    for leg in legs if len(legs) > 1 else []:
        low = [joint.limits[0] if joint.limits else -np.pi for joint in leg]
        high = [joint.limits[1] if joint.limits else np.pi for joint in leg]
        far = length(leg)

        def depth(q: np.ndarray, leg: list[Joint] = leg, far: float = far) -> float:
            poses = robot.poses({joint.name: float(x) for joint, x in zip(leg, q, strict=True)}, leg)
            return float(lowest(robot, leg[-1].child, poses)[2] + 1e-3 * far * (q @ q))

        starts = (np.clip(np.full(len(leg), start), low, high) for start in (0.3, -0.3))
        bounds = list(zip(low, high, strict=True))
        tried = [minimize(depth, start, method="Powell", bounds=bounds) for start in starts]
        best = min(tried, key=lambda result: result.fun)
        if best.fun > -0.5 * far:
            return [], {}
        pose.update({joint.name: float(x) for joint, x in zip(leg, best.x, strict=True)})
    return (legs, pose) if len(legs) > 1 else ([], {})


def on_knees(robot: ForeignRobot, pose: Mapping[str, float], path: Sequence[Joint]) -> bool:
    """Whether a leg would stand on what lies far before its end: see :data:`KNEES`."""
    poses = robot.poses(pose)
    far, low = zip(*_reaches(robot, poses, path), strict=True)
    far, low = np.concatenate(far), np.concatenate(low)
    return bool(far[low < low.min() + SOLE].max() < KNEES * far.max())


def _reaches(robot: ForeignRobot, poses: list, path: Sequence[Joint]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Reach along the leg and height of points all over its last body and of what that carries [m], each (N,)."""
    before = {path[-1].child: length(path)}
    for joint in [path[-1], *robot.joints]:  # parents come first
        if joint is not path[-1]:
            if joint.parent not in before or joint.child in before:
                continue
            own = next(j for j in robot.joints if j.child == joint.parent)
            before[joint.child] = before[joint.parent] + length([own, joint])
        anchor = (poses[joint.parent] * joint.in_parent).translation
        points = poses[joint.child].apply(np.vstack([np.zeros(3), surface(robot, joint.child)]))
        yield before[joint.child] + np.linalg.norm(points - anchor, axis=1), points[:, 2]


def own_joints(paths: Sequence[Path]) -> list[Path]:
    """The part of each path that is its own: a spine or a waist that bears several legs belongs to none."""
    often = Counter(joint.name for path in paths for joint in path)
    return [[joint for joint in path if often[joint.name] == 1 or len(paths) == 1] for path in paths]
