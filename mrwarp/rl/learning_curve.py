"""Picture of a training run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from mrwarp.trials.walking import WalkingGate


def plot(rows: list[dict[str, float]], gate_rows: list[dict[str, Any]], path: Path) -> None:
    """Draw tracking error, reward, falls and clock match over wall time, with the gate checks.

    Args:
        rows: Progress figures per update, as the trainer keeps them.
        gate_rows: Gate checks.
        path: PNG to write.
    """
    gate = WalkingGate()
    figure = Figure(figsize=(10, 6), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    minutes = [row["seconds"] / 60.0 for row in rows]
    panels = {
        "v_x_rmse": ("v_x RMSE while exploring [m/s]", axes[0, 0]),
        "reward": ("reward per second", axes[0, 1]),
        "falls_per_hour": ("falls per robot hour", axes[1, 0]),
        "clock_match": ("contact matches the clock [1]", axes[1, 1]),
    }
    for name, (label, axis) in panels.items():
        axis.plot(minutes, [row[name] for row in rows], color="#1f6fb4", linewidth=1.2)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    checks = [(row["seconds"] / 60.0, row["v_x_rmse"][f"{gate.rmse_at:g}"], row["passed"]) for row in gate_rows]
    first = axes[0, 0]
    first.axhline(gate.rmse, color="#b4451f", linestyle="--", linewidth=1, label=f"gate {gate.rmse} m/s")
    first.axhline(gate.rmse_aim, color="#3a8f3a", linestyle=":", linewidth=1, label=f"aim {gate.rmse_aim} m/s")
    for minute, rmse, passed in checks:
        first.plot(minute, rmse, marker="o", color="#3a8f3a" if passed else "#b4451f")
    first.set_ylim(0.0, 0.6)
    first.legend()
    axes[1, 0].set_yscale("symlog", linthresh=1.0)
    axes[1, 1].set_ylim(0.4, 1.0)
    for axis in axes[1]:
        axis.set_xlabel("wall time [min]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
