"""A diagnosis as text: the verdict in a sentence, numbers in sensible units with the digits that intervals carry."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from mrwarp.diagnose.held_out import Account
from mrwarp.diagnose.result import Diagnosis
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.effects.law import EffectParameter
from mrwarp.recording.data import quantity, true_names
from mrwarp.sysid.report.words import both, capital, percent
from mrwarp.sysid.verdict import Cause, Value

_STEPS: dict[str, tuple[tuple[float, float, str], ...]] = {
    "s": ((0.0, 1e3, "ms"), (1.0, 1.0, "s"), (600.0, 1.0 / 60.0, "min")),
    "rad": ((0.0, 1e3, "mrad"), (0.2, 1.0, "rad")),
    "m": ((0.0, 1e6, "µm"), (1e-3, 1e3, "mm"), (1.0, 1.0, "m")),
    "rad/s": ((0.0, 1e3, "mrad/s"), (0.1, 1.0, "rad/s")),
    "m/s": ((0.0, 1e3, "mm/s"), (1.0, 1.0, "m/s")),
    "A": ((0.0, 1e3, "mA"), (0.5, 1.0, "A")),
    "V": ((0.0, 1e3, "mV"), (0.5, 1.0, "V")),
    "N·m": ((0.0, 1e3, "mN·m"), (0.5, 1.0, "N·m"), (1e4, 1e-3, "kN·m")),
    "N": ((0.0, 1e3, "mN"), (0.5, 1.0, "N"), (1e4, 1e-3, "kN")),
    "kg·m²": ((0.0, 1e4, "kg·cm²"), (0.1, 1.0, "kg·m²")),
    "kg": ((0.0, 1e3, "g"), (0.5, 1.0, "kg")),
    "1/s": ((0.0, 6e3, "% per minute"),),
    "1/J": ((0.0, 1e5, "% per kJ"),),
    "N·m·s/rad": ((0.0, 1e3, "mN·m·s/rad"), (0.1, 1.0, "N·m·s/rad")),
}
"""Unit: from which size on, what factor gives what readable unit."""

_THOUSAND = 1e3
"""Numbers from this on are written out, without a power of ten."""
_TIMES = 1e3
"""Ratio of two times from which they are no one quantity: lags are milliseconds, what warms up takes minutes."""
_FEW_ALONG = 2
"""Most effects along one variable that are named as not explaining it."""
_LITTLE = 0.5
"""Share of what a learned torque could take off the error, by what repeats, below which boosting takes only little."""
_MOSTLY = 0.5
"""Part of all that could be predicted, and error over the torque's standard deviation, from which most is unknown."""
_VARIABLES = {
    "qd": "the velocity",
    "qdd": "the acceleration",
    "time": "the time",
    "memory": "what happened shortly before (memory)",
    "frequency": "the frequency",
    "temperature": "the temperature",
}


class Readable(NamedTuple):
    """One number as text, and its 95 % interval; empty where there is none."""

    value: str
    interval: str


