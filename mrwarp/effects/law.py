"""Definition of an effect: a named physical law beyond eqs. 14 and 15, with its parameters and its place in the path.

A law is a ``@wp.func`` that changes a :class:`Path`, the quantities of one joint at one step. All laws have the same
arguments, so that the path can be composed of all laws of the catalogue (:mod:`mrwarp.effects.path`):

``law(s, values, row, at, memory, line, slot) -> Path`` with ``values[row, at]`` the law's first parameter and
``memory[line, slot]`` its first state. At null values a law returns the path untouched.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import warp as wp


@wp.struct
class Path:
    """One joint at one step, from the commanded current to the sensor's reading."""

    dt: wp.float32
    """Step [s]."""
    time: wp.float32
    """Time in the session [s]."""
    slid_time: wp.float32
    """Time in the session, counted by sliding: the path length so far over its mean speed [s]."""
    begins: wp.int32
    """1 at the first step, where states are set."""
    held: wp.int32
    """1 in the simulator, where command and torque hold for a step; 0 where a sample is what was at its time."""
    command: wp.float32
    """Commanded current at the step's end [A]."""
    command_before: wp.float32
    """Commanded current at the step's begin [A]."""
    current: wp.float32
    """Current that flows [A]."""
    field: wp.float32
    """Current that magnetises: what K1 is multiplied by [A]."""
    q: wp.float32
    """Angle of the device's shaft [rad]."""
    zero: wp.float32
    """Angle where the stiffness of eq. 14 is at rest [rad]."""
    middle: wp.float32
    """Middle of the angles of the run [rad]; in the simulator ``zero``."""
    qd: wp.float32
    """Its velocity [rad/s]."""
    qdd: wp.float32
    """Its acceleration [rad/s²]."""
    qd_before: wp.float32
    """Velocity at the step's begin [rad/s]."""
    joint_speed: wp.float32
    """Speed by which the hysteresis weakens where the shaft's is another, behind play and a spring; else 0 [rad/s]."""
    qdd_before: wp.float32
    """Acceleration at the step's begin [rad/s²]."""
    path_1: wp.float32
    """Signed path length of the shaft in this step up to a reversal, 0 without one [rad]."""
    path_2: wp.float32
    """Signed path length after it [rad]."""
    z: wp.float32
    """Hysteresis state [rad]; in the stage ``shaft`` that before the step."""
    stiffness: wp.float32
    """Torque of the hysteresis over z [N·m/rad], known from the stage ``shaft`` on."""
    viscosity: wp.float32
    """B of eq. 14 and, from the stage ``torque`` on, what effects add to it [N·m·s/rad]."""
    alpha: wp.float32
    """Of eq. 14 [s/rad]."""
    beta: wp.float32
    """Of eq. 15 [1/rad]."""
    gamma: wp.float32
    """Of eq. 15 [1/rad]."""
    engaged: wp.float32
    """1 where the joint drives the device's shaft, 0 where it moves in a gap and the device takes no part."""
    yield_gain: wp.float32
    """Factor of the hysteretic torque."""
    viscous_gain: wp.float32
    """Factor of the viscous torque."""
    weakening: wp.float32
    """Power of ``1 + alpha*|qd|``."""
    heat: wp.float32
    """Energy turned to heat and not yet lost [J]."""
    temperature: wp.float32
    """Temperature that was logged [degC]; in the simulator that of the model file."""
    torque: wp.float32
    """Torque [N·m]: in the stage ``torque`` what is added to eq. 14, in the stage ``sensor`` the reading."""
    torque_before: wp.float32
    """Torque at a sample as long as the command that comes with it does not act [N·m]."""


Stage = Literal["current", "motion", "shaft", "hysteresis", "torque", "sensor"]
STAGES: tuple[Stage, ...] = ("current", "motion", "shaft", "hysteresis", "torque", "sensor")
"""Order of the path: command to field, measured to true motion, that to the shaft, its stress, torque, its sensor."""

Kind = Literal["mechanism", "sensor", "calibration", "law"]


@dataclass(frozen=True, kw_only=True)
class Ranges:
    """Ranges that a data set (or a joint's use) covers; in the units of the samples."""

    q: float = 1.0
    """Whole range of the angle."""
    qd: float = 5.0
    """95th percentile of the speed."""
    slow: float = 5.0
    """25th percentile over the runs that move of their 95th percentile of the speed."""
    current: float = 1.5
    """Largest current."""
    torque: float = 1.0
    """Typical torque."""
    dt: float = 0.005
    """Sampling interval [s]."""
    radian: float = 1.0
    """One radian; 0 for a linear motion."""
    turns: float = 0.0
    """Full turns that a joint makes, one that lacks a twentieth too; 0 for a linear motion."""
    session: float = 600.0
    """Length of the session [s]."""
    temperature: float = 0.0
    """Mean of the temperature that was logged [degC]."""
    load: bool = False
    """Whether the control input is a load or a pressure, which makes no field: K1 of eq. 14 is 0."""
    carried: bool = False
    """Whether the control input is a load, in the unit of a torque or force."""
    drive: bool = False
    """Whether the torque is a drive's own report, its current or voltage, and no sensor's reading."""


