"""Where holding ends: faster gaits, heavier loads, a softer motor and a slower coil, age, and a stance on four brakes.

The shipped policies of MR_Go-SAL walk as they are: they know the 1.5 Hz clock, loads up to 3.5 kg, and coils without
lag. Policies that were trained on at each clock may walk next to them. Each part is one batch, or one per gait or
ground; every setting meets the same robots, poses and gait phases.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mrwarp.energy.power import ElectricalCfg, battery_power, cost_of_transport
from mrwarp.enums import HoldCurrent
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.paper import GRAVITY
from mrwarp.params import MrParams
from mrwarp.resources import ENERGY, policy_file
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.runtime import panels, text_table
from mrwarp.trials.power_meter import MotionMeter, PowerMeter
from mrwarp.trials.statistics import interval, share
from mrwarp.trials.thermal_mission import HoldMeter
from mrwarp.trials.walk_trials import STAND_HOLD, STAND_RATE, STAND_SETTLE, STAND_STIFFER
from mrwarp.trials.walking import PAYLOAD_VARIANT, Policy, act, make_env, set_payload
from paper.study.currents import HELD, LEARNING
from paper.study.matched_training import settled
from paper.study.plan import check_seeds, kept, plant_cfg

ROBOT = "mr_go_sal"

GAITS = (1.5, 2.0, 2.5)
"""Stride frequencies of the clock [Hz]."""
SPEEDS = tuple(k / 10 for k in range(3, 19))
"""Commanded speeds at each [m/s]."""
LEARNERS, LEARNED = 128, (0.2, 1.4)
"""Robots that learn together at a clock, and the speeds that they are commanded [m/s]."""
PAYLOADS = (0.0, 2.0, 4.0, 6.0, 8.0)
"""Loads on the back [kg]."""
GAINS, LAGS = (0.0, 5.0, 10.0, 15.0), (0.0, 0.01, 0.025, 0.05)
"""Motor gains while holding [N·m/rad], and time constants of the coils [s]."""
PAPER_GAIN = GAINS.index(5.0) * len(LAGS)
"""Setting that others are compared with: the paper's gain, coils without lag."""
LOSSES = (0.0, 0.1, 0.2, 0.3, 0.4)
"""Losses of yield and hysteresis with age [1]."""
STAND_CURRENTS = (0.0, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.7, 1.0, 1.5)
"""Holding currents of a stance [A]; without current the motors show what the knees need."""
SLOPES = (0.0, 0.15, 0.3)
"""Uphill slopes that it stands on [1]."""
LATERAL = (0.0, 10.0, 20.0)
"""Loads to the left, at the trunk [N]."""
STAND_SECONDS = 10.0
"""Time over which a stance drifts [s]."""
MARGINS = (0.0, 1.0, 1.2, 1.5, 2.0, np.inf)
"""Bounds of the classes of yield margin."""


@dataclass(frozen=True, kw_only=True)
class LimitsCfg:
    """How much is walked and stood."""

    seeds: tuple[int, ...] = (0, 1, 2)
    """Training seeds of the policies."""
    trials: int = 2
    """Walks of each setting and policy, and stances of each."""
    seconds: float = 10.0
    """Measured time of a walk [s]."""
    policies: Path = ENERGY
    """Folder of policies of MR_Go-SAL."""
    train: int = 0
    """PPO updates of further policies, one for each clock and seed, that go on from the shipped ones; 0 = none."""
    threads: int = 0
    """CPU threads of the physics; 0 = all, the figures are the same."""

    def __post_init__(self) -> None:
        check_seeds(self.seeds)


def task(cfg: LimitsCfg, *, payload: int = 0, terrain: str = "flat", hold: HoldCurrent | None = None) -> TaskCfg:
    """MR_Go-SAL's task; ``hold``: the holding current, by default the support current."""
    env = replace(plant_cfg(ROBOT, threads=cfg.threads, terrain=terrain), payload=payload)
    return replace(env, hold_current=hold) if hold else env


