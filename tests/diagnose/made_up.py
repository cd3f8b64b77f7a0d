"""Diagnoses as the pictures and the report get them, made up from a loop with a lag in its current; no fit is run."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mrwarp.diagnose.result import REGIMES, Accounting, Diagnosis, Shift, Traces, Tried
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.model_file import FittedOn, Model, Parameter, make_effect
from mrwarp.params import MrParams
from mrwarp.recording.load import Recording, Trajectory
from mrwarp.sysid.verdict import Cause, Error, Gain, NextExperiment, Unexplained, Value, Verdict

DT = 0.005
NOISE = 0.05
_REQUIRED = ("D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma")


def make(verdict: Verdict | None = "named", *, runs: int = 8, samples: int = 800, **changes: Any) -> Diagnosis:
    """A diagnosis with the parts that its verdict has; ``changes`` replaces fields."""
    rng = np.random.default_rng(3)
    recording, traces = _data(rng, runs, samples, verdict)
    before, after = traces.torque - traces.baseline, traces.torque - traces.extended
    parts = [slice(k * samples, (k + 1) * samples) for k in range(runs)]
    names = [run.id for run in recording.trajectories]
    spread = float(traces.torque.std())
    causes = (
        Cause(
            name="coil_lag",
            p_value=1e-9,
            alternatives=("command_delay",),
            gain=0.6,
            parameters={"time_constant": Value(value=0.01, ci95=(0.0097, 0.0104), unit="s")},
        ),
    )
    structure = Unexplained(depends_on=("q", "qd"), form="a smooth product of angle and velocity", share=0.4)
    fields: dict[str, Any] = {
        "verdict": verdict,
        "sentence": "The current in the coil lags behind its command by 10 ms.",
        "causes": causes if verdict in ("named", "named_and_unexplained") else (),
        "parameter_shift": (
            Shift(name="torque_gain", value=1.03, ci95=(1.02, 1.04), unit="1", alternatives=("current_gain",)),
        ),
        "unexplained": structure if verdict in ("unexplained", "named_and_unexplained") else None,
        "detectable": {"wear": Value(value=1e-5, ci95=(1e-5, 1e-5), unit="1/s"),
                       "backlash": Value(value=0.002, ci95=(0.002, 0.002), unit="rad")},
        "invisible": {"temperature_drift": "the session lasts 30 s"},
        "cannot_know": (),
        "baseline": Error(rmse=_rms(before), nrmse=_rms(before) / spread, unit="N·m"),
        "extended": Error(rmse=_rms(after), nrmse=_rms(after) / spread, unit="N·m"),
        "gain": Gain(rmse_reduction=0.4, ci95=(0.35, 0.45), held_out=tuple(names[:2]))
        if verdict in ("named", "named_and_unexplained") else None,
        "next_experiment": NextExperiment(
            what="Step the current at constant speed.", seconds=20.0, separates=("coil_lag", "command_delay"),
            kind="current_steps", settings={"speed": 1.0}),
        "tried": tuple(
            Tried(name=name, gain=0.6 * 0.75**k, error=0.01, values={"x": 1.0}, outcome="rejected: it only fits noise")
            for k, name in enumerate(["coil_lag", "command_delay", *(n for n in CATALOGUE if n[0] not in "ce")])
        ),
        "accounting": Accounting(named=0.6, predictable=0.1, noise=0.3),
        "per_trajectory": {n: (_rms(before[p]), _rms(after[p])) for n, p in zip(names, parts, strict=True)},
        "per_regime": {name: (0.2, 0.1) for name in REGIMES},
        "notes": ("trajectory 'run 3' has a gap",),
        "model": _model(recording),
        "recording": recording,
        "traces": traces,
        "seconds": 4.2,
        "seed": 7,
    }  # fmt: skip
    if verdict is None:
        nothing = Error(rmse=float("nan"), nrmse=float("nan"), unit="N·m")
        fields |= {
            "sentence": "No verdict: the joint hardly moves.", "parameter_shift": (), "detectable": {}, "tried": (),
            "gain": None, "model": None, "traces": None, "baseline": nothing, "extended": nothing, "per_trajectory": {},
            "per_regime": {}, "cannot_know": ("The joint hardly moves: record 30 s of 1 Hz swings.",),
        }  # fmt: skip
    return Diagnosis(**(fields | changes))


def _data(rng: np.random.Generator, runs: int, samples: int, verdict: str | None) -> tuple[Recording, Traces]:
    """Swings with stepped current whose field lags by 10 ms; the baseline knows nothing of the lag."""
    t = np.arange(samples) * DT
    trajectories, rows = [], []
    for k in range(runs):
        q = 0.4 * np.sin(2 * np.pi * (0.6 + 0.1 * k) * t)
        qd = np.gradient(q, DT)
        current = np.repeat(rng.choice([0.0, 0.5, 1.0, 1.5], samples // 80 + 1), 80)[:samples]
        field = current.copy()
        for i in range(1, samples):
            field[i] += (field[i - 1] - current[i]) * np.exp(-DT / 0.01)
        shape = np.tanh(4.0 * qd)
        named = verdict in ("named", "named_and_unexplained")
        base, extended = (0.4 + current) * shape, (0.4 + (field if named else current)) * shape
        torque = extended + NOISE * rng.normal(size=samples)
        if verdict in ("unexplained", "named_and_unexplained"):
            torque = torque + 0.3 * q**2
        trajectories.append(Trajectory(id=f"run {k}", t=t, q=q, qd=qd, current=current, torque=torque))
        regime = np.where(np.abs(qd) < 0.05, 0, 1)
        rows.append((torque, base, extended, q, qd, np.gradient(qd, DT), current, t + k * samples * DT, regime))
    names = ("torque", "baseline", "extended", "q", "qd", "qdd", "current", "time", "regime")
    columns: Mapping[str, Any] = dict(zip(names, map(np.concatenate, zip(*rows, strict=True)), strict=True))
    traces = Traces(**columns, start=np.arange(runs + 1) * samples, noise_rms=NOISE)
    return Recording(trajectories=tuple(trajectories)), traces


def _model(recording: Recording) -> Model:
    numbers = MrParams().to_dict()
    flat = {k: v for group in numbers.values() if isinstance(group, dict) for k, v in group.items()} | numbers
    return Model(
        parameters={k: Parameter(value=float(flat[k]), unit=MrParams.spec(k).unit) for k in _REQUIRED},
        fitted_on=FittedOn(source="made up", trajectories=8, samples=recording.samples, rate=200.0),
        effects=(make_effect("coil_lag", {"time_constant": 0.01, "hold": 0.0}),),
    )


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))
