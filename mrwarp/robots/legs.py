"""Legs found from a robot's kinematic tree: which chains reach the ground, their feet, order, stance and gait."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from mrwarp.robots.foreign import ForeignRobot, Joint, RobotFileError, Shape
from mrwarp.usd.robot import Layout, Leg

GROUND_SHARE = 0.15
"""Ends of chains that lie this share of the height above the lowest one still reach the ground."""

CROUCH = 0.73
"""Share of its reach at which a leg stands where the file has no keyframe: that of the shipped robot."""

SOLE = 0.005
"""Shapes of a foot that reach this close to its lowest point are its sole [m]."""

GAITS = {"trot": 4, "alternate": 2, "tripod": 6}
"""Gaits, and for how many legs each is meant."""

TORQUE_STEP = 0.005
"""Step of the torque loop [s], paper section 5.1."""

KP_PER_LIMIT, KD_PER_KP = 1.5, 0.02
"""Gains where the file has none: Kp = 1.5/rad of the torque limit, Kd = 0.02 s of Kp (Go1 in practice: 35 N·m/rad and
0.6 N·m·s/rad at 23.7 N·m)."""


@dataclass(frozen=True, kw_only=True)
class Drive:
    """The motor of a joint."""

    kp: float
    """[N·m/rad]"""
    kd: float
    """[N·m·s/rad]"""
    torque_limit: float
    """[N·m]"""
    gains_from: str
    """Where the gains come from: ``file``, ``option`` or ``rule``."""


@dataclass(frozen=True, kw_only=True)
class Foot:
    """What touches the ground: a sphere on the last body of a leg."""

    body: int
    centre: np.ndarray
    """In the body's frame [m], shape (3,)."""
    radius: float
    """[m]"""
    friction: float
    shape: Shape | None
    """The file's own sphere; None: one was put where the leg is lowest."""


@dataclass(frozen=True, kw_only=True)
class Choices:
    """What the user says in place of a guess; names of joints may hold * and ?."""

    pose: Mapping[str, float] = field(default_factory=dict)
    """Neutral angle [rad]."""
    kp: Mapping[str, float] = field(default_factory=dict)
    kd: Mapping[str, float] = field(default_factory=dict)
    torque_limit: Mapping[str, float] = field(default_factory=dict)
    armature: Mapping[str, float] = field(default_factory=dict)
    """Rotor inertia at the joint [kg·m²]."""
    gait: str = ""
    """One of :data:`GAITS`; empty: by the number of legs."""
    unlimited: tuple[str, ...] = ()
    """Joints that may turn without limits."""
    feet: tuple[str, ...] = ()
    """Bodies that carry a foot; empty: the ends of chains that are lowest."""
    fix: tuple[str, ...] = ()
    """Joints that are held at their neutral angle, as those of arms."""


@dataclass(frozen=True, kw_only=True)
class UnderstoodRobot:
    """A robot with what legged tasks need."""

    robot: ForeignRobot
    layout: Layout
    feet: tuple[Foot, ...]
    drives: dict[str, Drive]
    height: float
    """Height of the trunk in the neutral stance [m]."""
    notes: tuple[str, ...]
    """What was guessed or left out, for the user."""


