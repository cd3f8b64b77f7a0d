"""A diagnosis as ``result.json``: the keys that other programs rely on, then what the report shows besides."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.diagnose.result import Cause, Diagnosis, Gain, Shift
from mrwarp.run_dir import write_result


def to_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of ``result.json`` but for schema, seed, versions and command, which :func:`write` adds.

    Plain values only; an interval that the data do not give holds infinities, which are written as null.
    """
    d = diagnosis
    contract = {
        "verdict": d.verdict,
        "causes": [_cause(c) for c in d.causes],
        "parameter_shift": [_shift(s) for s in d.parameter_shift],
        "unexplained": dataclasses.asdict(d.unexplained) if d.unexplained else None,
        "detectable": {name: {"value": v.value, "unit": v.unit} for name, v in d.detectable.items()},
        "baseline": {"rmse": d.baseline.rmse, "nrmse": d.baseline.nrmse, "unit": d.baseline.unit},
        "extended": {"rmse": d.extended.rmse, "nrmse": d.extended.nrmse},
        "gain": _gain(d.gain),
        "next_experiment": dataclasses.asdict(d.next_experiment) if d.next_experiment else None,
        "seconds": d.seconds,
    }
    besides = {
        "sentence": d.sentence,
        "cannot_know": d.cannot_know,
        "invisible": d.invisible,
        "tried": [dataclasses.asdict(t) for t in d.tried],
        "accounting": dataclasses.asdict(d.accounting),
        "per_trajectory": _pairs(d.per_trajectory),
        "per_regime": _pairs(d.per_regime),
        "notes": d.notes,
        "noise_rms": d.traces.noise_rms if d.traces else None,
        "data": _data(d),
    }
    return plain({**contract, **besides})


def write(
    diagnosis: Diagnosis, out: Path, command: str, besides: Mapping[str, Any] | None = None, *, name: str = ""
) -> Path:
    """Write ``out/result.json`` in one piece.

    Args:
        diagnosis: What was found.
        out: Folder, made if it is not there.
        command: Command line that made it.
        besides: Further results, such as those of ``--predict``.
        name: File name of the extended model, if there is one.
    """
    figures = to_dict(diagnosis) | plain(dict(besides or {})) | {"model": name or None}
    return write_result(out, figures, seed=diagnosis.seed, command=command)


def plain(value: Any) -> Any:
    """The same as objects, lists, texts, numbers and null of JSON: no NumPy types, no tuples, no paths."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return str(value) if isinstance(value, Path) else value


def _cause(cause: Cause) -> dict[str, Any]:
    parameters = {k: {"value": v.value, "ci95": v.ci95, "unit": v.unit} for k, v in cause.parameters.items()}
    return {
        "name": cause.name,
        "parameters": parameters,
        "p_value": cause.p_value,
        "alternatives": cause.alternatives,
        "gain": cause.gain,
    }


def _shift(shift: Shift) -> dict[str, Any]:
    return {
        "name": shift.name,
        "value": shift.value,
        "ci95": shift.ci95,
        "alternatives": shift.alternatives,
        "unit": shift.unit,
    }


def _gain(gain: Gain | None) -> dict[str, Any]:
    """The gain; without one its numbers are null, so that a reader finds the same keys everywhere."""
    if gain is None:
        return {"rmse_reduction": None, "ci95": [None, None], "held_out": [], "per_regime": {}}
    return {
        "rmse_reduction": gain.rmse_reduction,
        "ci95": gain.ci95,
        "held_out": gain.held_out,
        "per_regime": _pairs(gain.per_regime),
    }


def _pairs(rows: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    return {name: {"baseline": before, "extended": after} for name, (before, after) in rows.items()}


def _data(d: Diagnosis) -> dict[str, Any]:
    runs = d.recording.trajectories
    return {
        "source": d.recording.source,
        "units": d.recording.units,
        "trajectories": len(runs),
        "samples": d.recording.samples,
        "seconds": sum(float(run.t[-1] - run.t[0]) for run in runs),
        "rates": sorted({round(1.0 / run.dt, 3) for run in runs}),
        "velocity_derived": any(run.qd_derived for run in runs),
    }
