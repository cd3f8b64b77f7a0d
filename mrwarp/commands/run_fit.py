"""``mrwarp fit``: identify a joint from recordings and write its model, figures and pictures."""

from __future__ import annotations

import dataclasses
import fnmatch
import math
import time
from collections.abc import Mapping
from typing import Any

from mrwarp.identify.damper import (
    ExtendedFit,
    extended_torque,
    fit_extended,
    prediction_errors,
    undo_moving_average,
)
from mrwarp.identify.fit import FitResult, fit, read_holding
from mrwarp.identify.fit_pictures import loops_picture, residual_picture
from mrwarp.identify.intervals import Estimate
from mrwarp.identify.replay import simulate
from mrwarp.model_file import HOLDING_NOTE, Effect, FittedOn, Model, Parameter, parameter_unit, save_model
from mrwarp.options.command_line import CommandLine
from mrwarp.options.data_options import Fit
from mrwarp.recording.load import (
    Recording,
    RecordingError,
    check_same_units,
    load_recording,
)
from mrwarp.run_dir import check_writable, versions, write_result


def run(options: Fit, line: CommandLine) -> int:
    """Identify a joint; 0 when its model is written, 2 on bad input (then nothing is written)."""
    started = time.perf_counter()

    def progress(text: str) -> None:
        print(f"[{time.perf_counter() - started:5.1f} s] {text}", flush=True)

    check_writable(options.out)
    progress(f"reading {options.data}")
    recording = _without(load_recording(options.data), options.exclude)
    unseen = load_recording(options.predict) if options.predict else None
    if unseen is not None:
        check_same_units(unseen, recording)
    holding = read_holding(options.data, recording, options.holding, progress)
    result = fit(
        recording,
        holding=holding,
        robust=options.robust,
        seed=options.seed,
        progress=lambda text: progress(f"eq. 14: {text}"),
    )
    extended = None
    if options.extended:
        extended = fit_extended(recording, seed=options.seed, progress=lambda text: progress(f"extended: {text}"))
    predicted = predictions(unseen, result, extended, options.averaged) if unseen else {}
    save_model(to_model(result, extended), options.out / "model.json")
    progress("pictures")
    loops_picture(recording, result, extended, options.out / "loops.png")
    residual_picture(recording, result, extended, options.out / "residual.png")
    content = figures(result, extended) | {"predicted": predicted}
    write_result(options.out, content, seed=options.seed, command=str(line))
    print(table(result, extended))
    if holding is None:
        print(f"\n{HOLDING_NOTE}")
    for name, errors in predicted.items():
        print(f"NRMSE of {name}: " + ", ".join(f"{key} {100 * value:.1f} %" for key, value in errors.items()))
    seconds = time.perf_counter() - started
    print(f"\nmodel.json, result.json, loops.png and residual.png in {options.out} ({seconds:.0f} s)")
    return 0


def _without(recording: Recording, pattern: str | None) -> Recording:
    """The recording without the trajectories whose name matches.

    Raises:
        RecordingError: nothing, or everything, matches.
    """
    if pattern is None:
        return recording
    kept = tuple(run for run in recording.trajectories if not fnmatch.fnmatch(run.id, pattern))
    if not 0 < len(kept) < len(recording.trajectories):
        names = ", ".join(run.id for run in recording.trajectories[:5])
        which = "no" if kept else "every"
        raise RecordingError(f"--exclude {pattern!r} matches {which} trajectory; they are named {names} ...")
    return dataclasses.replace(recording, trajectories=kept)


