"""From the units inside the diagnosis to those of the recording."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mrwarp.diagnose.engine import Engine, Fitted
from mrwarp.diagnose.uncertainty import covariance, interval
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.effects.law import EffectParameter
from mrwarp.identify.dataset import Scales
from mrwarp.identify.parameters import LINEAR, SHAPE
from mrwarp.model_file import Effect, FittedOn, Model, Parameter, effect_unit, parameter_unit
from mrwarp.recording.load import Recording
from mrwarp.run_dir import versions


def factor_of(parameter: EffectParameter, scales: Scales) -> float:
    """Factor from a parameter's inner value to that in the units of the recording."""
    q, current, torque = parameter.scale
    return scales.q**q * scales.current**current * scales.torque**torque


def unit_of(parameter: EffectParameter, units: Mapping[str, str]) -> str:
    """Unit of a parameter for a device with these units of q, current and torque."""
    return effect_unit(parameter, units)


def outer_model(
    engine: Engine,
    fit: Fitted,
    recording: Recording,
    seed: int,
    refined: Mapping[tuple[str, str], tuple[float, float, float]] | None = None,
) -> Model:
    """The fitted model in the units of the recording, for ``model.json``.

    Args:
        engine: The data set.
        fit: The model.
        recording: What it was fitted to.
        seed: Seed of the diagnosis.
        refined: Value and interval of parameters that are known better than by the fit, inner units.
    """
    scales, units, spread = engine.samples.scales, recording.units, covariance(fit)
    row = fit.coordinates.row(fit.x)
    parameters = {}
    for i, name in enumerate((*LINEAR, *SHAPE)):
        factor = scales.factor(name)
        low, high = interval(fit, i, spread)
        value, ci95 = float(row[i]) * factor, None
        if i < len(LINEAR) and low <= fit.x[i] <= high:
            ci95 = (low * factor, high * factor)
        parameters[name] = Parameter(value=value, unit=parameter_unit(name, units), ci95=ci95)
    for name in ("q_offset", "q_center"):
        value = engine.q_zero * scales.q if name == "q_offset" else 0.0
        parameters[name] = Parameter(value=value, unit=parameter_unit(name, units))
    effects = []
    values = fit.coordinates.values(fit.x)
    for effect in fit.effects:
        entries = {}
        for p in CATALOGUE[effect].parameters:
            if p.name not in values[effect]:
                continue
            factor, ci95 = factor_of(p, scales), None
            for i, slot in fit.coordinates.items():
                if slot.effect == effect and slot.parameter is p:
                    ci95 = outer_interval(fit, i, spread, slot.logarithmic, factor)
            value = values[effect][p.name]
            if refined and (effect, p.name) in refined:
                value, *bounds = refined[effect, p.name]
                ci95 = (bounds[0] * factor, bounds[1] * factor)
            entries[p.name] = Parameter(value=value * factor, unit=unit_of(p, units), ci95=ci95)
        effects.append(Effect(name=effect, parameters=entries))
    runs = recording.trajectories
    return Model(
        parameters=parameters, effects=tuple(effects), units=dict(units), seed=seed, versions=versions(),
        fitted_on=FittedOn(
            source=str(recording.source or "in memory"), trajectories=len(runs), samples=recording.samples,
            rate=1.0 / runs[0].dt,
        ),
    )  # fmt: skip


def outer_interval(
    fit: Fitted, index: int, spread: np.ndarray, logarithmic: bool, factor: float
) -> tuple[float, float]:
    """Interval of a coordinate as that of its parameter."""
    low, high = interval(fit, index, spread)
    if logarithmic:
        low, high = float(np.exp(low)), float(np.exp(min(high, 50.0)))
    return low * factor, high * factor
