"""Parameters of one MR joint: every number with its unit, allowed range and source.

The five groups follow the paper: the current-aware Bouc-Wen model (eqs. 14, 15), the pre-yield holding law (eqs. 18,
19), the two gates (eqs. 5, 8), the motor that shares the joint (eqs. 2, 9) and the coil. :class:`MrParams` holds all.

All objects are frozen and keyword-only; a variant is ``dataclasses.replace``, never an edit in place.

The same names are used in USD (``newton:mr:<name>``, see ``assets/usd/schema``), in ``model.json`` and in the kernels.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Self, TypeVar

_PAPER_BW = "paper section 4.2, identified coefficients of eqs. 14 and 15"
_PAPER_HOLD = "paper section 4.4, pre-yield fit of eq. 18"
_PAPER_GATE = "paper section 3.2, nominal dynamic-gate thresholds"

_MOST_TORQUE = 1e6
"""Largest torque of a device [N·m], and per unit of what else it depends on: a larger one is in another unit."""
_STEEPEST = 1e9
"""Largest rate of eq. 15 [1/rad]: the loop of dry friction, over on a path below the rounding of an angle."""
_MOST_GAIN = _MOST_TORQUE * _STEEPEST
"""Largest K0 and K1: what a device bears is their ratio to the rate, and that alone is bounded."""


class ParameterError(ValueError):
    """A parameter is missing, misspelt, not a number or out of its range; the message says which, and the remedy."""


@dataclass(frozen=True, kw_only=True)
class ParamSpec:
    """Facts about one parameter: ``unit``, closed range ``[low, high]``, ``default``, ``source``, ``doc``."""

    name: str
    group: str
    unit: str
    low: float
    high: float
    default: float
    source: str
    doc: str

    def check(self, value: float, where: str) -> float:
        """Return ``value`` as float, or raise :class:`ParameterError` naming ``where``, the value and the range."""
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise ParameterError(f"{where}: {self.name} = {value!r} is not a number; {self.allowed()}") from None
        except OverflowError:  # a whole number of more than 308 digits
            number = math.inf if value > 0 else -math.inf
        if not math.isfinite(number) or not self.low <= number <= self.high:
            raise ParameterError(f"{where}: {self.name} = {number:g} is out of range; {self.allowed()}")
        return number

    def allowed(self) -> str:
        """The allowed range as text, e.g. ``allowed: 0 to 1000 N·m/(rad·A), default 10.4133``."""
        return f"allowed: {self.low:g} to {self.high:g}{with_unit(self.unit)}, default {self.default:g}"


def with_unit(unit: str) -> str:
    """A unit to stand behind a number: with a blank before it, nothing for that of a ratio."""
    return f" {unit}" if unit not in ("", "1") else ""


def param(default: float, unit: str, low: float, high: float, source: str, doc: str) -> Any:
    """A field of a :class:`ParamGroup`; the arguments are those of :class:`ParamSpec`."""
    return field(default=default, metadata={"unit": unit, "low": low, "high": high, "source": source, "doc": doc})


class ParamGroup:
    """Base of frozen groups of numbers that each have unit, range and source: every field a float within its range."""

    @classmethod
    @functools.cache
    def specs(cls) -> tuple[ParamSpec, ...]:
        """The specification of every field, in declaration order."""
        return tuple(
            ParamSpec(name=f.name, group=cls.__name__, default=f.default, **f.metadata)  # type: ignore[arg-type]
            for f in dataclasses.fields(cls)  # type: ignore[arg-type]
        )

    def __post_init__(self) -> None:
        for spec in self.specs():
            # frozen: the checked float replaces what was given, such as an int or a numeric string
            object.__setattr__(self, spec.name, spec.check(getattr(self, spec.name), type(self).__name__))


@dataclass(frozen=True, kw_only=True)
class BoucWenParams(ParamGroup):
    """Current-aware Bouc-Wen torque, eqs. 14 and 15.

    ``tau_BW = D + B*qd + C*q_c + I1*I + (K0 + K1*I)/(1 + alpha*|qd|) * z`` with
    ``dz/dt = qd - beta*|qd|*z - gamma*qd*|z|`` and ``q_c = q - q_neutral - (q_offset + q_center)``.

    Raises:
        ParameterError: a value or the torque of slow sliding is out of range, or ``beta + gamma <= 0`` (then z would
            grow without bound).
    """

    q_neutral: float = param(
        -1.5,
        "rad",
        -3.2,
        3.2,
        "neutral stance pose of mrwarp/usd/robot.py",
        "Joint angle from which the displacement q_c is measured.",
    )
    q_offset: float = param(2.39638101e-4, "rad", -1e4, 1e4, _PAPER_BW, "Encoder offset of the bench.")
    q_center: float = param(-1.51224291e-17, "rad", -1e4, 1e4, _PAPER_BW, "Centre of the bench's motion.")
    D: float = param(-0.01917639, "N·m", -_MOST_TORQUE, _MOST_TORQUE, _PAPER_BW, "Constant torque bias.")
    B: float = param(0.1013626, "N·m·s/rad", 0.0, _MOST_TORQUE, _PAPER_BW, "Viscous coefficient.")
    C: float = param(0.2160456, "N·m/rad", -_MOST_TORQUE, _MOST_TORQUE, _PAPER_BW, "Stiffness about q_c = 0.")
    I1: float = param(-7.681742e-4, "N·m/A", -_MOST_TORQUE, _MOST_TORQUE, _PAPER_BW, "Direct current term.")
    K0: float = param(0.3992754, "N·m/rad", 0.0, _MOST_GAIN, _PAPER_BW, "Hysteresis gain without current.")
    K1: float = param(10.413315, "N·m/(rad·A)", 0.0, _MOST_GAIN, _PAPER_BW, "Hysteresis gain per ampere.")
    alpha: float = param(0.7777051, "s/rad", 0.0, 1e6, _PAPER_BW, "Speed weakening of the hysteretic part.")
    beta: float = param(16.50618, "1/rad", 0.0, _STEEPEST, _PAPER_BW, "Loop-shape coefficient.")
    gamma: float = param(-10.53036, "1/rad", -_STEEPEST, _STEEPEST, _PAPER_BW, "Loop-shape coefficient.")
    z_max: float = param(
        5.0, "rad", 0.0, 1e3, "paper section 4.3, bound of the integrated state", "Clip on |z| of the Euler step."
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.beta + self.gamma <= 0.0:
            raise ParameterError(
                f"BoucWenParams: need beta + gamma > 0 1/rad, got {self.beta:g} + {self.gamma:g}; "
                "raise beta or gamma, else z has no bound"
            )
        for name, unit in (("K0", "N·m"), ("K1", "N·m/A")):
            if getattr(self, name) > _MOST_TORQUE * (self.beta + self.gamma):
                raise ParameterError(
                    f"BoucWenParams: {name}/(beta + gamma) = {getattr(self, name) * self.z_bound:g} {unit}, the torque "
                    f"of slow sliding; allowed: up to {_MOST_TORQUE:g} {unit}; lower {name}, or raise beta or gamma"
                )

    @property
    def z_bound(self) -> float:
        """Bound 1/(beta + gamma) of |z| under monotonic loading [rad]."""
        return 1.0 / (self.beta + self.gamma)

    @property
    def euler_rate(self) -> float:
        """Rate of eq. 15 [1/rad]: on a longer path in one step than its inverse, Euler's step overshoots."""
        return max(self.beta - self.gamma, self.beta + self.gamma)

    def sliding_torque(self, current: float) -> float:
        """Torque of slow steady sliding [N·m] at a current [A]: eq. 14's hysteresis at |z| = ``z_bound`` and qd = 0."""
        return (self.K0 + self.K1 * abs(current)) * self.z_bound


