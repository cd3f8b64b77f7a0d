"""The pickup-and-return task with devices that warm up: what that costs their holding, and what compensation costs.

The walks are simulated again and again along the way, with devices as warm as they are by then: a warm fluid yields
earlier and flows more easily, a warm coil has more resistance. Between the windows the thermal model carries on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mrwarp.energy import thermal
from mrwarp.energy.power import ElectricalCfg, JointLoad, battery_power
from mrwarp.energy.thermal import Temperatures, ThermalCfg
from mrwarp.enums import CurrentCommand, HoldCurrent
from mrwarp.env.vec_env import WalkEnv
from mrwarp.params import HoldParams
from mrwarp.runtime import panels, text_table
from mrwarp.trials.mission import MissionCfg, MissionError
from mrwarp.trials.statistics import interval
from mrwarp.trials.walk_trials import WalkBatch, WalkCfg, robot_env, standing_load
from mrwarp.trials.walking import PAYLOAD_VARIANT, Policy, task_devices

MODES = {
    "fixed": "fixed support current",
    "fixed_compensated": "fixed, raised with temperature",
    "law": "law by need at 50 Hz",
    "law_compensated": "law by need and temperature",
}
"""Who sets the holding current: the paper's fixed one (section 5.2), chosen cold by eq. 18 at 1.2 times the 95th
percentile of the need; or the law of :mod:`mrwarp.env.commands`. Each without and with I = tau_y^-1(tau, T)."""

WINDOWS = 3
"""Simulated windows of each phase."""

STILL, SLIPS = 0.01, 0.05
"""A held joint is still below the one speed and slips above the other afterwards [rad/s]; the brake constraint's own
creep is below 3e-4 (docs/determinism.md)."""

GO_ON = 10.0
"""Step of the temperature trace [s]."""


class HoldMeter:
    """How devices hold; one of ``env.substep_hooks``.

    Args:
        env: The environments.

    Attributes:
        holds, slips: Holds that began, and those of them in which a still joint moved again under more load than the
            device bears, shape (E, M).
        held, short: Torque steps while holding, and those in which the yield torque was below the need, (E, M).
        need: Need of each torque step while holding [N·m].
    """

    def __init__(self, env: WalkEnv) -> None:
        self._env, a = env, env.actuator
        self._joints = list(a.mr_joints)
        zeros = torch.zeros_like(env.view(a.m_hold))
        self.holds, self.slips, self.held, self.short = (zeros.clone() for _ in range(4))
        self._before, self._still, self._slipped = (zeros.bool() for _ in range(3))
        self.need: list[torch.Tensor] = []
        env.substep_hooks.append(self.count)

    def count(self) -> None:
        """Add the torque step that has just been simulated."""
        env, a = self._env, self._env.actuator
        hold, speed = env.view(a.m_hold) > 0.0, env.qd[:, self._joints].abs()
        begins = hold & ~self._before
        p = {name: env.view(a.param(name)) for name in ("T_max", "K", "n", "kp_base", "kp_low")}
        need = ((p["kp_base"] - p["kp_low"]) * (env.q_des - env.q)[:, self._joints]).abs()
        ratio = (env.view(a.current) / p["K"]) ** p["n"]
        short = hold & (p["T_max"] * ratio / (1.0 + ratio) < need)
        self._still = hold & ~begins & (self._still | (speed < STILL))
        slips = short & self._still & (speed > SLIPS) & ~self._slipped
        self._slipped = hold & ~begins & (self._slipped | slips)
        self._before = hold
        self.holds += begins
        self.slips += slips
        self.held += hold
        self.short += short
        self.need.append(need[hold])


@dataclass(frozen=True, kw_only=True)
class Window:
    """Measurements of a window with devices of some temperature."""

    joints: JointLoad
    """Mean over the trials, shapes (J,), (M,)."""
    speed: float
    slipped: float
    """Share of the holds."""
    short: float
    """Share of the held time in which the yield torque was below the need."""
    need: np.ndarray
    """Need while holding [N·m], shape (N,)."""


def run(
    cfg: MissionCfg,
    policy: Policy,
    electrical: ElectricalCfg,
    heat: ThermalCfg,
    ambient: float,
    report: Callable[[str, float], None] = lambda text, share: None,
    modes: Sequence[str] = tuple(MODES),
) -> dict[str, Any]:
    """Walk out, stand and walk back with MR_Go-SAL in every mode.

    Args:
        cfg: The task; its ``current`` is the largest that any mode may use.
        policy: What walks.
        electrical: Numbers of the power model.
        heat: Numbers of the thermal model.
        ambient: Temperature of the air above that at which the devices were identified [K].
        report: Called with what is under way and the share that is done.
        modes: Of :data:`MODES`.

    Returns:
        ``modes`` by name, ``fixed_current`` [A] and ``need_95`` [N·m]; ``slipped`` and ``short`` of a window with
        devices as cold as they were identified, and ``ambient`` [K].
    """
    cold = walk_window(cfg, policy, "law", np.zeros(4), cfg.current, cfg.outbound_load, heat, electrical)
    need = float(np.quantile(cold.need, 0.95))
    fixed = _inverse(_hold(cfg), cfg.current, need, 1.0)
    found = {}
    for k, mode in enumerate(modes):
        found[mode] = _mission(
            cfg,
            policy,
            mode,
            need,
            electrical,
            heat,
            ambient,
            lambda share, k=k, mode=mode: report(MODES[mode], (k + share) / len(modes)),
        )
    same = {"slipped": cold.slipped, "short": cold.short, "ambient": ambient}
    return {"modes": found, "fixed_current": fixed, "need_95": need, **same}


def _mission(
    cfg: MissionCfg,
    policy: Policy,
    mode: str,
    need: float,
    electrical: ElectricalCfg,
    heat: ThermalCfg,
    ambient: float,
    report: Callable[[float], None],
) -> dict[str, Any]:
    """One mission: figures, and what happened over time."""
    now = Temperatures.ambient((), 12, 4)
    trace: dict[str, list[float]] = {name: [] for name in ("t", "rise", "strength", "coil")}
    energy, coil_energy, elapsed, windows = 0.0, 0.0, 0.0, []
    phases = [("outbound", cfg.outbound_load), ("standby", cfg.outbound_load), ("return", cfg.return_load)]
    for k, (phase, load) in enumerate(phases):
        for part in range(WINDOWS):
            warm = now.fluid + ambient
            strength, slips = thermal.derated(warm, heat)[0], {}
            if phase == "standby":
                env = _env(cfg, mode, need, float(strength.min()), PAYLOAD_VARIANT)
                joints = standing_load(env, load=load, hold=True, derate=_derating(mode, warm, heat, electrical))[0]
                seconds = cfg.standby / WINDOWS
            else:
                limit = _current(cfg, mode, need, float(strength.min()))
                walked = walk_window(cfg, policy, mode, warm, limit, load, heat, electrical)
                joints, seconds = walked.joints, cfg.distance / WINDOWS / walked.speed
                slips = {"slipped": walked.slipped, "short": walked.short}
            heated = {"coil": float(joints.coil.sum()), "friction": float(joints.friction.sum())}
            windows.append({"phase": phase, "t": elapsed, "rise": float(now.fluid.mean()), **slips, **heated})
            power = float(battery_power(joints, electrical).total)
            for _ in range(max(round(seconds / GO_ON), 1)):
                step = seconds / max(round(seconds / GO_ON), 1)
                now = thermal.step(now, np.zeros(12), joints.coil + joints.friction, step, heat)
                elapsed += step
                trace["t"].append(elapsed)
                trace["rise"].append(float(now.fluid.mean()))
                trace["strength"].append(float(thermal.derated(now.fluid + ambient, heat)[0].min()))
                trace["coil"].append(float(joints.coil.sum()))
            energy += power * seconds
            coil_energy += float(joints.coil.sum()) * seconds / electrical.coil_efficiency
            report((k + (part + 1) / WINDOWS) / 3.0)
    trace["factor"] = _factors(cfg, mode, need, trace["strength"])
    gone = [t for t, factor in zip(trace["t"], trace["factor"], strict=True) if factor < 1.0]
    walks = [w for w in windows if "slipped" in w]
    return {
        "rise": max(trace["rise"]), "yield_left": min(trace["strength"]), "safety_factor_left": min(trace["factor"]),
        "used_up_after": gone[0] if gone else None,
        "slipped": float(np.mean([w["slipped"] for w in walks])),
        "slipped_at_the_end": walks[-1]["slipped"], "short": float(np.mean([w["short"] for w in walks])),
        "coil_energy": coil_energy, "energy": energy, "seconds": elapsed, "windows": windows, "trace": trace,
    }  # fmt: skip


def _hold(cfg: MissionCfg) -> HoldParams:
    """How the task's devices hold."""
    mr = task_devices(cfg.env)[0].mr
    assert mr is not None
    return mr.hold


