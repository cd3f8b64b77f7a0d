"""Table 6 and figure 9: cost of transport.

Go1's rows calibrate the electrical model, all others are predicted. Robots walk at the speeds that the paper measured.
What the calibration leaves open of the electrical numbers is part of the error of every predicted figure.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from mrwarp import paper
from mrwarp.energy import consistency
from mrwarp.energy.model_numbers import CALIBRATED, Calibration
from mrwarp.energy.power import ElectricalCfg, battery_power
from mrwarp.paper import PaperValue
from mrwarp.runtime import drawing
from mrwarp.trials import walk_figures, walk_pictures
from mrwarp.trials.statistics import ratio_sd
from mrwarp.trials.walk_figures import Saving, mean_power
from mrwarp.trials.walk_trials import WalkResult
from paper.reproduce import walks
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import CELLS, Comparison, Findings, TextTable, compare, identified
from paper.reproduce.settings import over_seeds
from paper.reproduce.verdicts import Claim, rows
from paper.reproduce.walks import Walks

Claimed = tuple[str, str, bool]
"""A claim's identifier and sentence, and whether it holds."""

Cots = dict[tuple[str, float, float], dict[str, Any]]
"""COT over training seeds, see :func:`over_seeds`, by robot, payload [kg] and commanded speed [m/s]."""

REDUCTION = ("reduction of COT", "%", 1)
"""Quantity, unit and digits."""

STICKS = "SAL against MR_Go, a device that sticks"
"""Beginning of the conditions of brakes that stick."""


