"""Table 3: which torque model a training needs."""

from __future__ import annotations

from mrwarp import paper
from mrwarp.enums import MODELS
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import Findings
from paper.reproduce.settings import PLANT_TITLES, networks, rollouts_time, study_files
from paper.reproduce.table2 import evaluation, metric_rows
from paper.reproduce.verdicts import Claim, Measure, rows
from paper.study.rollouts import CURRENT, PLANT, evaluate


def table3(job: Job) -> Findings:
    """Metrics per torque model in training over the seeds, by the paper's explicit torque, SAL on."""
    cells = [(model, CURRENT) for model in MODELS]
    found = evaluate(evaluation(job), cells, lambda share: job.report("rollouts", share))
    return Findings(
        rows=[row for of in found for row in metric_rows(PLANT_TITLES[of.plant], of, paper.TABLE_3[of.plant])],
        notes=[f"{sum(row.fell for row in found)} of all rollouts fell."],
    )


def _by_model(quantity: str) -> Measure:
    return rows("table3", quantity, *PLANT_TITLES.values())


EXPERIMENTS = (
    Experiment(
        name="table3",
        compute=table3,
        settings=("rollouts", "seed"),
        files=lambda: [*study_files(MODELS), *networks((PLANT,))],
        seconds=rollouts_time,
    ),
)

CLAIMS = (
    Claim(
        id="models.tracking",
        place="Table 3",
        says="v_x RMSE by MLP, Bouc-Wen, LSTM, PG-RLSTM in training [m/s]",
        measure=_by_model("v_x RMSE"),
        why="Which model a training has changes nothing that seeds resolve, in the paper or here.",
    ),
    Claim(
        id="models.lean",
        place="Table 3",
        says="roll-pitch RMS, same order [deg]",
        measure=_by_model("roll-pitch RMS"),
        why="By symmetric networks and a weight of −100 on the tilt, chosen with this row in view.",
    ),
    Claim(
        id="models.yaw",
        place="Table 3",
        says="yaw-rate RMSE, same order [rad/s]",
        measure=_by_model("yaw-rate RMSE"),
        why="Ours turns less; the paper names neither noise nor randomisation.",
    ),
)
