"""Faults of a robot's simulation and their places: from a log to named causes (docs/how_robot_logs_decide.md)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats
from threadpoolctl import threadpool_limits

from mrwarp.diagnose.first_answer import NOT_CHECKED, being_checked, likely
from mrwarp.diagnose.result import Error, Suspect, Value
from mrwarp.robot_logs.causes import ORDINARY, OUTSIDE, OWN_DELAY, TORQUE_SCALE, Parameter, parameters_of
from mrwarp.robot_logs.evidence import Evidence, gather, losses
from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.robot_fit import FirstLook, first_look, fitted, fitted_alone, likelier, searched, uneven
from mrwarp.robot_logs.robot_log import LogError, RobotLog
from mrwarp.robot_logs.robot_proof import Sizes, by_replay, clear_ones, cross_validated
from mrwarp.robot_logs.robot_verdict import NamedCause, RobotDiagnosis, cause_text, sentence_of
from mrwarp.robot_logs.selection import (
    PARTS,
    WALKING,
    Direction,
    Found,
    Posterior,
    bounds_of,
    bounds_without,
    own_members,
    posterior,
    select,
    sizes,
)
from mrwarp.robot_logs.unexplained import joined, listed, outside, pushes, steady
from mrwarp.robot_logs.unknowable import cannot_know, friction_that_holds, motions_of, next_experiment
from mrwarp.robot_logs.windows import LEAST_WINDOWS, Windows, cut_windows
from mrwarp.sysid.jackknife import student, sum_and_error
from mrwarp.sysid.left_out import in_a_row, predicted
from mrwarp.sysid.verdict import VERDICTS

FIT_SECONDS, SECONDS = 10.0, 60.0
"""Parts of a log by which the robot is fitted step by step, and from which causes are reported [s]; logs of up to
:data:`WHOLE` s are fitted as a whole."""

WHOLE = 15.0

NOT_PREDICTED = "pieces of the log that took no part are not clearly predicted better with it"
NOT_CLEAR = "its interval includes sizes that healthy robots have"


def robot_of(log: RobotLog, robot: str | None) -> Path:
    """The robot's description: as given, or the file next to the log's files that the log names.

    Raises:
        LogError: neither is there.
    """
    if robot is not None:
        return Path(robot)
    if not log.robot:
        raise LogError(f"{log.path}: names no robot; name the description with --robot")
    near = (log.path if log.path.is_dir() else log.path.parent) / log.robot
    if not near.is_file():
        raise LogError(
            f"{log.path}: its robot, {log.robot}, does not lie next to it; name the description with --robot"
        )
    return near


@threadpool_limits.wrap(limits=1, user_api="blas")  # its threads would wait for those of the replay, at full load
def diagnose_log(
    robot: Path, log: RobotLog, *, device: str = "cpu", progress: Callable[[str], None] = lambda _: None,
    answered: Callable[[RobotDiagnosis], bool] = lambda _: True,
) -> RobotDiagnosis:  # fmt: skip
    """Diagnose a log against a robot's description, with replays on a Warp ``device``.

    ``answered`` takes the first answer, which is not final; the diagnosis ends with it where that returns False.

    Raises:
        LogError: robot and log do not fit.
    """
    begun = time.perf_counter()
    progress(f"reading {robot}")
    model = replay_model(robot, log, device)
    parameters = parameters_of(model, log)
    groups = cut_windows(model, log, budget=SECONDS)
    if (count := sum(group.count for group in groups)) < LEAST_WINDOWS:
        raise LogError(
            f"{log.path}: too short: {count} pieces of {groups[0].t[0, -1] if groups else 0.5:.1f} s, "
            f"{LEAST_WINDOWS} are needed; record longer"
        )
    part = groups if log.seconds <= WHOLE else cut_windows(model, log, budget=FIT_SECONDS)
    if sum(group.count for group in part) < LEAST_WINDOWS:
        part = groups
    look = first_look(model, part, parameters, progress)
    answer = _first_answer(look, model, log, groups, parameters, begun)
    progress(being_checked(answer.sentence))
    if not answered(answer):
        return answer
    theta, confirmed, evidence, rivals = fitted(model, part, parameters, progress, look)
    if part is not groups:
        evidence = gather(model, groups, parameters, theta, progress)
    progress("causes that stand out")
    chosen = select(evidence, parameters, confirmed)
    validated, _ = cross_validated(chosen, evidence, parameters)
    # derivatives do not reach from a large cause to a robot without it: in the air, where errors fade, what the fit
    # needed is for the replay to judge alone; on feet, where they grow, both have to agree
    found = [f for f in chosen if f in validated or (f.direction in confirmed and not model.free)]
    rejected = [f for f in chosen if f not in found]
    found, refuted = by_replay(found, model, groups, evidence, parameters, theta)
    rejected += refuted

    wide = bounds_of(parameters)

    def alone(
        found: list[Found], start: np.ndarray = theta, bounds: tuple[np.ndarray, np.ndarray] = wide
    ) -> tuple[Sizes, Evidence]:
        released, (low, high) = [f.direction for f in found], bounds
        named = {k for d in released for k in d.members}
        begin = np.where([k in named or p.of_session for k, p in enumerate(parameters)], start, 0.0)
        size, near, free = fitted_alone(model, groups, parameters, released, begin, low, high)
        own, prior, lone = [parameters[k] for k in free], np.zeros((len(free), len(free))), size[free]
        lone[[k for k, p in enumerate(own) if p.of_session and free[k] not in named]] = 0.0
        for d in released:
            at = [free.index(k) for k in d.members]
            if uneven(d, model, parameters):
                lone = searched(lone, at, model, groups, own, near, prior, low[free], high[free])
            else:
                lone = near.sized(lone, at, low[free], high[free])
        each = size.copy()
        each[free] = lone
        return Sizes(size=size, lone=each, wider=WALKING if model.free else 1.0), _on_windows_of(evidence, near, free)

    progress("sizes")
    found, unclear, size, near = clear_ones(found, evidence, parameters, alone)
    rejected += unclear
    likely, other = likelier(found, size.size, parameters)
    if [f.direction for f in likely] != [f.direction for f in found]:
        size, near = alone(likely, other)
    found = likely
    progress("before and after")
    foreign = [f for f in found if f.direction.cause in OUTSIDE]
    # a floor or a delay that is a fault is no part of the session before it is reported
    usual = bounds_without(parameters, [f.direction for f in found if f not in foreign])
    before = (size, near) if len(foreign) == len(found) else alone(foreign, bounds=usual)

    def held_out(found: list[Found], near: Evidence) -> tuple[dict[str, Any], dict[str, tuple[float, float]]]:
        own = ([f.direction for f in foreign], before[1], usual), ([f.direction for f in found], near, wide)
        return _held_out(model, groups, evidence, parameters, *own)

    gain, errors = held_out(found, near)
    if gain["ci95"][1] < 0.0:  # each was clear, but with them all together the replay is worse
        rejected += [f for f in found if f not in foreign]
        found, usual = foreign, wide
        size, near = before = alone(foreign)
        gain, errors = held_out(found, near)
    now = posterior(evidence, parameters, [f.direction for f in found])
    found = [replace(f, alternatives=(*f.alternatives, *rivals.get(f.direction, ()))) for f in found]
    named = [_named(f, found, size, evidence, parameters, now) for f in found]
    causes = tuple(c for c in named if c.name not in OUTSIDE)
    extended = np.zeros(len(parameters))
    for cause in causes:
        for k, change in cause.change.items():
            extended[k] = change
    beliefs = posterior(evidence, parameters, [*(f.direction for f in found), *(f.direction for f in rejected)])
    suspects, both = [], [*found, *rejected]
    for f in (f for f in rejected if f.direction.cause not in OUTSIDE):
        about = sizes(evidence.likelihood(), parameters, [f.direction for f in both], *wide)
        c = _named(f, both, replace(size, size=about, lone=about), evidence, parameters, beliefs)
        reason = NOT_CLEAR if f in unclear else NOT_PREDICTED
        suspects.append(Suspect(name=c.name, reason=f"at {c.where}: {reason}", parameters=c.parameters, gain=c.gain))
    progress("what no cause explains")
    acting = outside(pushes(evidence, model, groups, parameters, theta), groups, log)
    always = [
        steady(f.direction, next(iter(c.parameters.values())).value, c.gain, log, parameters)
        for f, c in zip(found, named, strict=True) if c.name in OUTSIDE
    ]  # fmt: skip
    unexplained = joined([*always, *([acting] if acting else [])])
    session = {p.where: float(size.size[k]) for k, p in enumerate(parameters) if p.field == "shift"}
    notes = [*getattr(log, "notes", ())]
    late = next(k for k, p in enumerate(parameters) if p.cause == "command_delay")
    if not any(late in c.change for c in causes) and abs(now.mean[late]) > parameters[late].least:
        row = parameters[late].usual[1]
        notes.append(
            f"commands act {1e3 * now.mean[late]:.1f} ms after their row: within a row of {1e3 * row:.1f} ms "
            "that is how the log was written"
        )
    scale = sum(float(size.size[k]) for k, p in enumerate(parameters) if p.field == "scale")
    if abs(scale) > TORQUE_SCALE:
        notes.append(
            f"all drives' torques are {1.0 + scale:.2f} times what gains and masses of the description make them: "
            "either may be off, and a robot that is held does not show which"
        )
    frictions = ("coulomb_friction", "viscous_friction")
    if less := [c.where for c in causes if c.name in frictions and min(c.change.values()) < 0.0]:
        notes.append(
            f"less friction than described at {', '.join(dict.fromkeys(less))}: the description has too much, "
            "or a controller compensates friction and the log's command does not have it"
        )
    if evidence.lost:
        notes.append(
            f"{evidence.lost} pieces of the log were left out: something else moved the robot there, "
            f"at {_when(log, groups, evidence.keep)}"
        )
    holds = friction_that_holds(evidence, model, log, groups, parameters, theta)
    shown = [d for f in both for d in (f.direction, *f.alternatives)]
    unknown = cannot_know(evidence, parameters, model, log, now, holds, shown)
    return RobotDiagnosis(
        verdict=VERDICTS[bool(causes), unexplained is not None],
        sentence=sentence_of(causes, unexplained),
        causes=causes,
        suspects=tuple(suspects),
        unexplained=unexplained,
        cannot_know=unknown,
        next_experiment=next_experiment(causes, unknown, motions_of(model)),
        baseline=Error(rmse=errors["all"][0], nrmse=1.0, unit="healthy error"),
        extended=Error(
            rmse=errors["all"][1], nrmse=errors["all"][1] / max(errors["all"][0], 1e-12), unit="healthy error"
        ),
        gain=gain,
        per_joint={joint: _both(*errors[f"q.{joint}"]) for joint in model.joints},
        per_channel={name: _both(*errors[name]) for name in evidence.sigma},
        session=session,
        notes=tuple(notes),
        parameters=tuple(parameters),
        theta=extended,
        model=model,
        log=log,
        windows=tuple(groups),
        seconds=time.perf_counter() - begun,
    )


def _first_answer(
    look: FirstLook, model: ReplayModel, log: RobotLog, groups: list[Windows], parameters: list[Parameter], begun: float
) -> RobotDiagnosis:
    """A diagnosis that is not final: the changes with which the replay is best as suspects, and no verdict.

    Where no fault stands out, what descriptions rarely know may: of that the changes as large as a fault.
    """
    unknown, found = float("nan"), []
    moved = np.abs(look.begin - look.session)
    ordinary = [
        Direction(cause=p.cause, where=p.where, members=(k,))
        for k, p in enumerate(parameters)
        if p.cause in ORDINARY and moved[k] > p.least
    ]
    for d in look.loudest or ordinary:
        change = {k: float(look.begin[k]) for k in d.members}
        first = parameters[d.members[0]]
        values = _values(first, float(np.mean(list(change.values()))), unknown)
        found.append(
            NamedCause(name=d.cause, where=d.where, parameters=values, p_value=unknown, alternatives=(), gain=unknown,
                       change=change)
        )  # fmt: skip
    nothing = Error(rmse=unknown, nrmse=unknown, unit="healthy error")
    return RobotDiagnosis(
        verdict=None,
        sentence=likely("; ".join(cause_text(c) for c in found) or "no single fault that stands out"),
        final=False,
        causes=(),
        suspects=tuple(
            Suspect(name=c.name, reason=f"at {c.where}: {NOT_CHECKED}", parameters=c.parameters, gain=c.gain)
            for c in found
        ),
        cannot_know=(),
        baseline=nothing,
        extended=nothing,
        gain={"rmse_reduction": None, "ci95": (None, None), "held_out": ()},
        per_joint={},
        session={},
        parameters=tuple(parameters),
        theta=np.zeros(len(parameters)),
        model=model,
        log=log,
        windows=tuple(groups),
        seconds=time.perf_counter() - begun,
    )


def _values(first: Parameter, mean: float, half: float) -> dict[str, Value]:
    """The numbers of a cause from the change of its first parameter and the half of that change's interval."""
    low, high = sorted(first.absolute(mean + s * half) for s in (-1.0, 1.0))
    values = {first.name: Value(value=first.absolute(mean), ci95=(low, high), unit=first.unit)}
    if first.relative:
        values["factor"] = Value(value=1.0 + mean, ci95=(1.0 + mean - half, 1.0 + mean + half), unit="1")
    return values


