"""Table 6 and figure 9: cost of transport.

Go1's rows calibrate the electrical model, all others are predicted. Robots walk at the speeds that the paper measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from mrwarp import paper
from mrwarp.energy import consistency
from mrwarp.energy.model_numbers import CALIBRATED
from mrwarp.energy.power import ElectricalCfg, battery_power
from mrwarp.paper import PaperValue
from mrwarp.runtime import drawing
from mrwarp.trials import walk_figures, walk_pictures
from mrwarp.trials.statistics import ratio_sd
from mrwarp.trials.walk_figures import Saving, mean_power
from mrwarp.trials.walk_trials import WalkResult
from paper.reproduce import walks
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import CELLS, Comparison, Findings, TextTable, compare, identified, over_seeds
from paper.reproduce.verdicts import Claim, rows
from paper.reproduce.walks import Walks
from paper.study.plan import HIGH_POWER_PRICE, POWER_PRICE

Claimed = tuple[str, str, bool]
"""A claim's identifier and sentence, and whether it holds."""


Cots = dict[tuple[str, float, float], dict[str, Any]]
"""COT over training seeds, see :func:`over_seeds`, by robot, payload [kg] and commanded speed [m/s]."""


PARTS = {
    "copper_calves": "calves",
    "copper_hips_thighs": "hips and thighs",
    "electronics": "electronics",
    "drive_friction": "drive friction",
    "mechanical": "mechanical power",
    "regenerated": "regenerated power",
    "coil": "coils",
    "controllers": "current controllers",
}
"""Parts of the battery's power as people read them."""


def table6(job: Job) -> Findings:
    """COT per robot and condition, what SAL saves and where the rest goes.

    Raises:
        ValueError: Go1 arrived in fewer than two conditions.
    """
    walked = walks.read(job)
    fit = walked.calibrated()
    sticking = walked.results["constraint_coupling"]
    standing = {name: float(battery_power(joints, fit.cfg).total) for name, joints in walked.standing.items()}
    holding = [r for r in walked.both if r.robot != "mr_go_sal"] + walked.results["holding"]
    savings, alone, stuck = (
        walk_figures.savings(results, fit.cfg, standing["go1"] - standing["mr_go_hold"])
        for results in (walked.both, holding, sticking)
    )
    cots, cots_stuck = (cots_of(walked, variant, fit.cfg) for variant in ("both", "constraint_coupling"))
    by_holding = {saved.name: f"{saved.cot_reduction:.1%}" for saved in alone}
    rows = [row for result in walked.both if (row := _cot(result, fit.cfg, cots)) is not None]
    rows += [
        reduction_row("SAL against MR_Go", saved, cots, _lost(saved, by_holding.get(saved.name, "no robot arrived")))
        for saved in savings
    ]
    rows += [
        reduction_row("SAL against MR_Go, a device that sticks", saved, cots_stuck, _held(saved)) for saved in stuck
    ]
    bounds, said = closed_form(savings, walked.both, fit.cfg)
    carried, costs = carrying(walked.both, fit.cfg)
    training = _training(walked, fit.cfg)
    return Findings(
        rows=rows,
        **identified(*_claims(cots, walked.both), *of_sticking(_claims(cots_stuck, sticking))),
        notes=[
            f"Go1's four rows and its {paper.MISSION_POWER['go1']['standby']:g} W of standing give {fit} "
            f"(95 %), to {fit.rmse:.1f} W (RMS). No row of MR_Go and MR_Go-SAL took part.",
            "Devices act by the paper's explicit torque (eqs. 6, 19), with which MR_Go-SAL's policies were trained; "
            "those of a device that sticks were trained with brakes that hold a calf still, and walk with them.",
            "The spread of a reduction is that of the ratio of two independent COTs, ours over training seeds, the "
            "paper's over its walks.",
            "Each robot is commanded the speed that the paper measured for it: its cost of transport divides by that, "
            "and so does the calibration.",
            costs,
            said,
            *walked.arrivals(*(name for name in walks.VARIANTS if name != "same_gait")),
        ],
        reasons={
            "walk.power/mr_go": costs,
            "walk.power/mr_go_sal": _saved(savings),
            "walk.saving/cot": _device_alone(walked, fit.cfg),
        },
        tables=[_speeds(walked, cots), carried, _parts(savings), bounds, training],
        figures={
            "savings": [asdict(saved) for saved in savings],
            "holding_alone": [asdict(saved) for saved in alone],
            "constraint_coupling": [asdict(saved) for saved in stuck],
            "standing": standing,
            "conditions": [walk_figures.row(result, fit.cfg) for result in walked.both],
            "calibration": {name: getattr(fit.cfg, name) for name in CALIBRATED["electrical"]}
            | {"half_width": fit.half_width, "rmse": fit.rmse},
        },
    )


