"""``mrwarp mission``: 150 m out, ten minutes of standing, 150 m back loaded: power, state of charge, temperatures."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from pathlib import Path
from typing import Any

from mrwarp import paper
from mrwarp.commands import energy_runs as energy_cli
from mrwarp.energy import consistency
from mrwarp.energy.battery import BatteryError
from mrwarp.options.arguments import Parser, count, positive
from mrwarp.params import ParameterError
from mrwarp.run_dir import check_writable, write_result
from mrwarp.runtime import quiet_libraries
from mrwarp.usd.open_stage import AssetError


def make_parser() -> argparse.ArgumentParser:
    """The options of ``mrwarp mission``."""
    parser = Parser(
        prog="mrwarp mission",
        description="The pickup-and-return task with Go1, MR_Go and MR_Go-SAL. A window of every phase is simulated "
        "and carried over the whole phase by the electrical, battery and thermal models.",
    )
    add = parser.add_argument
    add("--out", type=Path, default=Path("runs/mission"), help="output folder (default: runs/mission)")
    add("--robot", nargs="+", choices=paper.ROBOTS, default=list(paper.ROBOTS), help="robots (default: all three)")
    add("--speed", type=energy_cli.speed, default=0.3, metavar="V", help="command [m/s], not in the paper (0.3)")
    add("--distance", type=energy_cli.distance, default=paper.DISTANCE, metavar="M", help="one way [m] (150)")
    add("--standby", type=positive, default=paper.STANDBY, metavar="S", help="standing [s] (600)")
    arm = f"load out and while standing [kg] (the arm: {paper.arm_load():.1f}, from Go1's own rows)"
    add("--outbound-load", type=energy_cli.load, default=paper.arm_load(), metavar="KG", help=arm)
    add("--return-load", type=energy_cli.load, default=3.0, metavar="KG", help="load back [kg] (3)")
    add(
        "--window", type=energy_cli.distance, default=10.0, metavar="M", help="simulated distance of each walk [m] (10)"
    )
    add("--seeds", type=count, default=3, help="repetitions (default: 3)")
    add("--feedback", action="store_true", help="warm windings and fluids act back; a second pass")
    add("--calibrate", action="store_true", help="fit thermal numbers and capacity to Go1's, write numbers.json")
    energy_cli.add_options(parser)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run the mission; 0 done, 1 when a robot could not finish, 2 on bad input."""
    argv = sys.argv[1:] if argv is None else argv
    args = make_parser().parse_args(argv)
    quiet_libraries()
    from mrwarp.trials import mission, mission_figures, mission_pictures

    out: Path = args.out
    started, progress = time.perf_counter(), energy_cli.Progress(sys.stdout)
    try:
        check_writable(out)
        groups, policies = energy_cli.numbers(args), energy_cli.policies(args)
        cfg = _cfg(args)
        of_paper = _task(cfg) == _task(mission.MissionCfg())
        if args.calibrate and "go1" not in cfg.robots:
            raise ValueError("--calibrate needs Go1 among the robots")
        if args.calibrate and not of_paper:
            raise ValueError(f"--calibrate needs the paper's task, whose figures it fits; leave out {_OPTIONS}")
        phases = mission.measure(cfg, policies, progress)
        fit = None
        if "go1" in cfg.robots and of_paper:
            heat, battery, fit = mission.calibrate(phases["go1"], *groups.values())
            fit["numbers"] = {"housing_capacity": heat.housing_capacity, "housing_resistance": heat.housing_resistance,
                              "capacity": battery.capacity}  # fmt: skip
            if args.calibrate:
                groups |= {"thermal": heat, "battery": battery}
        fitted = energy_cli.fitted_names("thermal", "battery") if args.calibrate else ()
        own = energy_cli.calibrated(groups, fitted) if of_paper else ()
        traces = {robot: mission.run(found, *groups.values(), feedback=False) for robot, found in phases.items()}
        cold = _rows(traces, own) if args.feedback else None
        if args.feedback:
            fluid = {robot: mission.fluid_rises(trace) for robot, trace in traces.items()}
            phases = mission.measure(cfg, policies, progress, fluid, groups["thermal"])
            traces = {robot: mission.run(found, *groups.values(), feedback=True) for robot, found in phases.items()}
        progress.done()
    except mission.MissionError as error:
        print(f"\nmrwarp mission: {error}", file=sys.stderr)
        return 1
    except (AssetError, ParameterError, BatteryError, ValueError, OSError) as error:
        print(f"mrwarp mission: {error}", file=sys.stderr)
        return 2
    rows = _rows(traces, own)
    figures = {
        "simulated": f"{args.window:g} m of each walk and 5 s of standing; carried over the phases by the models"
        + ("; with feedback, which the calibration was without" if args.feedback else ""),
        "task": {**_task(cfg), "feedback": args.feedback, "seeds": cfg.seeds, "of_paper": of_paper},
        "robots": rows, "windows": mission_figures.windows(phases), "without_feedback": cold,
        "changes": mission_figures.changes(rows), "calibration": fit,
        "numbers": energy_cli.described(groups, fitted), "consistency": consistency.check(),
        "wall_seconds": time.perf_counter() - started,
    }  # fmt: skip
    if args.calibrate:
        energy_cli.write_numbers(out / "numbers.json", groups)
    write_result(out, figures, seed=args.seed, command="mrwarp mission " + shlex.join(argv))
    mission_pictures.power(traces, out / "power.png")
    mission_pictures.temperature(traces, rows, out / "temperature.png")
    _print(figures)
    print(f"\nfigures and pictures in {out}")
    return 0


