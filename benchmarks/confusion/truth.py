"""The truth: eqs. 14 and 15 and the hidden effects along a prescribed motion, float64, sampled at 2 kHz or above.

Memory of the path and of the current is exact (:mod:`benchmarks.confusion.path`, :mod:`benchmarks.confusion.current`);
only what filters the torque or the velocity is stepped through the fine grid. Pure NumPy and SciPy: no line is shared
with the simulator or with the diagnosis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import lfilter

from benchmarks.confusion import effects as law
from benchmarks.confusion import foreign
from benchmarks.confusion.effects import Effect, State
from benchmarks.confusion.motion import Motion
from benchmarks.confusion.path import Path, Turns, behind_gap, gear_to_locked_output, on_spring
from mrwarp.params import MrParams

BASE = ("D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma")
"""Coefficients that a fit of eqs. 14 and 15 chooses."""

CREEP_TIME = 1.5
"""Time constant of the creep [s]."""

COIL_RESISTANCE = 4.0
"""Resistance of the coil that heats the fluid [Ohm]."""

_FILTERED = frozenset({"torque_sensor_lag", "creep"})
"""Effects that need the torque on the fine grid."""


@dataclass(frozen=True, kw_only=True)
class Device:
    """One device on the bench."""

    base: Mapping[str, float]
    """Coefficients of eqs. 14 and 15 by the names of :data:`BASE`."""
    zero: float
    """Position where the stiffness of eq. 14 is zero [rad]."""
    effects: Mapping[str, Effect] = field(default_factory=dict)
    """Hidden effects, by name."""
    law: str = ""
    """Another law than eqs. 14 and 15, of the families "foreign" and "outside"; empty for these."""
    numbers: Mapping[str, float] = field(default_factory=dict)
    """Coefficients of that law."""

    @classmethod
    def drawn(cls, spread: float, seed: np.random.SeedSequence) -> Device:
        """A device whose coefficients are uniform within ``spread`` about the paper's, without any effect.

        Draws whose hysteresis would run away (beta + gamma below a third of the paper's) are repeated.
        """
        paper = MrParams().bouc_wen
        rng = np.random.default_rng(seed)
        while True:
            base = {name: getattr(paper, name) * (1.0 + spread * rng.uniform(-1.0, 1.0)) for name in BASE}
            if base["beta"] + base["gamma"] > (paper.beta + paper.gamma) / 3.0:
                return cls(base=base, zero=paper.q_offset + paper.q_center)

    def with_effects(self, effects: Mapping[str, Effect]) -> Device:
        """A copy of the device with these effects only."""
        return replace(self, effects=dict(effects))


@dataclass(frozen=True, kw_only=True)
class Signals:
    """Columns of an ideal log; arrays (T, M) at the logged samples."""

    q: np.ndarray
    """Encoder [rad]."""
    qd: np.ndarray
    """Velocity channel [rad/s]."""
    current: np.ndarray
    """Commanded current [A]."""
    torque: np.ndarray
    """Torque sensor [N·m]."""
    path: Path
    """The path that the velocity channel describes."""


def simulate(device: Device, motion: Motion) -> Signals:
    """Run a device through a motion, without noise."""
    hidden = device.effects
    samples = slice(None) if _FILTERED & hidden.keys() else motion.logged
    torque = _torque(device, motion, samples)
    if "torque_sensor_lag" in hidden:
        torque = lagged(torque, hidden["torque_sensor_lag"].strength, motion.dt)
    if samples != motion.logged:
        torque = torque[:, motion.logged]
    if "torque_gain" in hidden:
        torque = hidden["torque_gain"].strength * torque
    if "torque_bias" in hidden:
        torque = torque + hidden["torque_bias"].strength

    q, qd, path = motion.q[:, motion.logged], motion.qd[:, motion.logged], motion.path
    if "velocity_lag" in hidden:
        slow = lagged(motion.qd, hidden["velocity_lag"].strength, motion.dt)
        way = np.cumsum(0.5 * motion.dt * (slow[:, 1:] + slow[:, :-1]), axis=1)
        way = np.concatenate([np.zeros((len(way), 1)), way], axis=1)
        qd, path = slow[:, motion.logged], Path.of(way, Turns.of(way), motion.logged)
    if "encoder_offset" in hidden:
        q = q - hidden["encoder_offset"].strength
    return Signals(q=q, qd=qd, current=motion.command.at(motion.t[motion.logged]), torque=torque, path=path)


def _torque(device: Device, motion: Motion, samples: slice) -> np.ndarray:
    """Torque of the device [N·m], before the sensor, shape (T, M)."""
    p, hidden = device.base, device.effects
    if device.law:
        fine, _ = _state(device, motion, slice(None))
        along = (fine.q, fine.qd, fine.qdd, fine.current, motion.dt)
        shaft = {key: hidden[name].strength for name, key in foreign.BEHIND.items() if name in hidden}
        own = (foreign.behind if shaft else foreign.torque)(device.law, device.numbers, *along, **shaft)
        state, _ = _state(device, motion, samples)
        own = own + _gear(device, motion)
        return own[:, samples] + sum(add(hidden[name], state) for name, add in law.TORQUES.items() if name in hidden)
    gap, compliance = "backlash" in hidden, 0.0
    if "series_compliance" in hidden:
        compliance = hidden["series_compliance"].strength
    state, path = _state(device, motion, slice(None) if gap or compliance else samples)
    stiffness = p["K0"] + p["K1"] * _strength(device, state)
    if compliance:
        carried, speed = on_spring(motion.q, compliance, stiffness, p, motion.dt)
        state, _ = _state(device, motion, samples)
        state = replace(state, qd=speed[:, samples])
        # the spring carries all that the device bears
        z, stiffness = carried[:, samples] - p["B"] * state.qd, 1.0 + p["alpha"] * np.abs(state.qd)
    elif gap:
        driven = behind_gap(motion.q, hidden["backlash"].strength, stiffness, p, motion.dt)
        z, stiffness, touched = driven.z[:, samples], stiffness[:, samples], driven.contact[:, samples] != 0.0
        state, _ = _state(device, motion, samples)
        z = np.where(touched, z, 0.0)
        state = replace(
            state, qd=np.where(touched, state.qd, 0.0), qdd=np.where(touched, state.qdd, 0.0), touched=touched
        )
    else:
        z = path.hysteresis(p["beta"], p["gamma"])
    hysteretic = stiffness / (1.0 + p["alpha"] * np.abs(state.qd)) * z
    if "speed_weakening" in hidden:
        hysteretic *= law.speed_weakening(hidden["speed_weakening"], state, p["alpha"])
    for name, factor in law.FACTORS.items():
        if name in hidden:
            hysteretic *= factor(hidden[name], state)
    viscous = p["B"] * state.qd
    for name, factor in law.THINNING.items():
        if name in hidden:
            thin = factor(hidden[name], state)
            hysteretic, viscous = hysteretic * thin, viscous * thin**1.5
    if "creep" in hidden:  # the standard linear solid: a share of the stress relaxes
        hysteretic = hysteretic - hidden["creep"].strength * lagged(hysteretic, CREEP_TIME, motion.dt)
    torque = p["D"] + viscous + p["C"] * (state.q - device.zero) + p["I1"] * state.current + hysteretic
    for name, own in law.TORQUES.items():
        if name in hidden:
            torque += own(hidden[name], state)
    return torque + _gear(device, motion)[:, samples]


def _gear(device: Device, motion: Motion) -> np.ndarray:
    """Torque that a gear with play bears, which leads to a locked output, on the fine grid."""
    if "compliance_with_backlash" not in device.effects:
        return np.zeros_like(motion.q)
    gear = device.effects["compliance_with_backlash"]
    return gear_to_locked_output(motion.q - device.zero, gear.strength, gear.draws["half_gap"], motion.dt)


def _strength(device: Device, state: State) -> np.ndarray:
    """Current that magnetises, behind a core that saturates."""
    if "current_saturation" not in device.effects:
        return state.current
    u = device.effects["current_saturation"].strength
    return state.current / np.sqrt(1.0 + (u * state.current) ** 2)


def _state(device: Device, motion: Motion, samples: slice) -> tuple[State, Path]:
    """The device's state along the motion and the path of its hysteresis."""
    hidden, command = device.effects, motion.command
    if "command_delay" in hidden:
        command = command.delayed(hidden["command_delay"].strength)
    if "current_gain" in hidden:
        command = command.scaled(hidden["current_gain"].strength)
    if "coil_lag" in hidden:
        command = command.lagged(hidden["coil_lag"].strength)
    if "remanence" in hidden:
        width = hidden["remanence"].strength
        command = command.magnetised((0.5 * width, width, 1.5 * width))

    q, qd = motion.q[:, samples], motion.qd[:, samples]
    path = motion.path if samples == motion.logged else Path.of(motion.q, motion.turns, samples)
    current = command.at(motion.t[samples])
    if "path_lag" in hidden:
        current = _over_way(command.at(motion.t), motion.q, hidden["path_lag"].strength)[:, samples]
    state = State(t=motion.t[samples], q=q, qd=qd, qdd=motion.qdd[:, samples], current=current)
    if "temperature_drift" in hidden:
        state = replace(state, warmth=_on(samples, _warmth(device, motion), motion))
    if "temperature_fade" in hidden:
        state = replace(state, room=law.room_temperature(hidden["temperature_fade"], motion.start)[:, None])
    if "wear" in hidden:
        state = replace(state, slid=_on(samples, motion.slid / motion.slid[-1, -1], motion))
    return state, path


def _over_way(current: np.ndarray, q: np.ndarray, length: float) -> np.ndarray:
    """A current that follows another over a way instead of a time, exact for steps that it keeps, arrays (T, N)."""
    if length <= 0.0:
        return current
    kept, out = np.exp(-np.abs(np.diff(q, axis=1)) / length), current.copy()
    for k in range(1, current.shape[1]):
        out[:, k] = current[:, k - 1] + (out[:, k - 1] - current[:, k - 1]) * kept[:, k - 1]
    return out


def _on(samples: slice, logged: np.ndarray, motion: Motion) -> np.ndarray:
    """Slow values at the logged samples, held in between where the fine grid is asked for."""
    if samples == motion.logged:
        return logged
    return np.repeat(logged, motion.substeps, axis=1)[:, : motion.q.shape[1]]


def _warmth(device: Device, motion: Motion) -> np.ndarray:
    """Temperature rise of the fluid at the logged samples [K]: one heat capacity, which cools at rests.

    The heat is that of the cold device without effects.
    """
    draws = device.effects["temperature_drift"].draws
    plain = replace(device, effects={})
    current, qd = motion.command.at(motion.t[motion.logged]), motion.qd[:, motion.logged]
    power = np.abs(_torque(plain, motion, motion.logged) * qd) + COIL_RESISTANCE * current**2
    step = 1.0 / motion.rate
    kept = np.exp(-step / draws["time_constant"])
    heated = np.asarray(lfilter([step / draws["capacity"]], [1.0, -kept], power, axis=1))
    cooling = np.exp(-(motion.t[motion.logged] / draws["time_constant"]))
    begin, ends = 0.0, motion.start + motion.t[-1]
    for k in range(len(heated)):
        heated[k] += begin * cooling
        if k + 1 < len(heated):
            begin = heated[k, -1] * np.exp(-(motion.start[k + 1] - ends[k]) / draws["time_constant"])
    return heated


def lagged(x: np.ndarray, time_constant: float, dt: float) -> np.ndarray:
    """First-order lag along the last axis, settled at the start; exact for an input that is straight in each step."""
    if time_constant <= 0.0:
        return x
    kept = np.exp(-dt / time_constant)
    mean = time_constant / dt * (1.0 - kept)
    out, _ = lfilter([1.0 - mean, mean - kept], [1.0, -kept], x, axis=1, zi=mean * x[:, :1])
    return np.asarray(out)
