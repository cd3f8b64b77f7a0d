"""The experiment that best separates effects which a data set cannot tell apart.

Each of a few standard experiments is simulated with the named effect and fitted with its rival; what the rival cannot
imitate, against the noise of this data set, is the separation (T-optimality by enumeration).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from mrwarp.diagnose.choose import Choice
from mrwarp.diagnose.engine import Engine
from mrwarp.diagnose.kernels import HEAT_TIMES
from mrwarp.diagnose.kinematics import Kinematics
from mrwarp.diagnose.replay import ExtendedReplay, Motion
from mrwarp.diagnose.result import NextExperiment
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.sysid.replay import Samples

_SECONDS = 16.0
_SIGMAS = 5.0
_SAFETY = 4.0
"""How much longer than ideal data would need: model errors and trajectories that differ."""

_WORDS: Mapping[str, str] = {
    "current steps": "step the current to random levels every 0.2 to 0.6 s while the joint swings at 1 Hz",
    "current chirp": "sweep the current from 0.5 to 20 Hz while the joint swings at 1 Hz",
    "current staircase": "raise and lower the current in slow steps while the joint swings at 1 Hz",
    "fast swings": "swing the joint through its whole range at 0.5 to 3 Hz at several constant currents",
    "slow triangle": "move the joint slowly back and forth through its whole range at several constant currents",
    "small swings": "swing the joint by a tenth of its range at 1 to 6 Hz at several constant currents",
}


def propose(engine: Engine, choice: Choice, seed: int) -> NextExperiment | None:
    """The experiment for the first named effect that has rivals; None where nothing is left open."""
    for effect, rivals in choice.alternatives.items():
        if not rivals:
            continue
        rest = tuple(e for e in choice.final.effects if e != effect)
        names = (effect, *rivals)
        if set(names) <= {"wear", "temperature_drift", "current_saturation"}:
            return NextExperiment(
                what="repeat the first trajectory after a rest of several thermal time constants, and again at the end",
                seconds=3.0 * 600.0, separates=names, kind="rest and repeat",
            )  # fmt: skip
        rng = np.random.default_rng(seed)
        best = None
        for kind in _WORDS:
            separation = min(_separation(engine, choice, kind, rest, rival, rng) for rival in rivals)
            if best is None or separation > best[1]:
                best = (kind, separation)
        assert best is not None
        kind, separation = best
        rate = 1.0 / engine.motion.ranges.dt
        seconds = _SAFETY * _SIGMAS**2 / (rate * max(separation, 1e-9) ** 2)
        scales = engine.samples.scales
        seconds = float(np.clip(seconds, 2.0, 36000.0))
        settings = {
            "separation_sigma": float(separation), "range": engine.motion.ranges.q * scales.q,
            "current_max": engine.motion.ranges.current * scales.current, "rate": rate,
        }  # fmt: skip
        return NextExperiment(what=_WORDS[kind], seconds=seconds, separates=names, kind=kind, settings=settings)
    return None


def _separation(
    engine: Engine, choice: Choice, kind: str, rest: tuple[str, ...], rival: str, rng: np.random.Generator
) -> float:
    """RMS, in units of the whitened noise, of what the rival cannot imitate of the final model in an experiment."""
    final = choice.final
    order = tuple(name for name in CATALOGUE if name in {*rest, rival})
    other = choice.fits.get(order)
    if other is None:
        return 0.0
    motion = _motion(engine.motion, kind, rng)
    replay = ExtendedReplay(motion)
    torque = replay.torque(final.coordinates.row(final.x)[None])[0].astype(float)
    motion = dataclasses.replace(motion, samples=dataclasses.replace(motion.samples, torque=torque))
    trial = Engine(ExtendedReplay(motion), engine.q_zero, np.ones(len(torque)), engine.units)
    trial.noise = dataclasses.replace(engine.noise_model, offset=0.0, gain=0.0)
    c = other.coordinates
    fitted = trial.fit(c, other.x, iterations=6)
    return float(np.sqrt(fitted.loss.sum() / max(fitted.grams.count, 1.0)))


def _motion(like: Motion, kind: str, rng: np.random.Generator) -> Motion:
    """Motion and current of an experiment within the ranges of a data set; inner units, without noise."""
    r = like.ranges
    dt = r.dt
    t = np.arange(round(_SECONDS / dt)) * dt
    swing, top = 0.35 * r.q, r.current
    speed = r.qd
    current = np.zeros(len(t))
    if kind in ("current steps", "current chirp", "current staircase"):
        omega = min(2.0 * np.pi * 1.0, speed / swing * 1.5)
        q = swing * np.sin(omega * t)
    if kind == "current steps":
        at = 0
        while at < len(t):
            span = round(rng.uniform(0.2, 0.6) / dt)
            current[at : at + span] = rng.uniform(0.0, top)
            at += span
    elif kind == "current chirp":
        phase = 2.0 * np.pi * np.cumsum(0.5 * 40.0 ** (t / t[-1])) * dt
        current = 0.5 * top * (1.0 + np.sin(phase))
    elif kind == "current staircase":
        level = np.abs((t / 4.0) % 2.0 - 1.0)
        current = top * np.round(level * 8.0) / 8.0
    else:
        size, low, high = {
            "fast swings": (swing, 0.5, 3.0), "slow triangle": (swing, 0.1, 0.1), "small swings": (0.1 * r.q, 1.0, 6.0)
        }[kind]  # fmt: skip
        f = low * (high / low) ** (t / t[-1])
        phase = 2.0 * np.pi * np.cumsum(f) * dt
        q = size * np.sin(phase)
        fastest = float(np.abs(np.gradient(q, dt)).max())
        if fastest > 2.0 * speed:
            q = q * 2.0 * speed / fastest
        current = top * np.floor(4.0 * t / t[-1] * 0.999) / 3.0
    if not np.any(like.samples.current):
        current[:] = 0.0
    qd = np.gradient(q, dt)
    samples = Samples(
        q=q + 0.5 * (like.samples.q.max() + like.samples.q.min()), qd=qd, current=current, torque=np.zeros(len(t)),
        start=np.array([0, len(t)]), dt=np.array([dt]), scales=like.samples.scales,
    )  # fmt: skip
    qdd = np.gradient(qd, dt)
    return Motion(
        samples=samples, qdd=qdd, time=t, slid_time=t, heat=np.zeros((len(HEAT_TIMES), len(t))), ranges=r,
        kinematics=Kinematics(qd=qd, qdd=qdd, velocity_lag=0.0, velocity_lag_error=float("inf")),
    )  # fmt: skip
