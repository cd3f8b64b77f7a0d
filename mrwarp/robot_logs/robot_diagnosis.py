"""What the simulation of a robot gets wrong, and where: from a log to named causes, as docs/robot_logs.md has it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from mrwarp.diagnose.result import Error, Suspect, Value
from mrwarp.robot_logs.causes import ORDINARY, SESSION, Parameter, parameters_of
from mrwarp.robot_logs.evidence import Evidence, fit, gather, replayed, within
from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.robot_log import LogError, RobotLog
from mrwarp.robot_logs.robot_verdict import NamedCause, RobotDiagnosis, sentence_of
from mrwarp.robot_logs.selection import (
    DRIVE,
    LEAST_SHARE,
    NAMED_ODDS,
    Direction,
    Found,
    Posterior,
    bounds_of,
    directions_of,
    estimate,
    healthy,
    posterior,
    prior_of,
    select,
)
from mrwarp.robot_logs.unknowable import cannot_know, next_experiment
from mrwarp.robot_logs.window_replay import Hypotheses, Replay, mismatch, nuisances
from mrwarp.robot_logs.windows import Windows, cut_windows

FIT_SECONDS, SECONDS = 10.0, 60.0
"""Parts of a log by which the robot is fitted step by step, and from which causes are told [s]."""

ROUNDS = 4
"""Times that what stands out is released and the robot fitted anew."""

FOLDS = 8
"""Pieces of the log that are predicted from the others."""

FORETOLD, NEARLY_ALL = 4.0, 0.85
"""Least gain of a cause on the pieces that took no part, as Wilcoxon's standard score over windows: one chance in a
hundred over 200 causes and places. Few windows cannot reach it: there, this share of the score that they can reach."""

NOT_FORETOLD = "pieces of the log that took no part are not clearly predicted better with it"

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
    groups = cut_windows(model, log, budget=SECONDS)
    if (count := sum(group.count for group in groups)) < LEAST_WINDOWS:
        raise LogError(
            f"{log.path}: too short: {count} pieces of {groups[0].t[0, -1] if groups else 0.5:.1f} s, "
            f"{LEAST_WINDOWS} are needed; record longer"
        )
    theta, confirmed = _fitted(model, log, parameters, progress)
    evidence = gather(model, groups, parameters, theta, healthy(parameters), progress)
    progress("causes that stand out")
    found, doubtful = _foretelling(select(evidence, parameters, confirmed), evidence, parameters)
    now = posterior(evidence, parameters, [f.direction for f in found])
    causes = tuple(_named(f, found, evidence, parameters, now) for f in found)
    extended = np.zeros(len(parameters))
    for cause in causes:
        for k, change in cause.change.items():
            extended[k] = max(change, parameters[k].lowest)
    progress("before and after")
    gain, before, after = _held_out(evidence, parameters, found)
    beside = posterior(evidence, parameters, [*(f.direction for f in found), *(f.direction for f in doubtful)])
    suspects = tuple(
        Suspect(name=c.name, reason=f"at {c.where}: {NOT_FORETOLD}", parameters=c.parameters, gain=c.gain)
        for c in (_named(f, [*found, *doubtful], evidence, parameters, beside) for f in doubtful)
    )
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
        notes.append(
            f"{evidence.lost} pieces of the log were left out: something else moved the robot there, "
            f"at {_when(log, groups, evidence.keep)}"
        )
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


MOST_TIMES = 6
"""Most times of pieces that a note lists."""


def _when(log: RobotLog, groups: list[Windows], keep: np.ndarray) -> str:
    """Recordings and times of the windows that do not count."""
    runs, starts = (np.concatenate([getattr(w, name) for w in groups])[~keep] for name in ("run", "start"))
    places = [f"{log.runs[r].t[s]:.1f} s of {log.runs[r].id}" for r, s in zip(runs, starts, strict=True)]
    return ", ".join(places[:MOST_TIMES]) + (
        f" and {len(places) - MOST_TIMES} more" if len(places) > MOST_TIMES else ""
    )


def _fitted(
    model: ReplayModel, log: RobotLog, parameters: list[Parameter], progress: Callable[[str], None]
) -> tuple[np.ndarray, list[Direction]]:
    """The robot around which the log is judged, shape (P,), and what had to be released for it."""
    groups = cut_windows(model, log, budget=FIT_SECONDS)
    if sum(group.count for group in groups) < LEAST_WINDOWS:
        groups = cut_windows(model, log, budget=SECONDS)
    theta = np.zeros(len(parameters))
    released: list[Direction] = []
    for round_ in range(ROUNDS):
        evidence = gather(model, groups, parameters, theta, healthy(parameters), progress)
        found = [f.direction for f in select(evidence, parameters) if f.direction.cause not in ORDINARY]
        # common causes go first: those at single places may only stand for them
        common = [d for d in found if len(d.members) > 1]
        wanted = common if common and common != released else found
        if round_ and wanted == released:
            break
        released = wanted
        named = {k for d in released for k in d.members}
        low, high = bounds_of(parameters)
        idle = [k for k, p in enumerate(parameters) if p.field == "limit" and k not in named]
        low[idle] = high[idle] = 0.0  # a limit acts as soon as it is there

        def refit(start: np.ndarray, directions: list[Direction], low=low, high=high) -> np.ndarray:  # noqa: ANN001
            return fit(model, groups, parameters, start, prior_of(parameters, directions), low, high, progress)

        def left(theta: np.ndarray, directions: list[Direction], evidence: Evidence = evidence) -> float:
            seen = replayed(evidence, model, groups, parameters, theta) / evidence.scale
            return float(seen + theta @ prior_of(parameters, directions) @ theta)

        theta = refit(theta, released)
        theta, released = _one_drive(theta, released, parameters, refit, left)
    return theta, released


def _one_drive(
    theta: np.ndarray, released: list[Direction], parameters: list[Parameter],
    refit: Callable[[np.ndarray, list[Direction]], np.ndarray], left: Callable[[np.ndarray, list[Direction]], float],
) -> tuple[np.ndarray, list[Direction]]:  # fmt: skip
    """Of each drive one cause, where the replay is as good with it alone: Kp is much as a stronger motor's."""
    for place in dict.fromkeys(d.where for d in released if d.cause in DRIVE):
        own = [d for d in released if d.cause in DRIVE and d.where == place]
        rest = [d for d in released if d not in own]
        best, least = (theta, released), left(theta, released) - 2.0 * NAMED_ODDS * (len(own) > 1)
        for other in directions_of(parameters):
            if other.cause not in DRIVE or other.where != place or len(other.members) != len(own[0].members):
                continue
            if own == [other]:
                continue
            start = theta.copy()
            start[[k for k, p in enumerate(parameters) if p.cause in DRIVE]] = 0.0
            new = refit(start, [*rest, other])
            if (value := left(new, [*rest, other])) < least:
                best, least = (new, [*rest, other]), value
        theta, released = best
    return theta, released


