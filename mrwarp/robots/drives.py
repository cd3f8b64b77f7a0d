"""The motor of each joint: torque limit, gains and rotor inertia, by rule where the file has none."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from mrwarp.robots.foreign import ForeignRobot, Joint, RobotFileError
from mrwarp.robots.guesses import Guess, Subject, some

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
    kd_ruled: bool
    """Whether Kd is by rule, with Kp or without."""
    limit_from: str
    """Where the torque limit comes from: ``file`` or ``option``."""


@dataclass(frozen=True, kw_only=True)
class Choices:
    """The user's choices in place of a guess; names of joints may hold * and ?."""

    pose: Mapping[str, float] = field(default_factory=dict)
    """Neutral angle [rad]."""
    kp: Mapping[str, float] = field(default_factory=dict)
    kd: Mapping[str, float] = field(default_factory=dict)
    torque_limit: Mapping[str, float] = field(default_factory=dict)
    armature: Mapping[str, float] = field(default_factory=dict)
    """Rotor inertia at the joint [kg·m²]."""
    gait: str = ""
    """One of :data:`mrwarp.robots.leg_order.GAITS`; empty: by the number of legs."""
    unlimited: tuple[str, ...] = ()
    """Joints that may turn without limits."""
    feet: tuple[str, ...] = ()
    """Bodies that carry a foot; empty: the ends of chains that are lowest."""
    fix: tuple[str, ...] = ()
    """Joints that are held at their neutral angle, as those of arms."""
    forward: str = "x"
    """Where the trunk looks, one of :data:`mrwarp.robots.leg_order.FORWARD`."""


def chosen(choice: Mapping[str, float], name: str) -> float | None:
    """The last choice whose pattern fits."""
    found = [value for pattern, value in choice.items() if fnmatch.fnmatchcase(name, pattern)]
    return found[-1] if found else None


def drives_of(robot: ForeignRobot, joints: Sequence[Joint], choices: Choices) -> tuple[dict[str, Drive], list[Guess]]:
    """The motors of joints, and a note on gains by rule.

    Raises:
        RobotFileError: a joint has no torque limit.
    """
    limits = {j.name: chosen(choices.torque_limit, j.name) or j.torque_limit for j in joints}
    if bare := [name for name, limit in limits.items() if limit is None]:
        raise RobotFileError(f"{robot.path}: {_without_motor(bare, joints)}")
    drives = {joint.name: _drive(joint, choices) for joint in joints}
    ruled = [name for name, drive in drives.items() if drive.gains_from == "rule"]
    bare = [name for name, drive in drives.items() if drive.kd_ruled and name not in ruled]
    texts = {
        f"no gains for {some(ruled)}: Kp = {KP_PER_LIMIT:g}/rad of the torque limit, Kd = {KD_PER_KP:g} s of Kp; "
        "--kp and --kd change them": ruled,
        f"no damping for {some(bare)}: Kd = {KD_PER_KP:g} s of Kp; --kd changes it": bare,
    }
    return drives, [Guess(subject=Subject.GAINS, text=text) for text, names in texts.items() if names]


def _without_motor(bare: Sequence[str], joints: Sequence[Joint]) -> str:
    """Remedy for joints without a torque limit: where others have motors, these are passive."""
    give = f"give --torque-limit '{bare[0]}=NM' or '*=NM'"
    if not any(joint.torque_limit is not None or joint.kp is not None for joint in joints):
        return f"{bare[0]} has no torque limit; {give}"
    return (
        f"{some(bare)} {'have' if bare[1:] else 'has'} no torque limit where other joints have an actuator; if nothing "
        f"drives them, hold them with --fix {' '.join(bare)}; if motors do, {give}"
    )


def _drive(joint: Joint, choices: Choices) -> Drive:
    given = chosen(choices.torque_limit, joint.name)
    limit = given or joint.torque_limit
    assert limit is not None
    kp, kd, source = joint.kp, joint.kd if joint.kp is not None else None, "file"
    if kp is None:
        kp, source = KP_PER_LIMIT * limit, "rule"
    if (own := chosen(choices.kp, joint.name)) is not None:
        kp, kd, source = own, None, "option"
    if (own := chosen(choices.kd, joint.name)) is not None:
        kd, source = own, "option" if source == "file" else source
    return Drive(
        kp=kp,
        kd=KD_PER_KP * kp if kd is None else kd,
        torque_limit=limit,
        gains_from=source,
        kd_ruled=kd is None,
        limit_from="option" if given else "file",
    )


def with_rotors(robot: ForeignRobot, drives: Mapping[str, Drive], choices: Choices) -> tuple[ForeignRobot, list[str]]:
    """The robot with a rotor inertia at every joint, and the joints whose rotor is a guess.

    Damping is computed at the begin of a torque step, so a joint is stable while ``Kd * step < 2 * inertia``. Light
    feet alone fail that; a rotor of ``Kd * step`` does not, and is what motors with such gains have (G1: 0.004 to
    0.025 kg·m² with Kd of 0.9 to 6).
    """
    joints, ruled = [], []
    for joint in robot.joints:
        own = chosen(choices.armature, joint.name)
        if own is None and joint.armature == 0.0 and joint.name in drives:
            ruled.append(joint.name)
            own = TORQUE_STEP * drives[joint.name].kd
        joints.append(joint if own is None else replace(joint, armature=own))
    return replace(robot, joints=joints), ruled


def rotor_notes(ruled: Sequence[str]) -> list[Guess]:
    """A note on rotors by rule."""
    text = f"no rotor inertia for {some(ruled)}: {TORQUE_STEP:g} s of Kd; --armature changes it"
    return [Guess(subject=Subject.ROTOR, text=text)] * bool(ruled)
