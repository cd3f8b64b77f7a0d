"""Figure 8: the front-right calf while held (a, b) and the torque distributions of the front-right leg (c)."""

from __future__ import annotations

from mrwarp import paper
from mrwarp.reproduce import walks as walking
from mrwarp.reproduce.experiment import Experiment, Findings, Job, TextTable
from mrwarp.trials import meter, walk_figures, walk_pictures
from mrwarp.usd.robot import JOINTS

PAIR = ("go1", "mr_go_sal")
"""The robots that the figure compares."""

SHOWN = tuple(JOINTS[joint] for joint in meter.SHOWN)
"""Joints of the front-right leg."""

SIMILAR = 0.15
"""Largest relative difference of means that counts as broadly similar."""


def compute(job: Job) -> Findings:
    """Both pictures, and whether the distributions shift as the paper says; it gives no numbers."""
    walks = walking.read(job.folders["walks"])
    walk_pictures.holding(walks.both, job.out / "holding.png")
    walk_pictures.distributions(walks.both, job.out / "torques.png")
    compared = [r for r in walks.both if r.robot in PAIR]
    whole = walking.complete(compared)
    torque = {(r.robot, r.payload, r.command): walk_figures.torques(r) for r in walks.both if len(r.speed)}
    cells = list(dict.fromkeys((r.payload, r.command) for r in walks.both))

    def figure(key: tuple[str, float, float], joint: str, name: str) -> str:
        return f"{torque[key][joint][name]:.1f}" if key in torque else "none arrived"

    lines = [
        [paper.condition_name(*cell), joint, *(figure((robot, *cell), joint, name) for name in ("mean", "p95")
         for robot in PAIR)]
        for cell in cells for joint in SHOWN
    ]  # fmt: skip

    def ratios(joint: str, name: str) -> list[float]:
        """MR_Go-SAL over Go1 by condition."""
        return [torque["mr_go_sal", *cell][joint][name] / torque["go1", *cell][joint][name] for cell in cells]

    def lower(joint: str, name: str) -> bool:
        return whole and max(ratios(joint, name)) < 1.0

    return Findings(
        claims={
            "SAL lowers the calf's mean torque in every condition": lower("FR_calf", "mean"),
            "SAL shortens the calf's high-torque tail (95th percentile) in every condition": lower("FR_calf", "p95"),
            f"hip and thigh stay broadly similar (means within {100.0 * SIMILAR:.0f} %)": whole
            and all(abs(ratio - 1.0) < SIMILAR for joint in ("FR_hip", "FR_thigh") for ratio in ratios(joint, "mean")),
        },
        notes=walking.arrivals(compared),
        tables=[
            TextTable(
                title=f"|motor torque| [N·m], {paper.NAMES['go1']} and {paper.NAMES['mr_go_sal']}; to 0.25 N·m",
                head=["condition", "joint", "mean, Go1", "mean, SAL", "95 %, Go1", "95 %, SAL"],
                rows=lines,
            )
        ],
        pictures={
            "holding.png": "Figures 8(a, b): the front-right calf, holding intervals blue, damping orange",
            "torques.png": "Figure 8(c): distributions of the front-right motors' torque, Go1 left, SAL right",
        },
        figures={
            "torque": {
                f"{robot}, {paper.condition_name(load, speed)}": value for (robot, load, speed), value in torque.items()
            }
        },
    )


EXPERIMENT = Experiment(name="fig8", compute=compute, needs=("walks",))
