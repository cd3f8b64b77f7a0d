"""What the simulation of a robot gets wrong, and where: from a log to named causes, as docs/robot_logs.md has it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from mrwarp.diagnose.result import Error, Suspect, Value
from mrwarp.robot_logs.causes import SESSION, Parameter, parameters_of
from mrwarp.robot_logs.evidence import Evidence, gather
from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.robot_log import LogError, RobotLog
from mrwarp.robot_logs.robot_verdict import NamedCause, RobotDiagnosis, sentence_of
from mrwarp.robot_logs.selection import Direction, Found, Posterior, healthy, posterior, select
from mrwarp.robot_logs.unknowable import cannot_know, next_experiment
from mrwarp.robot_logs.window_replay import Hypotheses, Replay, mismatch, nuisances
from mrwarp.robot_logs.windows import Windows, cut_windows

BUDGETS = (20.0, 20.0, 60.0)
"""Parts of a log that the rounds look at [s]: each begins at the robot that the one before found."""

FOLDS = 8
"""Pieces of the log that are predicted from the others."""

LEAST_WINDOWS = 8
"""Fewest windows that carry a verdict."""


def robot_of(log: RobotLog, robot: str | None) -> Path:
    """The robot's description: as given, or the file beside the log that the log names.

    Raises:
        LogError: neither is there.
    """
    if robot is not None:
        return Path(robot)
    beside = log.path / log.robot
    if not beside.is_file():
        raise LogError(f"{log.path}: its robot, {log.robot}, does not lie beside it; name the description with --robot")
    return beside


def diagnose_log(robot: Path, log: RobotLog, *, progress: Callable[[str], None] = lambda _: None) -> RobotDiagnosis:
    """Diagnose a log against a robot's description.

    Raises:
        LogError: robot and log do not fit.
    """
    begun = time.perf_counter()
    progress(f"reading {robot}")
    model = replay_model(robot, log)
    parameters = parameters_of(model, log)
    theta = np.zeros(len(parameters))
    lowest = np.array([max(p.lowest, -0.95) if p.relative else p.lowest for p in parameters])
    for round_, seconds in enumerate(BUDGETS):
        groups = cut_windows(model, log, budget=seconds)
        if sum(group.count for group in groups) < LEAST_WINDOWS:
            raise LogError(
                f"{log.path}: too short: {sum(group.count for group in groups)} pieces of "
                f"{groups[0].t[0, -1] if groups else 0.5:.1f} s, {LEAST_WINDOWS} are needed; record longer"
            )
        evidence = gather(model, groups, parameters, theta, healthy(parameters), progress)
        # the numbers that no description knows are moved first; what stands out of the rest is asked at the end
        if round_ < len(BUDGETS) - 1:
            theta = np.maximum(posterior(evidence, parameters, []).mean, lowest)
    progress("causes that stand out")
    found = select(evidence, parameters)
    released = [f.direction for f in found]
    now = posterior(evidence, parameters, released)
    causes = tuple(_named(f, found, evidence, parameters, now) for f in found)
    extended = np.zeros(len(parameters))
    for cause in causes:
        for k, change in cause.change.items():
            extended[k] = max(change, parameters[k].lowest)
    progress("before and after")
    gain, before, after = _held_out(evidence, parameters, found)
    suspects: tuple[Suspect, ...] = ()
    if causes and gain["ci95"][0] <= 0.0:
        # what does not foretell the rest of the log is no cause, however sure its interval looks
        reason = "pieces of the log that took no part are not predicted better with it"
        suspects = tuple(Suspect(name=c.name, reason=f"at {c.where}: {reason}", parameters=c.parameters, gain=c.gain)
                         for c in causes)  # fmt: skip
        causes, extended, after = (), np.zeros(len(parameters)), before
    per_joint, per_channel = _errors(model, groups, parameters, now, extended)
    verdict = "named" if causes else "none"
    session = {p.where: float(now.mean[k]) for k, p in enumerate(parameters) if p.field == "shift"}
    notes = [*getattr(log, "notes", ())]
    late = next(k for k, p in enumerate(parameters) if p.cause == "command_delay")
    if not any(c.name == "command_delay" for c in causes) and abs(now.mean[late]) > parameters[late].least:
        row = parameters[late].usual[1]
        notes.append(
            f"commands act {1e3 * now.mean[late]:.1f} ms after their row: within a row of {1e3 * row:.1f} ms "
            "that is how the log was written"
        )
    if evidence.lost:
        notes.append(f"{evidence.lost} pieces of the log were left out: something else moved the robot there")
    unknown = cannot_know(evidence, parameters, model, log, now)
    return RobotDiagnosis(
        verdict=verdict,
        sentence=sentence_of(causes),
        causes=causes,
        suspects=suspects,
        cannot_know=unknown,
        next_experiment=next_experiment(causes, unknown),
        baseline=Error(rmse=before, nrmse=1.0, unit="healthy error"),
        extended=Error(rmse=after, nrmse=after / max(before, 1e-12), unit="healthy error"),
        gain=gain,
        per_joint=per_joint,
        per_channel=per_channel,
        session=session,
        notes=tuple(notes),
        parameters=tuple(parameters),
        theta=extended,
        model=model,
        log=log,
        windows=tuple(groups),
        seconds=time.perf_counter() - begun,
    )


def _named(f: Found, found: list[Found], evidence: Evidence, parameters: list[Parameter], now: Posterior) -> NamedCause:
    """A cause with its size: of a single number as the log has it, of a group the change that all share."""
    values: dict[str, Value] = {}
    change: dict[int, float] = {}
    first = parameters[f.direction.members[0]]
    others = [x.direction for x in found if x is not f]
    if len(f.direction.members) == 1:
        k = f.direction.members[0]
        mean, sd = _without_prior(k, now, evidence, parameters, [*others, f.direction])
    else:
        k = f.direction.members[0]
        mean, sd = now.mean[k], float(np.sqrt(now.covariance[k, k]))
    low, high = (first.absolute(mean + s * 1.96 * sd) for s in (-1.0, 1.0))
    values[first.name] = Value(value=first.absolute(mean), ci95=(low, high), unit=first.unit)
    if first.relative:
        values["factor"] = Value(value=1.0 + mean, ci95=(1.0 + mean - 1.96 * sd, 1.0 + mean + 1.96 * sd), unit="1")
    for k in f.direction.members:
        change[k] = float(now.mean[k]) if len(f.direction.members) > 1 else float(mean)
    full = _left(evidence, now.mean)
    without = posterior(evidence, parameters, others).mean.copy()
    without[list(f.direction.members)] = 0.0
    return NamedCause(
        name=f.direction.cause,
        where=f.direction.where,
        parameters=values,
        p_value=float(2.0 * stats.norm.sf(abs(f.z))),
        alternatives=tuple(dict.fromkeys(_place(d, f.direction.where) for d in f.alternatives)),
        gain=float(max(1.0 - full / max(_left(evidence, without), 1e-12), 0.0)),
        change=change,
    )


def _place(direction: Direction, here: str) -> str:
    return direction.cause if direction.where == here else f"{direction.cause} of {direction.where}"


def _without_prior(
    k: int, now: Posterior, evidence: Evidence, parameters: list[Parameter], released: list[Direction]
) -> tuple[float, float]:
    """Mean and standard deviation of one number by the log alone, the others as they are."""
    variance = now.covariance[k, k]
    known = max(1.0 / variance - now.precision[k, k], 1e-3 / variance)
    return float(now.mean[k] / variance / known), float(1.0 / np.sqrt(known))


def _left(evidence: Evidence, theta: np.ndarray) -> float:
    """Squared mismatch of all windows at ``theta``."""
    a, b = evidence.a.sum(axis=0), evidence.b.sum(axis=0)
    return float(evidence.c.sum() - 2.0 * b @ theta + theta @ a @ theta)


def _held_out(
    evidence: Evidence, parameters: list[Parameter], found: list[Found]
) -> tuple[dict[str, Any], float, float]:
    """Reduction of the error on pieces of the log that took no part, with its interval, and both errors [1]."""
    session = [k for k, p in enumerate(parameters) if p.cause == SESSION]
    named = sorted({k for f in found for k in f.direction.members})
    folds = np.array_split(np.arange(len(evidence.c)), FOLDS)
    rows = []
    for fold in folds:
        keep = np.setdiff1d(np.arange(len(evidence.c)), fold)
        a, b = evidence.a[keep].sum(axis=0) / evidence.scale, evidence.b[keep].sum(axis=0) / evidence.scale
        q = healthy(parameters)
        row = []
        for free in (session, sorted({*session, *named})):
            theta = np.zeros(len(parameters))
            at = np.ix_(free, free)
            weight = q[at].copy()
            for i, k in enumerate(free):
                if k in named:
                    weight[i, i] = 1.0 / max(parameters[k].fault, parameters[k].spread) ** 2
            if free:
                theta[free] = np.linalg.solve(a[at] + weight, b[free])
            own_a, own_b = evidence.a[fold].sum(axis=0), evidence.b[fold].sum(axis=0)
            row.append(max(evidence.c[fold].sum() - 2.0 * own_b @ theta + theta @ own_a @ theta, 1e-12))
        rows.append(row)
    errors = np.sqrt(np.array(rows))
    total = np.sqrt((errors**2).sum(axis=0) / max(evidence.samples, 1))
    each = 1.0 - errors[:, 1] / errors[:, 0]
    half = stats.t.ppf(0.975, FOLDS - 1) * each.std(ddof=1) / np.sqrt(FOLDS)
    value = float(1.0 - total[1] / total[0])
    gain = {"rmse_reduction": value, "ci95": (value - half, value + half), "held_out": tuple(range(FOLDS))}
    return gain, float(total[0]), float(total[1])


def _errors(
    model: ReplayModel, groups: list[Windows], parameters: list[Parameter], now: Posterior, extended: np.ndarray
) -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]]]:
    """RMSE before and after, both beside the session's offsets: of the angle by joint, and by channel."""
    session = np.array([p.cause == SESSION for p in parameters])
    both: list[dict[str, np.ndarray]] = []
    for theta in (np.where(session, now.mean, 0.0), np.where(session, now.mean, extended)):
        squares: dict[str, list[np.ndarray]] = {}
        for windows in groups:
            every = np.arange(windows.count)
            start = np.zeros((windows.count, len(nuisances(model))))
            changes = Hypotheses.of(parameters, np.tile(theta, (windows.count, 1)), model)
            for name, x in mismatch(windows.measured, Replay(model, windows).run(changes, every, start)).items():
                squares.setdefault(name, []).append(np.nan_to_num(x).reshape(-1, x.shape[-1]) ** 2)
        both.append({name: np.sqrt(np.concatenate(x).mean(axis=0)) for name, x in squares.items()})

    def pair(of: Callable[[dict[str, np.ndarray]], float]) -> dict[str, float]:
        return {"baseline": of(both[0]), "extended": of(both[1])}

    joints = {joint: pair(lambda x, j=j: float(x["q"][j])) for j, joint in enumerate(model.joints)}
    channels = {name: pair(lambda x, n=name: float(np.sqrt((x[n] ** 2).mean()))) for name in both[0]}
    return joints, channels