def understand(robot: ForeignRobot, choices: Choices) -> UnderstoodRobot:
    """Find legs, feet, stance, gait and drives; a robot whose root stands still has no legs.

    Raises:
        RobotFileError: no chain reaches the ground, a torque limit is missing, a choice names no joint, or its angle
            lies outside a joint's limits.
    """
    numbers = (choices.pose, choices.kp, choices.kd, choices.torque_limit, choices.armature)
    for choice in (*numbers, choices.unlimited, choices.fix):
        for pattern in choice:
            if not fnmatch.filter([joint.name for joint in robot.joints], pattern):
                known = ", ".join(joint.name for joint in robot.joints)
                raise RobotFileError(f"{robot.path}: no joint is called {pattern}; choose among {known}")
    held = {j.name: j for j in robot.joints if any(fnmatch.fnmatchcase(j.name, name) for name in choices.fix)}
    angles = {name: _chosen(choices.pose, name) for name in held}
    robot = robot.fixed({name: _home(held[name]) if q is None else q for name, q in angles.items()})
    robot.check()
    chains = _chains(robot)
    driven = [joint for joint in robot.joints if joint.name not in robot.rails]
    for joint in driven:
        if joint.limits is None and not any(fnmatch.fnmatchcase(joint.name, name) for name in choices.unlimited):
            raise RobotFileError(
                f"{robot.path}: {joint.name} has no limits; give it some there, or say --unlimited {joint.name}"
            )
    notes = list(robot.notes)
    pose = {joint.name: _home(joint) for joint in driven}
    pose.update({joint.name: v for joint in driven if (v := _chosen(choices.pose, joint.name)) is not None})
    legs = _grounded(robot, chains, choices.feet) if robot.floating else []
    feet = {leg[-1].child: _foot(robot, leg[-1].child) for leg in legs}
    if legs and not all(
        joint.home is not None or _chosen(choices.pose, joint.name) is not None for joint in robot.joints
    ):
        pose = _stance(robot, legs, feet, pose, choices)
        notes.append("the file has no keyframe: the stance was solved; --pose JOINT=RAD changes it")
    for joint in driven:
        if joint.limits and not joint.limits[0] - 1e-6 <= pose[joint.name] <= joint.limits[1] + 1e-6:
            raise RobotFileError(
                f"{robot.path}: neutral angle of {joint.name} = {pose[joint.name]:.3f} rad lies outside its limits, "
                f"{joint.limits[0]:.3f} to {joint.limits[1]:.3f}; give --pose {joint.name}=RAD"
            )
    poses = robot.poses(pose)
    centres = np.array([poses[body].apply(foot.centre) for body, foot in feet.items()])
    # front legs first, left before right
    centres = centres.reshape(-1, 3)
    rows = np.round(centres[:, 0] / max(np.ptp(centres[:, 0]) if legs else 0.0, 0.05) * 2.0)
    order = sorted(range(len(legs)), key=lambda k: (-rows[k], -centres[k, 1]))
    legs, centres = [legs[k] for k in order], centres[order]
    touching = [feet[leg[-1].child] for leg in legs]
    notes += [
        f"{robot.bodies[foot.body].name} has no sphere below: one of {1e3 * foot.radius:.0f} mm was put there"
        for foot in touching
        if foot.shape is None
    ]
    names = _names(legs)
    phases = _phases(robot, choices.gait, rows[order], centres[:, 1])
    used = {joint.name for leg in legs for joint in leg}
    joints = [joint for leg in legs for joint in leg] + [joint for joint in driven if joint.name not in used]
    layout = Layout(
        trunk=robot.bodies[robot.root].name,
        legs=tuple(
            Leg(
                name=name,
                joints=tuple(joint.name for joint in leg),
                foot=f"{name}_foot",
                phase=phase,
                sole=foot.shape is None and any(s.collides and s.body == foot.body for s in robot.shapes),
            )
            for name, leg, phase, foot in zip(names, legs, phases, touching, strict=True)
        ),
        neutral={joint.name: pose[joint.name] for joint in joints},
    )
    drives = {joint.name: _drive(robot, joint, choices) for joint in joints}
    if ruled := [name for name, drive in drives.items() if drive.gains_from == "rule"]:
        notes.append(
            f"no gains for {', '.join(ruled[:3])}{' and others' if ruled[3:] else ''}: Kp = {KP_PER_LIMIT:g}/rad of "
            f"the torque limit, Kd = {KD_PER_KP:g} s of Kp; --kp and --kd change them"
        )
    robot, rotors = _armatures(robot, drives, choices)
    notes += rotors
    radii = np.array([foot.radius for foot in touching])
    height = float(-(centres[:, 2] - radii).min()) if legs else 0.0
    return UnderstoodRobot(
        robot=robot, layout=layout, feet=tuple(touching), drives=drives, height=height, notes=tuple(notes)
    )


