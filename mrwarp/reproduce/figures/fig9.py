"""Figure 9: the cost of transport of table 6 as bars."""

from __future__ import annotations

from mrwarp.reproduce import walks
from mrwarp.reproduce.experiment import Findings, Job
from mrwarp.trials import walk_figures, walk_pictures


def compute(job: Job) -> Findings:
    """The picture; its numbers are table 6's."""
    walked = walks.read(job)
    cfg = walked.calibrated().cfg
    walk_pictures.cost([walk_figures.row(result, cfg) for result in walked.both], job.out / "cot.png")
    least = walks.complete(walked.both)
    if least:
        cots = {(r.robot, r.cell): walk_figures.cot(r, cfg).mean() for r in walked.both}
        least = all(cots[key] >= cots["mr_go_sal", key[1]] for key in cots)
    return Findings(
        claims={"MR_Go-SAL has the lowest COT in all four conditions": least},
        notes=["The numbers are those of table 6.", *walked.arrivals("both")],
        pictures={"cot.png": "Cost of transport: bars ours, marks the paper's; hatched rows were calibrated"},
    )
