"""Identification of eqs. 14 and 15 by simulation error through the simulator's kernels, and of eq. 18.

Nothing is to be tuned: scales, starts, bounds and steps follow from the recording.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from mrwarp.identify.checks.refusal_reason import missed
from mrwarp.identify.contradictions import refuse_contradictions, refuse_unexplained
from mrwarp.identify.dataset import Dataset, Scales, rms
from mrwarp.identify.intervals import Estimate, assess
from mrwarp.identify.parameters import (
    LEAST_SHAPE,
    LINEAR,
    NON_NEGATIVE,
    SHAPE,
    STEEPEST,
    shape_parameters,
)
from mrwarp.identify.projection import FEW, Point, Progress, Structure, held_out_ratio, search
from mrwarp.identify.replay import Replay
from mrwarp.model_file import Effect
from mrwarp.params import BoucWenParams, holding_curve
from mrwarp.recording.load import Holding, Recording, RecordingError, find_holding, load_holding
from mrwarp.recording.saturation import saturated
from mrwarp.sysid.settings import Gain

PARAMETERS = (*LINEAR, *SHAPE)
"""Fitted parameters of eqs. 14 and 15."""


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

    def elements(self, loop: Mapping[str, float]) -> list[dict[str, float]]:
        """One hysteresis element of unit gain."""
        return [{"K0": 1.0, **loop}]

    def columns(self, samples: Dataset, elements: np.ndarray) -> np.ndarray:
        """1, qd, q_c, I, z/(1 + alpha*|qd|) and I times that."""
        h, current = elements[0].astype(float), samples.current
        return np.column_stack([np.ones(len(h)), samples.qd, samples.q - self.q_zero, current, h, h * current])


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """How far a fitted model's torque is from the measured one, in the unit of the recording."""

    rmse: float
    """Root mean square of simulated minus measured torque."""
    nrmse: float
    """rmse over the standard deviation of the measured torque, pooled."""
    rmse_per_trajectory: dict[str, float]
    rmse_per_current: dict[str, float]
    simulated: tuple[np.ndarray, ...]
    """Simulated torque of each trajectory."""
    warnings: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class FitResult(Misfit):
    """A fitted joint, in the units of the recording."""

    estimates: dict[str, Estimate]
    """Each parameter of eqs. 14, 15 and, from holding data, 18."""
    combinations: dict[str, Estimate]
    """Combinations that the data determine better than the parameters themselves."""
    fixed: dict[str, float]
    """Parameters that are never fitted: q_offset, q_center and coil_time_constant are 0, z_max is the paper's."""
    units: dict[str, str]
    source: str
    samples: int
    trajectories: int
    rate: float
    """Sampling rate [1/s], median."""
    current: tuple[float, float]
    """Smallest and largest current, in size."""
    condition: float
    seed: int
    correlations: dict[str, dict[str, float]] = field(default_factory=dict)
    """Correlation of the errors of each pair of parameters with an interval [1]; empty where it was not assessed."""
    effects: tuple[Effect, ...] = ()
    """The law that takes the place of eq. 15, if one was asked for, and further effects."""
    offsets: dict[str, float] = field(default_factory=dict)
    """Torque by which the zero of each trajectory lies off D, where the zeros differ."""
    held_out: float | None = None
    """NRMSE of trajectories left out in turn; None where it was not asked for."""

    @property
    def values(self) -> dict[str, float]:
        """All parameters of eq. 14 and 15 (and 18), fitted and given."""
        return {**self.fixed, **{name: e.value for name, e in self.estimates.items()}}


