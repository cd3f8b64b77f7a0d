"""Groups of smooth functions of what was measured: what any missing law would show up in, whatever its form.

They find structure that no effect of the catalogue explains, and say along which variables it lies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from mrwarp.identify.dataset import Motion

_FINE = 14
"""Highest number of periods over the range of the angle that the fine structure resolves."""


@dataclass(frozen=True)
class Group:
    """Columns that are tested together."""

    variables: tuple[str, ...]
    """What they depend on, in the words of ``result.json``."""
    form: str
    rows: np.ndarray
    """Shape (k, N)."""
    slow: bool = False
    """Whether they vary mainly between trajectories."""


def make_groups(motion: Motion, loop: np.ndarray, hysteretic: np.ndarray) -> list[Group]:
    """The groups of a data set.

    Args:
        motion: The samples.
        loop: Hysteretic torque per unit of yield gain without current, z/(1 + alpha*|qd|), shape (N,).
        hysteretic: The whole hysteretic torque, shape (N,).
    """
    s, r = motion, motion.ranges
    middle = 0.5 * (s.q.max() + s.q.min())
    q = 2.0 * (s.q - middle) / r.q
    qd = s.qd / (1.5 * r.qd)
    v = np.clip(qd, -1.5, 1.5)
    a = np.abs(v)
    current = s.current / r.current
    h = loop / max(float(np.percentile(np.abs(loop), 98)), 1e-12)
    qdd = motion.qdd / max(float(np.percentile(np.abs(motion.qdd), 98)), 1e-12)
    qdd = np.clip(qdd, -3.0, 3.0)
    time = motion.time / r.session
    sign = np.tanh(s.qd / (0.02 * r.qd))
    quick = current - _low_pass(current, s, 0.02)
    heat = motion.heat[2] / max(float(motion.heat[2].max()), 1e-12)
    heat_slow = motion.heat[4] / max(float(motion.heat[4].max()), 1e-12)
    yield_scale = max(float(np.percentile(np.abs(hysteretic), 98)), 1e-12)
    tau = hysteretic / yield_scale
    hi = h * current

    def cheb(x: np.ndarray, k: int) -> np.ndarray:
        return np.polynomial.chebyshev.chebval(np.clip(x, -1.0, 1.0), [0.0] * k + [1.0])

    phase = np.pi * (q + 1.0)
    fine = [f(k * phase) for k in range(3, _FINE + 1) for f in (np.sin, np.cos)]
    slow_v = [
        f(s.qd / (w * r.qd)) for w in (0.03, 0.1, 0.25) for f in (lambda x: x / (1 + x**2), lambda x: 1 / (1 + x**2))
    ]
    groups = [
        Group(("q",), "smooth", _stack(*(cheb(q, k) for k in range(2, 6)))),
        Group(("q",), "periodic", _stack(*fine)),
        Group(("qd",), "smooth", _stack(a, v**2, v * a, v**3, a**3)),
        Group(("qd",), "slow", _stack(sign, np.abs(sign), *slow_v)),
        Group(("qdd",), "smooth", _stack(qdd, qdd * np.abs(qdd))),
        Group(("current",), "smooth", _stack(*(cheb(2 * current - 1, k) for k in (2, 3, 4)))),
        Group(("current", "memory"), "quick", _stack(quick, quick * h, quick * v, quick * sign)),
        Group(("current", "memory"), "loop", _stack(*(h * cheb(2 * current - 1, k) for k in (2, 3, 4)))),
        Group(("memory",), "loop shape", _stack(h * np.abs(h), h**2, h**3, hi * np.abs(h), hi * h, hi * h * h)),
        Group(("memory",), "creep", _stack(*(_low_pass(x, s, w) for w in (0.1, 0.4, 1.5, 5.0) for x in (h, hi)))),
        Group(("memory",), "lag", _stack(*(tau - _low_pass(tau, s, w) for w in (0.005, 0.015)))),
        Group(("q", "qd"), "product", _stack(*(cheb(q, k) * f for k in (1, 2, 3) for f in (v, a, v * a)))),
        Group(("q", "current"), "product", _stack(
            *(cheb(q, k) * cheb(2 * current - 1, j) for k in (1, 2, 3, 4, 5) for j in (1, 2)),
            *(cheb(q, k) * current for k in (2, 3, 4, 5)))),
        Group(("qd", "current"), "product", _stack(
            *(f * g for f in (v, a, v * a, sign) for g in (current, current**2)))),
        Group(("qd", "memory"), "loop", _stack(*(f * g for f in (h, hi) for g in (a, v**2, v, sign)))),
        Group(("q", "memory"), "loop", _stack(*(cheb(q, k) * f for k in (1, 2, 3, 4) for f in (h, hi)))),
        Group(("time",), "drift", _stack(time * h, time * hi, time * v, time * sign, time**2 * hi), slow=True),
        Group(("time",), "warming", _stack(*(w * f for w in (heat, heat_slow) for f in (h, hi, v))), slow=True),
    ]  # fmt: skip
    return [Group(g.variables, g.form, g.rows[g.rows.std(axis=1) > 1e-9], g.slow) for g in groups]


def _stack(*rows: np.ndarray) -> np.ndarray:
    return np.stack(rows)


def _low_pass(x: np.ndarray, samples, time_constant: float) -> np.ndarray:
    """First-order low-pass of each trajectory that starts settled."""
    out = np.empty_like(x)
    for part, dt in zip(samples.parts, samples.dt, strict=True):
        keep = np.exp(-dt / time_constant)
        out[part], _ = lfilter([1.0 - keep], [1.0, -keep], x[part], zi=[keep * x[part.start]])
    return out