def _when(log: RobotLog, groups: list[Windows], keep: np.ndarray) -> str:
    """Recordings and times of the windows that do not count."""
    runs, starts = (np.concatenate([getattr(w, name) for w in groups])[~keep] for name in ("run", "start"))
    return listed([f"{log.runs[r].t[s]:.1f} s of {log.runs[r].id}" for r, s in zip(runs, starts, strict=True)])


def _named(
    f: Found, found: list[Found], size: Sizes, evidence: Evidence, parameters: list[Parameter], now: Posterior
) -> NamedCause:
    """A cause with its size and what it explains."""
    others = [x.direction for x in found if x is not f]
    first = parameters[own_members(f.direction, others)[0]]
    mean, half = size.of(f.direction, [x.direction for x in found], now, parameters)
    if first.field == "delay":
        mean, half = mean - OWN_DELAY, half + OWN_DELAY
    values = _values(first, mean, half)
    early = first.field == "delay" and mean < 0.0  # none acts before it was given: the commands' stamps are late
    if early:
        values = {"shift": Value(value=-mean, ci95=(-mean - half, -mean + half), unit=first.unit)}
    full = evidence.at(now.mean)
    without = posterior(evidence, parameters, others).mean.copy()
    without[list(f.direction.members)] = 0.0
    return NamedCause(
        name="clock_shift" if early else f.direction.cause,
        where="commands" if early else f.direction.where,
        parameters=values,
        p_value=float(2.0 * stats.norm.sf(abs(f.z))),
        alternatives=tuple(dict.fromkeys(_place(d, f.direction.where) for d in f.alternatives)),
        gain=float(max(1.0 - full / max(evidence.at(without), 1e-12), 0.0)),
        change={k: float(size.size[k]) for k in f.direction.members},
    )


