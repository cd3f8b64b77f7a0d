"""Pictures of the costs: against the number of robots, and part by part."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  after the backend is chosen

from benchmarks.perf.measure import PARTS  # noqa: E402

LINES = {
    "plain.plain": "plain mujoco.batch, same states",
    "pd.robot": "plain motors",
    "bouc_wen.robot": "Bouc-Wen, gates, hold",
    "lstm.robot": "with the LSTM residual",
    "bouc_wen.env": "whole environment step",
    "mjwarp_eager.robot": "MuJoCo-Warp, eager",
    "mjwarp_captured.robot": "MuJoCo-Warp, captured",
}
"""Labels of the drawn parts, by the name of their times."""

PHYSICS_STEPS = 4
"""Physics steps in a policy step."""


def cost_picture(walking: dict[str, Any], path: Path) -> None:
    """Microseconds per robot and physics step against the number of robots, with quartiles."""
    figure, axes = plt.subplots(figsize=(7.5, 4.8), layout="constrained")
    for part, label in LINES.items():
        counts = [int(count) for count, found in walking.items() if part in found["seconds"]]
        rows = [walking[str(count)]["seconds"][part] for count in counts]
        if counts:
            scale = [1e6 / (PHYSICS_STEPS * count) for count in counts]
            middle = [row["median"] * s for row, s in zip(rows, scale, strict=True)]
            axes.plot(counts, middle, "o-", label=label, markersize=4)
            low = [row["low"] * s for row, s in zip(rows, scale, strict=True)]
            axes.fill_between(counts, low, [row["high"] * s for row, s in zip(rows, scale, strict=True)], alpha=0.15)
    axes.set(xscale="log", yscale="log", xlabel="robots", ylabel="time per robot and physics step [µs]")
    axes.set_xticks([int(count) for count in walking], [str(count) for count in walking])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def breakdown_picture(walking: dict[str, Any], path: Path) -> None:
    """Stacked parts of a policy step, per robot and physics step, for 64 and 256 robots or what there is."""
    counts = [count for count in walking if count in ("64", "256")] or list(walking)[-1:]
    figure, panels = plt.subplots(
        1, len(counts), figsize=(4.2 * len(counts) + 1, 4.4), layout="constrained", squeeze=False
    )
    for axes, count in zip(panels[0], counts, strict=True):
        found = walking[count]["breakdown"]
        scale = 1e6 / (PHYSICS_STEPS * int(count))
        bottom = [0.0] * len(found)
        for part, label in PARTS.items():
            heights = [max(found[name][part], 0.0) * scale for name in found]
            axes.bar(list(found), heights, bottom=bottom, label=label)
            bottom = [b + h for b, h in zip(bottom, heights, strict=True)]
        axes.set(title=f"{count} robots", ylabel="time per robot and physics step [µs]")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside lower center", ncols=2, fontsize=8)
    figure.savefig(path, dpi=120)
    plt.close(figure)