def _inverse(hold: HoldParams, most: float, need: float, strength: float) -> float:
    """Current at which a device of some strength holds 1.2 times the need [A], eq. 18, up to what is allowed."""
    wanted = min(hold.safety_factor * need / strength, 0.999 * hold.T_max)
    return min(hold.current_for(wanted), most)


def _factors(cfg: MissionCfg, mode: str, need: float, strengths: Sequence[float]) -> list[float]:
    """Yield torque over the need, with the current that a mode gives devices which have so much of their strength left.

    1.2 until a compensated current is as large as is allowed.
    """
    hold, known = _hold(cfg), mode.endswith("compensated")
    currents = [_inverse(hold, cfg.current, need, strength if known else 1.0) for strength in strengths]
    return [s * hold.yield_torque(current) / need for s, current in zip(strengths, currents, strict=True)]


def _current(cfg: MissionCfg, mode: str, need: float, strength: float) -> float:
    """Current that the devices may use in a mode [A]."""
    if not mode.startswith("fixed"):
        return cfg.current
    return _inverse(_hold(cfg), cfg.current, need, strength if mode.endswith("compensated") else 1.0)


def _env(cfg: MissionCfg, mode: str, need: float, strength: float, payload: int) -> Any:
    """The task of a mode."""
    env = robot_env(cfg.env, "mr_go_sal", payload)
    law = mode.startswith("law")
    hold = HoldCurrent.SUPPORT if law else HoldCurrent.FIXED
    return replace(
        env,
        current_by=CurrentCommand.SCHEDULED if law else CurrentCommand.FIXED,
        currents=(_current(cfg, mode, need, strength),),
        hold_current=hold,
    )


