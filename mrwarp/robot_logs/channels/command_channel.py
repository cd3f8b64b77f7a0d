"""Whether a log's targets are what the drives were asked for: they have to ask for the torque that it takes.

A joint that rests asks for ``kp*(q_des - q) + tau_ff``, which is the torque of gravity (held robots) or of the torque
channel, up to dry friction. So the target that a rest needs is known. A target that is another number of times it,
turns the other way, is off by a constant, stands still or is that of another joint is refused, with its size.

Where the torque channel reads what targets ask for, they are right. If the links do not need that torque, a hand or
another force from outside has the rest: these rows are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.signal import lfilter

from mrwarp.robot_logs.causes.of_channels import EXPLAINED, SMOOTHED, STANDSTILL, UNLIKE
from mrwarp.robot_logs.causes.places import torque_scale, turns
from mrwarp.robot_logs.channels.joint_torque import JointTorques, gain_along, gravity_along, torques_along
from mrwarp.robot_logs.replay_model import LONGEST_DELAY, ReplayModel
from mrwarp.robot_logs.robot_log import MIN_SAMPLES, UNITS, LogError, LogRun, RobotLog, reads_torque
from mrwarp.sysid.least_squares import minimum_within


class Rests(NamedTuple):
    """Rows in which a joint rests, R of all recordings."""

    angle: np.ndarray
    """[rad], shape (R,)."""
    target: np.ndarray
    """As logged [rad], shape (R,)."""
    needed: np.ndarray
    """Targets that each joint's angle and torque need [rad], shape (R, J); NaN where no gain is known."""
    stiffness: float
    """Gain of the joint [N·m/rad]."""


def check_commands(model: ReplayModel, log: RobotLog) -> RobotLog:
    """The log without rows in which a hand moves joints against their targets, with a note.

    Targets that ask resting joints for another torque than they take are refused where another reading explains it.

    Raises:
        LogError: a joint's target is in another unit or turned, off by a constant, frozen, or another joint's; or all
            act at another time than any replay looks for; or a hand moves the robot all the time.
    """
    log = _let_go(model, log)
    runs = [run for run in log.runs if "q_des" in run.joint and (not model.free or reads_torque(log, run))]
    every = [_along(model, log, run) for run in runs]
    wrong: dict[str, list[str]] = {}
    for j, joint in enumerate(log.joints if every else ()):
        rests = _rests(every, j)
        if len(rests.target) > model.settings.robot.parts and (text := _contradiction(model, log, j, rests)):
            wrong.setdefault(text, []).append(joint)
    if wrong:
        said = "; ".join(f"q_des of {', '.join(joints)} {text}" for text, joints in wrong.items())
        raise LogError(f"{log.path}: {said}")
    if not model.free and (text := _late(model, log, runs)):
        raise LogError(f"{log.path}: q_des {text}")
    return log


def _let_go(model: ReplayModel, log: RobotLog) -> RobotLog:
    """The log of a held robot without rows in which drives give what is asked for and the links need another torque.

    Recordings are cut there. Rows that the smoothing mixes with them go, too.

    Raises:
        LogError: nothing is left.
    """
    runs = () if model.free else [run for run in log.runs if reads_torque(log, run)]
    along = [torques_along(model, log, run, SMOOTHED) for run in runs]
    held = [j for j in range(len(log.joints)) if along and _pushed(model, log, along, j)]
    if not held:
        return log
    least = [model.settings.gain.detail * torque_scale(model, log, j) for j in held]
    left, seconds = [run for run in log.runs if not reads_torque(log, run)], 0.0
    for run, x in zip(runs, along, strict=True):
        other = (np.abs(x.asked - x.rigid)[:, held] > least).any(axis=1)
        out = maximum_filter1d(other, 2 * round(3.0 * SMOOTHED / run.dt) + 1)
        seconds += float(out.sum()) * run.dt
        ends = np.flatnonzero(np.diff(np.append(True, np.append(out, True)).astype(int))).reshape(-1, 2).tolist()
        left += [_piece(run, first, end) for first, end in ends if end - first >= MIN_SAMPLES]
    what = (
        f"a hand or another force from outside moves {', '.join(log.joints[j] for j in held)}: the torque read is what "
        f"q_des asks for, and the links need another; {seconds:.1f} s of this are left out"
    )
    if not left:
        raise LogError(f"{log.path}: {what}, and nothing is left; record the robot without it")
    return replace(log, runs=tuple(left), notes=(*log.notes, what))


