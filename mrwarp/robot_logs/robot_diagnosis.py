"""Faults of a robot's simulation and their places: from a log to named causes (docs/how_diagnosis_decides.md)."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from mrwarp.robot_logs.causes.cause import NUISANCE
from mrwarp.robot_logs.causes.parameter import Parameter, parameters_of
from mrwarp.robot_logs.causes.robot_causes import CATALOGUE, DRIVE, ORDINARY, OUTSIDE, SETUP
from mrwarp.robot_logs.channels.command_channel import check_commands
from mrwarp.robot_logs.channels.hidden_dynamics import with_oscillator
from mrwarp.robot_logs.channels.motion_channels import one_motion
from mrwarp.robot_logs.channels.torque_channel import consistent
from mrwarp.robot_logs.channels.trunk_motion import one_trunk
from mrwarp.robot_logs.initial_guess import first_look
from mrwarp.robot_logs.likelihood import Likelihood, gather
from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.report.stages import (
    BEFORE_AFTER,
    FIT,
    PROOF,
    READING,
    SIZES,
    UNEXPLAINED,
    WHOLE_LOG,
    within,
)
from mrwarp.robot_logs.robot_fit import FirstLook, fitted, fitted_alone, likelier, searched, uneven
from mrwarp.robot_logs.robot_log import LogError, RobotLog
from mrwarp.robot_logs.robot_proof import Sizes, by_replay, clear_ones, cross_validated, held_out
from mrwarp.robot_logs.robot_verdict import (
    NamedCause,
    RobotDiagnosis,
    cause_text,
    explained,
    named_cause,
    sentence_of,
    values_of,
)
from mrwarp.robot_logs.selection import (
    Found,
    Hypothesis,
    Posterior,
    bounds_of,
    bounds_without,
    posterior,
    scored,
    select,
    sizes,
)
from mrwarp.robot_logs.unexplained import joined, listed, outside, pushes, steady, unconfirmed
from mrwarp.robot_logs.unknowable import cannot_know, friction_that_holds, motions_of, next_experiment
from mrwarp.robot_logs.windows import Windows, cut_windows
from mrwarp.sysid.jackknife import student
from mrwarp.sysid.last_gate import Change, impossible, passed
from mrwarp.sysid.settings import Settings
from mrwarp.sysid.verdict import (
    NOT_CHECKED,
    VERDICTS,
    Error,
    Gain,
    Suspect,
    Unexplained,
    being_checked,
    not_checked,
)

NOT_PREDICTED = "pieces of the log that took no part are not clearly predicted better with it"
AS_HEALTHY = "numbers that are each a little off, as on healthy robots, explain the log as well"
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
    robot: Path,
    log: RobotLog,
    *,
    device: str = "cpu",
    progress: Callable[[str], None] = lambda _: None,
    answered: Callable[[RobotDiagnosis], bool] = lambda _: True,
    settings: Settings | None = None,
) -> RobotDiagnosis:
    """Diagnose a log against a robot's description, with replays on a Warp ``device``.

    ``answered`` takes the first answer, which is not final; the diagnosis ends with it where that returns False.
    ``settings`` are the numbers by which is decided, None takes those of the documentation.

    Raises:
        LogError: robot and log do not fit.
    """
    begun = time.perf_counter()
    case = _read(robot, log, device, settings or Settings(), progress)
    log = case.log
    look = first_look(case.model, case.part, case.parameters, progress)
    answer = _first_answer(look, case.model, log, case.groups, case.parameters, begun)
    progress(being_checked(answer.sentence))
    if not answered(answer):
        return answer
    judged = _judged(case, look, progress)
    judged = _sized(case, judged, within(progress, SIZES))
    judged, gain, errors = _before_and_after(case, judged, within(progress, BEFORE_AFTER))
    likelihood, parameters, found, size = judged.likelihood, case.parameters, judged.found, judged.size
    now = posterior(likelihood, parameters, [f.hypothesis for f in found])
    named = [named_cause(f, found, size, likelihood, parameters, now) for f in found]
    causes = tuple(c for c in named if c.name not in (*OUTSIDE, *SETUP))
    causes = tuple(_to_scale(c, case, judged, now) for c in causes)
    extended, setup = (_changes(parameters, x) for x in (causes, [c for c in named if c.name in SETUP]))
    progress(UNEXPLAINED)
    before, after = errors["all"]
    unexplained = _outside(case, judged, named, (after / max(before, 1e-12)) ** 2)
    holds = friction_that_holds(likelihood, case.model, log, case.groups, parameters, judged.theta)
    shown = [d for f in [*found, *judged.rejected] for d in (f.hypothesis, *f.alternatives)]
    unknown = cannot_know(likelihood, parameters, case.model, log, now, holds, shown)
    return RobotDiagnosis(
        verdict=VERDICTS[bool(causes), unexplained is not None],
        sentence=sentence_of(causes, unexplained, after, case.model.settings.robot.worst),
        causes=causes,
        suspects=_suspects(case, judged),
        unexplained=unexplained,
        cannot_know=unknown,
        next_experiment=next_experiment(causes, unknown, motions_of(case.model)),
        baseline=Error(rmse=before, nrmse=1.0, unit="healthy error"),
        extended=Error(rmse=after, nrmse=after / max(before, 1e-12), unit="healthy error"),
        gain=gain,
        per_joint={joint: _both(*errors[f"q.{joint}"]) for joint in case.model.joints},
        per_channel={name: _both(*errors[name]) for name in likelihood.sigma},
        session={p.where: float(size.size[k]) for k, p in enumerate(parameters) if p.field == "shift"},
        notes=tuple(_notes(case, judged, named, now)),
        parameters=tuple(parameters),
        theta=extended,
        setup=setup,
        model=case.model,
        log=log,
        windows=tuple(case.groups),
        seconds=time.perf_counter() - begun,
    )


@dataclass(frozen=True, kw_only=True)
class _Case:
    """A robot and its log, cut into windows."""

    model: ReplayModel
    log: RobotLog
    groups: list[Windows]
    part: list[Windows]
    """Windows by which the robot is fitted step by step."""
    parameters: list[Parameter]


@dataclass(frozen=True, kw_only=True)
class _Judged:
    """Causes of a log, and those that are not proven."""

    theta: np.ndarray
    """The robot about which ``likelihood`` is, shape (P,)."""
    likelihood: Likelihood
    rivals: dict[Hypothesis, list[Hypothesis]]
    """Causes of drives with which the replay was nearly as good."""
    found: list[Found]
    rejected: Mapping[Found, str]
    """Those that are not proven, and why."""
    size: Sizes
    near: Likelihood
    """About the robot with the sizes of the causes."""


def _read(robot: Path, log: RobotLog, device: str, settings: Settings, progress: Callable[[str], None]) -> _Case:
    """The robot, and its log in windows.

    Raises:
        LogError: robot and log do not fit.
    """
    progress(f"{READING}: {robot}")
    known, model = len(log.notes), replace(replay_model(robot, log, device), settings=settings)
    if model.held:
        note = f"{', '.join(model.held)}: not in the log, so held where the description has them"
        log = replace(log, notes=(*log.notes, note))
    if model.beyond:
        read = ", ".join(f"{joint} ({most:.3g} N·m)" for joint, most in model.beyond.items())
        note = f"tau is far beyond the description's torque limit at {read}: it has none here"
        log = replace(log, notes=(*log.notes, note))
    log = consistent(model, check_commands(model, one_trunk(one_motion(log, model.settings), model.settings)))
    model = with_oscillator(model, log)
    least, effort = settings.robot.windows, settings.robot_fit
    groups = cut_windows(model, log, budget=effort.seconds)
    if (count := sum(group.count for group in groups)) < least:
        raise LogError(
            f"{log.path}: too short: {count} pieces of {groups[0].t[0, -1] if groups else 0.5:.1f} s, "
            f"{'; '.join((f'{least} are needed', *log.notes[known:]))}; record longer"
        )
    part = groups if log.seconds <= effort.whole else cut_windows(model, log, budget=effort.fit_seconds)
    if sum(group.count for group in part) < least:
        part = groups
    return _Case(model=model, log=log, groups=groups, part=part, parameters=parameters_of(model, log))


def _judged(case: _Case, look: FirstLook, progress: Callable[[str], None]) -> _Judged:
    """Causes that stand out about the robot that fits, and of these the ones that parts and the replay confirm."""
    model, groups, parameters = case.model, case.groups, case.parameters
    theta, confirmed, likelihood, rivals = fitted(model, case.part, parameters, within(progress, FIT), look)
    if case.part is not groups:
        likelihood = gather(model, groups, parameters, theta, within(progress, WHOLE_LOG), known=likelihood)
    progress(PROOF)
    chosen = select(likelihood, parameters, confirmed)
    validated, _ = cross_validated(chosen, likelihood, parameters)
    # derivatives do not reach from a large cause to a robot without it: in the air, where errors fade, what the fit
    # needed is for the replay to judge alone; on feet, where they grow, both have to agree
    found = [f for f in chosen if f in validated or (f.hypothesis in confirmed and not model.free)]
    rejected = [f for f in chosen if f not in found]
    log = within(progress, PROOF)
    found, refuted = by_replay(found, model, groups, likelihood, parameters, theta, log)
    unproven = dict.fromkeys([*rejected, *refuted], NOT_PREDICTED)
    if all(f.hypothesis.cause in ORDINARY for f in chosen):  # what looked best is not silently dropped
        # the session's scale of torques stands for all drives: whether they are off cannot be known
        own = [d for d in look.guessed if d.where != "robot" or d.cause not in DRIVE]
        unproven |= dict.fromkeys(scored(likelihood, parameters, own), AS_HEALTHY)
    nothing = Sizes(size=np.zeros(len(parameters)), lone=np.zeros(len(parameters)), wider=1.0)
    return _Judged(
        theta=theta,
        likelihood=likelihood,
        rivals=rivals,
        found=found,
        rejected=unproven,
        size=nothing,
        near=likelihood,
    )


def _alone(
    case: _Case,
    judged: _Judged,
    found: list[Found],
    log: Callable[[str], None],
    start: np.ndarray | None = None,
    bounds: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[Sizes, Likelihood]:
    """Sizes of causes, fitted alone with the session's offsets from ``start``, (P,), and the likelihood there."""
    model, groups, parameters = case.model, case.groups, case.parameters
    start, (low, high) = judged.theta if start is None else start, bounds or bounds_of(parameters)
    free = [f.hypothesis for f in found]
    named = {k for d in free for k in d.members}
    begin = np.where([k in named or p.is_nuisance for k, p in enumerate(parameters)], start, 0.0)
    size, near, indices = fitted_alone(model, groups, parameters, free, begin, low, high, log=log)
    own, prior, lone = [parameters[k] for k in indices], np.zeros((len(indices), len(indices))), size[indices]
    lone[[k for k, p in enumerate(own) if p.is_nuisance and indices[k] not in named]] = 0.0
    for d in free:
        at = [indices.index(k) for k in d.members]
        if uneven(d, model, parameters):
            lone = searched(lone, at, model, groups, own, near, prior, low[indices], high[indices])
        else:
            lone = near.sized(lone, at, low[indices], high[indices])
    each = size.copy()
    each[indices] = lone
    sizes_ = Sizes(size=size, lone=each, wider=model.settings.robot.walking if model.free else 1.0)
    return sizes_, _on_windows_of(judged.likelihood, near, indices)


