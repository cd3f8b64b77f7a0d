"""Effects that can be hidden in a virtual robot: causes of the contract, and effects outside the catalogue."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from mrwarp.run_dir import one_line

Kind = Literal["joint", "device", "body", "trunk", "foot", "robot", "channel"]
"""Kinds of places: a joint, a joint with a device, a body, a foot's leg, one of :data:`CHANNELS`, or nothing."""

CHANNELS = ("joints", "imu", "commands", "feet")
"""Groups of columns whose stamps can be shifted."""


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One effect that can be hidden."""

    kind: Kind
    unit: str
    """Unit of the size; empty where it has none."""
    size: tuple[str, ...]
    """Names of its numbers; the first may stand alone, the others are then 0."""
    low: float
    high: float
    help: str
    catalogued: bool = True
    """Whether a diagnosis has a name for it."""


def _effect(kind: Kind, unit: str, low: float, high: float, text: str, *size: str, catalogued: bool = True) -> Effect:
    return Effect(kind=kind, unit=unit, size=size or ("size",), low=low, high=high, help=text, catalogued=catalogued)


EFFECTS: dict[str, Effect] = {
    "trunk_mass": _effect("trunk", "kg", -5.0, 20.0, "added to the trunk, at its centre of mass"),
    "trunk_com": _effect("trunk", "m", -0.2, 0.2, "the trunk's centre of mass is moved", "x", "y", "z"),
    "link_mass": _effect("body", "kg", -5.0, 20.0, "added to a link, at its centre of mass"),
    "link_com": _effect("body", "kg·m", -5.0, 5.0, "static moment added to a link: its centre moves", "x", "y", "z"),
    "link_length": _effect("body", "m", -0.1, 0.1, "a link is longer, its children sit further out"),
    "rotor_inertia": _effect("joint", "kg·m²", -1.0, 10.0, "added to the rotor, seen at the joint"),
    "coulomb_friction": _effect("joint", "N·m", 0.0, 100.0, "dry friction, added"),
    "viscous_friction": _effect("joint", "N·m·s/rad", 0.0, 100.0, "friction in proportion to speed, added"),
    "stribeck": _effect("joint", "N·m", 0.0, 100.0, "dry friction near standstill, faded at 0.15 rad/s"),
    "backlash": _effect("joint", "rad", 0.0, 0.2, "half of the play between motor and link"),
    "motor_strength": _effect("joint", "", 0.0, 3.0, "factor on the motor's torque"),
    "torque_limit": _effect("joint", "N·m", 0.0, 1000.0, "the motor gives no more than this"),
    "kp": _effect("joint", "", 0.0, 5.0, "factor on the gain that the drive uses, relative to the logged one"),
    "kd": _effect("joint", "", 0.0, 5.0, "factor on the drive's damping gain"),
    "command_delay": _effect("robot", "s", 0.0, 0.1, "commands act later"),
    "command_lag": _effect("joint", "s", 0.0, 0.1, "time constant of a filter on the joint's target"),
    "clock_shift": _effect("channel", "s", -0.05, 0.05, "stamps of a channel are late by this"),
    "torque_lag": _effect("joint", "s", 0.0, 0.1, "time constant with which the motor's torque follows"),
    "gravity_compensation": _effect("joint", "", -2.0, 2.0, "share of gravity's torque that the drive adds by itself"),
    "series_elasticity": _effect("joint", "Hz", 1.0, 100.0, "natural frequency of the link on its locked motor"),
    "base_compliance": _effect("robot", "Hz", 1.0, 100.0, "natural frequency of a held robot on its base"),
    "torque_channel_offset": _effect("joint", "N·m", -100.0, 100.0, "added to every reading of the torque"),
    "torque_channel_gain": _effect("joint", "", -100.0, 100.0, "factor on every reading of the torque"),
    "torque_channel_gravity": _effect(
        "joint", "", -2.0, 2.0, "share of gravity's torque that readings of the torque add"
    ),
    "encoder_offset": _effect("joint", "rad", -0.5, 0.5, "added to every reading of the encoder"),
    "velocity_lag": _effect("joint", "s", 0.0, 0.1, "time constant of the filter on the measured speed"),
    "imu_tilt": _effect("robot", "rad", -0.3, 0.3, "the inertial sensor is mounted askew", "roll", "pitch"),
    "gyro_bias": _effect("robot", "rad/s", -1.0, 1.0, "added to the gyroscope", "x", "y", "z"),
    "ground_friction": _effect("robot", "", 0.02, 3.0, "coefficient of the ground in place of the description's"),
    "ground_slope": _effect("robot", "rad", -0.3, 0.3, "the ground is tilted about x and y", "roll", "pitch"),
    "ground_stiffness": _effect("robot", "", 0.01, 10.0, "factor on the stiffness of every contact"),
    "coil_dead": _effect("device", "", 0.0, 0.0, "the coil's wire is broken: no current flows"),
    "coil_lag": _effect("device", "s", 0.0, 0.2, "time constant of the coil, added"),
    "device_strength": _effect("device", "", 0.0, 3.0, "factor on what the device gives per current"),
    "device_drag": _effect("device", "N·m", 0.0, 20.0, "drag of the device without current, added"),
    "hysteresis_law": _effect("device", "", 0.0, 0.0, "the device slides without memory: an arctangent of the speed"),
    "tail_weight": _effect("robot", "kg", 0.0, 5.0, "a weight swings from the rear of the trunk", catalogued=False),
    "cable_pull": _effect("robot", "N", 0.0, 200.0, "an elastic cable pulls back and up", catalogued=False),
    "soft_foot": _effect("foot", "", 0.01, 1.0, "factor on the stiffness of one foot", catalogued=False),
    "wind": _effect("robot", "N", 0.0, 200.0, "gusts from the left, each some seconds long", catalogued=False),
}
"""By name, as ``mrwarp log record --hide`` takes them; those of the contract first."""


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """One hidden effect at one place."""

    cause: str
    where: str
    """Joint, body or leg; ``robot`` where the effect has no place."""
    values: tuple[float, ...]
    """In the order of the effect's ``size``."""

    @property
    def value(self) -> float:
        """The first number."""
        return self.values[0]

    def to_dict(self) -> dict[str, object]:
        """As in ``truth.json``."""
        effect = EFFECTS[self.cause]
        values = dict(zip(effect.size, self.values, strict=True))
        return {
            "cause": self.cause, "where": self.where, "values": values, "unit": effect.unit or "1",
            "catalogued": effect.catalogued,
        }  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Places:
    """Places of a robot, by the names that its description gives."""

    joint: tuple[str, ...]
    device: tuple[str, ...]
    body: tuple[str, ...]
    trunk: str
    legs: dict[str, tuple[str, ...]]
    """Joints of each leg."""


