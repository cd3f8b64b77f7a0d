"""What every assumed electrical number moves in table 6: power recomputed from the walks, nothing simulated again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from mrwarp import paper
from mrwarp.energy import consistency
from mrwarp.energy.calibrate import Calibration, calibrate
from mrwarp.energy.power import CALIBRATED
from mrwarp.reproduce import walks as walking
from mrwarp.reproduce.experiment import Experiment, Findings, Job, TextTable
from mrwarp.trials import walk_figures


def compute(job: Job) -> Findings:
    """Reduction of COT per condition with one number at the ends of its range, calibrated anew on Go1 each time.

    Raises:
        CalibrationError: Go1 arrived in fewer than three conditions.
    """
    walks = walking.read(job.folders["walks"])
    fit = walks.calibrated()
    direct = calibrate(walks.calibration_rows(), replace(fit.cfg, calf_gear=1.0)).cfg
    others = [result for result in walks.both if result.robot != "mr_go_sal"]
    motors, devices = walks.standing["go1"], walks.standing["mr_go_hold"]
    standing, ungeared = (walk_figures.standing_saving(motors, devices, cfg) for cfg in (fit.cfg, direct))
    held = walk_figures.parts(motors, fit.cfg)["copper_calves"] - walk_figures.parts(devices, fit.cfg)["copper_calves"]
    savings = walk_figures.savings(walks.both, fit.cfg, standing)
    tables = [budget(savings, [walk_figures.row(result, fit.cfg) for result in walks.both])]
    alone, stuck = (walk_figures.savings(results, fit.cfg) for results in ([*others, *walks.same_gait], walks.sticking))
    tables.append(same_gait(alone, stuck))
    figures: dict[str, Any] = {}
    theirs = consistency.check()["cot_reduction"]
    friction, said = drive_friction(walks, fit, theirs)
    tables.append(friction)
    for branches, results in (("both branches", walks.both), ("holding alone", [*others, *walks.holding])):
        found = walk_figures.sensitivity(results, walks.calibration_rows(), fit.cfg)
        nominal = {walk_figures.name(s): s["cot_reduction"] for s in walk_figures.savings(results, fit.cfg)}
        rows = [["calibrated", "", *(f"{100.0 * value:.1f}" for value in nominal.values())]]
        for name, ends in found.items():
            rows += [
                [name, f"{end['value']:.4g}", *(f"{100.0 * end[cell]:.1f}" for cell in nominal)] for end in ends
            ]  # fmt: skip
        rows.append(["paper", "", *(f"{100.0 * theirs[cell]:.1f}" for cell in nominal)])
        tables.append(
            TextTable(title=f"Reduction of COT by SAL [%], {branches}", head=["number", "value", *nominal], rows=rows)
        )
        figures[branches] = {"nominal": nominal, "varied": found}
    ends = [
        (end[cell], name, end["value"], branches)
        for branches, found in figures.items() for name, ends in found["varied"].items() for end in ends
        for cell in found["nominal"]
    ]  # fmt: skip
    span = (
        f" The reductions of all cells lie between {100.0 * min(ends)[0]:.1f} % ({_told(min(ends))}) and "
        f"{100.0 * max(ends)[0]:.1f} % ({_told(max(ends))})."
    ) if ends else ""  # fmt: skip
    return Findings(
        notes=[
            "Each assumed number stands at the ends of its plausible range, with the calibrated ones fitted "
            "anew to Go1's rows; each of these stands at the ends of its 95 % interval, with the others fitted "
            f"anew.{span}",
            f"Standing, the paper's Go1 draws {consistency.STANDING:.1f} W more than its MR_Go on held calves, ours "
            f"{standing:.1f} W: the calves' copper {held:.1f} W, less coils and controllers. With calves without extra "
            f"gear it would be {ungeared:.1f} W.",
            said,
            *walking.all_arrivals(walks, "both", "holding", "same_gait", "sticking"),
        ],
        tables=tables, figures=figures,
    )  # fmt: skip


def budget(savings: list[dict[str, Any]], conditions: list[dict[str, Any]]) -> TextTable:
    """The calves' copper of MR_Go beside what the paper's saving would need of it, and what SAL costs elsewhere."""
    by_key = {(c["robot"], c["payload"], c["command"]): c for c in conditions}
    rows = []
    for s in savings:
        off, on = (by_key[robot, s["payload"], s["command"]] for robot in ("mr_go", "mr_go_sal"))
        copper, part = off["parts"]["copper_calves"], s["saving_by_part"]
        rows.append([
            walk_figures.name(s), f"{copper:.0f}", f"{100.0 * copper / off['power']['mean']:.0f} %",
            f"{100.0 * s['paper']['saving'] / copper:.0f} %", f"{100.0 * part['copper_calves'] / copper:.0f} %",
            f"{s['bound']['our_standing']:.0f}", f"{s['bound']['paper_standing']:.0f}", f"{s['paper']['saving']:.0f}",
            f"{100.0 * (on['speed']['mean'] / off['speed']['mean'] - 1.0):+.1f} %",
            f"{1e3 * (on['height']['mean'] - off['height']['mean']):+.0f}",
        ])  # fmt: skip
    head = [
        "condition", "MR_Go's calf copper [W]", "of its power", "the paper's saving is", "SAL saves",
        "closed form, our standing [W]", "closed form, the paper's [W]", "paper saved [W]", "speed", "height [mm]",
    ]  # fmt: skip
    return TextTable(title="What there is to save, and what SAL changes besides", head=head, rows=rows)


def same_gait(alone: list[dict[str, Any]], stuck: list[dict[str, Any]]) -> TextTable:
    """What SAL saves with the holding torque of eq. 19 alone, which leaves MR_Go's gait as it is."""
    trained = {walk_figures.name(s): f"{100.0 * s['hold_share']:.1f} %" for s in stuck}
    rows = [
        [name := walk_figures.name(e), f"{100.0 * e['hold_share']:.1f} %", trained.get(name, "no robot arrived"),
         f"{100.0 * paper.TABLE_7[int(e['payload']), e['command']]['simulation']:.1f} %",
         f"{e['saving_by_part']['copper_calves']:+.1f}", f"{e['saving_by_part']['copper_hips_thighs']:+.1f}",
         f"{100.0 * e['cot_reduction']:.1f} %"]
        for e in alone
    ]  # fmt: skip
    head = ["condition", "held", "held, trained, a device that sticks", "held, paper", "calves save [W]",
            "hips and thighs save [W]", "reduction of COT"]  # fmt: skip
    return TextTable(title="Holding alone on MR_Go's gait, by the explicit torque of eq. 19", head=head,
                 rows=rows)  # fmt: skip


