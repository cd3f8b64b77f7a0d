"""What the simulation of a robot gets wrong, and where: from a log to named causes, as docs/robot_logs.md has it."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from mrwarp.diagnose.result import Error, Suspect, Value, Verdict
from mrwarp.robot_logs.causes import ORDINARY, SESSION, Parameter, parameters_of
from mrwarp.robot_logs.evidence import Evidence, fit, gather, losses, replayed, within
from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.robot_log import LogError, RobotLog
from mrwarp.robot_logs.robot_verdict import NamedCause, RobotDiagnosis, sentence_of
from mrwarp.robot_logs.selection import (
    DRIVE,
    LEAST_SHARE,
    NAMED_ODDS,
    PARTS,
    WALKING,
    Direction,
    Found,
    Posterior,
    bounds_of,
    directions_of,
    half_width,
    healthy,
    posterior,
    prior_of,
    select,
    sizes,
    vector,
)
from mrwarp.robot_logs.unexplained import listed, outside, pushes
from mrwarp.robot_logs.unknowable import cannot_know, next_experiment
from mrwarp.robot_logs.windows import Windows, cut_windows

FIT_SECONDS, SECONDS = 10.0, 60.0
"""Parts of a log by which the robot is fitted step by step, and from which causes are told [s]; logs of up to
:data:`WHOLE` s are fitted as a whole."""

WHOLE = 15.0

ROUNDS = 4
"""Times that what stands out is released and the robot fitted anew."""

FORETOLD, NEARLY_ALL = 4.0, 0.85
"""Least gain of a cause on the pieces that took no part, as Wilcoxon's standard score over windows: one chance in a
hundred over 200 causes and places. Few windows cannot reach it: there, this share of the score that they can reach."""

ACTS = 0.05
"""A window has a say on a cause where it holds this share of the mean window's information on it: a coil that was not
asked for current says nothing of it, but for what the other numbers do without it."""

LOUD, MULTIPLES, PICKS = 6, (0.5, 1.0, 2.0, 4.0), 3
"""Directions that are tried by the replay alone, their sizes in those that derivatives ask for, and how many are taken
one after the other."""

SEARCHED, SEARCHES = 1.25, 4
"""Factor between sizes of a cause that are tried by the replay, and how often the range is widened."""

PROOF_STEPS = 2
"""Steps of the fits by which a cause is proven: from where derivatives say."""

NOT_FORETOLD = "pieces of the log that took no part are not clearly predicted better with it"
NOT_CLEAR = "its interval reaches to what is no fault"

VERDICTS: dict[tuple[bool, bool], Verdict] = {
    (False, False): "none", (True, False): "named", (False, True): "unexplained", (True, True): "named_and_unexplained",
}  # fmt: skip
"""By whether there are causes, and something that none explains."""

LEAST_WINDOWS = 8
"""Fewest windows that carry a verdict."""


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """Sizes by the replay, shape (P,)."""

    size: np.ndarray
    """Of the causes, beside the session's offsets."""
    lone: np.ndarray
    """The same where nothing else is off."""
    wider: float
    """Factor on intervals."""

    def half_width(self, d: Direction, now: Posterior, parameters: list[Parameter]) -> float:
        """See :func:`mrwarp.robot_logs.selection.half_width`."""
        k = d.members[0]
        return half_width(d, float(self.size[k]), now, parameters, wider=self.wider, lone=float(self.lone[k]))


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
    part = groups if log.seconds <= WHOLE else cut_windows(model, log, budget=FIT_SECONDS)
    if sum(group.count for group in part) < LEAST_WINDOWS:
        part = groups
    theta, confirmed, evidence = _fitted(model, part, parameters, progress)
    if part is not groups:
        evidence = gather(model, groups, parameters, theta, progress)
    progress("causes that stand out")
    found, doubtful = _foretelling(select(evidence, parameters, confirmed), evidence, parameters)
    found, refuted = _by_replay(found, model, groups, evidence, parameters)
    doubtful += refuted

    def alone(found: list[Found]) -> tuple[Sizes, Evidence]:
        released = [f.direction for f in found]
        named = {k for d in released for k in d.members}
        begin = np.where([k in named or p.cause == SESSION for k, p in enumerate(parameters)], theta, 0.0)
        low, high = bounds_of(parameters)
        size, near, free = _alone(model, groups, parameters, released, begin, low, high)
        own, prior, lone = [parameters[k] for k in free], np.zeros((len(free), len(free))), size[free]
        lone[[k for k, p in enumerate(own) if p.cause == SESSION]] = 0.0
        for d in released:
            at = [free.index(k) for k in d.members]
            lone = _searched(lone, at, model, groups, own, near, prior, low[free], high[free])
        each = size.copy()
        each[free] = lone
        return Sizes(size=size, lone=each, wider=WALKING if model.free else 1.0), _on_windows_of(evidence, near, free)

    progress("sizes")
    found, unclear, size, near = _clear(found, evidence, parameters, alone)
    doubtful += unclear
    now = posterior(evidence, parameters, [f.direction for f in found])
    causes = tuple(_named(f, found, size, evidence, parameters, now) for f in found)
    extended = np.zeros(len(parameters))
    for cause in causes:
        for k, change in cause.change.items():
            extended[k] = change
    progress("before and after")
    before = near if not found else alone([])[1]
    gain, errors = _held_out(model, groups, evidence, parameters, ([], before), ([f.direction for f in found], near))
    beside = posterior(evidence, parameters, [*(f.direction for f in found), *(f.direction for f in doubtful)])
    suspects, both = [], [*found, *doubtful]
    for f in doubtful:
        about = sizes(evidence, parameters, [f.direction for f in both])
        c = _named(f, both, replace(size, size=about, lone=about), evidence, parameters, beside)
        reason = NOT_CLEAR if f in unclear else NOT_FORETOLD
        suspects.append(Suspect(name=c.name, reason=f"at {c.where}: {reason}", parameters=c.parameters, gain=c.gain))
    progress("what no cause explains")
    unexplained = outside(pushes(evidence, model, groups, parameters, theta), groups, log)
    session = {p.where: float(size.size[k]) for k, p in enumerate(parameters) if p.field == "shift"}
    notes = [*getattr(log, "notes", ())]
    late = next(k for k, p in enumerate(parameters) if p.cause == "command_delay")
    if not any(c.name == "command_delay" for c in causes) and abs(now.mean[late]) > parameters[late].least:
        row = parameters[late].usual[1]
        notes.append(
            f"commands act {1e3 * now.mean[late]:.1f} ms after their row: within a row of {1e3 * row:.1f} ms "
            "that is how the log was written"
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
    unknown = cannot_know(evidence, parameters, model, log, now)
    return RobotDiagnosis(
        verdict=VERDICTS[bool(causes), unexplained is not None],
        sentence=sentence_of(causes, unexplained),
        causes=causes,
        suspects=tuple(suspects),
        unexplained=unexplained,
        cannot_know=unknown,
        next_experiment=next_experiment(causes, unknown),
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


def _when(log: RobotLog, groups: list[Windows], keep: np.ndarray) -> str:
    """Recordings and times of the windows that do not count."""
    runs, starts = (np.concatenate([getattr(w, name) for w in groups])[~keep] for name in ("run", "start"))
    return listed([f"{log.runs[r].t[s]:.1f} s of {log.runs[r].id}" for r, s in zip(runs, starts, strict=True)])


def _fitted(
    model: ReplayModel, groups: list[Windows], parameters: list[Parameter], progress: Callable[[str], None]
) -> tuple[np.ndarray, list[Direction], Evidence]:
    """The robot around which the log is judged, shape (P,), what had to be released for it, the evidence about it."""
    theta = np.zeros(len(parameters))
    released: list[Direction] = []
    described = evidence = gather(model, groups, parameters, theta, progress)
    fits: dict[frozenset[Direction], tuple[np.ndarray, list[Direction]]] = {}
    progress("single causes")
    begin, loudest = _loudest(model, groups, parameters, described)

    def left(theta: np.ndarray, directions: list[Direction], evidence: Evidence) -> float:
        seen, _ = replayed(evidence, model, groups, parameters, theta)
        return float(seen / evidence.scale + theta @ prior_of(parameters, directions) @ theta)

    for round_ in range(ROUNDS):
        found = loudest
        if round_ or not loudest:
            # what does not predict what it did not see is no cause, and would only lead the fit astray
            seen, _ = _foretelling(select(evidence, parameters), evidence, parameters)
            found = [f.direction for f in seen if f.direction.cause not in ORDINARY]
        # common causes go first: those at single places may only stand for them
        common = [d for d in found if len(d.members) > 1]
        wanted = common if common and common != released else found
        if (same := fits.get(frozenset(wanted))) is not None:
            # the last fit asks for itself, or two ask for each other: the likelier one stands
            if same[0] is not theta and left(*same, evidence) < left(theta, released, evidence):
                theta, released = same
                evidence = gather(model, groups, parameters, theta, progress)
            break
        released = wanted
        named = {k for d in released for k in d.members}
        low, high = bounds_of(parameters)
        idle = [k for k, p in enumerate(parameters) if p.field == "limit" and k not in named]
        low[idle] = high[idle] = 0.0  # a limit acts as soon as it is there

        def refit(
            directions: list[Direction], start: np.ndarray = theta, evidence: Evidence = evidence, low=low, high=high,  # noqa: ANN001
        ) -> tuple[np.ndarray, Evidence, bool]:  # fmt: skip
            if directions:
                first = begin.copy()
                first[[k for d in loudest if d not in directions for k in d.members]] = 0.0
                start, _, _ = _alone(model, groups, parameters, directions, first, low, high, described)
                _, evidence = replayed(evidence, model, groups, parameters, start)
            prior = prior_of(parameters, directions)
            return fit(model, groups, parameters, start, evidence, prior, low, high, progress)

        theta, evidence, fresh = refit(released)
        judge = functools.partial(left, evidence=evidence)
        theta, released, evidence, fresh = _one_drive(theta, released, evidence, fresh, parameters, refit, judge)
        fits[frozenset(wanted)] = fits[frozenset(released)] = theta, released
        if not fresh:
            evidence = gather(model, groups, parameters, theta, progress)
    return theta, released, evidence


def _alone(
    model: ReplayModel, groups: list[Windows], parameters: list[Parameter], released: list[Direction],
    begin: np.ndarray, low: np.ndarray, high: np.ndarray, described: Evidence | None = None,
) -> tuple[np.ndarray, Evidence, list[int]]:  # fmt: skip
    """The robot with ``released`` and the session's offsets fitted alone by the replay, from ``begin``, (P,).

    Far from the truth, where derivatives say little, the other numbers would take up what a large fault leaves.
    ``described`` is evidence about the robot as described; without it derivatives are taken at ``begin``.

    Returns:
        Parameters, shape (P,); evidence about them of those that were free; and which these are.
    """
    named = {k for d in released for k in d.members}
    free = sorted(named | {k for k, p in enumerate(parameters) if p.cause == SESSION or begin[k] != 0.0})
    own = [parameters[k] for k in free]
    prior = prior_of(own, [replace(d, members=tuple(free.index(k) for k in d.members)) for d in released])
    start, evidence = np.clip(begin[free], low[free], high[free]), described.of(free) if described else None
    if evidence is not None and start.any():
        _, evidence = replayed(evidence, model, groups, own, start)
    found = np.zeros(len(parameters))
    found[free], evidence, _ = fit(
        model, groups, own, start, evidence, prior, low[free], high[free], lambda _: None, renew=int(bool(described))
    )
    if described is None:
        for d in released:
            members = [free.index(k) for k in d.members]
            found[free] = _searched(found[free], members, model, groups, own, evidence, prior, low[free], high[free])
    return found, evidence, free


def _searched(
    x: np.ndarray, members: list[int], model: ReplayModel, groups: list[Windows], parameters: list[Parameter],
    evidence: Evidence, prior: np.ndarray, low: np.ndarray, high: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Parameters, (P,), with ``members`` of the size that the replay is best with, found without derivatives.

    Derivatives are those of coarse steps, and of feet that touch: a fit by them ends where they vanish.
    """

    def at(times: float) -> tuple[float, np.ndarray]:
        new = x.copy()
        new[members] = np.clip(times * new[members], low[members], high[members])
        return replayed(evidence, model, groups, parameters, new)[0] / evidence.scale + float(new @ prior @ new), new

    sizes, seen = [1.0 / SEARCHED, 1.0, SEARCHED], {}
    for _ in range(SEARCHES):
        seen |= {s: at(s) for s in sizes if s not in seen}
        best = min(seen, key=lambda size: seen[size][0])
        if min(seen) < best < max(seen):
            break
        sizes = [best / SEARCHED, best * SEARCHED]
    if not min(seen) < best < max(seen):
        return seen[best][1]
    near = np.array([max(s for s in seen if s < best), best, min(s for s in seen if s > best)])
    bend, slope, _ = np.polyfit(near, [seen[s][0] for s in near], 2)
    return at(float(np.clip(-slope / (2.0 * bend), near[0], near[2])))[1] if bend > 0.0 else seen[best][1]


def _loudest(
    model: ReplayModel, groups: list[Windows], parameters: list[Parameter], described: Evidence
) -> tuple[np.ndarray, list[Direction]]:
    """A robot where a fit can begin, (P,), and the fault in it, if any: of single changes that which replays like best.

    Derivatives about the described robot end where a foot lifts: in sum, many small changes then promise more than the
    true large one, and the replay keeps none of it. So single changes are tried by the replay at several sizes, the
    best is kept, and those beside it are tried, until one is more than a healthy robot can have.
    """
    theta, (low, high) = np.zeros(len(parameters)), bounds_of(parameters)
    usual = healthy(parameters)
    a, b = described.a.sum(axis=0), described.b.sum(axis=0)
    directions = [d for d in directions_of(parameters) if d.cause != SESSION]
    changes = np.stack([vector(d, parameters) for d in directions])
    information = np.maximum(np.einsum("dp,pq,dq->d", changes, a, changes), 1e-12)

    def seen(x: np.ndarray) -> float:
        each = np.tile(x, (len(described.c), 1))
        return float(described.weight @ losses(described, model, groups, parameters, each)[0] / described.scale)

    here = seen(theta)
    for _ in range(PICKS):
        score = changes @ (b - a @ theta)
        best, taken = 0.0, None
        for k in np.argsort(-(score**2) / information)[:LOUD].tolist():
            d, prior = directions[k], prior_of(parameters, [directions[k]])
            for times in MULTIPLES:
                new = np.clip(theta + times * score[k] / information[k] * changes[k], low, high)
                gain = here - seen(new) - new @ prior @ new + theta @ usual @ theta
                if gain > best:
                    best, taken = gain, (new, d)
        if taken is None or best < 2.0 * NAMED_ODDS:
            return theta, []
        d = taken[1]
        alone = taken[0] - theta
        theta, here = taken[0], seen(taken[0])
        if d.cause not in ORDINARY and alone @ usual @ alone > 2.0 * NAMED_ODDS:
            return theta, [d]
    return theta, []


def _one_drive(
    theta: np.ndarray, released: list[Direction], evidence: Evidence, fresh: bool, parameters: list[Parameter],
    refit: Callable[[list[Direction]], tuple[np.ndarray, Evidence, bool]],
    left: Callable[[np.ndarray, list[Direction]], float],
) -> tuple[np.ndarray, list[Direction], Evidence, bool]:  # fmt: skip
    """Of each drive one cause, where the replay is as good with it alone: Kp is much as a stronger motor's."""
    for place in dict.fromkeys(d.where for d in released if d.cause in DRIVE):
        own = [d for d in released if d.cause in DRIVE and d.where == place]
        rest = [d for d in released if d not in own]
        best, least = (theta, released, evidence, fresh), left(theta, released) - 2.0 * NAMED_ODDS * (len(own) > 1)
        for other in directions_of(parameters):
            if other.cause not in DRIVE or other.where != place or len(other.members) != len(own[0].members):
                continue
            if own == [other]:
                continue
            new, seen, near = refit([*rest, other])
            if (value := left(new, [*rest, other])) < least:
                best, least = (new, [*rest, other], seen, near), value
        theta, released, evidence, fresh = best
    return theta, released, evidence, fresh


def _named(
    f: Found, found: list[Found], size: Sizes, evidence: Evidence, parameters: list[Parameter], now: Posterior
) -> NamedCause:
    """A cause with its size and what it explains."""
    values: dict[str, Value] = {}
    first = parameters[f.direction.members[0]]
    others = [x.direction for x in found if x is not f]
    mean, half = float(size.size[f.direction.members[0]]), size.half_width(f.direction, now, parameters)
    low, high = (first.absolute(mean + s * half) for s in (-1.0, 1.0))
    values[first.name] = Value(value=first.absolute(mean), ci95=(low, high), unit=first.unit)
    if first.relative:
        values["factor"] = Value(value=1.0 + mean, ci95=(1.0 + mean - half, 1.0 + mean + half), unit="1")
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
        change={k: float(size.size[k]) for k in f.direction.members},
    )


def _place(direction: Direction, here: str) -> str:
    return direction.cause if direction.where == here else f"{direction.cause} of {direction.where}"


def _foretelling(
    found: list[Found], evidence: Evidence, parameters: list[Parameter]
) -> tuple[list[Found], list[Found]]:
    """Causes without which pieces of the log that took no part are predicted worse, and the others."""

    def without(found: list[Found], tried: list[Found]) -> list[np.ndarray]:
        loss = _foretold(evidence, parameters, found, None)
        return [_foretold(evidence, parameters, found, one) - loss for one in tried]

    return _certain(found, without, evidence, parameters)


def _by_replay(
    found: list[Found], model: ReplayModel, groups: list[Windows], evidence: Evidence, parameters: list[Parameter]
) -> tuple[list[Found], list[Found]]:
    """Causes without which the replay itself, fitted anew, is worse, and those that only its derivatives ask for.

    A step of a leg is far from linear: beside a large fault derivatives blame neighbours for what the replay with
    them does not show.
    """

    def without(found: list[Found], tried: list[Found]) -> list[np.ndarray]:
        q = prior_of(parameters, [f.direction for f in found])
        about, left = evidence, []
        for one in (None, *tried):
            low, high = _allowed(parameters, found, one)
            a, b = about.a.sum(axis=0) / about.scale, about.b.sum(axis=0) / about.scale
            start, _ = within(a + q, b, low, high)
            _, here = replayed(evidence, model, groups, parameters, start)
            theta, here, _ = fit(
                model, groups, parameters, start, here, q, low, high, lambda _: None, steps=PROOF_STEPS, renew=0
            )
            if one is None:
                about = here
            each = np.tile(theta, (len(evidence.c), 1))
            unlikely = evidence.scale * float(theta @ q @ theta) / len(each)
            left.append(evidence.weight * losses(evidence, model, groups, parameters, each)[0] + unlikely)
        broke = ~np.isfinite(left).all(axis=0)
        return [np.where(broke, 0.0, loss - left[0]) for loss in left[1:]]

    return _certain(found, without, evidence, parameters)


def _clear(
    found: list[Found], evidence: Evidence, parameters: list[Parameter],
    alone: Callable[[list[Found]], tuple[Sizes, Evidence]],
) -> tuple[list[Found], list[Found], Sizes, Evidence]:  # fmt: skip
    """Causes whose 95 % intervals leave out what is no fault, and the others, the least clear taken out first.

    ``alone`` fits causes and session's offsets alone; of what is left, its result comes with them.
    """
    found, doubtful = list(found), []
    while True:
        size, near = alone(found)
        now, clear = posterior(evidence, parameters, [f.direction for f in found]), []
        for d in (f.direction for f in found):
            k = d.members[0]
            beyond = abs(size.size[k] - np.clip(size.size[k], *parameters[k].usual))
            clear.append(float(beyond / size.half_width(d, now, parameters)))
        if not found or min(clear) > 1.0:
            return found, doubtful, size, near
        doubtful.append(found.pop(int(np.argmin(clear))))


def _on_windows_of(evidence: Evidence, near: Evidence, free: list[int]) -> Evidence:
    """What ``near`` says of its ``free`` parameters, in the shapes of ``evidence``; nothing of windows it left out."""
    a, b = np.zeros_like(evidence.a), np.zeros_like(evidence.b)
    here, there = np.flatnonzero(near.keep[evidence.keep]), np.flatnonzero(evidence.keep[near.keep])
    own = np.array(free, dtype=int)
    a[np.ix_(here, own, own)], b[np.ix_(here, own)] = near.a[there], near.b[there]
    return replace(evidence, a=a, b=b, scale=near.scale)


def _certain(
    found: list[Found],
    without: Callable[[list[Found], list[Found]], list[np.ndarray]],
    evidence: Evidence,
    parameters: list[Parameter],
) -> tuple[list[Found], list[Found]]:
    """Causes that windows agree on, and the others.

    ``without`` gives what every window, (W,), loses among causes without each of some. The least certain is taken out
    first, and those that were not certain beside it are tried again.
    """
    found, tried, doubtful = list(found), list(found), []
    while tried:
        certain = []
        for f, gain in zip(tried, without(found, tried), strict=True):
            share = float(gain.sum()) / (evidence.samples * len(f.direction.members))
            certain.append(min(_agreement(gain[_acting(f.direction, evidence, parameters)]), share / LEAST_SHARE))
        least = int(np.argmin(certain))
        if certain[least] >= 1.0:
            break
        found.remove(tried[least])
        doubtful.append(tried[least])
        tried = [f for k, f in enumerate(tried) if certain[k] < 1.0 and k != least]
    return found, doubtful


def _acting(d: Direction, evidence: Evidence, parameters: list[Parameter]) -> np.ndarray:
    """Windows that have a say on a direction, shape (N,)."""
    change = vector(d, parameters)[list(d.members)]
    own = evidence.a[:, list(d.members)][:, :, list(d.members)]
    information = np.einsum("wij,i,j->w", own, change, change)
    enough = np.sort(information)[-min(LEAST_WINDOWS, len(information))]
    return np.flatnonzero(information >= min(ACTS * information.mean(), enough))


def _agreement(gain: np.ndarray) -> float:
    """Wilcoxon's signed-rank score over windows, whose gains differ by orders of magnitude, in what is needed of it."""
    ranks, count = stats.rankdata(np.abs(gain)), np.arange(1.0, len(gain) + 1.0)
    needed = min(FORETOLD, NEARLY_ALL * float(count.sum() / np.sqrt((count**2).sum())))
    return float((np.sign(gain) * ranks).sum() / max(np.sqrt((ranks**2).sum()), 1e-12)) / needed


def _foretold(evidence: Evidence, parameters: list[Parameter], found: list[Found], without: Found | None) -> np.ndarray:
    """Squared mismatch of each window, by parameters from the other pieces; ``without`` is held at its description.

    With it each window's part of what the parameters are unlikely by: twelve drives that all settle far beside their
    commands foretell a log of a heavier trunk as well as its mass does.
    """
    q = prior_of(parameters, [f.direction for f in found])
    low, high = _allowed(parameters, found, without)
    loss = np.zeros(len(evidence.c))
    for fold in np.array_split(np.arange(len(loss)), PARTS):
        keep = np.setdiff1d(np.arange(len(loss)), fold)
        a, b = evidence.a[keep].sum(axis=0) / evidence.scale, evidence.b[keep].sum(axis=0) / evidence.scale
        theta, _ = within(a + q, b, low, high)
        loss[fold] = (
            evidence.c[fold] - 2.0 * evidence.b[fold] @ theta
            + np.einsum("wij,i,j->w", evidence.a[fold], theta, theta)
            + evidence.scale * float(theta @ q @ theta) / len(loss)
        )  # fmt: skip
    return loss


def _allowed(parameters: list[Parameter], found: list[Found], without: Found | None) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of causes, and of what a healthy robot may be off beside them, shapes (P,)."""
    low, high = bounds_of(parameters)
    named = {k for f in found for k in f.direction.members}
    for k, p in enumerate(parameters):
        if k not in named and p.cause not in (*ORDINARY, SESSION):
            most = 2.0 * p.spread if p.field != "limit" else 0.0  # a limit acts as soon as it is there
            low[k], high[k] = max(low[k], -most), min(high[k], most)
    if without is not None:
        for k in without.direction.members:
            low[k], high[k] = parameters[k].usual
    return low, high


def _held_out(
    model: ReplayModel, groups: list[Windows], evidence: Evidence, parameters: list[Parameter],
    *fits: tuple[list[Direction], Evidence],
) -> tuple[dict[str, Any], dict[str, tuple[float, float]]]:  # fmt: skip
    """Error of the replay on parts of the log that took no part, before and after, both beside their session's offsets.

    ``fits`` are the causes of each and the evidence about its fit.

    Returns:
        Reduction of the weighted error beside each window's best start, with its interval over parts; and errors before
        and after: ``all`` is that one by reading [1], a channel's and ``q.JOINT`` are RMSE from the logged start.
    """
    theta = np.zeros((2, len(evidence.c), len(parameters)))
    parts = np.array_split(np.arange(len(evidence.c)), PARTS)
    for part in parts:
        rest = np.setdiff1d(np.arange(len(evidence.c)), part)
        for k, (released, near) in enumerate(fits):
            theta[k, part] = sizes(replace(near, a=near.a[rest], b=near.b[rest]), parameters, released)
    both = [losses(evidence, model, groups, parameters, x) for x in theta]
    whole = np.isfinite(both[0][0]) & np.isfinite(both[1][0])  # a replay that broke has no error to compare
    channels = sum(len(x) for x in evidence.sigma.values())
    samples = channels * np.mean([w.t.shape[1] for w in groups])
    by_part = np.array([[loss[part[whole[part]]].sum() for loss, _ in both] for part in parts if whole[part].any()])
    each = 1.0 - np.sqrt(by_part[:, 1] / np.maximum(by_part[:, 0], 1e-12))
    half = stats.t.ppf(0.975, max(len(each) - 1, 1)) * each.std(ddof=1) / np.sqrt(len(each))
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
