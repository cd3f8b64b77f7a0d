"""Order of legs, their names and the gait; and whether their names contradict where they are."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from mrwarp.robots.foreign import Joint, RobotFileError
from mrwarp.robots.guesses import Guess, Subject

_WORDS = re.compile(r"[A-Z]*[a-z]+\d*|[A-Z]+\d*|\d+|[^\W\d_a-zA-Z]+|_+")
"""Words of a name: HipAA_joint2 has Hip, AA, _, joint2."""

GAITS = {"trot": 4, "alternate": 2, "tripod": 6}
"""Gaits, and for how many legs each is meant."""

FORWARD = {"x": 0.0, "y": 0.5 * np.pi, "-x": np.pi, "-y": -0.5 * np.pi}
"""Axes of the trunk that may point forwards, and how far they are turned from x about z [rad]."""

SAID = {
    "front": (1.0, 0.0), "fore": (1.0, 0.0), "rear": (-1.0, 0.0), "hind": (-1.0, 0.0), "back": (-1.0, 0.0),
    "left": (0.0, 1.0), "right": (0.0, -1.0),
    **{f"{row}{side}": (x, y) for row, x in (("f", 1.0), ("r", -1.0), ("h", -1.0), ("b", -1.0))
       for side, y in (("l", 1.0), ("r", -1.0))},
    **{f"{side}{row}": (x, y) for row, x in (("f", 1.0), ("h", -1.0), ("b", -1.0))
       for side, y in (("l", 1.0), ("r", -1.0))},
}  # fmt: skip
"""Words of a name that give a leg's place: how far in front, how far to the left."""


def leg_names(legs: Sequence[Sequence[Joint]]) -> list[str]:
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


def rows_of(feet: np.ndarray) -> np.ndarray:
    """Row of each foot, 0 the rearmost: rows are separated by at least half the widest gap between them.

    Args:
        feet: Places in the trunk's frame [m], shape (L, 3).
    """
    if len(feet) < 2:
        return np.zeros(len(feet))
    order = np.argsort(feet[:, 0])
    gaps = np.diff(feet[order, 0])
    least = max(0.5 * float(gaps.max()), 0.1 * float(np.ptp(feet[:, :2], axis=0).max()))
    rows = np.zeros(len(feet))
    rows[order[1:]] = np.cumsum(gaps > least)
    return rows


def phases(path: object, gait: str, rows: np.ndarray, sides: np.ndarray) -> list[float]:
    """Offsets on the gait clock: neighbours of a row, and of a side, half a cycle shifted.

    Args:
        path: The robot's file.
        gait: One of :data:`GAITS`; empty: by the number of legs.
        rows: Of each leg, shape (L,).
        sides: How far left each foot is [m], shape (L,).

    Raises:
        RobotFileError: the gait is for another number of legs.
    """
    wanted = gait or next((name for name, count in GAITS.items() if count == len(rows)), "")
    if gait and gait not in GAITS:
        raise RobotFileError(f"{path}: --gait {gait} is not {', '.join(GAITS)}")
    if gait and GAITS[gait] != len(rows):
        raise RobotFileError(f"{path}: --gait {gait} is for {GAITS[gait]} legs; this robot has {len(rows)}")
    if not wanted:
        return [0.0 if k % 2 == 0 else 0.5 for k in range(len(rows))]
    ranks = np.unique(-rows, return_inverse=True)[1]
    return [0.5 * float((int(rank) + int(side < 0.0)) % 2) for rank, side in zip(ranks, sides, strict=True)]


def looks_elsewhere(names: Sequence[Sequence[str]], feet: np.ndarray, forward: str) -> list[Guess]:
    """A note where the names of the legs say that the robot looks along another axis than x.

    Args:
        names: Names of each leg's joints and bodies.
        feet: Places of the feet in the trunk's frame, x forwards [m], shape (L, 3).
        forward: The axis of the file that was taken as x, one of :data:`FORWARD`.
    """
    said = np.array([_said(own) for own in names]).reshape(-1, 2)
    fronts, lefts = said.T @ (feet[:, :2] - feet[:, :2].mean(axis=0)) if len(feet) else np.zeros((2, 2))
    both = [set(column) >= {1.0, -1.0} for column in said.T]
    if not any(both):
        return []
    toward = fronts if both[0] else _turned(lefts, -0.5 * np.pi)  # a left side is a quarter turn from the front
    axis = max(FORWARD, key=lambda name: float(_turned(np.array([1.0, 0.0]), FORWARD[name]) @ toward))
    if axis == "x" or not np.linalg.norm(toward) > 1e-3:
        return []
    angle = FORWARD[axis] + FORWARD[forward]
    own = min(FORWARD, key=lambda name: abs(np.exp(1j * FORWARD[name]) - np.exp(1j * angle)))
    leg = int(np.argmax(np.abs(said[:, 0 if both[0] else 1])))
    text = (
        f"names such as {names[leg][0]} say that the robot looks along {own}, and {forward} was taken: "
        f"--forward {own} turns it"
    )
    return [Guess(subject=Subject.FORWARD, text=text)]


def _turned(vector: np.ndarray, angle: float) -> np.ndarray:
    return Rotation.from_rotvec([0.0, 0.0, angle]).apply([*vector, 0.0])[:2]


def _said(names: Sequence[str]) -> tuple[float, float]:
    """Where the words of a leg's names say that it is: 1 in front, -1 behind, 1 left, -1 right, 0 nothing."""
    words = {word.lower().rstrip("0123456789") for name in names for word in _WORDS.findall(name)}
    found = [SAID[word] for word in words if word in SAID]
    total = np.sign(np.sum(np.array(found).reshape(-1, 2), axis=0))
    return float(total[0]), float(total[1])
