"""Table 7: share of time in which the holding gate is open."""

from __future__ import annotations

from mrwarp import paper
from mrwarp.params import GateParams
from mrwarp.reproduce import walks
from mrwarp.reproduce.experiment import Comparison, Findings, Job, compare, over_seeds
from mrwarp.reproduce.walks import Walks
from mrwarp.trials import walk_figures
from mrwarp.trials.walk_trials import WalkResult


def compute(job: Job) -> Findings:
    """Mean activation over the calves beside the paper's simulation and hardware."""
    walked = walks.read(job)
    both = {"hardware": "paper's hardware", "simulation": "paper's simulation"}
    stuck = {"hardware": "paper's hardware, a device that sticks"}
    rows, share, claims = _rows(walked, "both", both)
    more, share_sticking, claims_sticking = _rows(walked, "constraint_coupling", stuck)
    return Findings(
        rows=[*rows, *more],
        claims={**claims, **{f"a device that sticks: {name}": holds for name, holds in claims_sticking.items()}},
        notes=walked.arrivals("both", "constraint_coupling", robots=("mr_go_sal",)),
        figures={
            "activation": {paper.condition_name(*cell): value for cell, value in share.items()},
            "activation_sticking": {paper.condition_name(*cell): value for cell, value in share_sticking.items()},
        },
    )


def _rows(
    walked: Walks, variant: str, sources: dict[str, str]
) -> tuple[list[Comparison], dict[tuple[float, float], float], dict[str, bool]]:
    """Rows of a variant beside the paper's sources by their names there, our shares of time [%], and the claims."""
    rows, share = [], {}
    results = [result for result in walked.results[variant] if result.robot == "mr_go_sal"]
    for result in results:
        ours = over_seeds(100.0 * result.hold.mean(-1), walked.seed_of(result, variant))
        share[result.cell] = ours["ours"]
        for source, shown in sources.items():
            theirs = 100.0 * paper.TABLE_7[result.cell][source]  # type: ignore[index]
            why = _why(result, ours["ours"], theirs)
            rows.append(compare(f"{result.condition}, {shown}", ("activation", "%", 1), theirs, ours, why))
    return rows, share, _claims(share, walks.complete(results))


def _claims(share: dict[tuple[float, float], float], whole: bool) -> dict[str, bool]:
    """Section 6.4's claims on the shares by payload [kg] and speed [m/s]; False where a condition is missing."""
    return {
        "activation is longer at 0.3 than at 0.5 m/s, without and with payload": whole
        and all(share[load, 0.3] > share[load, 0.5] for load in (0.0, 3.0)),
        "activation is longer with payload than without, at both speeds": whole
        and all(share[3.0, speed] > share[0.0, speed] for speed in (0.3, 0.5)),
    }


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
