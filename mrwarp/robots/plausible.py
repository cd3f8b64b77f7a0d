"""Numbers that stand in files in place of those that nobody knew, found by what no machine can be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from mrwarp.paper import GRAVITY
from mrwarp.robots.drives import Drive
from mrwarp.robots.foreign import Body, ForeignRobot, Joint, RobotFileError
from mrwarp.robots.guesses import Guess, Subject, some
from mrwarp.robots.stance import Foot, standing_torques
from mrwarp.robots.surfaces import surface

TIMES = 100.0
"""A torque limit that is larger than the stance needs by more than this factor is a placeholder: motors of legged
robots give 3 to 20 times as much."""

LEVER = 0.1
"""Share of its height that a robot's weight has as lever at least, whose legs are straight in the stance."""

GYRATION = 2.0
"""Radius of gyration over the farthest point of a body. No body exceeds 1; shapes are simpler than what they stand
for."""

DENSITY = 1000.0
"""Mean density of robots' links [kg/m³], for bodies whose shapes say nothing of a side."""


def with_real_inertias(robot: ForeignRobot) -> tuple[ForeignRobot, list[Guess]]:
    """The robot with a solid box for the inertia of each body whose own is that of a much larger one, and a note."""
    outlines = [_outline(robot, k) for k in range(len(robot.bodies))]
    places = robot.poses({})
    whole = np.concatenate([place.apply(points) for place, points in zip(places, outlines, strict=True)])
    size = float(np.linalg.norm(np.ptp(whole, axis=0)))
    bodies, found = list(robot.bodies), []
    for k, (body, points) in enumerate(zip(robot.bodies, outlines, strict=True)):
        if not body.mass > 0.0 or (k == robot.root and not robot.floating):
            continue
        radius = float(np.sqrt(np.linalg.eigvalsh(body.inertia).max() / body.mass))
        far = float(np.linalg.norm(points - body.com, axis=1).max(initial=0.0))
        if all(shape.body != k for shape in robot.shapes):  # its meshes may have been left out
            far = max(far, 0.5 * size)
        if radius > GYRATION * far > 0.0:
            found.append((radius / far, k))
            bodies[k] = replace(body, inertia=_solid(body.mass, np.ptp(points, axis=0)))
    if not found:
        return robot, []
    worst = max(found)[1]
    old, new = (float(np.linalg.eigvalsh(own[worst].inertia).max()) for own in (robot.bodies, bodies))
    body = robot.bodies[worst]
    text = (
        f"inertias of {some([robot.bodies[k].name for _, k in found])} are no body's of that size ({body.name}: "
        f"{old:.3g} kg·m² at {body.mass:.3g} kg would be a body of {np.sqrt(old / body.mass):.2g} m): those of solid "
        f"boxes were taken ({body.name}: {new:.3g} kg·m²); write the right ones there"
    )
    changes = {robot.bodies[k].name: bodies[k].inertia - robot.bodies[k].inertia for _, k in found}
    return replace(robot, bodies=bodies, replaced=changes), [Guess(subject=Subject.INERTIA, text=text)]


def _outline(robot: ForeignRobot, body: int) -> np.ndarray:
    """Points of a body's shapes and joints in its frame [m], shape (N, 3)."""
    ends = [j.in_parent.translation for j in robot.joints if j.parent == body]
    ends += [j.in_child.translation for j in robot.joints if j.child == body]
    own = [surface(robot, body), *np.reshape(ends, (-1, 1, 3)), robot.bodies[body].com[None]]
    return np.concatenate(own)


def _solid(mass: float, sides: np.ndarray) -> np.ndarray:
    """Inertia of a solid box [kg·m²], shape (3, 3); no side is smaller than that of a cube of :data:`DENSITY`."""
    squares = np.maximum(sides, (mass / DENSITY) ** (1.0 / 3.0)) ** 2
    return np.diag(mass / 12.0 * (squares.sum() - squares))


