"""Sensitivity of the impact trials to the gates' thresholds (paper section 3.2), as one batched run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mrwarp import paper
from mrwarp.trials.impact import MOTOR_WINDOW, ImpactTrace, Variant
from mrwarp.trials.statistics import spread

VALUES: dict[str, tuple[float, ...]] = {
    "f_th": (3.0, 5.0, 7.0, 13.0),
    "eps_e": (0.01, 0.03, 0.05, 0.07, 0.09),
    "eps_v": (0.10, 0.15, 0.20, 0.25, 0.30),
}
"""Values of each threshold [N, rad, rad/s], paper section 3.2; one is varied at a time."""


def variants(current: float) -> tuple[Variant, ...]:
    """The reference without current, then every threshold value with it."""
    rows = [Variant(current=current, params={name: v}) for name, values in VALUES.items() for v in values]
    return (Variant(current=0.0), *rows)


def reductions(trace: ImpactTrace) -> dict[str, list[dict[str, Any]]]:
    """Reduction of CoM drop and of mean motor torque against no current, in percent over the paired trials.

    Args:
        trace: Trace of a sweep over :func:`variants`.

    Returns:
        Per threshold a list of rows with ``value``, ``drop`` and ``motor`` (mean and SD over trials).
    """
    drop = trace.height[:, :, 0] - trace.height.min(axis=2)
    early = trace.t <= MOTOR_WINDOW
    motor = np.abs(trace.tau_motor[:, :, early]).mean(axis=(2, 3))
    result: dict[str, list[dict[str, Any]]] = {}
    i = 1
    for name, values in VALUES.items():
        result[name] = []
        for value in values:
            result[name].append(
                {
                    "value": value,
                    "drop": spread(100.0 * (drop[0] - drop[i]) / drop[0].mean()),
                    "motor": spread(100.0 * (motor[0] - motor[i]) / motor[0].mean()),
                }
            )
            i += 1
    return result


def plot(rows: dict[str, list[dict[str, Any]]], path: Path) -> None:
    """Draw both reductions over each threshold, beside the paper's ranges."""
    labels = {"f_th": "f_th [N]", "eps_e": "eps_e [rad]", "eps_v": "eps_v [rad/s]"}
    titles = {"drop": "reduction of CoM drop [%]", "motor": "reduction of mean calf motor torque [%]"}
    figure = Figure(figsize=(11, 6), layout="constrained")
    axes = figure.subplots(2, 3, sharex="col")
    for column, (name, entries) in enumerate(rows.items()):
        x = [entry["value"] for entry in entries]
        for row, quantity in enumerate(("drop", "motor")):
            axis = axes[row, column]
            axis.errorbar(
                x, [e[quantity]["mean"] for e in entries], [e[quantity]["sd"] for e in entries],
                marker="o", color="#1f6fb4", capsize=3, label="ours: mean, SD over trials",
            )  # fmt: skip
            if quantity in paper.THRESHOLDS[name]:
                ends = paper.THRESHOLDS[name][quantity]
                axis.plot([x[0], x[-1]], ends, "s--", color="#b4451f", label="paper: ends of range")
            axis.grid(alpha=0.3)
            axis.axhline(0.0, color="0.6", linewidth=0.8)
            if column == 0:
                axis.set_ylabel(titles[quantity])
        axes[1, column].set_xlabel(labels[name])
    axes[0, 0].legend(fontsize=8)
    figure.savefig(path, dpi=110)
