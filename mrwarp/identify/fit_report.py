"""Results of a fit: the model of ``model.json``, the figures of ``result.json``, the printed table, predictions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from mrwarp.effects.catalogue import HYSTERESIS, KNOWN
from mrwarp.identify.damper import ExtendedFit, extended_torque, prediction_errors, undo_moving_average
from mrwarp.identify.fit import FitResult
from mrwarp.identify.intervals import Estimate
from mrwarp.identify.law_fit import model_torque, printed, printed_numbers
from mrwarp.identify.replay import simulate
from mrwarp.model_file import Effect, FittedOn, Model, Parameter, model_to_dict, parameter_unit
from mrwarp.recording.load import Recording
from mrwarp.run_dir import versions
from mrwarp.runtime import text_table


def to_model(result: FitResult, extended: ExtendedFit | None = None) -> Model:
    """Eqs. 14, 15 (18); an extended model only as an effect with its own full set."""
    estimates = {name: Parameter(value=v, unit=parameter_unit(name, result.units)) for name, v in result.fixed.items()}
    for name, e in result.estimates.items():
        estimates[name] = Parameter(value=e.value, unit=parameter_unit(name, result.units), ci95=e.ci95)
    origin = FittedOn(
        source=result.source,
        trajectories=result.trajectories,
        samples=result.samples,
        rate=result.rate,
        current=result.current,
    )
    return Model(
        parameters=estimates,
        fitted_on=origin,
        units=result.units,
        effects=(*result.effects, *((extended_damper(extended, result.units),) if extended else ())),
        seed=result.seed,
        versions=versions(),
    )


def extended_damper(extended: ExtendedFit, units: Mapping[str, str]) -> Effect:
    """The extended model as an effect, every number with its unit and interval."""
    q, current, torque = (units[key] for key in ("q", "current", "torque"))
    unit = {
        "B_current": f"{torque}·s/({q}·{current})", "B_direction": f"{torque}·s/{q}",
        "B_direction_current": f"{torque}·s/({q}·{current})", "saturation": "1", "softening": "1", "creep": "1/s",
        "current_full": current,
    }  # fmt: skip
    intervals = {name: e.ci95 for name, e in extended.estimates.items()}
    parameters = {
        name: Parameter(value=value, unit=unit.get(name) or parameter_unit(name, units), ci95=intervals.get(name))
        for name, value in extended.values.items()
    }
    return Effect(name="extended_damper", parameters=parameters)


def predictions(
    recording: Recording, result: FitResult, extended: ExtendedFit | None, window: float
) -> dict[str, dict[str, float]]:
    """RMSE over standard deviation of each unseen trajectory, per model and per reading of its motion.

    With ``window`` > 0 the simulated torque passes the moving average that the measured one passed, and both lose their
    mean; the motion is taken as published, and again with its own average undone.
    """
    motions = {"": recording}
    if window > 0.0:
        undone = undo_moving_average(recording, window)
        motions = {" (motion as published)": recording, " (average of the motion undone)": undone}
    found = {}
    for name, motion in motions.items():
        if result.effects:
            torque = model_torque(to_model(result), motion)
            found[f"{law_title(result)}{name}"] = prediction_errors(motion, torque, window)
        else:
            found[f"eqs. 14, 15{name}"] = prediction_errors(motion, simulate(result.values, motion), window)
        if extended is not None:
            torque = extended_torque(extended.values, motion)
            found[f"extended model{name}"] = prediction_errors(motion, torque, window)
    return found


def law_title(result: FitResult) -> str:
    """The hysteresis law of a fit in words, or that there is none."""
    law = next((effect.name for effect in result.effects if effect.name in HYSTERESIS), "")
    return KNOWN[law].title if law else "inertia, gravity, spring and friction" if result.effects else "eq. 14"


def figures(result: FitResult, extended: ExtendedFit | None = None) -> dict[str, Any]:
    """Content of ``result.json``; an interval that the data do not give is null."""
    same = ("fixed", "units", "source", "trajectories", "samples", "rate")
    fitted = {
        "parameters": _entries(result.estimates),
        "combinations": _entries(result.combinations),
        **{name: getattr(result, name) for name in same},
        "condition": min(result.condition, 1e300),
        "correlations": result.correlations,
        "warnings": result.warnings,
        **_errors(result),
        "held_out_nrmse": result.held_out,
        "given": result.given,
    }
    if result.effects:
        model = model_to_dict(to_model(result))
        fitted |= {"law": model.get("law"), "effects": model["effects"], "offsets": result.offsets}
    if extended is not None:
        fitted["extended"] = {
            "parameters": _entries(extended.estimates),
            "current_full": extended.current_full,
            "warnings": extended.warnings,
            **_errors(extended),
        }
    return fitted


_UNIT_OF = {"loading": "beta", "unloading": "beta", "saturation": "D", "initial": "K0", "bias": "D"}
"""Parameter with the unit of a combination, by the combination's first word."""


