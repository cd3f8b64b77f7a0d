"""Pictures of a fit: loops per current and the histogram of what is left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mrwarp.effects.catalogue import KNOWN
from mrwarp.identify.damper import ExtendedFit
from mrwarp.identify.fit import FitResult
from mrwarp.recording.data import quantity
from mrwarp.recording.load import Recording
from mrwarp.sysid.settings import Gain


def loops_picture(recording: Recording, result: FitResult, extended: ExtendedFit | None, path: Path) -> None:
    """Measured against simulated torque over angle (or displacement) and velocity, one column per current."""
    groups: dict[str, int] = {}
    for k, run in enumerate(recording.trajectories):
        constant = np.ptp(run.current) <= Gain.share * max(1e-9, abs(run.current).max())
        key = f"{run.current[0]:.3g} {recording.units['current']}" if constant else "varying current"
        best = groups.get(key)
        if best is None or run.qd.std() > recording.trajectories[best].qd.std():
            groups[key] = k
    chosen = sorted(groups.items())[:6]
    figure = Figure(figsize=(3.6 * len(chosen), 6.4), layout="constrained")
    axes = figure.subplots(2, len(chosen), squeeze=False)
    for column, (key, k) in enumerate(chosen):
        run = recording.trajectories[k]
        unit = recording.units["q"]
        way = quantity("q", recording.units)
        for row, (x, label) in enumerate(((run.q, f"{way} [{unit}]"), (run.qd, f"velocity [{unit}/s]"))):
            ax = axes[row, column]
            ax.plot(x, run.torque, color="0.6", lw=0.8, label="measured")
            ax.plot(x, result.simulated[k], color="tab:red", lw=0.8, label=_title(result))
            if extended is not None:
                ax.plot(x, extended.simulated[k], color="tab:blue", lw=0.8, label="extended")
            ax.set_xlabel(label)
            ax.grid(alpha=0.3)
        axes[0, column].set_title(f"{key}: {run.id}", fontsize=9)
    for ax in axes[:, 0]:
        ax.set_ylabel(f"{quantity('torque', recording.units)} [{recording.units['torque']}]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), fontsize=8)
    figure.savefig(path, dpi=110)


def _title(result: FitResult) -> str:
    return KNOWN[result.effects[0].name].title if result.effects else "eqs. 14, 15"


def residual_picture(recording: Recording, result: FitResult, extended: ExtendedFit | None, path: Path) -> None:
    """Histogram of simulated minus measured torque."""
    figure = Figure(figsize=(6, 3.6), layout="constrained")
    ax = figure.subplots()
    sets = [(_title(result), result.simulated, "tab:red")]
    if extended is not None:
        sets.append(("extended", extended.simulated, "tab:blue"))
    for label, simulated, color in sets:
        error = np.concatenate([s - run.torque for s, run in zip(simulated, recording.trajectories, strict=True)])
        text = f"{label}: RMSE {np.sqrt(np.mean(error**2)):.3g} {recording.units['torque']}"
        ax.hist(error, bins=120, histtype="step", color=color, label=text)
    ax.set_yscale("log")
    ax.set_xlabel(f"simulated less measured torque [{recording.units['torque']}]")
    ax.set_ylabel("number of samples")
    ax.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=len(sets), fontsize=8)
    figure.savefig(path, dpi=110)
