"""Release before toe-off: what the field that stays in the core costs in swing, and what a reverse pulse saves.

Section 3.3 of the paper releases the support branch before toe-off and demagnetises the device. Here a core keeps a
field of the play's half width (the effect ``remanence``, :mod:`mrwarp.effects.remanence`) when its coil's current ends.
A stance ends by the foot's force, as the gates have it, or some time before the clock's toe-off; then the coil may get
a pulse the other way round, sized by its measured current so that the core is left without field.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mrwarp.energy.power import ElectricalCfg
from mrwarp.enums import CurrentCommand
from mrwarp.env.vec_env import WalkEnv
from mrwarp.model_file import Effect, FittedOn, Model, Parameter
from mrwarp.params import MrParams
from mrwarp.resources import policy_file
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.runtime import panels, text_table
from mrwarp.trials.power_meter import leg_channels
from mrwarp.trials.statistics import interval
from mrwarp.trials.walking import make_env
from mrwarp.usd.robot import TROT_PHASE
from paper.study.limits import ROBOT, LimitsCfg, by_setting, settings, task, walk
from paper.study.plan import kept

WIDTHS = (0.0, 0.05, 0.1, 0.2, 0.4)
"""Half widths of the play [A]: assumed. Of a magnetic circuit of soft steel some percent of the largest field stay."""

RELEASES = {
    "by foot force": (0.0, False),
    "by foot force, pulse": (0.0, True),
    "20 ms before": (0.02, False),
    "20 ms before, pulse": (0.02, True),
    "50 ms before": (0.05, False),
    "50 ms before, pulse": (0.05, True),
}
"""Time before the clock's toe-off [s], and whether a reverse pulse follows."""

PULSE_STEPS = 2
"""Length of a pulse in torque steps of 5 ms."""

CURRENT, LAG, SPEED = 0.5, 0.01, 0.5
"""Current while a gate is open [A], the best fixed one (docs/coil_commands.md); the coils' time constant [s]; walked
speed [m/s]."""


def device(width: float) -> Model:
    """The paper's device whose core keeps a field."""
    parameters = {s.name: Parameter(value=s.default, unit=s.unit) for s in MrParams.specs() if s.name != "q_neutral"}
    keeps = Effect(name="remanence", parameters={"half_width": Parameter(value=width, unit="A")})
    origin = FittedOn(source="mrwarp study release", trajectories=0, samples=0, rate=200.0)
    return Model(parameters=parameters, fitted_on=origin, effects=(keeps,))


class Releaser:
    """Commands the coils at 200 Hz; one of ``env.robot.before_hooks``.

    Args:
        env: Environments whose coils are commanded.
        lead: Time before the clock's toe-off at which a leg's device is released, 0: by the gates alone [s]; (E,).
        pulse: Whether a reverse pulse follows a release, bool, shape (E,).
        width: Half width of the cores' play [A], shape (E,).
    """

    def __init__(self, env: WalkEnv, lead: torch.Tensor, pulse: torch.Tensor, width: torch.Tensor) -> None:
        self._env, self._lead, self._pulse, self._width = env, lead[:, None], pulse[:, None], width[:, None]
        device, dt, lag = env.actuator, env.sim.dt, LAG
        self._coil = env.view(device.coil)
        self._command = env.arrays.current_command
        self._offset = torch.tensor(TROT_PHASE)
        self._left = torch.zeros_like(self._coil)
        self._amps = torch.zeros_like(self._coil)
        self._stood = torch.zeros_like(self._coil, dtype=torch.bool)
        self._step = 0
        # a pulse of command c from the coil's current b: the mean current of its last step is (1 - x) c + x b, that of
        # the step after it z ((1 - y) c + y b); the lower one is to be minus the width
        self._z = lag / dt * (1.0 - math.exp(-dt / lag))
        self._x, self._y = math.exp(-(PULSE_STEPS - 1) * dt / lag) * self._z, math.exp(-PULSE_STEPS * dt / lag)
        env.robot.before_hooks.append(self.command)

    def command(self) -> None:
        """Write the command of the coming torque step."""
        env = self._env
        cfg, dt = env.cfg, env.sim.dt
        phase = (env.phase + (self._step % cfg.decimation) * dt * cfg.gait_frequency)[:, None] + self._offset
        self._step += 1
        phase = phase - phase.floor()
        stance = phase < 0.5 - self._lead * cfg.gait_frequency
        loaded = env.f_foot > env.contact_force
        holds = torch.where(self._lead > 0.0, stance | ((phase >= 0.5) & loaded), loaded)
        begins = self._stood & ~holds & self._pulse & (self._width > 0.0)
        self._stood = holds
        last = -(self._width + self._x * self._coil) / (1.0 - self._x)
        after = -(self._width / self._z + self._y * self._coil) / (1.0 - self._y)
        self._amps = torch.where(begins, torch.maximum(last, after), self._amps)
        self._left = torch.where(begins, float(PULSE_STEPS), (self._left - 1.0).clamp(min=0.0))
        on = torch.where(holds, env.current_e[:, None], 0.0)
        self._command.copy_(torch.where(self._left > 0.0, self._amps, on))


