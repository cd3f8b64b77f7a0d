"""The whole diagnosis: what is wrong, why, the extended model and what it gains."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

import numpy as np
from scipy.stats import chi2

from mrwarp.diagnose.choose import Choice, best_single, choose, threshold
from mrwarp.diagnose.detectable import detectable
from mrwarp.diagnose.engine import Engine, Fitted
from mrwarp.diagnose.experiment import propose
from mrwarp.diagnose.heldout import HeldOut, hold_out, reduction
from mrwarp.diagnose.lines import Line, find_line
from mrwarp.diagnose.model import LINEAR, Slot
from mrwarp.diagnose.predictor import Predictor
from mrwarp.diagnose.prepare import groups_of, learn_noise, prepare
from mrwarp.diagnose.result import (
    REGIMES,
    Accounting,
    Cause,
    Diagnosis,
    Error,
    Gain,
    Shift,
    Traces,
    Tried,
    Unexplained,
    Value,
    Verdict,
)
from mrwarp.diagnose.shift import Found, find_shifts
from mrwarp.diagnose.sufficient import gaps, hindrances
from mrwarp.diagnose.uncertainty import covariance, interval
from mrwarp.diagnose.units import factor_of, outer_model, unit_of
from mrwarp.diagnose.words import experiment_sentence, sentence_of
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.model_file import JOINT_UNITS, Model
from mrwarp.params import MrParams
from mrwarp.sysid.recording import Recording

Progress = Callable[[str], None]

_UNEXPLAINED_T = 2.0
"""Structure is only reported when it foretells trajectories with this ratio to its standard error."""
_SLOW_T = 2.5
_SHARE = 0.2
"""Part of the predictable mismatch above which what is left beside named effects is reported."""


def diagnose(
    recording: Recording,
    *,
    model: Model | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    threads: int = 1,
) -> Diagnosis:
    """Find what eqs. 14 and 15 get wrong about a recording, and why.

    Args:
        recording: Measured runs.
        model: The device as it should be: its parameters are nominal for shifts of calibration, its effects are part
            of the baseline. None: the paper's joint where the units are its own.
        seed: Seed of every draw (starts, resampling).
        progress: Told what is being done.
        threads: CPU threads of the replay.
    """
    told = progress or (lambda text: None)
    begun = time.perf_counter()
    reasons = hindrances(recording)
    if reasons:
        return _no_verdict(recording, reasons, seed, time.perf_counter() - begun)
    known = tuple(e.name for e in model.effects if e.name in CATALOGUE) if model else ()
    baseline = prepare(recording, known=known, model=model, threads=threads, seed=seed, told=told)
    engine, base = baseline.engine, baseline.fitted
    line = find_line(engine.samples.torque - base.torque, engine.samples, engine.noise_model)
    if line:
        told(f"a line at {line.frequency:.2f} Hz is set aside")
        engine.set_aside(line.frequency, base.torque)
        base = engine.fit(base.coordinates, base.x)
        engine.noise = learn_noise(engine, base.torque, groups_of(engine, base.coordinates, base.x))
        base = engine.fit(base.coordinates, base.x)

    lag = engine.motion.kinematics.velocity_lag
    candidates = [
        name for name, law in CATALOGUE.items()
        if law.kind != "calibration" and name not in known and (name != "velocity_lag" or lag > 0.0)
    ]  # fmt: skip
    told(f"{len(candidates)} effects as candidates")
    first = best_single(engine, base, candidates)
    if first is not None:
        told(f"noise without {first.effects[-1]}")
        engine.noise = learn_noise(engine, first.torque, groups_of(engine, first.coordinates, first.x))
        base = engine.fit(base.coordinates, base.x)
    choice = choose(engine, base, lambda f: groups_of(engine, f.coordinates, f.x), candidates, told)

    told("smallest sizes that would have shown")
    sizes, unseen = detectable(engine, choice.final, candidates)
    held = hold_out(engine, choice)
    unexplained = _unexplained(choice, line)
    causes = _causes(engine, choice, candidates)
    shifts = _shifts(engine, choice, recording, model)
    told("next experiment")
    following = propose(engine, choice, seed)
    return _assembled(
        engine, choice, held, line, unexplained, causes, shifts, sizes, unseen, following, recording, seed, begun
    )


# --- the parts of the result ---


def _unexplained(choice: Choice, line: Line | None) -> Unexplained | None:
    """Structure that stays when the named effects are in, or None."""
    final = choice.final
    left = [
        f for f in choice.left_after
        if f.gain > 1.5 * threshold(final) and f.t > (_SLOW_T if f.group.slow or "memory" in f.group.variables else _UNEXPLAINED_T)
    ]  # fmt: skip
    gain = max([f.gain for f in left], default=0.0)
    if line is None and not left:
        return None
    named = choice.gain
    both = gain + (line.gain if line else 0.0)
    share = both / max(named + both, 1e-9)
    if named > 0.0 and share < _SHARE:
        return None
    if line is not None and line.gain > gain:
        return Unexplained(depends_on=("frequency",), form=f"a line at {line.frequency:.2f} Hz", share=share)
    top = left[0]
    variables = list(top.group.variables)
    for f in left[1:3]:
        if f.gain > 0.5 * top.gain:
            variables += [v for v in f.group.variables if v not in variables]
    return Unexplained(depends_on=tuple(variables), form=top.group.form, share=share)


def _causes(engine: Engine, choice: Choice, candidates: list[str]) -> list[Cause]:
    final = choice.final
    spread = covariance(final)
    starts = sum(1 for _ in candidates) * 6
    causes = []
    for effect in final.effects:
        if effect in choice.base.effects:
            continue
        parameters = {}
        for i, slot in enumerate(final.coordinates.slots, start=9):
            if slot.effect == effect:
                parameters[slot.parameter.name] = _value(engine, final, slot, i, spread)
        own = choice.own_gain.get(effect, choice.gain)
        count = len(parameters)
        causes.append(
            Cause(
                name=effect,
                parameters=parameters,
                p_value=float(min(1.0, starts * chi2.sf(max(own, 0.0), count))),
                alternatives=choice.alternatives.get(effect, ()),
                gain=own / float(choice.base.left_out.sum()),
            )  # fmt: skip
        )
    return sorted(causes, key=lambda c: -c.gain)


def _value(engine: Engine, fit: Fitted, slot: Slot, index: int, spread: np.ndarray) -> Value:
    factor = factor_of(slot.parameter, engine.samples.scales)
    low, high = interval(fit, index, spread)
    numbers = np.array([fit.x[index], low, high])
    if slot.logarithmic:
        numbers = np.exp(numbers)
    value, low, high = numbers * factor
    return Value(value=float(value), ci95=(float(low), float(high)), unit=unit_of(slot.parameter, engine.units))


def _shifts(engine: Engine, choice: Choice, recording: Recording, model: Model | None) -> list[Shift]:
    """Shifts of calibration against the nominal parameters."""
    if model is not None:
        nominal = model.values
    elif recording.units == JOINT_UNITS:
        paper = MrParams().bouc_wen
        nominal = {name: getattr(paper, name) for name in LINEAR}
    else:
        return []
    scales = engine.samples.scales
    inner = {name: nominal[name] / scales.factor(name) for name in LINEAR}
    found = find_shifts(choice.final, inner, float(np.ptp(engine.samples.torque)))
    return [_shift(f, engine, recording) for f in found]


def _shift(found: Found, engine: Engine, recording: Recording) -> Shift:
    bias = found.name == "torque_bias"
    factor = engine.samples.scales.torque if bias else 1.0
    half = 1.96 * found.error * factor
    value = found.value * factor
    return Shift(
        name=found.name, value=value, ci95=(value - half, value + half),
        unit=recording.units["torque"] if bias else "1", alternatives=found.alternatives,
    )  # fmt: skip


def _assembled(
    engine: Engine,
    choice: Choice,
    held: HeldOut,
    line: Line | None,
    unexplained: Unexplained | None,
    causes: list[Cause],
    shifts: list[Shift],
    sizes: dict[str, float],
    unseen: list[str],
    following,
    recording: Recording,
    seed: int,
    begun: float,
) -> Diagnosis:
    samples, scales = engine.samples, engine.samples.scales
    measured = engine.measured
    base_error, extended_error = measured - choice.base.torque, measured - choice.final.torque
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
        gain = Gain(
            rmse_reduction=value, ci95=ci95, held_out=tuple(names),
            per_regime=_per_regime(held.foretold_baseline - measured, held.foretold_extended - measured, regime, scales.torque),
        )  # fmt: skip
    spread = float(measured.std()) or 1.0
    visible = {
        name: Value(value=size * factor_of(p, scales), ci95=(0.0, 0.0), unit=unit_of(p, engine.units))
        for name, size in sizes.items()
        for p in [CATALOGUE[name].parameters[0]]
    }
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
            f"without one of the trajectories another model would have been chosen in {100 * (1 - held.agreed):.0f} % of cases"
        )
    total = float(choice.base.left_out.sum())
    left = max([f.gain for f in choice.left_after], default=0.0) + (line.gain if line else 0.0)
    named_share = max(0.0, choice.gain) / total
    predictable = max(0.0, left) / total if unexplained else 0.0
    result = Diagnosis(
        verdict=verdict, sentence="", causes=tuple(causes), parameter_shift=tuple(shifts), unexplained=unexplained,
        detectable=visible, invisible=invisible, cannot_know=tuple(gaps(recording)),
        baseline=Error(rmse=_rms(base_error) * scales.torque, nrmse=_rms(base_error) / spread, unit=unit),
        extended=Error(rmse=_rms(extended_error) * scales.torque, nrmse=_rms(extended_error) / spread, unit=unit),
        gain=gain, next_experiment=following, tried=tuple(_tried(engine, choice, causes)),
        accounting=Accounting(named=named_share, predictable=predictable, noise=max(0.0, 1.0 - named_share - predictable)),
        per_trajectory={
            name: (float(np.sqrt(a / n)) * scales.torque, float(np.sqrt(b / n)) * scales.torque)
            for name, a, b, n in zip(names, held.baseline, held.extended, np.diff(samples.start), strict=True)
        },
        per_regime=_per_regime(base_error, extended_error, regime, scales.torque), notes=tuple(notes),
        model=outer_model(engine, choice.final, recording, seed), recording=recording,
        traces=Traces(
            torque=measured * scales.torque, baseline=choice.base.torque * scales.torque,
            extended=choice.final.torque * scales.torque, q=samples.q * scales.q, qd=samples.qd * scales.q,
            qdd=engine.motion.qdd * scales.q, current=samples.current * scales.current, time=engine.motion.time,
            start=samples.start, regime=regime, noise_rms=engine.noise_model.rms * scales.torque,
        ),
        predictor=Predictor.of(engine, choice), seconds=time.perf_counter() - begun, seed=seed,
    )  # fmt: skip
    return dataclasses.replace(result, sentence=sentence_of(result))


def _tried(engine: Engine, choice: Choice, causes: list[Cause]) -> list[Tried]:
    named = {c.name for c in causes}
    rivals = {a for c in causes for a in c.alternatives}
    total = float(choice.base.left_out.sum())
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
            found[name] = (_rms(before[at]) * scale, _rms(after[at]) * scale)
    return found


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _no_verdict(recording: Recording, reasons: list[str], seed: int, seconds: float) -> Diagnosis:
    unit = recording.units["torque"]
    nothing = Error(rmse=float("nan"), nrmse=float("nan"), unit=unit)
    result = Diagnosis(
        verdict=None, sentence="", causes=(), parameter_shift=(), unexplained=None, detectable={}, invisible={},
        cannot_know=tuple(reasons + gaps(recording)), baseline=nothing, extended=nothing, gain=None,
        next_experiment=experiment_sentence(reasons), tried=(),
        accounting=Accounting(named=0.0, predictable=0.0, noise=1.0), per_trajectory={}, per_regime={}, notes=(),
        model=None, recording=recording, traces=None, seconds=seconds, seed=seed,
    )  # fmt: skip
    return dataclasses.replace(result, sentence=sentence_of(result))