def _sized(case: _Case, judged: _Judged, log: Callable[[str], None]) -> _Judged:
    """The causes with clear sizes; where two are one robot, the likelier of them."""
    found, unclear, size, near = clear_ones(
        judged.found, judged.likelihood, case.parameters, lambda found: _alone(case, judged, found, log)
    )
    likely, other = likelier(found, size.size, case.parameters, case.model.settings.odds.rival)
    if [f.hypothesis for f in likely] != [f.hypothesis for f in found]:
        size, near = _alone(case, judged, likely, log, other)
    rejected = {**judged.rejected, **{f: _unclear(f, case, judged) for f in unclear}}
    return replace(judged, found=likely, rejected=rejected, size=size, near=near)


def _unclear(f: Found, case: _Case, judged: _Judged) -> str:
    """Why a cause's size is none of a fault."""
    p = case.parameters[f.hypothesis.members[0]]
    size = float(
        sizes(judged.likelihood.normal_equations(), case.parameters, [f.hypothesis], *bounds_of(case.parameters))[
            f.hypothesis.members[0]
        ]
    )
    return impossible(size, p.possible, p.unit) or NOT_CLEAR


def _before_and_after(
    case: _Case, judged: _Judged, log: Callable[[str], None]
) -> tuple[_Judged, Gain, dict[str, tuple[float, float]]]:
    """Errors on parts that took no part, with and without the causes.

    Causes that do not pass the gate go, the one that explains least first. What is outside the catalogue, and how
    drives are set up, acts before and after.
    """
    found, size, near, wide = judged.found, judged.size, judged.near, bounds_of(case.parameters)
    foreign = [f for f in found if f.hypothesis.cause in (*OUTSIDE, *SETUP)]
    # a floor or a delay that is a fault is no part of the session before it is reported
    usual = bounds_without(case.parameters, [f.hypothesis for f in found if f not in foreign])
    before = (size, near) if len(foreign) == len(found) else _alone(case, judged, foreign, log, bounds=usual)

    def errors(
        own: Sequence[Found],
    ) -> tuple[tuple[float, float], dict[str, Change], tuple[Sizes, Likelihood, Gain, dict[str, tuple[float, float]]]]:
        healthy, usual_ = before, usual
        if own == causes:
            size, near = judged.size, judged.near
        elif own:
            size, near = _alone(case, judged, [f for f in found if f in foreign or f in own], log)
        else:  # nothing is wrong: the floor may be what it likes
            healthy, usual_ = _alone(case, judged, foreign, log), wide
            size, near = healthy
        hypotheses = [f.hypothesis for f in found if f in foreign or f in own]
        pair = ([f.hypothesis for f in foreign], healthy[1], usual_), (hypotheses, near, wide)
        gain, each, channels = held_out(case.model, case.groups, judged.likelihood, case.parameters, *pair)
        return gain.ci95, channels, (size, near, gain, each)

    causes = [f for f in found if f not in foreign]
    _, refused, (size, near, gain, each) = passed(
        causes,
        errors=errors,
        gains=lambda f, left: explained(f, [*foreign, *left], judged.likelihood, case.parameters),
        most=float(np.sqrt(1.0 + case.model.settings.robot.share)) - 1.0,
    )
    found, rejected = [f for f in found if f not in refused], {**judged.rejected, **refused}
    found = [replace(f, alternatives=(*f.alternatives, *judged.rivals.get(f.hypothesis, ()))) for f in found]
    return replace(judged, found=found, rejected=rejected, size=size, near=near), gain, each


