"""Who should command the coils: gates at a fixed current, a law, or the policy; all with the same budget and price.

Every arm goes on from the shipped policy of its robot and training seed, for as many updates, and pays the same price
per watt, coils included; coils lag. Then all are walked and pushed alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.energy import thermal
from mrwarp.energy.power import ElectricalCfg, battery_power, cost_of_transport, motor_heat
from mrwarp.energy.thermal import Temperatures, ThermalCfg
from mrwarp.enums import ARMS, CurrentCommand, HoldCurrent
from mrwarp.env.cfg import EnvCfg
from mrwarp.paper import DISTANCE
from mrwarp.rl import checkpoint
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.rl.ppo_cfg import LearningCfg
from mrwarp.rl.trainer import TrainCfg, Trainer
from mrwarp.runtime import panels, text_table
from mrwarp.study.plan import ENERGY, HIGH_POWER_PRICE, kept, plant_cfg, policy_file
from mrwarp.trials.impact import ImpactCfg, ImpactSweep, Variant, body_extremes
from mrwarp.trials.statistics import half_width
from mrwarp.trials.walk_trials import WalkCfg, WalkResult, walk
from mrwarp.usd.robot import CALF_COLUMNS, CURRENT_GROUPS

ROBOT = {"none": "go1", "off": "mr_go"}
"""Robot of ``paper.ROBOTS`` of an arm; the others are MR_Go-SAL."""

TITLES = {
    "none": "no device (Go1)",
    "off": "device without current",
    "fixed": "gates, best fixed current",
    "support": "gates, support current at 200 Hz",
    "scheduled": "law at 50 Hz, latched gate",
    "learned": "policy commands the current",
}

CELLS = ((0.0, 0.3), (0.0, 0.5), (3.0, 0.3), (3.0, 0.5))
"""Loads [kg] and speeds [m/s] whose cost of transport counts, those of table 6."""

FAST = (0.6, 0.7, 0.8, 0.9)
"""Commanded speeds beyond them, without load [m/s]."""

HELD = 0.9
"""A speed is held where the mean is this share of the command and nobody falls."""

SWEPT = (0.4, 0.5, 0.6, 0.75, 1.0, 1.25, 1.5)
"""Fixed currents of which the best is taken [A]."""

HOLD_SPEED = 1.0
"""Speed below which the devices of the arm ``learned`` may hold [rad/s], five times the paper's: whether a joint is
held is the policy's choice, which commands no current where it wants none."""


@dataclass(frozen=True, kw_only=True)
class CurrentsCfg:
    """What is compared, and how long each arm learns."""

    arms: tuple[str, ...] = ARMS
    """Of :data:`mrwarp.enums.ARMS`."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Training seeds; policies to begin with are shipped for 0, 1, 2."""
    num_envs: int = 128
    """Training environments."""
    iterations: int = 250
    """PPO updates of every arm; in the first 100 the critic learns alone. 0 measures the shipped policies as they are,
    all arms but ``learned`` with the same policy."""
    power_price: float = HIGH_POWER_PRICE
    """Price of a watt of motors and coils [1/W]."""
    coil_lag: float = 0.01
    """Time constant of the coils [s]: assumed, MR brakes of this size answer in 5 to 25 ms."""
    trials: int = 3
    """Walks of each condition."""
    distance: float = 10.0
    """Measured distance of each [m]."""
    pushes: int = 10
    """Pushes of 100 N for 0.2 s on a walking robot."""
    threads: int = 0
    """CPU threads of the physics; 0 = all."""
    learning: LearningCfg = field(default_factory=lambda: LearningCfg(desired_kl=0.01, entropy=0.0005))
    """How fast networks learn: a step that settles a gait."""