AmountT = TypeVar("AmountT", bound=Any)
"""A number or an array of them."""


def holding_curve(current: AmountT, T_max: float, K: float, n: float) -> AmountT:
    """tau_y of eq. 18 [N·m], as ``mrwarp.kernels.brake.yield_torque``, in float64."""
    ratio = (abs(current) / K) ** n
    return T_max * ratio / (1.0 + ratio)


@dataclass(frozen=True, kw_only=True)
class HoldParams(ParamGroup):
    """Pre-yield holding law, eqs. 18 and 19: ``tau_y(I) = T_max*I^n/(K^n + I^n)``."""

    T_max: float = param(26.59697, "N·m", 1e-6, _MOST_TORQUE, _PAPER_HOLD, "Saturation torque.")
    K: float = param(0.51272, "A", 1e-6, 1e3, _PAPER_HOLD, "Current at half of T_max.")
    n: float = param(2.87967, "1", 0.1, 20.0, _PAPER_HOLD, "Exponent of the current-torque curve.")
    safety_factor: float = param(
        1.2, "1", 1.0, 10.0, "paper section 5.2", "Margin of the support current over the needed torque."
    )

    def yield_torque(self, current: AmountT) -> AmountT:
        """Torque up to which the device holds [N·m] at coil currents [A], eq. 18; a number or an array."""
        return holding_curve(current, self.T_max, self.K, self.n)

    def current_for(self, torque: AmountT) -> AmountT:
        """Coil currents [A] at which the device holds torques from 0 to below T_max [N·m]: the inverse of eq. 18."""
        return self.K * (torque / (self.T_max - torque)) ** (1.0 / self.n)

    @staticmethod
    def unmeasured(bouc_wen: BoucWenParams, current: float, saturation: float = 0.0) -> dict[str, float]:
        """T_max, K and n of a device whose break-away torque nobody measured.

        The yield torque is taken as the torque at which the device slides slowly: a Bingham plastic (Phillips, PhD
        thesis, UC Berkeley 1969; Spencer et al., J. Eng. Mech. 123, 1997) gives way where its flow begins. That is the
        least that it holds: real fluids and seals stick above it (the paper's device nine times). With n = 1.3 and K =
        1.5 times the current, eq. 18 rises as the sliding torque does, within 3 % of a straight line from 0 A.

        Args:
            bouc_wen: The device as it slides.
            current: Largest current that it is used with [A].
            saturation: u of the effect ``current_saturation`` [1/A], by which the sliding torque grows ever less.
        """
        n, top = 1.3, max(abs(current), 1e-3)
        field = math.tanh(saturation * top) / saturation if saturation else top
        T_max = min(max(bouc_wen.sliding_torque(field) * (1.0 + 1.5**n), 1e-6), _MOST_TORQUE)
        return {"T_max": T_max, "K": 1.5 * top, "n": n}


