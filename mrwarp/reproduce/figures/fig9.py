"""Figure 9: the cost of transport of table 6 as bars."""

from __future__ import annotations

from mrwarp.reproduce import walks as walking
from mrwarp.reproduce.experiment import Experiment, Findings, Job
from mrwarp.trials import walk_figures, walk_pictures


def compute(job: Job) -> Findings:
    """The picture; its numbers are table 6's."""
    walks = walking.read(job.folders["walks"])
    cfg = walks.calibrated().cfg
    conditions = [walk_figures.row(result, cfg) for result in walks.both]
    walk_pictures.cost({"conditions": conditions}, job.out / "cot.png")
    least = walking.complete(walks.both) and all(
        min(same, key=lambda c: c["cot"]["mean"])["robot"] == "mr_go_sal"
        for cell in {(c["payload"], c["command"]) for c in conditions}
        if (same := [c for c in conditions if (c["payload"], c["command"]) == cell])
    )
    return Findings(
        claims={"MR_Go-SAL has the lowest COT in all four conditions": least},
        notes=["The numbers are those of table 6.", *walking.arrivals(walks.both)],
        pictures={"cot.png": "Cost of transport: bars ours, marks the paper's; hatched rows were calibrated"},
    )


EXPERIMENT = Experiment(name="fig9", compute=compute, needs=("walks",))
