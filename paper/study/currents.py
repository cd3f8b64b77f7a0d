"""Who should command the coils: gates at a fixed current, a law, or the policy; all with the same budget and price.

Every arm goes on from the policy of its robot and training seed, for as many updates, and pays the same price per watt,
coils included; coils lag. Then all are walked and pushed in the same way. Further prices show what power can be had
for what tracking and what drop under a push.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.energy import thermal
from mrwarp.energy.power import ElectricalCfg, JointLoad, battery_power, cost_of_transport, motor_heat
from mrwarp.energy.thermal import Temperatures, ThermalCfg
from mrwarp.enums import ARMS, CurrentCommand, HoldCurrent
from mrwarp.env.cfg import TaskCfg
from mrwarp.paper import DISTANCE
from mrwarp.resources import ENERGY, FIRST_SEEDS, policy_file
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.rl.ppo_cfg import PpoCfg
from mrwarp.runtime import panels, text_table
from mrwarp.trials.impact import ImpactCfg, ImpactSweep, Variant, body_extremes
from mrwarp.trials.statistics import half_width
from mrwarp.trials.walk_trials import WalkCfg, WalkResult, walk
from mrwarp.usd.robot import CALF_COLUMNS, CURRENT_GROUPS, HIP_COLUMNS
from paper.study.matched_training import settled
from paper.study.plan import HIGH_POWER_PRICE, SEEDS, kept, plant_cfg

COMMAND = "mrwarp study current"

ROBOT = {"none": "go1", "off": "mr_go"}
"""Robot of ``paper.ROBOTS`` of an arm; the others are MR_Go-SAL."""

TITLES = {
    "none": "no device (Go1)",
    "off": "device without current",
    "fixed": "gates, best fixed current",
    "latched": "these gates, wide and latched",
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
held is the policy's choice, which commands no current where it wants none. Those of ``latched`` have it too, and the
latch of a commanded gate, at the current of ``fixed``: what ``learned`` saves against it is the command's alone."""

LEARNING = PpoCfg(desired_kl=0.01, entropy=0.0005)
"""How fast networks learn: a step that settles a gait, as that of ``policies/energy``."""


@dataclass(frozen=True, kw_only=True)
class CurrentsCfg:
    """Compared arms, and how long each learns.

    Raises:
        ValueError: no policy to begin with is there for a seed.
    """

    arms: tuple[str, ...] = ARMS
    """Of :data:`mrwarp.enums.ARMS`."""
    seeds: tuple[int, ...] = SEEDS
    """Training seeds, of ``plan.SEEDS``."""
    num_envs: int = 128
    """Training environments."""
    iterations: int = 250
    """PPO updates of every arm; in the first 100 the critic learns alone. 0 measures the shipped policies as they are,
    all arms but ``learned`` with the same policy."""
    power_price: float = HIGH_POWER_PRICE
    """Price of a watt of motors and coils [1/W]."""
    more_prices: tuple[float, ...] = ()
    """Further prices [1/W], for all arms whose coils carry current: they make the front."""
    more_seeds: tuple[int, ...] = FIRST_SEEDS
    """Training seeds there."""
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
    learning: PpoCfg = LEARNING
    """How fast the arms learn."""

    def __post_init__(self) -> None:
        if unknown := [seed for seed in (*self.seeds, *self.more_seeds) if seed not in SEEDS]:
            raise ValueError(f"seed {unknown[0]}: policies to begin with are shipped for 0 to {SEEDS[-1]}")


def arm_env(cfg: CurrentsCfg, arm: str, fixed: float) -> TaskCfg:
    """The task of an arm; ``fixed`` is the current of the arm ``fixed`` [A]."""
    env = plant_cfg(
        ROBOT.get(arm, "mr_go_sal"),
        num_envs=cfg.num_envs,
        threads=cfg.threads,
        randomize="all",
        power_price=cfg.power_price,
    )
    gates = ("fixed", "latched")
    command = CurrentCommand(arm) if arm in ("latched", "scheduled", "learned") else CurrentCommand.FIXED
    hold = HoldCurrent.FIXED if arm in gates else HoldCurrent.SUPPORT
    current = 0.0 if arm in ROBOT else fixed if arm in gates else CURRENT_GROUPS[-1]
    return replace(
        env,
        hold_speed=HOLD_SPEED if arm in ("latched", "learned") else None,
        currents=(current,),
        current_by=command,
        coil_lag=cfg.coil_lag,
        hold_current=hold,
    )


