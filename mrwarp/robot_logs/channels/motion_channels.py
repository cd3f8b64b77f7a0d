"""Whether angles, speeds, stamps and targets of a log show one motion: regressions of each joint, before any replay.

Over a tenth of a second the mean of the logged speed is the change of the angle over the stamps. What is another number
of times that, comes late, or belongs to another joint is no reading of the speed: it is left out, with its size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from mrwarp.robot_logs.causes.of_channels import EXPLAINED, LATE, SMOOTHED, STANDSTILL
from mrwarp.robot_logs.channels.torque_channel import Fit, regressed
from mrwarp.robot_logs.robot_log import LogError, LogRun, RobotLog
from mrwarp.sysid.settings import Settings


def one_motion(log: RobotLog, settings: Settings) -> RobotLog:
    """The log without speeds that contradict their angles, with a note on each.

    Raises:
        LogError: joints follow each other's targets.
    """
    _check_targets(log, settings)
    wrong = _wrong_speeds(log, settings)
    if not wrong:
        return log
    out = [log.joints.index(joint) for joint in wrong]
    runs = []
    for run in log.runs:
        if "qd" in run.joint:
            qd = run.joint["qd"].copy()
            qd[:, out] = np.nan
            run = replace(run, joint={**run.joint, "qd": qd})
        runs.append(run)
    groups: dict[str, list[str]] = {}
    for joint, text in wrong.items():
        groups.setdefault(text, []).append(joint)
    notes = [f"qd of {', '.join(joints)} {text}; it is left out" for text, joints in groups.items()]
    return replace(log, runs=tuple(runs), notes=(*log.notes, *notes))


def _wrong_speeds(log: RobotLog, settings: Settings) -> dict[str, str]:
    """Joints whose speed is none of theirs, each with what it is instead."""
    parts, tolerated = settings.robot.parts, settings.gain.detail
    runs = [run for run in log.runs if "qd" in run.joint]
    motions = [_changes(run) for run in runs]
    if not motions:
        return {}
    changes, faster, speeds = (np.concatenate(columns) for columns in zip(*motions, strict=True))
    there = [j for j in range(len(log.joints)) if np.isfinite(speeds[:, j]).all() and changes[:, j].std() > STANDSTILL]
    fits = {j: regressed(speeds[:, j], [changes[:, j], faster[:, j]], [], parts) for j in there}
    wrong = {j: fit for j, fit in fits.items() if abs(fit.value[0] - 1.0) - fit.half[0] > tolerated}
    if common := _in_common(fits, wrong, tolerated):
        return {log.joints[j]: common for j in wrong}
    texts = {j: _instead(j, fit, log.joints, changes, speeds, settings) for j, fit in wrong.items()}
    for j in fits.keys() - wrong.keys():  # x(t - late) is x - late * its rate, to first order
        late, half = -fits[j].value[1] / fits[j].value[0], fits[j].half[1] / abs(fits[j].value[0])
        if abs(late) - half > LATE:
            when = "after" if late > 0.0 else "before"
            texts[j] = f"comes {1e3 * abs(late):.0f} ms {when} the change of its angle: filtered, or of another clock"
    return {log.joints[j]: texts[j] for j in sorted(texts)}


def _in_common(fits: dict[int, Fit], wrong: dict[int, Fit], tolerated: float) -> str:
    """The one factor by which all speeds differ from their angles, in words; empty where there is none."""
    factors = np.array([fit.value[0] for fit in wrong.values()])
    if not len(factors) or len(wrong) < len(fits) or min(fit.explained for fit in wrong.values()) < EXPLAINED:
        return ""
    middle = float(np.median(factors))
    if np.abs(factors / middle - 1.0).max() > tolerated:
        return ""
    return (
        f"is {middle:.3g} times the change of the angle, as that of every joint that moves: either the stamps count "
        f"{middle:.3g} times the time that passed, or all speeds have another unit; declare the unit of t or of qd"
    )


def _instead(
    j: int, fit: Fit, joints: Sequence[str], changes: np.ndarray, speeds: np.ndarray, settings: Settings
) -> str:
    """A reading that is not the change of its angle, in words: its factor, whose it is, or neither."""
    size, half = float(fit.value[0]), float(fit.half[0])
    follows = [regressed(speeds[:, j], [x], [], settings.robot.parts).explained for x in changes.T]
    if follows[j] >= settings.gain.half:
        return (
            f"is {size:.3g} times the change of its angle (95 %: {size - half:.3g} to {size + half:.3g}): that of the "
            "motor's side, or another unit"
        )
    if follows[best := int(np.argmax(follows))] > EXPLAINED:
        return f"follows the angle of {joints[best]}: columns that changed places"
    return "does not follow the change of its angle: another joint's, or no speed"


def _changes(run: LogRun) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Change of the angles over the stamps, its rate, and the mean of the logged speeds, shape (M, J) each.

    Without stretches that reach over a gap, or where an angle begins again at its other end.
    """
    q, t, qd = run.joint["q"], run.t, run.joint["qd"]
    step = min(max(1, round(SMOOTHED / run.dt)), run.samples - 1)
    time = t[step:] - t[:-step]
    path = cumulative_trapezoid(qd, t, axis=0, initial=0.0)
    change, mean = (((x[step:] - x[:-step]) / time[:, None]) for x in (q, path))
    jumps = np.concatenate([[0.0], np.cumsum((np.abs(np.diff(q, axis=0)) > np.pi).any(axis=1))])
    whole = (time < 1.5 * step * run.dt) & (jumps[step:] == jumps[:-step])
    faster = np.gradient(change, 0.5 * (t[step:] + t[:-step]), axis=0) if len(change) > 1 else 0.0 * change
    return change[whole], faster[whole], mean[whole]


def _check_targets(log: RobotLog, settings: Settings) -> None:
    """Refuse targets that changed places: two joints of which one follows the other's, and neither its own."""
    for j, i, own, other in _followed(log, settings.gain.half):
        a, b = log.joints[j], log.joints[i]
        raise LogError(
            f"{log.path}: {a} follows the target of {b}, not its own ({100.0 * other:.0f} and {100.0 * own:.0f} % of "
            f"its motion): q_des of {a} and {b} changed places; write each under its joint's name"
        )


def _followed(log: RobotLog, half: float) -> Iterator[tuple[int, int, float, float]]:
    """Joints, those whose target they follow, and the shares of their motion that follow their own and that one."""
    runs = [run.joint for run in log.runs if "q_des" in run.joint]
    if not runs:
        return
    q, target = (np.concatenate([x[name] - x[name].mean(axis=0) for x in runs]) for name in ("q", "q_des"))
    moving = np.isfinite(target).all(axis=0) & (np.minimum(q.std(axis=0), target.std(axis=0)) > STANDSTILL * SMOOTHED)
    where = np.flatnonzero(moving)
    shares = np.corrcoef(q[:, where].T, target[:, where].T)[: len(where), len(where) :] ** 2 if len(where) else None
    for a, j in enumerate(where):
        assert shares is not None
        b = int(np.argmax(shares[a]))
        if shares[a, a] < half and shares[b, b] < half and shares[a, b] > EXPLAINED:
            yield int(j), int(where[b]), float(shares[a, a]), float(shares[a, b])