def measure(cfg: LimitsCfg, electrical: ElectricalCfg) -> dict[str, Any]:
    """Walk with all of :data:`WIDTHS` and :data:`RELEASES`.

    Returns:
        Figures of :func:`paper.study.limits.walk`, and ``drag``, the devices' mean torque in swing [N·m], each of
        shape (widths x releases, policies).
    """
    policies = [OnnxPolicy(policy_file(cfg.policies, ROBOT, seed)) for seed in cfg.seeds]
    cases = [(width, lead, pulse) for width in WIDTHS for lead, pulse in RELEASES.values()]
    width, lead, pulse = settings(cfg, cases).T
    base = replace(
        task(cfg), current_by=CurrentCommand.SCHEDULED, currents=(CURRENT,), coil_lag=LAG, model=device(WIDTHS[1])
    )
    base = replace(base, latch=1.0)
    env = make_env(base, len(width), 0)
    effects = env.actuator.effects
    assert effects is not None  # the model has one
    as_tensor = [torch.tensor(x, dtype=torch.float32, device=env.device) for x in (lead, pulse, width)]
    env.view(effects.value("remanence", "half_width"))[:] = as_tensor[2][:, None]
    Releaser(env, as_tensor[0], as_tensor[1] > 0.0, as_tensor[2])
    torque, steps = torch.zeros(env.num_envs), torch.zeros(env.num_envs)

    def swing() -> None:
        now = leg_channels(env)
        free = (now["f_foot"] <= env.contact_force).float()
        torque.add_((now["tau_mr"].abs() * free).sum(1))
        steps.add_(free.sum(1))

    mass = np.full(env.num_envs, float(env.sim.scene.model.body_mass.sum()))
    speed = np.full(env.num_envs, SPEED)
    found = walk(env, policies, speed, mass, cfg.seconds, electrical, trials=cfg.trials, watch=swing)
    return by_setting(cfg, found | {"drag": (torque / steps.clamp(min=1.0)).numpy()}, len(cases))


def run(
    cfg: LimitsCfg,
    out: Path,
    electrical: ElectricalCfg,
    report: Callable[[str, float], None] = lambda text, share: None,
) -> dict[str, Any]:
    """Walk unless ``out`` holds the figures, and sum up: by width and release, and the paired change of the power.

    Raises:
        ValueError: the file in ``out`` is damaged or of other choices, or a policy is missing.
    """
    asked = {name: getattr(cfg, name) for name in ("seeds", "trials", "seconds", "policies")}
    report("walking", 0.0)
    found = kept(out / "walked.json", asked, partial(measure, cfg, electrical))
    power = np.array(found["power"], dtype=float).reshape(len(WIDTHS), len(RELEASES), -1)
    rows: dict[str, dict[str, Any]] = {}
    for i, width in enumerate(WIDTHS):
        rows[f"{width:g}"] = {}
        for k, name in enumerate(RELEASES):
            at = i * len(RELEASES) + k
            rows[f"{width:g}"][name] = {
                **{key: interval(values[at]) for key, values in found.items()},
                "against_no_field": interval(power[i, k] - power[0, k]),
                "against_foot_force": interval(power[i, k] - power[i, 0]),
            }
    return {"rows": rows, "current": CURRENT, "coil_lag": LAG, "speed": SPEED}


def lines(found: Mapping[str, Any]) -> list[str]:
    """The table."""

    def cell(own: Mapping[str, Any], digits: int, factor: float = 1.0, sign: str = "") -> str:
        return f"{factor * own['mean']:{sign}.{digits}f} ± {factor * own['half_width']:.{digits}f}"

    head = (
        "half width [A]",
        "release",
        "torque in swing [N·m]",
        "power [W]",
        "against no field",
        "against foot force",
        "v_x RMSE [m/s]",
        "held [%]",
        "fell [%]",
    )
    rows = [
        (
            width,
            name,
            cell(own["drag"], 3),
            cell(own["power"], 1),
            cell(own["against_no_field"], 2, sign="+"),
            cell(own["against_foot_force"], 2, sign="+"),
            cell(own["v_x_rmse"], 3),
            cell(own["hold"], 0, 100.0),
            cell(own["fell"], 0, 100.0),
        )
        for width, by in found["rows"].items()
        for name, own in by.items()
    ]
    return text_table(head, rows, left=2)


def picture(found: Mapping[str, Any], path: Path) -> None:
    """Torque in swing and battery power over the field that stays, by release."""
    figure, ((left, right),) = panels((11, 4.2), columns=2)
    for name in RELEASES:
        for axis, key in ((left, "drag"), (right, "power")):
            own = [by[name][key] for by in found["rows"].values()]
            line = "--" if name.endswith("pulse") else "-"
            means, spread = ([x[part] for x in own] for part in ("mean", "half_width"))
            axis.errorbar(
                WIDTHS, means, spread if axis is left else None, marker="o", capsize=2, linestyle=line, label=name
            )
    left.set(xlabel="half width of the core's play [A]", ylabel="device's torque in swing [N·m]")
    right.set(xlabel="half width of the core's play [A]", ylabel=f"battery power at {SPEED:g} m/s [W]")
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=len(RELEASES), fontsize=8)
    figure.savefig(path, dpi=110)
