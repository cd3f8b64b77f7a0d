"""``mrwarp walk``: cost of transport, support activation and tracking of three robots over a measured distance."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from pathlib import Path
from typing import Any

from mrwarp import paper
from mrwarp.commands import energy_runs as energy_cli
from mrwarp.options.arguments import Parser, count
from mrwarp.params import ParameterError
from mrwarp.run_dir import check_writable, write_result
from mrwarp.runtime import quiet_libraries
from mrwarp.usd.open_stage import AssetError


def make_parser() -> argparse.ArgumentParser:
    """The options of ``mrwarp walk``."""
    parser = Parser(
        prog="mrwarp walk",
        description="Walk a measured distance with Go1, MR_Go (SAL off) and MR_Go-SAL: battery power and cost of "
        "transport (table 6), support activation (table 7), torques (figure 8) and tracking.",
    )
    add = parser.add_argument
    add("--out", type=Path, default=Path("runs/walk-energy"), help="output folder (default: runs/walk-energy)")
    add("--robot", nargs="+", choices=paper.ROBOTS, default=None, help="robots (default: all three)")
    add("--sal", choices=("on", "off"), help="only MR_Go-SAL (on) or MR_Go (off)")
    add(
        "--speed",
        type=energy_cli.speed,
        nargs="+",
        default=[0.3, 0.5],
        metavar="V",
        help="commands [m/s] (default: 0.3 0.5)",
    )
    add(
        "--payload", type=energy_cli.load, nargs="+", default=[0.0, 3.0], metavar="KG", help="loads [kg] (default: 0 3)"
    )
    add("--distance", type=energy_cli.distance, default=30.0, metavar="M", help="measured distance (default: 30)")
    add("--trials", type=count, default=3, help="repetitions per condition (default: 3)")
    add(
        "--calibrate", action="store_true", help="fit the electrical numbers to this run's Go1 rows, write numbers.json"
    )
    energy_cli.add_options(parser)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Walk and report; 0 done, 1 when a robot fell or was too slow in every trial, 2 on bad input."""
    argv = sys.argv[1:] if argv is None else argv
    args = make_parser().parse_args(argv)
    quiet_libraries()
    from mrwarp.trials.walk_trials import WalkCfg, walk

    out: Path = args.out
    try:
        check_writable(out)
        groups, policies = energy_cli.numbers(args), energy_cli.policies(args)
        cfg = WalkCfg(
            robots=_robots(args), payloads=tuple(args.payload), speeds=tuple(args.speed), trials=args.trials,
            distance=args.distance, current=args.current, env=energy_cli.env_cfg(args), seed=args.seed,
        )  # fmt: skip
        if args.calibrate and not _can_calibrate(cfg):
            raise ValueError("--calibrate needs Go1 at 0.3 and 0.5 m/s with 0 and 3 kg; leave out --robot, --sal, "
                             "--speed and --payload")  # fmt: skip
        started, progress = time.perf_counter(), energy_cli.Progress(sys.stdout)
        results = walk(cfg, policies, progress)
        figures, code = _figures(args, cfg, results, groups)
        progress.done()
    except (AssetError, ParameterError, ValueError, OSError) as error:
        print(f"mrwarp walk: {error}", file=sys.stderr)
        return 2
    from mrwarp.trials import walk_pictures

    if args.calibrate:
        energy_cli.write_numbers(out / "numbers.json", groups)
    figures |= {"distance": args.distance, "wall_seconds": time.perf_counter() - started}
    write_result(out, figures, seed=args.seed, command="mrwarp walk " + shlex.join(argv))
    walk_pictures.cost(figures["conditions"], out / "cot.png")
    walk_pictures.holding(results, out / "holding.png")
    walk_pictures.distributions(results, out / "torques.png")
    _print(figures)
    print(f"\nfigures and pictures in {out}")
    return code


def _robots(args: argparse.Namespace) -> tuple[str, ...]:
    """Robots that are asked for.

    Raises:
        ValueError: --robot and --sal exclude each other.
    """
    if args.sal is None:
        return tuple(robot for robot in paper.ROBOTS if args.robot is None or robot in args.robot)
    if args.robot is not None:
        raise ValueError("--robot and --sal exclude each other: --sal on is --robot mr_go_sal, --sal off is mr_go")
    return ("mr_go_sal",) if args.sal == "on" else ("mr_go",)


def _can_calibrate(cfg: Any) -> bool:
    """Whether all four conditions of Go1 in table 6 are walked."""
    walked = {(robot, load, speed) for robot in cfg.robots for load in cfg.payloads for speed in cfg.speeds}
    return {key for key in paper.TABLE_6 if key[0] == "go1"} <= walked


