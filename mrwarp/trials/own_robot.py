"""Cost of transport of a robot of one's own by the current of its devices: the same walks with each current."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mrwarp.energy.power import GO1_LIMIT, ElectricalCfg, JointLoad, battery_power, cost_of_transport
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.natural_units import Scales, scales_of
from mrwarp.runtime import figure_text, panels, text_table
from mrwarp.trials.energy_report import walked
from mrwarp.trials.joint_need import chatter
from mrwarp.trials.power_meter import MotionMeter, PowerMeter
from mrwarp.trials.statistics import spread
from mrwarp.trials.walk_pictures import NOT_WHOLE, shown_cost
from mrwarp.trials.walking import Policy, lost_lines, make_env, same_starts
from mrwarp.usd.asset import JointActuator, most_current
from mrwarp.usd.robot import CURRENT_GROUPS

PATIENCE, WARMUP = 2.0, 2.0
"""A trial fails when it takes this many times ``distance/speed``; walking before it is measured [s]."""


def as_go1(joints: JointLoad, limits: np.ndarray, by: Scales) -> JointLoad:
    """Means of joints in Go1's units: the share of each motor's torque limit, times and powers by the robot's size.

    Nobody measured the motors of these robots. The assumption is that they are as good as Go1's: at its joint's torque
    limit a motor loses the heat that Go1's does at its own, in proportion to the robot's power (mass times speed), and
    electronics and drive friction have Go1's share of it too.

    Args:
        joints: Means, shapes (..., J) and (..., M).
        limits: Torque limits of the joints [N·m], shape (J,).
        by: The robot's size.
    """
    return JointLoad(
        torque_square=joints.torque_square * (GO1_LIMIT / limits) ** 2,
        speed=joints.speed * by.time,
        work_out=joints.work_out / by.power,
        work_in=joints.work_in / by.power,
        coil=joints.coil / by.power,
        friction=joints.friction / by.power,
    )


def assumption(by: Scales) -> str:
    """The rule of :func:`as_go1` and its factors, for the user."""
    return (
        "assumed: motors as good as Go1's, whose energy model was calibrated: a motor loses at its torque limit "
        f"what Go1's does there, powers x {by.power:.3g}, torques of the drives' friction x {by.torque:.3g}"
    )


def currents_of(devices: Sequence[JointActuator], current: float) -> list[float]:
    """None, a third, two thirds and all of what the devices take of a current [A]."""
    return list(dict.fromkeys(CURRENT_GROUPS.of(min(current, most_current(devices)))))


@torch.no_grad()
def walk_currents(
    task: TaskCfg,
    policy: Policy,
    *,
    currents: Sequence[float],
    speeds: Sequence[float],
    payload: float,
    trials: int,
    distance: float,
    seed: int,
    cfg: ElectricalCfg,
    report: Callable[[float], None] = lambda share: None,
) -> list[dict[str, Any]]:
    """Walk a distance with every current and speed, from the same poses and gait phases.

    Args:
        task: The robot.
        policy: Its policy.
        currents: Currents the devices may use [A]; 0 is SAL off.
        speeds: Commands [m/s].
        payload: Mass on the trunk [kg].
        trials: Repetitions.
        distance: [m]
        seed: Seed of poses and phases.
        cfg: Numbers of the energy model, Go1's.
        report: Called with the share that is done.

    Returns:
        A row per current and speed: ``power`` [W] and its ``parts``, ``cot`` [1], ``speed`` [m/s], ``v_x_rmse``,
        ``hold`` and ``damping`` shares of time, ``switches`` of gates [1/s], trials that ``fell`` or were ``late``;
        spreads are over the trials.
    """
    conditions = [(current, speed) for current in currents for speed in speeds]
    env = make_env(replace(task, payload=payload), len(conditions) * trials, seed)
    limits = np.array([actuator.tau_limit for actuator in env.sim.scene.actuators])
    mass, by, dt = float(env.sim.scene.model.body_mass.sum()), env.scales, env.cfg.step_dt
    each = torch.tensor(conditions, device=env.device).repeat_interleave(trials, dim=0)
    env.restart()
    same_starts(env, trials, seed)
    env.current_e.copy_(each[:, 0])
    command = torch.zeros(env.num_envs, 3, device=env.device)
    command[:, 0] = each[:, 1]
    env.set_command(command)
    meter, motion = PowerMeter(env), MotionMeter(env, command)
    fell = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)
    going, obs = ~fell, env.get_observations()
    skip = round(WARMUP / dt)
    for step in range(skip + round(PATIENCE * distance / min(speeds) / dt)):
        meter.on.copy_(going & (step >= skip))
        obs, _, _, _ = env.step(policy(obs))
        env.set_command(command)
        fell |= going & env.fallen
        going = going & ~fell
        if step >= skip:
            motion.add(going)
            going = going & (motion.distance < distance)
            going = going & (motion.seconds < PATIENCE * distance / command[:, 0])
        if step % 100 == 99:
            report(float((motion.distance / distance).clamp(max=1.0).mean()))
        if not bool(going.any()):
            break
    arrived = (motion.distance >= distance).cpu().numpy() & ~fell.cpu().numpy()
    own, figures = meter.joint_load(), motion.figures()
    load = as_go1(own, limits, by)
    power = battery_power(load, replace(cfg, calf_gear=1.0))
    total, rows = by.power * power.total, []
    for i, (current, speed) in enumerate(conditions):
        done = np.arange(i * trials, (i + 1) * trials)
        lost = int(fell[done].sum())
        done = done[arrived[done]]
        cot = cost_of_transport(total[done], mass, figures["speed"][done])
        rows.append({
            "current": current, "command": speed, "payload": payload, "mass": mass, "trials": len(done), "fell": lost,
            "late": trials - lost - len(done), "cot": spread(cot), "power": spread(total[done]),
            "parts": {name: spread(by.power * values[done])["mean"] for name, values in power.parts().items()},
            "speed": spread(figures["speed"][done]), "v_x_rmse": spread(figures["v_x_rmse"][done]),
            "hold": spread(meter.hold[done].mean(-1)) if meter.hold.size else None,
            "damping": spread(meter.dynamic[done].mean(-1)) if meter.dynamic.size else None,
            "switches": spread(meter.switches[done].mean(-1)) if meter.switches.size else None,
        })  # fmt: skip
    return rows


def savings(rows: Sequence[dict[str, Any]]) -> list[dict[str, float]]:
    """Relative change of the cost of transport by each current, from none; where robots arrived with both."""
    off = {
        (row["payload"], row["command"]): row["cot"]["mean"] for row in rows if row["current"] == 0 and row["trials"]
    }
    return [
        {
            **{name: row[name] for name in ("payload", "command", "current")},
            "cot_change": row["cot"]["mean"] / off[row["payload"], row["command"]] - 1.0,
        }
        for row in rows
        if row["current"] > 0 and row["trials"] and (row["payload"], row["command"]) in off
    ]


def figures(rows: Sequence[dict[str, Any]]) -> dict[str, float | None]:
    """At the fastest command with the lightest load: cost of transport without current, with all of it, the change."""
    load, fast = min(row["payload"] for row in rows), max(row["command"] for row in rows)
    own = [row for row in rows if (row["payload"], row["command"]) == (load, fast)]
    off, on = ((row["cot"]["mean"] if row["trials"] else None) for row in (own[0], own[-1]))
    return {"cot_off": off, "cot_on": on, "cot_change": on / off - 1.0 if on and off else None}


def lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The table."""
    changes = {(s["payload"], s["command"], s["current"]): s["cot_change"] for s in savings(rows)}
    cells = []
    for row in rows:
        change = changes.get((row["payload"], row["command"], row["current"]))
        speed, power, cot = walked(row)
        cells.append((
            f"{row['payload']:g}", f"{row['command']:g}", f"{row['current']:g} A", cot, power, speed,
            "" if change is None else figure_text(change, "+.1%"),
            "" if row["hold"] is None or not row["trials"] else f"{row['hold']['mean']:.1%}",
            "" if row["switches"] is None or not row["trials"] else f"{row['switches']['mean']:.3g}/s",
            "  ".join(f"{why} {row[why]}" for why in ("fell", "late") if row[why]),
        ))  # fmt: skip
    head = ("load", "cmd", "current", "COT", "power", "speed", "COT by SAL", "held", "gates", "")
    return [*text_table(head, cells), *lost_lines(rows, PATIENCE)]