def lines(result: FitResult, extended: ExtendedFit | None = None) -> list[str]:
    """Parameters, combinations, errors per current and warnings as text."""

    def estimates(title: str, found: Mapping[str, Estimate]) -> list[str]:
        rows = [(name, f"{e.value:.4g}", _interval(e)) for name, e in found.items()]
        return ["", *text_table((f"{title:44s}", "value", "95 % interval"), rows)]

    named = {f"{name} [{parameter_unit(name, result.units)}]": e for name, e in result.estimates.items()}
    for effect in result.effects:
        named |= {
            f"{printed(effect.name, name)} [{p.unit}]": Estimate.of(p.value, p.ci95)
            for name, p in effect.parameters.items()
            if printed(effect.name, name) in {*printed_numbers([effect.name])} - {*result.given}
        }
    control = f" {result.units['current']}".removesuffix(" 1").removesuffix(" none")
    for name, e in result.combinations.items():
        at = control if name.rpartition(" ")[0].endswith(" at") else ""
        named[f"{name}{at} [{parameter_unit(_UNIT_OF[name.partition(' ')[0]], result.units)}]"] = e
    found = estimates("parameter", named)
    if result.given:
        numbers = ", ".join(f"{name} = {value:.4g}" for name, value in result.given.items())
        found += ["", f"given, not fitted (--fix): {numbers}"]
    errors = [{**result.rmse_per_current, "all": result.rmse}]
    head = [f"current [{result.units['current']}]", f"RMSE [{result.units['torque']}]"]
    share = f"NRMSE of {law_title(result)} {100 * result.nrmse:.2f} %"
    if result.held_out is not None:
        share += f", of trajectories left out in turn {100 * result.held_out:.2f} %"
    if extended is not None:
        found += estimates("extended model", extended.estimates)
        errors.append({**extended.rmse_per_current, "all": extended.rmse})
        head.append("extended")
        share += f", extended {100 * extended.nrmse:.2f} %"
    rows = [(key, *(f"{values[key]:.4g}" for values in errors)) for key in errors[0]]
    found += ["", *text_table(head, rows), share]
    return found + [f"warning: {text}" for text in result.warnings]


def _errors(result: FitResult | ExtendedFit) -> dict[str, Any]:
    names = ("rmse", "nrmse", "rmse_per_current", "rmse_per_trajectory")
    return {name: getattr(result, name) for name in names}


def _entries(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {
        name: {
            "value": e.value,
            "ci95": e.ci95,
            "ci95_joint": [e.value - e.half_joint, e.value + e.half_joint] if math.isfinite(e.half_joint) else None,
        }
        for name, e in estimates.items()
    }


def _interval(e: Estimate) -> str:
    return f"{e.ci95[0]:.4g} to {e.ci95[1]:.4g}" if e.ci95 else "none: not determined, or held at the edge of its range"