@dataclass(frozen=True, kw_only=True)
class GateParams(ParamGroup):
    """Thresholds of the dynamic gate (eq. 5) and the holding gate (eq. 8)."""

    f_th: float = param(5.0, "N", 0.0, 1e4, _PAPER_GATE, "Foot force above which the leg counts as loaded.")
    eps_e: float = param(0.05, "rad", 0.0, 10.0, _PAPER_GATE, "Tracking error above which damping may act.")
    eps_v: float = param(0.20, "rad/s", 0.0, 100.0, _PAPER_GATE, "Speed above which damping may act.")
    eps_hold: float = param(0.20, "rad/s", 0.0, 100.0, "paper section 3.3", "Speed below which holding may act.")


@dataclass(frozen=True, kw_only=True)
class MotorParams(ParamGroup):
    """The electric motor on the same joint: PD law of eq. 2 with the gain switch of eq. 9."""

    kp_base: float = param(
        35.0,
        "N·m/rad",
        0.0,
        1e4,
        "not in the paper; public Go1 practice is 20 to 35 (MuJoCo Playground's Go1: 35); 25 cannot stand open loop",
        "Proportional gain with the holding gate closed.",
    )
    kp_low: float = param(5.0, "N·m/rad", 0.0, 1e4, "paper section 7", "Proportional gain while the device holds.")
    kd: float = param(0.6, "N·m·s/rad", 0.0, 1e3, "not in the paper; Go1 practice 0.5 to 0.7", "Derivative gain.")
    tau_limit: float = param(
        35.55,
        "N·m",
        0.0,
        1e4,
        "Go1 calf effort limit, unitree_go1 of MuJoCo Menagerie (knee forcerange)",
        "Motor torque limit.",
    )