TORQUES = "the drives' torques"
"""Scale of masses, inertias and frictions where no log shows that of both."""


def _to_scale(c: NamedCause, case: _Case, judged: _Judged, now: Posterior) -> NamedCause:
    """A cause by the scale of all drives' torques, where that is every session's own and no reading anchors it.

    What is a mass, an inertia or a friction has a wider interval then; where the scale is off by more than it is on
    healthy robots, or drives are what is wrong, it has none.
    """
    parameters, anchored = case.parameters, judged.likelihood.sigma
    scale = next((k for k, p in enumerate(parameters) if p.declared.of_all), None)
    mechanical = any(parameters[k].declared.mechanical for k in c.change)
    if scale is None or parameters[scale].declared.measured_in in anchored or not mechanical:
        return c
    p = parameters[scale]
    drives = any(f.hypothesis.cause in DRIVE and f.hypothesis.where == "robot" for f in judged.found)
    if drives or max(abs(float(judged.size.size[scale])), abs(float(now.mean[scale]))) > p.least:
        endless = {name: replace(v, ci95=(-np.inf, np.inf)) for name, v in c.parameters.items()}
        return replace(c, parameters=endless, relative_to=TORQUES)
    wider = {}
    for name, v in c.parameters.items():
        share = student(0.95, np.inf) * p.spread * abs(v.value)
        low, high = (v.value + s * np.hypot(s * (end - v.value), share) for s, end in zip((-1, 1), v.ci95, strict=True))
        wider[name] = replace(v, ci95=(float(low), float(high)))
    return replace(c, parameters=wider)


