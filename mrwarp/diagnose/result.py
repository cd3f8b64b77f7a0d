"""The result of a diagnosis: typed data, from which the report and ``result.json`` are written."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.diagnose.checks.recording_faults import RecordingFault
from mrwarp.diagnose.checks.spikes import Spikes
from mrwarp.diagnose.held_out import Account, Predictor
from mrwarp.diagnose.law_choice import LawChoice
from mrwarp.identify.dataset import parts_of, rms
from mrwarp.model_file import Model
from mrwarp.recording.load import Recording
from mrwarp.run_dir import write_result
from mrwarp.sysid.verdict import Verdict


@dataclass(frozen=True, kw_only=True)
class Value:
    """A number with its 95 % interval and unit."""

    value: float
    ci95: tuple[float, float]
    unit: str


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A named effect."""

    name: str
    parameters: Mapping[str, Value]
    p_value: float
    """Chance that noise alone would give as much, after looking at every candidate."""
    alternatives: tuple[str, ...]
    """Effects that these data cannot distinguish from it."""
    gain: float
    """Reduction of the held-out squared mismatch that is this effect's alone [1]."""


@dataclass(frozen=True, kw_only=True)
class Suspect:
    """An effect that fits, but is not proven: no cause, and no part of the extended model."""

    name: str
    reason: str
    """The missing part of a proof."""
    parameters: Mapping[str, Value]
    """Its numbers where it was found."""
    gain: float
    """Reduction of the squared mismatch where it was found [1]."""
    possible: bool = True
    """False: no device has it with this sign or size; a report shows it with what was tried only."""


@dataclass(frozen=True, kw_only=True)
class Shift(Value):
    """A shift of calibration against the nominal model."""

    name: str
    alternatives: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """Structure that no effect of the catalogue explains."""

    depends_on: tuple[str, ...]
    """Variables, the clearest first."""
    form: str
    """How it depends on them, in words."""
    share: float
    """Its part of all that could be predicted beyond eqs. 14 and 15 [1]."""
    formula: str | None = None


@dataclass(frozen=True, kw_only=True)
class Tried:
    """One effect of the catalogue and what came of it."""

    name: str
    gain: float
    """Reduction of the held-out squared mismatch, alone on top of the baseline [1]; negative: it only fits noise."""
    error: float
    """Standard error of it over trajectories [1]."""
    values: Mapping[str, float]
    """Its best parameters, units of the recording."""
    outcome: str
    """named, alternative, rejected or not visible, with the reason in a few words."""


@dataclass(frozen=True, kw_only=True)
class Error:
    """RMS of measured minus predicted torque, each trajectory predicted by a fit to the others.

    All samples count equally but those at which nobody knows the state of the joint: the first of a trajectory, until
    the unknown stress at its start is forgotten, and the edges of rests.
    """

    rmse: float
    nrmse: float
    """rmse over the standard deviation of the measured torque."""
    unit: str


@dataclass(frozen=True, kw_only=True)
class Gain:
    """Gain of the extension on trajectories that took no part in fitting it."""

    rmse_reduction: float
    """1 - rmse(extended)/rmse(baseline), of the errors that :class:`Error` defines [1]."""
    ci95: tuple[float, float]
    held_out: tuple[str, ...]
    per_regime: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """RMSE of baseline and extension for hold, slip, reversal, current step; units of the recording."""


@dataclass(frozen=True, kw_only=True)
class NextExperiment:
    """A recording that would settle what this one leaves open."""

    what: str
    """The experiment in one sentence."""
    seconds: float
    separates: tuple[str, ...]
    """Effects that it separates, or shows."""
    kind: str
    """Name of the standard experiment."""
    settings: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Accounting:
    """Where the baseline's mean squared mismatch goes; the parts add up to 1: :class:`Account` without intervals."""

    named: float
    predictable: float
    """Repeatable, but not explained by the named effects."""
    noise: float


