"""Table 6: cost of transport of three robots; Go1's rows calibrate the electrical model, the others are predicted."""

from __future__ import annotations

import math
from typing import Any

from mrwarp import paper
from mrwarp.energy import consistency
from mrwarp.energy.power import CALIBRATED, ElectricalCfg, battery_power
from mrwarp.paper import PaperValue
from mrwarp.reproduce import walks as walking
from mrwarp.reproduce.experiment import Comparison, Experiment, Findings, Job, TextTable, over_seeds
from mrwarp.reproduce.walks import Walks
from mrwarp.study.plan import HIGH_POWER_PRICE, POWER_PRICE
from mrwarp.trials import walk_figures
from mrwarp.trials.statistics import ratio_sd
from mrwarp.trials.walk_trials import WalkResult

Cots = dict[tuple[str, float, float], dict[str, Any]]
"""COT over training seeds, see :func:`over_seeds`, by robot, payload [kg] and commanded speed [m/s]."""


def compute(job: Job) -> Findings:
    """COT per robot and condition, what SAL saves and where the rest goes.

    Raises:
        CalibrationError: Go1 arrived in fewer than two conditions.
    """
    walks = walking.read(job.folders["walks"])
    fit = walks.calibrated()
    conditions = [walk_figures.row(result, fit.cfg) for result in walks.both]
    standing = {name: float(battery_power(joints, fit.cfg).total) for name, joints in walks.standing.items()}
    saving = walk_figures.standing_saving(walks.standing["go1"], walks.standing["mr_go_hold"], fit.cfg)
    savings = walk_figures.savings(walks.both, fit.cfg, saving)
    plain = [r for r in walks.both if r.robot != "mr_go_sal"]
    alone = walk_figures.savings([*plain, *walks.holding], fit.cfg, saving)
    cots, cots_sticking = (_cots(walks, variant, fit.cfg) for variant in ("both", "sticking"))
    rows = [_cot(condition, cots) for condition in conditions]
    rows += [_reduction(saved, _at(alone, saved), cots) for saved in savings]
    stuck = walk_figures.savings(walks.sticking, fit.cfg, saving)
    bounds, said = closed_form(savings, conditions)
    carried, told = carrying(conditions)
    rows += [_reduction_sticking(saved, cots_sticking) for saved in stuck]
    return Findings(
        rows=[row for row in rows if row is not None],
        claims=_claims(cots, walks.both)
        | {f"a device that sticks: {name}": holds for name, holds in _claims(cots_sticking, walks.sticking).items()},
        notes=[
            f"Go1's four rows and its {paper.MISSION_POWER['go1']['standby']:g} W of standing give {fit} "
            f"(95 %), to {fit.rmse:.1f} W (RMS). Every row of MR_Go and MR_Go-SAL is a prediction.",
            "Devices act by the paper's explicit torque (eqs. 6, 19), with which MR_Go-SAL's policies were trained; "
            "those of a device that sticks were trained with brakes that hold a calf still, and walk with them.",
            "The spread of a reduction is that of the ratio of two independent COTs, ours over training seeds, the "
            "paper's over its walks.",
            told,
            said,
            *walking.all_arrivals(walks, "both", "holding", "sticking", "crossed", "unpaid", "high"),
        ],
        tables=[carried, _parts(savings), bounds, _training(walks, fit.cfg)],
        figures={"savings": savings, "holding_alone": alone, "sticking": stuck, "standing": standing,
                 "conditions": conditions,
                 "calibration": {**{name: getattr(fit.cfg, name) for name in CALIBRATED},
                                 "half_width": fit.half_width, "rmse": fit.rmse}},
    )  # fmt: skip


