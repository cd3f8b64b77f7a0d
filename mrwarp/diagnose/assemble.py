"""The typed result from the parts of a diagnosis."""

from __future__ import annotations

import dataclasses
import time

import numpy as np

from mrwarp.diagnose.choice import Choice, threshold
from mrwarp.diagnose.data_checks import gaps
from mrwarp.diagnose.engine import Engine
from mrwarp.diagnose.formula import find_formula
from mrwarp.diagnose.heldout import HeldOut, reduction
from mrwarp.diagnose.physical_units import factor_of, outer_model, unit_of
from mrwarp.diagnose.predictor import Predictor
from mrwarp.diagnose.result import (
    REGIMES,
    Accounting,
    Cause,
    Diagnosis,
    Error,
    Gain,
    NextExperiment,
    Shift,
    Traces,
    Tried,
    Unexplained,
    Value,
    Verdict,
)
from mrwarp.diagnose.spectral_lines import Line
from mrwarp.diagnose.verdict_text import sentence_of
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.dataset import rms
from mrwarp.recording.load import Recording


def assembled(
    engine: Engine,
    choice: Choice,
    held: HeldOut,
    line: Line | None,
    unexplained: Unexplained | None,
    causes: list[Cause],
    shifts: list[Shift],
    sizes: dict[str, float],
    unseen: list[str],
    following: NextExperiment | None,
    recording: Recording,
    seed: int,
    begun: float,
) -> Diagnosis:
    """The typed result from what was found."""
    samples, scales = engine.samples, engine.samples.scales
    measured = engine.measured
    baseline, extended = choice.stated(engine, choice.base), choice.stated(engine, choice.final)
    base_error, extended_error = measured - baseline.torque, measured - extended.torque
    regime = regimes(engine)
    names = [run.id for run in recording.trajectories]
    unit = recording.units["torque"]
    verdict: Verdict = "none"
    if causes:
        verdict = "named_and_unexplained" if unexplained else "named"
    elif unexplained:
        verdict = "unexplained"
    gain = None
    if causes:
        value, ci95 = reduction(held, seed)
        foretold = (held.foretold_baseline - measured, held.foretold_extended - measured)
        per_regime = _per_regime(*foretold, regime, scales.torque)
        gain = Gain(rmse_reduction=value, ci95=ci95, held_out=tuple(names), per_regime=per_regime)
    spread = float(measured.std()) or 1.0
    visible = {
        name: Value(value=size * factor_of(p, scales), ci95=(0.0, 0.0), unit=unit_of(p, engine.units))
        for name, size in sizes.items()
        for p in [CATALOGUE[name].parameters[0]]
    }
    traces = Traces(
        torque=measured * scales.torque, baseline=baseline.torque * scales.torque,
        extended=extended.torque * scales.torque, q=samples.q * scales.q, qd=samples.qd * scales.q,
        qdd=engine.motion.qdd * scales.q, current=samples.current * scales.current, time=engine.motion.time,
        start=samples.start, regime=regime, noise_rms=engine.noise_model.rms * scales.torque,
    )  # fmt: skip
    if unexplained is not None:
        formula = find_formula(traces, unexplained, recording.units, seed=seed)
        unexplained = dataclasses.replace(unexplained, formula=formula)
    invisible = {name: _why_unseen(name, recording) for name in unseen}
    for name, law in CATALOGUE.items():
        if law.kind == "calibration":
            invisible[name] = (
                "re-fitting eq. 14 takes it up without a trace; only nominal parameters (--model) can show it"
            )
    if engine.motion.kinematics.velocity_lag == 0.0:
        error = engine.motion.kinematics.velocity_lag_error
        if np.isfinite(error):
            visible["velocity_lag"] = Value(value=max(5.0 * error, 1e-4), ci95=(0.0, 0.0), unit="s")
            invisible.pop("velocity_lag", None)
        else:
            visible.pop("velocity_lag", None)
            invisible["velocity_lag"] = "the recording has no velocity channel"
    notes = [f"velocity derived from the angle without phase: {sum(r.qd_derived for r in recording.trajectories)} of "
             f"{len(names)} trajectories"] if any(r.qd_derived for r in recording.trajectories) else []  # fmt: skip
    if held.agreed < 1.0 and causes:
        notes.append(
            "without one of the trajectories another model would have been chosen "
            f"in {100 * (1 - held.agreed):.0f} % of cases"
        )
    total = choice.base.total
    left = max([f.gain for f in choice.left_after], default=0.0) + (line.gain if line else 0.0)
    named_share = max(0.0, choice.gain) / total
    predictable = max(0.0, left) / total if unexplained else 0.0
    result = Diagnosis(
        verdict=verdict, sentence="", causes=tuple(causes), parameter_shift=tuple(shifts), unexplained=unexplained,
        detectable=visible, invisible=invisible, cannot_know=tuple(gaps(recording)),
        baseline=Error(rmse=rms(base_error) * scales.torque, nrmse=rms(base_error) / spread, unit=unit),
        extended=Error(rmse=rms(extended_error) * scales.torque, nrmse=rms(extended_error) / spread, unit=unit),
        gain=gain, next_experiment=following, tried=tuple(_tried(engine, choice, causes)),
        accounting=Accounting(
            named=named_share, predictable=predictable, noise=max(0.0, 1.0 - named_share - predictable)
        ),
        per_trajectory={
            name: (float(np.sqrt(a / n)) * scales.torque, float(np.sqrt(b / n)) * scales.torque)
            for name, a, b, n in zip(
                names, held.baseline, held.extended if causes else held.baseline, np.diff(samples.start), strict=True
            )
        },
        per_regime=_per_regime(base_error, extended_error, regime, scales.torque), notes=tuple(notes),
        model=outer_model(engine, extended, recording, seed, choice.refined),
        baseline_model=outer_model(engine, baseline, recording, seed), recording=recording,
        traces=traces, predictor=Predictor.of(engine, choice), seconds=time.perf_counter() - begun, seed=seed,
    )  # fmt: skip
    return dataclasses.replace(result, sentence=sentence_of(result))