@torch.no_grad()
def walk(
    env: WalkEnv,
    policies: Sequence[Policy],
    speed: np.ndarray,
    mass: np.ndarray,
    seconds: float,
    electrical: ElectricalCfg,
    *,
    trials: int,
    warmup: float = 2.0,
    watch: Callable[[], None] | None = None,
) -> dict[str, np.ndarray]:
    """Walk for a time; policies drive equal parts of the environments, groups of ``trials`` begin identically.

    Args:
        env: The environments, with their settings.
        policies: The policies.
        speed: Commanded speed [m/s], shape (E,).
        mass: Mass of each robot [kg], shape (E,).
        seconds: Measured time, up to a fall [s].
        electrical: Numbers of the power model.
        trials: Walks of each setting.
        warmup: Walking before it [s].
        watch: Called after every torque step, that of the warm-up too.

    Returns:
        By name, shape (E,): ``fell``, ``speed`` and ``v_x_rmse`` [m/s], ``power`` and ``coil`` [W], ``cot``, ``hold``
        share of time, ``clock`` share of time in which contacts are the clock's, ``slipped`` share of the holds,
        ``short`` and ``full`` shares of the held time in which the device yields below its need or has all the current;
        NaN where a robot never began.
    """
    env.restart()
    env.copy_envs(torch.arange(env.num_envs, device=env.device) % trials)
    command = torch.zeros(env.num_envs, 3, device=env.device)
    command[:, 0] = torch.tensor(speed, device=env.device)
    env.set_command(command)
    env.substep_hooks.clear()
    meter, holds, motion = PowerMeter(env), HoldMeter(env), MotionMeter(env, command)
    device = env.actuator
    most = torch.minimum(env.current_e[:, None], env.view(device.param("current_max")))
    full, clock = torch.zeros_like(holds.held), torch.zeros(env.num_envs, device=env.device)
    env.substep_hooks.append(
        lambda: full.add_((env.view(device.m_hold) > 0.0) & (env.view(device.coil) >= 0.99 * most))
    )
    if watch is not None:
        env.substep_hooks.append(watch)
    going = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)
    skip = round(warmup / env.cfg.step_dt)
    obs = env.get_observations()
    for step in range(skip + round(seconds / env.cfg.step_dt)):
        meter.on.copy_(going & (step >= skip))
        obs, _, _, _ = env.step(act(policies, obs))
        env.set_command(command)
        going = going & ~env.fallen
        if step >= skip:
            motion.add(going)
            clock += going * env.clock_match.float().mean(1)
    env.substep_hooks.clear()
    figures, parts = motion.figures(), battery_power(meter.joint_load(), electrical)
    steps = (motion.seconds / env.cfg.step_dt).cpu().numpy()
    held = holds.held.sum(1).clamp(min=1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return {
            "fell": ~going.cpu().numpy(),
            "speed": figures["speed"],
            "v_x_rmse": figures["v_x_rmse"],
            "power": np.where(steps > 0, parts.total, np.nan),
            "coil": np.where(steps > 0, parts.coil, np.nan),
            "cot": cost_of_transport(parts.total, mass, figures["speed"]),
            "hold": np.where(steps > 0, meter.hold.mean(1), np.nan),
            "clock": clock.cpu().numpy() / steps,
            "slipped": (holds.slips.sum(1) / holds.holds.sum(1).clamp(min=1.0)).cpu().numpy(),
            "short": (holds.short.sum(1) / held).cpu().numpy(),
            "full": (full.sum(1) / held).cpu().numpy(),
        }


def settings(cfg: LimitsCfg, values: Sequence[Any]) -> np.ndarray:
    """Values of the settings by environment: policies x settings x trials, shape (E, ...)."""
    return np.tile(np.repeat(np.array(values), cfg.trials, axis=0), (len(cfg.seeds), *[1] * (np.ndim(values) - 1)))


def by_setting(cfg: LimitsCfg, found: Mapping[str, np.ndarray], count: int) -> dict[str, Any]:
    """Figures of :func:`walk` by setting: means over the trials of each policy, shape (settings, policies)."""
    shape = (len(cfg.seeds), count, cfg.trials)
    return {name: values.reshape(shape).mean(axis=2).T.tolist() for name, values in found.items()}


def learners(cfg: LimitsCfg, frequency: float) -> TaskCfg:
    """Task in which policies learn a clock of this frequency [Hz]: that of the shipped ones, with faster commands."""
    env = plant_cfg(ROBOT, num_envs=LEARNERS, threads=cfg.threads, randomize="all")
    return replace(env, gait_frequency=frequency, commands=replace(env.commands, v_x=LEARNED))


def train(
    cfg: LimitsCfg, out: Path, report: Callable[[str, float], None] = lambda text, share: None
) -> dict[float, list[Path]] | None:
    """Policies of each clock by seed, trained in a folder where they are not there yet; None after Ctrl-C."""
    found: dict[float, list[Path]] = {f: [] for f in GAITS}
    jobs = [(seed, f) for seed in cfg.seeds for f in GAITS]
    for k, (seed, f) in enumerate(jobs):
        report(f"training, {f:g} Hz, seed {seed}", k / len(jobs))
        begin, folder = policy_file(cfg.policies, ROBOT, seed), out / f"{f:g}_Hz_seed{seed}"
        policy = settled(learners(cfg, f), seed, cfg.train, LEARNING, begin, folder, "mrwarp study limits")
        if policy is None:
            return None
        found[f].append(policy)
    return found


def _mass(env: WalkEnv, payload: np.ndarray | float = 0.0) -> np.ndarray:
    return np.full(env.num_envs, float(env.sim.scene.model.body_mass.sum()) - env.cfg.payload) + payload


def gait(cfg: LimitsCfg, frequency: float, policies: Sequence[Policy], electrical: ElectricalCfg) -> dict[str, Any]:
    """Walk with a clock of this frequency [Hz] at all of :data:`SPEEDS`; figures of shape (speeds, policies)."""
    speed = settings(cfg, SPEEDS)
    env = make_env(replace(task(cfg), gait_frequency=frequency), len(speed), 0)
    found = walk(env, policies, speed, _mass(env), cfg.seconds, electrical, trials=cfg.trials)
    return by_setting(cfg, found, len(SPEEDS))


def payload(cfg: LimitsCfg, policies: Sequence[Policy], electrical: ElectricalCfg) -> dict[str, Any]:
    """Walk with all of :data:`PAYLOADS` at 0.3 m/s; figures of shape (loads, policies)."""
    load = settings(cfg, PAYLOADS)
    env = make_env(task(cfg, payload=PAYLOAD_VARIANT), len(load), 0)
    set_payload(env, load)
    speed = np.full(len(load), 0.3)
    found = walk(env, policies, speed, _mass(env, load), cfg.seconds, electrical, trials=cfg.trials)
    return by_setting(cfg, found, len(PAYLOADS))


def gain_and_lag(cfg: LimitsCfg, policies: Sequence[Policy], electrical: ElectricalCfg) -> dict[str, Any]:
    """Walk at 0.5 m/s with all of :data:`GAINS` and :data:`LAGS`; figures of shape (gains x lags, policies)."""
    pairs = [(gain, lag) for gain in GAINS for lag in LAGS]
    values = settings(cfg, pairs)
    env = make_env(task(cfg), len(values), 0)
    for name, column in zip(("kp_low", "coil_time_constant"), values.T, strict=True):
        env.actuator.set_param(name, column[:, None])
    speed = np.full(len(values), 0.5)
    found = walk(env, policies, speed, _mass(env), cfg.seconds, electrical, trials=cfg.trials)
    return by_setting(cfg, found, len(pairs))


def age(cfg: LimitsCfg, policies: Sequence[Policy], electrical: ElectricalCfg) -> dict[str, Any]:
    """Walk at 0.5 m/s with 3 kg and devices that have lost :data:`LOSSES`; figures of shape (losses x 2, policies).

    Each loss twice: the holding current is set for the device as it was new, and for the device as it is, re-fitted.
    """
    cases = [(1.0 - loss, known) for loss in LOSSES for known in (False, True)]
    left, known = settings(cfg, cases).T
    env = make_env(task(cfg, payload=PAYLOAD_VARIANT), len(left), 0)
    factor = torch.tensor(left, dtype=torch.float32, device=env.device)[:, None]
    for name in ("T_max", "K0", "K1"):
        env.view(env.actuator.param(name)).mul_(factor)
    # eq. 18 is solved for the T_max that a device has: with the safety factor times what is left it is a new one's
    env.view(env.actuator.param("safety_factor")).mul_(torch.where(torch.tensor(known[:, None] > 0.0), 1.0, factor))
    speed, load = np.full(len(left), 0.5), np.full(len(left), float(PAYLOAD_VARIANT))
    found = walk(env, policies, speed, _mass(env, load), cfg.seconds, electrical, trials=cfg.trials)
    return by_setting(cfg, found, len(cases))


@torch.no_grad()
def stance(cfg: LimitsCfg, ground: str) -> dict[str, Any]:
    """Stand with the knees held by their devices, uphill or on rough ground, under a load to the left.

    A standing controller has moved the targets until the joints stand where they should, with the slope, before the
    devices take over and the load comes. A slope is gravity turned: a force on every body.

    Returns:
        Of each stance: ``slope``, ``lateral`` [N], ``current`` [A], ``margin``: least over the knees of the yield
        torque over the need, which is the torque of that knee's motor in the same stance without current, less the
        share that the low gain keeps; ``drift``: largest over the knees that are held before and after
        :data:`STAND_SECONDS` [rad]; ``sank``: trunk [m]; ``slipped``: whether a knee that was still slid; ``fell``;
        ``held``: mean share of time.
    """
    rough = ground == "rough"
    cases = [(s, load, amps) for s in (SLOPES[:1] if rough else SLOPES) for load in LATERAL for amps in STAND_CURRENTS]
    slope, lateral, current = np.repeat(np.array(cases), 2 * cfg.trials, axis=0).T
    env = make_env(task(cfg, terrain=ground, hold=HoldCurrent.FIXED), len(slope), 0)
    if env.terrain is not None:
        env.terrain.level[:], env.terrain.kind[:] = env.terrain.cfg.levels - 1, 0
    actuator, dt = env.actuator, env.cfg.step_dt
    for array in (actuator.kp, actuator.kd, actuator.param("kp_base"), actuator.param("kd")):
        env.view(array).mul_(STAND_STIFFER)
    env.restart()
    env.copy_envs(torch.arange(env.num_envs, device=env.device) % (2 * cfg.trials))
    env.set_command(torch.zeros(env.num_envs, 3, device=env.device))
    turned = np.stack([-np.sin(np.arctan(slope)), 0.0 * slope, 1.0 - np.cos(np.arctan(slope))], axis=1)
    model, trunk = env.sim.scene.model, env.sim.body(env.layout.trunk)

    def load(newton: np.ndarray) -> None:
        side = np.stack([0.0 * newton, newton, 0.0 * newton], axis=1)
        for b in range(1, model.nbody):
            env.sim.push(model.body(b).name, GRAVITY * model.body_mass[b] * turned + side * (b == trunk))

    load(0.0 * lateral)
    env.current_e.zero_()
    actions = torch.zeros(env.num_envs, env.num_actions, device=env.device)
    fell = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)
    for _ in range(round(STAND_SETTLE / dt)):
        actions += STAND_RATE * dt / env.cfg.action_scale * (env.default_q - env.q)
        env.step(actions)
        fell |= env.fallen
    env.current_e.copy_(torch.tensor(current, dtype=torch.float32))
    for _ in range(round(STAND_HOLD / dt)):
        env.step(actions)
        fell |= env.fallen
    knees = list(actuator.mr_joints)
    holds, begin, height = HoldMeter(env), env.q[:, knees].clone(), env.height.clone()
    held = env.view(actuator.m_hold) > 0.0
    load(lateral)
    for _ in range(round(STAND_SECONDS / dt)):
        env.step(actions)
        fell |= env.fallen
    torque = env.view(actuator.tau_motor)[:, knees].abs().cpu().numpy()
    count = len(STAND_CURRENTS)
    alone = torque.reshape(-1, count, 2 * cfg.trials, len(knees))[:, :1]  # without current
    p = MrParams()
    need = (1.0 - p.motor.kp_low / (STAND_STIFFER * p.motor.kp_base)) * alone
    bears = np.array([p.hold.yield_torque(amps) for amps in STAND_CURRENTS])[:, None, None]
    held &= env.view(actuator.m_hold) > 0.0
    drift = ((env.q[:, knees] - begin).abs() * held).amax(1)
    return {
        "slope": slope, "lateral": lateral, "current": current,
        "margin": (bears / np.maximum(need, 1e-6)).min(axis=3).ravel(),
        "drift": drift.cpu().numpy(), "sank": (height - env.height).cpu().numpy(),
        "slipped": holds.slips.sum(1).cpu().numpy() > 0, "fell": fell.cpu().numpy(),
        "held": (holds.held.mean(1) / (STAND_SECONDS / env.sim.dt)).cpu().numpy(),
    }  # fmt: skip


