"""Figure 8: the front-right calf while held (a, b) and the torque distributions of the front-right leg (c)."""

from __future__ import annotations

from mrwarp import paper
from mrwarp.evaluate import walk_figures, walk_pictures
from mrwarp.reproduce import walking
from mrwarp.reproduce.experiment import Experiment, Findings, Job, Table
from mrwarp.reproduce.table6 import condition_name


def compute(job: Job) -> Findings:
    """Both pictures, and whether the distributions shift as the paper says; it gives no numbers."""
    walks = walking.read(job.folders["walks"])
    walk_pictures.holding(walks.both, job.out / "holding.png")
    walk_pictures.distributions(walks.both, job.out / "torques.png")
    torque = {(r.robot, r.payload, r.command): walk_figures.torques(r) for r in walks.both}
    cells = list(dict.fromkeys((r.payload, r.command) for r in walks.both))
    lines = [
        [condition_name(*cell), joint, *(f"{torque[robot, *cell][joint][name]:.1f}"
         for name in ("mean", "p95") for robot in ("go1", "mr_go_sal"))]
        for cell in cells for joint in torque["go1", *cell]
    ]  # fmt: skip

    def lower(joint: str, name: str) -> bool:
        return all(torque["mr_go_sal", *cell][joint][name] < torque["go1", *cell][joint][name] for cell in cells)

    others = [
        abs(torque["mr_go_sal", *cell][joint]["mean"] / torque["go1", *cell][joint]["mean"] - 1.0)
        for cell in cells for joint in ("FR_hip", "FR_thigh")
    ]  # fmt: skip
    return Findings(
        claims={
            "SAL lowers the calf's mean torque in every condition": lower("FR_calf", "mean"),
            "SAL shortens the calf's high-torque tail (95th percentile) in every condition": lower("FR_calf", "p95"),
            "hip and thigh stay broadly similar (means within 15 %)": max(others) < 0.15,
        },
        tables=[Table(title=f"|motor torque| [N·m], {paper.NAMES['go1']} and {paper.NAMES['mr_go_sal']}; to 0.25 N·m",
                      head=["condition", "joint", "mean, Go1", "mean, SAL", "95 %, Go1", "95 %, SAL"], rows=lines)],
        pictures={"holding.png": "Figures 8(a, b): the front-right calf, holding intervals blue, damping orange",
                  "torques.png": "Figure 8(c): distributions of the front-right motors' torque, Go1 left, SAL right"},
        figures={"torque": {f"{robot}, {condition_name(load, speed)}": value
                            for (robot, load, speed), value in torque.items()}},
    )  # fmt: skip


EXPERIMENT = Experiment(
    name="fig8", title="Figure 8: stance support and torque relief", compute=compute, needs=("walks",)
)