def drive_friction(walks: walking.Walks, fit: Calibration, theirs: dict[str, float]) -> tuple[TextTable, str]:
    """What drive friction explains: Go1's rows, and the predicted reductions of COT, without it and with it.

    Args:
        walks: The walks.
        fit: The calibration.
        theirs: The paper's reductions of COT by condition.
    """
    name = "drive_friction"
    without = calibrate(walks.calibration_rows(), replace(fit.cfg, **{name: 0.0}), hold=(name,))
    fits = (without, fit)
    reductions = [
        {walk_figures.name(s): s["cot_reduction"] for s in walk_figures.savings(walks.both, f.cfg)} for f in fits
    ]
    rows = [
        [f"{spec.name} [{spec.unit}]", *(f.interval(spec.name) for f in fits), ""]
        for spec in fit.cfg.specs() if spec.name in CALIBRATED
    ]  # fmt: skip
    rows += [[row, *(f"{f.fitted[row]:.0f}" for f in fits), f"{fit.measured[row]:.0f}"] for row in fit.measured]
    rows.append(["their mismatch (RMS) [W]", *(f"{f.rmse:.1f}" for f in fits), ""])
    rows += [
        [f"reduction of COT, {cell} [%]", *(f"{100.0 * found[cell]:.1f}" for found in reductions),
         f"{100.0 * theirs[cell]:.1f}"]
        for cell in reductions[0]
    ]  # fmt: skip
    watts = walk_figures.drive_friction(walks.both, fit.cfg)
    text = (
        f"Drive friction is {fit.interval(name)} N·m (95 %) by Go1's rows, "
        f"{min(watts):.0f} to {max(watts):.0f} W while walking, and brings them from {without.rmse:.1f} to "
        f"{fit.rmse:.1f} W (RMS). Without it what holding saves is overrated: all that load does not explain is put "
        "down to copper."
    )
    title = "What drive friction explains (± 95 %), Go1's rows [W] and what SAL saves"
    return TextTable(title=title, head=["", "without", "with drive friction", "paper"], rows=rows), text


def _told(end: tuple[float, str, float, str]) -> str:
    """Which number made a reduction."""
    _, name, value, branches = end
    return f"{name} = {value:.3g}, {branches}"


EXPERIMENT = Experiment(name="electrical", compute=compute, needs=("walks",))