def run(
    cfg: LimitsCfg,
    out: Path,
    electrical: ElectricalCfg,
    report: Callable[[str, float], None] = lambda text, share: None,
) -> dict[str, Any] | None:
    """Train and measure what is not in ``out`` yet, and sum up; None after Ctrl-C in a training.

    Raises:
        ValueError: a file in ``out`` is damaged or of other choices, or a policy is missing.
    """
    asked = {name: getattr(cfg, name) for name in ("seeds", "trials", "seconds", "policies")}
    policies = [OnnxPolicy(policy_file(cfg.policies, ROBOT, seed)) for seed in cfg.seeds]
    jobs: dict[str, Callable[[], dict[str, Any]]] = {
        **{f"gait {f:g} Hz": partial(gait, cfg, f, policies, electrical) for f in GAITS},
        "payload": partial(payload, cfg, policies, electrical),
        "gain and lag": partial(gain_and_lag, cfg, policies, electrical),
        "age": partial(age, cfg, policies, electrical),
        **{f"stance, {ground}": partial(stance, cfg, ground) for ground in ("flat", "rough")},
    }
    learned = train(cfg, out / "trained", report) if cfg.train else {}
    if learned is None:
        return None
    for f, files in learned.items():
        own = [OnnxPolicy(file) for file in files]
        jobs[f"gait {f:g} Hz, trained"] = partial(gait, cfg, f, own, electrical)
    found = {}
    for k, (name, measure) in enumerate(jobs.items()):
        report(name, k / len(jobs))
        of = asked | ({"train": cfg.train} if name.endswith("trained") else {})
        found[name] = kept(out / "parts" / f"{name.replace(', ', '_').replace(' ', '_')}.json", of, measure)
    return {
        "gait": gait_rows(found, ""),
        "gait_trained": gait_rows(found, ", trained") if learned else {},
        "payload": {f"{load:g}": row(found["payload"], i) for i, load in enumerate(PAYLOADS)},
        "gain_and_lag": {
            f"{gain:g}, {1e3 * lag:g} ms": row(found["gain and lag"], i * len(LAGS) + k, against=PAPER_GAIN)
            for i, gain in enumerate(GAINS)
            for k, lag in enumerate(LAGS)
        },
        "age": {
            f"{loss:.0%}, {who}": row(found["age"], 2 * i + k, against=0)
            for i, loss in enumerate(LOSSES)
            for k, who in enumerate(("as new", "re-fitted"))
        },
        "stance": {ground: margin_rows(found[f"stance, {ground}"]) for ground in ("flat", "rough")},
        "stances": {ground: found[f"stance, {ground}"] for ground in ("flat", "rough")},
    }