def _named(f: Found, found: list[Found], evidence: Evidence, parameters: list[Parameter], now: Posterior) -> NamedCause:
    """A cause with its size: of a single number as the log has it, of a group the change that all share."""
    values: dict[str, Value] = {}
    change: dict[int, float] = {}
    first = parameters[f.direction.members[0]]
    others = [x.direction for x in found if x is not f]
    if len(f.direction.members) == 1:
        k = f.direction.members[0]
        mean, sd = estimate(k, now, parameters)
    else:
        k = f.direction.members[0]
        mean, sd = now.mean[k], float(np.sqrt(max(now.covariance[k, k], now.robust[k])))
    low, high = (first.absolute(mean + s * 1.96 * sd) for s in (-1.0, 1.0))
    values[first.name] = Value(value=first.absolute(mean), ci95=(low, high), unit=first.unit)
    if first.relative:
        values["factor"] = Value(value=1.0 + mean, ci95=(1.0 + mean - 1.96 * sd, 1.0 + mean + 1.96 * sd), unit="1")
    for k in f.direction.members:
        change[k] = float(now.mean[k]) if len(f.direction.members) > 1 else float(mean)
    full = evidence.at(now.mean)
    without = posterior(evidence, parameters, others).mean.copy()
    without[list(f.direction.members)] = 0.0
    return NamedCause(
        name=f.direction.cause,
        where=f.direction.where,
        parameters=values,
        p_value=float(2.0 * stats.norm.sf(abs(f.z))),
        alternatives=tuple(dict.fromkeys(_place(d, f.direction.where) for d in f.alternatives)),
        gain=float(max(1.0 - full / max(evidence.at(without), 1e-12), 0.0)),
        change=change,
    )


