"""Figure 6(b): calf motor torque of the simulated push while the device damps, with and without current."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from mrwarp import paper
from mrwarp.reproduce import pushes
from mrwarp.reproduce.experiment import Findings, Job, compare, over_seeds, seeds_of
from mrwarp.usd.robot import LEGS

TORQUE = ("calf motor torque", "N·m", 2)
"""Quantity, unit and digits."""

LAST = -1
"""Place of the largest current, 1.5 A; the first is 0 A."""


def compute(job: Job) -> Findings:
    """Mean and peak over the samples in which the damping gate is open at 1.5 A, and the paired change."""
    found = pushes.read(job)
    torque, gate = np.abs(found.trace["tau_motor"]), found.trace["m_dyn"][LAST] > 0.0
    rows, lower = [], []
    pairs = {leg: same_load(leg, pushes.ADOPTED.phases) for leg in paper.FIGURE_6_PUSH}
    for leg, theirs in paper.FIGURE_6_PUSH.items():
        k, name = LEGS.index(pairs[leg]), leg if pairs[leg] == leg else f"{pairs[leg]} for the paper's {leg}"
        on, off = (_over(torque[place, :, :, k], gate[:, :, k]) for place in (LAST, 0))
        damped = ~np.isnan(on["mean"])
        seeds = seeds_of(np.flatnonzero(damped), found.policies)
        for kind in ("mean", "peak"):
            with_current, without = on[kind][damped], off[kind][damped]
            change = with_current / without - 1.0
            lower.append(float(change.mean()) < 0.0)
            reference = float(without.mean()) if len(without) else float("nan")
            why = (
                f"Without current ours is {reference:.1f} N·m, the paper's "
                f"{theirs[kind] / (1.0 + theirs[f'{kind}_change']):.1f} N·m; its gains are not stated."
            )
            taken = "The device takes over what its sliding torque can carry, see the readings of table 4."
            change_theirs, changes = 100.0 * theirs[f"{kind}_change"], over_seeds(100.0 * change, seeds)
            rows += [
                compare(f"{name}, {kind}, 1.5 A", TORQUE, theirs[kind], over_seeds(with_current, seeds), why),
                compare(f"{name}, {kind}, 0 to 1.5 A", ("change", "%", 1), change_theirs, changes, taken),
            ]
    _plot(found.trace, job)
    return Findings(
        rows=rows, claims={"current lowers the motor's torque on the loaded pair": all(lower)},
        notes=[f"Push of table 4, reading: {pushes.ADOPTED.name}.", *_mirrored(pairs),
               *pushes.fallen(found.trace["fell"], "pushes")],
        pictures={"torque.png": "Calf motor torque of the first trial at 0 and 1.5 A; damping gate open where shaded"},
    )  # fmt: skip


def same_load(leg: str, phases: tuple[float, float] | None) -> str:
    """The leg that is loaded here where ``leg`` of the paper's pair is: the one that stands at the same end.

    Args:
        leg: Of :data:`mrwarp.usd.robot.LEGS`.
        phases: Gait phases at onset; None is any, and every leg stands for itself.
    """
    return next((stands for stands in pushes.stance_legs(phases) if stands[0] == leg[0]), leg)


def _mirrored(pairs: Mapping[str, str]) -> list[str]:
    if all(leg == ours for leg, ours in pairs.items()):
        return []
    theirs, ours = " and ".join(pairs), " and ".join(pairs.values())
    return [
        f"This push meets the robot while {ours} stand, the paper's while {theirs} do: the mirrored legs are compared."
    ]


def _over(torque: np.ndarray, gate: np.ndarray) -> dict[str, np.ndarray]:
    """Mean and peak per trial over the samples in which the gate is open; NaN where it never is. Shapes (N, T)."""
    open_ = gate.any(axis=1)
    masked = np.where(gate, torque, np.nan)
    blank = np.full(len(gate), np.nan)
    found = {"mean": blank.copy(), "peak": blank.copy()}
    found["mean"][open_] = np.nanmean(masked[open_], axis=1)
    found["peak"][open_] = np.nanmax(masked[open_], axis=1)
    return found


def _plot(trace: dict[str, np.ndarray], job: Job) -> None:
    figure = Figure(figsize=(11, 5.2), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    for k, (leg, axis) in enumerate(zip(LEGS, axes.flat, strict=True)):
        axis.plot(trace["t"], trace["tau_motor"][0, 0, :, k], color="0.5", label="0 A")
        axis.plot(trace["t"], trace["tau_motor"][LAST, 0, :, k], color="#1f6fb4", label="1.5 A")
        axis.fill_between(trace["t"], 0, 1, where=trace["m_dyn"][LAST, 0, :, k] > 0.0, color="#e08a1e", alpha=0.2,
                          linewidth=0, transform=axis.get_xaxis_transform())  # fmt: skip
        axis.set_title(f"{leg} calf", fontsize=9)
        axis.grid(alpha=0.3)
    for axis in axes[1]:
        axis.set_xlabel("time after the push began [s]")
    for axis in axes[:, 0]:
        axis.set_ylabel("motor torque [N·m]")
    axes[0, 0].legend(fontsize=8)
    figure.savefig(job.out / "torque.png", dpi=110)