def fit(
    recording: Recording,
    *,
    holding: Holding | None = None,
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
        robust: Weigh down samples far off (Huber), for recordings with outliers.
        exact: As in :class:`mrwarp.identify.replay.Replay`.
        substeps: As there.
        seed: Seed of the samples on which the starts are searched.
        progress: Called with what is being done.

    Raises:
        RecordingError: too few break-away torques for eq. 18, columns that contradict each other, or a model that
            explains next to nothing.
    """
    log = progress or (lambda text: None)
    refuse_contradictions(recording)
    at_rest = {} if holding is None else fit_holding(holding.current, holding.torque)
    scales = Scales.of(recording)
    samples = Dataset.of(recording, scales)
    structure = BoucWenStructure(samples)
    replay = Replay(samples, exact=exact, substeps=substeps)
    point, warnings = search(structure, replay, robust=robust, seed=seed, log=log)

    log("intervals")
    names = structure.linear + structure.shape
    top = 1.0 if not samples.current.any() else float(np.abs(samples.current).max())
    assessment = assess(point, lambda x: _named(structure, scales, x, top), len(names), names)
    warnings += _notes(recording, point, structure, assessment.together)
    runs = recording.trajectories
    nrmse = missed(point.simulated - samples.torque, samples.torque, samples.counts)
    ratio = held_out_ratio(structure, point, len(runs))
    held_out = nrmse * ratio
    refuse_unexplained(recording, samples, nrmse, held_out)
    return FitResult(
        estimates={name: assessment.estimates[name] for name in PARAMETERS} | at_rest,
        combinations={name: e for name, e in assessment.estimates.items() if name not in PARAMETERS},
        fixed={"q_offset": 0.0, "q_center": 0.0, "z_max": BoucWenParams().z_max, "coil_time_constant": 0.0},
        units=dict(recording.units),
        source=str(recording.source or "in memory"),
        samples=len(samples.q),
        trajectories=len(runs),
        rate=float(np.median([1.0 / run.dt for run in runs])),
        current=recording.current_range,
        condition=assessment.condition,
        correlations=assessment.correlations,
        seed=seed,
        held_out=held_out if len(runs) > 1 else None,
        **misfit(recording, point.simulated, samples, warnings),
    )


def misfit(recording: Recording, simulated: np.ndarray, samples: Dataset, warnings: list[str]) -> dict[str, Any]:
    """The fields of :class:`Misfit` of a simulated torque in normalised units, shape (N,)."""
    runs, tau = recording.trajectories, simulated * samples.scales.torque
    torques = [tau[part] for part in samples.parts]
    errors = [(sim - run.torque)[run.known] for sim, run in zip(torques, runs, strict=True)]
    groups: dict[str, list[np.ndarray]] = {}
    for run, error in zip(runs, errors, strict=True):
        constant = np.ptp(run.current) <= Gain.unchanging * max(1e-9, float(np.abs(run.current).max()))
        groups.setdefault(f"{np.median(run.current):.3g}" if constant else "varying", []).append(error)
    rmse = rms(np.concatenate(errors))
    return {
        "rmse": rmse,
        "nrmse": rmse / (float(np.concatenate([run.torque[run.known] for run in runs]).std()) or 1.0),
        "rmse_per_trajectory": {run.id: rms(e) for run, e in zip(runs, errors, strict=True)},
        "rmse_per_current": {key: rms(np.concatenate(groups[key])) for key in sorted(groups)},
        "simulated": tuple(torques),
        "warnings": (*warnings, *filter(None, [saturated(recording)])),
    }


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
    top = recording.current_range[1] or 1.0
    levels = np.unique(np.round(np.concatenate([run.current for run in recording.trajectories]) / top, 3)) * top
    if len(levels) == 1:
        notes.append(f"the current is {levels[0]:g} throughout: I1 and K1 cannot be distinguished from D and K0")
    notes += [f"cannot be distinguished: {', '.join(group)}; trust their combinations only" for group in together]
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
    return notes + made_motion(recording)


def made_motion(recording: Recording) -> list[str]:
    """Parts of the motion that were not measured."""
    runs, notes = recording.trajectories, []
    if any(run.qd_derived for run in runs):
        notes.append("the velocity was derived from q by zero-phase differentiation")
    if any(run.q_integrated for run in runs):
        notes.append("the angle was integrated from qd: D, C and what depends on the place are not to be trusted")
    return notes


def read_holding(data: Path, recording: Recording, file: Path | None, log: Progress) -> Holding | None:
    """Break-away torques: those of ``file``, else those next to the data if they can be used.

    Raises:
        RecordingError: the torques do not fit the recording, or those of ``file`` are too few.
    """
    found = file or find_holding(data)
    if found is None:
        return None
    holding = load_holding(found, recording)
    try:
        fit_holding(holding.current, holding.torque)
    except RecordingError as error:
        if file is None:
            log(f"note: no eq. 18: {found} is not used: {error}")
            return None
        raise RecordingError(f"{found}: {error}") from None
    log(f"note: eq. 18: break-away torques of {found}")
    return holding


def fit_holding(current: np.ndarray, torque: np.ndarray) -> dict[str, Estimate]:
    """Fit ``T_max*I^n/(K^n + I^n)`` to break-away torques by least squares in log(K), log(n) and T_max.

    Args:
        current: Current of each test [A], shape (N,).
        torque: Torque at which the joint gave way [N·m], shape (N,).

    Raises:
        RecordingError: fewer than five tests, or fewer than three levels of current above 0.
    """
    current, torque = np.abs(np.asarray(current, dtype=float)), np.abs(np.asarray(torque, dtype=float))
    levels = len(np.unique(np.round(current[current > 0] / current.max(initial=0.0), 4)))
    if len(current) < 5 or levels < 3:
        raise RecordingError(
            f"{len(current)} break-away tests at {levels} currents above 0; eq. 18 needs 5 tests at 3 currents"
        )
    scale, low, high = float(np.median(current[current > 0])), [-4.0, np.log(0.1)], [4.0, np.log(20.0)]

    def mismatch_of(x: np.ndarray) -> np.ndarray:
        return x[0] * holding_curve(current, 1.0, scale * np.exp(x[1]), np.exp(x[2])) - torque

    def derivatives(x: np.ndarray) -> np.ndarray:
        """By T_max, log(K) and log(n), shape (N, 3)."""
        unit = holding_curve(current, 1.0, scale * np.exp(x[1]), np.exp(x[2]))
        bend = x[0] * np.exp(x[2]) * unit * (1.0 - unit)
        logarithm = np.log(np.where(current > 0.0, current, 1.0) / scale) - x[1]
        return np.column_stack([unit, -bend, bend * logarithm])

    starts = []
    for k, n in itertools.product(np.linspace(-2, 2, 21), np.log(np.linspace(0.5, 8, 20))):
        unit = holding_curve(current, 1.0, scale * np.exp(k), np.exp(n))
        starts.append(np.array([unit @ torque / (unit @ unit), k, n]))
    found = least_squares(
        mismatch_of,
        min(starts, key=lambda x: float((mismatch_of(x) ** 2).sum())),
        jac=derivatives,  # pyright: ignore[reportArgumentType]
        bounds=([-np.inf, *low], [np.inf, *high]),
        x_scale="jac",
        ftol=1e-15,
        xtol=1e-12,
        gtol=1e-15,
    )
    (best, *x), table, mismatch = found.x, found.jac, found.fun
    inverse = np.linalg.pinv(table.T @ table)
    # each test left out once (HC3): the scatter of break-away torques grows with the torque
    leverage = np.einsum("ij,jk,ik->i", table, inverse, table)
    meat = table.T @ (table * (mismatch / np.maximum(1.0 - leverage, 1e-6))[:, None] ** 2)
    sigma = np.sqrt(np.diag(inverse @ meat @ inverse))
    values = {"T_max": float(best), "K": scale * float(np.exp(x[0])), "n": float(np.exp(x[1]))}
    slopes = (1.0, values["K"], values["n"])
    dof = len(current) - 3
    wide, wider = stats.t.ppf((0.975, 1 - 0.025 / 3), dof)
    return {
        name: Estimate(value=value, half=float(wide * s * slope), half_joint=float(wider * s * slope))
        for (name, value), s, slope in zip(values.items(), sigma, slopes, strict=True)
    }
