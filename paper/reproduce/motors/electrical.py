"""Effect of every assumed electrical number on table 6: power recomputed from the walks, nothing simulated again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from mrwarp import paper
from mrwarp.energy import consistency
from mrwarp.energy.model_numbers import CALIBRATED, Calibration, calibrate
from mrwarp.energy.power import ElectricalCfg
from mrwarp.trials import walk_figures
from mrwarp.trials.walk_figures import Saving, mean, mean_power, parts, standing_saving
from mrwarp.trials.walk_trials import WalkResult
from paper.reproduce import walks
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import Findings, TextTable
from paper.reproduce.walks import Walks


def compute(job: Job) -> Findings:
    """Reduction of COT per condition with one number at the ends of its range, calibrated again on Go1 each time.

    Raises:
        ValueError: Go1 arrived in fewer than three conditions.
    """
    walked = walks.read(job)
    fit = walked.calibrated()
    others = [result for result in walked.both if result.robot != "mr_go_sal"]
    motors, devices = walked.standing["go1"], walked.standing["mr_go_hold"]
    direct = calibrate(walked.calibration_rows(), replace(fit.cfg, calf_gear=1.0)).cfg
    standing, ungeared = (standing_saving(motors, devices, cfg) for cfg in (fit.cfg, direct))
    held = parts(motors, fit.cfg)["copper_calves"] - parts(devices, fit.cfg)["copper_calves"]
    savings = walk_figures.savings(walked.both, fit.cfg, standing)
    same, stuck = (
        walk_figures.savings(results, fit.cfg)
        for results in ([*others, *walked.results["same_gait"]], walked.results["constraint_coupling"])
    )
    theirs = consistency.check()["cot_reduction"]
    friction, said = drive_friction(walked, fit, theirs)
    tables = [budget(savings, walked.both, fit.cfg), same_gait(same, stuck), friction]
    figures: dict[str, Any] = {}
    ends = []
    for branches, results in (("both branches", walked.both), ("holding alone", others + walked.results["holding"])):
        varied = walk_figures.sensitivity(results, walked.calibration_rows(), fit.cfg)
        nominal = {saved.name: saved.cot_reduction for saved in walk_figures.savings(results, fit.cfg)}
        rows = [["calibrated", "", *map(_percent, nominal.values())]]
        for name, entries in varied.items():
            rows += [[name, f"{end['value']:.4g}", *(_percent(end[cell]) for cell in nominal)] for end in entries]
            ends += [(end[cell], name, end["value"], branches) for end in entries for cell in nominal]
        rows.append(["paper", "", *(_percent(theirs[cell]) for cell in nominal)])
        title = f"Reduction of COT by SAL [%], {branches}"
        name = branches.replace(" ", "_")
        tables.append(TextTable(title=title, head=["number", "value", *nominal], rows=rows, id=name))
        figures[branches] = {"nominal": nominal, "varied": varied}
    span = ""
    if ends:
        low, high = (
            f"{100.0 * share:.1f} % ({name} = {value:.3g}, {branches})"
            for share, name, value, branches in (min(ends), max(ends))
        )
        span = f" The reductions of all cells lie between {low} and {high}."
    return Findings(
        notes=[
            "Each assumed number stands at the ends of its plausible range, with the calibrated ones fitted "
            "again to Go1's rows. Each of these stands at the ends of its 95 % interval, with the others fitted "
            f"again.{span}",
            f"Standing, the paper's Go1 draws {consistency.STANDING:.1f} W more than its MR_Go on held calves, ours "
            f"{standing:.1f} W: the calves' copper {held:.1f} W, less coils and controllers. With calves without extra "
            f"gear it would be {ungeared:.1f} W.",
            said,
            *walked.arrivals("both", "holding", "same_gait", "constraint_coupling"),
        ],
        tables=tables,
        figures=figures,
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f}"


def budget(savings: Sequence[Saving], results: Sequence[WalkResult], cfg: ElectricalCfg) -> TextTable:
    """The calves' copper of MR_Go next to what the paper's saving would need of it, and what SAL costs elsewhere."""
    walked = {(r.robot, *r.cell): r for r in results}
    head = [
        "condition",
        "MR_Go's calf copper [W]",
        "of its power",
        "the paper's saving is",
        "SAL saves",
        "closed form, our standing [W]",
        "closed form, the paper's [W]",
        "paper saved [W]",
        "speed",
        "height [mm]",
    ]
    rows = []
    for saved in savings:
        assert saved.paper is not None  # all four conditions are table 6's
        off, on = (walked[robot, saved.payload, saved.command] for robot in walks.SAL)
        copper = parts(off.joints, cfg)["copper_calves"]
        shares = copper / mean_power(off, cfg), saved.paper["saving"] / copper
        watts = saved.bound["our_standing"], saved.bound["paper_standing"], saved.paper["saving"]
        rows.append(
            [
                saved.name,
                f"{copper:.0f}",
                *(f"{100.0 * share:.0f} %" for share in (*shares, saved.saving_by_part["copper_calves"] / copper)),
                *(f"{value:.0f}" for value in watts),
                f"{100.0 * (mean(on.speed) / mean(off.speed) - 1.0):+.1f} %",
                f"{1e3 * (mean(on.motion['height']) - mean(off.motion['height'])):+.0f}",
            ]
        )
    return TextTable(title="What there is to save, and other changes by SAL", head=head, rows=rows)


def same_gait(alone: Sequence[Saving], stuck: Sequence[Saving]) -> TextTable:
    """Saving by SAL with the holding torque of eq. 19 alone, which leaves MR_Go's gait as it is."""
    trained = {saved.name: f"{_percent(saved.hold_share)} %" for saved in stuck}
    head = [
        "condition",
        "held",
        "held, trained, a device that sticks",
        "held, paper",
        "calves save [W]",
        "hips and thighs save [W]",
        "reduction of COT",
    ]
    rows = [
        [
            saved.name,
            f"{_percent(saved.hold_share)} %",
            trained.get(saved.name, "no robot arrived"),
            f"{_percent(paper.TABLE_7[int(saved.payload), saved.command]['simulation'])} %",
            f"{saved.saving_by_part['copper_calves']:+.1f}",
            f"{saved.saving_by_part['copper_hips_thighs']:+.1f}",
            f"{_percent(saved.cot_reduction)} %",
        ]
        for saved in alone
    ]
    return TextTable(title="Holding alone on MR_Go's gait, by the explicit torque of eq. 19", head=head, rows=rows)