def _derating(mode: str, warm: np.ndarray, heat: ThermalCfg, electrical: ElectricalCfg) -> Callable[..., None]:
    """Causes of the warmth of a mode's devices [K above their identification], shape (M,)."""
    strength, viscosity = thermal.derated(warm, heat)

    def derate(env: WalkEnv, robots: Sequence[str] = ()) -> None:
        del robots
        factors: Mapping[str, np.ndarray] = {
            **dict.fromkeys(("T_max", "K0", "K1"), strength),
            "B": viscosity,
            "coil_resistance": 1.0 + electrical.copper_coefficient * warm,
        }
        for name, factor in factors.items():
            env.view(env.actuator.param(name)).mul_(torch.tensor(factor, dtype=torch.float32, device=env.device))
        if mode == "law":  # it takes the devices for as strong as they were cold
            env.arrays.strength.copy_(torch.tensor(1.0 / strength, dtype=torch.float32).expand_as(env.arrays.strength))

    return derate


def walk_window(
    cfg: MissionCfg,
    policy: Policy,
    mode: str,
    warm: np.ndarray,
    limit: float,
    load: float,
    heat: ThermalCfg,
    electrical: ElectricalCfg,
) -> Window:
    """Walk a window with devices so warm [K above their identification], shape (M,)."""
    walk = WalkCfg(
        robots=("mr_go_sal",),
        payloads=(load,),
        speeds=(cfg.speed,),
        trials=cfg.seeds,
        distance=cfg.window,
        current=limit,
        derate=_derating(mode, warm, heat, electrical),
        env=_env(cfg, mode, 1.0, 1.0, 0),
        seed=cfg.seed,
    )
    batch = WalkBatch(walk, ("mr_go_sal",), load, {"mr_go_sal": policy})
    meter = HoldMeter(batch.env)
    (result,) = batch.run()
    if not len(result.speed):
        raise MissionError(f"MR_Go-SAL with {load:g} kg fell or was too slow in every window; choose another policy")
    return Window(
        joints=result.joints.mean(),
        speed=float(result.speed.mean()),
        slipped=float(meter.slips.sum() / meter.holds.sum().clamp(min=1.0)),
        short=float(meter.short.sum() / meter.held.sum().clamp(min=1.0)),
        need=torch.cat(meter.need).cpu().numpy(),
    )


FIGURES = (
    "rise",
    "yield_left",
    "safety_factor_left",
    "slipped",
    "slipped_at_the_end",
    "short",
    "coil_energy",
    "energy",
)
"""Figures of a mission that :func:`over` sums up."""


