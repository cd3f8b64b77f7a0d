"""Forces on the robot that no cause explains: the force that each window needs on top of the model, where and when.

Every window is replayed with a constant force on the trunk and a constant torque in each joint, next to the unknown
start. What a found cause explains acts already.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.likelihood import Likelihood
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.robot_log import RobotLog
from mrwarp.robot_logs.selection import Hypothesis
from mrwarp.robot_logs.slopes import DERIVATIVE_STEP, START_SPREAD
from mrwarp.robot_logs.window_replay import ParameterBatch, Replay, nuisances
from mrwarp.robot_logs.windows import Windows, mismatch
from mrwarp.sysid.settings import Robot
from mrwarp.sysid.verdict import Unexplained

STEP = 0.02
"""Forces by which derivatives are taken, as a share of the robot's weight and of the most a joint was asked for."""

MOST_TIMES = 6
"""Most times of pieces that a sentence lists."""


@dataclass(frozen=True, kw_only=True)
class Outside(Unexplained):
    """A force that no cause of the catalogue gives."""

    where: str
    """Joint, or the body that it pushes."""
    when: tuple[tuple[str, float, float], ...]
    """Recording, begin and end [s]."""
    peak: tuple[float, ...]
    """Largest of these windows: of the trunk x, y, z in the world's axes [N], of a joint its torque [N·m]."""


@dataclass(frozen=True, kw_only=True)
class Pushes:
    """Constant forces in addition to the model in each of W windows, at D places: the trunk, and each joint."""

    where: tuple[str, ...]
    size: tuple[np.ndarray, ...]
    """Likeliest force of each place minus that of the median window, which a weight or an offset gives as well: of the
    trunk x, y, z [N] in the world's axes, of a joint its torque [N·m]; shapes (3, W) and (1, W)."""
    share: np.ndarray
    """Part of each window's mismatch that a place's force explains, shape (D, W)."""


def pushes(
    likelihood: Likelihood,
    model: ReplayModel,
    groups: Sequence[Windows],
    parameters: list[Parameter],
    theta: np.ndarray,
) -> Pushes:
    """Forces that windows ask for about ``theta``, shape (P,), those too that do not count as evidence."""
    mj = model.model
    step = STEP * np.maximum(model.asked, 0.1)
    places = [(j, [(int(v), s)]) for j, v, s in zip(model.joints, model.v_adr, step.tolist(), strict=True)]
    if model.free:
        first = int(mj.jnt_dofadr[mj.body_jntadr[model.trunk]])
        push = STEP * 9.81 * float(mj.body_subtreemass[model.trunk])
        places.insert(0, (model.body_name(model.trunk), [(first + k, push) for k in range(3)]))
    found: list[list[tuple[np.ndarray, ...]]] = [[] for _ in places]
    rare = [likelihood.scale * (STEP / likelihood.settings.robot.push / members[0][1]) ** 2 for _, members in places]
    for windows, slopes in zip(groups, likelihood.slopes, strict=True):
        left = mismatch(windows.measured, _replayed(Replay(model, windows), parameters, theta, 0, 0.0))
        coarse = Replay(model, windows.coarse(max(1, int(np.floor(DERIVATIVE_STEP / windows.h + 1e-6)))))
        base = _replayed(coarse, parameters, theta, 0, 0.0)
        r, starts = _scaled(left, likelihood), slopes.z / slopes.scale(likelihood.sigma)
        begin = np.linalg.inv(starts @ starts.mT + np.eye(starts.shape[1]) / START_SPREAD**2)
        r0 = (starts @ r[..., None])[..., 0]
        c = np.maximum((r**2).sum(axis=1) - np.einsum("wi,wij,wj->w", r0, begin, r0), 1e-12)
        for (_, members), rows, few in zip(places, found, rare, strict=True):
            slopes = [mismatch(_replayed(coarse, parameters, theta, dof, s), base) for dof, s in members]
            f = np.stack([_scaled(x, likelihood) / s for x, (_, s) in zip(slopes, members, strict=True)], axis=1)
            across = begin @ (starts @ f.mT)
            a = f @ f.mT - (f @ starts.mT) @ across
            b = (f @ r[..., None])[..., 0] - np.einsum("wzi,wz->wi", across, r0)
            size = np.linalg.solve(a + few * np.eye(len(members)), b[..., None])[..., 0]
            rows.append((a, size, c - 2.0 * (size * b).sum(axis=1) + np.einsum("wi,wij,wj->w", size, a, size)))
    sizes, shares = [], []
    for rows in found:
        a, size, left = (np.concatenate(x) for x in zip(*rows, strict=True))
        size = size - np.median(size, axis=0)
        gain = np.einsum("wi,wij,wj->w", size, a, size)
        sizes.append(size.T)
        shares.append(gain / np.maximum(gain + left, 1e-12))
    return Pushes(where=tuple(name for name, _ in places), size=tuple(sizes), share=np.stack(shares))


