"""What every assumed electrical number moves in table 6: power recomputed from the walks, nothing simulated again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from mrwarp import paper
from mrwarp.electrical import consistency
from mrwarp.electrical.calibrate import MOTION_LOSS, Calibration, CalibrationError, calibrate
from mrwarp.evaluate import walk_figures
from mrwarp.reproduce import walking
from mrwarp.reproduce.experiment import Experiment, Findings, Job, Table


def compute(job: Job) -> Findings:
    """Reduction of COT per condition with one number at the ends of its range, calibrated anew on Go1 each time.

    Raises:
        CalibrationError: Go1 arrived in fewer than two conditions.
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
    motion, said = loss_of_motion(walks, fit, theirs)
    tables += motion
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
            Table(title=f"Reduction of COT by SAL [%], {branches}", head=["number", "value", *nominal], rows=rows)
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
            "Each assumed number stands at the ends of its plausible range, with electronics and winding resistance "
            "calibrated anew on Go1's rows; each of these two stands at the ends of its 95 % interval, with the other "
            f"one calibrated anew.{span}",
            f"Standing, the paper's Go1 draws {consistency.STANDING:.1f} W more than its MR_Go on held calves, ours "
            f"{standing:.1f} W: the calves' copper {held:.1f} W, less coils and controllers. With calves without extra "
            f"gear it would be {ungeared:.1f} W.",
            said,
            *walking.all_arrivals(walks, "both", "holding", "same_gait", "sticking"),
        ],
        tables=tables, figures=figures,
    )  # fmt: skip


def budget(savings: list[dict[str, Any]], conditions: list[dict[str, Any]]) -> Table:
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
    return Table(title="What there is to save, and what SAL changes besides", head=head, rows=rows)


def same_gait(alone: list[dict[str, Any]], stuck: list[dict[str, Any]]) -> Table:
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
    return Table(title="Holding alone on MR_Go's gait, by the explicit torque of eq. 19", head=head,
                 rows=rows)  # fmt: skip


def loss_of_motion(walks: walking.Walks, fit: Calibration, theirs: dict[str, float]) -> tuple[list[Table], str]:
    """What Go1's rows say of a power that is drawn whenever the robot walks: a third number beside the model's two.

    The model is not extended by it: what such a loss follows has to be known before it is one.

    Args:
        walks: The walks.
        fit: The calibration of the model.
        theirs: The paper's reductions of COT by condition.

    Returns:
        The table, none if too few of Go1's walks arrived, and what to say of it.
    """
    try:
        third = calibrate(walks.calibration_rows(), fit.cfg, motion=True)
    except CalibrationError as error:
        return [], f"A loss of motion: {error}."
    fits = (fit, third)
    reductions = [
        {walk_figures.name(s): s["cot_reduction"] for s in walk_figures.savings(walks.both, f.walking)} for f in fits
    ]
    numbers = {"electronics": ("electronics [W]", 1), "winding_resistance": ("winding [Ohm]", 3)}
    rows = [
        [title, *(f"{getattr(f.cfg, name):.{digits}f} ± {f.half_width[name]:.{digits}f}" for f in fits), ""]
        for name, (title, digits) in numbers.items()
    ]
    loss, half = third.motion_loss, third.half_width[MOTION_LOSS]
    rows.append(["loss while walking [W]", "none", f"{loss:.1f} ± {half:.1f}", ""])
    rows += [[name, *(f"{f.fitted[name]:.0f}" for f in fits), f"{fit.measured[name]:.0f}"] for name in fit.measured]
    rows.append(["their mismatch (RMS) [W]", *(f"{f.rmse:.1f}" for f in fits), ""])
    rows += [
        [f"reduction of COT, {cell} [%]", *(f"{100.0 * found[cell]:.1f}" for found in reductions),
         f"{100.0 * theirs[cell]:.1f}"]
        for cell in reductions[0]
    ]  # fmt: skip
    title = "What Go1's rows say of a loss of motion (± 95 %), and what SAL would then save"
    text = (
        f"A third number, a power that is drawn whenever the robot walks, is {loss:.0f} ± {half:.0f} W (95 %) by Go1's "
        f"rows and brings them from {fit.rmse:.1f} to {third.rmse:.1f} W (RMS). It is not in the model: with it the "
        f"reductions would be {', '.join(f'{100.0 * value:.1f}' for value in reductions[1].values())} %."
    )
    return [Table(title=title, head=["", "the model", "with a loss of motion", "paper"], rows=rows)], text


def _told(end: tuple[float, str, float, str]) -> str:
    """Which number made a reduction."""
    _, name, value, branches = end
    return f"{name} = {value:.3g}, {branches}"


EXPERIMENT = Experiment(name="electrical", compute=compute, needs=("walks",))
