"""Whether a log's torque channel is a torque: its regression on what rigid bodies need, by gravity and by inertia.

One regression per joint, with parts of the log as the units of chance. A robot that floats moves in ways that no rigid
body's torque is known for: its channel is compared with what commands ask for. A channel that is no torque in
N·m, or follows nothing, is left out with the reason; smaller contradictions are causes of the channel, which the
likelihood weighs against all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from mrwarp.robot_logs.causes.of_channels import EXPLAINED, SMOOTHED, SPEAKS, UNLIKE
from mrwarp.robot_logs.causes.places import torque_scale
from mrwarp.robot_logs.channels.joint_torque import JointTorques, asked_torque, torques_along
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.robot_log import LogRun, RobotLog, reads_torque
from mrwarp.sysid.jackknife import jackknife, student
from mrwarp.sysid.left_out import in_a_row


class Fit(NamedTuple):
    """Regression of a channel."""

    value: np.ndarray
    """Coefficients of the references, shape (R,)."""
    half: np.ndarray
    """Half of their 95 % intervals, shape (R,)."""
    explained: float
    """Share of the variance [1]."""


def regressed(y: np.ndarray, references: Sequence[np.ndarray], others: Sequence[np.ndarray], parts: int) -> Fit:
    """Least squares of ``y``, (N,), on references and other regressors, (N,) each, with an offset.

    Intervals are of the jackknife over ``parts`` neighbouring parts.
    """
    x = np.stack([*references, *others, np.ones(len(y))], axis=1)
    folds = in_a_row(len(y), parts)
    grams = np.stack([np.column_stack([x[f], y[f]]).T @ np.column_stack([x[f], y[f]]) for f in folds])
    count = x.shape[1]
    tiny = 1e-9 * np.diag(np.diag(grams.sum(axis=0))[:count] + 1e-12)

    def solved(g: np.ndarray) -> np.ndarray:
        return np.linalg.solve(g[:count, :count] + tiny, g[:count, count])

    whole = solved(grams.sum(axis=0))
    error = np.sqrt(np.diag(jackknife(np.stack([solved(grams.sum(axis=0) - g) for g in grams]))))
    left = float(((y - x @ whole) ** 2).sum() / max(((y - y.mean()) ** 2).sum(), 1e-300))
    own = slice(0, len(references))
    return Fit(whole[own], student(0.95, parts - 1) * error[own], 1.0 - left)


def consistent(model: ReplayModel, log: RobotLog) -> RobotLog:
    """The log without torque channels that are no torque, each with a note of what it is and the remedy."""
    runs = [run for run in log.runs if reads_torque(log, run)]
    if not runs:
        return log
    if model.free:
        wrong = _unlike_commands(model, log, runs)
    else:
        along = [torques_along(model, log, run, SMOOTHED) for run in runs]
        every = {joint: _contradiction(model, log, along, j) for j, joint in enumerate(log.joints)}
        wrong = {joint: text for joint, text in every.items() if text}
    if not wrong:
        return log
    out = [log.joints.index(joint) for joint in wrong]
    left = []
    for run in log.runs:
        tau = run.joint.get("tau")
        if tau is not None:
            tau = tau.copy()
            tau[:, out] = np.nan
        left.append(run if tau is None else replace(run, joint={**run.joint, "tau": tau}))
    groups: dict[str, list[str]] = {}
    for joint, text in wrong.items():
        groups.setdefault(text, []).append(joint)
    notes = [f"tau of {', '.join(joints)} {text}; it is left out" for text, joints in groups.items()]
    return replace(log, runs=tuple(left), notes=(*log.notes, *notes))


def _unlike_commands(model: ReplayModel, log: RobotLog, runs: Sequence[LogRun]) -> dict[str, str]:
    """Joints whose channel cannot be the torque that commands ask for, each with the reason."""
    pairs = []
    for run in runs:
        speed = run.joint["qd"] if "qd" in run.joint else np.gradient(run.joint["q"], run.t, axis=0)
        asked, size = asked_torque(log, run, np.nan_to_num(speed)), max(1, round(SMOOTHED / run.dt))
        pairs.append(uniform_filter1d(np.stack([run.joint["tau"], asked]), size, axis=1))
    read, asked = np.concatenate(pairs, axis=1)
    sizes: dict[int, float] = {}
    for j, (y, x) in enumerate(zip(read.T, asked.T, strict=True)):
        if np.isfinite(y).all() and x.std() > SPEAKS * torque_scale(model, log, j):
            fit = regressed(y, [x], [], model.settings.robot.parts)
            if fit.explained > EXPLAINED and abs(fit.value[0]) > fit.half[0]:
                sizes[j] = float(fit.value[0])
    other = [size for size in sizes.values() if size > 0.0 and not 1.0 / UNLIKE < size < UNLIKE]
    turned = "turns the other way than what commands ask for: change its sign"
    span = dict.fromkeys(f"{f(other, default=0.0):.2g}" for f in (min, max))
    unit = (
        f"is {' to '.join(span)} times what targets and gains ask for: a "
        "current or a percentage, not N·m, or gains of another unit; convert it, declare its unit in units, or write "
        '"tau_is": "none"'
    )
    return {log.joints[j]: turned if size < 0.0 else unit for j, size in sizes.items() if size < 0.0 or size in other}


def _contradiction(model: ReplayModel, log: RobotLog, along: Sequence[JointTorques], j: int) -> str:
    """Why a joint's channel is no torque, in words; empty where it is one."""

    def of(name: str) -> np.ndarray:
        return np.concatenate([getattr(x, name)[:, j] for x in along])

    y, gravity, inertial = of("read"), of("gravity"), of("inertial")
    if max(gravity.std(), inertial.std()) < SPEAKS * torque_scale(model, log, j) or not np.isfinite(y).all():
        return ""
    fit = regressed(y, [gravity, inertial], [of("rubbed"), of("qd")], model.settings.robot.parts)
    if fit.explained < 1.0 - EXPLAINED:
        return "does not follow what the links need: another joint's, or no torque"
    each = zip(fit.value.tolist(), fit.half.tolist(), ("gravity", "inertial"), strict=True)
    known = [(v, h, name) for v, h, name in each if abs(v) > h]
    if fit.explained < EXPLAINED or not known:
        return ""
    size, _, name = min(known, key=lambda x: x[1] / abs(x[0]))
    if all(v + h < 0.0 for v, h, _ in known):
        return "turns the other way than what the links need: change its sign"
    if all(abs(v) < 1.0 / UNLIKE for v, _, _ in known) or all(abs(v) > UNLIKE for v, _, _ in known):
        return (
            f"is {size:.2g} of the {name} torque: a current or a percentage, not N·m; convert it, declare its unit in "
            'units, or write "tau_is": "none"'
        )
    return ""