def _tried(engine: Engine, choice: Choice, causes: list[Cause]) -> list[Tried]:
    named = {c.name for c in causes}
    rivals = {a for c in causes for a in c.alternatives}
    total = choice.base.total
    need = threshold(choice.base)
    rows = []
    for c in choice.first_look:
        d = choice.base.left_out - c.left_out
        gain, error = float(d.sum()) / total, float(np.std(d, ddof=1) * np.sqrt(len(d))) / total
        if c.effect in named:
            outcome = "named"
        elif c.effect in rivals:
            outcome = "alternative: these data cannot tell it from the cause named"
        elif gain * total < need:
            outcome = "rejected: gains no more than noise would"
        elif named:
            outcome = "rejected: adds too little once the named causes are in"
        else:
            outcome = "rejected: free functions of other variables explain the same better"
        coordinates = engine.coordinates(
            (*choice.base.effects, c.effect), {**choice.base.coordinates.choices, **c.choices}
        )
        values = {}
        own = [s for s in coordinates.slots if s.effect == c.effect]
        for slot, x in zip(own, c.values, strict=True):
            inner = float(np.exp(x)) if slot.logarithmic else float(x)
            values[slot.parameter.name] = inner * factor_of(slot.parameter, engine.samples.scales)
        rows.append(Tried(name=c.effect, gain=gain, error=error, values=values, outcome=outcome))
    return rows


def _why_unseen(name: str, recording: Recording) -> str:
    if name in ("coil_lag", "command_delay", "remanence"):
        return "the current hardly changes within a trajectory"
    if name in ("current_saturation", "current_viscosity"):
        return "too few levels of current"
    return "at no size in its range would it stand out from what eq. 14 takes up and from the noise"


def regimes(engine: Engine) -> np.ndarray:
    """Index into ``REGIMES`` of each sample, shape (N,)."""
    s, r = engine.samples, engine.motion.ranges
    out = np.full(len(s.q), REGIMES.index("slip"), dtype=np.int8)
    out[np.abs(s.qd) < 0.02 * r.qd] = REGIMES.index("hold")
    for part, dt in zip(s.parts, s.dt, strict=True):
        reach = max(1, round(0.1 / dt))
        qd = s.qd[part]
        turns = np.flatnonzero((qd[1:] * qd[:-1] < 0.0) & (np.abs(qd[1:] - qd[:-1]) > 1e-3 * r.qd))
        jumps = np.flatnonzero(np.abs(np.diff(s.current[part])) > 0.05 * r.current)
        for marks, name in ((turns, "reversal"), (jumps, "current step")):
            for k in marks:
                at = part.start + int(k) + 1
                out[at : min(at + reach, part.stop)] = REGIMES.index(name)
    return out


def _per_regime(
    before: np.ndarray, after: np.ndarray, regime: np.ndarray, scale: float
) -> dict[str, tuple[float, float]]:
    found = {}
    for i, name in enumerate(REGIMES):
        at = regime == i
        if at.any():
            found[name] = (rms(before[at]) * scale, rms(after[at]) * scale)
    return found
