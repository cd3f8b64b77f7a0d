"""Legs found from a robot's kinematic tree: which chains reach the ground, their feet, order, stance and gait."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from mrwarp.env.rng import MOST_JOINTS
from mrwarp.robots.base import check_base
from mrwarp.robots.chains import (
    GROUND_SHARE,
    LEVEL_SHARE,
    Path,
    hanging,
    left_out,
    named_paths,
    on_knees,
    own_joints,
    reaching,
)
from mrwarp.robots.drives import Choices, Drive, chosen, drives_of, rotor_notes, with_rotors
from mrwarp.robots.feet import find_foot, foot_notes, wheels, with_soles
from mrwarp.robots.foreign import FREE_LIMIT, ForeignRobot, Joint, RobotFileError
from mrwarp.robots.guesses import Guess, Subject, some, sorted_lines
from mrwarp.robots.leg_order import FORWARD, leg_names, looks_elsewhere, phases, rows_of
from mrwarp.robots.plausible import check_rotors, check_torque_limits, with_real_inertias
from mrwarp.robots.second.left_over import left_over
from mrwarp.robots.stance import Foot, solve_stance, standing_torques
from mrwarp.robots.surfaces import SOLE, extremes, lowest
from mrwarp.runtime import closest
from mrwarp.usd.robot import Layout, Leg

HEIGHTS = (0.01, 10.0)
"""Smallest and largest height of a trunk in the stance [m]; beyond, a file's lengths are no metres."""

LEVEL = 0.01
"""Largest difference of the soles' heights in the stance [m]."""

OFF_LIMITS = 0.02
"""How far a joint that bears nothing is from its limits, as a share of their range."""

LEAN = 0.35
"""Largest angle from upright at which the trunk of a keyframe stands [rad]."""


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
    """Guesses and omissions, for the user, first what would change the robot most."""
    given_rotors: tuple[str, ...]
    """Joints whose rotor inertia the user gave."""


def understand(robot: ForeignRobot, choices: Choices) -> UnderstoodRobot:
    """Find legs, feet, stance, gait and drives; a robot whose root stands still has no legs.

    Raises:
        RobotFileError: no chain reaches the ground, a torque limit is missing, a choice names no joint, its angle lies
            outside a joint's limits, nobody says whether the robot floats, or a number is a placeholder.
    """
    _check_names(robot, choices)
    robot, notes = _prepared(robot, choices)
    driven = [joint for joint in robot.joints if joint.name not in robot.rails]
    if len(driven) > MOST_JOINTS:
        raise RobotFileError(
            f"{robot.path}: {len(driven)} joints are driven; at most {MOST_JOINTS} are simulated: hold those of arms "
            "and hands with --fix JOINT ..."
        )
    notes += _limits(robot, driven, choices)
    given = {joint.name: q for joint in driven if (q := chosen(choices.pose, joint.name)) is not None}
    pose = {joint.name: _home(joint) for joint in driven} | given
    legs, touching = [], []
    if robot.floating:
        legs, touching, pose, more = _standing(robot, choices, given)
        notes += more
    _check_angles(robot, driven, pose)
    poses = robot.poses(pose)
    centres = np.array([poses[foot.body].apply(foot.centre) for foot in touching]).reshape(-1, 3)
    # front legs first, left before right
    rows = rows_of(centres)
    order = sorted(range(len(legs)), key=lambda k: (-rows[k], -centres[k, 1]))
    legs, centres, touching = [legs[k] for k in order], centres[order], [touching[k] for k in order]
    height = max((foot.radius - centre[2] for foot, centre in zip(touching, centres, strict=True)), default=0.0)
    if legs:
        _check_height(robot, legs, touching, poses, float(height))
    names = [[*(j.name for j in leg), *(robot.bodies[j.child].name for j in leg)] for leg in legs]
    notes += [*foot_notes(robot, touching), *looks_elsewhere(names, centres, choices.forward)]
    robot = with_soles(robot, touching)
    layout = _layout(robot, choices, legs, touching, centres, rows[order], pose)
    drives, ruled = drives_of(robot, [next(j for j in driven if j.name == name) for name in layout.joints], choices)
    notes += [*ruled, *check_torque_limits(robot, drives, touching, pose, float(height))]
    robot, guessed = with_rotors(robot, drives, choices)
    own = {joint.name: foot for leg, foot in zip(legs, touching, strict=True) for joint in leg}
    check_rotors(robot, guessed, drives, own, pose)
    notes += rotor_notes(guessed)
    damping = {j.name: j.kd for j in driven if j.kd and drives[j.name].gains_from != "file"}
    if unread := left_over(robot.path, damping=damping):
        notes.append(Guess(subject=Subject.OMITTED, text=f"not carried: {unread}"))
    if legs:
        notes.append(Guess(subject=Subject.HOLDING, text=_holding(robot, touching, pose, drives)))
    return UnderstoodRobot(
        robot=robot,
        layout=layout,
        feet=tuple(touching),
        drives=drives,
        height=float(height),
        notes=sorted_lines(notes),
        given_rotors=tuple(j.name for j in robot.joints if chosen(choices.armature, j.name) is not None),
    )


