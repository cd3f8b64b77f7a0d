"""Content of a recording as text, and notes for a user on one that is not wrong."""

from __future__ import annotations

import json

import numpy as np

from mrwarp.recording.angle import without_wrong_readings
from mrwarp.recording.column_checks import TURNS, turns
from mrwarp.recording.data import NO_INPUT, Trajectory, few_levels, quantity, with_unit
from mrwarp.recording.differentiate import HALF_WIDTH, frequency_response, half_samples
from mrwarp.recording.load import Recording
from mrwarp.sysid.settings import Spikes


def describe(recording: Recording, verdict: str = "good") -> list[str]:
    """Sizes, rates, ranges with units, and the header; the ``verdict`` stands in the first line."""
    runs, units = recording.trajectories, recording.units
    lengths = [len(run.t) for run in runs]
    rates = ", ".join(f"{rate:g}" for rate in sorted({float(f"{1.0 / run.dt:.4g}") for run in runs}))
    seconds = sum(len(run.t) * run.dt for run in runs)
    lines = [
        f"{recording.source}: {verdict}",
        f"trajectories  {len(runs)} of {min(lengths)} to {max(lengths)} samples",
        f"samples       {recording.samples} at {rates} Hz, {seconds:.4g} s",
    ]
    shown = {**units, "qd": f"{units['q']}/s", "temperature": "degC"}
    more = {"qd": _velocity(recording), "current": _levels(recording)}
    for key in ("q", "qd", "current", "torque", "temperature"):
        if shown.get(key) == NO_INPUT:
            lines.append(f"{key:13s} none: a device without a control input")
            continue
        columns = [column for run in runs if (column := getattr(run, key)) is not None]
        if columns:
            low, high = (float(end(list(map(end, columns)))) for end in (np.min, np.max))
            known = f" in {len(columns)} trajectories" if key == "temperature" else more.get(key, "")
            lines.append(f"{key:13s} {with_unit(f'{low:.4g} to {high:.4g}', shown[key])}{known}")
    for key, value in recording.header.items():
        text = json.dumps(value, ensure_ascii=False)
        lines.append(f"{key:13s} {text if len(text) <= 100 else text[:97] + '...'}")
    return lines


def _velocity(recording: Recording) -> str:
    """How a velocity that was not measured was made."""
    derived = [run for run in recording.trajectories if run.qd_derived]
    if not derived:
        return ""
    run = max(derived, key=_half_width)
    half = run.qd_half or half_samples(len(run.t), run.dt)
    f = np.linspace(0.0, 0.5 / run.dt, 2000)
    cut = f[int(np.argmax(frequency_response(f, run.dt, half) < np.sqrt(0.5)))]
    widest = len(derived) > 1 and len({run.qd_half for run in derived}) > 1
    return (
        f", derived from q in {len(derived)} of {len(recording.trajectories)} trajectories: zero phase, cubic over "
        f"{'up to ' if widest else ''}{2 * half + 1} samples, half the power at {cut:.3g} Hz"
    )


def _half_width(run: Trajectory) -> float:
    """Half of the window that a derived velocity was made with [s]."""
    return HALF_WIDTH if run.qd_half is None else max(HALF_WIDTH, run.qd_half * run.dt)


def _levels(recording: Recording) -> str:
    currents = [run.current for run in recording.trajectories]
    levels = np.unique(np.concatenate(currents))
    steps = sum(int(np.count_nonzero(np.diff(current))) for current in currents)
    named = ", ".join(f"{x:g}" for x in levels) if len(levels) <= 12 else f"{len(levels)} different"
    name, named = quantity("current", recording.units), with_unit(named, recording.units["current"])
    known = f" ({name})" if name != "current" else ""
    return f"{known}; levels {named}; {steps} changes within trajectories"


def notes(recording: Recording, parts: int = 1) -> list[str]:
    """Notes for a user on a recording that is not wrong; ``parts`` is how many runs or blocks are judged."""
    runs, found = recording.trajectories, recording.repaired(40)
    against = [run.id for run in runs if float(np.mean(run.torque * run.qd)) < 0.0]
    if len(against) > len(runs) / 2:
        found.append(
            f"torque times velocity is negative in {len(against)} of {len(runs)} trajectories: torque must be positive "
            "against positive velocity (eq. 14); if the sensor counts the other way, flip its sign"
        )
    if recording.units["q"] == "rad" and (round_ := max(map(turns, runs))) > TURNS:
        undeclared = "" if "q" in recording.declared else "; declare the unit of q if it is not rad"
        found.append(f"up to {round_:.0f} turns in one direction: taken as a shaft that goes round{undeclared}")
    spikes = [len(without_wrong_readings(run.torque, most=Spikes.most)[1]) for run in runs]
    if any(spikes):
        torque, worst = quantity("torque", recording.units), runs[int(np.argmax(spikes))].id
        found.append(
            f"{sum(spikes)} single readings of the {torque} go far off and come back at once, most of them in "
            f"{worst!r}: diagnose leaves such spikes out, fit weighs them down with --robust"
        )
    if all(few_levels(run.torque) for run in runs):
        found.append(
            f"the {quantity('torque', recording.units)} has few levels, as a command has, and no sensor: where it was "
            "commanded and not measured, what a drive does to it is not in these data"
        )
    name = quantity("current", recording.units)
    if recording.units["current"] == NO_INPUT:
        pass  # there is none to be changed
    elif all(np.ptp(run.current) == 0.0 for run in runs):
        found.append(f"the {name} is constant in every trajectory: a lag or delay of what it acts on cannot be seen")
    elif len({float(run.current.max()) for run in runs}) == 1:
        found.append(f"all trajectories reach the same {name}: terms that depend on it rest on its changes only")
    still = [run.id for run in runs if float(np.ptp(run.q)) == 0.0]
    if still:
        found.append(f"no motion in {len(still)} trajectories, e.g. {still[0]!r}")
    if max(len(runs), parts) == 1:
        found.append("one trajectory: nothing is left to test a model on; record several")
    derived = [run for run in runs if run.qd_derived]
    if derived:
        width = max(map(_half_width, derived))
        found.append(
            f"velocity was differentiated; reversals faster than {1e3 * width:.3g} ms are smoothed"
            + (" (so long because the motion is slow against its noise)" if width > 2.0 * HALF_WIDTH else "")
        )
    return found