def _changes(parameters: Sequence[Parameter], causes: Sequence[NamedCause]) -> np.ndarray:
    """Changes of some causes, shape (P,)."""
    found = np.zeros(len(parameters))
    for cause in causes:
        for k, change in cause.change.items():
            found[k] = change
    return found


def _suspects(case: _Case, judged: _Judged) -> tuple[Suspect, ...]:
    """Causes that are not proven, with the missing part of the proof."""
    likelihood, parameters, suspects = judged.likelihood, case.parameters, []
    both = [*judged.found, *judged.rejected]
    free = [f.hypothesis for f in both]
    beliefs = posterior(likelihood, parameters, free)
    for f, reason in ((f, x) for f, x in judged.rejected.items() if f.hypothesis.cause not in OUTSIDE):
        about = sizes(likelihood.normal_equations(), parameters, free, *bounds_of(parameters))
        c = named_cause(f, both, replace(judged.size, size=about, lone=about), likelihood, parameters, beliefs)
        suspects.append(Suspect(name=c.name, reason=f"at {c.where}: {reason}", parameters=c.parameters, gain=c.gain))
    return tuple(suspects)


def _outside(case: _Case, judged: _Judged, named: list[NamedCause], left: float) -> Unexplained | None:
    """Effects outside the catalogue: those that act always, among the causes, and pushes at times.

    ``left`` is the share of the squared error that the named causes leave [1].
    """
    pushed = pushes(judged.likelihood, case.model, case.groups, case.parameters, judged.theta)
    acting = outside(pushed, case.groups, case.log, case.model.settings.robot)
    always = [
        steady(f.hypothesis, next(iter(c.parameters.values())).value, c.gain, case.log, case.parameters)
        for f, c in zip(judged.found, named, strict=True)
        if c.name in OUTSIDE
    ]
    unproven = not any(p.declared.sought for c in named for p in (case.parameters[k] for k in c.change))
    hidden = unconfirmed(case.model, case.parameters, case.log, left) if unproven else None
    return joined([*always, *([hidden] if hidden else []), *([acting] if acting else [])])