def scale(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which numbers of a size are readable."""
    found = (1.0, "" if unit == "1" else unit)
    for least, factor, name in _STEPS.get(unit, ()):
        if abs(size) >= least:
            found = (factor, name)
    return found


def rounded(value: float, figures: int) -> str:
    """A number with so many figures; a large one without a power of ten."""
    number = float(f"{value:.{figures}g}")
    return f"{number:.0f}" if abs(number) >= 10.0 ** (figures - 1) else f"{value:.{figures}g}"


_INVERSE = {"rad/(N·m)": "N·m/rad", "m/N": "N/m"}
"""Units of a compliance, each with that of the spring constant that stands next to it."""


def digits(value: float, half: float) -> str:
    """A number with the digits that its half interval leaves, two of them uncertain, and four at most."""
    if not math.isfinite(value):
        return "unknown"
    if value == 0.0:
        return "0"
    if not math.isfinite(half) or half <= 0.0:
        return rounded(value, 4)
    places = min(1 - math.floor(math.log10(half)), 3 - math.floor(math.log10(abs(value))))
    if places > 6 or places < -6:
        return rounded(value, 4)
    return f"{value:.{places}f}" if places >= 0 else f"{round(value, places):.0f}"


def measured(value: float, unit: str, *, scaled: bool = True) -> str:
    """A number with its readable unit, or with its own."""
    factor, name = scale(value, unit) if scaled else (1.0, unit)
    size = abs(value * factor)
    return (
        f"{value * factor:{'.0f' if size >= _THOUSAND else '.3g'}} {name}".strip()
        if math.isfinite(value)
        else "unknown"
    )


def largest_of(values: Iterable[Value]) -> dict[str, float]:
    """Largest size of each unit among the numbers of a table, whose readable unit the others share."""
    largest: dict[str, float] = {}
    for value in values:
        if math.isfinite(value.value):
            largest[value.unit] = max(largest.get(value.unit, 0.0), abs(value.value))
    return largest


def largest_in_report(d: Diagnosis) -> dict[str, float]:
    """Sizes that choose a report's units, one for each quantity; torques are in the unit of the pictures' axes."""
    numbers = [v for c in d.causes for v in c.parameters.values()]
    numbers += [next(iter(x.parameters.values())) for x in d.suspects if x.parameters and x.possible]
    return largest_of([*numbers, *d.parameter_shift, *d.detectable.values()]) | {d.recording.units["torque"]: 1.0}


def shared_scale(value: float, unit: str, largest: Mapping[str, float] | None) -> tuple[float, str]:
    """Factor and readable unit of a number in a table with these :func:`largest_of` its unit."""
    top = (largest or {}).get(unit, abs(value))
    return scale(value if unit == "s" and top > _TIMES * abs(value) else top, unit)


def readable(
    value: Value, parameter: EffectParameter | None = None, largest: Mapping[str, float] | None = None
) -> Readable:
    """A value and its interval; a gain is given as its change in per cent, what repeats along an angle per turn.

    ``largest`` holds the :func:`largest_of` a table, whose numbers of one unit then share a readable one.
    """
    low, high = value.ci95
    if is_gain(parameter) and value.unit == "1":
        return Readable(_signed(value.value), f"{_signed(low)} to {_signed(high)}" if low < high else "")
    factor, name = shared_scale(value.value, value.unit, largest)
    if parameter is not None and parameter.repeats and value.unit == "1/rad":
        name = "per turn"
    half = 0.5 * (high - low) * factor
    text = f"{digits(value.value * factor, half)} {name}".strip()
    interval = f"{digits(low * factor, half)} to {digits(high * factor, half)} {name}".strip() if low < high else ""
    return Readable(text + spring_constant(value), interval)


def spring_constant(value: Value) -> str:
    """The spring constant next to a compliance, as " (250 N·m/rad)"; empty next to anything else."""
    known = value.unit in _INVERSE and value.value > 0.0
    return f" ({rounded(1.0 / value.value, 3)} {_INVERSE[value.unit]})" if known else ""


def is_gain(parameter: EffectParameter | None) -> bool:
    """Whether a parameter is a factor on a measured quantity."""
    return parameter is not None and parameter.name == "gain" and parameter.null == 1.0


def title(token: str) -> str:
    """Name of an effect in the catalogue."""
    return CATALOGUE[token].title if token in CATALOGUE else token


def either(tokens: Iterable[str]) -> str:
    """Titles joined by commas and "or"."""
    return both((title(token) for token in tokens), "or")


def variable(name: str, units: Mapping[str, str]) -> str:
    """A variable of ``depends_on`` in words."""
    if name in ("q", "current", "torque"):
        return f"the {quantity(name, units)}"
    return _VARIABLES.get(name, name)


def axis_label(key: str, units: Mapping[str, str], gap: str = " ") -> str:
    """Quantity of a recording's column, with its unit."""
    return f"velocity{gap}[{units['q']}/s]" if key == "qd" else f"{quantity(key, units)}{gap}[{units[key]}]"


def _signed(factor: float) -> str:
    return f"{100.0 * (factor - 1.0):+.2f} %"


def sentence_of(d: Diagnosis) -> str:
    """The verdict in one sentence, behind one for each thing that is wrong with the recording."""
    parts = []
    if d.law is not None and d.law.other:
        before, after = map(percent, d.law.error)
        errors = f", error {before} → {after}" if d.law.error[1] < d.law.error[0] and after != before else ""
        shape = "is a simpler one" if d.law.simpler else "has another shape"
        parts.append(f"the hysteresis {shape}: {d.law.title}{errors}")
        if (dry := d.dry_friction) is not None:
            shown = readable(dry, largest=largest_in_report(d))
            known = f" ({shown.interval})" if shown.interval else ""
            parts[-1] += f", in which the joint slides at {shown.value}{known} of Coulomb friction"
    if d.causes:
        parts.append(
            ("with it " if parts else "")
            + "the model lacks "
            + both(_cause_text(c.name, c.alternatives, len(d.causes)) + _per_turn(c) for c in d.causes)
        )
        if d.gain is not None:
            low, high = d.gain.ci95
            them = "it" if len(d.causes) == 1 else "them"
            gains = d.gain.rmse_reduction > 0.0
            parts.append(
                f"with {them} the error on unseen trajectories "
                + (f"falls by {percent(d.gain.rmse_reduction)}" if gains else "does not fall")
                + f" (95 %: {percent(low)} to {percent(high)})"
            )
    if d.unexplained is not None:
        also = "also, " if d.causes else ""
        what = f"structure along {both(variable(v, d.recording.units) for v in d.unexplained.depends_on[:2])}"
        if d.unexplained.depends_on[0] == "frequency":
            what = d.unexplained.form
        parts.append(f"{also}there is {what} that {_not_explained_by(d)}")
        if d.unexplained.share > _MOSTLY and d.extended.nrmse > _MOSTLY:
            parts.insert(0, f"mostly unknown: {percent(d.extended.nrmse, 0)} of the torque is not predicted")
    if d.account is not None and d.account.open:
        parts.append(_what_repeats(d.account))
    likely = [s.name for s in d.suspects if s.possible]
    if not parts and likely:
        parts.append(f"no cause is proven, but these data do not rule out {either(likely)}")
    if not parts:
        parts.append("nothing is missing that these data could show")
    for s in d.parameter_shift:
        parts.append(f"the calibration has shifted: {either((s.name, *s.alternatives))}")
    return " ".join((*fault_sentences(d), true_names(capital("; ".join(parts)) + ".", d.recording.units)))


def _not_explained_by(d: Diagnosis) -> str:
    """Effects that do not explain the found structure, with the effects that lie along its first variable alone."""
    assert d.unexplained is not None
    first = d.unexplained.depends_on[0]
    along = [t for t in d.tried if t.name in CATALOGUE and CATALOGUE[t.name].depends_on == (first,)]
    if named := [t.name for t in along if t.outcome == "named"]:
        return f"goes beyond {either(named)}"
    if along and len(along) <= _FEW_ALONG:
        return f"{either(t.name for t in along)} does not explain"
    return "no effect of the catalogue explains"


def _what_repeats(account: Account) -> str:
    """How much repeats without a name, and what a learned torque could take of it."""
    repeats, gains = percent(account.repeatable.share, 0), account.learnable.share
    kept = account.least / max(account.least + account.unnamed, 1e-9)
    most = 1.0 - math.sqrt(kept)
    if gains < _LITTLE * most:
        return (
            f"{repeats} of the squared mismatch comes again where the same motion does, and has no name. Boosting "
            f"takes only {percent(gains, 0)} off the error of a held-out run. A learned torque (--learn) "
            f"needs more runs of the same motions; it could then take up to {percent(most, 0)}"
        )
    return (
        f"{repeats} of the squared mismatch comes again in every run and has no name: a learned torque (--learn) could "
        f"take up to {percent(gains, 0)} off the error on unseen trajectories"
    )


def fault_sentences(d: Diagnosis) -> list[str]:
    """Faults of the recording, a sentence each."""
    return [true_names(capital(fault.sentence) + ".", d.recording.units) for fault in d.recording_faults]


def _per_turn(cause: Cause) -> str:
    """How often something repeats in a full turn, strongest first, where it is known for several harmonics."""
    found = [v.value for name, v in cause.parameters.items() if name.startswith("periods") and v.unit == "1/rad"]
    if len(found) < 2:
        return ""
    first, *others = dict.fromkeys(f"{n:.0f}" for n in found)
    return f" ({first} per turn, then {both(others)})" if others else f" ({first} per turn)"


def _cause_text(name: str, alternatives: tuple[str, ...], causes: int) -> str:
    if causes > 1 and alternatives:
        return f"{either([name])} (or {either(alternatives)})"
    return either((name, *alternatives))