def _chosen(choice: Mapping[str, float], name: str) -> float | None:
    """The last choice whose pattern fits."""
    found = [value for pattern, value in choice.items() if fnmatch.fnmatchcase(name, pattern)]
    return found[-1] if found else None


def _home(joint: Joint) -> float:
    """An angle to begin with [rad]: the keyframe's, else 0, or the middle of limits that leave it out."""
    if joint.home is not None:
        return joint.home
    if joint.limits is None or joint.limits[0] <= 0.0 <= joint.limits[1]:
        return 0.0
    return 0.5 * (joint.limits[0] + joint.limits[1])


def _chains(robot: ForeignRobot) -> list[list[Joint]]:
    """Joints from the root to every last body."""
    parents = {joint.child: joint for joint in robot.joints}
    inner = {joint.parent for joint in robot.joints}
    chains = []
    for joint in robot.joints:
        if joint.child in inner:
            continue
        chain = [joint]
        while chain[0].parent in parents:
            chain.insert(0, parents[chain[0].parent])
        chains.append(chain)
    return chains


def _grounded(robot: ForeignRobot, chains: list[list[Joint]], feet: Sequence[str]) -> list[list[Joint]]:
    """The chains whose ends reach the ground with all joints at 0, where legs hang stretched."""
    if feet:
        known = {robot.bodies[chain[-1].child].name: chain for chain in chains}
        for name in feet:
            if name not in known:
                raise RobotFileError(
                    f"{robot.path}: --feet {name} is not the end of a chain; choose among {', '.join(known)}"
                )
        return [known[name] for name in feet]
    poses = robot.poses({})
    ends = [_lowest(robot, chain[-1].child, poses)[2] for chain in chains]
    if not chains or min(ends) > -0.02:
        raise RobotFileError(
            f"{robot.path}: nothing hangs below {robot.bodies[robot.root].name}, so it has no legs; name the last "
            "bodies of its legs with --feet"
        )
    return [chain for chain, end in zip(chains, ends, strict=True) if end < (1.0 - GROUND_SHARE) * min(ends)]


def _extreme(shape: Shape, down: np.ndarray) -> np.ndarray:
    """The shape's farthest point along a direction of its own frame [m], shape (3,)."""
    size = shape.size
    if shape.kind == "sphere":
        return down * size[0]
    if shape.kind == "capsule":
        return down * size[0] + np.array([0.0, 0.0, np.sign(down[2]) * size[1]])
    if shape.kind == "box":
        return np.sign(down) * size
    if shape.kind == "cylinder":
        flat = np.array([down[0], down[1], 0.0])
        return flat / max(float(np.linalg.norm(flat)), 1e-9) * size[0] + np.array([0, 0, np.sign(down[2]) * size[1]])
    assert shape.points is not None
    return shape.points[np.argmax(shape.points @ down)]


def _lowest(robot: ForeignRobot, body: int, poses: list) -> np.ndarray:
    """Lowest point of a body in the root's frame [m]: of what collides, else of all shapes, else its origin."""
    points = [poses[body].translation, *(point for _, point in _extremes(robot, body, poses))]
    return min(points, key=lambda point: point[2])


