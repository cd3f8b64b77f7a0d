"""The result of a joint's diagnosis: the answer of any plant, and what a joint has in addition."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from mrwarp.diagnose.checks.recording_faults import RecordingFault
from mrwarp.diagnose.checks.spikes import Spikes
from mrwarp.diagnose.held_out import Account, Predictor
from mrwarp.diagnose.law_choice import LawChoice
from mrwarp.identify.dataset import parts_of, rms
from mrwarp.model_file import Model
from mrwarp.recording.load import Recording
from mrwarp.sysid.verdict import Answer, Value


@dataclass(frozen=True, kw_only=True)
class Shift(Value):
    """A shift of calibration against the nominal model."""

    name: str
    alternatives: tuple[str, ...]


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
class Diagnosis(Answer):
    """The result of :func:`mrwarp.diagnose.pipeline.diagnose`.

    Errors are RMS of torque. All samples count equally but those at which nobody knows the state of the joint: the
    first of a trajectory, until the unknown stress at its start is forgotten, and the edges of rests.
    """

    law: LawChoice | None = None
    """The hysteresis law of the baseline and what it was compared with; None: no comparison was needed."""
    recording_faults: tuple[RecordingFault, ...] = ()
    """Faults of the recording itself, taken out before anything else was asked."""
    parameter_shift: tuple[Shift, ...] = ()
    invisible: Mapping[str, str] = field(default_factory=dict)
    """Effects that no size would show in these data, and why."""
    tried: tuple[Tried, ...] = ()
    account: Account | None = None
    """Shifts with intervals, and their evidence."""
    spikes: Spikes | None = None
    """Samples that were kept out of every fit; None: there are none."""
    accounting: Accounting = Accounting(named=0.0, predictable=0.0, noise=1.0)
    per_trajectory: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """RMSE of baseline and extension, of the same errors."""
    per_regime: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """RMSE for hold, slip, reversal, current step."""
    model: Model | None = None
    """The extended model."""
    baseline_model: Model | None = None
    """The baseline, fitted to the same data without the causes."""
    recording: Recording
    traces: Traces | None = None
    predictor: Predictor | None = None
    """Baseline and extended model, for other recordings of the device."""

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
        """The figures of ``result.json``, with those of a joint."""
        account = None
        if self.account is not None:
            account = {name: x for name, x in asdict(self.account).items() if name not in ("unreported", "of_runs")}
        rows = ("recording_faults", "parameter_shift", "tried")
        found = super().to_dict()
        return found | {
            "invisible": self.invisible,
            "extended": {"rmse": self.extended.rmse, "nrmse": self.extended.nrmse},
            "accounting": asdict(self.accounting),
            **{name: [asdict(row) for row in getattr(self, name)] for name in rows},
            **{name: _before_after(getattr(self, name)) for name in ("per_trajectory", "per_regime")},
            "account": account,
            "law": self._law(),
            "gain": found["gain"] | {"per_regime": _before_after(self.per_regime) if self.gain else {}},
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
