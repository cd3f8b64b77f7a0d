"""Table 7: share of time in which the holding gate is open."""

from __future__ import annotations

from mrwarp import paper
from mrwarp.paper import PaperValue
from mrwarp.params import GateParams
from mrwarp.reproduce import walks as walking
from mrwarp.reproduce.experiment import Comparison, Experiment, Findings, Job, over_seeds
from mrwarp.reproduce.walks import Walks
from mrwarp.trials import walk_figures
from mrwarp.trials.walk_trials import WalkResult


def compute(job: Job) -> Findings:
    """Mean activation over the calves beside the paper's simulation and hardware."""
    walks = walking.read(job.folders["walks"])
    results, sticking = (
        [result for result in walked if result.robot == "mr_go_sal"] for walked in (walks.both, walks.sticking)
    )
    rows, share = _rows(results, walks, "both", {"hardware": "paper's hardware", "simulation": "paper's simulation"})
    stuck = {"hardware": "paper's hardware, a device that sticks"}
    more, share_sticking = _rows(sticking, walks, "sticking", stuck)
    return Findings(
        rows=[*rows, *more],
        claims=_claims(share, walking.complete(results))
        | {
            f"a device that sticks: {name}": holds
            for name, holds in _claims(share_sticking, walking.complete(sticking)).items()
        },
        notes=walking.all_arrivals(walks, "both", "sticking", robots=("mr_go_sal",)),
        figures={
            "activation": {paper.condition_name(*cell): value for cell, value in share.items()},
            "activation_sticking": {paper.condition_name(*cell): value for cell, value in share_sticking.items()},
        },
    )


def _rows(
    results: list[WalkResult], walks: Walks, variant: str, sources: dict[str, str]
) -> tuple[list[Comparison], dict[tuple[float, float], float]]:
    """Rows of a variant's walks beside the paper's sources, by their names in the table, and our shares of time [%]."""
    rows, share = [], {}
    for result in results:
        cell = (result.payload, result.command)
        ours = over_seeds(100.0 * result.hold.mean(-1), walks.seed_of(result, variant))
        share[cell] = ours["ours"]
        for source, shown in sources.items():
            value = 100.0 * paper.TABLE_7[cell][source]  # type: ignore[index]
            rows.append(
                Comparison(condition=f"{paper.condition_name(*cell)}, {shown}", quantity="activation", unit="%",
                    paper=PaperValue(mean=value), **ours, digits=1, why=_why(result, ours["ours"], value))
            )  # fmt: skip
    return rows, share


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


EXPERIMENT = Experiment(name="table7", compute=compute, needs=("walks",))
