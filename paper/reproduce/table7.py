"""Table 7: support activation next to the paper's simulation and hardware.

Its simulation stands next to walks as commanded, its hardware next to walks at the measured speeds.
"""

from __future__ import annotations

from mrwarp import paper
from mrwarp.params import GateParams
from mrwarp.trials import walk_figures
from mrwarp.trials.walk_trials import WalkResult
from paper.reproduce import walks
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import CELLS, Comparison, Findings, compare, identified
from paper.reproduce.settings import over_seeds
from paper.reproduce.table6 import Claimed, of_others
from paper.reproduce.verdicts import Claim, rows
from paper.reproduce.walks import Walks


def table7(job: Job) -> Findings:
    """Mean activation over the calves next to the paper's simulation and hardware."""
    walked = walks.read(job)
    rows, share, claims = _activation(walked, "both", {"hardware": "paper's hardware"})
    simulated, _, nominal = _activation(walked, "as_commanded", {"simulation": "paper's simulation"})
    stuck = {"hardware": "paper's hardware, a device that sticks"}
    more, share_sticking, claims_sticking = _activation(walked, "constraint_coupling", stuck)
    return Findings(
        rows=[*rows, *simulated, *more],
        **identified(
            *claims,
            *of_others("commanded", "at 0.3 and 0.5 m/s", nominal),
            *of_others("stuck", "a device that sticks", claims_sticking),
        ),
        notes=walked.arrivals("both", "as_commanded", "constraint_coupling", robots=("mr_go_sal",)),
        figures={
            name: {paper.condition_name(*cell): value for cell, value in found.items()}
            for name, found in (("activation", share), ("activation_constraint_coupling", share_sticking))
        },
    )


def _activation(
    walked: Walks, variant: str, sources: dict[str, str]
) -> tuple[list[Comparison], dict[tuple[float, float], float], list[Claimed]]:
    """Rows of a variant next to the paper's sources by their names there, our shares of time [%], and the claims."""
    rows, share = [], {}
    results = [result for result in walked.results[variant] if result.robot == "mr_go_sal"]
    for result in results:
        ours = over_seeds(100.0 * result.hold.mean(-1), walked.seed_of(result, variant))
        share[result.cell] = ours["ours"]
        for source, shown in sources.items():
            theirs = 100.0 * paper.TABLE_7[result.cell][source]
            why = _why(result, ours["ours"], theirs)
            rows.append(compare(f"{result.condition}, {shown}", ("activation", "%", 1), theirs, ours, why))
    whole = walks.complete(results)  # without a condition no claim of section 6.4 holds
    claims = [
        (
            "longer_when_slow",
            "activation is longer at 0.3 than at 0.5 m/s, without and with payload",
            whole and all(share[load, 0.3] > share[load, 0.5] for load in (0.0, 3.0)),
        ),
        (
            "longer_when_loaded",
            "activation is longer with payload than without, at both speeds",
            whole and all(share[3.0, speed] > share[0.0, speed] for speed in (0.3, 0.5)),
        ),
    ]
    return rows, share, claims


def _why(result: WalkResult, ours: float, theirs: float) -> str:
    """How the shares of time [%] come about."""
    if not len(result.speed):
        return "No trial arrived."
    legs, damped = 100.0 * result.hold.mean(0), 100.0 * result.dynamic.mean()
    return (
        f"The gate holds a loaded calf below {GateParams().eps_hold:g} rad/s; our gait's calves stand still "
        f"{'longer' if ours > theirs else 'for less time'}: {legs.min():.0f} to {legs.max():.0f} % over the four, of a "
        f"stance of {100.0 * walk_figures.STANCE_SHARE:.0f} % (damping takes {damped:.0f} %)."
    )


EXPERIMENTS = (Experiment(name="table7", compute=table7, needs=("walks",)),)

CLAIMS = (
    Claim(
        id="walk.activation/simulation",
        place="Table 7, simulation",
        says="activation, same order [%]",
        measure=rows("table7", "activation", *(f"{cell}, paper's simulation" for cell in CELLS)),
        why="Ours spreads too much over seeds to order four conditions.",
    ),
    Claim(
        id="walk.activation/hardware",
        place="Table 7, hardware",
        says="activation, same order [%]",
        measure=rows("table7", "activation", *(f"{cell}, paper's hardware" for cell in CELLS)),
        why="At 0.5 m/s ours does not hold longer with payload; the hardware does.",
    ),
)
