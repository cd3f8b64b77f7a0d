"""Table 7: share of time in which the holding gate is open; figure 8: a held calf, and what it takes off the motors."""

from __future__ import annotations

from mrwarp import paper
from mrwarp.params import GateParams
from mrwarp.reproduce import walks
from mrwarp.reproduce.cache import Job
from mrwarp.reproduce.comparison import Comparison, Findings, TextTable, compare, over_seeds
from mrwarp.reproduce.walks import Walks
from mrwarp.trials import power_meter, walk_figures, walk_pictures
from mrwarp.trials.walk_trials import WalkResult
from mrwarp.usd.robot import JOINTS

PAIR = ("go1", "mr_go_sal")
"""The robots that figure 8 compares."""

SHOWN = tuple(JOINTS[joint] for joint in power_meter.SHOWN)
"""Joints of the front-right leg."""

SIMILAR = 0.15
"""Largest relative difference of means that counts as broadly similar."""


def table7(job: Job) -> Findings:
    """Mean activation over the calves beside the paper's simulation and hardware."""
    walked = walks.read(job)
    both = {"hardware": "paper's hardware", "simulation": "paper's simulation"}
    rows, share, claims = _activation(walked, "both", both)
    stuck = {"hardware": "paper's hardware, a device that sticks"}
    more, share_sticking, claims_sticking = _activation(walked, "constraint_coupling", stuck)
    return Findings(
        rows=[*rows, *more],
        claims={**claims, **{f"a device that sticks: {name}": holds for name, holds in claims_sticking.items()}},
        notes=walked.arrivals("both", "constraint_coupling", robots=("mr_go_sal",)),
        figures={
            "activation": {paper.condition_name(*cell): value for cell, value in share.items()},
            "activation_sticking": {paper.condition_name(*cell): value for cell, value in share_sticking.items()},
        },
    )


def _activation(
    walked: Walks, variant: str, sources: dict[str, str]
) -> tuple[list[Comparison], dict[tuple[float, float], float], dict[str, bool]]:
    """Rows of a variant beside the paper's sources by their names there, our shares of time [%], and the claims."""
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
    claims = {
        "activation is longer at 0.3 than at 0.5 m/s, without and with payload": whole
        and all(share[load, 0.3] > share[load, 0.5] for load in (0.0, 3.0)),
        "activation is longer with payload than without, at both speeds": whole
        and all(share[3.0, speed] > share[0.0, speed] for speed in (0.3, 0.5)),
    }
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


def fig8(job: Job) -> Findings:
    """Both pictures, and whether the torques of the front-right leg shift as the paper says; it gives no numbers."""
    walked = walks.read(job)
    walk_pictures.holding(walked.both, job.out / "holding.png")
    walk_pictures.distributions(walked.both, job.out / "torques.png")
    whole = walks.complete([r for r in walked.both if r.robot in PAIR])
    torque = {(r.robot, *r.cell): walk_figures.torques(r) for r in walked.both if len(r.speed)}
    cells = list(dict.fromkeys(r.cell for r in walked.both))

    def shown(robot: str, cell: tuple[float, float], joint: str, name: str) -> str:
        """One number of the table as text."""
        return f"{torque[robot, *cell][joint][name]:.1f}" if (robot, *cell) in torque else "none arrived"

    def ratios(joint: str, name: str) -> list[float]:
        """MR_Go-SAL over Go1 by condition."""
        return [torque["mr_go_sal", *cell][joint][name] / torque["go1", *cell][joint][name] for cell in cells]

    rows = [
        [paper.condition_name(*cell), joint, *(shown(r, cell, joint, name) for name in ("mean", "p95") for r in PAIR)]
        for cell in cells
        for joint in SHOWN
    ]
    title = f"|motor torque| [N·m], {paper.NAMES['go1']} and {paper.NAMES['mr_go_sal']}; to 0.25 N·m"
    head = ["condition", "joint", "mean, Go1", "mean, SAL", "95 %, Go1", "95 %, SAL"]
    return Findings(
        claims={
            "SAL lowers the calf's mean torque in every condition": whole and max(ratios("FR_calf", "mean")) < 1.0,
            "SAL shortens the calf's high-torque tail (95th percentile) in every condition": whole
            and max(ratios("FR_calf", "p95")) < 1.0,
            f"hip and thigh stay broadly similar (means within {100.0 * SIMILAR:.0f} %)": whole
            and all(abs(ratio - 1.0) < SIMILAR for joint in SHOWN[:2] for ratio in ratios(joint, "mean")),
        },
        notes=walked.arrivals("both", robots=PAIR),
        tables=[TextTable(title=title, head=head, rows=rows)],
        pictures={
            "holding.png": "Figures 8(a, b): the front-right calf, holding intervals blue, damping orange",
            "torques.png": "Figure 8(c): distributions of the front-right motors' torque, Go1 left, SAL right",
        },
        figures={"torque": {f"{r}, {paper.condition_name(*cell)}": value for (r, *cell), value in torque.items()}},
    )
