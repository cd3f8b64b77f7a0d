"""How large a hidden cause is: by how much it worsens the re-fitted simulation of a healthy log; its size at a level.

The level is ``s = sqrt(E1/E0 - 1)``. E0 is the squared error that the replay leaves of a healthy log, with all numbers
fitted that a healthy robot may be off by; E1 is the same when the cause changes the robot and only the other numbers
are fitted. Both count every reading by what is left in its channel.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mrwarp.robot_logs.causes.parameter import Parameter, parameters_of
from mrwarp.robot_logs.likelihood import Likelihood, fit, replayed
from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.selection import bounds_of, healthy
from mrwarp.robot_logs.virtual.hidden_effects import EFFECTS, Hidden
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from mrwarp.robot_logs.windows import Windows, cut_windows
from mrwarp.sysid.least_squares import minimum_within

TOLERANCE = 0.1
"""Share of a level that a size may lack."""

_STEPS, _WIDEST = 8, 2.0
"""Most steps of the search for a size, and the largest factor between two of them."""

FACTORS = ("motor_strength", "kp", "kd", "device_strength", "torque_channel_gain")
"""Causes whose size is a factor that is added to."""


def sized(cause: str, first: Sequence[float], times: float) -> tuple[float, ...]:
    """Numbers of a cause ``times`` as large as ``first``, where that can be hidden: factors count from 1."""
    effect = EFFECTS[cause]
    if cause in FACTORS:
        low, values = 0.05, [1.0 + times * (x - 1.0) for x in first]
    elif cause == "ground_stiffness":
        low, values = effect.low, [x**times for x in first]
    elif cause in ("ground_friction", "torque_limit"):
        low, values = effect.low, [x / times for x in first]
    else:
        low, values = effect.low, [x * times for x in first]
    return tuple(float(np.clip(x, low, effect.high)) for x in values)


@dataclass(frozen=True, kw_only=True)
class HealthyLog:
    """A log of a healthy robot, and the re-fitted simulation of it."""

    model: ReplayModel
    windows: list[Windows]
    parameters: list[Parameter]
    theta: np.ndarray
    """Fitted, shape (P,)."""
    likelihood: Likelihood

    def level(self, hidden: Hidden) -> float | None:
        """Level of a cause [1]; None where the replay has no number for it."""
        change = _change(hidden, self.parameters)
        if not change:
            return None
        theta, (low, high) = self.theta.copy(), bounds_of(self.parameters)
        for k, value in change.items():
            theta[k] = low[k] = high[k] = value
        _, about = replayed(self.likelihood, self.model, self.windows, self.parameters, theta)
        least = self._refitted(self.likelihood, *bounds_of(self.parameters))
        return float(np.sqrt(max(self._refitted(about, low, high) / least - 1.0, 0.0)))

    def _refitted(self, about: Likelihood, low: np.ndarray, high: np.ndarray) -> float:
        """Weighted squared error that is left within bounds [1]; numbers that these hold are no healthy robot's."""
        prior, (information, score) = healthy(self.parameters) * about.scale, about.sums()
        x, _ = minimum_within(information + prior, score, low, high)
        own = np.where(low == high, 0.0, x)
        return about.at(x) + float(own @ prior @ own)

    def size(self, hidden: Hidden, level: float) -> tuple[Hidden, float | None]:
        """The cause, larger than ``hidden`` where that is less than a level, and the level that it has.

        Where no size reaches it, the largest; where the replay has no number for it, ``hidden`` and None.
        """
        times, new, found = 1.0, hidden, self.level(hidden)
        for _ in range(_STEPS):
            if found is None or found >= (1.0 - TOLERANCE) * level:
                break
            times *= float(min(level / max(found, 1e-9), _WIDEST))
            new = replace(hidden, values=sized(hidden.cause, hidden.values, times))
            found = self.level(new)
        return new, found


def healthy_log(cfg: LogCfg, device: str = "cpu") -> HealthyLog:
    """Record a log as ``cfg`` says but without what it hides, and fit the replay to it, on a Warp ``device``."""
    folder = Path(tempfile.mkdtemp(prefix="robot_levels_"))
    try:
        record(replace(cfg, hide=()), folder)
        log = load_log(folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    model = replay_model(Path(cfg.robot), log, device)
    parameters = parameters_of(model, log)
    windows = cut_windows(model, log, budget=model.settings.robot_fit.fit_seconds)
    low, high = bounds_of(parameters)
    theta, likelihood, _ = fit(
        model, windows, parameters, np.zeros(len(parameters)), None, healthy(parameters), low, high, lambda _: None
    )
    return HealthyLog(model=model, windows=windows, parameters=parameters, theta=theta, likelihood=likelihood)


def _change(hidden: Hidden, parameters: list[Parameter]) -> dict[int, float]:
    """Numbers of the replay, by parameter, that a hidden cause changes; empty where there are none."""
    cause, where = hidden.cause, hidden.where
    if (cause, where) == ("clock_shift", "commands"):
        cause, where = "command_delay", "robot"
    own = [(k, p) for k, p in enumerate(parameters) if p.cause == cause and same_place(where, p.where)]
    found = {}
    for (k, p), value in zip(own, hidden.values, strict=False):
        if cause in FACTORS:
            found[k] = value - 1.0
        elif cause in ("ground_friction", "torque_limit"):
            found[k] = min(value / p.nominal - 1.0, p.highest)
        elif cause == "ground_stiffness":
            found[k] = 1.0 / value - 1.0
        else:
            found[k] = -1.0 if cause == "coil_dead" else value
    return found


def same_place(where: str, other: str) -> bool:
    """Whether places are one; the other may be a body that carries the path of its file."""
    return where == other or other.endswith(f"_{where}")