def _place(direction: Direction, here: str) -> str:
    return direction.cause if direction.where == here else f"{direction.cause} of {direction.where}"


def _on_windows_of(evidence: Evidence, near: Evidence, free: list[int]) -> Evidence:
    """Evidence of ``near`` on its ``free`` parameters, in the shapes of ``evidence``; without windows it left out."""
    a, b = np.zeros_like(evidence.information), np.zeros_like(evidence.score)
    here, there = np.flatnonzero(near.keep[evidence.keep]), np.flatnonzero(evidence.keep[near.keep])
    own = np.array(free, dtype=int)
    a[np.ix_(here, own, own)], b[np.ix_(here, own)] = near.information[there], near.score[there]
    return replace(evidence, information=a, score=b, scale=near.scale)


def _held_out(
    model: ReplayModel, groups: list[Windows], evidence: Evidence, parameters: list[Parameter],
    *fits: tuple[list[Direction], Evidence, tuple[np.ndarray, np.ndarray]],
) -> tuple[dict[str, Any], dict[str, tuple[float, float]]]:  # fmt: skip
    """Error of the replay on parts of the log that took no part, before and after, both with their session's offsets.

    ``fits`` are the causes of each, the evidence about its fit, and its bounds.

    Returns:
        Reduction of the weighted error from each window's best start, with its interval over parts; and errors before
        and after: ``all`` is that one by reading [1], a channel's and ``q.JOINT`` are RMSE from the logged start.
    """
    parts, both = in_a_row(len(evidence.square), PARTS), []
    for released, near, bounds in fits:

        def solve(a: np.ndarray, b: np.ndarray, released=released, near=near, bounds=bounds) -> np.ndarray:  # noqa: ANN001
            each = zip(a / near.scale, b / near.scale, strict=True)
            return np.stack([sizes(x, parameters, released, *bounds) for x in each])

        theta, _ = predicted(near, parts, solve)
        both.append(losses(evidence, model, groups, parameters, theta))
    whole = np.isfinite(both[0][0]) & np.isfinite(both[1][0])  # a replay that broke has no error to compare
    channels = sum(len(x) for x in evidence.sigma.values())
    samples = channels * np.mean([w.t.shape[1] for w in groups])
    by_part = np.array([[loss[part[whole[part]]].sum() for loss, _ in both] for part in parts if whole[part].any()])
    each = 1.0 - np.sqrt(by_part[:, 1] / np.maximum(by_part[:, 0], 1e-12))
    half = student(0.95, max(len(each) - 1, 1)) * sum_and_error(each)[1] / len(each)
    total = np.sqrt(by_part.sum(axis=0) / (whole.sum() * samples))
    value = float(1.0 - total[1] / max(total[0], 1e-12))
    errors = {"all": (float(total[0]), float(total[1]))}
    for name in both[0][1]:
        before, after = (np.sqrt(squares[name][whole].mean(axis=0)) for _, squares in both)
        errors[name] = (float(np.sqrt((before**2).mean())), float(np.sqrt((after**2).mean())))
        if name == "q":
            errors |= {f"q.{j}": (float(before[k]), float(after[k])) for k, j in enumerate(model.joints)}
    return {"rmse_reduction": value, "ci95": (value - half, value + half), "held_out": tuple(range(PARTS))}, errors


def _both(before: float, after: float) -> dict[str, float]:
    return {"baseline": before, "extended": after}