def _cot(condition: dict[str, Any], cots: Cots) -> Comparison | None:
    """Comparison of a robot in a condition; None where the paper has none."""
    reference = condition["paper"]
    if reference is None:
        return None
    robot, payload, command = (condition[key] for key in ("robot", "payload", "command"))
    power = condition["power"]["mean"]
    why = (
        f"Ours draws {power:.0f} W at {condition['speed']['mean']:.2f} m/s, the paper's {reference['power']:.0f} W at "
        f"{reference['speed']:.2f} m/s: power explains {power / reference['power'] - 1.0:+.0%}, speed "
        f"{reference['speed'] / condition['speed']['mean'] - 1.0:+.0%}."
    )
    return Comparison(
        condition=f"{paper.NAMES[robot]}, {paper.condition_name(payload, command)}", quantity="COT",
        unit="", paper=PaperValue(mean=reference["cot"], sd=reference["sd"]), **cots[robot, payload, command],
        calibrated=condition["calibrated"], why=why,
    )  # fmt: skip


def _cots(walks: Walks, variant: str, cfg: ElectricalCfg) -> Cots:
    """Cost of transport of each robot and condition in a variant's walks."""
    return {
        (r.robot, r.payload, r.command): over_seeds(walk_figures.cot(r, cfg), walks.seed_of(r, variant))
        for r in getattr(walks, variant)
    }  # fmt: skip


def _reduced(after: Cots, before: Cots, cell: tuple[float, float]) -> float:
    """How much lower MR_Go-SAL's COT is than MR_Go's, relative; NaN where one of them did not arrive."""
    return 1.0 - after["mr_go_sal", *cell]["ours"] / before["mr_go", *cell]["ours"]


def _claims(cots: Cots, results: list[WalkResult]) -> dict[str, bool]:
    """Section 6.4's claims on the reduction of COT by SAL; False where a condition is missing."""
    whole = walking.complete([result for result in results if result.robot != "go1"])
    reductions = {cell: _reduced(cots, cots, cell) for cell in dict.fromkeys(key[1:] for key in cots)}
    least, most = paper.COT_REDUCTION
    return {
        "SAL lowers COT in all four conditions": whole and min(reductions.values()) > 0.0,
        f"by at least {100.0 * least:.1f} %": whole and min(reductions.values()) >= least,
        f"by at most {100.0 * most:.1f} %": whole and max(reductions.values()) <= most,
        "at 0.3 m/s no less with payload than without": whole and reductions[3.0, 0.3] >= reductions[0.0, 0.3],
    }


def _reduction(saved: dict[str, Any], alone: dict[str, Any] | None, cots: Cots) -> Comparison:
    """What SAL saves against MR_Go, with the part that takes the most away as the reason."""
    part = saved["saving_by_part"]
    need = saved["paper"]["saving"]
    lost = sorted((name for name in part if part[name] < -0.5), key=lambda name: part[name])
    text = ", ".join(f"{_PARTS[name]} {part[name]:+.1f} W" for name in lost) or "nothing"
    why = (
        f"The calves' copper saves {part['copper_calves']:+.1f} W of the {need:.0f} W the paper's saving needs "
        f"(at most {saved['bound']['walking_copper']:.0f} W here, all of it gone while held); {text} take from it; "
        f"holding alone: {'no robot arrived' if alone is None else format(alone['cot_reduction'], '.1%')}."
    )
    return _reduction_row("SAL against MR_Go", saved, cots, why)


def _reduction_sticking(saved: dict[str, Any], cots: Cots) -> Comparison:
    """What SAL saves with brakes that stick, with the paper's held share beside ours."""
    held = paper.TABLE_7[int(saved["payload"]), saved["command"]]["hardware"]
    why = (
        f"Trained and walked with brakes that stick: the calves are held for {saved['hold_share']:.1%} of the time, "
        f"the paper's hardware for {held:.1%}. {saved['saving']:.0f} W are saved, the paper's "
        f"{saved['paper']['saving']:.0f} W."
    )
    return _reduction_row("SAL against MR_Go, a device that sticks", saved, cots, why)