def _check_names(robot: ForeignRobot, choices: Choices) -> None:
    """Refuse choices of joints that are not there."""
    numbers = (choices.pose, choices.kp, choices.kd, choices.torque_limit, choices.armature)
    for choice in (*numbers, choices.unlimited, choices.fix):
        for pattern in choice:
            if not fnmatch.filter(known := [joint.name for joint in robot.joints], pattern):
                hint = f"{closest(pattern, known)}choose among {', '.join(known)}"
                raise RobotFileError(f"{robot.path}: no joint is called {pattern}; {hint}")


def _prepared(robot: ForeignRobot, choices: Choices) -> tuple[ForeignRobot, list[Guess]]:
    """The robot with real inertias, its held joints and wheels part of the bodies before them, x forwards; notes."""
    robot, notes = with_real_inertias(robot)
    held = {j.name: j for j in robot.joints if any(fnmatch.fnmatchcase(j.name, name) for name in choices.fix)}
    angles = {name: chosen(choices.pose, name) for name in held}
    robot = robot.fixed({name: _home(held[name]) if q is None else q for name, q in angles.items()})
    if robot.floating:
        home = {j.name: _home(j) if (q := chosen(choices.pose, j.name)) is None else q for j in robot.joints}
        if rolling := wheels(robot, [home, {}]):
            names = [joint.name for joint in rolling]
            robot = robot.fixed({name: home[name] for name in names})
            text = f"wheels are not simulated: {some(names)} {'are' if names[1:] else 'is'} held, as by --fix"
            notes.append(Guess(subject=Subject.WHEELS, text=text))
    robot.check()
    if choices.feet and not robot.floating:
        raise RobotFileError(
            f"{robot.path}: --feet {choices.feet[0]}: {robot.bodies[robot.root].name} stands still, so it has no feet; "
            "let it float with --base free, or leave --feet out"
        )
    notes += [*robot.notes, *check_base(robot)]
    if choices.forward != "x":
        angle = FORWARD[choices.forward]
        robot = replace(robot.turned(Rotation.from_rotvec([0.0, 0.0, angle])), forward=angle)
    return robot, notes


def _limits(robot: ForeignRobot, driven: Sequence[Joint], choices: Choices) -> list[Guess]:
    """Take limits that are none off the joints that the user names; a note on joints without limits.

    Raises:
        RobotFileError: limits have so wide a range that they must be in degrees.
    """
    free = []
    for joint in driven:
        said = any(fnmatch.fnmatchcase(joint.name, name) for name in choices.unlimited)
        if joint.limits is not None and joint.limits[1] - joint.limits[0] > FREE_LIMIT:
            if not said:
                low, high = joint.limits
                raise RobotFileError(
                    f"{robot.path}: {joint.name} has limits of {low:g} to {high:g}, a range of ten turns or more; "
                    f"write them in radians there, or say --unlimited {joint.name}"
                )
            joint.limits = None
        if joint.limits is None and not said:
            free.append(joint.name)
    text = f"no limits for {some(free)}: nothing stops them; write limits there, or say --unlimited"
    return [Guess(subject=Subject.LIMITS, text=text)] * bool(free)