_OPTIONS = "--speed, --distance, --standby, --outbound-load and --return-load"


def _task(cfg: Any) -> dict[str, float]:
    """What makes a mission the paper's or another."""
    return {
        name: getattr(cfg, name) for name in ("speed", "distance", "standby", "outbound_load", "return_load")
    }  # fmt: skip


def _rows(traces: dict[str, Any], calibrated: tuple[str, ...]) -> dict[str, Any]:
    from mrwarp.trials import mission_figures

    return {robot: mission_figures.row(robot, trace, calibrated=calibrated) for robot, trace in traces.items()}


def _cfg(args: argparse.Namespace) -> Any:
    from mrwarp.trials.mission import MissionCfg

    return MissionCfg(
        robots=tuple(robot for robot in paper.ROBOTS if robot in args.robot), speed=args.speed, distance=args.distance,
        standby=args.standby, outbound_load=args.outbound_load, return_load=args.return_load, window=args.window,
        seeds=args.seeds, current=args.current, feedback=args.feedback, env=energy_cli.env_cfg(args), seed=args.seed,
    )  # fmt: skip


def _print(figures: dict[str, Any]) -> None:
    """The tables."""
    theirs = "paper" if figures["task"]["of_paper"] else "paper, whose task is another: see --help"
    print(f"simulated: {figures['simulated']}; ours ({theirs}); * used to calibrate")
    print(f"{'robot':10s} {'out [W]':>16s} {'standby [W]':>16s} {'back [W]':>16s} {'charge [pp]':>16s} "
          f"{'calf walk [K]':>16s} {'calf stand [K]':>16s} {'all [K]':>16s}")  # fmt: skip
    for robot, row in figures["robots"].items():
        cells = [*(row["power"][name] for name in ("outbound", "standby", "return")), row["depletion"],
                 *(row["rise"][name] for name in ("calf_walking", "calf_standby", "all"))]  # fmt: skip
        print(f"{paper.NAMES[robot]:10s} " + " ".join(
            f"{cell['mean']:7.1f} ({cell['paper']:.1f}){'*' if cell['calibrated'] else ' '}".rjust(16) for cell in cells
        ))  # fmt: skip
    for robot, walks in figures["windows"].items():
        for name, walk in walks.items():
            if walk["fell"] or walk["late"]:
                lost = f"of {walk['tried']} windows {walk['fell']} fell, {walk['late']} came too late"
                print(
                    f"{paper.NAMES[robot]}, {name}: {lost}; {walk['counted']} repetitions finished both ways and count"
                )
    for name, change in figures["changes"].items():
        print(f"MR_Go to MR_Go-SAL, {name.replace('_', ' ')}: {change['ours']:+.1%} (paper {change['paper']:+.1%})")
    check = figures["consistency"]
    first = check["by_speed"][0]
    by = first["reconciled_by"]
    print(
        f"the paper's own numbers: SAL at {check['walking_power_ratio']:.3f} of MR_Go's walking power and "
        f"{check['depletion_ratio']:.3f} of its depletion; {first['energy_ratio']:.3f} of the energy at equal "
        f"{first['speed']:g} m/s. SAL walking at {by['sal_speed']:.2f} m/s would reconcile them, or "
        f"{by['hidden_load']:.0f} W beside the meter, or a gauge with exponent {by['gauge_exponent']:.2f}"
    )