def fig9(job: Job) -> Findings:
    """The costs of transport as bars."""
    walked = walks.read(job)
    cfg = walked.calibrated().cfg
    with drawing("cot.png"):
        walk_pictures.cost([walk_figures.row(result, cfg) for result in walked.both], job.out / "cot.png")
    least = walks.complete(walked.both)
    if least:
        cots = {(r.robot, r.cell): walk_figures.cot(r, cfg).mean() for r in walked.both}
        least = all(cots[key] >= cots["mr_go_sal", key[1]] for key in cots)
    return Findings(
        **identified(("sal_lowest", "MR_Go-SAL has the lowest COT in all four conditions", least)),
        notes=["The numbers are those of table 6.", *walked.arrivals("both")],
        pictures={"cot.png": "Cost of transport: bars ours, marks the paper's; hatched rows were calibrated"},
    )


def cots_of(walked: Walks, variant: str, cfg: ElectricalCfg) -> Cots:
    """Cost of transport of each robot and condition in a variant's walks."""
    return {
        (r.robot, *r.cell): over_seeds(walk_figures.cot(r, cfg), walked.seed_of(r, variant))
        for r in walked.results[variant]
    }


def _cot(result: WalkResult, cfg: ElectricalCfg, cots: Cots) -> Comparison | None:
    """Row of a robot in a condition; None where the paper has none."""
    theirs = paper.TABLE_6.get((result.robot, *result.cell))
    if theirs is None:
        return None
    power, speed = mean_power(result, cfg), walk_figures.mean(result.speed)
    return compare(
        f"{paper.NAMES[result.robot]}, {result.condition}",
        ("COT", "", 3),
        PaperValue(mean=theirs.cot, sd=theirs.sd),
        cots[result.robot, *result.cell],
        f"Ours draws {power:.0f} W at {speed:.2f} m/s, the paper's {theirs.power:.0f} W at {theirs.speed:.2f} m/s: "
        f"power explains {power / theirs.power - 1.0:+.0%}, speed {theirs.speed / speed - 1.0:+.0%}.",
        calibrated=result.robot == "go1",
    )


def reduction_row(robots: str, saved: Saving, cots: Cots, why: str) -> Comparison:
    """Row of what SAL saves in a condition, with the spread of the ratio of both robots' COT."""
    assert saved.paper is not None  # all four conditions are table 6's
    cell = saved.payload, saved.command
    after, before = (cots[robot, *cell] for robot in ("mr_go_sal", "mr_go"))
    seeds = min(after["n"], before["n"])
    sd = 100.0 * ratio_sd((after["ours"], after["sd"]), (before["ours"], before["sd"])) if seeds > 1 else None
    theirs = [100.0 * saved.paper[name] for name in ("cot_reduction", "cot_reduction_sd")]
    return compare(
        f"{robots}, {saved.name}",
        ("reduction of COT", "%", 1),
        PaperValue(mean=theirs[0], sd=theirs[1]),
        {"ours": 100.0 * _reduced(cots, cots, cell), "sd": sd, "n": seeds},
        why,
    )


def _lost(saved: Saving, alone: str) -> str:
    """The part that takes most of the saving away; ``alone`` is the reduction of COT by holding alone."""
    assert saved.paper is not None
    part = saved.saving_by_part
    lost = sorted((name for name in part if part[name] < -0.5), key=lambda name: part[name])
    text = ", ".join(f"{PARTS[name]} {part[name]:+.1f} W" for name in lost) or "nothing"
    return (
        f"The calves' copper saves {part['copper_calves']:+.1f} W of the {saved.paper['saving']:.0f} W the paper's "
        f"saving needs (at most {saved.bound['walking_copper']:.0f} W here, all of it gone while held). {text} take "
        f"from it. Holding alone: {alone}."
    )