def _check_angles(robot: ForeignRobot, driven: Sequence[Joint], pose: Mapping[str, float]) -> None:
    """Refuse a stance beyond the joints' limits."""
    for joint in driven:
        if joint.limits and not joint.limits[0] - 1e-6 <= pose[joint.name] <= joint.limits[1] + 1e-6:
            raise RobotFileError(
                f"{robot.path}: neutral angle of {joint.name} = {pose[joint.name]:.3f} rad lies outside its limits, "
                f"{joint.limits[0]:.3f} to {joint.limits[1]:.3f}; give --pose {joint.name}=RAD"
            )


def _layout(
    robot: ForeignRobot,
    choices: Choices,
    legs: Sequence[Sequence[Joint]],
    feet: Sequence[Foot],
    centres: np.ndarray,
    rows: np.ndarray,
    pose: Mapping[str, float],
) -> Layout:
    """Legs with names and phases, then the joints of no leg, with their neutral angles."""
    offsets = phases(robot.path, choices.gait, rows, centres[:, 1])
    used = {joint.name for leg in legs for joint in leg}
    joints = [joint for leg in legs for joint in leg]
    joints += [joint for joint in robot.joints if joint.name not in used and joint.name not in robot.rails]
    return Layout(
        trunk=robot.bodies[robot.root].name,
        legs=tuple(
            Leg(
                name=name,
                joints=tuple(joint.name for joint in leg),
                foot=f"{name}_foot",
                phase=phase,
                sole=foot.sole,
            )
            for name, leg, phase, foot in zip(leg_names(legs), legs, offsets, feet, strict=True)
        ),
        neutral={joint.name: pose[joint.name] for joint in joints},
    )


def _holding(robot: ForeignRobot, feet: Sequence[Foot], pose: Mapping[str, float], drives: Mapping[str, Drive]) -> str:
    """Torque to hold the stance: the joint whose motor comes nearest to its limit, and what gives most."""
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
    robot: ForeignRobot, choices: Choices, given: Mapping[str, float]
) -> tuple[list[list[Joint]], list[Foot], dict[str, float], list[Guess]]:
    """Legs, their feet, the stance, and what was guessed.

    Legs are sought in the pose that was given, in a keyframe only if the robot stands in it, else hanging with all
    joints at 0, else where they reach.

    Raises:
        RobotFileError: there are none.
    """
    names = {joint.name for joint in robot.joints}
    keys = [{**key.angles, **given} for key in robot.keyframes if names <= set(key.angles) and key.lean <= LEAN]
    whole = [{name: key[name] for name in names} for key in keys] or [dict(given)] * (set(given) == names)
    notes: list[Guess] = []
    for pose in whole:
        paths, found = _paths(robot, choices, pose, LEVEL_SHARE)
        if paths and _stands(robot, pose, paths):
            legs = own_joints(paths)
            taken = next(key.name for key in robot.keyframes if pose.items() <= {**key.angles, **given}.items())
            more = f" of {len(robot.keyframes)}" if robot.keyframes[1:] else ""
            text = f"keyframe {taken}{more} is the stance; --pose JOINT=RAD changes it"
            said = [Guess(subject=Subject.STANCE, text=text)] * bool(robot.keyframes)
            return legs, [find_foot(robot, leg, pose) for leg in legs], pose, [*found, *said, *_others(robot, paths)]
    stretched: dict[str, float] = {}
    paths, notes = _paths(robot, choices, dict(given), GROUND_SHARE) if given else ([], notes)
    if not paths or any(on_knees(robot, given, path) for path in paths):
        paths, notes = _paths(robot, choices, {}, GROUND_SHARE)
    if not choices.feet and (not paths or any(on_knees(robot, {}, path) for path in paths)):
        reached, stretched = reaching(robot)
        paths, notes = (reached, []) if reached else (paths, notes)
    if not paths:
        raise RobotFileError(
            f"{robot.path}: nothing hangs below {robot.bodies[robot.root].name}, so it has no legs; hold an arm with "
            "--base fixed, or name the last bodies of its legs with --feet"
        )
    legs, notes = own_joints(paths), [*notes, *_others(robot, paths)]
    if set(given) == names:
        return legs, [find_foot(robot, leg, given) for leg in legs], dict(given), notes
    feet = [find_foot(robot, leg, stretched) for leg in legs]
    first = {joint.name: _near_zero(joint) for joint in robot.joints} | dict(given)
    pose, stands = solve_stance(with_soles(robot, feet), legs, feet, first, stretched, given)
    why = "the keyframe is no stance, the robot does not stand in it" if robot.keyframes else "the file has no keyframe"
    found = "one was solved" if robot.keyframes else "the stance was solved"
    if faults := stands.faults:
        found = f"no stance was found, {', '.join(faults)}"
    text = f"{why}: {found} ({stands.text}); --pose JOINT=RAD changes it"
    notes.append(Guess(subject=Subject.STANCE, text=text))
    return legs, feet, pose, notes


