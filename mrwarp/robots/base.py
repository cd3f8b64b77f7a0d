"""Whether a robot's root floats or is held: what the file says, what is taken where it is silent, and when to ask."""

from __future__ import annotations

from mrwarp.robots.chains import chains, limbs, own_joints
from mrwarp.robots.foreign import ForeignRobot, RobotFileError
from mrwarp.robots.guesses import Guess, Subject, some

LIMBS, LEGS = 2, 4
"""From how many limbs of one build on a root that stands still is asked about: where the file is silent (two are a
biped or two arms), and where it says so (four are a quadruped on a stand, or a hand)."""


def check_base(robot: ForeignRobot) -> list[Guess]:
    """A note on what was taken.

    Raises:
        RobotFileError: nobody says whether the root floats, and its limbs contradict what the format implies.
    """
    root, found = robot.bodies[robot.root], limbs(robot)
    if robot.floating:
        return [] if robot.base_said else _floating(robot)
    if robot.rails:
        return []
    moving = sum(body.mass for k, body in enumerate(robot.bodies) if k != robot.root)
    weight = f"{root.name} ({root.mass:.2f} kg)" if root.mass > 0.0 else root.name
    if robot.base_said != "user" and len(found) >= (LEGS if robot.base_said else LIMBS):
        ends = some([robot.bodies[path[-1].child].name for path in found])
        why = "the file holds" if robot.base_said else "the file has no free joint, which would hold"
        raise RobotFileError(
            f"{robot.path}: {why} {weight} still, and {len(found)} limbs of one build hang from it, to {ends}: say "
            "--base free if it walks, --base fixed if it is held"
        )
    why = {"user": "--base fixed", "file": "the file holds it", "": "no free joint"}[robot.base_said]
    text = f"{weight} stands still, {moving:.2f} kg move ({why}); --base free lets it float"
    return [Guess(subject=Subject.BASE, text=text)]


def _floating(robot: ForeignRobot) -> list[Guess]:
    """A note on a file that is silent, whose robot floats.

    Raises:
        RobotFileError: it is likely an arm, for a single limb hangs from its root.
    """
    root, all_of = robot.bodies[robot.root].name, chains(robot)
    single = len({chain[0].name for chain in all_of}) == 1
    if single and (len(all_of) == 1 or min(len(own) for own in own_joints(all_of)) < 2):
        raise RobotFileError(
            f"{robot.path}: the file does not say whether {root} floats, and one limb hangs from it: an arm, which has "
            "no legs, needs --base fixed; a robot on one leg needs --base free, and --feet BODY if it lies flat"
        )
    text = f"the file does not say whether {root} floats: it does; --base fixed holds it"
    return [Guess(subject=Subject.BASE, text=text)]