def _extremes(robot: ForeignRobot, body: int, poses: list) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Centre and lowest point of each of a body's shapes in the root's frame [m]."""
    shapes = [shape for shape in robot.shapes if shape.body == body]
    for shape in [shape for shape in shapes if shape.collides] or shapes:
        world = poses[body] * shape.pose
        low = world.apply(_extreme(shape, world.rotation.inv().apply([0.0, 0.0, -1.0])))
        yield world.translation, low


def _foot(robot: ForeignRobot, body: int) -> Foot:
    """The sphere that touches the ground with the leg stretched: the lowest collision sphere, else one put there."""
    poses = robot.poses({})
    lowest = _lowest(robot, body, poses)
    best = None
    for shape in robot.shapes:
        if shape.body == body and shape.kind == "sphere" and shape.collides:
            centre = (poses[body] * shape.pose).translation
            if centre[2] - shape.size[0] < lowest[2] + 0.01 and (best is None or shape.size[0] > best.size[0]):
                best = shape
    if best is not None:
        return Foot(
            body=body, centre=best.pose.translation, radius=float(best.size[0]), friction=best.friction, shape=best
        )
    radius = 0.02
    own = [shape.friction for shape in robot.shapes if shape.body == body and shape.collides]
    sole = [centre for centre, low in _extremes(robot, body, poses) if low[2] < lowest[2] + SOLE]
    middle = np.array([*np.mean(sole or [lowest], axis=0)[:2], lowest[2] + radius])
    centre = poses[body].inv().apply(middle)
    return Foot(body=body, centre=centre, radius=radius, friction=max(own, default=0.8), shape=None)


def _stance(
    robot: ForeignRobot, legs: list[list[Joint]], feet: dict[int, Foot], pose: dict[str, float], choices: Choices
) -> dict[str, float]:
    """A stance: every foot below its leg's second joint, at :data:`CROUCH` of the reach, as far beside as stretched.

    Knees point inwards if they can; a foot on ankles stays level.
    """
    pose = dict(pose)
    for leg in legs:
        free = [joint for joint in leg if _chosen(choices.pose, joint.name) is None]
        if not free:
            continue
        low = np.array([max(joint.limits[0] + 1e-3, -2.0) if joint.limits else -2.0 for joint in free])
        high = np.array([min(joint.limits[1] - 1e-3, 2.0) if joint.limits else 2.0 for joint in free])
        end = feet[leg[-1].child]
        reach = sum(float(np.linalg.norm(joint.in_parent.translation)) for joint in leg[2:])
        reach += float(np.linalg.norm(end.centre))

        stretched = robot.poses({})
        upright = stretched[end.body].rotation.inv().apply([0.0, 0.0, 1.0])

        def seen(
            q: np.ndarray, leg: list[Joint], free: list[Joint], end: Foot, upright: np.ndarray = upright
        ) -> tuple[np.ndarray, ...]:
            alone = replace(robot, joints=leg)  # the other legs need not be followed
            poses = alone.poses({**pose, **{joint.name: x for joint, x in zip(free, q, strict=True)}})
            anchors = [(poses[joint.parent] * joint.in_parent).translation for joint in leg[:2] + leg[-1:]]
            foot, up = poses[end.body].apply(end.centre), poses[end.body].rotation.apply(upright)
            return anchors[0], anchors[min(1, len(leg) - 1)], anchors[-1], foot, up

        def miss(
            q: np.ndarray, leg: list[Joint], free: list[Joint], end: Foot, beside: float, reach: float
        ) -> np.ndarray:
            _, hip, _, foot, up = seen(q, leg, free, end)
            below, side, drop = (foot - hip) / reach
            level = up[:2] if len(leg) > 3 and end.shape is None else []
            return np.array([below, side - beside / reach, -drop - CROUCH, *(0.02 * q), *level])

        beside = (
            float(
                stretched[end.body].apply(end.centre)[1] - (stretched[leg[1].parent] * leg[1].in_parent).translation[1]
            )
            if leg[1:]
            else 0.0
        )
        bend = np.array([0.0] * (len(free) - 2) + [0.7, -1.4][-len(free) :])
        results = [
            least_squares(miss, np.clip(start, low, high), bounds=(low, high), args=(leg, free, end, beside, reach))
            for start in (bend, -bend, 0.5 * (low + high))
        ]
        near = [result for result in results if result.cost < min(r.cost for r in results) + 1e-3]

        def inwards(result: Any, leg: list[Joint] = leg, free: list[Joint] = free, end: Foot = end) -> float:
            first, hip, knee, foot, _ = seen(result.x, leg, free, end)
            return float((knee[0] - 0.5 * (hip[0] + foot[0])) * (1.0 if first[0] < 0.0 else -1.0))

        found = max(near, key=inwards)
        pose.update({joint.name: round(float(x), 3) for joint, x in zip(free, found.x, strict=True)})
    return pose


def _names(legs: list[list[Joint]]) -> list[str]:
    """Names of the legs: what the names of a leg's joints and no other's begin with, else numbers."""
    names = []
    for k, leg in enumerate(legs):
        prefix = leg[0].name
        for joint in leg[1:]:
            while not joint.name.startswith(prefix):
                prefix = prefix[:-1]
        prefix = prefix.rstrip("_")
        names.append(prefix if prefix else f"leg{k + 1}")
    return names if len(set(names)) == len(names) else [f"leg{k + 1}" for k in range(len(legs))]


def _phases(robot: ForeignRobot, gait: str, rows: np.ndarray, sides: np.ndarray) -> list[float]:
    """Offsets on the gait clock: neighbours of a row, and of a side, half a cycle apart."""
    wanted = gait or next((name for name, count in GAITS.items() if count == len(rows)), "")
    if gait and gait not in GAITS:
        raise RobotFileError(f"{robot.path}: --gait {gait} is not {', '.join(GAITS)}")
    if gait and GAITS[gait] != len(rows):
        raise RobotFileError(f"{robot.path}: --gait {gait} is for {GAITS[gait]} legs; this robot has {len(rows)}")
    if not wanted:
        return [0.0 if k % 2 == 0 else 0.5 for k in range(len(rows))]
    ranks = np.unique(-rows, return_inverse=True)[1]
    return [0.5 * float((int(rank) + int(side < 0.0)) % 2) for rank, side in zip(ranks, sides, strict=True)]


def _armatures(robot: ForeignRobot, drives: Mapping[str, Drive], choices: Choices) -> tuple[ForeignRobot, list[str]]:
    """The robot with a rotor inertia at every joint, and a note where the file has none.

    Damping is computed at the begin of a torque step, so a joint is stable while ``Kd * step < 2 * inertia``. Light
    feet alone fail that; a rotor of ``Kd * step`` does not, and is what motors with such gains have (G1: 0.004 to
    0.025 kg·m² beside Kd of 0.9 to 6).
    """
    joints, ruled = [], []
    for joint in robot.joints:
        own = _chosen(choices.armature, joint.name)
        if own is None and joint.armature == 0.0 and joint.name in drives:
            ruled.append(joint.name)
            own = TORQUE_STEP * drives[joint.name].kd
        joints.append(joint if own is None else replace(joint, armature=own))
    names = f"{', '.join(ruled[:3])}{' and others' if ruled[3:] else ''}"
    note = f"no rotor inertia for {names}: {TORQUE_STEP:g} s of Kd; --armature changes it"
    return replace(robot, joints=joints), [note] * bool(ruled)


def _drive(robot: ForeignRobot, joint: Joint, choices: Choices) -> Drive:
    limit = _chosen(choices.torque_limit, joint.name) or joint.torque_limit
    if limit is None:
        raise RobotFileError(
            f"{robot.path}: {joint.name} has no torque limit; give --torque-limit '{joint.name}=NM' or '*=NM'"
        )
    kp, kd, source = joint.kp, joint.kd if joint.kp is not None else None, "file"
    if kp is None:
        kp, source = KP_PER_LIMIT * limit, "rule"
    if (chosen := _chosen(choices.kp, joint.name)) is not None:
        kp, kd, source = chosen, None, "option"
    kd = KD_PER_KP * kp if kd is None else kd
    if (chosen := _chosen(choices.kd, joint.name)) is not None:
        kd = chosen
    return Drive(kp=kp, kd=kd, torque_limit=limit, gains_from=source)