def drive_friction(walked: Walks, fit: Calibration, theirs: dict[str, float]) -> tuple[TextTable, str]:
    """Effect of drive friction: Go1's rows, and the predicted reductions of COT, without it and with it.

    ``theirs`` are the paper's reductions of COT by condition.
    """
    name = "drive_friction"
    without = calibrate(walked.calibration_rows(), replace(fit.cfg, **{name: 0.0}), hold=(name,))
    fits = (without, fit)
    reductions = [{saved.name: saved.cot_reduction for saved in walk_figures.savings(walked.both, f.cfg)} for f in fits]
    units = {spec.name: spec.unit for spec in fit.cfg.specs()}
    rows = [
        [f"{number} [{units[number]}]", *(f.interval(number) for f in fits), ""] for number in CALIBRATED["electrical"]
    ]
    rows += [[row, *(f"{f.fitted[row]:.0f}" for f in fits), f"{fit.measured[row]:.0f}"] for row in fit.measured]
    rows.append(["their mismatch (RMS) [W]", *(f"{f.rmse:.1f}" for f in fits), ""])
    rows += [
        [f"reduction of COT, {cell} [%]", *(_percent(found[cell]) for found in reductions), _percent(theirs[cell])]
        for cell in reductions[0]
    ]
    watts = [parts(result.joints, fit.cfg)[name] for result in walked.both if len(result.speed)]
    text = (
        f"Drive friction is {fit.interval(name)} N·m (95 %) by Go1's rows, "
        f"{min(watts):.0f} to {max(watts):.0f} W while walking, and brings them from {without.rmse:.1f} to "
        f"{fit.rmse:.1f} W (RMS). Without it what holding saves is overrated: all that load does not explain is put "
        "down to copper."
    )
    title = "What drive friction explains (± 95 %), Go1's rows [W] and what SAL saves"
    return TextTable(title=title, head=["", "without", "with drive friction", "paper"], rows=rows), text


EXPERIMENTS = (Experiment(name="electrical", compute=compute, needs=("walks",)),)
