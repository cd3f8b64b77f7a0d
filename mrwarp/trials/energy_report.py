"""Figures of a measured walk and of missions as a whole, and their printed tables, ours compared with the paper's."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from typing import Any

import numpy as np

from mrwarp import paper
from mrwarp.energy import consistency, model_numbers
from mrwarp.energy.power import JointLoad, battery_power
from mrwarp.runtime import NOT_KNOWN, figure_text, text_table
from mrwarp.trials import mission, walk_figures
from mrwarp.trials.mission import MissionCfg, MissionTrace
from mrwarp.trials.walk_trials import WalkCfg, WalkResult, robot_env, standing_load
from mrwarp.trials.walking import PAYLOAD_VARIANT, Policy, lost_lines


def can_calibrate(cfg: WalkCfg) -> bool:
    """Whether all four conditions of Go1 in table 6 are walked."""
    walked = {(robot, load, speed) for robot in cfg.robots for load in cfg.payloads for speed in cfg.speeds}
    return {key for key in paper.TABLE_6 if key[0] == "go1"} <= walked


def walk_figures_of(
    cfg: WalkCfg, results: Sequence[WalkResult], groups: dict[str, Any], *, calibrated: bool
) -> dict[str, Any]:
    """Everything for ``result.json``.

    Where ``calibrated``, the electrical numbers are fitted to Go1's rows, used, and replaced in ``groups``.

    Raises:
        ValueError: calibrate, and Go1 did not arrive in one of its four conditions.
    """
    load = paper.arm_load()

    @cache
    def standing(robot: str, hold: bool = False) -> JointLoad:
        return standing_load(robot_env(cfg.env, robot, PAYLOAD_VARIANT), load=load, hold=hold)[0]

    of_paper = all(result.paper_device for result in results)
    found: dict[str, Any] = {"consistency": consistency.check()} if of_paper else {}
    own_rows = "go1" in cfg.robots and (of_paper or calibrated)
    rows = walk_figures.calibration_rows(results, standing("go1")) if own_rows else []
    complete = can_calibrate(cfg) and len(rows) == 5
    if calibrated and not complete:
        raise ValueError("--calibrate: Go1 did not arrive in all four conditions; name another --policy-go1")
    if complete:
        fit = model_numbers.calibrate(rows, groups["electrical"])
        source = "Go1 of table 6 and its standby power of section 6.5"
        found["calibration"] = {**asdict(fit), "text": str(fit), "rows": source, "standby_load": load}
        if calibrated:
            groups["electrical"] = fit.cfg
    fitted = model_numbers.fitted_names("electrical") if calibrated else ()
    electrical = groups["electrical"]
    found["numbers"] = model_numbers.described(groups, fitted)
    own = "electrical" in model_numbers.calibrated(groups, fitted)
    found["conditions"] = [walk_figures.row(result, electrical, calibrated=own) for result in results]
    if {"mr_go", "mr_go_sal"} <= set(cfg.robots):
        loads = {
            "go1": standing("go1"),
            "mr_go_motors": standing("mr_go"),
            "mr_go_holding": standing("mr_go", True),
        }
        powers = {name: float(battery_power(joints, electrical).total) for name, joints in loads.items()}
        saving = powers["go1"] - powers["mr_go_holding"]
        found["standing"] = {**powers, "saving": saving, "load": load, "calibrated": {"go1": own, "others": False}}
        found["savings"] = [asdict(s) for s in walk_figures.savings(results, electrical, saving)]
        if of_paper:
            found["paper_bounds"] = {source: consistency.paper_bounds(source) for source in ("hardware", "simulation")}
        if complete:
            found["sensitivity"] = walk_figures.sensitivity(results, rows, electrical)
    return found


def walked(row: Mapping[str, Any]) -> tuple[str, str, str]:
    """Speed, power and cost of transport of a row as a table shows them; empty where no trial arrived."""
    if not row["trials"]:
        return "", "", ""
    power, cot = row["power"]["mean"], row["cot"]
    if power is None or math.isnan(power):  # of a device whose coil's resistance nobody stated
        without = sum(value for value in row["parts"].values() if value is not None and not math.isnan(value))
        return f"{row['speed']['mean']:.3f}", f"{without:.1f} W + coils", NOT_KNOWN
    return f"{row['speed']['mean']:.3f}", f"{power:.1f} W", f"{cot['mean']:.3f} ± {cot['sd']:.3f}"


def walk_lines(figures: dict[str, Any]) -> list[str]:
    """The table of a walk, its calibration and what SAL saves."""
    rows = []
    for row in figures["conditions"]:
        reference, held, activation = row["paper"], row["hold_mean"], row["paper_hold_mean"]
        notes = ["calibrated"] * row["calibrated"] + [f"{why} {row[why]}" for why in ("fell", "late") if row[why]]
        rows.append((
            paper.NAMES[row["robot"]], f"{row['payload']:g}", f"{row['command']:g}", *walked(row),
            f"{reference['cot']:.3f} ± {reference['sd']:.3f}" if reference else "",
            f"{row['difference']['relative']:+.1%}" if reference and row["trials"] else "",
            "" if held is None or not row["trials"] else f"{held['mean']:.1%}",
            "" if activation is None else f"{activation['simulation']:.1%}", "  ".join(notes),
        ))  # fmt: skip
    head = ("robot", "load", "cmd", "speed", "power", "COT", "paper", "diff", "held", "paper", "")
    if not any(row["paper"] for row in figures["conditions"]):  # another device than the paper's
        head, *rows = ([*row[:6], row[8], row[10]] for row in (head, *rows))
    lines = [*text_table(head, rows), *lost_lines(figures["conditions"], WalkCfg().patience)]
    if fit := figures.get("calibration"):
        bounds = "".join(f"; {name} stands at the end of its range" for name in fit["at_bound"])
        lines.append(f"\nGo1 alone gives: {fit['text']}; its five rows to {fit['rmse']:.1f} W (RMS){bounds}")
    lines += [_saving_line(row) for row in figures.get("savings", [])]
    return lines


def _saving_line(row: Mapping[str, Any]) -> str:
    """Saving by SAL in one condition; figures that depend on a coil whose resistance is not known is left out."""
    bound, reference, part = row["bound"], row["paper"], row["saving_by_part"]
    where = f"SAL at {row['payload']:g} kg, {row['command']:g} m/s"
    calves, others = part["copper_calves"], part["copper_hips_thighs"]
    most = f"holding at most {bound['walking_copper']:.1f} W"
    if math.isnan(row["saving"]):
        motors = sum(value for value in part.values() if not math.isnan(value))
        return (
            f"{where} saves {motors:+.1f} W (calves {calves:+.1f}, hips and thighs {others:+.1f}) less what the coils "
            f"take, which is {NOT_KNOWN}; {most}"
        )
    return (
        f"{where} saves {row['saving']:+.1f} W (calves {calves:+.1f}, hips and thighs {others:+.1f}, "
        f"coils {part['coil']:+.1f}), COT {-row['cot_reduction']:+.1%}; {most} (closed form: "
        + (
            f"{bound['our_standing']:.1f} from our standing saving"
            if bound["our_standing"] > 0.0
            else "none, standing robots save nothing either"
        )
        + (f", {bound['paper_standing']:.1f} from the paper's)" if "paper_standing" in bound else ")")
        + (f"; paper {-reference['saving']:+.1f} W, {-reference['cot_reduction']:+.1%}" if reference else "")
    )


def mission_figures_of(
    cfg: MissionCfg,
    policies: Mapping[str, Policy],
    groups: dict[str, Any],
    progress: Callable[[str, float], None],
    *,
    of_paper: bool,
    calibrated: bool,
    fluid_known: bool = True,
) -> tuple[dict[str, MissionTrace], dict[str, Any]]:
    """The missions, and their figures for ``result.json``.

    ``of_paper``: whether the task is the paper's, whose figures of Go1 fit the numbers. Where ``calibrated``, these are
    used, and replaced in ``groups``. ``fluid_known``: whether the devices' thermal numbers are theirs; else their
    temperature is left out.
    """
    fitted = model_numbers.fitted_names("thermal", "battery") if calibrated else ()

    def rows(traces: Mapping[str, MissionTrace]) -> dict[str, Any]:
        own = model_numbers.calibrated(groups, fitted) if of_paper else ()
        return {robot: walk_figures.mission_row(robot, trace, calibrated=own) for robot, trace in traces.items()}

    def run(feedback: bool) -> dict[str, MissionTrace]:
        traces = {robot: mission.run(found, *groups.values(), feedback=feedback) for robot, found in phases.items()}
        if not fluid_known:
            for trace in traces.values():
                trace.rise["fluid"] = np.full_like(trace.depletion, np.nan)
        return traces

    phases = mission.measure(cfg, policies, progress)
    fit = cold = None
    if "go1" in cfg.robots and of_paper:
        heat, battery, fit = mission.calibrate(phases["go1"], *groups.values())
        fit["numbers"] = {
            "housing_capacity": heat.housing_capacity,
            "housing_resistance": heat.housing_resistance,
            "capacity": battery.capacity,
        }
        if calibrated:
            groups |= {"thermal": heat, "battery": battery}
    traces = run(feedback=False)
    if cfg.feedback:
        cold = rows(traces)
        fluid = {robot: trace.fluid.mean(1) for robot, trace in traces.items()}
        phases = mission.measure(cfg, policies, progress, fluid, groups["thermal"])
        traces = run(feedback=True)
    warm = rows(traces)
    return traces, {
        "simulated": f"{cfg.window:g} m of each walk and 5 s of standing; carried over the phases by the models"
        + ("; with feedback, which the calibration was without" if cfg.feedback else ""),
        "robots": warm,
        "windows": walk_figures.mission_windows(phases),
        "without_feedback": cold,
        "changes": walk_figures.mission_changes(warm),
        "calibration": fit,
        "numbers": model_numbers.described(groups, fitted),
        "consistency": consistency.check(),
    }


def mission_lines(figures: dict[str, Any]) -> list[str]:
    """The table of a mission, what was lost on the way, and what SAL changes."""
    compared = any(row["depletion"]["paper"] is not None for row in figures["robots"].values())
    theirs = " (paper)" if figures["task"]["of_paper"] else " (paper, whose task is another: see --help)"
    rows = []
    for robot, row in figures["robots"].items():
        cells = [
            *(row["power"][name] for name in ("outbound", "standby", "return")),
            row["depletion"],
            *(row["rise"][name] for name in ("calf_walking", "calf_standby", "all")),
        ]
        compared_with = ("" if cell["paper"] is None else f" ({cell['paper']:.1f})" for cell in cells)
        marks = ("*" if cell["calibrated"] else " " for cell in cells)
        shown = (
            f"{figure_text(c['mean'], '.1f')}{paper_s}{mark}"
            for c, paper_s, mark in zip(cells, compared_with, marks, strict=True)
        )
        rows.append((paper.NAMES[robot], *shown))
    head = ("robot", "out [W]", "standby [W]", "back [W]", "charge [pp]", "calf walk [K]", "calf stand [K]", "all [K]")
    lines = [
        f"simulated: {figures['simulated']}; ours{theirs if compared else ''}; * used to calibrate",
        *text_table(head, rows),
    ]
    for robot, walks in figures["windows"].items():
        for name, walk in walks.items():
            if walk["fell"] or walk["late"]:
                lost = f"of {walk['tried']} windows {walk['fell']} fell, {walk['late']} came too late"
                counted = f"{walk['counted']} repetitions finished both ways and count"
                lines.append(f"{paper.NAMES[robot]}, {name}: {lost}; {counted}")
    for name, change in figures["changes"].items():
        compared_with = "" if change["paper"] is None else f" (paper {change['paper']:+.1%})"
        ours = figure_text(change["ours"], "+.1%")
        lines.append(f"MR_Go to MR_Go-SAL, {name.replace('_', ' ')}: {ours}{compared_with}")
    if not compared:
        return lines
    check = figures["consistency"]
    first = check["by_speed"][0]
    by = first["reconciled_by"]
    lines.append(
        f"the paper's own numbers: SAL at {check['walking_power_ratio']:.3f} of MR_Go's walking power and "
        f"{check['depletion_ratio']:.3f} of its depletion; {first['energy_ratio']:.3f} of the energy at equal "
        f"{first['speed']:g} m/s. SAL walking at {by['sal_speed']:.2f} m/s would reconcile them, or "
        f"{by['hidden_load']:.0f} W past the meter, or a gauge with exponent {by['gauge_exponent']:.2f}"
    )
    return lines