def check_torque_limits(
    robot: ForeignRobot,
    drives: Mapping[str, Drive],
    feet: Sequence[Foot],
    pose: Mapping[str, float],
    height: float,
) -> list[Guess]:
    """Refuse placeholders for torque limits, see :data:`TIMES`; those that the user gave are noted.

    Args:
        robot: The robot.
        drives: Its motors.
        feet: Its feet; none of an arm.
        pose: The stance [rad].
        height: Of the trunk above the ground [m].

    Raises:
        RobotFileError: a torque limit is a placeholder.
    """
    needed = _needed(robot, drives, feet, pose, height)
    beyond = [name for name, drive in drives.items() if drive.torque_limit > TIMES * needed > 0.0]
    for source in ("file", "option"):
        if own := [name for name in beyond if drives[name].limit_from == source]:
            worst = max(own, key=lambda name: drives[name].torque_limit)
            limit = drives[worst].torque_limit
            text = (
                f"torque limit of {some(own)} = {limit:g} N·m is {limit / needed:.0f} times what any joint needs to "
                f"hold the robot, {needed:.2g} N·m"
            )
            if source == "option":
                return [Guess(subject=Subject.HOLDING, text=f"{text}; --torque-limit said so")]
            names = f"'{worst}=NM' or '*=NM'" if len(own) == len(drives) else " ".join(f"'{name}=NM'" for name in own)
            raise RobotFileError(
                f"{robot.path}: {text}: a placeholder, from which gains and rotors would follow; give the motors' with "
                f"--torque-limit {names}"
            )
    return []


def _needed(
    robot: ForeignRobot, drives: Mapping[str, Drive], feet: Sequence[Foot], pose: Mapping[str, float], height: float
) -> float:
    """Largest torque that a joint needs to hold the robot [N·m]: in its stance, of an arm in any pose."""
    if feet:
        weight = GRAVITY * sum(body.mass for body in robot.bodies)
        torques = standing_torques(robot, feet, pose)
        return max(*(torques[name] for name in drives), LEVER * height * weight / len(feet))
    poses = robot.poses(pose)
    return max((_weight_moment(robot, poses, joint) for joint in robot.joints if joint.name in drives), default=0.0)


def _weight_moment(robot: ForeignRobot, poses: Sequence[RigidTransform], joint: Joint) -> float:
    """Weight of what a joint carries, times its distance from it [N·m]."""
    anchor = (poses[joint.parent] * joint.in_parent).translation
    own = [(robot.bodies[k].mass, poses[k].apply(robot.bodies[k].com)) for k in robot.carried(joint)]
    return GRAVITY * sum(mass * float(np.linalg.norm(com - anchor)) for mass, com in own)


def check_rotors(
    robot: ForeignRobot,
    guessed: Sequence[str],
    drives: Mapping[str, Drive],
    feet: Mapping[str, Foot],
    pose: Mapping[str, float],
) -> None:
    """Refuse a guessed rotor of a leg that is heavier than what it moves: the leg in the air, or the robot on it.

    Args:
        robot: The robot with its rotors.
        guessed: Joints whose rotor is a guess.
        drives: Motors of all joints.
        feet: The foot of each leg's joints.
        pose: The stance [rad].

    Raises:
        RobotFileError: a rotor is heavier.
    """
    poses, masses = robot.poses(pose), np.array([body.mass for body in robot.bodies])
    share = float(masses.sum()) / max(len({foot.body for foot in feet.values()}), 1)
    centre = masses @ [place.apply(body.com) for place, body in zip(poses, robot.bodies, strict=True)] / masses.sum()
    for joint in robot.joints:
        if joint.name not in guessed or joint.name not in feet:
            continue
        frame = poses[joint.parent] * joint.in_parent
        axis, foot = frame.rotation.apply(joint.axis), feet[joint.name]
        ends = (poses[foot.body].apply(foot.centre), centre)
        lever = max(float(np.linalg.norm(end - frame.translation)) for end in ends)
        carried = sum(_about(robot.bodies[k], poses[k], frame.translation, axis) for k in robot.carried(joint))
        moved = max(carried, share * lever**2)
        if joint.armature > moved:
            raise RobotFileError(
                f"{robot.path}: {joint.name} would get a rotor of {joint.armature:.3g} kg·m² by its Kd of "
                f"{drives[joint.name].kd:.3g} N·m·s/rad. It moves only {moved:.2g} kg·m²; give "
                f"--armature '{joint.name}=X', or the motor's --torque-limit or --kd"
            )


def _about(body: Body, place: RigidTransform, point: np.ndarray, axis: np.ndarray) -> float:
    """Inertia of a body about an axis through a point [kg·m²]."""
    own = place.rotation.inv().apply(axis)
    arm = np.cross(axis, place.apply(body.com) - point)
    return float(own @ body.inertia @ own + body.mass * arm @ arm)