def _notes(case: _Case, judged: _Judged, causes: Sequence[NamedCause], now: Posterior) -> list[str]:
    """Remarks on the log and the description that are no causes."""
    notes, parameters = [*getattr(case.log, "notes", ())], case.parameters
    notes += [f"no fault: {cause_text(c)}" for c in causes if c.name in SETUP]
    named = {k for c in causes for k in c.change}
    for k, p in enumerate(parameters):
        value = float(judged.size.size[k] if p.cause == NUISANCE else now.mean[k])
        if (remark := p.declared.remark) and k not in named and abs(value) > p.least:
            notes.append(remark(value, p.usual))
    frictions = [name for name in ORDINARY if CATALOGUE[name].rubs]
    if less := [c.where for c in causes if c.name in frictions and min(c.change.values()) < 0.0]:
        notes.append(
            f"less friction than described at {', '.join(dict.fromkeys(less))}: the description has too much, "
            "or a controller compensates friction and the log's command does not have it"
        )
    if judged.likelihood.lost:
        notes.append(
            f"{judged.likelihood.lost} pieces of the log were left out: something else moved the robot there, "
            f"at {_when(case.log, case.groups, judged.likelihood.keep)}"
        )
    return notes


def _first_answer(
    look: FirstLook, model: ReplayModel, log: RobotLog, groups: list[Windows], parameters: list[Parameter], begun: float
) -> RobotDiagnosis:
    """A diagnosis that is not final: the changes with which the replay is best as suspects, and no verdict.

    Where no fault stands out, what descriptions rarely know may: of that the changes as large as a fault.
    """
    unknown, found = float("nan"), []
    moved = np.abs(look.guess - look.nuisance)
    ordinary = [
        Hypothesis(cause=p.cause, where=p.where, members=(k,))
        for k, p in enumerate(parameters)
        if p.cause in ORDINARY and moved[k] > p.least
    ]
    for d in look.guessed or ordinary:
        change = {k: float(look.guess[k]) for k in d.members}
        first = parameters[d.members[0]]
        values = values_of(first, float(np.mean(list(change.values()))), unknown)
        found.append(
            NamedCause(
                name=d.cause,
                where=d.where,
                parameters=values,
                p_value=unknown,
                alternatives=(),
                gain=unknown,
                change=change,
            )
        )
    return RobotDiagnosis(
        **not_checked("; ".join(map(cause_text, found)) or "no single fault that stands out", "healthy error"),
        suspects=tuple(
            Suspect(name=c.name, reason=f"at {c.where}: {NOT_CHECKED}", parameters=c.parameters, gain=c.gain)
            for c in found
        ),
        per_joint={},
        session={},
        parameters=tuple(parameters),
        theta=np.zeros(len(parameters)),
        model=model,
        log=log,
        windows=tuple(groups),
        seconds=time.perf_counter() - begun,
    )


def _when(log: RobotLog, groups: list[Windows], keep: np.ndarray) -> str:
    """Recordings and times of the windows that do not count."""
    runs, starts = (np.concatenate([getattr(w, name) for w in groups])[~keep] for name in ("run", "start"))
    return listed([f"{log.runs[r].t[s]:.1f} s of {log.runs[r].id}" for r, s in zip(runs, starts, strict=True)])


def _on_windows_of(likelihood: Likelihood, near: Likelihood, indices: list[int]) -> Likelihood:
    """The likelihood ``near`` of the parameters ``indices``, in the shapes of ``likelihood``; 0 in windows left out."""
    a, b = np.zeros_like(likelihood.information), np.zeros_like(likelihood.score)
    here, there = np.flatnonzero(near.keep[likelihood.keep]), np.flatnonzero(likelihood.keep[near.keep])
    own = np.array(indices, dtype=int)
    a[np.ix_(here, own, own)], b[np.ix_(here, own)] = near.information[there], near.score[there]
    return replace(likelihood, information=a, score=b, scale=near.scale)


def _both(before: float, after: float) -> dict[str, float]:
    return {"baseline": before, "extended": after}
