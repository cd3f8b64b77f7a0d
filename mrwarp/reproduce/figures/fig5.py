"""Figure 5: learning curves of the conventional and the actuator-aware trainings."""

from __future__ import annotations

from mrwarp.reproduce.experiment import Findings, Job
from mrwarp.study.curves import figure5, plot
from mrwarp.study.plan import AWARE, CONVENTIONAL


def compute(job: Job) -> Findings:
    """The picture, and whether the aware policies learn more slowly and end higher; the paper gives no numbers."""
    curves = figure5()
    plot(curves, job.out / "rewards.png")
    slow, plain = curves[AWARE], curves[CONVENTIONAL]
    quarter = slow.update <= 0.25 * slow.update[-1]
    last = slow.update >= 0.9 * slow.update[-1]
    early = [float(curve.mean[quarter].mean()) for curve in (slow, plain)]
    late = [float(curve.mean[last].mean()) for curve in (slow, plain)]
    return Findings(
        claims={"the actuator-aware training learns more slowly at first": early[0] < early[1],
                "and ends at a higher reward": late[0] > late[1]},
        notes=[
            f"Reward per second, actuator-aware and conventional: {early[0]:.2f} and {early[1]:.2f} over the first "
            f"quarter, {late[0]:.2f} and {late[1]:.2f} over the last tenth of the updates."
        ],
        pictures={"rewards.png": "Reward over the trainings, mean and SD over three seeds"},
    )  # fmt: skip
