"""Makes an entry of the library out of what ``mrwarp fit`` or ``mrwarp diagnose`` wrote, and the recording it read."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp import paper
from mrwarp.devices.entry import FILE, Device, stated_part
from mrwarp.model_file import FittedOn, Model, Parameter, load_model, save_model
from mrwarp.options.json_file import read_json_file
from mrwarp.params import MrParams
from mrwarp.recording.blocks import in_blocks
from mrwarp.recording.data import Recording, quantity
from mrwarp.recording.load import RecordingError
from mrwarp.run_dir import NOT_FINAL, is_not_final, plain, versions, write_text

PAPER = "paper"
"""Name of the paper's device, whose recordings are not public: its numbers are those that the paper states."""

SPEED = 99.0
"""Percentile of the speed that counts as the largest [%]: beyond it the speed is derived from a jump or a spike."""

_OF_THE_PAPER = (
    "q_offset",
    "q_center",
    "D",
    "B",
    "C",
    "I1",
    "K0",
    "K1",
    "alpha",
    "beta",
    "gamma",
    "z_max",
    "T_max",
    "K",
    "n",
    "current_max",
)
"""The paper's statements on its device: eqs. 14, 15 and 18. It gives neither the coil's resistance nor a mass."""

_OF_A_FIT = "each run, with a zero of its own, predicted by the fit to the others; the law was given, not searched"

_PAPER_RANGE = {"q": (-1.0, 1.0), "speed": 10.0, "current": (0.0, 1.5), "trajectories": 0, "seconds": 0.0}
"""Section 4.1: velocities up to about 10 rad/s, displacements up to about 1 rad, 0 to 1.5 A in steps of 0.5 A."""


def make_device(name: str, library: Path, results: Path, recording: Recording) -> Device:
    """Write the model and the measured part of an entry whose stated part is there.

    Args:
        name: Name of the device.
        library: Folder of the library.
        results: Folder that ``mrwarp fit`` or ``mrwarp diagnose`` filled.
        recording: What that read.

    Raises:
        JsonFileError: a file is missing or damaged; nothing is written.
        RecordingError: the recording is not the one of the results.
        ValueError: the results hold no model.
    """
    stated = _stated(name, library)
    remedy = "name the --out of 'mrwarp fit' or 'mrwarp diagnose'"
    result = read_json_file(results / "result.json", remedy)
    if not isinstance(result, dict) or not ("held_out_nrmse" in result or isinstance(result.get("extended"), dict)):
        raise ValueError(f"{results}: holds no error on unseen runs; {remedy}, with --law where it is fit")
    if is_not_final(result):
        raise ValueError(f"{results}: its result.json is {NOT_FINAL}; let 'mrwarp diagnose' come to its end")
    model = load_model(results / "model.json")
    runs = recording.trajectories
    read = result.get("data", result)
    counts = {len(runs), len(in_blocks(recording).trajectories)}  # long runs are fitted in blocks
    if read["trajectories"] not in counts or str(recording.source) != str(read["source"]):
        raise RecordingError(
            f"{recording.source}: has {len(runs)} runs, {results} was made of {read['trajectories']} of "
            f"{read['source']}; name that recording, from the same folder"
        )
    measured = {
        "commands": (result["command"], f"mrwarp device make {name} --data {recording.source} --results {results}"),
        "range": _range(recording),
        "held_out": _held_out(result),
        "predicted": _predicted(result),
        "unexplained": _unexplained(result),
        "faults": [fault["sentence"] for fault in result.get("recording_faults", ())],
        "versions": versions(),
    }
    return _write(Device(name=name, model=model, stated=stated, measured=plain(measured)), library)


