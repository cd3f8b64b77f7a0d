"""``mrwarp mission``: 150 m out, ten minutes of standing, 150 m back loaded: power, state of charge, temperatures."""

from __future__ import annotations

import sys
import time
from typing import Any

from mrwarp import paper
from mrwarp.commands.run_walk import env_cfg, read_policies
from mrwarp.energy import consistency, model_numbers
from mrwarp.options.command_line import CommandLine
from mrwarp.options.trial_options import Mission
from mrwarp.run_dir import check_writable, write_result
from mrwarp.runtime import ProgressLine
from mrwarp.trials import mission, walk_figures, walk_pictures
from mrwarp.trials.mission import MissionCfg
from mrwarp.trials.walking import device_notes

_TASK = ("speed", "distance", "standby", "outbound_load", "return_load")
"""What makes a mission the paper's or another."""


def run(options: Mission, line: CommandLine) -> int:
    """Run the mission; 0 done, 1 when a robot could not finish, 2 on bad input."""
    started, progress = time.perf_counter(), ProgressLine(sys.stdout)
    check_writable(options.out)
    groups, policies = model_numbers.read_numbers(options.numbers, options.set), read_policies(options)
    cfg = make_cfg(options)
    of_paper = _task(cfg) == _task(MissionCfg())
    if options.calibrate and "go1" not in cfg.robots:
        raise ValueError("--calibrate needs Go1 among the robots")
    if options.calibrate and not of_paper:
        others = ", ".join(f"--{name.replace('_', '-')}" for name in _TASK)
        raise ValueError(f"--calibrate needs the paper's task, whose figures it fits; leave out {others}")
    for text in device_notes(cfg.env, options.current):
        print(text, flush=True)
    try:
        phases = mission.measure(cfg, policies, progress)
        fit = None
        if "go1" in cfg.robots and of_paper:
            heat, battery, fit = mission.calibrate(phases["go1"], *groups.values())
            fit["numbers"] = {
                "housing_capacity": heat.housing_capacity,
                "housing_resistance": heat.housing_resistance,
                "capacity": battery.capacity,
            }
            if options.calibrate:
                groups |= {"thermal": heat, "battery": battery}
        fitted = model_numbers.fitted_names("thermal", "battery") if options.calibrate else ()
        own = model_numbers.calibrated(groups, fitted) if of_paper else ()
        traces = {robot: mission.run(found, *groups.values(), feedback=False) for robot, found in phases.items()}
        cold = _rows(traces, own) if options.feedback else None
        if options.feedback:
            fluid = {robot: trace.fluid.mean(1) for robot, trace in traces.items()}
            phases = mission.measure(cfg, policies, progress, fluid, groups["thermal"])
            traces = {robot: mission.run(found, *groups.values(), feedback=True) for robot, found in phases.items()}
    finally:
        progress.done()
    rows = _rows(traces, own)
    figures = {
        "simulated": f"{options.window:g} m of each walk and 5 s of standing; carried over the phases by the models"
        + ("; with feedback, which the calibration was without" if options.feedback else ""),
        "task": {**_task(cfg), "feedback": options.feedback, "seeds": cfg.seeds, "of_paper": of_paper},
        "robots": rows,
        "windows": walk_figures.mission_windows(phases),
        "without_feedback": cold,
        "changes": walk_figures.mission_changes(rows),
        "calibration": fit,
        "numbers": model_numbers.described(groups, fitted),
        "consistency": consistency.check(),
        "wall_seconds": time.perf_counter() - started,
    }
    if options.calibrate:
        model_numbers.write_numbers(options.out / "numbers.json", groups)
    write_result(options.out, figures, seed=options.seed, command=str(line))
    walk_pictures.mission_power(traces, options.out / "power.png")
    walk_pictures.mission_temperature(traces, rows, options.out / "temperature.png")
    _print(figures)
    print(f"\nfigures and pictures in {options.out}")
    return 0


def make_cfg(options: Mission) -> MissionCfg:
    """The mission that the options ask for."""
    return MissionCfg(
        robots=tuple(robot for robot in paper.ROBOTS if robot in options.robot),
        **{name: getattr(options, name) for name in _TASK},
        window=options.window,
        seeds=options.seeds,
        current=options.current,
        feedback=options.feedback,
        env=env_cfg(options),
        seed=options.seed,
    )


def _task(cfg: MissionCfg) -> dict[str, float]:
    return {name: getattr(cfg, name) for name in _TASK}


def _rows(traces: dict[str, Any], calibrated: tuple[str, ...]) -> dict[str, Any]:
    return {robot: walk_figures.mission_row(robot, trace, calibrated=calibrated) for robot, trace in traces.items()}


def _print(figures: dict[str, Any]) -> None:
    """The tables."""
    compared = any(row["depletion"]["paper"] is not None for row in figures["robots"].values())
    theirs = " (paper)" if figures["task"]["of_paper"] else " (paper, whose task is another: see --help)"
    print(f"simulated: {figures['simulated']}; ours{theirs if compared else ''}; * used to calibrate")
    print(f"{'robot':10s} {'out [W]':>16s} {'standby [W]':>16s} {'back [W]':>16s} {'charge [pp]':>16s} "
          f"{'calf walk [K]':>16s} {'calf stand [K]':>16s} {'all [K]':>16s}")  # fmt: skip
    for robot, row in figures["robots"].items():
        cells = [*(row["power"][name] for name in ("outbound", "standby", "return")), row["depletion"],
                 *(row["rise"][name] for name in ("calf_walking", "calf_standby", "all"))]  # fmt: skip
        print(f"{paper.NAMES[robot]:10s} " + " ".join(
            (f"{cell['mean']:7.1f}" + ("" if cell["paper"] is None else f" ({cell['paper']:.1f})")
             + ("*" if cell["calibrated"] else " ")).rjust(16) for cell in cells
        ))  # fmt: skip
    for robot, walks in figures["windows"].items():
        for name, walk in walks.items():
            if walk["fell"] or walk["late"]:
                lost = f"of {walk['tried']} windows {walk['fell']} fell, {walk['late']} came too late"
                print(
                    f"{paper.NAMES[robot]}, {name}: {lost}; {walk['counted']} repetitions finished both ways and count"
                )
    for name, change in figures["changes"].items():
        theirs = "" if change["paper"] is None else f" (paper {change['paper']:+.1%})"
        print(f"MR_Go to MR_Go-SAL, {name.replace('_', ' ')}: {change['ours']:+.1%}{theirs}")
    if not compared:
        return
    check = figures["consistency"]
    first = check["by_speed"][0]
    by = first["reconciled_by"]
    print(
        f"the paper's own numbers: SAL at {check['walking_power_ratio']:.3f} of MR_Go's walking power and "
        f"{check['depletion_ratio']:.3f} of its depletion; {first['energy_ratio']:.3f} of the energy at equal "
        f"{first['speed']:g} m/s. SAL walking at {by['sal_speed']:.2f} m/s would reconcile them, or "
        f"{by['hidden_load']:.0f} W beside the meter, or a gauge with exponent {by['gauge_exponent']:.2f}"
    )