@dataclass(frozen=True, kw_only=True)
class EffectParameter:
    """One number of a law."""

    name: str
    unit: str
    """Unit for a joint in rad, A and N·m."""
    scale: tuple[int, int, int] = (0, 0, 0)
    """Powers of the units of angle, current and torque in it, so that it can be converted; seconds stay."""
    null: float = 0.0
    """Value at which the law does nothing."""
    low: Callable[[Ranges], float] = lambda r: -float("inf")
    high: Callable[[Ranges], float] = lambda r: float("inf")
    """Where it is searched."""
    most: Callable[[Ranges], float] = lambda r: float("inf")
    """Largest value that a device can have: a fit beyond it stands for something else."""
    beyond: str = ""
    """Why it cannot be larger, in words."""
    starts: Callable[[Ranges], tuple[float, ...]] | None = None
    """Values from which a non-linear parameter is searched; None: the torque is smooth in it at its null value."""
    requires: str = ""
    """Name of the number of repetitions without which this number does nothing."""
    repeats: bool = False
    """Whether it counts repetitions along the angle. Of a joint that turns on and on the mismatch's spectrum gives them
    better than any search would, and they are not searched."""
    preset: Callable[[Ranges], float] | None = None
    """Value of a parameter that is not searched but set by what the data cover."""
    resolution: float = 0.0
    """Relative standard error that stays however much is recorded."""
    choices: tuple[float, ...] = ()
    """Values of a parameter that says how the data were logged; tried in turn, and no part of the device. With
    ``form`` the reported fit also has what is between and beyond them, within the bounds."""
    form: bool = False
    """Whether it only bends the law: null while causes are searched, fitted for the reported fit where that predicts
    clearly better, and absent from a model otherwise."""
    carried: bool = False
    """Whether it is that share of an inertia whose torque adds to a load: searched together with an inertia only, where
    the control input is a torque or a force. None of the inertia is then no better a guess than any part of it."""
    optional: bool = False
    """Whether a model may do without it: then it is null."""
    negative: bool = True
    """Whether the sign is free."""
    sudden: bool = False
    """Whether what it changes comes and goes at samples, of which a small step of it would meet single ones."""
    tried_again: tuple[float, ...] = ()
    """Factors of a value that was found from which it is fitted again, where another law takes eq. 15's place and fits
    stop where contacts come and go."""
    recovers: bool = False
    """Whether it is the time in which the effect is gone in a rest. Where that is as long as a session can show, the
    effect is no alternative: it recovers in no rest then, and is another under its name."""
    divides: bool = False
    """Whether the law divides by it, so that it must be above 0."""

    def allowed(self) -> str:
        """Sensible values, in words."""
        return "above 0" if self.divides else "any finite number" if self.negative else "0 or more"

    def allows(self, value: float) -> bool:
        """Whether a finite value makes sense."""
        return value > 0.0 if self.divides else value >= 0.0 or self.negative


STEP_IN_INTERVAL = EffectParameter(
    name="hold",
    unit="1",
    choices=(0.0, 1.0),
    form=True,
    low=lambda r: -1.0,
    high=lambda r: 1.0,
)
"""Where the command steps between two samples that differ: at the second (1), at the first (-1), or anywhere, as a ramp
(0). A log does not say, and (1 - hold)/2 of an interval is how long before the second it is on average."""

DRY_FRICTION_SPEED = EffectParameter(
    name="speed",
    unit="rad/s",
    scale=(1, 0, 0),
    negative=False,
    divides=True,
    preset=lambda r: 0.012 * r.qd,
)
"""Speed over which dry friction changes its sign: small against the speeds that the data cover.

A contact that slips at once, or a few times later, does so between samples: neither is seen.
"""

DIRECTED_FRICTION_SPEED = replace(DRY_FRICTION_SPEED, preset=lambda r: 0.0035 * r.qd)
"""The value for friction that differs by direction, which follows the speed and has no memory."""

STRAIN_TIME = wp.constant(0.005)
"""Time in which a dry contact is strained until it slips, at the speed of its change of sign [s]: the paper's step."""