def _held(saved: Saving) -> str:
    """The held share next to the paper's, with brakes that stick."""
    assert saved.paper is not None
    held = paper.TABLE_7[int(saved.payload), saved.command]["hardware"]
    return (
        f"Trained and walked with brakes that stick: the calves are held for {saved.hold_share:.1%} of the time, "
        f"the paper's hardware for {held:.1%}. {saved.saving:.0f} W are saved, the paper's "
        f"{saved.paper['saving']:.0f} W."
    )


def _reduced(after: Cots, before: Cots, cell: tuple[float, float]) -> float:
    """How much lower MR_Go-SAL's COT is than MR_Go's, relative; NaN where one of them did not arrive."""
    return 1.0 - after["mr_go_sal", *cell]["ours"] / before["mr_go", *cell]["ours"]


def of_sticking(claims: Sequence[Claimed]) -> list[Claimed]:
    """Claims of brakes that stick."""
    return of_others("stuck", "a device that sticks", claims)


def of_others(begin: str, title: str, claims: Sequence[Claimed]) -> list[Claimed]:
    """Claims of other walks, by identifiers and sentences that begin so."""
    return [(f"{begin}_{name}", f"{title}: {text}", holds) for name, text, holds in claims]


def _saved(savings: Sequence[Saving]) -> str:
    """Saving by SAL in watts next to the paper's, a sentence."""
    if not savings:
        return "No condition in which both MR_Go and MR_Go-SAL arrived."
    ours = ", ".join(f"{saved.saving:.0f}" for saved in savings)
    theirs = ", ".join(f"{saved.paper['saving']:.0f}" for saved in savings if saved.paper)
    return f"What MR_Go draws too much remains, SAL takes {ours} W from it and the paper's {theirs} W."


def _device_alone(walked: Walks, cfg: ElectricalCfg) -> str:
    """Saving by the device where both robots walk with the same policies, a sentence."""
    own, swapped = (cots_of(walked, name, cfg) for name in ("both", "swapped_policies"))
    cells = list(dict.fromkeys(result.cell for result in walked.both))
    alone, whole = (
        ", ".join(f"{100.0 * _reduced(after, own, cell):.0f}" for cell in cells) for after in (swapped, own)
    )
    return f"With MR_Go's policies on both robots the device alone saves {alone} of {whole} %, the rest is training's."


def _speeds(walked: Walks, cots: Cots) -> TextTable:
    """Effect of the measured speeds: cost of transport with them, and with 0.3 and 0.5 m/s, both calibrated there."""
    nominal = cots_of(walked, "as_commanded", walked.calibrated("as_commanded").cfg)
    head = ["robot and condition", "commanded [m/s]", "COT", "COT at 0.3 and 0.5 m/s", "paper"]
    rows = []
    for (robot, load, speed), found in cots.items():
        theirs = paper.TABLE_6.get((robot, load, speed))
        if theirs is not None:
            name = f"{paper.NAMES[robot]}, {paper.condition_name(load, speed)}"
            figures = found["ours"], nominal.get((robot, load, speed), {}).get("ours", math.nan), theirs.cot
            rows.append([name, f"{theirs.speed:.2f}", *(f"{value:.3f}" for value in figures)])
    title = "Cost of transport at the paper's measured speeds and as commanded, each with its own calibration"
    return TextTable(title=title, head=head, rows=rows, id="speeds")


def _claims(cots: Cots, results: list[WalkResult]) -> list[Claimed]:
    """Section 6.4's claims on the reduction of COT by SAL; False where a condition is missing."""
    whole = walks.complete([result for result in results if result.robot != "go1"])
    reductions = {cell: _reduced(cots, cots, cell) for cell in dict.fromkeys(key[1:] for key in cots)}
    least, most = paper.COT_REDUCTION
    more_loaded = whole and reductions[3.0, 0.3] >= reductions[0.0, 0.3]
    return [
        ("cot_lower", "SAL lowers COT in all four conditions", whole and min(reductions.values()) > 0.0),
        ("at_least", f"by at least {100.0 * least:.1f} %", whole and min(reductions.values()) >= least),
        ("at_most", f"by at most {100.0 * most:.1f} %", whole and max(reductions.values()) <= most),
        ("more_when_loaded", "at 0.3 m/s no less with payload than without", more_loaded),
    ]


