"""Figure 8: the front-right calf while held (a, b) and the torque distributions of the front-right leg (c)."""

from __future__ import annotations

from mrwarp import paper
from mrwarp.reproduce import walks
from mrwarp.reproduce.experiment import Findings, Job, TextTable
from mrwarp.trials import power_meter, walk_figures, walk_pictures
from mrwarp.usd.robot import JOINTS

PAIR = ("go1", "mr_go_sal")
"""The robots that the figure compares."""

SHOWN = tuple(JOINTS[joint] for joint in power_meter.SHOWN)
"""Joints of the front-right leg."""

SIMILAR = 0.15
"""Largest relative difference of means that counts as broadly similar."""


def compute(job: Job) -> Findings:
    """Both pictures, and whether the distributions shift as the paper says; it gives no numbers."""
    walked = walks.read(job)
    walk_pictures.holding(walked.both, job.out / "holding.png")
    walk_pictures.distributions(walked.both, job.out / "torques.png")
    whole = walks.complete([r for r in walked.both if r.robot in PAIR])
    torque = {(r.robot, *r.cell): walk_figures.torques(r) for r in walked.both if len(r.speed)}
    cells = list(dict.fromkeys(r.cell for r in walked.both))

    def figure(robot: str, cell: tuple[float, float], joint: str, name: str) -> str:
        """One number of the table as text."""
        return f"{torque[robot, *cell][joint][name]:.1f}" if (robot, *cell) in torque else "none arrived"

    def ratios(joint: str, name: str) -> list[float]:
        """MR_Go-SAL over Go1 by condition."""
        return [torque["mr_go_sal", *cell][joint][name] / torque["go1", *cell][joint][name] for cell in cells]

    rows = [
        [paper.condition_name(*cell), joint, *(figure(r, cell, joint, name) for name in ("mean", "p95") for r in PAIR)]
        for cell in cells
        for joint in SHOWN
    ]
    similar = whole and all(abs(r - 1.0) < SIMILAR for joint in SHOWN[:2] for r in ratios(joint, "mean"))
    title = f"|motor torque| [N·m], {paper.NAMES['go1']} and {paper.NAMES['mr_go_sal']}; to 0.25 N·m"
    return Findings(
        claims={
            "SAL lowers the calf's mean torque in every condition": whole and max(ratios("FR_calf", "mean")) < 1.0,
            "SAL shortens the calf's high-torque tail (95th percentile) in every condition": whole
            and max(ratios("FR_calf", "p95")) < 1.0,
            f"hip and thigh stay broadly similar (means within {100.0 * SIMILAR:.0f} %)": similar,
        },
        notes=walked.arrivals("both", robots=PAIR),
        tables=[
            TextTable(
                title=title,
                head=["condition", "joint", "mean, Go1", "mean, SAL", "95 %, Go1", "95 %, SAL"],
                rows=rows,
            )
        ],
        pictures={
            "holding.png": "Figures 8(a, b): the front-right calf, holding intervals blue, damping orange",
            "torques.png": "Figure 8(c): distributions of the front-right motors' torque, Go1 left, SAL right",
        },
        figures={"torque": {f"{r}, {paper.condition_name(*cell)}": value for (r, *cell), value in torque.items()}},
    )
