"""Data of known devices, made by the diagnosis' own kernel along exact motion: what a fit must find again."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from mrwarp.diagnose.problem import Fit, Problem, fit_model
from mrwarp.effects.catalogue import parameter_of
from mrwarp.effects.law import Ranges
from mrwarp.effects.replay_kernel import HEAT_TIMES
from mrwarp.identify.dataset import Motion, Scales
from mrwarp.identify.kinematics import Kinematics
from mrwarp.identify.noise import Noise
from mrwarp.identify.parameters import LINEAR, SHAPE, Parameters, shape_coordinates
from mrwarp.identify.replay import EffectReplay
from mrwarp.model_file import JOINT_UNITS
from mrwarp.recording.load import Recording, Trajectory
from mrwarp.sysid.settings import Effort, Law, Settings
from tests.identify.synthetic import DT, TRUTH

SIGMA = 0.02
QUICK = Settings(law=Law(structured=100.0), effort=Effort(starts_on=600, samples=600))
"""Of whole diagnoses without a comparison of laws, and with little boosting."""


def swing(rng: np.random.Generator, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sum of three sines of 0.5 to 2 Hz with its exact derivatives."""
    q, qd, qdd = (np.zeros(len(t)) for _ in range(3))
    for _ in range(3):
        w, amplitude, phase = 2 * np.pi * rng.uniform(0.5, 2.0), rng.uniform(0.1, 0.35), rng.uniform(0, 2 * np.pi)
        q += amplitude * np.sin(w * t + phase)
        qd += amplitude * w * np.cos(w * t + phase)
        qdd -= amplitude * w * w * np.sin(w * t + phase)
    return q, qd, qdd


def motion(
    seed: int = 1, *, runs: int = 8, seconds: float = 4.0, dt: float = DT, current: float | None = None
) -> Motion:
    """Exact motion of several runs with stepped current, or a constant one; torque 0, units of the joint."""
    rng = np.random.default_rng(seed)
    count = round(seconds / dt)
    t = np.arange(count) * dt
    parts = [swing(rng, t) for _ in range(runs)]
    q, qd, qdd = (np.concatenate(x) for x in zip(*parts, strict=True))
    steps = rng.uniform(0.0, 1.5, (runs, 10)).repeat(-(-count // 10), axis=1)[:, :count].ravel()
    if current is not None:
        steps = np.full(runs * count, current)
    ranges = Ranges(
        q=float(np.ptp(q)),
        qd=float(np.percentile(np.abs(qd), 95)),
        current=1.5,
        torque=0.8,
        dt=dt,
        session=runs * seconds,
    )
    time = np.arange(len(q)) * dt
    heat = np.stack([-0.5 * T * np.expm1(-time / T) for T in HEAT_TIMES])  # at a constant 0.5 W
    kinematics = Kinematics(qd=qd, qdd=qdd, velocity_lag=0.0, velocity_lag_error=float("inf"))
    return Motion(
        q=q,
        qd=qd,
        current=steps,
        torque=np.zeros(len(q)),
        start=np.arange(runs + 1) * count,
        dt=np.full(runs, dt),
        scales=Scales(),
        qdd=qdd,
        time=time,
        slid_time=time,
        heat=heat,
        ranges=ranges,
        kinematics=kinematics,
    )


def vector(c: Parameters, effects: Mapping[str, Mapping[str, float]] | None = None, **changes: float) -> np.ndarray:
    """Coordinates of the paper's joint with some effects."""
    p = {**TRUTH, **changes}
    x = [p[name] for name in LINEAR]
    alpha, beta, gamma = (p[name] for name in SHAPE)
    x += list(shape_coordinates(alpha, beta, gamma, c.ranges.qd))
    for slot in c.slots:
        value = (effects or {})[slot.effect].get(slot.parameter.name, slot.parameter.null)
        x.append(np.log(value) if slot.logarithmic else value)
    return np.array(x)


def white(sigma: float, offset: float = 0.0, gain: float = 0.0) -> Noise:
    """Noise without memory."""
    return Noise(whitening=np.ones(1), sigma=sigma, rms=sigma, offset=offset, gain=gain)


def problem(
    effects: Mapping[str, Mapping[str, float]] | None = None,
    *,
    seed: int = 1,
    sigma: float = SIGMA,
    plus: np.ndarray | float = 0.0,
    at: Motion | None = None,
    **changes: float,
) -> Problem:
    """Data of the paper's joint with effects, white noise of a known size and an addition."""
    at = at or motion(seed)
    bent = any(parameter_of(effect, name).form for effect, p in (effects or {}).items() for name in p)
    p = Parameters(tuple(effects or {}), at.ranges, 0.0, form=bent)
    torque = EffectReplay(at).torque(p.row(vector(p, effects, **changes))[None])[0].astype(float) + plus
    torque += sigma * np.random.default_rng([seed, 7]).normal(size=len(torque))
    return posed(dataclasses.replace(at, torque=torque), sigma=max(sigma, 1e-4))


def posed(at: Motion, *, sigma: float = SIGMA, q_zero: float = 0.0, units: Mapping[str, str] = JOINT_UNITS) -> Problem:
    """A motion with its torque as a problem in which every sample counts."""
    return Problem(
        replay=EffectReplay(at),
        measured=at.torque,
        weight=np.ones(len(at.torque)),
        q_zero=q_zero,
        units=units,
        noise=white(sigma),
    )


def fitted(on: Problem, effects: Mapping[str, Mapping[str, float]] | None = None, off: float = 0.0) -> Fit:
    """A model fitted to a problem, from the paper's joint with effects, all numbers ``off`` by a share."""
    p = on.parameters(tuple(effects or {}))
    x = vector(p, effects)
    return fit_model(on, p, x + off * np.where(np.arange(len(x)) < len(LINEAR), x, 1.0))


def recording(at: Motion, torque: np.ndarray, *, q: float = 1.0, current: float = 1.0, size: float = 1.0) -> Recording:
    """A motion with a torque as a recording, in other units if asked."""
    s, runs = at, []
    for k, part in enumerate(s.parts):
        runs.append(
            Trajectory(
                id=f"run {k}",
                t=at.time[part],
                q=q * s.q[part],
                qd=q * s.qd[part],
                current=current * s.current[part],
                torque=size * torque[part],
            )
        )
    units = {"q": "rad", "current": "A", "torque": "N·m"}
    if (q, current, size) != (1.0, 1.0, 1.0):
        units = {"q": "m", "current": "V", "torque": "N"}
    return Recording(trajectories=tuple(runs), units=units)