def arm_env(cfg: CurrentsCfg, arm: str, fixed: float) -> EnvCfg:
    """The task of an arm; ``fixed`` is the current of the arm ``fixed`` [A]."""
    env = plant_cfg(
        ROBOT.get(arm, "mr_go_sal"), num_envs=cfg.num_envs, threads=cfg.threads, randomize="all",
        power_price=cfg.power_price,
    )  # fmt: skip
    command = CurrentCommand(arm) if arm in ("scheduled", "learned") else CurrentCommand.FIXED
    hold = HoldCurrent.FIXED if arm == "fixed" else HoldCurrent.SUPPORT
    current = 0.0 if arm in ROBOT else fixed if arm == "fixed" else CURRENT_GROUPS[-1]
    return replace(
        env,
        hold_speed=HOLD_SPEED if arm == "learned" else None,
        currents=(current,),
        current=command,
        coil_lag=cfg.coil_lag,
        actuator=replace(env.actuator, hold_current=hold),
    )


def run(
    cfg: CurrentsCfg, out: Path, electrical: ElectricalCfg, heat: ThermalCfg,
    report: Callable[[str, float], None] = lambda text, share: None,
) -> dict[str, Any] | None:  # fmt: skip
    """Sweep the fixed current, train and measure what is missing in ``out``; None after Ctrl-C in a training.

    Args:
        cfg: The comparison.
        out: Folder of trainings and measurements, which are taken from there when they are done.
        electrical: Numbers of the power model.
        heat: Numbers of the thermal model.
        report: Called with what is under way and the share that is done.

    Raises:
        ValueError: a file in ``out`` is damaged or of another comparison.
    """
    names = ("coil_lag", "iterations", "trials", "distance", "pushes", "power_price")
    asked = {name: getattr(cfg, name) for name in names}
    sweep = kept(out / "fixed_currents.json", asked, lambda: _sweep(cfg, electrical, report))
    best = float(min(sweep, key=lambda amps: sweep[amps]["cot"]))
    jobs = [(arm, seed) for seed in cfg.seeds for arm in cfg.arms]
    rows: dict[str, dict[int, dict[str, Any]]] = {arm: {} for arm in cfg.arms}
    for k, (arm, seed) in enumerate(jobs):
        folder = out / f"{arm}_seed{seed}"
        report(f"{arm}, seed {seed}", k / len(jobs))
        policy = _trained(cfg, arm, seed, best, folder)
        if policy is None:
            return None
        measure = partial(_measure, cfg, arm, best, policy, electrical, heat)
        rows[arm][seed] = kept(folder / "measured.json", asked, measure)
    return {"arms": figures(rows), "fixed_currents": sweep, "best_fixed": best, "seeds": list(cfg.seeds),
            "measured": rows}  # fmt: skip


def _sweep(cfg: CurrentsCfg, electrical: ElectricalCfg, report: Callable[[str, float], None]) -> dict[str, Any]:
    """Mean cost of transport by fixed current, of the policy of seed 0 before it learns with it."""
    found, policy = {}, OnnxPolicy(policy_file(ENERGY, "mr_go_sal", 0))
    for amps in SWEPT:
        report(f"fixed current {amps:g} A", 0.0)
        results = _walks(replace(cfg, trials=2, distance=5.0), "fixed", amps, policy, (0.3, 0.5))
        cots = [float(np.mean(_cot(r, electrical))) for r in results if len(r.speed)]
        found[f"{amps:g}"] = {"cot": float(np.mean(cots)) if len(cots) == len(results) else float("inf"), "by": cots}
    return found


def _trained(cfg: CurrentsCfg, arm: str, seed: int, best: float, folder: Path) -> Path | None:
    """Policy of an arm, trained to the end; None after Ctrl-C."""
    begin = policy_file(ENERGY, ROBOT.get(arm, "mr_go_sal"), seed)
    if cfg.iterations == 0:
        return begin
    policy, saved = folder / "policy.onnx", folder / "checkpoint.pt"
    env = arm_env(cfg, arm, best)
    if saved.is_file():
        content = checkpoint.load(saved)
        mine = {**checkpoint.task(env), "seed": seed}
        theirs = {**content["task"], "seed": content["seed"]}
        if mine != theirs or content["iteration"] > cfg.iterations:
            raise ValueError(f"{folder}: trained with other choices than asked for; name another --out")
        if content["iteration"] == cfg.iterations and policy.is_file():
            return policy
    train = TrainCfg(
        env=env, out=folder, seed=seed, iterations=cfg.iterations, until_gate=False, check_every=float("inf"),
        learning=cfg.learning, command="mrwarp study current",
    )  # fmt: skip
    go_on = saved if saved.is_file() else None
    result = Trainer(train, resume=go_on, start_from=None if go_on else begin).run()
    return None if result["stopped"] == "interrupted" else policy