def run(
    cfg: CurrentsCfg,
    out: Path,
    electrical: ElectricalCfg,
    heat: ThermalCfg,
    report: Callable[[str, float], None] = lambda text, share: None,
) -> dict[str, Any] | None:
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
    sweep = kept(out / "fixed_currents.json", _asked(cfg), lambda: sweep_currents(cfg, electrical, report))
    best = float(min(sweep, key=lambda amps: sweep[amps]["cot"]))
    more = replace(cfg, arms=tuple(arm for arm in cfg.arms if arm not in ROBOT), seeds=cfg.more_seeds)
    parts = {cfg.power_price: (cfg, out)}
    parts |= {price: (replace(more, power_price=price), out / f"price_{price:g}") for price in cfg.more_prices}
    jobs = [(price, arm, seed) for price, (part, _) in parts.items() for seed in part.seeds for arm in part.arms]
    rows: dict[float, dict[str, dict[int, dict[str, Any]]]] = {}
    for k, (price, arm, seed) in enumerate(jobs):
        part, folder = parts[price][0], parts[price][1] / f"{arm}_seed{seed}"
        report(f"{arm}, seed {seed}, {price:g} per W", k / len(jobs))
        policy = _trained(part, arm, seed, best, folder)
        if policy is None:
            return None
        measure = partial(measure_policy, part, arm, best, policy, electrical, heat)
        by_arm = rows.setdefault(price, {arm: {} for arm in part.arms})
        by_arm[arm][seed] = kept(folder / "measured.json", _asked(part), measure)
    first, *others = (
        {"arms": figures(found), "measured": found, "power_price": price, "seeds": list(parts[price][0].seeds)}
        for price, found in rows.items()
    )
    return {**first, "more_prices": others, "fixed_currents": sweep, "best_fixed": best}


def _asked(cfg: CurrentsCfg) -> dict[str, Any]:
    """Dependencies of measured figures, except the folder."""
    names = ("coil_lag", "iterations", "trials", "distance", "pushes", "power_price")
    return {name: getattr(cfg, name) for name in names}


def sweep_currents(cfg: CurrentsCfg, electrical: ElectricalCfg, report: Callable[[str, float], None]) -> dict[str, Any]:
    """Mean cost of transport by fixed current, of the policy of seed 0 before it learns with it."""
    found, policy = {}, OnnxPolicy(policy_file(ENERGY, "mr_go_sal", 0))
    for amps in SWEPT:
        report(f"fixed current {amps:g} A", 0.0)
        results = _walks(replace(cfg, trials=2, distance=5.0), "fixed", amps, policy, (0.3, 0.5))
        cots = [float(np.mean(_cot(r, electrical))) for r in results if len(r.speed)]
        found[f"{amps:g}"] = {"cot": float(np.mean(cots)) if len(cots) == len(results) else float("inf"), "by": cots}
    return found


def _trained(cfg: CurrentsCfg, arm: str, seed: int, best: float, folder: Path) -> Path | None:
    """Policy of an arm, trained to the end from the shipped one of its robot and seed; None after Ctrl-C."""
    begin = policy_file(ENERGY, ROBOT.get(arm, "mr_go_sal"), seed)
    if cfg.iterations == 0:
        return begin
    return settled(arm_env(cfg, arm, best), seed, cfg.iterations, cfg.learning, begin, folder, COMMAND)


def _walks(cfg: CurrentsCfg, arm: str, best: float, policy: OnnxPolicy, speeds: Sequence[float]) -> list[WalkResult]:
    """Both loads at some speeds."""
    robot, env = ROBOT.get(arm, "mr_go_sal"), arm_env(cfg, arm, best)
    walks = WalkCfg(
        robots=(robot,),
        speeds=tuple(speeds),
        trials=cfg.trials,
        distance=cfg.distance,
        env=env,
        current=env.currents[0] or CURRENT_GROUPS[-1],
    )
    return walk(walks, {robot: policy})


def _cot(result: WalkResult, electrical: ElectricalCfg) -> np.ndarray:
    return cost_of_transport(battery_power(result.joints, electrical).total, result.mass, result.speed)


