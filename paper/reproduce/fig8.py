"""Figure 8: what the front-right calf's motor carries with SAL, and where the torques that are left come from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrwarp import paper
from mrwarp.runtime import drawing
from mrwarp.trials import power_meter, walk_figures, walk_pictures
from mrwarp.trials.walk_trials import WalkResult
from mrwarp.usd.robot import JOINTS
from paper.reproduce import walks
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import Findings, TextTable, identified
from paper.reproduce.verdicts import Claim
from paper.reproduce.walks import Walks

PAIR = ("go1", "mr_go_sal")
"""The robots that figure 8 compares."""

SHOWN = tuple(JOINTS[joint] for joint in power_meter.SHOWN)
"""Joints of the front-right leg."""

SIMILAR = 0.15
"""Largest relative difference of means that counts as broadly similar."""


def fig8(job: Job) -> Findings:
    """Both pictures, and whether the torques of the front-right leg shift as the paper says; it gives no numbers."""
    walked = walks.read(job)
    with drawing("holding.png"):
        walk_pictures.holding(walked.both, job.out / "holding.png")
    with drawing("torques.png"):
        walk_pictures.distributions(walked.both, job.out / "torques.png")
    whole = walks.complete([r for r in walked.both if r.robot in PAIR])
    torque = {(r.robot, *r.cell): walk_figures.torques(r) for r in walked.both if len(r.speed)}
    cells = list(dict.fromkeys(r.cell for r in walked.both))

    def shown(robot: str, cell: tuple[float, float], joint: str, name: str) -> str:
        return f"{torque[robot, *cell][joint][name]:.1f}" if (robot, *cell) in torque else "none arrived"

    def ratios(joint: str, name: str) -> list[float]:
        return [torque["mr_go_sal", *cell][joint][name] / torque["go1", *cell][joint][name] for cell in cells]

    rows = [
        [paper.condition_name(*cell), joint, *(shown(r, cell, joint, name) for name in ("mean", "p95") for r in PAIR)]
        for cell in cells
        for joint in SHOWN
    ]
    tail, why = _tail(walked.both)
    title = f"|motor torque| [N·m], {paper.NAMES['go1']} and {paper.NAMES['mr_go_sal']}; to 0.25 N·m"
    head = ["condition", "joint", "mean, Go1", "mean, SAL", "95 %, Go1", "95 %, SAL"]
    return Findings(
        **identified(
            (
                "calf_lower",
                "SAL lowers the calf's mean torque in every condition",
                whole and max(ratios("FR_calf", "mean")) < 1.0,
            ),
            (
                "tail_shorter",
                "SAL shortens the calf's high-torque tail (95th percentile) in every condition",
                whole and max(ratios("FR_calf", "p95")) < 1.0,
            ),
            (
                "hip_thigh_similar",
                f"hip and thigh stay broadly similar (means within {100.0 * SIMILAR:.0f} %)",
                whole and all(abs(ratio - 1.0) < SIMILAR for joint in SHOWN[:2] for ratio in ratios(joint, "mean")),
            ),
        ),
        notes=walked.arrivals("both", robots=PAIR),
        reasons={"walk.calf_torque": f"{why} {_thigh(walked)}"},
        tables=[TextTable(title=title, head=head, rows=rows), tail],
        pictures={
            "holding.png": "Figures 8(a, b): the front-right calf, holding intervals blue, damping orange",
            "torques.png": "Figure 8(c): distributions of the front-right motors' torque, Go1 left, SAL right",
        },
        figures={"torque": {f"{r}, {paper.condition_name(*cell)}": value for (r, *cell), value in torque.items()}},
    )


def _tail(results: Sequence[WalkResult]) -> tuple[TextTable, str]:
    """Where the front-right calf's torques beyond Go1's 95th percentile are with SAL: a table and a sentence."""
    torque = power_meter.torque_of_bins()
    limits = {r.cell: walk_figures.torques(r)["FR_calf"]["p95"] for r in results if r.robot == "go1" and len(r.speed)}
    rows, held = [], []
    for result in results:
        if result.robot == "mr_go_sal" and len(result.speed) and result.cell in limits:
            beyond = result.stance[:, torque > limits[result.cell]].sum(1)
            shares = beyond / max(beyond.sum(), 1.0)
            times = result.stance.sum(1) / max(result.stance.sum(), 1.0)
            cells = (f"{100.0 * share:.0f}, {100.0 * time:.0f}" for share, time in zip(shares, times, strict=True))
            rows.append([result.condition, f"{limits[result.cell]:.1f}", *cells])
            held.append(shares)
    head = ["condition", "Go1's 95 % [N·m]", *power_meter.STANCE]
    title = "The front-right calf's torques beyond Go1's 95th percentile with SAL, and its time [% of either]"
    text = "No condition in which both arrived."
    if held:
        before, during, after = (_span(100.0 * x) for x in np.transpose(held)[1:])
        text = (
            f"The tail is what the gate of eq. 8 leaves out. Of the torques beyond Go1's 95th percentile {before} come "
            f"before the calf is held, from touch-down on. While it is held come {during}, after it was let go {after}."
        )
    return TextTable(title=title, head=head, rows=rows, id="tail"), text


def _span(values: np.ndarray) -> str:
    """Least and largest of some percentages, one figure where both are equal."""
    return " to ".join(dict.fromkeys(f"{value:.0f}" for value in (values.min(), values.max()))) + " %"


def _thigh(walked: Walks) -> str:
    """The thigh's mean torque of Go1, and of MR_Go-SAL's policies with SAL on and off, a sentence."""
    found = [
        [walk_figures.torques(r)["FR_thigh"]["mean"] for r in walked.results[variant] if r.robot == robot]
        for variant, robot in (("both", "go1"), ("both", "mr_go_sal"), ("swapped_policies", "mr_go"))
    ]
    bare, on, off = (", ".join(f"{value:.1f}" for value in values) for values in found)
    return f"The thigh has {bare} N·m on Go1 and {on} with SAL, and {off} with the same policies and SAL off."


EXPERIMENTS = (Experiment(name="fig8", compute=fig8, needs=("walks",)),)

CLAIMS = (
    Claim(
        id="walk.calf_torque",
        place="Figure 8",
        says="SAL lowers the calf's mean torque and shortens its tail, hip and thigh stay broadly similar",
        holds=(("fig8", "calf_lower"), ("fig8", "tail_shorter"), ("fig8", "hip_thigh_similar")),
        why="The mean falls by nearly half, the 95th percentile does not.",
    ),
)