def _walks(cfg: CurrentsCfg, arm: str, best: float, policy: OnnxPolicy, speeds: Sequence[float]) -> list[WalkResult]:
    """Both loads at some speeds."""
    robot, env = ROBOT.get(arm, "mr_go_sal"), arm_env(cfg, arm, best)
    walks = WalkCfg(
        robots=(robot,), speeds=tuple(speeds), trials=cfg.trials, distance=cfg.distance, env=env,
        current=env.currents[0] or CURRENT_GROUPS[-1],
    )  # fmt: skip
    return walk(walks, {robot: policy})


def _cot(result: WalkResult, electrical: ElectricalCfg) -> np.ndarray:
    return cost_of_transport(battery_power(result.joints, electrical).total, result.mass, result.speed)


def _measure(
    cfg: CurrentsCfg, arm: str, best: float, file: Path, electrical: ElectricalCfg, heat: ThermalCfg
) -> dict[str, Any]:
    """Figures of one policy, see :data:`UNITS`."""
    policy = OnnxPolicy(file)
    results = {r.cell: r for r in _walks(cfg, arm, best, policy, (0.3, 0.5, *FAST))}
    found: dict[str, Any] = {}
    for (load, speed), r in results.items():
        name = f"{load:g} kg, {speed:g} m/s"
        if (load, speed) in CELLS:
            parts = battery_power(r.joints, electrical)
            calves = battery_power(_calves(r), electrical).copper
            found[name] = {
                "cot": _mean(_cot(r, electrical)), "power": _mean(parts.total), "coil": _mean(parts.coil),
                "calves": _mean(calves), "v_x_rmse": _mean(r.motion["v_x_rmse"]), "held": _mean(r.hold),
                "fell": r.fell, "late": r.late,
            }  # fmt: skip
    held = [
        v
        for (load, v), r in results.items()
        if load == 0.0 and not r.fell and len(r.speed) and r.speed.mean() >= HELD * v
    ]
    walked = [found[f"{load:g} kg, {speed:g} m/s"] for load, speed in CELLS]
    loaded = results[3.0, 0.3]
    env = arm_env(cfg, arm, best)
    pushed = ImpactCfg(variants=(Variant(current=env.currents[0]),), trials=cfg.pushes, env=env)
    extremes = body_extremes(ImpactSweep(pushed, policy).run())
    return {
        "conditions": found,
        **{
            name: float(np.mean([row[name] for row in walked]))
            for name in ("cot", "power", "coil", "calves", "v_x_rmse")
        },
        "fastest": max(held, default=0.0),
        "min_height": float(extremes["min_height"].mean()),
        "peak_down_velocity": float(extremes["peak_down_velocity"].mean()),
        "calf_rise": _rise(loaded, electrical, heat),
    }


def _calves(result: WalkResult) -> Any:
    """The load of the calves' motors alone."""
    square = np.zeros_like(result.joints.torque_square)
    square[:, list(CALF_COLUMNS)] = result.joints.torque_square[:, list(CALF_COLUMNS)]
    return replace(result.joints, torque_square=square)


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if np.size(values) else float("nan")


def _rise(result: WalkResult, electrical: ElectricalCfg, heat: ThermalCfg) -> float:
    """Mean rise of the calf motors over the mission's 300 m with the load, without its pause [K]."""
    if not len(result.speed):
        return float("nan")
    joints = result.joints.mean()
    seconds = 2.0 * DISTANCE / float(result.speed.mean())
    begin = Temperatures.ambient((), joints.torque_square.shape[-1], 0)
    after = thermal.step(begin, motor_heat(joints, electrical), np.zeros(0), seconds, heat)
    return float(after.housing[list(CALF_COLUMNS)].mean())


