"""``mrwarp walk``: cost of transport, support activation and tracking of three robots over a measured distance."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict, replace
from typing import Any

from mrwarp import paper
from mrwarp.energy import consistency, model_numbers
from mrwarp.energy.power import battery_power
from mrwarp.env.cfg import EnvCfg, make_walk_cfg
from mrwarp.options.command_line import CommandLine
from mrwarp.options.trial_options import EnergyRun, Walk
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.run_dir import check_writable, write_result
from mrwarp.runtime import ProgressLine
from mrwarp.study.plan import ENERGY, SEEDS, plant_of, policy_file
from mrwarp.trials import walk_figures, walk_pictures
from mrwarp.trials.walk_trials import WalkCfg, robot_env, standing_load, walk
from mrwarp.trials.walking import PAYLOAD_VARIANT, Policy, device_notes


def run(options: Walk, line: CommandLine) -> int:
    """Walk and report; 0 done, 1 when a robot fell or was too slow in every trial, 2 on bad input."""
    check_writable(options.out)
    groups, policies = model_numbers.read_numbers(options.numbers, options.set), read_policies(options)
    cfg = WalkCfg(
        robots=_robots(options),
        payloads=options.payload,
        speeds=options.speed,
        trials=options.trials,
        distance=options.distance,
        current=options.current,
        env=env_cfg(options),
        seed=options.seed,
    )
    if options.calibrate and not _can_calibrate(cfg):
        conditions = "Go1 at 0.3 and 0.5 m/s with 0 and 3 kg"
        raise ValueError(f"--calibrate needs {conditions}; leave out --robot, --sal, --speed and --payload")
    for text in device_notes(cfg.env, options.current):
        print(text, flush=True)
    started, progress = time.perf_counter(), ProgressLine(sys.stdout)
    try:
        results = walk(cfg, policies, progress)
        figures, code = _figures(options, cfg, results, groups)
    finally:
        progress.done()
    if options.calibrate:
        model_numbers.write_numbers(options.out / "numbers.json", groups)
    figures |= {"distance": options.distance, "wall_seconds": time.perf_counter() - started}
    write_result(options.out, figures, seed=options.seed, command=str(line))
    walk_pictures.cost(figures["conditions"], options.out / "cot.png")
    walk_pictures.holding(results, options.out / "holding.png")
    walk_pictures.distributions(results, options.out / "torques.png")
    _print(figures)
    print(f"\nfigures and pictures in {options.out}")
    return code


def env_cfg(options: EnergyRun) -> EnvCfg:
    """The task that the options ask for."""
    env = make_walk_cfg(coupling=options.coupling, asset=options.asset, model=options.model, threads=options.threads)
    return replace(env, currents=(options.current,), actuator=replace(env.actuator, damping=options.branches == "both"))


def read_policies(options: EnergyRun) -> dict[str, Policy]:
    """Policy of each robot, by default trained with its coupling; files that are the same are loaded once.

    Raises:
        PolicyError: a file cannot be used.
    """
    paths = {
        robot: getattr(options, f"policy_{robot}")
        or options.policy
        or policy_file(ENERGY, plant_of(robot, options.coupling), SEEDS[0])
        for robot in paper.ROBOTS
    }
    loaded = {path: OnnxPolicy(path) for path in set(paths.values())}
    return {robot: loaded[path] for robot, path in paths.items()}


def _robots(options: Walk) -> tuple[str, ...]:
    """Robots that are asked for.

    Raises:
        ValueError: --robot and --sal exclude each other.
    """
    if options.sal is None:
        return tuple(robot for robot in paper.ROBOTS if options.robot is None or robot in options.robot)
    if options.robot is not None:
        raise ValueError("--robot and --sal exclude each other: --sal on is --robot mr_go_sal, --sal off is mr_go")
    return ("mr_go_sal",) if options.sal == "on" else ("mr_go",)


def _can_calibrate(cfg: Any) -> bool:
    """Whether all four conditions of Go1 in table 6 are walked."""
    walked = {(robot, load, speed) for robot in cfg.robots for load in cfg.payloads for speed in cfg.speeds}
    return {key for key in paper.TABLE_6 if key[0] == "go1"} <= walked


def _figures(options: Walk, cfg: Any, results: list[Any], groups: dict[str, Any]) -> tuple[dict, int]:
    """Everything for ``result.json``, and the exit code; ``--calibrate`` replaces the electrical numbers.

    Raises:
        ValueError: --calibrate, and Go1 did not arrive in one of its four conditions.
    """
    load = paper.arm_load()
    stand = _Standing(cfg.env, load)
    found: dict[str, Any] = {"consistency": consistency.check()}
    rows = walk_figures.calibration_rows(results, stand.use("go1")) if "go1" in cfg.robots else []
    complete = _can_calibrate(cfg) and len(rows) == 5
    if options.calibrate and not complete:
        raise ValueError("--calibrate: Go1 did not arrive in all four conditions; name another --policy-go1")
    fitted: tuple[str, ...] = ()
    if complete:
        fit = model_numbers.calibrate(rows, groups["electrical"])
        found["calibration"] = {
            **asdict(fit), "text": str(fit), "rows": "Go1 of table 6 and its standby power of section 6.5",
            "standby_load": load,
        }  # fmt: skip
        if options.calibrate:
            groups["electrical"] = fit.cfg
            fitted = model_numbers.fitted_names("electrical")
    electrical = groups["electrical"]
    found["numbers"] = model_numbers.described(groups, fitted)
    own = "electrical" in model_numbers.calibrated(groups, fitted)
    found["conditions"] = [walk_figures.row(result, electrical, calibrated=own) for result in results]
    if {"mr_go", "mr_go_sal"} <= set(cfg.robots):
        standing = stand.powers(electrical)
        saving = walk_figures.standing_saving(stand.use("go1"), stand.use("mr_go", hold=True), electrical)
        found["standing"] = {**standing, "saving": saving, "load": load, "calibrated": {"go1": own, "others": False}}
        found["savings"] = [asdict(s) for s in walk_figures.savings(results, electrical, saving)]
        found["paper_bounds"] = {source: consistency.paper_bounds(source) for source in ("hardware", "simulation")}
        if complete:
            found["sensitivity"] = walk_figures.sensitivity(results, rows, electrical)
    lost = [result for result in results if not len(result.speed)]
    return found, 1 if lost else 0


class _Standing:
    """Standing robots, each simulated when it is first asked for."""

    def __init__(self, env: Any, load: float) -> None:
        self._env, self._load, self._known = env, load, {}

    def use(self, robot: str, *, hold: bool = False) -> Any:
        if (robot, hold) not in self._known:
            cfg = robot_env(self._env, robot, PAYLOAD_VARIANT)
            self._known[robot, hold] = standing_load(cfg, load=self._load, hold=hold)[0]
        return self._known[robot, hold]

    def powers(self, electrical: Any) -> dict[str, float]:
        """Battery power by robot and by what holds the calves [W]."""
        uses = {
            "go1": self.use("go1"),
            "mr_go_motors": self.use("mr_go"),
            "mr_go_holding": self.use("mr_go", hold=True),
        }
        return {name: float(battery_power(use, electrical).total) for name, use in uses.items()}


def _print(figures: dict[str, Any]) -> None:
    """The tables."""
    compared = any(row["paper"] for row in figures["conditions"])
    print(f"{'robot':10s} {'load':>5s} {'cmd':>4s} {'speed':>6s} {'power':>8s} {'COT':>15s} "
          + (f"{'paper':>15s} {'diff':>7s} {'held':>6s} {'paper':>6s}" if compared else f"{'held':>6s}"))  # fmt: skip
    for row in figures["conditions"]:
        reference, held = row["paper"], row["hold_mean"]
        theirs = f"{reference['cot']:.3f} ± {reference['sd']:.3f}" if reference else ""
        difference = f"{row['difference']['relative']:+.1%}" if reference else ""
        activation = row["paper_hold_mean"]
        share = f"{'' if held is None else format(held['mean'], '.1%'):>6s}"
        if compared:
            simulated = "" if activation is None else format(activation["simulation"], ".1%")
            share = f"{theirs:>15s} {difference:>7s} {share} {simulated:>6s}"
        print(
            f"{paper.NAMES[row['robot']]:10s} {row['payload']:5g} {row['command']:4g} {row['speed']['mean']:6.3f} "
            f"{row['power']['mean']:6.1f} W {row['cot']['mean']:7.3f} ± {row['cot']['sd']:.3f} {share}"
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
            f"{bound['our_standing']:.1f} from our standing saving"
            + (f", {bound['paper_standing']:.1f} from the paper's)" if "paper_standing" in bound else ")")
            + (f"; paper {-reference['saving']:+.1f} W, {-reference['cot_reduction']:+.1%}" if reference else "")
        )