def _paths(
    robot: ForeignRobot, choices: Choices, pose: Mapping[str, float], share: float
) -> tuple[list[Path], list[Guess]]:
    """Joints to the bodies that the user names, else to those that reach the ground in a pose."""
    if choices.feet:
        return named_paths(robot, choices.feet), []
    return hanging(robot, pose, share, twins=share == GROUND_SHARE)


def _stands(robot: ForeignRobot, pose: Mapping[str, float], paths: Sequence[Path]) -> bool:
    """Whether the robot stands on these legs: all of one build, level, on their ends, the trunk well above."""
    poses = robot.poses(pose)
    feet = [lowest(robot, path[-1].child, poses)[2] for path in paths]
    clear = min(feet) < 0.0 and lowest(robot, robot.root, poses)[2] > (1.0 - GROUND_SHARE) * min(feet)
    level = max(feet) - min(feet) <= LEVEL
    return bool(clear and level) and not left_out(robot, paths) and not any(on_knees(robot, pose, p) for p in paths)


def _others(robot: ForeignRobot, paths: Sequence[Path]) -> list[Guess]:
    """A note on chains that are built as the legs and are none."""
    if not (others := left_out(robot, paths)):
        return []
    text = (
        f"{some([robot.bodies[path[-1].child].name for path in others])} ends a chain that is built as the legs, and "
        "counts as no leg; --feet names all"
    )
    return [Guess(subject=Subject.LEGS, text=text)]


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
        low = [low[2] for _, low in extremes(robot, k, poses, solid=True)]
        if k not in standing and low and min(low) < min(soles.values()) - SOLE:
            remedy = f"--pose {parents[k]}=RAD or --fix {parents[k]}" if k in parents else "--pose JOINT=RAD"
            raise RobotFileError(
                f"{robot.path}: in the stance {body.name} reaches {1e3 * (min(soles.values()) - min(low)):.0f} mm into "
                f"the ground; give {remedy}"
            )


def _near_zero(joint: Joint) -> float:
    """The angle that is nearest to 0, off the ends of the limits [rad]: 0 is how a file draws its robot."""
    if joint.limits is None:
        return 0.0
    edge = OFF_LIMITS * (joint.limits[1] - joint.limits[0])
    return float(np.clip(0.0, joint.limits[0] + edge, joint.limits[1] - edge))


def _home(joint: Joint) -> float:
    """An angle to begin with [rad]: the keyframe's, else 0, or the middle of limits that leave it out."""
    if joint.home is not None:
        return joint.home
    if joint.limits is None or joint.limits[0] <= 0.0 <= joint.limits[1]:
        return 0.0
    return 0.5 * (joint.limits[0] + joint.limits[1])
