"""Legs found from a robot's kinematic tree: which chains reach the ground, their feet, order, stance and gait."""

from __future__ import annotations

import fnmatch
import itertools
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from mrwarp.robots.foreign import ForeignRobot, Joint, RobotFileError, Shape
from mrwarp.robots.stance import Foot, solve_stance, standing_torques
from mrwarp.runtime import closest
from mrwarp.usd.robot import STAND_HEIGHT, Layout, Leg

GROUND_SHARE, LEVEL_SHARE = 0.15, 0.05
"""Ends of chains that lie this share of the height above the lowest one still reach the ground: hanging with all joints
at 0, and in a keyframe, where feet are level."""

EQUAL = 0.02
"""Chains whose lengths differ by no more than this share are alike; legs are, a tail or one arm is not."""

HEIGHTS = (0.01, 10.0)
"""Smallest and largest height of a trunk in the stance [m]; beyond, a file's lengths are no metres."""

SOLE = 0.005
"""Shapes that reach this close to a foot's lowest point are its sole, and so are bodies to a leg's lowest [m]."""

FOOT_RADIUS, LEVEL = 0.02, 0.01
"""Largest radius of a foot that is put onto a leg, and largest difference of the soles' heights in the stance [m]."""

_WORDS = re.compile(r"[A-Z]*[a-z]+\d*|[A-Z]+\d*|\d+|[^\W\d_a-zA-Z]+|_+")
"""Words of a name: HipAA_joint2 has Hip, AA, _, joint2."""

GAITS = {"trot": 4, "alternate": 2, "tripod": 6}
"""Gaits, and for how many legs each is meant."""

FORWARD = {"x": 0.0, "y": 0.5 * np.pi, "-x": np.pi, "-y": -0.5 * np.pi}
"""Axes of the trunk that may point forwards, and how far they are turned from x about z [rad]."""

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
    forward: str = "x"
    """Where the trunk looks, one of :data:`FORWARD`."""


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
            if not fnmatch.filter(known := [joint.name for joint in robot.joints], pattern):
                hint = f"{closest(pattern, known)}choose among {', '.join(known)}"
                raise RobotFileError(f"{robot.path}: no joint is called {pattern}; {hint}")
    held = {j.name: j for j in robot.joints if any(fnmatch.fnmatchcase(j.name, name) for name in choices.fix)}
    angles = {name: _chosen(choices.pose, name) for name in held}
    robot = robot.fixed({name: _home(held[name]) if q is None else q for name, q in angles.items()})
    robot.check()
    if choices.forward != "x":
        robot = robot.turned(Rotation.from_rotvec([0.0, 0.0, FORWARD[choices.forward]]))
    driven = [joint for joint in robot.joints if joint.name not in robot.rails]
    for joint in driven:
        if joint.limits is None and not any(fnmatch.fnmatchcase(joint.name, name) for name in choices.unlimited):
            raise RobotFileError(
                f"{robot.path}: {joint.name} has no limits less than ten turns apart; give it some there, in radians, "
                f"or say --unlimited {joint.name}"
            )
    notes = list(robot.notes)
    chosen = {joint.name: q for joint in driven if (q := _chosen(choices.pose, joint.name)) is not None}
    pose = {joint.name: _home(joint) for joint in driven} | chosen
    legs, touching = [], []
    if choices.feet and not robot.floating:
        raise RobotFileError(
            f"{robot.path}: --feet {choices.feet[0]}: {robot.bodies[robot.root].name} stands still, so it has no feet; "
            "let it float there, or leave --feet out"
        )
    if robot.floating:
        legs, touching, pose = _standing(robot, choices, pose, chosen, notes)
    for joint in driven:
        if joint.limits and not joint.limits[0] - 1e-6 <= pose[joint.name] <= joint.limits[1] + 1e-6:
            raise RobotFileError(
                f"{robot.path}: neutral angle of {joint.name} = {pose[joint.name]:.3f} rad lies outside its limits, "
                f"{joint.limits[0]:.3f} to {joint.limits[1]:.3f}; give --pose {joint.name}=RAD"
            )
    poses = robot.poses(pose)
    centres = np.array([poses[foot.body].apply(foot.centre) for foot in touching]).reshape(-1, 3)
    # front legs first, left before right
    rows = _rows(centres)
    order = sorted(range(len(legs)), key=lambda k: (-rows[k], -centres[k, 1]))
    legs, centres, touching = [legs[k] for k in order], centres[order], [touching[k] for k in order]
    height = max((foot.radius - centre[2] for foot, centre in zip(touching, centres, strict=True)), default=0.0)
    if legs:
        _check_height(robot, legs, touching, poses, float(height))
    if put := [robot.bodies[foot.body].name for foot in touching if foot.shape is None]:
        sizes = ", ".join(sorted({f"{1e3 * foot.radius:.0f}" for foot in touching if foot.shape is None}))
        notes.append(f"no sphere below {_some(put)}: one of {sizes} mm was put there")
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
                sole=foot.sole,
            )
            for name, leg, phase, foot in zip(names, legs, phases, touching, strict=True)
        ),
        neutral={joint.name: pose[joint.name] for joint in joints},
    )
    drives = {joint.name: _drive(robot, joint, choices) for joint in joints}
    if ruled := [name for name, drive in drives.items() if drive.gains_from == "rule"]:
        notes.append(
            f"no gains for {_some(ruled)}: Kp = {KP_PER_LIMIT:g}/rad of the torque limit, Kd = {KD_PER_KP:g} s of Kp; "
            "--kp and --kd change them"
        )
    robot, rotors = _armatures(robot, drives, choices)
    notes += rotors
    if legs:
        notes.append(_holding(robot, touching, pose, drives))
    return UnderstoodRobot(
        robot=robot, layout=layout, feet=tuple(touching), drives=drives, height=float(height), notes=tuple(notes)
    )