def _figures(args: argparse.Namespace, cfg: Any, results: list[Any], groups: dict[str, Any]) -> tuple[dict, int]:
    """Everything for ``result.json``, and the exit code; ``--calibrate`` replaces the electrical numbers.

    Raises:
        ValueError: --calibrate, and Go1 did not arrive in one of its four conditions.
    """
    from dataclasses import asdict

    from mrwarp.energy import calibrate, consistency
    from mrwarp.trials import walk_figures as figures

    load = paper.arm_load()
    stand = _Standing(cfg.env, load)
    found: dict[str, Any] = {"consistency": consistency.check()}
    rows = figures.calibration_rows(results, stand.use("go1")) if "go1" in cfg.robots else []
    complete = _can_calibrate(cfg) and len(rows) == 5
    if args.calibrate and not complete:
        raise ValueError("--calibrate: Go1 did not arrive in all four conditions; name another --policy-go1")
    fitted: tuple[str, ...] = ()
    if complete:
        fit = calibrate.calibrate(rows, groups["electrical"])
        found["calibration"] = {
            **asdict(fit), "text": str(fit), "rows": "Go1 of table 6 and its standby power of section 6.5",
            "standby_load": load,
        }  # fmt: skip
        if args.calibrate:
            groups["electrical"] = fit.cfg
            fitted = energy_cli.fitted_names("electrical")
    electrical = groups["electrical"]
    found["numbers"] = energy_cli.described(groups, fitted)
    own = "electrical" in energy_cli.calibrated(groups, fitted)
    found["conditions"] = [figures.row(result, electrical, calibrated=own) for result in results]
    if {"mr_go", "mr_go_sal"} <= set(cfg.robots):
        standing = stand.powers(electrical)
        saving = figures.standing_saving(stand.use("go1"), stand.use("mr_go", hold=True), electrical)
        found["standing"] = {**standing, "saving": saving, "load": load, "calibrated": {"go1": own, "others": False}}
        found["savings"] = [asdict(s) for s in figures.savings(results, electrical, saving)]
        found["paper_bounds"] = {source: consistency.paper_bounds(source) for source in ("hardware", "simulation")}
        if complete:
            found["sensitivity"] = figures.sensitivity(results, rows, electrical)
    lost = [result for result in results if not len(result.speed)]
    return found, 1 if lost else 0


class _Standing:
    """Standing robots, each simulated when it is first asked for."""

    def __init__(self, env: Any, load: float) -> None:
        self._env, self._load, self._known = env, load, {}

    def use(self, robot: str, *, hold: bool = False) -> Any:
        from dataclasses import replace

        from mrwarp.trials.standing import standing_load
        from mrwarp.trials.walking import PAYLOAD_VARIANT

        if (robot, hold) not in self._known:
            cfg = replace(self._env, robot=robot, payload=PAYLOAD_VARIANT)
            self._known[robot, hold] = standing_load(cfg, load=self._load, hold=hold)[0]
        return self._known[robot, hold]

    def powers(self, electrical: Any) -> dict[str, float]:
        """Battery power by robot and by what holds the calves [W]."""
        from mrwarp.energy.power import battery_power

        uses = {
            "go1": self.use("go1"),
            "mr_go_motors": self.use("mr_go"),
            "mr_go_holding": self.use("mr_go", hold=True),
        }
        return {name: float(battery_power(use, electrical).total) for name, use in uses.items()}


def _print(figures: dict[str, Any]) -> None:
    """The tables."""
    print(f"{'robot':10s} {'load':>5s} {'cmd':>4s} {'speed':>6s} {'power':>8s} {'COT':>15s} {'paper':>15s} "
          f"{'diff':>7s} {'held':>6s} {'paper':>6s}")  # fmt: skip
    for row in figures["conditions"]:
        reference, held = row["paper"], row["hold_mean"]
        theirs = f"{reference['cot']:.3f} ± {reference['sd']:.3f}" if reference else ""
        difference = f"{row['difference']['relative']:+.1%}" if reference else ""
        activation = row["paper_hold_mean"]
        print(
            f"{paper.NAMES[row['robot']]:10s} {row['payload']:5g} {row['command']:4g} {row['speed']['mean']:6.3f} "
            f"{row['power']['mean']:6.1f} W {row['cot']['mean']:7.3f} ± {row['cot']['sd']:.3f} {theirs:>15s} "
            f"{difference:>7s} {'' if held is None else format(held['mean'], '.1%'):>6s} "
            f"{'' if activation is None else format(activation['simulation'], '.1%'):>6s}"
            + ("  calibrated" if row["calibrated"] else "")
            + (f"  fell {row['fell']}" if row["fell"] else "")
            + (f"  late {row['late']}" if row["late"] else "")
        )
    if "calibration" in figures:
        fit = figures["calibration"]
        print(
            f"\nGo1 alone gives: {fit['text']}; its five rows to {fit['rmse']:.1f} W (RMS)"
            + "".join(f"; {name} stands at the end of its range" for name in fit["at_bound"])
        )
    for row in figures.get("savings", []):
        bound, reference = row["bound"], row["paper"]
        print(
            f"SAL at {row['payload']:g} kg, {row['command']:g} m/s saves {row['saving']:+.1f} W "
            f"(calves {row['saving_by_part']['copper_calves']:+.1f}, hips and thighs "
            f"{row['saving_by_part']['copper_hips_thighs']:+.1f}, coils {row['saving_by_part']['coil']:+.1f}), COT "
            f"{-row['cot_reduction']:+.1%}; holding at most {bound['walking_copper']:.1f} W (closed form: "
            f"{bound['our_standing']:.1f} from our standing saving, {bound['paper_standing']:.1f} from the paper's)"
            + (f"; paper {-reference['saving']:+.1f} W, {-reference['cot_reduction']:+.1%}" if reference else "")
        )