@dataclass(frozen=True, kw_only=True)
class Traces:
    """Arrays for pictures; units of the recording, all trajectories end to end, shape (N,)."""

    torque: np.ndarray
    baseline: np.ndarray
    extended: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    current: np.ndarray
    time: np.ndarray
    start: np.ndarray
    """First sample of each trajectory and the end of the last, shape (T + 1,)."""
    regime: np.ndarray
    """Index into ``REGIMES`` of each sample."""
    noise_rms: float
    one_clock: bool = True
    """Whether time counts through the session; else from the start of each trajectory."""
    counts: np.ndarray | None = None
    """Samples that are no spike, bool, shape (N,); None: all."""
    without: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Torque of the extended model without one of its causes, all else kept, where it has several; shape (N,)."""

    @property
    def parts(self) -> list[slice]:
        """The samples of each trajectory."""
        return parts_of(self.start)


REGIMES = ("hold", "slip", "reversal", "current step")
"""hold: nearly at rest; reversal: 0.1 s after the velocity changed sign; current step: 0.1 s after a jump."""


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The result of :func:`mrwarp.diagnose.pipeline.diagnose`."""

    verdict: Verdict | None
    """None: the data cannot carry a verdict; ``cannot_know`` says why."""
    sentence: str
    final: bool = True
    """False: a first answer, whose suspects are what looks likeliest; nothing is checked, and there is no model."""
    law: LawChoice | None = None
    """The hysteresis law of the baseline and what it was compared with; None: no comparison was needed."""
    recording_faults: tuple[RecordingFault, ...] = ()
    """Faults of the recording itself, taken out before anything else was asked."""
    causes: tuple[Cause, ...] = ()
    suspects: tuple[Suspect, ...] = ()
    parameter_shift: tuple[Shift, ...] = ()
    unexplained: Unexplained | None = None
    detectable: Mapping[str, Value] = field(default_factory=dict)
    """Smallest size of each effect that these data would have shown; effects missing here are invisible in them."""
    invisible: Mapping[str, str] = field(default_factory=dict)
    """Effects that no size would show in these data, and why."""
    cannot_know: tuple[str, ...]
    """Questions that these data cannot answer, each with the recording to make."""
    baseline: Error
    extended: Error
    gain: Gain | None = None
    next_experiment: NextExperiment | None = None
    tried: tuple[Tried, ...] = ()
    account: Account | None = None
    """Shifts with intervals, and their evidence."""
    spikes: Spikes | None = None
    """Samples that were kept out of every fit; None: there are none."""
    accounting: Accounting = Accounting(named=0.0, predictable=0.0, noise=1.0)
    per_trajectory: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """RMSE of baseline and extension, of the same errors; so is that per regime."""
    per_regime: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    model: Model | None = None
    """The extended model."""
    baseline_model: Model | None = None
    """The baseline, fitted to the same data without the causes."""
    recording: Recording
    traces: Traces | None = None
    predictor: Predictor | None = None
    """Baseline and extended model, for other recordings of the device."""
    seconds: float
    seed: int

    @property
    def dry_friction(self) -> Value | None:
        """Torque at which a law in eq. 15's place slides, where no control input changes it: Coulomb friction.

        None also where it is not known to its own size, as of a joint of one speed: viscous friction does as well; and
        of a joint that moves one way only: an offset of the torque's zero does as well.
        """
        none = not any(run.current.any() for run in self.recording.trajectories) and not self.recording.one_way
        if self.law is None or not self.law.other or self.model is None or not none:
            return None
        slides = self.model.parameters["K0"]  # per unit of h, whose bound is 1
        low, high = slides.ci95 or (-math.inf, math.inf)
        if not high - low < 2.0 * slides.value:
            return None
        return Value(value=slides.value, ci95=(low, high), unit=self.baseline.unit)

    def baseline_rmse(self, recording: Recording) -> float:
        """RMSE of the baseline on another recording of the device [its unit of torque]."""
        return self._rmse(recording, 0)

    def extended_rmse(self, recording: Recording) -> float:
        """RMSE of the extended model on another recording of the device [its unit of torque]."""
        return self._rmse(recording, 1)

    def _rmse(self, recording: Recording, model: int) -> float:
        if self.predictor is None:
            raise ValueError("a diagnosis without a verdict has no model")
        return rms(self.predictor.torque(recording)[model] - np.concatenate([x.torque for x in recording.trajectories]))

    def to_dict(self) -> dict[str, Any]:
        """The figures of ``result.json``; an interval that the data do not give holds infinities, written as null."""
        gain = {"rmse_reduction": None, "ci95": (None, None), "held_out": (), "per_regime": {}}
        if self.gain is not None:
            gain = asdict(self.gain) | {"per_regime": _before_after(self.gain.per_regime)}
        plain = ("verdict", "final", "seconds", "sentence", "cannot_know", "invisible", "notes")
        rows = ("recording_faults", "causes", "suspects", "parameter_shift", "tried")
        parts = ("unexplained", "baseline", "next_experiment", "accounting")
        account = None
        if self.account is not None:
            account = {name: x for name, x in asdict(self.account).items() if name != "unreported"}
        return {
            **{name: getattr(self, name) for name in plain},
            **{name: asdict(part) if (part := getattr(self, name)) else None for name in parts},
            **{name: [asdict(row) for row in getattr(self, name)] for name in rows},
            **{name: _before_after(getattr(self, name)) for name in ("per_trajectory", "per_regime")},
            "account": account,
            "law": self._law(),
            "detectable": {name: {"value": v.value, "unit": v.unit} for name, v in self.detectable.items()},
            "extended": {"rmse": self.extended.rmse, "nrmse": self.extended.nrmse},
            "gain": gain,
            "spikes": {name: getattr(self.spikes, name) for name in _COUNTED} if self.spikes else None,
            "noise_rms": self.traces.noise_rms if self.traces else None,
            "data": _about(self.recording),
        }

    def _law(self) -> dict[str, Any] | None:
        """Compared laws, and the friction of the law that was taken."""
        if self.law is None:
            return None
        dry = {"coulomb_friction": asdict(self.dry_friction)} if self.dry_friction else {}
        return asdict(self.law) | {"title": self.law.title, "error": self.law.error} | dry

    def write(self, out: Path, command: str, extras: Mapping[str, Any] | None = None, *, model_name: str = "") -> Path:
        """Write ``result.json`` atomically into a folder, which is made if it is not there.

        ``extras`` holds further results, such as those of ``--predict``, ``model_name`` the extended model's file.
        """
        figures = self.to_dict() | dict(extras or {}) | {"model": model_name or None}
        return write_result(out, figures, seed=self.seed, command=command)


_COUNTED = ("samples", "share", "of_squared_mismatch", "per_trajectory")
"""Content of ``result.json`` on spikes."""


def _before_after(rows: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    return {name: {"baseline": before, "extended": after} for name, (before, after) in rows.items()}


def _about(recording: Recording) -> dict[str, Any]:
    """Where the data come from, and how many there are."""
    runs = recording.trajectories
    return {
        "source": recording.source,
        "units": recording.units,
        "trajectories": len(runs),
        "samples": recording.samples,
        "seconds": sum(float(run.t[-1] - run.t[0]) for run in runs),
        "rates": sorted({round(1.0 / run.dt, 3) for run in runs}),
        "repairs": [vars(repair) for repair in recording.repairs],
        "velocity_derived": any(run.qd_derived for run in runs),
    }