UNITS = {
    "cot": "1", "power": "W", "coil": "W", "calves": "W", "v_x_rmse": "m/s", "fastest": "m/s", "min_height": "m",
    "peak_down_velocity": "m/s", "calf_rise": "K",
}  # fmt: skip
"""Figures of an arm: means over the four conditions of table 6 of cost of transport, battery power, coils, copper of
the calves and tracking; fastest speed held; lowest trunk and peak downward velocity under the push; calves' rise."""


def figures(rows: Mapping[str, Mapping[int, Mapping[str, Any]]]) -> dict[str, Any]:
    """Mean and 95 % interval over training seeds of every figure, and the paired difference to the arm ``fixed``."""
    found: dict[str, Any] = {}
    for arm, by_seed in rows.items():
        found[arm] = {}
        for name in UNITS:
            values = np.array([row[name] for row in by_seed.values()], dtype=float)
            found[arm][name] = {"mean": float(values.mean()), "half_width": half_width(values), "seeds": len(values)}
        both = [seed for seed in by_seed if seed in rows.get("fixed", {})]
        if arm != "fixed" and both:
            change = np.array([by_seed[s]["cot"] / rows["fixed"][s]["cot"] - 1.0 for s in both])
            found[arm]["cot_change"] = {
                "mean": float(change.mean()),
                "half_width": half_width(change),
                "seeds": len(both),
            }
    return found


def lines(found: Mapping[str, Any]) -> list[str]:
    """The table."""
    digits = {"cot": 3, "v_x_rmse": 3, "min_height": 4, "peak_down_velocity": 3}
    head = ("arm", *(f"{name} [{unit}]" for name, unit in UNITS.items()), "COT against fixed")
    rows = []
    for arm, own in found["arms"].items():
        cells = [f"{own[n]['mean']:.{digits.get(n, 1)}f} ± {own[n]['half_width']:.{digits.get(n, 1)}f}" for n in UNITS]
        change = own.get("cot_change")
        rows.append((TITLES[arm], *cells, f"{change['mean']:+.1%} ± {change['half_width']:.1%}" if change else ""))
    seeds = len(found["seeds"])
    return [
        f"best fixed current {found['best_fixed']:g} A; mean ± half width of the 95 % interval over {seeds} seeds",
        *text_table(head, rows),
    ]


def picture(found: Mapping[str, Any], path: Path) -> None:
    """The Pareto picture: power against tracking and against the drop under a push, a point per arm and seed."""
    figure, ((left, middle, right),) = panels((13, 4.2), columns=3)
    for arm, by_seed in found["measured"].items():
        x = [row["power"] for row in by_seed.values()]
        for axes, name in ((left, "v_x_rmse"), (middle, "min_height")):
            axes.plot(x, [row[name] for row in by_seed.values()], "o", alpha=0.8, label=TITLES[arm])
    left.set(xlabel="battery power [W]", ylabel="v_x RMSE [m/s]")
    middle.set(xlabel="battery power [W]", ylabel="lowest trunk under 100 N [m]")
    left.legend(fontsize=7)
    names, arms = ("coil", "calves"), list(found["arms"])
    bottom = np.zeros(len(arms))
    for name, label in zip(names, ("coils", "copper of the calves"), strict=True):
        values = np.array([found["arms"][arm][name]["mean"] for arm in arms])
        right.bar(arms, values, bottom=bottom, label=label)
        bottom += values
    right.bar(arms, [found["arms"][arm]["power"]["mean"] for arm in arms] - bottom, bottom=bottom, color="0.85",
              label="all else")  # fmt: skip
    right.set(ylabel="battery power [W]")
    right.legend(fontsize=7)
    figure.savefig(path, dpi=120)