def _reduction_row(robots: str, saved: dict[str, Any], cots: Cots, why: str) -> Comparison:
    """Comparison of what SAL saves in a condition, with the spread of the ratio of both robots' COT."""
    cell = saved["payload"], saved["command"]
    after, before = (cots[robot, *cell] for robot in ("mr_go_sal", "mr_go"))
    seeds = min(after["n"], before["n"])
    sd = 100.0 * ratio_sd((after["ours"], after["sd"]), (before["ours"], before["sd"])) if seeds > 1 else None
    theirs = saved["paper"]
    return Comparison(
        condition=f"{robots}, {walk_figures.name(saved)}",
        quantity="reduction of COT", unit="%",
        paper=PaperValue(mean=100.0 * theirs["cot_reduction"], sd=100.0 * theirs["cot_reduction_sd"]),
        ours=100.0 * _reduced(cots, cots, cell), sd=sd, n=seeds, digits=1, why=why,
    )  # fmt: skip


_PARTS = {
    "copper_calves": "calves", "copper_hips_thighs": "hips and thighs", "electronics": "electronics",
    "drive_friction": "drive friction", "mechanical": "mechanical power", "regenerated": "regenerated power",
    "coil": "coils", "controllers": "current controllers",
}  # fmt: skip


def _parts(savings: list[dict[str, Any]]) -> TextTable:
    return TextTable(
        title="What SAL saves, by part of the battery's power [W]; negative = draws more",
        head=["condition", *_PARTS.values(), "sum", "paper"],
        rows=[
            [walk_figures.name(s),
             *(f"{s['saving_by_part'][name]:+.1f}" for name in _PARTS),
             f"{s['saving']:+.1f}", f"{s['paper']['saving']:+.1f}"]
            for s in savings
        ],
    )  # fmt: skip


def carrying(conditions: list[dict[str, Any]]) -> tuple[TextTable, str]:
    """What MR_Go draws more than Go1, with SAL off: mass and drag of the devices; the paper's and ours.

    Args:
        conditions: See :func:`walk_figures.row`.

    Returns:
        The table, with the spread of the paper's difference as its COTs have it, and a sentence.
    """
    powers = {(c["robot"], c["payload"], c["command"]): c["power"]["mean"] for c in conditions if c["paper"]}
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
    ends = {source: f"{min(found):+.0f} to {max(found):+.0f} W" for source, found in more.items() if found}
    mass = paper.MASS["mr_go"] - paper.MASS["go1"]
    text = (
        f"Devices that are off cost their mass ({mass:.1f} kg) and their drag: ours draws {ends['ours']} more with "
        f"them, the paper's {ends['paper']}."
    ) if ends else "No condition in which both Go1 and MR_Go arrived."  # fmt: skip
    return TextTable(title="What MR_Go draws more than Go1 [W]", head=["condition", "ours", "paper"], rows=rows), text