def parse_hidden(text: str, places: Places) -> list[Hidden]:
    """Read ``CAUSE``, ``CAUSE=SIZE``, ``CAUSE=PLACE`` or ``CAUSE=PLACE:SIZE``; several numbers are parted by commas.

    A place is a name, a name with ``*``, or a leg, which stands for its joints.

    Raises:
        ValueError: cause, place or size are not of this robot; the message says what is.
    """
    cause, _, rest = text.partition("=")
    if cause not in EFFECTS:
        raise ValueError(f"--hide {text}: there is no effect {cause!r}; there are {', '.join(EFFECTS)}")
    effect = EFFECTS[cause]
    placed = effect.kind not in ("robot", "trunk")
    place, colon, numbers = rest.rpartition(":")
    if not colon:
        place, numbers = (rest, "") if placed and not effect.low < effect.high else ("", rest)
    form = f"{cause}={'PLACE:' * placed}{','.join(name.upper() for name in effect.size)}"
    form = form if effect.low < effect.high else f"{cause}=PLACE"
    if placed and not place:
        raise ValueError(f"--hide {text}: where? write {form}; places: {', '.join(_known(effect.kind, places))}")
    values = _numbers(text, numbers, effect, form)
    found = _find(place, effect.kind, places) if placed else [places.trunk if effect.kind == "trunk" else "robot"]
    if not found:
        known = ", ".join(_known(effect.kind, places)) or "none on this robot"
        raise ValueError(f"--hide {text}: there is no place {place!r} for it; places: {known}")
    return [Hidden(cause=cause, where=where, values=values) for where in found]


def parse_all(texts: Sequence[str], places: Places) -> list[Hidden]:
    """Read all of ``--hide``; raises as :func:`parse_hidden`, and where one effect is asked for twice at a place."""
    found = [hidden for text in texts for hidden in parse_hidden(text, places)]
    for k, hidden in enumerate(found):
        if any((h.cause, h.where) == (hidden.cause, hidden.where) for h in found[:k]):
            raise ValueError(f"--hide {hidden.cause}: {hidden.where} is named twice; name it once")
    return found


def _numbers(text: str, numbers: str, effect: Effect, form: str) -> tuple[float, ...]:
    if not effect.low < effect.high:
        if numbers:
            raise ValueError(f"--hide {text}: it has no size; write {form}")
        return (1.0,)
    try:
        values = tuple(float(number) for number in numbers.split(","))
    except ValueError as error:
        raise ValueError(f"--hide {text}: {one_line(error)}; write {form}") from None
    if len(values) > len(effect.size):
        raise ValueError(f"--hide {text}: {len(values)} numbers, it has {len(effect.size)}; write {form}")
    for value in values:
        if not (math.isfinite(value) and effect.low <= value <= effect.high):
            unit = f" {effect.unit}" if effect.unit else ""
            raise ValueError(f"--hide {text}: {value:g}{unit}; allowed: {effect.low:g} to {effect.high:g}{unit}")
    return values + (0.0,) * (len(effect.size) - len(values))


def _known(kind: Kind, places: Places) -> Iterable[str]:
    lists = {"joint": places.joint, "device": places.device, "body": places.body, "foot": places.legs}
    return CHANNELS if kind == "channel" else lists[kind]


def _find(place: str, kind: Kind, places: Places) -> list[str]:
    known = list(_known(kind, places))
    if kind in ("joint", "device") and place in places.legs:
        return [name for name in known if name in places.legs[place]]
    return [name for name in known if fnmatch.fnmatchcase(name, place)]


def listing() -> list[tuple[str, str, str]]:
    """Rows (form, unit, what it is) of every effect, for the terminal and the page."""
    rows = []
    for name, effect in EFFECTS.items():
        place = {"robot": "", "trunk": ""}.get(effect.kind, effect.kind.upper())
        size = ",".join(s.upper() for s in effect.size) if effect.low < effect.high else ""
        rows.append((f"{name}={':'.join(x for x in (place, size) if x)}", effect.unit, effect.help))
    return rows