def outside(found: Pushes, groups: Sequence[Windows], log: RobotLog, settings: Robot) -> Outside | None:
    """Where and when windows one after the other ask for a force: the place that explains most, or None."""
    run, start = (np.concatenate([getattr(w, name) for w in groups]) for name in ("run", "start"))
    length = np.concatenate([w.t[:, -1] for w in groups])
    order = np.lexsort((start, run))
    best, most = None, 0.0
    for k, place in enumerate(found.where):
        rows = _in_a_row(found.share[k][order] >= settings.push_share, run[order], settings.push_windows)
        windows = [order[list(part)] for part in rows]
        if (share := sum(float(found.share[k][part].sum()) for part in windows)) > most:
            best, most = (k, place, windows), share
    if best is None:
        return None
    k, place, windows = best
    when = []
    for part in windows:
        t = log.runs[run[part[0]]].t
        end = t[start[part[-1]]] + length[part[-1]]
        when.append((log.runs[run[part[0]]].id, float(t[start[part[0]]]), float(end)))
    every = found.size[k][:, np.concatenate(windows)]
    peak = tuple(float(x) for x in every[:, int(np.argmax(np.linalg.norm(every, axis=0)))])
    size = ", ".join(f"{x:+.3g}" for x in peak)
    what = f"a torque in {place} of up to {size} N·m"
    if len(peak) > 1:
        what = f"a force on {place} of up to {size} N along x, y, z"
    at = listed([f"{begin:.1f} to {end:.1f} s of {name}" for name, begin, end in when])
    return Outside(
        depends_on=("time",),
        form=f"{what}, at {at}",
        share=float(found.share[k].mean()),
        where=place,
        when=tuple(when),
        peak=peak,
    )


def steady(hypothesis: Hypothesis, value: float, share: float, log: RobotLog, parameters: list[Parameter]) -> Outside:
    """Effects outside the catalogue that act all the time, see :data:`mrwarp.robot_logs.causes.robot_causes.OUTSIDE`.

    Args:
        hypothesis: What was found.
        value: Its number, in the unit of its parameter.
        share: Part of the mismatch that it explains [1].
        log: The log.
        parameters: All of them.
    """
    p = parameters[hypothesis.members[0]]
    assert p.declared.says is not None
    what = f"{p.declared.outside} {p.where} {p.declared.says(value, p.name)}"
    when = tuple((run.id, float(run.t[0]), float(run.t[-1])) for run in log.runs)
    return Outside(depends_on=("place",), form=what, share=share, where=p.where, when=when, peak=(value,))


def unconfirmed(model: ReplayModel, parameters: list[Parameter], log: RobotLog, left: float) -> Outside | None:
    """A motion that the log does not have and that the replay does not confirm in nearly all windows, if there is one.

    Its torque follows from a frequency and a damping; a link's and a base's own change with the pose. Where the named
    causes leave less of the squared error than it would have explained, ``left`` [1], it stood for one of them.
    """
    p = next((p for p in parameters if p.declared.sought), None)
    if model.hidden is None or p is None or p.declared.says is None or left < model.hidden.share:
        return None
    place = "" if p.where == "robot" else f"{p.where}: "
    other = f" (or {', '.join(p.others)})" if p.others else ""
    return Outside(
        depends_on=("time",),
        form=f"{place}{p.declared.says(model.hidden.frequency, p.name)}, about{other}",
        share=model.hidden.share,
        where=p.where,
        when=tuple((run.id, float(run.t[0]), float(run.t[-1])) for run in log.runs),
        peak=(model.hidden.frequency,),
    )


def joined(found: Sequence[Outside]) -> Outside | None:
    """All that no cause explains as one, at the place of the first; None where there is nothing."""
    if not found:
        return None
    first = found[0]
    return replace(
        first,
        form="; ".join(x.form for x in found),
        share=min(sum(x.share for x in found), 1.0),
        depends_on=tuple(dict.fromkeys(name for x in found for name in x.depends_on)),
    )


def listed(places: Sequence[str]) -> str:
    """The first :data:`MOST_TIMES` of them in words, and how many more there are."""
    more = len(places) - MOST_TIMES
    return ", ".join(places[:MOST_TIMES]) + (f" and {more} more" if more > 0 else "")


def _in_a_row(clear: np.ndarray, run: np.ndarray, least: int) -> list[list[int]]:
    """At least so many windows that are clear one after the other in one run; both shape (W,)."""
    pieces = [list(own) for _, own in groupby(range(len(clear)), key=lambda i: (run[i], clear[i]))]
    return [own for own in pieces if clear[own[0]] and len(own) >= least]


def _replayed(
    replay: Replay, parameters: list[Parameter], theta: np.ndarray, dof: int, push: float
) -> dict[str, np.ndarray]:
    """All windows with a force along one degree of freedom."""
    count = replay.windows.count
    changes = ParameterBatch.of(parameters, np.tile(theta, (count, 1)), replay.model)
    changes.fields["push"] = np.zeros((count, replay.model.model.nv))
    changes.fields["push"][:, dof] = push
    return replay.run(changes, np.arange(count), np.zeros((count, len(nuisances(replay.model)))))


def _scaled(x: dict[str, np.ndarray], likelihood: Likelihood) -> np.ndarray:
    """All channels in units of what is left in them, one row a window; 0 where there is no reading."""
    return np.concatenate([np.nan_to_num(x[n] / s).reshape(len(x[n]), -1) for n, s in likelihood.sigma.items()], axis=1)
