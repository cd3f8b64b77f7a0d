"""Causes that a log cannot show, and the motion that would."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mrwarp.robot_logs.causes.cause import Shown
from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.causes.robot_causes import CATALOGUE, NUISANCES
from mrwarp.robot_logs.likelihood import Likelihood, replayed
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.robot_log import RobotLog
from mrwarp.robot_logs.robot_verdict import NamedCause
from mrwarp.robot_logs.selection import Hypothesis, Posterior, bounds_of
from mrwarp.robot_logs.windows import Windows, foot_slipped
from mrwarp.sysid.verdict import NextExperiment

GROUND = tuple(
    name for through in ("trunk", "ground", "imu") for name, cause in CATALOGUE.items() if cause.through == through
)
"""Causes that speak through a moving trunk, ground or an inertial unit."""


MOTIONS = {name: cause.shown for name, cause in CATALOGUE.items() if cause.shown is not None}
"""Motion that shows a cause."""

ARM_MOTIONS = MOTIONS | {
    name: cause.shown_by_arm for name, cause in CATALOGUE.items() if cause.shown_by_arm is not None
}
"""Motions of a robot that cannot walk, as an arm on a table."""

OF_A_BASE = tuple(name for name in GROUND if CATALOGUE[name].through == "trunk")
"""Those of :data:`GROUND` that such a robot has, too: it has no feet, and no inertial sensor moves with it."""

NOT_LOOKED_FOR = {
    "backlash": "a motor's encoder hardly shows play; reverse the joint on a bench under a load that changes sign",
    "hysteresis_law": "a walk hardly shows a device's memory; record the joint on a bench, where laws are compared",
}
"""Causes that no replay of a log tries, why, and what shows them."""

TURNED = (
    "imu_axes: not looked for in robot logs. A unit that is turned on the trunk reads what a turned trunk would: quat, "
    "gyro and acc agree. Lean the trunk forward and see which angle changes"
)
"""Axes of an inertial unit, which no comparison of its own readings shows."""

ON_FEET = (
    "link_com: not looked for on a free robot, whose feet say less of it; hold the trunk and swing the link slowly"
)
"""Where a link's weight sits, which is tried on held robots."""

HALVED = 5
"""Times that the range is halved in which the friction lies that holds the feet: to 3 % of it."""


def friction_that_holds(
    likelihood: Likelihood,
    model: ReplayModel,
    log: RobotLog,
    groups: Sequence[Windows],
    parameters: list[Parameter],
    theta: np.ndarray,
) -> float | None:
    """Friction of the ground beyond which any would have made the same log [1]; None where a foot slipped.

    How well feet hold is known where they slip. Of others the replay excludes what is so low that they would.

    Args:
        likelihood: About ``theta``.
        model: The robot.
        log: Its log.
        groups: The windows of ``likelihood``.
        parameters: P parameters.
        theta: The robot around which the log is judged, shape (P,).
    """
    k = next((k for k, p in enumerate(parameters) if p.declared.needs_slip), None)
    if k is None or foot_slipped(model, log):
        return None

    def left(change: float) -> float:
        new = theta.copy()
        new[k] = change
        return replayed(likelihood, model, groups, parameters, new)[0] / likelihood.scale

    low, high = float(bounds_of(parameters)[0][k]), min(float(theta[k]), 0.0)
    shows = left(high) + 2.0 * likelihood.settings.robot.odds
    for _ in range(HALVED):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if left(middle) > shows else (low, middle)
    return parameters[k].absolute(high)


def cannot_know(
    likelihood: Likelihood,
    parameters: list[Parameter],
    model: ReplayModel,
    log: RobotLog,
    now: Posterior,
    holds: float | None = None,
    shown: Sequence[Hypothesis] = (),
) -> tuple[str, ...]:
    """Causes that no size of interest would have shown in this log, each with the motion to record.

    Args:
        likelihood: What the log says.
        parameters: P parameters.
        model: The robot.
        log: Its log.
        now: The parameters after the selection.
        holds: Friction of the ground beyond which none would have shown, see :func:`friction_that_holds`.
        shown: Causes that the verdict speaks of: named ones, their alternatives and suspects. The log shows them.
    """
    motions, spoken_of = motions_of(model), {k for d in shown for k in d.members}
    found = []
    if not model.free:
        if model.legged:
            found += [f"{cause}: the robot's base was fixed; {motions[cause].what}" for cause in GROUND]
        else:
            found += [f"{cause}: no motion shows it while the robot's base is fixed" for cause in OF_A_BASE]
        said = {d.cause for d in shown if d.where == "robot"}
        for x in NUISANCES.values():
            if x.of_all and x.of_all not in said and x.measured_in not in likelihood.sigma:
                found.append(f"{x.of_all} of robot: {x.unseen}; {motions[x.of_all].what}")
    for cause, where in _unseen(parameters, log, now, spoken_of, slips=holds is None).items():
        found.append(f"{cause}{where}: no size would have shown in this log; {motions[cause].what}")
    found += _not_sought(model, log)
    limits = [p for k, p in enumerate(parameters) if p.declared.limits and k not in spoken_of]
    if above := [
        f"{p.where} beyond {model.asked[p.index]:.3g} N·m"
        for p in limits
        if model.asked[p.index] < (1.0 - p.fault) * _limit(model, p.index)
    ]:
        cause = limits[0].cause
        found.append(f"{cause} of {', '.join(above)}: no more was asked for; {motions[cause].what}")
    for cause in (p.cause for p in parameters if p.declared.needs_slip):
        if holds is not None and not any(d.cause == cause for d in shown):
            found.append(f"{cause} of robot beyond {holds:.2g}: no foot slipped; {motions[cause].what}")
    if log.tau_is == "command":
        found.append("tau is the command: it says nothing of what the motors gave; log a measured torque or current")
    return tuple(found)


