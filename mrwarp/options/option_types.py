"""Types of options: numbers that refuse with value and range, lists of at least one value, flags, exclusive groups."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from tyro.conf import FlagConversionOff, FlagCreatePairsOff, Positional, create_mutex_group
from tyro.constructors import PrimitiveConstructorSpec

from mrwarp.enums import Coupling, ZStep
from mrwarp.options.command_line import Options
from mrwarp.params import with_unit

CURRENTS = (0.0, 0.5, 1.0, 1.5)
"""Fixed currents I_e over groups of robots [A], eq. 20."""

Flag = FlagCreatePairsOff[bool]
"""An option without a value: ``--live`` alone, without ``--no-live``."""

Number = TypeVar("Number", int, float)


def one(read: Callable[[str], Any], metavar: str, choices: Sequence[str] | None = None) -> PrimitiveConstructorSpec:
    """Type of an option with one value; ``read`` raises ValueError with value and what is allowed."""
    return _spec(lambda words: read(words[0]), 1, metavar, choices)


def some(
    read: Callable[[str], Any], metavar: str, choices: Sequence[str] | None = None, *, least: int = 1
) -> PrimitiveConstructorSpec:
    """Type of an option with ``least`` values or more, a tuple."""

    def instance(words: list[str]) -> tuple[Any, ...]:
        if len(words) < least:
            raise ValueError("expected at least one value")
        return tuple(read(word) for word in words)

    return _spec(instance, "*", f"{metavar} [{metavar} ...]", choices)


def three(read: Callable[[str], Any], metavar: str) -> PrimitiveConstructorSpec:
    """Type of an option with three values, such as a force."""
    return _spec(lambda words: tuple(read(word) for word in words), 3, " ".join([metavar] * 3))


def maybe_one(metavar: str) -> PrimitiveConstructorSpec:
    """Type of an option whose value may be left out; then it is empty."""

    def instance(words: list[str]) -> str:
        if len(words) > 1:
            raise ValueError(f"expected one value, not {' '.join(words)}")
        return words[0] if words else ""

    return _spec(instance, "*", f"[{metavar}]")


def one_of(choices: Sequence[str]) -> PrimitiveConstructorSpec:
    """Type of a choice."""
    return one(str, f"{{{','.join(choices)}}}", choices)


def some_of(choices: Sequence[str]) -> PrimitiveConstructorSpec:
    """Type of several choices."""
    return some(str, f"{{{','.join(choices)}}}", choices)


def some_as_one(read: Callable[[list[str]], Any], metavar: str) -> PrimitiveConstructorSpec:
    """Type of an option with one value or more that are read together, as ``some`` words of another type."""

    def instance(words: list[str]) -> Any:
        if not words:
            raise ValueError("expected at least one value")
        return read(words)

    return _spec(instance, "*", f"{metavar} [{metavar} ...]", None, lambda _: [])


def named(make: Callable[[str], Any], choices: Sequence[str]) -> PrimitiveConstructorSpec:
    """Type of a configuration that is chosen by its name; one that is none of them shows as ``own``."""

    def shown(value: Any) -> list[str]:
        return [next((name for name in choices if make(name) == value), "own")]

    return _spec(lambda words: make(words[0]), 1, f"{{{','.join(choices)}}}", choices, shown)


def _spec(
    read: Callable[[list[str]], Any],
    nargs: Any,
    metavar: str,
    choices: Sequence[str] | None = None,
    shows: Callable[[Any], list[str]] | None = None,
) -> PrimitiveConstructorSpec:
    def shown(value: Any) -> list[str]:
        return [_text(item) for item in (value if isinstance(value, tuple) else (value,))]

    return PrimitiveConstructorSpec(
        nargs=nargs,
        metavar=metavar,
        instance_from_str=read,
        is_instance=lambda _: True,
        str_from_instance=shows or shown,
        choices=tuple(choices) if choices else None,
    )


def _text(value: Any) -> str:
    """A default as it can be typed; of a shipped file its name."""
    if isinstance(value, Path) and value.is_absolute():
        return value.name
    return f"{value:g}" if isinstance(value, float) else str(value)


def checked(kind: type[Number], allowed: Callable[[Number], bool], wanted: str) -> Callable[[str], Number]:
    """Reader of a number; its refusal gives the text and then what is ``wanted``."""

    def read(text: str) -> Number:
        try:
            value = kind(text)
        except ValueError:
            raise ValueError(f"{text!r} is not a {'whole ' * (kind is int)}number") from None
        if not allowed(value):
            raise ValueError(f"{text}{wanted}")
        return value

    return read


def within(low: float, high: float, unit: str) -> Callable[[str], float]:
    """A number in a closed range."""
    return checked(float, lambda x: low <= x <= high, f"; allowed: {low:g} to {high:g}{with_unit(unit)}")


def assignment(text: str, read: Callable[[str], float] | None = None) -> tuple[str, float]:
    """A name and its number, by default any finite one."""
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise ValueError(f"{text!r} is not NAME=VALUE")
    try:
        return name, (read or number)(value)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


number = checked(float, math.isfinite, " must be a finite number")
positive = checked(float, lambda x: 0.0 < x < math.inf, " must be a positive number")
not_negative = checked(float, lambda x: 0.0 <= x < math.inf, " must be at least 0")
whole = checked(int, lambda n: n >= 0, " must be at least 0")
count = checked(int, lambda n: n >= 1, " must be at least 1")
seed = checked(int, lambda n: 0 <= n < 2**63, "; allowed: a whole number from 0 to 2^63 - 1")

coil_current = within(0.0, 100.0, "A")
"""Coil current; what a robot's devices take is known when it is loaded, see ``mrwarp.usd.asset.check_currents``."""

