"""The path's kernel along a prescribed motion of one shaft, with effects and base parameters given by name."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import warp as wp

from mrwarp.effects.catalogue import NULLS, SLOTS, column_of
from mrwarp.effects.replay_kernel import BASE, HEAT_TIMES, effect_replay_kernel
from tests.identify import synthetic

EPS = float(np.finfo(np.float32).eps)
TRUTH = {**synthetic.TRUTH, "q_zero": 0.03}
"""Paper section 4.2, with a zero of the angle."""

Effects = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, kw_only=True)
class Shaft:
    """Motion, command, time (also as the way slid counts it), heat at N samples; ``start`` cuts trajectories."""

    dt: float
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    current: np.ndarray
    time: np.ndarray
    slid_time: np.ndarray
    heat: np.ndarray
    start: tuple[int, ...]

    @property
    def temperature(self) -> np.ndarray:
        """Logged temperature [degC], which rises along the samples."""
        return 20.0 + 2.0 * self.time

    @classmethod
    def swinging(cls, seconds: float = 4.0, dt: float = 0.005, begin: float = 0.0) -> Self:
        """Three sines from standstill, seen exactly, with stepped and swept current."""
        t = begin + np.arange(round(seconds / dt)) * dt
        q, qd, qdd = (np.zeros(len(t)) for _ in range(3))
        for amplitude, f, phase in ((0.3, 0.7, 0.2), (0.12, 1.7, 1.1), (0.05, 3.1, 2.0)):
            w = 2.0 * np.pi * f
            q += amplitude * np.sin(w * t + phase)
            qd += amplitude * w * np.cos(w * t + phase)
            qdd -= amplitude * w * w * np.sin(w * t + phase)
        current = np.where(np.sin(3.0 * t) > 0.0, 1.0, 0.25) + 0.2 * np.sin(7.0 * t)
        heat = np.linspace(0.0, 5.0, len(t)) * np.linspace(1.0, 2.0, len(HEAT_TIMES))[:, None]
        slid = np.cumsum(np.abs(qd))
        made = {"q": q, "qd": qd, "qdd": qdd, "time": t, "slid_time": slid * t[-1] / slid[-1], "heat": heat}
        return replace(cls.steady(current, dt), **made)

    @classmethod
    def steady(cls, current: np.ndarray, dt: float = 0.005, qd: float = 1.0) -> Self:
        """Constant speed with a given command."""
        count = len(current)
        t, zero = np.arange(count) * dt, np.zeros(count)
        heat = np.zeros((len(HEAT_TIMES), count))
        made = {"q": qd * t, "qd": zero + qd, "qdd": zero, "current": current, "time": t, "slid_time": t, "heat": heat}
        return cls(dt=dt, **made, start=(0, count))

    def after(self, other: Self) -> Self:
        """This trajectory behind another one."""
        joined = {
            name: np.concatenate([getattr(other, name), getattr(self, name)], axis=-1)
            for name in ("q", "qd", "qdd", "current", "time", "slid_time", "heat")
        }
        return replace(self, **joined, start=(*other.start, *(other.start[-1] + n for n in self.start[1:])))


def rows(base: Mapping[str, float], effects: Effects) -> tuple[np.ndarray, np.ndarray]:
    """One row of base parameters and one of the effects; what is not named is 0 in the first, null in the second."""
    values = np.array(NULLS)
    for effect, parameters in effects.items():
        for name, value in parameters.items():
            values[column_of(effect, name)] = value
    return np.array([base.get(name, 0.0) for name in BASE]), values


def torques(shaft: Shaft, base: Mapping[str, float], candidates: list[Effects]) -> np.ndarray:
    """Torque of every set of effects, float32, shape (C, N), into an output poisoned with NaN."""
    made = [rows(base, effects) for effects in candidates]

    def array(x: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(x, dtype=np.float32), dtype=float, device="cpu")

    trajectories = len(shaft.start) - 1
    tau = wp.full((len(made), len(shaft.q)), float("nan"), dtype=float, device="cpu")
    memory = wp.zeros((len(made) * trajectories, SLOTS), dtype=float, device="cpu")
    signals = {"q", "qd", "qdd", "current", "time", "slid_time", "heat", "temperature"}
    arrays = {f"{name.split('_')[0]}_in": array(getattr(shaft, name)) for name in signals}
    arrays |= {"base": array(np.stack([b for b, _ in made])), "values": array(np.stack([v for _, v in made]))}
    arrays["start_in"] = wp.array(np.array(shaft.start, dtype=np.int32), dtype=int, device="cpu")
    arrays["dt_in"] = array(np.full(trajectories, shaft.dt))
    arrays["begin_in"] = array(np.zeros(trajectories))
    runs = [shaft.q[a:b] for a, b in zip(shaft.start[:-1], shaft.start[1:], strict=True)]
    arrays["middle_in"] = array(np.array([0.5 * (q.min() + q.max()) for q in runs]))
    arrays |= {"exact": 1, "substeps": 0}
    inputs = [arrays[arg.label] for arg in effect_replay_kernel.adj.args if arg.label in arrays]
    dim = (len(made), trajectories)
    wp.launch(effect_replay_kernel, dim=dim, inputs=inputs, outputs=[memory, tau], device="cpu")
    return tau.numpy().copy()


def torque(shaft: Shaft, base: Mapping[str, float], effects: Effects | None = None) -> np.ndarray:
    """Torque with some effects, float64, shape (N,)."""
    return torques(shaft, base, [effects or {}])[0].astype(float)


def loop(way: np.ndarray, beta: float, gamma: float, z: float = 0.0) -> np.ndarray:
    """z of eq. 15 along positions, float64: du/ds = 1 - (beta -+ gamma)*u below and above zero, without a time step."""
    out = np.zeros(len(way))
    for k, step in enumerate(np.diff(way), start=1):
        direction, left = np.sign(step), abs(step)
        u = direction * z
        if u < 0.0:
            rate = beta - gamma
            to_zero = np.log1p(-rate * u) / rate
            u = (1.0 - (1.0 - rate * u) * np.exp(-rate * min(left, to_zero))) / rate
            left = max(0.0, left - to_zero)
        if left > 0.0:
            rate = beta + gamma
            u = (1.0 - (1.0 - rate * u) * np.exp(-rate * left)) / rate
        z = direction * u if step else z
        out[k] = z
    return out


def turning(shaft: Shaft, gain: float, beta: float, gamma: float) -> float:
    """Torque by which two ways through a reversal between samples differ at most, a cubic's and a chord's [N·m].

    A chord leaves out a way of 0.5*qdd*(dt/2)^2 to the reversal and back. Over it the slopes of eq. 15, loading and
    unloading, differ by at most 2*beta/(beta + gamma). Twice, for what is left of the reversals before.
    """
    left_out = 0.5 * float(np.abs(shaft.qdd).max()) * (0.5 * shaft.dt) ** 2
    return 2.0 * gain * 2.0 * beta / (beta + gamma) * left_out


def dry(qd: np.ndarray, speed: float, dt: float = 0.005) -> np.ndarray:
    """Direction of dry friction along samples: a stop operator over the way of 5 ms at ``speed``."""
    stroke, strain = 0.005 * speed, [float(np.tanh(qd[0] / speed))]
    for way in qd[1:] * dt:
        strain.append(float(np.clip(strain[-1] + way / stroke, -1.0, 1.0)))
    return np.array(strain)


def play(x: np.ndarray, half_width: float, start: float) -> np.ndarray:
    """Prandtl's play operator along samples."""
    out, held = np.empty(len(x)), start
    for k, value in enumerate(x):
        held = min(max(held, value - half_width), value + half_width)
        out[k] = held
    return out