def _not_sought(model: ReplayModel, log: RobotLog) -> list[str]:
    """Causes that nothing in this log is tried for, and why."""
    names = [name for name in NOT_LOOKED_FOR if name == "backlash" or model.devices]
    found = [f"{name}: not looked for in robot logs; {NOT_LOOKED_FOR[name]}" for name in names]
    found += [TURNED, ON_FEET] if model.free else []
    sought = not model.free and all("q_des" in run.joint for run in log.runs)
    for cause in CATALOGUE.values():
        if cause.sought and not sought and not (model.free and cause.place == "robot"):
            found.append(f"{cause.name}: not looked for in this log; {cause.sought}")
    return found


def _unseen(
    parameters: Sequence[Parameter], log: RobotLog, now: Posterior, spoken_of: set[int], *, slips: bool
) -> dict[str, str]:
    """Causes of which no size would have shown, with their places in words: none where it showed at no place.

    ``spoken_of`` are parameters that the verdict speaks of; without ``slips`` friction of the ground is another matter.
    """
    asked = np.zeros(log.kp.shape, dtype=bool)
    for run in log.runs:  # one without commands may have had any
        asked |= (run.joint.get("current_cmd", np.ones((1, 1))) > 0.0).any(axis=0)
    unseen: dict[str, dict[str, list[str]]] = {}
    axes: dict[tuple[str, str], int] = {}
    known: dict[str, int] = {}
    for k, p in enumerate(parameters):
        if p.cause not in MOTIONS or p.declared.limits or (p.declared.needs_slip and not slips):
            continue
        information = 1.0 / now.covariance[k, k] - now.precision[k, k]
        sure = k in spoken_of or (
            (not p.declared.needs_current or asked[p.index])
            and information > 0.0
            and 1.0 / np.sqrt(max(information, 1e-30)) < max(2.0 * p.fault, 2.0 * p.least)
        )
        axes[p.cause, p.where] = axes.get((p.cause, p.where), 0) + 1
        known[p.cause] = known.get(p.cause, 0) + int(sure)
        if not sure:
            unseen.setdefault(p.cause, {}).setdefault(p.where, []).append(p.name)

    def of(cause: str) -> str:
        if not known[cause]:
            return ""
        each = [
            where if len(own) == axes[cause, where] else f"{where} along {' and '.join(own)}"
            for where, own in unseen[cause].items()
        ]
        return "" if each == ["robot"] else f" of {', '.join(each)}"

    return {cause: of(cause) for cause in unseen}


def _limit(model: ReplayModel, joint: int) -> float:
    """Largest torque that the description gives a joint [N·m]."""
    return float(model.model.actuator_forcerange[joint, 1]) if model.limited[joint] else np.inf


def motions_of(model: ReplayModel) -> Mapping[str, Shown]:
    """Motion that shows a cause of this robot, by the cause."""
    return MOTIONS if model.free or model.legged else ARM_MOTIONS


def next_experiment(
    causes: Sequence[NamedCause], unknown: Sequence[str], motions: Mapping[str, Shown] = MOTIONS
) -> NextExperiment | None:
    """The motion that separates the first cause from its alternatives, or shows the first of what cannot be known.

    ``unknown`` are sentences of :func:`cannot_know`, ``motions`` those of the robot, see :func:`motions_of`.
    """
    for cause in causes:
        rivals = [x.partition(" of ")[0] for x in cause.alternatives]
        if rivals:
            return _experiment(rivals[0], (cause.name, *rivals), motions)
    for text in unknown:
        name = text.partition(":")[0].partition(" of ")[0]
        if name in motions and text.endswith(motions[name].what):
            same = [x.partition(":")[0] for x in unknown if x.endswith(motions[name].what)]
            return _experiment(name, tuple(x.partition(" of ")[0] for x in same), motions)
    return None


def _experiment(cause: str, separates: tuple[str, ...], motions: Mapping[str, Shown]) -> NextExperiment:
    shown = motions[cause]
    return NextExperiment(
        what=shown.what, seconds=shown.seconds, separates=separates, kind=cause, settings=dict(shown.record)
    )