def _pushed(model: ReplayModel, log: RobotLog, along: Sequence[JointTorques], j: int) -> bool:
    """Whether a joint's drive gives the torque that is asked for, most of which no links, friction or spring need.

    Links may be up to :data:`UNLIKE` times what they are described as. What rubs or springs back turns against the
    motion; a target that stands still while a hand turns the joint asks the other way.
    """

    def of(name: str) -> np.ndarray:
        return np.concatenate([getattr(x, name)[:, j] for x in along])

    asked, read, q, qd = of("asked"), of("read"), of("q"), of("qd")
    if not np.isfinite(read).all():
        return False
    needs = np.stack([of("gravity"), of("inertial"), of("rubbed"), qd, q, np.ones(len(q))], axis=1)
    low, most = np.append(np.zeros(5), -np.inf), np.append([UNLIKE, UNLIKE], np.full(4, np.inf))
    # the weight on a vertical slide is a constant, too, so that its share is not known
    fit, _ = minimum_within(needs.T @ needs, needs.T @ asked, low, most)
    left = float(((asked - needs @ fit) ** 2).mean())
    gain, scale = model.settings.gain, torque_scale(model, log, j)
    large = left > max(gain.half * float(asked.var()), (gain.detail * scale) ** 2)
    return large and float(((read - asked) ** 2).mean()) < (1.0 - EXPLAINED) * left


def _piece(run: LogRun, first: int, end: int) -> LogRun:
    """Rows of a recording, from ``first`` to before ``end``; the recording itself where these are all."""
    if end - first == run.samples:
        return run
    rows = slice(first, end)
    joint, base, feet = ({name: x[rows] for name, x in own.items()} for own in (run.joint, run.base, run.feet))
    battery = None if run.battery is None else run.battery[rows]
    name, t = f"{run.id} from {run.t[first]:.2f} s", run.t[rows] - run.t[first]
    return LogRun(id=name, t=t, joint=joint, base=base, feet=feet, battery=battery)