@dataclass(frozen=True, kw_only=True)
class CoilParams(ParamGroup):
    """The coil and its current controller."""

    coil_time_constant: float = param(
        0.0, "s", 0.0, 10.0, "the paper's model has no lag", "First-order lag from command to coil current; 0 = none."
    )
    coil_resistance: float = param(
        4.0,
        "Ohm",
        0.0,
        1e4,
        "assumption: not in the paper; small MR brakes lie between 2 and 10",
        "Coil resistance, for the coil's loss and heat; 0 = not known: what hangs on it is left out.",
    )
    current_max: float = param(1.5, "A", 0.0, 100.0, "paper section 4.1, largest current tested", "Controller limit.")


_GROUPS: dict[str, type[ParamGroup]] = {
    "bouc_wen": BoucWenParams,
    "hold": HoldParams,
    "gate": GateParams,
    "motor": MotorParams,
    "coil": CoilParams,
}


@dataclass(frozen=True, kw_only=True)
class MrParams:
    """All parameters of one MR joint. Defaults are the paper's MR_Go calf joint.

    Example:
        >>> import mrwarp
        >>> weaker = mrwarp.MrParams().replace(T_max=10.0)
        >>> weaker.hold.T_max
        10.0
    """

    bouc_wen: BoucWenParams = field(default_factory=BoucWenParams)
    hold: HoldParams = field(default_factory=HoldParams)
    gate: GateParams = field(default_factory=GateParams)
    motor: MotorParams = field(default_factory=MotorParams)
    coil: CoilParams = field(default_factory=CoilParams)

    @classmethod
    @functools.cache
    def specs(cls) -> tuple[ParamSpec, ...]:
        """Specifications of all parameters, in the order of the groups. Names are unique over the groups."""
        return tuple(spec for group in _GROUPS.values() for spec in group.specs())

    @classmethod
    def spec(cls, name: str, where: str = "MrParams") -> ParamSpec:
        """The specification of one parameter.

        Raises:
            ParameterError: there is no such parameter; the message proposes the nearest name.
        """
        import difflib

        by_name = {spec.name: spec for spec in cls.specs()}
        if name not in by_name:
            by_lower = {known.lower(): spec for known, spec in by_name.items()}
            near = [by_lower[low] for low in difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.4)]
            hint = f"did you mean {near[0].name!r}? {near[0].allowed()}" if near else f"known: {', '.join(by_name)}"
            raise ParameterError(f"{where}: there is no MR parameter {name!r}; {hint}")
        return by_name[name]

    @classmethod
    def from_dict(cls, values: dict[str, float], where: str = "MrParams") -> Self:
        """Build from a flat ``{name: value}`` mapping that holds every parameter.

        Raises:
            ParameterError: a name is unknown or missing, or a value is out of range; names ``where`` it stood.
        """
        for name, value in values.items():
            cls.spec(name, where).check(value, where)
        missing = [spec for spec in cls.specs() if spec.name not in values]
        if missing:
            spec = missing[0]
            raise ParameterError(f"{where}: {spec.name} is missing; {spec.allowed()}")
        groups = {}
        for key, group in _GROUPS.items():
            try:
                groups[key] = group(**{spec.name: float(values[spec.name]) for spec in group.specs()})
            except ParameterError as error:
                raise ParameterError(f"{where}: {error}") from None
        return cls(**groups)

    def to_dict(self) -> dict[str, float]:
        """The flat ``{name: value}`` mapping; ``from_dict(to_dict())`` is the identity."""
        return {name: value for name, value in self}

    def __iter__(self) -> Iterator[tuple[str, float]]:
        """Iterate over ``(name, value)`` in the order of :meth:`specs`."""
        for key, group in _GROUPS.items():
            for spec in group.specs():
                yield spec.name, getattr(getattr(self, key), spec.name)

    def alone(self) -> Self:
        """The device by itself, as on a bench: angles from zero, and no motor.

        Every host outside of a robot's asset takes a device so: ``q_neutral`` says where a joint stands in a robot.
        """
        return self.replace(q_neutral=0.0, kp_base=0.0, kp_low=0.0, kd=0.0, tau_limit=1e4)

    def replace(self, **changes: float) -> Self:
        """A copy with some parameters changed, checked like any other."""
        for name in changes:
            self.spec(name)
        return type(self).from_dict({**self.to_dict(), **changes})
