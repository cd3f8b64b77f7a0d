"""Table 7: share of time in which the holding gate is open."""

from __future__ import annotations

from mrwarp import paper
from mrwarp.paper import Measured
from mrwarp.reproduce import walking
from mrwarp.reproduce.experiment import Experiment, Findings, Job, Row, over_seeds
from mrwarp.reproduce.table6 import condition_name


def compute(job: Job) -> Findings:
    """Mean activation over the calves beside the paper's simulation and hardware."""
    walks = walking.read(job.folders["walks"])
    rows, share = [], {}
    for result in (r for r in walks.both if r.robot == "mr_go_sal"):
        cell = (result.payload, result.command)
        ours = over_seeds(100.0 * result.hold.mean(-1), walks.seed_of(result))
        share[cell] = ours["ours"]
        legs = 100.0 * result.hold.mean(0)
        damped = 100.0 * result.dynamic.mean()
        for source, value in paper.TABLE_7[cell].items():  # type: ignore[index]
            why = (
                f"The gate holds a loaded calf below 0.2 rad/s; our gait's calves stand still longer: {legs.min():.0f} "
                f"to {legs.max():.0f} % over the four, of a stance of 50 % (damping takes {damped:.0f} %)."
            )
            rows.append(
                Row(condition=f"{condition_name(*cell)}, paper's {source}", quantity="activation", unit="%",
                    paper=Measured(mean=100.0 * value), **ours, digits=1, why=why)
            )  # fmt: skip
    return Findings(
        rows=rows,
        claims={
            "activation is longer at 0.3 than at 0.5 m/s, without and with payload": all(
                share[load, 0.3] > share[load, 0.5] for load in (0.0, 3.0)
            ),
            "activation is longer with payload than without, at both speeds": all(
                share[3.0, speed] > share[0.0, speed] for speed in (0.3, 0.5)
            ),
        },
        figures={"activation": {condition_name(*cell): value for cell, value in share.items()}},
    )


EXPERIMENT = Experiment(name="table7", title="Table 7: support activation", compute=compute, needs=("walks",))
