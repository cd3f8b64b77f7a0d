"""The picture of an entry: torque over angle and velocity, of the model and, where its licence allows, measured."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from mrwarp.devices.entry import Device
from mrwarp.identify.law_fit import model_torque
from mrwarp.model_file import JOINT_UNITS
from mrwarp.recording.data import Recording, Trajectory, quantity, with_unit
from mrwarp.run_dir import write_bytes

PERMISSIVE = ("MIT", "BSD-3-Clause", "Apache-2.0", "CC0-1.0")
"""Licences under which measured curves are drawn; a copyleft licence would pass to the picture."""

_CURVES = 3
"""Most runs in a picture: the lowest, middle and highest control input."""
_MOST = 1500
"""Most samples of a run that are drawn."""
_COLOURS = 32
"""Colours of the file: lines on white need few, and it stays below 40 kB."""


def paper_motion(device: Device) -> Recording:
    """Sines of 1 Hz at 0, half and all of the current, for a device without a public recording."""
    dt, top = 0.005, device.measured["range"]["current"][1]
    t = dt * np.arange(400)
    q, qd = 0.4 * np.sin(2.0 * np.pi * t), 0.8 * np.pi * np.cos(2.0 * np.pi * t)
    runs = [
        Trajectory(id=f"{amps:g} A", t=t, q=q, qd=qd, current=np.full_like(t, amps), torque=np.zeros_like(t))
        for amps in (0.0, 0.5 * top, top)
    ]
    return Recording(trajectories=tuple(runs), units=dict(JOINT_UNITS))


def loop_picture(device: Device, recording: Recording, path: Path, *, measured: bool) -> Path:
    """Draw and write the picture.

    Args:
        device: The entry.
        recording: Motion to draw.
        path: PNG file to write.
        measured: Whether the recording's torque was measured and may be shown.
    """
    units = device.model.units
    runs = _chosen(recording)
    shown = Recording(trajectories=tuple(runs), units=dict(units), source=recording.source)
    figure = Figure(figsize=(7.0, 2.9), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    measured = measured and device.stated["licence"] in PERMISSIVE
    for k, (run, torque) in enumerate(zip(runs, model_torque(device.model, shown), strict=True)):
        part, middle = _window(run), float(np.median(run.current))
        label = with_unit(f"{middle:.3g}", units["current"]) if np.ptp(run.current) < 0.1 * abs(middle) else run.id
        for ax, x in zip(axes, (run.q, run.qd), strict=True):
            if measured:
                ax.plot(x[part], run.torque[part], color="0.72", lw=2.4)
            ax.plot(x[part], torque[part], color=f"C{k}", lw=0.9, label=label)
    axes[0].set_ylabel(f"{quantity('torque', units)} [{units['torque']}]")
    axes[0].set_xlabel(f"{quantity('q', units)} [{units['q']}]")
    axes[1].set_xlabel(f"velocity [{units['q']}/s]")
    for ax in axes:
        ax.grid(alpha=0.3)
    handles, labels = axes[0].get_legend_handles_labels()
    title = f"{device.name}: model{', measured in grey' if measured else ''}"
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), fontsize=8, title=title)
    drawn, small = BytesIO(), BytesIO()
    figure.savefig(drawn, dpi=80, format="png")
    Image.open(drawn).convert("RGB").quantize(_COLOURS).save(small, format="png", optimize=True)
    return write_bytes(path, small.getvalue())


def _chosen(recording: Recording) -> list[Trajectory]:
    """Runs at the lowest, middle and highest control input, of each the one that moves most."""
    levels: dict[float, Trajectory] = {}
    for run in recording.trajectories:
        level = round(float(np.median(np.abs(run.current))), 1)
        if level not in levels or run.qd.std() > levels[level].qd.std():
            levels[level] = run
    order = sorted(levels)
    return [levels[order[k]] for k in sorted({0, len(order) // 2, len(order) - 1})][:_CURVES]


def _window(run: Trajectory) -> slice:
    """The middle of a run, of a whole motion there and back where it has one that is short enough."""
    above = run.q > 0.5 * (run.q.min() + run.q.max())
    up = np.flatnonzero(above[1:] & ~above[:-1])
    starts = up[np.insert(np.diff(up) > 10, 0, True)] if len(up) else up  # noise crosses the middle several times
    for k in range(len(starts) // 2, len(starts) - 1):
        if starts[k + 1] - starts[k] <= _MOST:
            return slice(int(starts[k]), int(starts[k + 1]) + 1)
    start = max((len(run.q) - _MOST) // 2, 0)
    return slice(start, start + _MOST)