def measure_policy(
    cfg: CurrentsCfg, arm: str, best: float, file: Path, electrical: ElectricalCfg, heat: ThermalCfg
) -> dict[str, Any]:
    """Figures of one policy, see :data:`UNITS`."""
    policy = OnnxPolicy(file)
    results = {r.cell: r for r in _walks(cfg, arm, best, policy, (0.3, 0.5, *FAST))}
    found: dict[str, Any] = {}
    for (load, speed), r in results.items():
        name = f"{load:g} kg, {speed:g} m/s"
        if (load, speed) in CELLS:
            parts, borne = battery_power(r.joints, electrical), replace(r.joints, torque_square=r.braking)
            copper = {
                figure: _mean(battery_power(_only(load, joints), electrical).copper)
                for figure, load, joints in (
                    ("calves", r.joints, CALF_COLUMNS), ("calf_oracle", borne, CALF_COLUMNS),
                    ("hips", r.joints, HIP_COLUMNS), ("hip_oracle", borne, HIP_COLUMNS),
                )
            }  # fmt: skip
            found[name] = {
                "cot": _mean(_cot(r, electrical)), "power": _mean(parts.total), "coil": _mean(parts.coil), **copper,
                "v_x_rmse": _mean(r.motion["v_x_rmse"]), "held": _mean(r.hold), "fell": r.fell, "late": r.late,
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
            for name in ("cot", "power", "coil", "calves", "calf_oracle", "hips", "hip_oracle", "v_x_rmse")
        },
        "fastest": max(held, default=0.0),
        "min_height": float(extremes["min_height"].mean()),
        "peak_down_velocity": float(extremes["peak_down_velocity"].mean()),
        "calf_rise": _rise(loaded, electrical, heat),
    }


def _only(load: JointLoad, joints: Sequence[int]) -> JointLoad:
    """The load of some motors alone."""
    square = np.zeros_like(load.torque_square)
    square[:, list(joints)] = load.torque_square[:, list(joints)]
    return replace(load, torque_square=square)


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
    "cot": "1", "power": "W", "coil": "W", "calves": "W", "calf_oracle": "W", "hips": "W", "hip_oracle": "W",
    "rest": "W", "v_x_rmse": "m/s", "fastest": "m/s", "min_height": "m", "peak_down_velocity": "m/s", "calf_rise": "K",
}  # fmt: skip
"""Figures of an arm: means over the four conditions of table 6 of cost of transport, battery power, coils, copper of
the calves and of the hips with what of it brakes could bear at the same motion (an oracle's bound, without its coils),
all but coils and calves, and tracking; fastest speed held; lowest trunk and peak downward velocity under the push;
calves' rise."""


def _value(row: Mapping[str, Any], name: str) -> float:
    """A figure of :data:`UNITS` of one policy."""
    return row["power"] - row["coil"] - row["calves"] if name == "rest" else row[name]


RELATIVE = ("cot", "power")
"""Figures whose difference between arms is a share of the other arm's; of all others it has the figure's unit."""

AGAINST = {"fixed": "the fixed current", "latched": "the same with wide and latched gates"}
"""Arms that others are compared with, seed by seed: ``latched`` with the arm ``learned`` alone, which has its gates."""

AIM = 0.15
"""Share of the cost of transport that commanded coils should save against the arm ``fixed``."""


def figures(rows: Mapping[str, Mapping[int, Mapping[str, Any]]]) -> dict[str, Any]:
    """Mean and 95 % interval over training seeds of every figure, and of its difference to another arm seed by seed.

    ``against_fixed`` and ``against_latched`` hold the differences (:data:`AGAINST`); ``clear`` says that the interval
    leaves out zero.
    """
    found: dict[str, Any] = {}
    for arm, by_seed in rows.items():
        found[arm] = {name: _interval([_value(row, name) for row in by_seed.values()]) for name in UNITS}
        for other in AGAINST:
            both = [seed for seed in by_seed if seed in rows.get(other, {})]
            if both and arm != other and (other == "fixed" or arm == "learned"):
                pairs = [(by_seed[seed], rows[other][seed]) for seed in both]
                found[arm][f"against_{other}"] = {name: _difference(pairs, name) for name in UNITS}
    return found


def _difference(pairs: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]], name: str) -> dict[str, Any]:
    """A figure's difference between two arms, a pair of rows for each seed."""
    own, other = np.array([[_value(row, name) for row in pair] for pair in pairs]).T
    change = _interval(np.divide(own, other) - 1.0 if name in RELATIVE else np.subtract(own, other))
    return {**change, "clear": len(own) > 1 and abs(change["mean"]) > change["half_width"]}


def _interval(values: Sequence[float] | np.ndarray) -> dict[str, Any]:
    numbers = np.asarray(values, dtype=float)
    return {"mean": float(numbers.mean()), "half_width": half_width(numbers), "seeds": len(numbers)}


DIGITS = {"cot": 3, "fastest": 2, "v_x_rmse": 4, "min_height": 4, "peak_down_velocity": 3}