def over(missions: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Sum up the missions of several policies: means, and half widths of 95 % intervals over the policies.

    Args:
        missions: What :func:`run` gave, by the policy's name; all in the same air, with the same modes.

    Returns:
        ``modes``: by name every figure of :data:`FIGURES`, ``used_up_after`` [s] of each policy, and what compensation
        ``costs`` and changes, policy by policy; ``cold``: the window with cold devices; ``missions`` as they came.
    """
    every, modes = list(missions.values()), {}
    for mode in every[0]["modes"]:
        own = [m["modes"][mode] for m in every]
        modes[mode] = {name: interval([m[name] for m in own]) for name in FIGURES}
        modes[mode]["used_up_after"] = [m["used_up_after"] for m in own]
        plain = mode.removesuffix("_compensated")
        if mode != plain and plain in every[0]["modes"]:
            modes[mode]["against_plain"] = {
                name: interval([m["modes"][mode][name] - m["modes"][plain][name] for m in every]) for name in FIGURES
            }
    shared = {name: interval([m[name] for m in every]) for name in ("fixed_current", "need_95")}
    cold = {name: interval([m[name] for m in every]) for name in ("slipped", "short")}
    return {"modes": modes, "cold": cold, **shared, "ambient": every[0]["ambient"], "missions": missions}


def lines(found: Mapping[str, Any]) -> list[str]:
    """The tables of :func:`over`."""
    many = len(found["missions"]) > 1

    def cell(value: Mapping[str, Any], form: str, factor: float = 1.0, sign: str = "") -> str:
        mean = f"{factor * value['mean']:{sign}{form}}"
        return f"{mean} ± {factor * value['half_width']:{form}}" if many else mean

    rows, costs = [], []
    for mode, m in found["modes"].items():
        gone = [t / 60.0 for t in m["used_up_after"] if t is not None]
        when = f"{min(gone):.0f} to {max(gone):.0f} min" if gone else ""
        used = "not" if not gone else when if len(gone) == len(found["missions"]) else f"{when}, {len(gone)} of them"
        rows.append((
            MODES[mode], cell(m["rise"], ".1f"), cell(m["yield_left"], ".1f", 100.0),
            cell(m["safety_factor_left"], ".3f"), used, cell(m["slipped"], ".1f", 100.0),
            cell(m["short"], ".1f", 100.0), cell(m["coil_energy"], ".2f", 1.0 / 3600.0),
            cell(m["energy"], ".1f", 1.0 / 3600.0),
        ))  # fmt: skip
        if change := m.get("against_plain"):
            costs.append((
                MODES[mode], cell(change["coil_energy"], ".3f", 1.0 / 3600.0, "+"),
                cell(change["energy"], ".2f", 1.0 / 3600.0, "+"), cell(change["slipped"], ".2f", 100.0, "+"),
                cell(change["short"], ".2f", 100.0, "+"),
            ))  # fmt: skip
    head = (
        "holding current",
        "rise [K]",
        "yield left [%]",
        "factor left",
        "used up",
        "holds that slip [%]",
        "time below need [%]",
        "coils [W·h]",
        "battery [W·h]",
    )
    names = (
        "compensation against none",
        "coils [W·h]",
        "battery [W·h]",
        "holds that slip [points]",
        "time below need [points]",
    )
    cold = cell(found["cold"]["slipped"], ".1f", 100.0)
    return [
        f"air {found['ambient']:g} K above the identification; fixed support current "
        f"{cell(found['fixed_current'], '.2f')} A for {cell(found['need_95'], '.1f')} N·m (95 % of the cold need)",
        f"with devices as warm as at their identification {cold} % of the law's holds slip",
        *text_table(head, rows),
        *(["", *text_table(names, costs)] if costs else []),
    ]


def picture(found: Mapping[str, Any], path: Path) -> None:
    """Device temperature, yield that is left, and coils over time; a line for each mode and policy."""
    figure, ((left, middle, right),) = panels((13, 3.8), columns=3)
    for k, mission in enumerate(found["missions"].values()):
        for i, (mode, m) in enumerate(mission["modes"].items()):
            t = np.array(m["trace"]["t"]) / 60.0
            style = {"linestyle": "--" if mode.endswith("compensated") else "-", "color": f"C{i}", "linewidth": 1.1}
            left.plot(t, m["trace"]["rise"], **style, label=MODES[mode] if k == 0 else None)
            middle.plot(t, m["trace"]["factor"], **style)
            right.plot(t, m["trace"]["coil"], **style)
    middle.axhline(1.0, color="black", linewidth=0.8)
    left.set(xlabel="time [min]", ylabel="device above air [K]")
    middle.set(xlabel="time [min]", ylabel="safety factor left")
    right.set(xlabel="time [min]", ylabel="coils [W]")
    left.legend(fontsize=7)
    figure.savefig(path, dpi=120)