def row(found: Mapping[str, Any], setting: int, *, against: int | None = None) -> dict[str, Any]:
    """Every figure of a setting over its policies, and the change of the power [W] against another, paired."""
    rows = {name: interval(values[setting]) for name, values in found.items()}
    if against is None:
        return rows
    change = np.array(found["power"][setting], dtype=float) - np.array(found["power"][against], dtype=float)
    return rows | {"power_change": interval(change)}


def steps_held(found: Mapping[str, Any]) -> np.ndarray:
    """How many of :data:`SPEEDS` each policy holds: nobody falls, 90 % of it, and all slower ones too; shape (P,)."""
    speed, fell = np.array(found["speed"], dtype=float), np.array(found["fell"], dtype=float)
    return np.cumprod((fell == 0.0) & (speed >= HELD * np.array(SPEEDS)[:, None]), axis=0).sum(axis=0)


def gait_row(found: Mapping[str, Any], first: Mapping[str, Any]) -> dict[str, Any]:
    """Fastest speed that is held, figures there and by speed; over policies.

    ``first``: figures of the gait that speed and power at 0.5 m/s are compared with, policy by policy.
    """
    upto, before = steps_held(found), steps_held(first)
    speeds, at = np.array([0.0, *SPEEDS]), SPEEDS.index(0.5)
    there = {name: interval([values[max(n - 1, 0)][k] for k, n in enumerate(upto)]) for name, values in found.items()}
    power = np.array(found["power"][at], dtype=float) - np.array(first["power"][at], dtype=float)
    return {
        "fastest": interval(speeds[upto]), "fastest_change": interval(speeds[upto] - speeds[before]), "there": there,
        "by_speed": {f"{v:g}": row(found, i) for i, v in enumerate(SPEEDS)}, "power_change": interval(power),
    }  # fmt: skip


