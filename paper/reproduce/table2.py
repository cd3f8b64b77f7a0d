"""Table 2 and figure 5: what training with the device in the loop changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mrwarp import paper
from mrwarp.enums import AWARE, CONVENTIONAL, Coupling
from mrwarp.paper import PaperValue
from mrwarp.runtime import drawing
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import BRAKE, Comparison, Findings, TextTable, compare, identified
from paper.reproduce.settings import TRAININGS, networks, over_seeds, rollouts_time, study_files
from paper.reproduce.verdicts import Claim, change, rows
from paper.study import matched_training
from paper.study.plan import BRAKE as BRAKE_POLICIES
from paper.study.plan import record_file
from paper.study.rollouts import CURRENT, PLANT, STEPS, EvaluationCfg, PolicyRow, causes, evaluate

METRICS = {
    "v_x_rmse": ("v_x RMSE", "m/s", 4),
    "v_x_bias": ("v_x bias", "m/s", 4),
    "height": ("mean CoM height", "m", 4),
    "height_rmse": ("CoM-z RMSE", "m", 4),
    "tilt_rms": ("roll-pitch RMS", "deg", 3),
    "yaw_rate_rmse": ("yaw-rate RMSE", "rad/s", 4),
}
"""Title, unit and digits of the study's metrics."""

CELLS = {"A": (CONVENTIONAL, 0.0), "B": (CONVENTIONAL, CURRENT), "C": (AWARE, 0.0), "D": (AWARE, CURRENT)}
"""Training of each configuration, and the current that its devices may use [A]."""

TRAINED = {name: f"{name}: {training}, SAL {'on' if current else 'off'}" for name, (training, current) in CELLS.items()}
"""Configurations of tables 2 and 5, as their rows call them."""

PAIRS = (TRAINED["A"], TRAINED["C"]), (TRAINED["B"], TRAINED["D"])
"""Trainings that are compared, SAL off and on."""


def table2(job: Job) -> Findings:
    """Configurations A to D over the training seeds, and which part of the plant makes the bias.

    By the paper's explicit torque, in training and evaluation; then by the brake constraint, in both.
    """
    literal = evaluation(job)
    brake = replace(literal, folder=BRAKE_POLICIES, coupling=Coupling.CONSTRAINT)
    found, fell = [], []
    for k, (cfg, suffix) in enumerate(((literal, ""), (brake, BRAKE))):
        cells = evaluate(cfg, list(CELLS.values()), lambda share, k=k: job.report("rollouts", (k + share) / 3.0))
        for name, row in zip(CELLS, cells, strict=True):
            found += metric_rows(TRAINED[name] + suffix, row, paper.TABLE_2[name])
            fell.append(row.fell)
    parts = causes(replace(literal, plant="bouc_wen"), TRAININGS, lambda share: job.report("causes", (2.0 + share) / 3))
    bias = [
        [title, *(_spread(parts[training][step].seeds["v_x_bias"]) for training in TRAININGS)]
        for step, title in STEPS.items()
    ]
    return Findings(
        rows=found,
        notes=[f"{sum(fell)} of all rollouts fell."],
        tables=[TextTable(title="Bias of v_x", head=["v_x bias [m/s] on", *TRAININGS], rows=bias, id="causes")],
    )


def _spread(values: np.ndarray) -> str:
    return f"{values.mean():.3f} ± {values.std(ddof=1):.3f}".replace("-", "−")


def evaluation(job: Job) -> EvaluationCfg:
    """How policies are rolled out with the paper's explicit torque."""
    settings = job.settings
    return EvaluationCfg(rollouts=settings.rollouts, seed=settings.seed, threads=settings.threads)


def metric_rows(condition: str, found: PolicyRow, theirs: Mapping[str, PaperValue]) -> list[Comparison]:
    """A row for each metric of the study that the paper gives."""
    why = "Rewards, gains and training length are not the paper's, so levels differ (docs/choices.md)."
    return [
        compare(condition, METRICS[metric], theirs[metric], over_seeds(found.seeds[metric]), why)
        for metric in METRICS
        if metric in theirs
    ]


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


EXPERIMENTS = (
    Experiment(
        name="table2",
        compute=table2,
        settings=("rollouts", "seed"),
        files=lambda: [*study_files(TRAININGS), *study_files((AWARE,), folder=BRAKE_POLICIES), *networks((PLANT,))],
        seconds=rollouts_time,
    ),
    Experiment(name="fig5", compute=fig5, files=lambda: study_files(TRAININGS, record_file)),
)

CLAIMS = (
    Claim(
        id="training.tracking/rmse",
        place="Table 2",
        says="v_x RMSE of A, B, C, D [m/s]",
        measure=rows("table2", "v_x RMSE", *TRAINED.values()),
        why="Under eq. 19 row B equals row A by construction.",
    ),
    Claim(
        id="training.tracking/change",
        place="Table 2",
        says="actuator-aware training lowers v_x RMSE, SAL off, on [%]",
        measure=change("table2", "v_x RMSE", *PAIRS),
        effect=True,
        why="The gain is the bias that training on the heavier robot takes away.",
    ),
    Claim(
        id="training.bias",
        place="Table 2",
        says="v_x bias of A, B, C, D [m/s]",
        measure=rows("table2", "v_x bias", *TRAINED.values()),
        why="Mass and drag slow a policy down that does not know them; the paper's run too fast.",
    ),
    Claim(
        id="training.height",
        place="Table 2",
        says="mean height higher by actuator-aware training, SAL off, on [%]",
        measure=change("table2", "mean CoM height", *PAIRS),
        effect=True,
        why="The change is a percent, within the spread of our seeds.",
    ),
    Claim(
        id="training.curves",
        place="Figure 5",
        says="the actuator-aware training learns more slowly at first and ends at a higher reward",
        holds=(("fig5", "slower_at_first"), ("fig5", "ends_higher")),
        why="By the paper's torque both hold; trained with a brake that sticks, it ended lower.",
    ),
)