def _some(names: Sequence[str]) -> str:
    """The first three names."""
    return f"{', '.join(names[:3])}{' and others' if names[3:] else ''}"


def _holding(robot: ForeignRobot, feet: Sequence[Foot], pose: Mapping[str, float], drives: Mapping[str, Drive]) -> str:
    """What it takes to hold the stance: the joint whose motor comes nearest to its limit, and what gives most."""
    torques = {name: torque for name, torque in standing_torques(robot, feet, pose).items() if name in drives}
    most = max(torques, key=lambda name: torques[name] / drives[name].torque_limit)
    soft = max(torques, key=lambda name: torques[name] / drives[name].kp)
    needed = f"{most} needs {torques[most]:.3g} of its {drives[most].torque_limit:.4g} N·m"
    if torques[most] > drives[most].torque_limit:
        return f"its motors cannot hold the stance: {needed}; --torque-limit, --pose or a device that holds"
    gives = torques[soft] / drives[soft].kp
    more = "; --kp makes it stiffer" if gives > 0.25 else ""
    return f"to hold the stance {needed}; {soft} gives way by {gives:.2f} rad{more}"


def _standing(
    robot: ForeignRobot, choices: Choices, pose: dict[str, float], chosen: Mapping[str, float], notes: list[str]
) -> tuple[list[list[Joint]], list[Foot], dict[str, float]]:
    """Legs, their feet and the stance; what was guessed is added to ``notes``."""
    home = {joint.name: joint.home for joint in robot.joints if joint.home is not None}
    keyed = len(home) == len(robot.joints)
    stretched: dict[str, float] = {}
    paths = _hanging(robot, home, LEVEL_SHARE, notes) if keyed and not choices.feet else []
    if paths and not _clear(robot, home, paths):
        paths = []
    if not paths:
        paths = _named_paths(robot, choices.feet) if choices.feet else _hanging(robot, {}, GROUND_SHARE, notes)
    if not paths:
        paths, stretched = _reaching(robot)
    if not paths:
        raise RobotFileError(
            f"{robot.path}: nothing hangs below {robot.bodies[robot.root].name}, so it has no legs; name the last "
            "bodies of its legs with --feet"
        )
    legs = _legs(paths)
    if len(chosen) == len(robot.joints) or (keyed and _clear(robot, pose, paths)):
        return legs, [_foot(robot, leg, pose) for leg in legs], pose
    feet = [_foot(robot, leg, stretched) for leg in legs]
    notes.append(
        "the keyframe is no stance, the trunk lies on the ground in it: one was solved; --pose JOINT=RAD changes it"
        if keyed
        else "the file has no keyframe: the stance was solved; --pose JOINT=RAD changes it"
    )
    first = {joint.name: _home(replace(joint, home=None)) for joint in robot.joints} | dict(chosen)
    return legs, feet, solve_stance(robot, legs, feet, first if keyed else pose, stretched, chosen)


def _clear(robot: ForeignRobot, pose: Mapping[str, float], paths: Sequence[Sequence[Joint]]) -> bool:
    """Whether the trunk is well above the feet."""
    poses = robot.poses(pose)
    feet = min(_lowest(robot, path[-1].child, poses)[2] for path in paths)
    return bool(feet < 0.0 and _lowest(robot, robot.root, poses)[2] > (1.0 - GROUND_SHARE) * feet)


