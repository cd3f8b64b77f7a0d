"""What a search for causes amounts to: causes with intervals, structure left over, shifts of calibration."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from mrwarp.diagnose.calibration_shift import Found, find_shifts
from mrwarp.diagnose.choice import Choice, threshold
from mrwarp.diagnose.engine import Engine, Fitted
from mrwarp.diagnose.features import Group
from mrwarp.diagnose.physical_units import factor_of, unit_of
from mrwarp.diagnose.result import (
    Cause,
    Shift,
    Unexplained,
    Value,
)
from mrwarp.diagnose.spectral_lines import Line
from mrwarp.diagnose.uncertainty import covariance, interval
from mrwarp.identify.parameters import LINEAR, SHAPE, Slot
from mrwarp.model_file import JOINT_UNITS, Model
from mrwarp.params import MrParams
from mrwarp.recording.load import Recording

_UNEXPLAINED_T = 2.0
"""Structure is only reported when it foretells trajectories with this ratio to its standard error."""
_CLEARLY = 2.0
"""Gain, in thresholds, from which it is reported at all."""
_BEYOND_DOUBT = 5.0
"""Gain, in thresholds, above which it is reported although a few trajectories carry it."""
_SLOW_T = 2.5
_SHARE = 0.2
"""Part of the predictable mismatch above which what is left beside named effects is reported."""


def unexplained_of(choice: Choice, line: Line | None) -> Unexplained | None:
    """Structure that stays when the named effects are in, or None."""
    final = choice.final
    need = threshold(final)
    left = [
        f
        for f in choice.left_after
        if f.gain > _BEYOND_DOUBT * need or (f.gain > _CLEARLY * need and f.t > _needed_t(f.group))
    ]
    gain = max([f.gain for f in left], default=0.0)
    if line is None and not left:
        return None
    named = choice.gain
    both = gain + (line.gain if line else 0.0)
    share = both / max(named + both, 1e-9)
    if named > 0.0 and share < _SHARE:
        return None
    if line is not None and line.gain > gain:
        return Unexplained(depends_on=("frequency",), form=f"a line at {line.frequency:.2f} Hz", share=share)
    top = left[0]
    variables = list(top.group.variables)
    for f in left[1:3]:
        if f.gain > 0.5 * top.gain:
            variables += [v for v in f.group.variables if v not in variables]
    return Unexplained(depends_on=tuple(variables), form=top.group.form, share=share)


def _needed_t(group: Group) -> float:
    return _SLOW_T if group.slow or "memory" in group.variables else _UNEXPLAINED_T


def causes_of(engine: Engine, choice: Choice, candidates: list[str]) -> list[Cause]:
    """The named effects, largest gain first, with the intervals of their parameters."""
    final = choice.stated(engine, choice.final)
    spread = covariance(final)
    starts = len(candidates) * 6
    causes = []
    for effect in choice.own(final):
        parameters = {}
        for i, slot in final.coordinates.items():
            if slot.effect == effect:
                refined = choice.refined.get((effect, slot.parameter.name))
                parameters[slot.parameter.name] = _value(engine, final, slot, i, spread, refined)
        own = choice.own_gain.get(effect, choice.gain)
        count = len(parameters)
        causes.append(
            Cause(
                name=effect,
                parameters=parameters,
                p_value=float(min(1.0, starts * chi2.sf(max(own, 0.0), count))),
                alternatives=choice.alternatives.get(effect, ()),
                gain=own / choice.base.total,
            )  # fmt: skip
        )
    return sorted(causes, key=lambda c: -c.gain)


def _value(
    engine: Engine, fit: Fitted, slot: Slot, index: int, spread: np.ndarray, refined: tuple[float, ...] | None
) -> Value:
    factor = factor_of(slot.parameter, engine.samples.scales)
    numbers = np.array(refined or (fit.x[index], *interval(fit, index, spread)))
    if slot.logarithmic and refined is None:
        numbers = np.exp(numbers)
    value, low, high = numbers * factor
    return Value(value=float(value), ci95=(float(low), float(high)), unit=unit_of(slot.parameter, engine.units))


def shifts_of(engine: Engine, choice: Choice, recording: Recording, model: Model | None) -> list[Shift]:
    """Shifts of calibration against the nominal parameters."""
    if model is not None:
        nominal = model.values
    elif recording.units == JOINT_UNITS:
        paper = MrParams().bouc_wen
        nominal = {name: getattr(paper, name) for name in (*LINEAR, *SHAPE)}
    else:
        return []
    scales = engine.samples.scales
    inner = {name: nominal[name] / scales.factor(name) for name in (*LINEAR, *SHAPE)}
    found = find_shifts(choice.final, inner, float(np.ptp(engine.samples.torque)))
    return [_shift(f, engine, recording) for f in found]


def _shift(found: Found, engine: Engine, recording: Recording) -> Shift:
    bias = found.name == "torque_bias"
    factor = engine.samples.scales.torque if bias else 1.0
    half = 1.96 * found.error * factor
    value = found.value * factor
    return Shift(
        name=found.name, value=value, ci95=(value - half, value + half),
        unit=recording.units["torque"] if bias else "1", alternatives=found.alternatives,
    )  # fmt: skip
