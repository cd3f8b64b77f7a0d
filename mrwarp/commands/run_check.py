"""``mrwarp check DATA``: say what a recording holds, or what is wrong with it. Writes nothing."""

from __future__ import annotations

import json

import numpy as np

from mrwarp.options.command_line import CommandLine
from mrwarp.options.data_options import Check
from mrwarp.recording.differentiate import HALF_WIDTH, frequency_response, half_samples
from mrwarp.recording.load import (
    Recording,
    Trajectory,
    derivative_ratio,
    find_holding,
    load_holding,
    load_recording,
)


def run(options: Check, line: CommandLine) -> int:
    """Explain a recording; a :class:`RecordingError` says what is wrong with it."""
    recording = load_recording(options.data)
    beside = find_holding(options.data)
    holding = load_holding(beside, recording) if beside else None
    print(describe(recording))
    if holding is not None:
        amps = np.unique(holding.current)
        unit = recording.units["torque"]
        print(
            f"break-away    {len(holding.current)} tests at {len(amps)} currents, up to {holding.torque.max():.4g} "
            f"{unit} ({beside})"
        )
    for note in notes(recording):
        print(f"note: {note}")
    return 0


def describe(recording: Recording) -> str:
    """What a recording holds, as text."""
    runs, units = recording.trajectories, recording.units
    dts = sorted({float(f"{run.dt:.4g}") for run in runs})
    rates = ", ".join(f"{1.0 / dt:.4g}" for dt in reversed(dts))
    seconds = sum(len(run.t) * run.dt for run in runs)
    shortest, longest = min(len(run.t) for run in runs), max(len(run.t) for run in runs)
    lines = [
        f"{recording.source}: good",
        f"trajectories  {len(runs)} of {shortest} to {longest} samples",
        f"samples       {recording.samples} at {rates} Hz, {seconds:.4g} s",
    ]
    for key in ("q", "qd", "current", "torque"):
        unit = f"{units['q']}/s" if key == "qd" else units[key]
        low = min(float(getattr(run, key).min()) for run in runs)
        high = max(float(getattr(run, key).max()) for run in runs)
        lines.append(f"{key:13s} {low:.4g} to {high:.4g} {unit}{_detail(key, runs, units)}")
    warm = [run.temperature for run in runs if run.temperature is not None]
    if warm:
        low, high = min(float(x.min()) for x in warm), max(float(x.max()) for x in warm)
        lines.append(f"temperature   {low:.4g} to {high:.4g} degC in {len(warm)} trajectories")
    for key, value in recording.header.items():
        text = json.dumps(value, ensure_ascii=False)
        lines.append(f"{key:13s} {text if len(text) <= 100 else text[:97] + '...'}")
    return "\n".join(lines)


def _detail(key: str, runs: tuple[Trajectory, ...], units: dict[str, str]) -> str:
    """What else there is to say about a column."""
    if key == "qd" and any(run.qd_derived for run in runs):
        run = next(run for run in runs if run.qd_derived)
        f = np.linspace(0.0, 0.5 / run.dt, 2000)
        gain = frequency_response(f, run.dt)
        cut = f[int(np.argmax(gain < np.sqrt(0.5)))]
        count, m = sum(run.qd_derived for run in runs), half_samples(len(run.t), run.dt)
        return (
            f", derived from q in {count} of {len(runs)} trajectories: zero phase, cubic over {2 * m + 1} samples, "
            f"half the power at {cut:.3g} Hz"
        )
    if key == "current":
        levels = np.unique(np.concatenate([np.unique(run.current) for run in runs]))
        steps = sum(int(np.count_nonzero(np.diff(run.current))) for run in runs)
        named = ", ".join(f"{x:g}" for x in levels) if len(levels) <= 12 else f"{len(levels)} different"
        return f"; levels {named} {units['current']}; {steps} changes within trajectories"
    return ""


def notes(recording: Recording) -> list[str]:
    """What a user should know before using a recording that is not wrong."""
    runs, found = recording.trajectories, []
    against = [run.id for run in runs if float(np.mean(run.torque * run.qd)) < 0.0]
    if len(against) > len(runs) / 2:
        found.append(
            f"torque times velocity is negative in {len(against)} of {len(runs)} trajectories: torque must be positive "
            "against positive velocity (eq. 14); if the sensor counts the other way, flip its sign"
        )
    odd = [run.id for run in runs if not run.qd_derived and not 0.7 < derivative_ratio(run) < 1.4]
    if odd:
        found.append(
            f"qd is not the derivative of q in {len(odd)} trajectories, e.g. {odd[0]!r}; if qd is not to be trusted, "
            "leave its column out and it is derived from q"
        )
    if all(np.ptp(run.current) == 0.0 for run in runs):
        found.append("the current is constant in every trajectory: a lag or delay of the coil cannot be seen")
    if len({float(run.current.max()) for run in runs}) == 1:
        found.append("all trajectories reach the same current: current-dependent terms rest on its changes only")
    still = [run.id for run in runs if float(np.ptp(run.q)) == 0.0]
    if still:
        found.append(f"no motion in {len(still)} trajectories, e.g. {still[0]!r}")
    if len(runs) == 1:
        found.append("one trajectory: nothing is left to test a model on; record several")
    if any(run.qd_derived for run in runs):
        found.append(f"derived velocities blunt reversals shorter than {1e3 * HALF_WIDTH:g} ms")
    return found