def _place(direction: Direction, here: str) -> str:
    return direction.cause if direction.where == here else f"{direction.cause} of {direction.where}"


def _foretelling(
    found: list[Found], evidence: Evidence, parameters: list[Parameter]
) -> tuple[list[Found], list[Found]]:
    """Causes without which pieces of the log that took no part are foretold worse, and those that make no difference.

    The least certain is taken out first, and the others are tried again without it.
    """
    found, doubtful = list(found), []
    while found:
        losses = [_foretold(evidence, parameters, found, without) for without in (None, *found)]
        gains = [loss - losses[0] for loss in losses[1:]]
        sure = [_signed_ranks(g) for g in gains]
        share = [
            float(g.sum()) / (evidence.samples * len(f.direction.members)) for f, g in zip(found, gains, strict=True)
        ]
        count = np.arange(1.0, len(evidence.c) + 1.0)
        needed = min(FORETOLD, NEARLY_ALL * float(count.sum() / np.sqrt((count**2).sum())))
        certain = [min(t / needed, part / LEAST_SHARE) for t, part in zip(sure, share, strict=True)]
        least = int(np.argmin(certain))
        if certain[least] >= 1.0:
            break
        doubtful.append(found.pop(least))
    return found, doubtful


def _signed_ranks(gain: np.ndarray) -> float:
    """Wilcoxon's signed-rank score over windows, whose gains differ by orders of magnitude."""
    ranks = stats.rankdata(np.abs(gain))
    return float((np.sign(gain) * ranks).sum() / max(np.sqrt((ranks**2).sum()), 1e-12))


def _foretold(evidence: Evidence, parameters: list[Parameter], found: list[Found], without: Found | None) -> np.ndarray:
    """Squared mismatch of each window, by parameters from the other pieces; ``without`` is held at its description."""
    q = prior_of(parameters, [f.direction for f in found])
    low, high = bounds_of(parameters)
    named = {k for f in found for k in f.direction.members}
    for k, p in enumerate(parameters):
        if k not in named and p.cause not in (*ORDINARY, SESSION):  # as far as a healthy robot may be off
            low[k], high[k] = max(low[k], -2.0 * p.spread), min(high[k], 2.0 * p.spread)
    if without is not None:
        for k in without.direction.members:
            low[k], high[k] = parameters[k].usual
    loss = np.zeros(len(evidence.c))
    for fold in np.array_split(np.arange(len(loss)), FOLDS):
        keep = np.setdiff1d(np.arange(len(loss)), fold)
        a, b = evidence.a[keep].sum(axis=0) / evidence.scale, evidence.b[keep].sum(axis=0) / evidence.scale
        theta, _ = within(a + q, b, low, high)
        loss[fold] = (
            evidence.c[fold] - 2.0 * evidence.b[fold] @ theta
            + np.einsum("wij,i,j->w", evidence.a[fold], theta, theta)
        )  # fmt: skip
    return loss


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
