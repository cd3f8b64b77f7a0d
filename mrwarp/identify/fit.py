"""Identification of eqs. 14 and 15 by simulation error through the simulator's kernels, and of eq. 18.

Nothing is to be tuned: scales, starts, bounds and steps follow from the recording.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from mrwarp.identify.checks.limits import Limits, least_size
from mrwarp.identify.checks.refusal_reason import followed_instead, missed
from mrwarp.identify.contradictions import refuse_contradictions, refuse_unexplained
from mrwarp.identify.dataset import Dataset, Motion, Scales, rms
from mrwarp.identify.intervals import Estimate, assess
from mrwarp.identify.parameters import (
    LEAST_SHAPE,
    LINEAR,
    NON_NEGATIVE,
    SHAPE,
    STEEPEST,
    shape_parameters,
)
from mrwarp.identify.projection import FEW, NextTo, Point, Progress, Projection, Structure, held_out_ratio, search
from mrwarp.identify.replay import Replay
from mrwarp.model_file import Effect
from mrwarp.params import BoucWenParams, holding_curve
from mrwarp.recording.data import quantity, with_unit
from mrwarp.recording.load import Holding, Recording, RecordingError, find_holding, load_holding
from mrwarp.recording.saturation import saturated
from mrwarp.sysid.settings import Gain, Rest

_INERTIA, _WEIGHT = ("an inertia", "inertia"), ("a weight", "sine", "cosine")
"""Bodies that may be missed: the name of each, and those of its linear numbers."""
PARAMETERS = (*LINEAR, *SHAPE)
"""Fitted parameters of eqs. 14 and 15."""


class BoucWenStructure(Structure):
    """Eqs. 14 and 15. Shape: log(1 + alpha*v), log(beta + gamma), log(beta - gamma), with v a typical speed.

    ``beta > |gamma|`` is the condition under which the hysteresis dissipates on any path. Where beta or gamma has
    ``limits`` (normalised, both ends), the last two are log(beta) and artanh(gamma/beta) instead.
    """

    shape = SHAPE
    linear = LINEAR
    non_negative = NON_NEGATIVE

    def __init__(
        self, samples: Dataset, q_zero: float = 0.0, limits: Mapping[str, tuple[float, float]] | None = None
    ) -> None:
        self.speed = float(np.percentile(np.abs(samples.qd), 95)) or 1.0
        self.q_zero, self.limits = q_zero, limits or {}
        self.low, self.high = np.array(LEAST_SHAPE), np.array(STEEPEST)
        grid = [np.array([0.0, 0.4, 1.0, 2.0]), np.linspace(-1, 6, 8), np.linspace(-1, 6, 8)]
        ends = {0: np.log1p(np.maximum(self.limits.get("alpha", (0.0, np.inf)), 0.0) * self.speed)}
        self.by_rates = not {"beta", "gamma"} & {*self.limits}
        if not self.by_rates:
            narrowest = 0.5 * (self.high[2] - self.low[2])  # half the difference of the logarithms of the rates
            least = least_size(self.gamma_ends) / np.tanh(narrowest)
            beta = np.maximum(self.limits.get("beta", (0.0, np.inf)), max(least, 1e-12))
            one = (0.0, 0.0) if self.gamma_ends[0] == self.gamma_ends[1] else (-narrowest, narrowest)
            self.low[2], self.high[2], grid[2] = *one, np.linspace(-1.5, 1.5, 5)
            ends |= {1: np.log(beta)}
        for i, (low, high) in ends.items():
            self.low[i] = low if low > self.high[i] else max(low, self.low[i])
            self.high[i] = high if high < self.low[i] else max(min(high, self.high[i]), self.low[i])
        inside = zip(grid, self.low, self.high, strict=True)
        self.grid = tuple(np.unique(np.clip(axis, low, high)) for axis, low, high in inside)

    @property
    def gamma_ends(self) -> tuple[float, float]:
        """Limits of gamma."""
        return self.limits.get("gamma", (-np.inf, np.inf))

    def linear_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of the linear parameters, within their limits."""
        low, high = super().linear_bounds()
        for i, name in enumerate(self.linear):
            if name in self.limits:
                low[i], high[i] = max(low[i], self.limits[name][0]), self.limits[name][1]
        return low, high

    def loop(self, theta: np.ndarray) -> dict[str, float]:
        """alpha, beta, gamma of a shape."""
        if self.by_rates:
            return shape_parameters(theta, self.speed)
        beta = float(np.exp(theta[1]))
        gamma = float(np.clip(beta * np.tanh(theta[2]), *self.gamma_ends))
        return {"alpha": float(np.expm1(theta[0])) / self.speed, "beta": beta, "gamma": gamma}

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
    given: dict[str, float] = field(default_factory=dict)
    """Numbers that were given (``--fix``), not fitted."""

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
    limits: Limits | None = None,
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
        limits: Numbers of eqs. 14 and 15 that are given or bounded.

    Raises:
        ValueError: ``limits`` name what eqs. 14 and 15 do not have.
        RecordingError: too few break-away torques for eq. 18, columns that contradict each other, or a model that
            explains next to nothing.
    """
    log, limits = progress or (lambda text: None), limits or Limits()
    limits.check(PARAMETERS)
    refuse_contradictions(recording)
    at_rest = {} if holding is None else fit_holding(holding.current, holding.torque)
    scales = Scales.of(recording)
    samples = Dataset.of(recording, scales)
    inner = {name: (low / scales.factor(name), high / scales.factor(name)) for name, (low, high) in limits.ends.items()}
    structure = BoucWenStructure(samples, limits=inner)
    replay = Replay(samples, exact=exact, substeps=substeps)
    point, warnings = search(structure, replay, robust=robust, seed=seed, log=log)

    log("intervals")
    names = structure.linear + structure.shape
    top = 1.0 if not samples.current.any() else float(np.abs(samples.current).max())
    searched = structure.low < structure.high
    assessment = assess(point, lambda x: _named(structure, scales, x, top), len(names), names, searched)
    warnings += _notes(recording, point, structure, assessment.together)
    stiffness = assessment.estimates["C"]
    detail = Gain.detail * float(samples.torque.std()) * scales.torque
    pushes = 0.5 * float(np.ptp(samples.q)) * scales.q * stiffness.value < -detail
    if stiffness.ci95 and stiffness.ci95[1] < 0.0 and pushes and "C" not in limits.ends:
        warnings.append(
            "C is below 0, as no spring is: it stands for what eq. 14 lacks, such as an inertia; run 'mrwarp diagnose "
            "joint'"
        )
    runs = recording.trajectories
    nrmse = missed(point.simulated - samples.torque, samples.torque, samples.counts)
    ratio = held_out_ratio(structure, point, len(runs))
    refuse_unexplained(recording, samples, nrmse, nrmse * ratio)
    figures = misfit(recording, point.simulated, samples, warnings)
    if figures["nrmse"] > Rest.unreported:
        figures["warnings"] += (_missed_text(figures["nrmse"], recording, structure, replay, point),)
    return FitResult(
        estimates={name: assessment.estimates[name] for name in PARAMETERS if name not in limits.given} | at_rest,
        combinations={name: e for name, e in assessment.estimates.items() if _combines(name) - {*limits.given}},
        fixed={"q_offset": 0.0, "q_center": 0.0, "z_max": BoucWenParams().z_max, "coil_time_constant": 0.0}
        | limits.given,
        given=limits.given,
        condition=assessment.condition,
        correlations=assessment.correlations,
        seed=seed,
        held_out=figures["nrmse"] * ratio if len(runs) > 1 else None,
        **origin(recording),
        **figures,
    )


def origin(recording: Recording) -> dict[str, Any]:
    """The fields of :class:`FitResult` that say what was fitted."""
    runs = recording.trajectories
    return {
        "units": dict(recording.units),
        "source": str(recording.source or "in memory"),
        "samples": sum(len(run.q) for run in runs),
        "trajectories": len(runs),
        "rate": float(np.median([1.0 / run.dt for run in runs])),
        "current": recording.current_range,
    }


def misfit(recording: Recording, simulated: np.ndarray, samples: Dataset, warnings: list[str]) -> dict[str, Any]:
    """The fields of :class:`Misfit` of a simulated torque in normalised units, shape (N,)."""
    runs, tau = recording.trajectories, simulated * samples.scales.torque
    torques = [tau[part] for part in samples.parts]
    errors = [(sim - run.torque)[run.known] for sim, run in zip(torques, runs, strict=True)]
    groups: dict[str, list[np.ndarray]] = {}
    for run, error in zip(runs, errors, strict=True):
        constant = np.ptp(run.current) <= Gain.share * max(1e-9, float(np.abs(run.current).max()))
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


def _missed_text(nrmse: float, recording: Recording, structure: Structure, replay: Replay, point: Point) -> str:
    """Warning of a large error, with what it follows as far as plain means show that."""
    samples, units = replay.samples, recording.units
    follows = (
        _bodies_missed(structure, replay, point, Motion.of(recording, samples.scales), units)
        or followed_instead(samples, units, left=samples.torque - point.simulated)
        or "'mrwarp diagnose joint' looks for the reason"
    )
    return f"{100.0 * nrmse:.0f} % of the {quantity('torque', units)} is missed (NRMSE): {follows}"


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


def _combines(name: str) -> set[str]:
    """Parameters of a combination by its name; none of a parameter's own name."""
    return {*re.findall(r"[A-Za-z]+\d?", name)} & {*PARAMETERS} if name not in PARAMETERS else set()


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
        if low < high and (x <= low != 0.0 or x >= high):  # alpha may be 0
            notes.append(f"the search for {name} ended at its bound: its interval is not reliable")
    ends = [structure.limits.get(name, (0.0, 1.0)) for name in structure.linear]
    stuck = [
        (name, value)
        for name, value, free, (low, high) in zip(structure.linear, point.linear, point.free, ends, strict=True)
        if not free and low < high
    ]
    zero, other = [name for name, value in stuck if not value], [name for name, value in stuck if value]
    if zero and len(levels) > 1:
        notes.append(f"{', '.join(zero)} ended at 0, the edge of the allowed range")
    gamma = structure.loop(point.theta)["gamma"]
    if structure.limits and structure.gamma_ends[0] < structure.gamma_ends[1] and gamma in structure.gamma_ends:
        other.append("gamma")
    if other:
        notes.append(f"{', '.join(other)} ended at a bound of --bound")
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