def _parts(savings: Sequence[Saving]) -> TextTable:
    rows = []
    for saved in savings:
        assert saved.paper is not None
        watts = [*(saved.saving_by_part[name] for name in PARTS), saved.saving, saved.paper["saving"]]
        rows.append([saved.name, *(f"{value:+.1f}" for value in watts)])
    title = "What SAL saves, by part of the battery's power [W]; negative = draws more"
    return TextTable(title=title, head=["condition", *PARTS.values(), "sum", "paper"], rows=rows)


def carrying(results: Sequence[WalkResult], cfg: ElectricalCfg) -> tuple[TextTable, str]:
    """Extra power of MR_Go over Go1, with SAL off: a table and a sentence."""
    powers = {(r.robot, *r.cell): mean_power(r, cfg) for r in results}
    rows, more = [], {"ours": [], "paper": []}
    for cell in paper.TABLE_7:
        ours = powers.get(("mr_go", *cell), math.nan) - powers.get(("go1", *cell), math.nan)
        if math.isnan(ours):
            continue
        bare, loaded = (paper.TABLE_6[robot, *cell] for robot in ("go1", "mr_go"))
        theirs, sd = loaded.power - bare.power, math.hypot(bare.power_sd, loaded.power_sd)
        rows.append([paper.condition_name(*cell), f"{ours:+.0f}", f"{theirs:+.0f} ± {sd:.0f}"])
        more["ours"].append(ours)
        more["paper"].append(theirs)
    text = "No condition in which both Go1 and MR_Go arrived."
    if rows:
        ours, theirs = (f"{min(watts):+.0f} to {max(watts):+.0f} W" for watts in more.values())
        text = (
            f"Devices that are off cost their mass ({paper.MASS['mr_go'] - paper.MASS['go1']:.1f} kg) and their drag: "
            f"ours draws {ours} more with them, the paper's {theirs}."
        )
    return TextTable(title="What MR_Go draws more than Go1 [W]", head=["condition", "ours", "paper"], rows=rows), text


def closed_form(savings: Sequence[Saving], results: Sequence[WalkResult], cfg: ElectricalCfg) -> tuple[TextTable, str]:
    """Saving by holding in closed form, from standing and the held share, next to what is saved: the paper's and ours.

    Returns:
        The table, all figures in percent of MR_Go's power, and a note on how far either saving follows the form.
    """
    hardware, simulation = (
        {(row["payload"], row["command"]): row for row in consistency.paper_bounds(source)}
        for source in ("hardware", "simulation")
    )
    powers = {r.cell: mean_power(r, cfg) for r in results if r.robot == "mr_go"}
    rows, followed = [], {"paper": [], "ours": []}
    for saved in savings:
        cell = saved.payload, saved.command
        measured, bound = hardware[cell]["paper_saving_relative"], hardware[cell]["bound_relative"]
        ours = saved.bound["our_standing"] / powers[cell]
        shown = measured, bound, simulation[cell]["bound_relative"], saved.power_reduction, ours
        rows.append([saved.name, *(f"{100.0 * value:.1f}" for value in shown)])
        followed["paper"].append(measured / bound)
        followed["ours"].append(saved.power_reduction / ours)
    text = "No condition in which both MR_Go and MR_Go-SAL arrived."
    if rows:
        theirs, ours = (f"{min(ratios):.2f} to {max(ratios):.2f}" for ratios in followed.values())
        least, most = hardware[0, 0.5], hardware[3, 0.3]
        grown = most["bound_relative"] / least["bound_relative"]
        text = (
            f"By the paper's own standing ({consistency.STANDING:.1f} W) and its hardware's activation, holding saves "
            f"{', '.join(row[2] for row in rows)} % of MR_Go's power under a steady load. Over the conditions the "
            f"paper's saving is {theirs} times its closed form, ours {ours} times ours. The former's scatter is "
            f"explained by neither activation nor load. From {paper.condition_name(0, 0.5)} to "
            f"{paper.condition_name(3, 0.3)} the paper's closed form grows by a factor of {grown:.2f}, "
            f"{grown * least['share'] / most['share']:.2f} of it by load and power alone. Its reductions of COT "
            f"lie within a factor of {paper.COT_REDUCTION[1] / paper.COT_REDUCTION[0]:.2f}."
        )
    head = [
        "condition",
        "the paper saves",
        "closed form: its standing, its hardware's shares",
        "its standing, its simulation's shares",
        "ours saves",
        "closed form: our standing, our shares",
    ]
    title = "What holding saves by closed form, 4 a S (m/m0)^2, next to what is saved [% of MR_Go's power]"
    return TextTable(title=title, head=head, rows=rows, id="closed_form"), text


