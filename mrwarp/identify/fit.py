"""Identification of eqs. 14 and 15 (and 18) from recordings, by simulation error through the simulator's kernels.

Nothing is to be tuned: scales, starts, bounds and steps follow from the recording. See
:mod:`mrwarp.identify.projection` for the search and :mod:`mrwarp.identify.intervals` for the intervals.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from mrwarp.identify.dataset import Dataset, Scales, rms
from mrwarp.identify.holding import fit_holding
from mrwarp.identify.intervals import Estimate, assess
from mrwarp.identify.parameters import (
    LEAST_SHAPE,
    LINEAR,
    NON_NEGATIVE,
    SHAPE,
    STEEPEST,
    shape_coordinates,
    shape_parameters,
)
from mrwarp.identify.projection import FEW, Point, Progress, Structure, search
from mrwarp.identify.replay import Replay
from mrwarp.params import BoucWenParams, MrParams
from mrwarp.recording.load import Holding, Recording

PARAMETERS = (*LINEAR, *SHAPE)
"""What is fitted of eqs. 14 and 15."""


class BoucWenStructure(Structure):
    """Eqs. 14 and 15. Shape: log(1 + alpha*v), log(beta + gamma), log(beta - gamma), with v a typical speed.

    ``beta > |gamma|`` is the condition under which the hysteresis dissipates on any path.
    """

    shape = SHAPE
    linear = LINEAR
    non_negative = NON_NEGATIVE

    def __init__(self, samples: Dataset, q_zero: float = 0.0) -> None:
        self.speed = float(np.percentile(np.abs(samples.qd), 95)) or 1.0
        self.q_zero = q_zero
        self.low, self.high = np.array(LEAST_SHAPE), np.array(STEEPEST)
        self.grid = (np.array([0.0, 0.4, 1.0, 2.0]), np.linspace(-1, 6, 8), np.linspace(-1, 6, 8))

    def loop(self, theta: np.ndarray) -> dict[str, float]:
        """alpha, beta, gamma of a shape."""
        return shape_parameters(theta, self.speed)

    def elements(self, theta: np.ndarray) -> list[dict[str, float]]:
        """One hysteresis element of unit gain."""
        return [{"K0": 1.0, **self.loop(theta)}]

    def columns(self, samples: Dataset, elements: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """1, qd, q_c, I, z/(1 + alpha*|qd|) and I times that."""
        h, current = elements[0].astype(float), samples.current
        return np.column_stack([np.ones(len(h)), samples.qd, samples.q - self.q_zero, current, h, h * current])


@dataclass(frozen=True, kw_only=True)
class FitResult:
    """A fitted joint, in the units of the recording."""

    estimates: dict[str, Estimate]
    """Each parameter of eqs. 14, 15 and, from holding data, 18."""
    combinations: dict[str, Estimate]
    """Combinations that the data determine better than the parameters themselves."""
    fixed: dict[str, float]
    """Parameters that were given: q_offset, q_center, z_max, coil_time_constant."""
    rmse: float
    """Root mean square of simulated minus measured torque."""
    nrmse: float
    """rmse over the standard deviation of the measured torque, pooled."""
    rmse_per_trajectory: dict[str, float]
    rmse_per_current: dict[str, float]
    simulated: tuple[np.ndarray, ...]
    """Simulated torque of each trajectory."""
    warnings: tuple[str, ...]
    units: dict[str, str]
    source: str
    samples: int
    trajectories: int
    rate: float
    """Sampling rate [1/s], median."""
    condition: float
    seed: int

    @property
    def values(self) -> dict[str, float]:
        """All parameters of eq. 14 and 15 (and 18), fitted and given."""
        return {**self.fixed, **{name: e.value for name, e in self.estimates.items()}}

    @property
    def params(self) -> MrParams:
        """The joint with everything else at its default; only for joints in rad and N·m.

        Raises:
            ParameterError: a value is outside the range of ``mrwarp.params``.
        """
        return MrParams().replace(**self.values)


def fit(
    recording: Recording,
    *,
    holding: Holding | None = None,
    start: MrParams | None = None,
    robust: bool = False,
    exact: bool = True,
    substeps: int = 2,
    seed: int = 0,
    progress: Progress | None = None,
) -> FitResult:
    """Identify a joint.

    Args:
        recording: Measured runs.
        holding: Break-away torques, for eq. 18.
        start: Where the search starts, besides its own grid; also gives q_offset, q_center and the coil's time
            constant, which are never fitted. None: no offset, no lag.
        robust: Weigh down samples far off (Huber), for recordings with outliers.
        exact: As in :class:`mrwarp.identify.replay.Replay`.
        substeps: As there.
        seed: Seed of the samples on which the starts are searched.
        progress: Called with what is being done.

    Raises:
        RecordingError: too few break-away torques for eq. 18; before the work.
    """
    log = progress or (lambda text: None)
    at_rest = {} if holding is None else fit_holding(holding.current, holding.torque)
    scales = Scales.of(recording)
    fixed = _fixed(start)
    replay = _with_coil(
        Replay(Dataset.of(recording, scales), exact=exact, substeps=substeps), fixed["coil_time_constant"]
    )
    samples = replay.samples
    structure = BoucWenStructure(samples, (fixed["q_offset"] + fixed["q_center"]) / scales.q)
    given = () if start is None else (_shape_of(start, structure, scales),)
    point, warnings = search(structure, replay, starts=given, robust=robust, seed=seed, log=log)

    log("intervals")
    names = structure.linear + structure.shape
    top = 1.0 if not samples.current.any() else float(np.abs(samples.current).max())
    assessment = assess(point, lambda x: _named(structure, scales, x, top), len(names), names)
    parameters = {name: assessment.estimates[name] for name in PARAMETERS} | at_rest
    combinations = {name: e for name, e in assessment.estimates.items() if name not in PARAMETERS}
    warnings += _notes(recording, point, structure, assessment.together)
    tau = point.simulated * scales.torque
    return FitResult(
        estimates=parameters,
        combinations=combinations,
        fixed=fixed,
        warnings=tuple(warnings),
        condition=assessment.condition,
        seed=seed,
        **summary(recording, [tau[part] for part in samples.parts]),
    )


def summary(recording: Recording, simulated: list[np.ndarray]) -> dict:
    """The figures of a fit that follow from its simulated torque."""
    runs = recording.trajectories
    errors = [sim - run.torque for sim, run in zip(simulated, runs, strict=True)]
    groups: dict[str, list[np.ndarray]] = {}
    for run, error in zip(runs, errors, strict=True):
        constant = np.ptp(run.current) <= 0.02 * max(1e-9, float(np.abs(run.current).max()))
        groups.setdefault(f"{np.median(run.current):.3g}" if constant else "varying", []).append(error)
    rmse = rms(np.concatenate(errors))
    return {
        "rmse": rmse,
        "nrmse": rmse / (float(np.concatenate([run.torque for run in runs]).std()) or 1.0),
        "rmse_per_trajectory": {run.id: rms(e) for run, e in zip(runs, errors, strict=True)},
        "rmse_per_current": {key: rms(np.concatenate(groups[key])) for key in sorted(groups)},
        "simulated": tuple(simulated),
        "units": dict(recording.units),
        "source": str(recording.source or "in memory"),
        "samples": sum(len(run.t) for run in runs),
        "trajectories": len(runs),
        "rate": float(np.median([1.0 / run.dt for run in runs])),
    }


def _fixed(start: MrParams | None) -> dict[str, float]:
    """What is given and not fitted."""
    z_max = BoucWenParams().z_max
    if start is None:
        return {"q_offset": 0.0, "q_center": 0.0, "z_max": z_max, "coil_time_constant": 0.0}
    bw = start.bouc_wen
    lag = start.coil.coil_time_constant
    return {"q_offset": bw.q_offset, "q_center": bw.q_center, "z_max": bw.z_max, "coil_time_constant": lag}


def _with_coil(replay: Replay, time_constant: float) -> Replay:
    """The replay with the current that flows instead of the command."""
    if time_constant == 0.0:
        return replay
    current = replay.torque([{"I1": 1.0, "coil_time_constant": time_constant}])[0].astype(float)
    samples = dataclasses.replace(replay.samples, current=current)
    return Replay(samples, exact=replay.exact, substeps=replay.substeps)


def _shape_of(start: MrParams, structure: BoucWenStructure, scales: Scales) -> np.ndarray:
    """Shape parameters of a given joint."""
    alpha, beta, gamma = (getattr(start.bouc_wen, name) / scales.factor(name) for name in SHAPE)
    return shape_coordinates(alpha, beta, gamma, structure.speed)


def _named(structure: BoucWenStructure, scales: Scales, x: np.ndarray, top: float) -> dict[str, float]:
    """Parameters in outer units, then the combinations that are better known; ``top`` is the largest inner current."""
    inner = dict(zip(structure.linear, x, strict=False)) | structure.loop(x[len(structure.linear) :])
    p = {name: value * scales.factor(name) for name, value in inner.items()}
    rate, high = p["beta"] + p["gamma"], top * scales.current
    gain = p["K0"] + p["K1"] * high
    return p | {
        "loading rate beta+gamma": rate,
        "unloading rate beta-gamma": p["beta"] - p["gamma"],
        "saturation torque K0/(beta+gamma) at 0": p["K0"] / rate,
        f"saturation torque (K0+K1*I)/(beta+gamma) at {high:.3g}": gain / rate,
        f"initial stiffness K0+K1*I at {high:.3g}": gain,
        f"bias D+I1*I at {high:.3g}": p["D"] + p["I1"] * high,
    }


def _notes(
    recording: Recording, point: Point, structure: BoucWenStructure, together: list[tuple[str, ...]]
) -> list[str]:
    """Warnings about what the data cannot say."""
    notes = []
    levels = np.unique(np.round(np.concatenate([run.current for run in recording.trajectories]), 3))
    if len(levels) == 1:
        notes.append(f"the current is {levels[0]:g} throughout: I1 and K1 cannot be told from D and K0")
    notes += [f"cannot be told apart: {', '.join(group)}; trust their combinations only" for group in together]
    for name, x, low, high in zip(structure.shape, point.theta, structure.low, structure.high, strict=True):
        if x <= low or x >= high:
            notes.append(f"the search for {name} ended at its bound: its interval is not reliable")
    stuck = [name for name, free in zip(structure.linear, point.free, strict=True) if not free]
    if stuck and len(levels) > 1:
        notes.append(f"{', '.join(stuck)} ended at 0, the edge of the allowed range")
    if len(recording.trajectories) < FEW:
        notes.append(
            f"only {len(recording.trajectories)} trajectories: intervals leave out errors that last a whole trajectory"
        )
    if any(run.qd_derived for run in recording.trajectories):
        notes.append("the velocity was derived from q by zero-phase differentiation")
    return notes
