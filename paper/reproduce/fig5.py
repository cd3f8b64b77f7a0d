"""Figure 5: learning curves with and without the device in the loop."""

from __future__ import annotations

from mrwarp.runtime import drawing
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import Findings, identified
from paper.reproduce.settings import (
    TRAININGS,
    study_files,
)
from paper.reproduce.verdicts import Claim
from paper.study import matched_training
from paper.study.plan import AWARE, CONVENTIONAL, record_file


def fig5(job: Job) -> Findings:
    """Learning curves by the paper's torque: whether aware policies learn more slowly and end higher."""
    found = matched_training.figure5()
    with drawing("rewards.png"):
        matched_training.plot(found, job.out / "rewards.png")
    slow, plain = found[AWARE], found[CONVENTIONAL]
    quarter, last = slow.update <= 0.25 * slow.update[-1], slow.update >= 0.9 * slow.update[-1]
    early, late = ([float(curve.mean[part].mean()) for curve in (slow, plain)] for part in (quarter, last))
    return Findings(
        **identified(
            ("slower_at_first", "the actuator-aware training learns more slowly at first", early[0] < early[1]),
            ("ends_higher", "and ends at a higher reward", late[0] > late[1]),
        ),
        notes=[
            f"Reward per second, actuator-aware and conventional: {early[0]:.2f} and {early[1]:.2f} over the first "
            f"quarter, {late[0]:.2f} and {late[1]:.2f} over the last tenth of the updates."
        ],
        pictures={"rewards.png": "Reward over the trainings, mean and SD over the seeds"},
    )


EXPERIMENTS = (Experiment(name="fig5", compute=fig5, files=lambda: study_files(TRAININGS, record_file)),)

CLAIMS = (
    Claim(
        id="training.curves",
        place="Figure 5",
        says="the actuator-aware training learns more slowly at first and ends at a higher reward",
        holds=(("fig5", "slower_at_first"), ("fig5", "ends_higher")),
        why="By the paper's torque both hold; trained with a brake that sticks, it ended lower.",
    ),
)
