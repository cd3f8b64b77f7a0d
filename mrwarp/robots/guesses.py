"""Guesses where a robot's file is silent, how good each is, and in which order it matters."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum, unique


@unique
class Subject(Enum):
    """Subjects of guesses, from what changes the robot most to what changes it least, and how good the guess is.

    The value is how good it is, as the table of docs/robot.md has it; the order is that of the list that
    ``mrwarp robot import`` ends with: another machine, another weight, another contact, other torques, other motion.
    """

    BASE = "a convention of the format"
    WHEELS = "no wheel is simulated"
    LEGS = "right if all legs have one build"
    FORWARD = "a convention; only names can contradict it"
    INERTIA = "the order of magnitude of a link"
    FEET = "a few millimetres"
    LIMITS = "true of few joints; nothing stops the joint"
    STANCE = "one of many that stand"
    GAINS = "within a factor of 3"
    ROTOR = "the order of magnitude of a motor"
    HOLDING = "computed from what stands above"
    OMITTED = "known, and not simulated"
    SECOND = "computed, from the file read twice"


@dataclass(frozen=True, kw_only=True)
class Guess:
    """One guess about a robot."""

    subject: Subject
    text: str
    """The guess, its parts, and how to say it otherwise."""

    @property
    def line(self) -> str:
        """The text, and how good the guess is."""
        return f"{self.text} [{self.subject.name.lower()}: {self.subject.value}]"


def sorted_lines(guesses: Iterable[Guess]) -> tuple[str, ...]:
    """Lines of guesses, first what would change the robot most."""
    order = list(Subject)
    return tuple(guess.line for guess in sorted(guesses, key=lambda guess: order.index(guess.subject)))


def some(names: Sequence[str]) -> str:
    """The first three names."""
    return f"{', '.join(names[:3])}{' and others' if names[3:] else ''}"