def _late(model: ReplayModel, log: RobotLog, runs: Sequence[LogRun]) -> str:
    """How much later than any replay looks back targets act, in words; empty where they do not.

    By the least squares between the torque that shifted targets ask for and the one that rigid bodies need. Where a
    first-order lag of the targets does as well, the replay looks for that.
    """
    scale = np.array([torque_scale(model, log, j) for j in range(len(log.joints))])
    most = 20.0 * LONGEST_DELAY
    times = np.linspace(-most, most, 81)
    left, lagged = np.zeros(len(times)), np.full(len(times), np.inf)
    lagged[times > 0.0] = 0.0
    for run in runs:
        x, target = torques_along(model, log, run, SMOOTHED), np.nan_to_num(run.joint["q_des"])
        inner = (run.t > most) & (run.t < run.t[-1] - most)
        gain = gain_along(log, run, "kp")[inner]
        rest = x.asked[inner] - x.rigid[inner] - gain * target[inner]
        for k, late in enumerate(times):
            row = np.maximum(np.searchsorted(run.t, run.t[inner] - late, side="right") - 1, 0)
            left[k] += float((((rest + gain * target[row]) / scale) ** 2).sum())
            if late > 0.0:
                part = 1.0 - np.exp(-run.dt / late)
                slow = target[0] + lfilter([part], [1.0, part - 1.0], target - target[0], axis=0)
                lagged[k] += float((((rest + gain * slow[inner]) / scale) ** 2).sum())
    late, least, now = float(times[np.argmin(left)]), float(left.min()), float(left[len(times) // 2])
    if abs(late) <= LONGEST_DELAY or least > (1.0 - EXPLAINED) * now or lagged.min() <= least:
        return ""
    when = "after" if late > 0.0 else "before"
    return (
        f"acts {1e3 * abs(late):.0f} ms {when} its row, which explains {100.0 * (1.0 - least / now):.0f} % of the "
        "torque that rigid bodies leave: log commands and readings by one clock, or shift its stamps"
    )


def _along(model: ReplayModel, log: RobotLog, run: LogRun) -> tuple[np.ndarray, ...]:
    """Which joints rest, angles, targets, needed ones and gains in a row each tenth of a second, (N, J) each."""
    step = max(1, round(SMOOTHED / run.dt))
    mean = np.abs(run.joint["q"][step:] - run.joint["q"][:-step]) / (run.t[step:] - run.t[:-step])[:, None]
    rows = np.arange(step, run.samples - step, step)
    moves = maximum_filter1d(np.pad(mean, ((0, run.samples - len(mean)), (0, 0)), mode="edge"), 3 * step, axis=0)
    joint, kp = {name: x[rows] for name, x in run.joint.items()}, gain_along(log, run, "kp")[rows]
    given = np.nan_to_num(joint.get("tau_ff", np.zeros(kp.shape)))
    takes = joint["tau"] if model.free else gravity_along(model, joint["q"])
    needed = joint["q"] + (takes - given) / np.where(kp > 0.0, kp, np.nan)
    return moves[rows] < STANDSTILL * turns(model), joint["q"], joint["q_des"], needed, kp


def _rests(every: list[tuple[np.ndarray, ...]], j: int) -> Rests:
    """Rows of a joint's rests, for which its target and the need of it are known."""
    known = [rest[:, j] & np.isfinite(target[:, j] + needed[:, j]) for rest, _, target, needed, _ in every]
    angle, target, needed, kp = (
        np.concatenate([own[k][rows] for own, rows in zip(every, known, strict=True)]) for k in range(1, 5)
    )
    return Rests(angle[:, j], target[:, j], needed, float(np.median(kp[:, j])) if len(kp) else 0.0)


def _contradiction(model: ReplayModel, log: RobotLog, j: int, rests: Rests) -> str:
    """Why targets cannot be what a joint was asked for, in words; empty where they can, or nothing explains it."""
    gain, target, own = model.settings.gain, rests.target, rests.needed[:, j]
    scale, spread = torque_scale(model, log, j), own.std()
    if rests.stiffness * min(rests.angle.std(), spread) < gain.detail * scale:  # it rests at about one angle
        return ""
    slope, share = _slope(target, own)
    if share > EXPLAINED and slope < 0.0:
        return f"is {slope:.3g} times what its rests need ({100.0 * share:.0f} % of it): change its sign"
    if share > EXPLAINED and not 1.0 / UNLIKE < slope < UNLIKE:
        unit = [name for name, size in UNITS["q_des"].items() if abs(slope * size - 1.0) < 0.1]
        remedy = (
            f'declare "units": {{"q_des": "{unit[0]}"}}' if unit else "another unit, or the motor's side: convert it"
        )
        return f"is {slope:.3g} times what its rests need ({100.0 * share:.0f} % of it): {remedy}"
    off = float(np.median(target - own))
    left = float(((target - own - off) ** 2).mean()) / spread**2
    if left > 1.0 - gain.detail:
        if np.ptp(target) == 0.0:
            low, high = rests.angle.min(), rests.angle.max()
            return (
                f"stands still while it rests from {low:.3g} to {high:.3g} rad: no command, or a hand moved it; a "
                "measured torque (tau, tau_is) would show which, or cut these rows"
            )
        shares = [_slope(target, x)[1] if np.isfinite(x).all() else 0.0 for x in rests.needed.T]
        best = int(np.argmax(shares))
        slope = _slope(target, rests.needed[:, best])[0]
        if shares[best] > EXPLAINED and 1.0 / UNLIKE < slope < UNLIKE:
            own_ = f"{log.joints[best]} needs ({100.0 * shares[best]:.0f} % of it)"
            return f"is what {own_}: write each under its joint's name"
    excess = abs(off) * rests.stiffness
    if left < 1.0 - EXPLAINED and excess > gain.half * scale:
        return (
            f"is {off:+.3g} rad from what its rests need, {excess:.3g} N·m too much: its zero is not that of the "
            "angle; take it off"
        )
    return ""


def _slope(y: np.ndarray, x: np.ndarray) -> tuple[float, float]:
    """Factor of a series to another one, (R,), and the share of its variance that follows."""
    both = float(((y - y.mean()) * (x - x.mean())).mean())
    power = max(float(x.var()), 1e-300)
    return both / power, both**2 / max(power * float(y.var()), 1e-300)