@wp.func
def dry_direction(s: Path, speed: float, memory: wp.array2d[float], line: int, slot: int) -> float:
    """Direction of dry friction, -1 to 1: it turns round with the way back, and stays what it is at rest.

    What rubs is elastic: a contact is strained over the way of :data:`STRAIN_TIME` at ``speed`` before it slips, keeps
    its strain when the joint stops, and turns round however slowly the joint does. In a gap nothing is held.
    """
    strain = wp.where(s.begins == 1, wp.tanh(s.qd / speed), memory[line, slot] + s.qd * s.dt / (speed * STRAIN_TIME))
    strain = wp.where(s.engaged == 1.0, wp.clamp(strain, -1.0, 1.0), wp.tanh(s.qd / speed))
    memory[line, slot] = strain
    return strain


DRY_FRICTION_RESOLUTION = 0.02
"""Relative standard error of dry friction, whose change of sign nobody sees.

Friction that changes its sign at once comes back as it is, that of a contact which is strained over 0.2 mrad 3 % too
small (``benchmarks.confusion --family bench --known --kinds coulomb_friction``).
"""


@dataclass(frozen=True, kw_only=True)
class EffectLaw:
    """One effect of the catalogue."""

    name: str
    """Token, as in reports, ``model.json`` and ``result.json``."""
    title: str
    """The effect in two or three words."""
    sentence: str
    """Its meaning to a mechanical engineer, in one sentence."""
    equation: str
    kind: Kind
    """``mechanism``: part of the device; ``sensor``: only in what is measured; ``calibration``: a shift of constants
    that re-fitting eq. 14 takes up without a trace; ``law``: takes the place of eq. 15."""
    stage: Stage
    parameters: tuple[EffectParameter, ...]
    law: Any
    """The ``@wp.func``."""
    adds: bool = False
    """Whether it only adds to the torque, independent of the hysteresis, and nothing where its linear numbers are 0."""
    states: int = 0
    """Numbers that the law remembers from step to step."""
    source: str = ""
    depends_on: tuple[str, ...] = ()
    """Variables along which it shows."""
    positive: str = ""
    """Why its first number can only be above 0; empty where it may have either sign."""
    needs: Literal["", "change", "command", "field", "alpha", "stroke", "angle", "temperature"] = ""
    """Without which there is no such effect: a control input that changes, or a changing command that can lag, or the
    current of a magnetic field; alpha of eq. 14, which no other law has; a stroke with ends; an angle in rad; or a
    logged temperature that changes."""
    mechanics: bool = False
    """Whether it is a body's mechanics, as B, C and D of eq. 14 are: linear in its numbers, and these effects oppose
    each other, so that they are looked for together, and bear what they bear together."""
    unseen: str = ""
    """Why a recording shows it at no size, where that is a matter of its control input."""
    measured_in: Literal["", "qd"] = ""
    """Channel that shows it alone, against another: it is a candidate only where that comparison found it."""
    one_positive: bool = False
    """Whether that holds for the larger of its linear numbers, not for the first."""
    rounds_corners: bool = False
    """Whether it rounds a loop's corners, which a law of another shape draws too sharply."""
    yields: bool = False
    """Whether the shaft's path then depends on B, K0 and K1, so that the torque is linear in these for small steps."""
    dry: bool = False
    """Whether it is dry friction: a real contact rubs more at rest than when it slides."""
    in_place_of: str = ""
    """Parameter of eq. 14 whose place it takes where the data exclude that one. Like a term of eq. 14 it comes before
    the other effects, stays next to them, and free functions do not replace it."""
    of_published_laws: Literal["", "term", "saturation", "direction"] = ""
    """Part that it has in published hysteresis laws: a further term over the control input; that input's saturation,
    where trajectories are predicted better with it; or what moves their means by direction, where nothing else does."""
    contains: str = ""
    """Effect that it is itself, with one number more, where that number lies beyond what the data cover: then it is an
    alternative to that one only where it predicts better."""
    hidden_by: str = ""
    """Effect next to which it is not resolved where the torque moves it by less than half of a sample's way."""
    rare: str = ""
    """Why it is no cause where it acts in less than half of the runs; empty where it may be."""
    taken_up_by: tuple[str, ...] = ()
    """Parameters of eq. 14 that take up a shift of calibration, each by the same share; or by the shift itself where
    its own number is 0 without one."""
    looks_like: tuple[str, ...] = ()
    """Effects that take up the same as a shift of calibration: they are its alternatives."""
    remedy: str = ""
    """The remedy on the bench or the device."""

    @property
    def inertial(self) -> bool:
        """Whether it follows the acceleration: it bends the loops of all hysteresis laws, as none of the path does."""
        return "qdd" in self.depends_on

    def defaults(self) -> dict[str, float]:
        """All parameters at null."""
        return {p.name: p.null for p in self.parameters}