def gait_rows(found: Mapping[str, Mapping[str, Any]], kind: str) -> dict[str, Any]:
    """Rows of all clocks, compared with the first of the same ``kind``: the end of the part's name."""
    first = found[f"gait {GAITS[0]:g} Hz{kind}"]
    return {f"{f:g}": gait_row(found[f"gait {f:g} Hz{kind}"], first) for f in GAITS}


def margin_rows(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Stances that did not fall by class of yield margin: share that slipped, median and largest drift [rad]."""
    margin, drift = np.array(found["margin"], dtype=float), np.array(found["drift"], dtype=float)
    slipped, current = np.array(found["slipped"], dtype=bool), np.array(found["current"], dtype=float)
    stands = (current > 0.0) & ~np.array(found["fell"], dtype=bool)
    rows = []
    for low, high in zip(MARGINS[:-1], MARGINS[1:], strict=True):
        own = (margin >= low) & (margin < high) & stands
        if own.any():
            rows.append({
                "low": low, "high": high, "slipped": share(int(slipped[own].sum()), int(own.sum())),
                "stances": int(own.sum()), "drift": float(np.median(drift[own])), "most": float(drift[own].max()),
            })  # fmt: skip
    return rows


def lines(found: Mapping[str, Any]) -> list[str]:
    """The tables."""

    def cell(own: Mapping[str, Any], digits: int = 2, factor: float = 1.0) -> str:
        return f"{factor * own['mean']:.{digits}f} ± {factor * own['half_width']:.{digits}f}"

    def change(own: Mapping[str, Any]) -> str:
        return f"{own['power_change']['mean']:+.1f} ± {own['power_change']['half_width']:.1f}"

    gaits = [
        (
            f"{f} Hz{kind}",
            ", ".join(f"{v:g}" for v in own["fastest"]["values"]),
            cell(own["fastest_change"]),
            change(own),
            *(cell(own["by_speed"]["0.5"][n], d, k) for n, d, k in SHOWN),
        )
        for rows, kind in ((found["gait"], ""), (found["gait_trained"], ", trained"))
        for f, own in rows.items()
    ]
    names = [f"{name} [%]" if factor > 1.0 else name for name, _, factor in SHOWN]
    loads = [(f"{load} kg", *(cell(own[n], d, k) for n, d, k in SHOWN)) for load, own in found["payload"].items()]
    pairs = [
        (pair, change(own), *(cell(own[n], d, k) for n, d, k in SHOWN)) for pair, own in found["gain_and_lag"].items()
    ]
    ages = [(name, change(own), *(cell(own[n], d, k) for n, d, k in SHOWN)) for name, own in found["age"].items()]
    stances = [
        (
            f"{ground}, {r['low']:g} to {r['high'] if r['high'] is not None else np.inf:g}",
            str(r["stances"]),
            f"{100 * r['slipped']['share']:.0f} ({100 * r['slipped']['low']:.0f} to {100 * r['slipped']['high']:.0f})",
            f"{1e3 * r['drift']:.1f}",
            f"{1e3 * r['most']:.1f}",
        )
        for ground, rows in found["stance"].items()
        for r in rows
    ]
    return [
        *text_table(("gait, at 0.5 m/s", "fastest held [m/s]", "against 1.5 Hz", "and [W]", *names), gaits), "",
        *text_table(("load, at 0.3 m/s", *names), loads), "",
        *text_table(("Kp_low [N·m/rad], lag", "against 5, 0 ms [W]", *names), pairs), "",
        *text_table(("loss, current set for the device", "against new [W]", *names), ages), "",
        *text_table(("stance, yield margin", "stances", "slipped [%]", "drift [mrad]", "most"), stances),
    ]  # fmt: skip


SHOWN = (
    ("fell", 0, 100.0), ("speed", 2, 1.0), ("cot", 2, 1.0), ("power", 1, 1.0), ("hold", 0, 100.0), ("clock", 0, 100.0),
    ("slipped", 1, 100.0), ("short", 1, 100.0), ("full", 1, 100.0),
)  # fmt: skip
"""Figures of a walk in the tables: digits, and 100 for a share."""


def picture(found: Mapping[str, Any], path: Path) -> None:
    """A panel for each part."""
    figure, ((left, right), (low, stand)) = panels((11, 8), 2, 2)
    for rows, mark, kind in ((found["gait"], ".", ""), (found["gait_trained"], "x", ", trained there")):
        for k, (f, own) in enumerate(rows.items()):
            points = [(v + 0.018 * (k - 1), x) for v in SPEEDS for x in own["by_speed"][f"{v:g}"]["speed"]["values"]]
            left.plot(*np.array(points).T, mark, color=f"C{k}", markersize=4, label=f"{f} Hz{kind}")
    left.plot(SPEEDS, SPEEDS, color="0.6", linewidth=0.8)
    left.set(xlabel="commanded speed [m/s]", ylabel="speed [m/s]", title="gait, each policy")
    left.legend(fontsize=8)
    for name, label in (("hold", "time held"), ("short", "held time below the need"), ("full", "held time at 1.5 A")):
        rows = [own[name] for own in found["payload"].values()]
        means, spread = ([100.0 * r[key] for r in rows] for key in ("mean", "half_width"))
        right.errorbar(PAYLOADS, means, spread, marker="o", capsize=2, label=label)
    right.set(xlabel="load [kg]", ylabel="share [%]", title="payload, 0.3 m/s")
    right.legend(fontsize=8)
    for k, gain in enumerate(GAINS):
        rows = [found["gain_and_lag"][f"{gain:g}, {1e3 * lag:g} ms"]["power_change"] for lag in LAGS]
        means, spread = ([r[key] for r in rows] for key in ("mean", "half_width"))
        at = 1e3 * np.array(LAGS) + 0.6 * (k - 1.5)
        low.errorbar(at, means, spread, marker="o", capsize=2, label=f"Kp_low {gain:g} N·m/rad")
    low.set(
        xlabel="coil lag [ms]", ylabel="power at 0.5 m/s against Kp_low 5, no lag [W]", title="low gain and coil lag"
    )
    low.legend(fontsize=8)
    for ground, own in found["stances"].items():
        margin, drift = np.array(own["margin"], dtype=float), np.array(own["drift"], dtype=float)
        # where no knee is held throughout there is no drift to show
        on = (np.array(own["current"]) > 0.0) & ~np.array(own["fell"], dtype=bool) & (drift > 0.0)
        stand.loglog(margin[on], 1e3 * drift[on], ".", alpha=0.6, label=ground)
    stand.axvline(1.0, color="0.6", linewidth=0.8)
    stand.axvline(MrParams().hold.safety_factor, color="0.6", linewidth=0.8, linestyle="--")
    stand.set_xticks(ticks := (0.2, 0.5, 1.0, 2.0, 5.0), [f"{x:g}" for x in ticks], minor=False)
    stand.set_xticks([], minor=True)
    stand.set(
        xlabel="yield margin of the weakest knee",
        ylabel=f"drift over {STAND_SECONDS:g} s [mrad]",
        title="stance on four brakes",
    )
    stand.legend(loc="upper right", fontsize=8)
    figure.savefig(path, dpi=110)