def _bodies_missed(structure: Structure, replay: Replay, point: Point, motion: Motion, units: Mapping[str, str]) -> str:
    """Text on the error of a fit with an inertia, a weight, or both next to it; empty if that is over half as large.

    Args:
        structure: What was fitted.
        replay: The samples.
        point: Where the fit ended.
        motion: The samples with their acceleration.
        units: Units of the recording.
    """
    samples, scales = replay.samples, replay.samples.scales
    columns = {"inertia": motion.qdd}
    parts = [(_INERTIA,)]
    if units["q"] == "rad":
        angle = samples.q * scales.q
        columns |= {"sine": np.sin(angle), "cosine": np.cos(angle)}
        parts += [(_WEIGHT,), (_INERTIA, _WEIGHT)]
    weight = samples.settled(structure.slowest(point.theta))
    before, best = Projection(structure, replay, weight).evaluate(point.theta).sse, np.inf
    found: dict[str, float] = {}
    for part in parts:
        names = [name for _, *own in part for name in own]
        fitted = Projection(NextTo(structure, {name: columns[name] for name in names}, _INERTIA), replay, weight)
        there = fitted.descend(point.theta)
        if there.sse < Gain.half * best:  # two have to be worth it
            best, found = there.sse, dict(zip(names, there.linear[len(structure.linear) :], strict=True))
    if not found or best > Gain.half**2 * before:
        return ""
    share = 100.0 * float(np.sqrt(best / max(float(weight.sum()), 1.0))) / (float(samples.torque.std()) or 1.0)
    unit = "kg·m²" if (units["q"], units["torque"]) == ("rad", "N·m") else f"{units['torque']}·s²/{units['q']}"
    said = []
    if "inertia" in found:
        size = found["inertia"] * scales.torque / scales.q
        said.append(f"{_INERTIA[0]} of {with_unit(f'{size:.3g}', unit)}")
    if "sine" in found:
        size = float(np.hypot(found["sine"], found["cosine"])) * scales.torque
        said.append(f"{_WEIGHT[0]} of {with_unit(f'{size:.3g}', units['torque'])}")
    return (
        f"with {' and '.join(said)} next to eq. 14 the fit would miss {share:.0f} %; 'mrwarp diagnose joint' looks for "
        "what is missing, and puts it into the model"
    )