def chattering(rows: Sequence[dict[str, Any]], task: TaskCfg, devices: Sequence[JointActuator]) -> list[str]:
    """A warning where the gates switch far more often than the gait asks for, at any current and command."""
    seen = [row["switches"]["mean"] for row in rows if row["switches"] and row["trials"] and row["current"] > 0.0]
    by = scales_of(str(task.robot))
    return [line for line in [chatter(devices, max(seen, default=0.0), task.gait_frequency / by.time)] if line]


def picture(rows: Sequence[dict[str, Any]], path: Path, title: str) -> None:
    """Cost of transport over the current, a line per load and speed, as PNG."""
    figure, ((axis,),) = panels((7, 4))
    for payload, command in dict.fromkeys((row["payload"], row["command"]) for row in rows):
        own = [r for r in rows if (r["payload"], r["command"]) == (payload, command) and r["trials"]]
        if not own:  # none arrived: no line, and no entry of the legend
            continue
        mean, sd, whole = (np.array(column) for column in zip(*map(shown_cost, own), strict=True))
        current = np.array([r["current"] for r in own])
        label = f"{payload:g} kg, {command:g} m/s"
        line, *_ = axis.errorbar(current[whole], mean[whole], sd[whole], marker="o", capsize=3, label=label)
        if not whole.all():
            style = {"marker": "o", "markerfacecolor": "white", "linestyle": ":"}
            axis.plot(current[~whole], mean[~whole], color=line.get_color(), label=f"{label}, {NOT_WHOLE}", **style)
    axis.set(xlabel="current the devices may use [A]", ylabel="cost of transport [1]", title=title)
    axis.margins(y=0.1)
    axis.set_ylim(bottom=0.0)
    axis.legend()
    figure.savefig(path, dpi=110)