def _training(walked: Walks, cfg: ElectricalCfg) -> TextTable:
    """Gains by the device and by the training: each robot's policies on either robot, and other prices."""
    free, dear = (walked.calibrated(variant).cfg for variant in ("no_power_price", "high_power_price"))
    own, stuck, swapped = (cots_of(walked, name, cfg) for name in ("both", "constraint_coupling", "swapped_policies"))
    cots_free, cots_dear = cots_of(walked, "no_power_price", free), cots_of(walked, "high_power_price", dear)
    columns = {
        "each robot its own policies": (own, own),
        "the same, a device that sticks": (stuck, stuck),
        "both MR_Go's": (swapped, own),
        "both MR_Go-SAL's": (own, swapped),
        "both table 2's, no price on power": (cots_free, cots_free),
        f"each its own, a price of {HIGH_POWER_PRICE:g} instead of {POWER_PRICE:g} per watt": (cots_dear, cots_dear),
    }
    rows = []
    for cell in dict.fromkeys(r.cell for r in walked.both):
        reduced = [_reduced(after, before, cell) for after, before in columns.values()]
        shown = ["no robot arrived" if math.isnan(value) else f"{100.0 * value:.1f}" for value in reduced]
        rows.append([paper.condition_name(*cell), *shown])
    title = (
        "Reduction of COT by SAL [%] by the policies that walk. The last two columns are calibrated on Go1's "
        f"walks with theirs (electronics {free.electronics:.1f} and {dear.electronics:.1f} W, winding "
        f"{free.winding_resistance:.3f} and {dear.winding_resistance:.3f} Ohm, drive friction "
        f"{free.drive_friction:.2f} and {dear.drive_friction:.2f} N·m)"
    )
    return TextTable(title=title, head=["condition", *columns], rows=rows, id="training")


EXPERIMENTS = (
    Experiment(name="table6", compute=table6, needs=("walks",)),
    Experiment(name="fig9", compute=fig9, needs=("walks",)),
)

CLAIMS = (
    Claim(
        id="walk.power/go1",
        place="Table 6, figure 9",
        says="COT of Go1: 0 kg at 0.3, 0.5; 3 kg at 0.3, 0.5 m/s",
        measure=rows("table6", "COT", *(f"Go1, {cell}" for cell in CELLS)),
        why="Three electrical numbers are fitted to these four rows and the standing power.",
    ),
    Claim(
        id="walk.power/mr_go",
        place="Table 6, figure 9",
        says="COT of MR_Go, same order",
        measure=rows("table6", "COT", *(f"MR_Go, {cell}" for cell in CELLS)),
        why="Devices that are off cost ours more than the paper's.",
    ),
    Claim(
        id="walk.power/mr_go_sal",
        place="Table 6, figure 9",
        says="COT of MR_Go-SAL, same order",
        measure=rows("table6", "COT", *(f"MR_Go-SAL, {cell}" for cell in CELLS)),
        why="What MR_Go draws too much remains.",
    ),
    Claim(
        id="walk.saving/cot",
        place="Table 6, abstract",
        says="reduction of COT by SAL, same order [%]",
        measure=rows("table6", "reduction of COT", *(f"SAL against MR_Go, {cell}" for cell in CELLS)),
        effect=True,
        why="About half of it is the training's: with equal policies the device alone saves less.",
    ),
)