def _check_height(
    robot: ForeignRobot, legs: Sequence[Sequence[Joint]], feet: Sequence[Foot], poses: list, height: float
) -> None:
    """Refuse a robot of another size, and one of which more than the feet is in the ground.

    Raises:
        RobotFileError: it is, or its feet are not level.
    """
    if not HEIGHTS[0] <= height <= HEIGHTS[1]:
        raise RobotFileError(f"{robot.path}: its trunk is {height:.4g} m high; write its lengths in metres")
    soles = {robot.bodies[f.body].name: poses[f.body].apply(f.centre)[2] - f.radius for f in feet}
    if max(soles.values()) - min(soles.values()) > LEVEL:
        heights = ", ".join(f"{name} {z:.3f}" for name, z in soles.items())
        raise RobotFileError(
            f"{robot.path}: in the stance the feet are not level: {heights} m; allowed: {LEVEL} m; name the bodies "
            "that stand with --feet BODY ..., or the stance with --pose JOINT=RAD"
        )
    standing = {joint.child for leg in legs for joint in leg}
    parents = {joint.child: joint.name for joint in robot.joints}
    for k, body in enumerate(robot.bodies):
        low = [low[2] for _, low in _extremes(robot, k, poses, solid=True)]
        if k not in standing and low and min(low) < min(soles.values()) - SOLE:
            remedy = f"--pose {parents[k]}=RAD or --fix {parents[k]}" if k in parents else "--pose JOINT=RAD"
            raise RobotFileError(
                f"{robot.path}: in the stance {body.name} reaches {1e3 * (min(soles.values()) - min(low)):.0f} mm into "
                f"the ground; give {remedy}"
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


def _named_paths(robot: ForeignRobot, feet: Sequence[str]) -> list[list[Joint]]:
    """Joints from the root to bodies by name."""
    chains = _chains(robot)
    known = {robot.bodies[j.child].name: chain[: k + 1] for chain in chains for k, j in enumerate(chain)}
    if unknown := [name for name in feet if name not in known]:
        raise RobotFileError(
            f"{robot.path}: --feet {unknown[0]} is no body at a joint; choose among {', '.join(known)}"
        )
    return [known[name] for name in feet]


def _hanging(robot: ForeignRobot, pose: Mapping[str, float], share: float, notes: list[str]) -> list[list[Joint]]:
    """Joints to the bodies that reach the ground in a pose, of chains that are alike if there are such."""
    poses = robot.poses(pose)
    chains = _chains(robot)
    lows = [[_lowest(robot, joint.child, poses)[2] for joint in chain] for chain in chains]
    floor = min((min(low) for low in lows), default=0.0)
    if not floor < min(-0.02 * max(map(_length, chains), default=0.0), _lowest(robot, robot.root, poses)[2]):
        return []  # the trunk would lie on the ground
    # a leg ends at its first body that is on the ground: toes are part of the foot
    ends = [next((k for k, z in enumerate(low) if z < min(low) + SOLE), 0) for low in lows]
    near = [
        chain[: k + 1] for chain, low, k in zip(chains, lows, ends, strict=True) if min(low) < (1.0 - share) * floor
    ]
    paths = list({path[-1].child: path for path in near}.values())
    twins = [path for path in paths if sum(_alike(path, other) for other in paths) > 1]
    if twins and (alone := [robot.bodies[path[-1].child].name for path in paths if path not in twins]):
        notes.append(f"{_some(alone)} hangs as low as the feet, but no other is like it: it counts as no leg")
    return twins or paths


def _length(path: Sequence[Joint]) -> float:
    """Distance along a path's joints [m]; offsets of the first are the trunk's."""
    return sum(float(np.linalg.norm((j.in_child.inv() * k.in_parent).translation)) for j, k in itertools.pairwise(path))


def _alike(a: Sequence[Joint], b: Sequence[Joint]) -> bool:
    """Whether two paths have equally many joints, equally far apart."""
    return len(a) == len(b) and abs(_length(a) - _length(b)) <= EQUAL * max(_length(a), _length(b))


def _reaching(robot: ForeignRobot) -> tuple[list[list[Joint]], dict[str, float]]:
    """Where nothing hangs: the most numerous chains that are alike and reach down, and the angles that stretch them."""
    chains = _chains(robot)
    kinds = [[other for other in chains if _alike(chain, other)] for chain in chains]
    legs = max(kinds, key=len, default=[])
    pose: dict[str, float] = {}
    for leg in legs if len(legs) > 1 else []:
        low = [joint.limits[0] if joint.limits else -np.pi for joint in leg]
        high = [joint.limits[1] if joint.limits else np.pi for joint in leg]

        def depth(q: np.ndarray, leg: list[Joint] = leg) -> float:
            poses = robot.poses({joint.name: float(x) for joint, x in zip(leg, q, strict=True)}, leg)
            return float(_lowest(robot, leg[-1].child, poses)[2] + 1e-3 * _length(leg) * (q @ q))

        starts = (np.clip(np.full(len(leg), start), low, high) for start in (0.3, -0.3))
        bounds = list(zip(low, high, strict=True))
        tried = [minimize(depth, start, method="Powell", bounds=bounds) for start in starts]
        found = min(tried, key=lambda result: result.fun)
        if found.fun > -0.5 * _length(leg):
            return [], {}
        pose.update({joint.name: float(x) for joint, x in zip(leg, found.x, strict=True)})
    return (legs, pose) if len(legs) > 1 else ([], {})


def _legs(paths: Sequence[Sequence[Joint]]) -> list[list[Joint]]:
    """What of each path is its own: a spine or a waist that bears several legs belongs to none."""
    often = Counter(joint.name for path in paths for joint in path)
    return [[joint for joint in path if often[joint.name] == 1 or len(paths) == 1] for path in paths]


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


def _extremes(
    robot: ForeignRobot, body: int, poses: list, *, solid: bool = False
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Centre and lowest point of each of a body's shapes in the root's frame [m]; ``solid``: of what will collide."""
    shapes = [shape for shape in robot.shapes if shape.body == body and not (solid and shape.kind == "mesh")]
    for shape in [shape for shape in shapes if shape.collides] or ([] if solid else shapes):
        world = poses[body] * shape.pose
        low = world.apply(_extreme(shape, world.rotation.inv().apply([0.0, 0.0, -1.0])))
        yield world.translation, low


def _foot(robot: ForeignRobot, leg: Sequence[Joint], pose: Mapping[str, float]) -> Foot:
    """The sphere that touches the ground in a pose, standing or stretched: the lowest of them, else one put there."""
    body, poses = leg[-1].child, robot.poses(pose)
    lowest = _lowest(robot, body, poses)
    own = [shape for shape in robot.shapes if shape.body == body and shape.collides]
    balls = [
        shape
        for shape in own
        if shape.kind == "sphere" and (poses[body] * shape.pose).translation[2] - shape.size[0] < lowest[2] + 0.01
    ]
    best = max(balls, key=lambda shape: shape.size[0], default=None)
    if best is not None and any(
        np.linalg.norm(ball.pose.translation - best.pose.translation) > best.size[0] + ball.size[0] for ball in balls
    ):
        best = None  # the corners of a sole
    if not any(shape.body == body for shape in robot.shapes):
        raise RobotFileError(
            f"{robot.path}: {robot.bodies[body].name} ends a leg and has no shape that says where its foot is; give it "
            "a collision sphere there, or leave --skip-meshes out"
        )
    if best is not None:
        return Foot(
            body=body, centre=best.pose.translation, radius=float(best.size[0]), friction=best.friction, shape=best
        )
    radius = min(FOOT_RADIUS, FOOT_RADIUS / STAND_HEIGHT * abs(float(lowest[2])))
    sole = [centre for centre, low in _extremes(robot, body, poses) if low[2] < lowest[2] + SOLE]
    middle = np.array([*np.mean(sole or [lowest], axis=0)[:2], lowest[2] + radius])
    return Foot(
        body=body,
        centre=poses[body].inv().apply(middle),
        radius=radius,
        friction=max((shape.friction for shape in own), default=0.8),
        shape=None,
        sole=any(shape.kind != "mesh" for shape in own),
    )


def _names(legs: list[list[Joint]]) -> list[str]:
    """Names of the legs: the words that begin, or end, the names of a leg's joints and no other's, else numbers."""
    numbers = [f"leg{k + 1}" for k in range(len(legs))]
    for begin in (True, False):
        names = []
        for leg in legs:
            words = [_WORDS.findall(joint.name) for joint in leg]
            if not begin:
                words = [row[::-1] for row in words]
            common = itertools.takewhile(lambda row: len(set(row)) == 1, zip(*words, strict=False))
            same = [row[0] for row in common] if len(leg) > 1 else words[0][:-1]
            names.append("".join(same if begin else same[::-1]).strip("_"))
        if all(names) and len(set(names)) == len(names):
            return [name if name.isidentifier() else f"leg{name}" for name in names]
    return numbers


def _rows(feet: np.ndarray) -> np.ndarray:
    """Row of each foot, 0 the rearmost: rows are as far apart as half the widest gap between them, or further.

    Args:
        feet: Places in the trunk's frame [m], shape (L, 3).
    """
    if len(feet) < 2:
        return np.zeros(len(feet))
    order = np.argsort(feet[:, 0])
    gaps = np.diff(feet[order, 0])
    apart = max(0.5 * float(gaps.max()), 0.1 * float(np.ptp(feet[:, :2], axis=0).max()))
    rows = np.zeros(len(feet))
    rows[order[1:]] = np.cumsum(gaps > apart)
    return rows


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