def make_paper_device(library: Path) -> Device:
    """Write the entry of the paper's device from what :mod:`mrwarp.params` and :mod:`mrwarp.paper` hold of it."""
    params = MrParams()
    values = params.to_dict()
    model = Model(
        parameters={name: Parameter(value=values[name], unit=MrParams.spec(name).unit) for name in _OF_THE_PAPER},
        fitted_on=FittedOn(
            source="the paper, sections 2.2 and 4.2",
            trajectories=0,
            samples=0,
            rate=200.0,
            current=(0.0, params.coil.current_max),
        ),
        versions=versions(),
    )
    errors = [found.mean for found in paper.FIGURE_4["bouc_wen"].values()]
    per_current = ", ".join(f"{found.mean:g} at {amps:g} A" for amps, found in paper.FIGURE_4["bouc_wen"].items())
    measured = {
        "commands": (f"mrwarp device make {PAPER}",),
        "range": _PAPER_RANGE,
        "held_out": {
            "rmse": float(np.mean(errors)),
            "nrmse": None,
            "how": f"as the paper publishes it for ten unseen trajectories: {per_current} (section 6.1)",
        },
        "predicted": (),
        "unexplained": "the paper names a delay of the current, asymmetric friction, a bias of the sensor and what "
        "differs from run to run, without numbers (section 4.3). Its network takes "
        f"{100 * paper.FIGURE_4_REDUCTION['bouc_wen']:.0f} % off the error",
        "faults": (),
        "versions": versions(),
    }
    return _write(Device(name=PAPER, model=model, stated=_stated(PAPER, library), measured=plain(measured)), library)


def _stated(name: str, library: Path) -> dict[str, str]:
    path = library / name / FILE
    return stated_part(read_json_file(path, "write its part 'stated' first, see CONTRIBUTING.md"), path)


def _write(device: Device, library: Path) -> Device:
    save_model(device.model, library / device.name / "model.json")
    content = {"stated": dict(device.stated), "measured": dict(device.measured)}
    text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)
    write_text(library / device.name / FILE, text + "\n")
    return device


def _range(recording: Recording) -> dict[str, Any]:
    """Smallest and largest angle and control input, and how long it was recorded."""
    runs = recording.trajectories

    def ends(column: str) -> tuple[float, float]:
        values = [getattr(run, column) for run in runs]
        return min(float(v.min()) for v in values), max(float(v.max()) for v in values)

    return {
        "q": ends("q"),
        "speed": float(np.percentile(np.abs(np.concatenate([run.qd for run in runs])), SPEED)),
        "current": ends("current"),
        "trajectories": len(runs),
        "seconds": sum(float(run.t[-1] - run.t[0]) for run in runs),
    }


def _held_out(result: Mapping[str, Any]) -> dict[str, Any]:
    """RMSE and NRMSE on runs that took no part."""
    if "held_out_nrmse" not in result:
        return {**result["extended"], "how": "each run predicted by the model fitted to the others"}
    held = result["held_out_nrmse"]
    if held is None:
        raise ValueError("the recording has a single run: none is left to be predicted; record several")
    rmse = held * result["rmse"] / result["nrmse"]
    return {"rmse": rmse, "nrmse": held, "how": _OF_A_FIT}


def _predicted(result: Mapping[str, Any]) -> list[str]:
    """Errors on recordings that took no part at all, in words."""
    found = result.get("predicted") or {}
    if "mean" not in found:  # as fit writes it: by model and reading, then by run
        return [
            f"{model}: NRMSE of {', '.join(f'{run} {100 * error:.1f} %' for run, error in errors.items())}"
            for model, errors in found.items()
        ]
    return [
        f"{found['source']}{f' ({reading})' if reading else ''}: mean NRMSE of {mean['trajectories']} runs "
        f"{100 * mean['extended']:.1f} %, of the baseline {100 * mean['baseline']:.1f} %"
        for reading, mean in found["mean"].items()
    ]


def _unexplained(result: Mapping[str, Any]) -> str:
    """The model's unexplained error, in words."""
    if "held_out_nrmse" in result:
        what = quantity("torque", result["units"])
        return f"{100 * result['held_out_nrmse']:.1f} % of the {what}, of runs left out; causes were not searched"
    account, found = result["account"], result["unexplained"]
    shares = {name: f"{100 * account[name]['share']:.1f} %" for name in ("named", "repeatable", "not_repeatable")}
    parts = [
        f"of the squared error of {result['law']['title'] if result['law'] else 'eq. 14'} the named effects explain "
        f"{shares['named']}; {shares['repeatable']} repeats without a named cause, "
        f"{shares['not_repeatable']} does not repeat"
    ]
    if found:
        parts[-1] += f". What repeats follows {', '.join(found['depends_on'])} (form: {found['form']})"
    if suspects := [row["name"] for row in result["suspects"] if row.get("possible", True)]:
        parts.append(f"suspected, not proven: {', '.join(suspects)}")
    return "; ".join(parts)