def table6(job: Job) -> Findings:
    """COT per robot and condition, what SAL saves and where the rest goes.

    Raises:
        ValueError: Go1 arrived in fewer than three conditions.
    """
    walked = walks.read(job)
    fit = walked.calibrated()
    sticking = walked.results["constraint_coupling"]
    standing = {name: float(battery_power(joints, fit.cfg).total) for name, joints in walked.standing.items()}
    savings = walk_figures.savings(walked.both, fit.cfg, standing["go1"] - standing["mr_go_hold"])
    stuck = walk_figures.savings(sticking, fit.cfg)
    cots, cots_stuck = (cots_of(walked, variant, fit.cfg) for variant in ("both", "constraint_coupling"))
    errors = dict(zip(cots, fit.error(lambda cfg: _means(walked, "both", cfg)), strict=True))
    found = [row for result in walked.both if (row := _cot(result, fit, cots, errors)) is not None]
    found += reduction_rows("SAL against MR_Go", walked, "both", fit, {s.cell: _lost(s) for s in savings})
    found += reduction_rows(STICKS, walked, "constraint_coupling", fit, {s.cell: _held(s) for s in stuck})
    bounds, said = closed_form(savings, walked.both, fit.cfg)
    costs = carrying(walked.both, fit.cfg)
    others = [name for name in walks.VARIANTS if name != "as_commanded"]
    return Findings(
        rows=found,
        **identified(*_claims(cots, walked.both), *of_others("stuck", STICKS, _claims(cots_stuck, sticking))),
        notes=[
            f"Go1's four rows and its {paper.MISSION_POWER['go1']['standby']:g} W of standing give {fit} "
            f"(95 %), to {fit.rmse:.1f} W (RMS). No row of MR_Go and MR_Go-SAL took part. A figure's error has what "
            "this leaves open of the three numbers, next to the scatter of the seeds.",
            "Devices act by the paper's explicit torque (eqs. 6, 19), with which MR_Go-SAL's policies were trained; "
            "those of a device that sticks were trained with brakes that hold a calf still, and walk with them.",
            "Each robot is commanded the speed that the paper measured for it: its cost of transport divides by that, "
            "and so does the calibration.",
            costs,
            said,
            *walked.arrivals(*others),
        ],
        reasons={
            "walk.power/mr_go": costs,
            "walk.power/mr_go_sal": _saved(savings),
            "walk.saving/cot": _device_alone(walked, fit.cfg),
        },
        tables=[bounds, training_table(walked, fit.cfg), sensitivity(walked, fit.cfg)],
        figures={
            "savings": [asdict(saved) for saved in savings],
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


def _means(walked: Walks, variant: str, cfg: ElectricalCfg) -> np.ndarray:
    return np.array([found["ours"] for found in cots_of(walked, variant, cfg).values()])


def _cot(
    result: WalkResult, fit: Calibration, cots: Cots, errors: Mapping[tuple[str, float, float], float]
) -> Comparison | None:
    """Row of a robot in a condition; None where the paper has none."""
    theirs = paper.TABLE_6.get((result.robot, *result.cell))
    if theirs is None:
        return None
    power, speed = mean_power(result, fit.cfg), walk_figures.mean(result.speed)
    key = (result.robot, *result.cell)
    return compare(
        f"{paper.NAMES[result.robot]}, {result.condition}",
        ("COT", "", 3),
        PaperValue(mean=theirs.cot, sd=theirs.sd, n=paper.WALKS),
        {**cots[key], "error": float(errors[key]), "error_free": fit.free},
        f"Ours draws {power:.0f} W at {speed:.2f} m/s, the paper's {theirs.power:.0f} W at {theirs.speed:.2f} m/s: "
        f"power explains {power / theirs.power - 1.0:+.0%}, speed {theirs.speed / speed - 1.0:+.0%}.",
        calibrated=result.robot == "go1",
    )


def reduction_rows(
    robots: str, walked: Walks, variant: str, fit: Calibration, why: Mapping[tuple[float, float], str]
) -> list[Comparison]:
    """Rows of what SAL saves in a variant, with the spread of the ratio of both robots' COT over training seeds.

    ``why``: by condition; where none stands no robot arrived, and no row is made.
    """

    def reductions(cfg: ElectricalCfg) -> np.ndarray:
        cots = cots_of(walked, variant, cfg)
        return 100.0 * np.array([_reduced(cots, cots, cell) for cell in why])

    cots, made = cots_of(walked, variant, fit.cfg), []
    for cell, ours, error in zip(why, reductions(fit.cfg), fit.error(reductions), strict=True):
        after, before = (cots[robot, *cell] for robot in ("mr_go_sal", "mr_go"))
        n = min(after["n"], before["n"])
        sd = 100.0 * ratio_sd((after["ours"], after["sd"]), (before["ours"], before["sd"])) if n > 1 else None
        theirs = [100.0 * value for value in paper.cot_reduction(*cell)]
        figure = {"ours": float(ours), "sd": sd, "n": n, "error": float(error), "error_free": fit.free}
        value = PaperValue(mean=theirs[0], sd=theirs[1], n=paper.WALKS)
        made.append(compare(f"{robots}, {paper.condition_name(*cell)}", REDUCTION, value, figure, why[cell]))
    return made


def _lost(saved: Saving) -> str:
    """The parts that take most of the saving away."""
    assert saved.paper is not None  # all four conditions are table 6's
    part = saved.saving_by_part
    lost = sorted((name for name in part if part[name] < -0.5), key=lambda name: part[name])
    text = ", ".join(f"{name.replace('_', ' ')} {part[name]:+.1f} W" for name in lost) or "nothing"
    return (
        f"The calves' copper saves {part['copper_calves']:+.1f} W of the {saved.paper['saving']:.0f} W the paper's "
        f"saving needs (at most {saved.bound['walking_copper']:.0f} W here, all of it gone while held). {text} take "
        "from it."
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


def carrying(results: Sequence[WalkResult], cfg: ElectricalCfg) -> str:
    """Extra power of MR_Go over Go1, with SAL off: a sentence."""
    powers = {(r.robot, *r.cell): mean_power(r, cfg) for r in results}
    more: dict[str, list[float]] = {"ours": [], "paper": []}
    for cell in paper.TABLE_7:
        ours = powers.get(("mr_go", *cell), math.nan) - powers.get(("go1", *cell), math.nan)
        if not math.isnan(ours):
            bare, loaded = (paper.TABLE_6[robot, *cell] for robot in ("go1", "mr_go"))
            more["ours"].append(ours)
            more["paper"].append(loaded.power - bare.power)
    if not more["ours"]:
        return "No condition in which both Go1 and MR_Go arrived."
    ours, theirs = (f"{min(watts):+.0f} to {max(watts):+.0f} W" for watts in more.values())
    return (
        f"Devices that are off cost their mass ({paper.MASS['mr_go'] - paper.MASS['go1']:.1f} kg) and their drag: "
        f"ours draws {ours} more with them, the paper's {theirs}."
    )


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
    lines, followed = [], {"paper": [], "ours": []}
    for saved in savings:
        measured, bound = (hardware[saved.cell][f"{name}_relative"] for name in ("paper_saving", "bound"))
        ours = saved.bound["our_standing"] / powers[saved.cell]
        shown = measured, bound, simulation[saved.cell]["bound_relative"], saved.power_reduction, ours
        lines.append([saved.name, *(f"{100.0 * value:.1f}" for value in shown)])
        followed["paper"].append(measured / bound)
        followed["ours"].append(saved.power_reduction / ours)
    text = "No condition in which both MR_Go and MR_Go-SAL arrived."
    if lines:
        theirs, ours = (f"{min(ratios):.2f} to {max(ratios):.2f}" for ratios in followed.values())
        text = (
            f"By the paper's own standing ({consistency.STANDING:.1f} W) and its hardware's activation, holding saves "
            f"{', '.join(row[2] for row in lines)} % of MR_Go's power under a steady load. Over the conditions the "
            f"paper's saving is {theirs} times its closed form, ours {ours} times ours."
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
    return TextTable(title=title, head=head, rows=lines, id="closed_form"), text


def training_table(walked: Walks, cfg: ElectricalCfg) -> TextTable:
    """Gains by the device and by the training: each robot's policies on either robot, and without a price on power."""
    free = walked.calibrated("no_power_price").cfg
    own, stuck, swapped = (cots_of(walked, name, cfg) for name in ("both", "constraint_coupling", "swapped_policies"))
    without = cots_of(walked, "no_power_price", free)
    columns = {
        "each robot its own policies": (own, own),
        "the same, a device that sticks": (stuck, stuck),
        "both MR_Go's": (swapped, own),
        "both MR_Go-SAL's": (own, swapped),
        "both table 2's, no price on power": (without, without),
    }
    lines = []
    for cell in dict.fromkeys(r.cell for r in walked.both):
        reduced = [_reduced(after, before, cell) for after, before in columns.values()]
        shown = ["no robot arrived" if math.isnan(value) else f"{100.0 * value:.1f}" for value in reduced]
        lines.append([paper.condition_name(*cell), *shown])
    title = (
        "Reduction of COT by SAL [%] by the policies that walk. The last column is calibrated on Go1's walks with "
        f"theirs (electronics {free.electronics:.1f} W, winding {free.winding_resistance:.3f} Ohm, drive friction "
        f"{free.drive_friction:.2f} N·m)"
    )
    return TextTable(title=title, head=["condition", *columns], rows=lines, id="training")


def sensitivity(walked: Walks, cfg: ElectricalCfg) -> TextTable:
    """Reductions with one electrical number at the ends of its range, the others fitted to Go1's rows each time.

    An assumed number stands at the ends of its plausible range, a fitted one at those of its 95 % interval. Nothing is
    simulated again.
    """
    varied = walk_figures.sensitivity(walked.both, walked.calibration_rows(), cfg)
    nominal = {saved.name: saved.cot_reduction for saved in walk_figures.savings(walked.both, cfg)}
    theirs = consistency.check()["cot_reduction"]

    def line(name: str, value: str, found: Mapping[str, float]) -> list[str]:
        return [name, value, *(f"{100.0 * found[cell]:.1f}" for cell in nominal)]

    lines = [line("fitted", "", nominal)]
    lines += [line(name, f"{end['value']:.4g}", end) for name, ends in varied.items() for end in ends]
    lines.append(line("paper", "", theirs))
    title = "Reduction of COT by SAL [%] with one electrical number at the ends of its range"
    return TextTable(title=title, head=["number", "value", *nominal], rows=lines, id="electrical")


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
        measure=rows("table6", REDUCTION[0], *(f"SAL against MR_Go, {cell}" for cell in CELLS)),
        effect=True,
        why="About half of it is the training's: with equal policies the device alone saves less.",
    ),
)