def to_model(result: FitResult, extended: ExtendedFit | None = None) -> Model:
    """What goes into ``model.json``: eqs. 14, 15 (18); an extended model only as an effect with its own full set."""
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
    effects = (extended_damper(extended, result.units),) if extended else ()
    return Model(
        parameters=estimates,
        fitted_on=origin,
        units=result.units,
        effects=effects,
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
    return Effect(
        name="extended_damper",
        parameters={
            name: Parameter(value=value, unit=unit.get(name) or parameter_unit(name, units), ci95=intervals.get(name))
            for name, value in extended.values.items()
        },
    )


def predictions(
    recording: Recording, result: FitResult, extended: ExtendedFit | None, window: float
) -> dict[str, dict[str, float]]:
    """RMSE over standard deviation of each unseen trajectory, per model and per reading of its motion.

    With ``window`` > 0 the simulated torque passes the moving average that the measured one passed, and both lose their
    mean; the motion is taken as published, and again with its own average undone.
    """
    motions = {"": recording} if window == 0.0 else {
        " (motion as published)": recording, " (average of the motion undone)": undo_moving_average(recording, window)
    }  # fmt: skip
    found = {}
    for name, motion in motions.items():
        found[f"eqs. 14, 15{name}"] = prediction_errors(motion, simulate(result.values, motion), window)
        if extended is not None:
            torque = extended_torque(extended.values, motion)
            found[f"extended model{name}"] = prediction_errors(motion, torque, window)
    return found


def figures(result: FitResult, extended: ExtendedFit | None = None) -> dict[str, Any]:
    """What goes into ``result.json``; an interval that the data do not give is null."""
    fitted = {
        "parameters": {name: _entry(e) for name, e in result.estimates.items()},
        "combinations": {name: _entry(e) for name, e in result.combinations.items()},
        "fixed": result.fixed,
        "units": result.units,
        "source": result.source,
        "trajectories": result.trajectories,
        "samples": result.samples,
        "rate": result.rate,
        "condition": min(result.condition, 1e300),
        "warnings": list(result.warnings),
        **_errors(result),
    }
    if extended is not None:
        parameters = {name: _entry(e) for name, e in extended.estimates.items()}
        fitted["extended"] = {
            "parameters": parameters, "current_full": extended.current_full, "warnings": list(extended.warnings),
            **_errors(extended),
        }  # fmt: skip
    return fitted


def table(result: FitResult, extended: ExtendedFit | None = None) -> str:
    """Parameters, combinations, errors per current and warnings as text."""
    rows = [f"\n{'parameter':44s} {'value':>13s}  95 % interval"]
    for name, e in [*result.estimates.items(), *result.combinations.items()]:
        unit = f" [{parameter_unit(name, result.units)}]" if name in result.estimates else ""
        rows.append(f"{name + unit:44s} {e.value:13.6g}  {_interval(e)}")
    if extended is not None:
        rows.append(f"\n{'extended model':44s} {'value':>13s}  95 % interval")
        rows += [f"{name:44s} {e.value:13.6g}  {_interval(e)}" for name, e in extended.estimates.items()]
    unit = result.units["torque"]
    rows.append(
        f"\n{'current [' + result.units['current'] + ']':14s} {'RMSE [' + unit + ']':>14s}"
        + "  extended" * bool(extended)
    )
    for key, value in result.rmse_per_current.items():
        more = f" {extended.rmse_per_current[key]:9.4g}" if extended else ""
        rows.append(f"{key:14s} {value:14.4g}{more}")
    more = f" {extended.rmse:9.4g}; NRMSE {100 * extended.nrmse:.2f} %" if extended else ""
    rows.append(f"{'all':14s} {result.rmse:14.4g}{more}   (eq. 14: NRMSE {100 * result.nrmse:.2f} %)")
    rows += [f"warning: {text}" for text in result.warnings]
    return "\n".join(rows)


def _errors(result: FitResult | ExtendedFit) -> dict[str, Any]:
    names = ("rmse", "nrmse", "rmse_per_current", "rmse_per_trajectory")
    return {name: getattr(result, name) for name in names}


def _entry(e: Estimate) -> dict[str, Any]:
    joint = [e.value - e.half_joint, e.value + e.half_joint] if math.isfinite(e.half_joint) else None
    return {"value": e.value, "ci95": list(e.ci95) if e.ci95 else None, "ci95_joint": joint}


def _interval(e: Estimate) -> str:
    return f"{e.ci95[0]:.6g} to {e.ci95[1]:.6g}" if e.ci95 else "none: not determined, or held at the edge of its range"