forward_speed = within(-5.0, 5.0, "m/s")
"""Commanded forward speed; quadrupeds of this size run at 3 to 5 m/s."""


def robot_name(text: str) -> str:
    """A shipped robot, or a robot's USD file."""
    if text not in ("mr_go", "go1") and Path(text).suffix not in (".usda", ".usdc", ".usd"):
        raise ValueError(f"{text!r} is neither mr_go, go1 nor a .usda file")
    return text


FILE = one(Path, "FILE")
ROBOT = one(robot_name, "ROBOT")

Robot = Annotated[str, ROBOT]
OnOff = Annotated[bool, named(lambda word: word == "on", ("on", "off")), FlagConversionOff]
"""A choice between on and off, with its word."""

File = Annotated[Path, FILE]
Folder = Annotated[Path, one(Path, "DIR")]
Data = Positional[Annotated[Path, one(Path, "DATA")]]
Text = Annotated[str, one(str, "TEXT")]
Count = Annotated[int, one(count, "N")]
Whole = Annotated[int, one(whole, "N")]
load = within(0.0, 20.0, "kg")
"""Mass on the back; the robot has 12 kg."""

Seed = Annotated[int, one(seed, "N")]
Load = Annotated[float, one(load, "KG")]
Seeds = Annotated[tuple[int, ...], some(seed, "S")]
Positive = Annotated[float, one(positive, "X")]
NotNegative = Annotated[float, one(not_negative, "X")]
Speed = Annotated[float, one(forward_speed, "V")]
Currents = Annotated[tuple[float, ...], some(coil_current, "A")]
OptionalLag = Annotated[float | None, one(within(0.0, 10.0, "s"), "S")]
OptionalFile = Annotated[Path | None, FILE]
OptionalFolder = Annotated[Path | None, one(Path, "DIR")]
OptionalText = Annotated[str | None, one(str, "TEXT")]


@dataclass(frozen=True, kw_only=True)
class RobotChoice:
    """Files that a simulated robot and its joints' devices come from."""

    model: Annotated[Any, one(str, "TEXT")] = None
    """model.json, or a device of 'mrwarp device list': identified joint with its effects, on all MR joints (default:
    the asset's own numbers)"""
    asset: OptionalText = None
    """another USD file than assets/usd/mr_go.usda"""


@dataclass(frozen=True, kw_only=True)
class StepChoice:
    """Step of the devices' hysteresis."""

    z_step: ZStep = ZStep.EXACT
    """step of the hysteresis state: its closed form, or the paper's Euler step, which makes the devices of fast joints
    too strong"""


@dataclass(frozen=True, kw_only=True)
class DeviceChoice(StepChoice):
    """How devices act on their joints."""

    coupling: Coupling = Coupling.CONSTRAINT
    """how the device acts: the paper's explicit torque, or a brake that sticks"""


@dataclass(frozen=True, kw_only=True)
class SteppedRobot(RobotChoice, StepChoice, Options):
    """A robot whose devices take a step that the command chooses, not a policy."""


def unit_of(text: str) -> tuple[str, str]:
    """A channel of a robot's log and its unit, such as ``q=deg``."""
    channel, _, unit = text.partition("=")
    if not (channel and unit):
        raise ValueError(f"{text!r} is not CHANNEL=UNIT, such as q=deg")
    return channel, unit


@dataclass(frozen=True, kw_only=True)
class LogOptions(Options):
    """Facts that a robot's log files leave open, for every command that reads one."""

    map: OptionalFile = None
    """what files do not say: of a joint's recording its columns and units (default: units.json next to it), of a bag or
    another project's log the rest (default: map.json next to them, if it is there)"""
    units: Annotated[tuple[tuple[str, str], ...], some(unit_of, "CHANNEL=UNIT")] = ()
    """of another project's log: units of its channels, such as q=deg; commands and speeds follow q"""

    @property
    def said(self) -> dict[str, Any]:
        """Both, as ``mrwarp.robot_logs.forms.open_log.open_log`` takes them; empty where neither is given."""
        return ({"map_file": self.map} if self.map else {}) | ({"units": dict(self.units)} if self.units else {})


VIEW = create_mutex_group(required=False, title="view")


@dataclass(frozen=True, kw_only=True)
class ViewOptions(Options):
    """Where robots are shown while they run."""

    live: Annotated[Flag, VIEW] = False
    """open rerun and watch some of the robots"""
    rrd: Annotated[OptionalFile, VIEW] = None
    """save that view as a recording"""
    connect: Annotated[OptionalText, VIEW] = None
    """URL: send it to a rerun viewer that runs already"""