def lines(found: Mapping[str, Any]) -> list[str]:
    """Two tables for each price: figures, and differences to the arm ``fixed``."""
    head = ("arm", *(f"{name} [{unit}]" for name, unit in UNITS.items()))
    text = [f"best fixed current {found['best_fixed']:g} A"]
    for part in (found, *found["more_prices"]):
        own = [(TITLES[arm], *(_cell(name, figure[name]) for name in UNITS)) for arm, figure in part["arms"].items()]
        text += [
            "",
            f"{part['power_price']:g} per W; mean ± half width of the 95 % interval over {len(part['seeds'])} seeds",
            *text_table(head, own),
        ]
        for other, title in AGAINST.items():
            changes = {arm: of[f"against_{other}"] for arm, of in part["arms"].items() if f"against_{other}" in of}
            against = [(TITLES[arm], *(_change(name, of[name]) for name in UNITS)) for arm, of in changes.items()]
            if against:
                text += [f"against {title}, seed by seed; * leaves out zero", *text_table(head, against)]
    return text


def _cell(name: str, value: Mapping[str, Any]) -> str:
    return _with_half(value, f".{DIGITS.get(name, 1)}f", "")


def _change(name: str, value: Mapping[str, Any]) -> str:
    form = ".1%" if name in RELATIVE else f".{DIGITS.get(name, 1)}f"
    return _with_half(value, form, "+") + ("*" if value["clear"] else "")


def _with_half(value: Mapping[str, Any], form: str, sign: str) -> str:
    """Mean and half width; one seed has none."""
    mean = f"{value['mean']:{sign}{form}}"
    return mean if value["seeds"] < 2 else f"{mean} ± {value['half_width']:{form}}"


COLOURS = {
    "none": "0.45", "off": "#7a4fa3", "support": "#c98b3c", "fixed": "#b4451f", "latched": "#d4a017",
    "scheduled": "#3a8f3a", "learned": "#1f6fb4",
}  # fmt: skip


def picture(found: Mapping[str, Any], path: Path) -> None:
    """The front: cost of transport against tracking and drop under a push, a point per policy; where power goes."""
    figure, ((left, middle, right),) = panels((13, 4.4), columns=3)
    parts = sorted((found, *found["more_prices"]), key=lambda part: part["power_price"])
    for axes, name, better in ((left, "v_x_rmse", -1.0), (middle, "min_height", 1.0)):
        points = []
        for k, part in enumerate(parts):
            for arm, by_seed in part["measured"].items():
                xy = np.array([(row["cot"], row[name]) for row in by_seed.values()])
                axes.scatter(*xy.T, s=18.0 * 2.4**k, color=COLOURS[arm], alpha=0.75, linewidths=0)
                points += list(xy) if arm not in ROBOT else []
        front = _front(np.reshape(points, (-1, 2)), better)
        axes.step(*front.T, where="post", color="0.3", linewidth=0.8, linestyle="--", zorder=0)
        if "fixed" in found["arms"]:
            aim = (1.0 - AIM) * found["arms"]["fixed"]["cot"]["mean"]
            axes.axvline(aim, color="0.3", linewidth=0.8, linestyle=":")
            axes.annotate(f" {AIM:.0%} less", (aim, 0.99), xycoords=("data", "axes fraction"), va="top", fontsize=7)
    left.set(xlabel="cost of transport", ylabel="v_x RMSE [m/s]")
    middle.set(xlabel="cost of transport", ylabel="lowest trunk under 100 N [m]")
    for arm in found["arms"]:
        left.scatter([], [], color=COLOURS[arm], s=36.0, label=TITLES[arm])
    left.plot([], [], "--", color="0.3", linewidth=0.8, label="best of all with a device")
    for k, part in enumerate(parts):
        middle.scatter([], [], color="0.6", s=18.0 * 2.4**k, label=f"{part['power_price']:g} per W")
    arms = list(found["arms"])
    bottom = np.zeros(len(arms))
    for name, label, colour in (
        ("coil", "coils", "#1f6fb4"),
        ("calves", "copper of the calves", "#c98b3c"),
        ("rest", "all else", "0.85"),
    ):
        values = np.array([found["arms"][arm][name]["mean"] for arm in arms])
        right.bar(arms, values, bottom=bottom, label=label, color=colour)
        bottom += values
    right.set(ylabel="battery power [W]", title=f"{found['power_price']:g} per W")
    right.set_ylim(top=1.2 * bottom.max())
    right.legend(fontsize=7)
    handles = [*left.get_legend_handles_labels()[0], *middle.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=8)
    figure.savefig(path, dpi=120)


def _front(points: np.ndarray, better: float) -> np.ndarray:
    """Points, shape (n, 2), that no other beats in both: less of the first, and of the second as ``better`` says."""
    kept_points: list[np.ndarray] = []
    for point in points[np.lexsort((-better * points[:, 1], points[:, 0]))]:
        if not kept_points or better * point[1] > better * kept_points[-1][1]:
            kept_points.append(point)
    return np.reshape(kept_points, (-1, 2))