def closed_form(savings: list[dict[str, Any]], conditions: list[dict[str, Any]]) -> tuple[TextTable, str]:
    """What holding saves by closed form, from standing and the held share, beside what is saved: the paper's and ours.

    Args:
        savings: See :func:`walk_figures.savings`, with our standing saving.
        conditions: See :func:`walk_figures.row`.

    Returns:
        The table, all figures in percent of MR_Go's power, and a note on how far either saving follows the form.
    """
    theirs = {
        source: {(row["payload"], row["command"]): row for row in consistency.paper_bounds(source)}
        for source in ("hardware", "simulation")
    }
    powers = {(c["payload"], c["command"]): c["power"]["mean"] for c in conditions if c["robot"] == "mr_go"}
    rows, followed = [], {"paper": [], "ours": []}
    for saved in savings:
        cell = saved["payload"], saved["command"]
        measured, simulated = theirs["hardware"][cell]["paper_saving_relative"], saved["power_reduction"]
        hardware, simulation = (theirs[source][cell]["bound_relative"] for source in ("hardware", "simulation"))
        ours = saved["bound"]["our_standing"] / powers[cell]
        shown = measured, hardware, simulation, simulated, ours
        rows.append([walk_figures.name(saved), *(f"{100.0 * value:.1f}" for value in shown)])
        followed["paper"].append(measured / hardware)
        followed["ours"].append(simulated / ours)
    head = ["condition", "the paper saves", "closed form: its standing, its hardware's shares",
            "its standing, its simulation's shares", "ours saves", "closed form: our standing, our shares"]  # fmt: skip
    ends = {source: f"{min(ratios):.2f} to {max(ratios):.2f}" for source, ratios in followed.items() if ratios}
    least, most = (theirs["hardware"][cell] for cell in ((0, 0.5), (3, 0.3)))
    grown = most["bound_relative"] / least["bound_relative"]
    by_load = grown * least["share"] / most["share"]
    text = (
        f"By the paper's own standing ({consistency.STANDING:.1f} W) and its hardware's activation, holding saves "
        f"{', '.join(row[2] for row in rows)} % of MR_Go's power under a steady load: over the conditions the paper's "
        f"saving is {ends['paper']} times its closed form, ours {ends['ours']} times ours. What the former scatters, "
        f"neither activation nor load explains. From {paper.condition_name(0, 0.5)} to {paper.condition_name(3, 0.3)} "
        f"the paper's closed form grows by a factor of {grown:.2f}, {by_load:.2f} of it by load and power alone, while "
        f"its reductions of COT lie within one of {paper.COT_REDUCTION[1] / paper.COT_REDUCTION[0]:.2f}."
    ) if ends else "No condition in which both MR_Go and MR_Go-SAL arrived."  # fmt: skip
    title = "What holding saves by closed form, 4 a S (m/m0)^2, beside what is saved [% of MR_Go's power]"
    return TextTable(title=title, head=head, rows=rows), text


def _training(walks: Walks, cfg: ElectricalCfg) -> TextTable:
    """What the device gives and what the training gives: each robot's policies on either robot, and other prices."""
    unpaid, high = (walks.calibrated_on(results).cfg for results in (walks.unpaid, walks.high))

    own, stuck, crossed = (_cots(walks, variant, cfg) for variant in ("both", "sticking", "crossed"))
    plain, dear = _cots(walks, "unpaid", unpaid), _cots(walks, "high", high)
    cells = list(dict.fromkeys((r.payload, r.command) for r in walks.both))

    def lower(after: Cots, before: Cots, cell: tuple[float, float]) -> str:
        reduction = _reduced(after, before, cell)
        return "no robot arrived" if math.isnan(reduction) else f"{100.0 * reduction:.1f}"

    lines = [
        [paper.condition_name(*cell), lower(own, own, cell), lower(stuck, stuck, cell), lower(crossed, own, cell),
         lower(own, crossed, cell), lower(plain, plain, cell), lower(dear, dear, cell)]
        for cell in cells
    ]  # fmt: skip
    head = ["condition", "each robot its own policies", "the same, a device that sticks", "both MR_Go's",
            "both MR_Go-SAL's", "both table 2's, no price on power, a device that sticks",
            f"each its own, a price of {HIGH_POWER_PRICE:g} instead of {POWER_PRICE:g} per watt"]  # fmt: skip
    return TextTable(
        title="Reduction of COT by SAL [%] by the policies that walk; the last two columns are calibrated on Go1's "
        f"walks with theirs (electronics {unpaid.electronics:.1f} and {high.electronics:.1f} W, winding "
        f"{unpaid.winding_resistance:.3f} and {high.winding_resistance:.3f} Ohm, drive friction "
        f"{unpaid.drive_friction:.2f} and {high.drive_friction:.2f} N·m)",
        head=head, rows=lines,
    )  # fmt: skip


def _at(savings: list[dict[str, Any]], condition: dict[str, Any]) -> dict[str, Any] | None:
    """What is saved in the same condition; None if a robot did not arrive there."""
    same = [s for s in savings if all(s[key] == condition[key] for key in ("payload", "command"))]
    return same[0] if same else None


EXPERIMENT = Experiment(name="table6", compute=compute, needs=("walks",))
