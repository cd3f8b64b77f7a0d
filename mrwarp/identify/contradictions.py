"""Reasons against a recording as bench data: columns that contradict each other, or a model that explains nothing.

A fit always ends somewhere. These checks say where its numbers would mean nothing, each with what to look at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import nnls

from mrwarp.identify.checks.refusal_reason import (
    by_place,
    explains_nothing,
    followed_instead,
    hardly_moves,
    own_noise,
)
from mrwarp.recording.angle import without_wrong_readings
from mrwarp.recording.data import Recording, RecordingError, Trajectory, quantity, with_unit
from mrwarp.recording.differentiate import differentiate
from mrwarp.sysid.settings import Data, Gain, Settings, Spikes

if TYPE_CHECKING:
    from mrwarp.identify.dataset import Dataset

_COPY = 1e-6
"""Part of the torque's variance that another column, times a factor, may leave if it is not a copy."""
_NOISE = 1.2
"""Ratio of the current's change from sample to sample to its spread from which it is noise: 1.41 where it is white."""
_COIL = ("A", "V")
"""Units of a control input that is a size and acts on the torque; a flag, a load or a pressure need not."""


def contradictions(recording: Recording, settings: Settings | None = None) -> list[str]:
    """Reasons why no model of a joint on a bench can follow from a recording, each with what to check or to record.

    Single samples of the torque that go off and come back at once, spikes, do not count. ``settings`` say what is next
    to nothing, and which torque drives; None: the defaults.
    """
    settings = settings or Settings()
    recording = without_spikes(recording, settings.spikes)
    runs, units = recording.trajectories, recording.units
    current_name, torque_name = quantity("current", units), quantity("torque", units)
    q, qd, current, torque = (
        np.concatenate([getattr(run, name) for run in runs]) for name in ("q", "qd", "current", "torque")
    )
    found = []
    noise = float(np.median([np.abs(np.diff(run.q, 2)).mean() for run in runs]))
    reach = float(np.median([np.ptp(run.q) for run in runs]))
    moves = reach > 8.0 * noise  # sixteen standard deviations
    if not moves:
        size = f" (the angle covers {reach:.2g} {units['q']}, its noise {noise:.2g})" if reach > 0.0 else ""
        found.append(
            f"the joint does not move beyond its noise{size}: friction and hysteresis show along motion only; move it "
            "by at least ten times the angle at which it yields, at 0.5 to 2 Hz and several amplitudes"
        )
    if float(np.ptp(torque)) == 0.0:
        return [*found, f"the torque is {torque[0]:.4g} throughout: is the sensor connected? Then record again"]
    if found or (wrong := _jumps(recording, settings.gain) or _wrong_velocity(recording, settings.gain)):
        return found or [wrong]
    copies = {"q": q, "qd": qd, "current": current}
    for name, x in copies.items():
        if np.ptp(x) > 0.0 and 1.0 - np.corrcoef(x, torque)[0, 1] ** 2 < _COPY:
            return [
                f"the {torque_name} is the column {name} times a factor: a command or a copy, not a measurement; take "
                "the sensor's column and try again"
            ]
    if current.min() < 0.0 < current.max() and torque.min() >= 0.0 and _turns(qd, current) > 0.5 > _turns(qd, torque):
        return [
            f"the {current_name} changes its sign with the motion and the {torque_name} never does: the two columns "
            "look swapped; swap them and try again"
        ]
    jumps = np.concatenate([np.diff(run.current) for run in runs])
    if float(jumps.std()) > _NOISE * float(current.std()) > 0.0:
        return [
            f"the {current_name} changes from sample to sample as noise does (up to "
            f"{with_unit(f'{np.abs(current).max():.3g}', units['current'])}): is its sensor connected? Write 0 "
            "where there is none, and try again"
        ]
    return _unrelated(recording, q, qd, current, torque, settings)


def without_spikes(recording: Recording, spikes: Spikes) -> Recording:
    """The recording without single samples of the torque that go far off and come back at once."""
    torques = [without_wrong_readings(run.torque, most=spikes.most)[0] for run in recording.trajectories]
    runs = tuple(replace(run, torque=x) for run, x in zip(recording.trajectories, torques, strict=True))
    return replace(recording, trajectories=runs)


def refuse_contradictions(recording: Recording) -> None:
    """Refuse a recording from which no model can follow.

    Raises:
        RecordingError: columns contradict each other; the first reason of :func:`contradictions`.
    """
    for reason in contradictions(recording):
        raise RecordingError(f"{recording.source or 'recording'}: {reason}")


def refuse_unexplained(recording: Recording, data: Dataset, nrmse: float, held_out: float) -> None:
    """Refuse a model that explains next to nothing, of the recording or of trajectories left out in turn.

    Args:
        recording: What was fitted.
        data: Its samples.
        nrmse: Error of the fit over the torque's standard deviation.
        held_out: The same of trajectories that took no part; it counts where there are enough.

    Raises:
        RecordingError: with what the torque follows instead.
    """
    needed = Data()
    worst = max(nrmse, held_out) if len(recording.trajectories) >= needed.runs else nrmse
    if worst >= needed.nothing:
        raise RecordingError(f"{recording.source or 'recording'}: {explains_nothing(worst, data, recording.units)}")


def forewarning(recording: Recording, settings: Settings | None = None, *, least: float | None = None) -> str:
    """Gaps of a fit where the plainest laws of a joint leave most of the torque; else, or if unclear, empty.

    ``least`` is the part of the torque's variance, without its spikes, that they have to leave; None: as in
    ``settings``, by default those of the documentation.
    """
    settings = settings or Settings()
    recording = without_spikes(recording, settings.spikes)
    runs = recording.trajectories
    q, qd, current, torque = (
        np.concatenate([getattr(run, name) for run in runs]) for name in ("q", "qd", "current", "torque")
    )
    free, passive = _plain_laws(q, qd, np.concatenate([np.gradient(run.qd, run.dt) for run in runs]), current)
    # a stress that does not yield is a spring about the middle of its run
    left = _left(torque, [*free, np.concatenate([run.q - np.median(run.q) for run in runs])], passive)
    if left < (settings.data.unlikely if least is None else least):
        return ""
    from mrwarp.identify.dataset import Dataset  # loads Warp: `mrwarp check` of a good recording does without

    if not (reason := followed_instead(Dataset.of(recording), recording.units, settings.gain)):
        return ""
    return f"plain friction, inertia and stiffness leave {100.0 * left:.0f} % of the torque's variance: {reason}"


def _jumps(recording: Recording, gain: Gain) -> str:
    """Whether the angle jumps in a way that was not put right when it was read: often, or beyond its motion.

    Where a run rests, an encoder on its edge flips: next to the motion of the other runs that is nothing.
    """
    most = max(float(np.ptp(run.q)) for run in recording.trajectories)
    for run in recording.trajectories:
        steps, reach = np.abs(np.diff(run.q)), float(np.ptp(run.q))
        at = np.flatnonzero(steps > max(gain.half * reach, gain.share * most))
        at = at[(at >= 3) & (at + 4 < len(run.q))]
        stays = [abs(np.median(run.q[k + 1 : k + 5]) - np.median(run.q[k - 3 : k + 1])) > gain.half * reach for k in at]
        if any(stays) and np.percentile(steps, 95) < gain.share * reach:
            k = int(at[np.argmax(stays)])
            name, unit = quantity("q", recording.units), recording.units["q"]
            return (
                f"the {name} of {run.id!r} jumps by {steps[k]:.3g} {unit} from one sample to the next at "
                f"{run.t[k]:.4g} s ({sum(stays)} such jumps), as no joint does: a reading that begins again, or was "
                "set to another zero, has to go on; put it right, and try again"
            )
    return ""


def _wrong_velocity(recording: Recording, gain: Gain) -> str:
    """Whether the velocity channel is not the derivative of the angle."""
    runs = [run for run in recording.trajectories if not run.qd_derived]
    if not runs:
        return ""
    qd = np.concatenate([run.qd for run in runs])
    derived = np.concatenate([differentiate(run.q, run.dt) for run in runs])
    own, other, both = float(qd @ qd), float(derived @ derived), float(qd @ derived)
    if own == 0.0:
        return "qd is 0 throughout while q moves: leave the column out, then it is derived, and try again"
    if both < gain.half * np.sqrt(own * other):
        return (
            f"qd is not the derivative of q (correlation {both / np.sqrt(own * other):.2f}): are two columns swapped, "
            "or of different joints? Put them right, or leave qd out, and try again"
        )
    if not gain.half < both / own < 1.0 / gain.half:
        return f"dq/dt is {both / own:.3g} times qd: one of them is in another unit; convert it, and try again"
    return ""


def _turns(qd: np.ndarray, x: np.ndarray) -> float:
    """Correlation, in size, of a column with the direction of motion; 0 for a constant one."""
    return float(abs(np.corrcoef(np.sign(qd), x)[0, 1])) if np.ptp(x) > 0.0 and np.ptp(np.sign(qd)) > 0.0 else 0.0


def _unrelated(
    recording: Recording,
    q: np.ndarray,
    qd: np.ndarray,
    current: np.ndarray,
    torque: np.ndarray,
    settings: Settings,
) -> list[str]:
    """Whether the torque has a turned sign, or nothing to do with the motion, or with a current that changes."""
    qdd = np.concatenate([np.gradient(run.qd, run.dt) for run in recording.trajectories])
    runs = recording.trajectories
    if turned := opposed(runs, settings):
        return [_opposed_text(recording, turned)]
    free, passive = _plain_laws(q, qd, qdd, current)
    unexplained = _left(torque, free[:2], passive[:3])
    with_current = _left(torque, free, passive)
    name, torque_name = quantity("current", recording.units), quantity("torque", recording.units)
    if resists(torque, qd) < -settings.faults.drives:
        return [
            f"the {torque_name} drives the motion instead of resisting it: its sign, or that of the "
            f"{quantity('q', recording.units)}, is turned against eq. 14, or the motion answers to the {torque_name} "
            "as in a log of a walking robot; turn a sign, or record where a bench prescribes the motion, and try again"
        ]
    varies = recording.units["current"] in _COIL and np.ptp(current) > settings.gain.share * np.abs(current).max()
    unrelated = with_current > 1.0 - settings.gain.share and not follows_place(recording, settings.rest.unreported)
    constant = varies and unexplained - with_current < settings.gain.floor * with_current
    if (unrelated or constant) and (hardly := hardly_moves([run.q for run in runs], recording.units)):
        return [hardly]
    if unrelated:
        noise = own_noise([run.torque for run in runs], recording.units, settings.gain)
        noisy = f" and hardly rises above its own noise ({noise} from sample to sample)" if noise else ""
        return [
            f"the {torque_name} does not follow motion or {name}{noisy}: does the joint move beyond its play, is the "
            "sensor connected, does its log belong to this motion? Did the bench prescribe it (in a log of a "
            "walking robot the motion answers to the torque)? Then record again"
        ]
    # next to what plain laws leave nobody sees what the coil does
    if constant and (reason := forewarning(recording, settings, least=0.0)):
        return [reason]
    if constant:
        return [
            f"the {torque_name} does not depend on the {name}, although that changes from {current.min():.3g} to "
            f"{current.max():.3g} {recording.units['current']}: is the coil connected, is it this joint's log, and "
            "does it move far enough to yield? Then record again"
        ]
    return []


def follows_place(recording: Recording, least: float) -> bool:
    """Whether a part of at least ``least`` of the torque's variance comes again where the angle does.

    Cogging and a weight's torque do: they belong to the motion.
    """
    runs = recording.trajectories
    q, torque = (np.concatenate([getattr(run, name) for run in runs]) for name in ("q", "torque"))
    start = np.cumsum([0, *(len(run.t) for run in runs)])
    parts = [slice(int(a), int(b)) for a, b in zip(start[:-1], start[1:], strict=True)]
    turn = 2.0 * np.pi if recording.units["q"] == "rad" else np.inf
    left = [float(np.var(torque - by_place(q, torque, parts, turn, own=own))) for own in (False, True)]
    return min(left) < (1.0 - least) * float(torque.var())


def resists(torque: np.ndarray, qd: np.ndarray) -> float:
    """Part of the power, in size, that a torque takes from the motion; negative where it drives it.

    A constant load does not count, unless the motion goes one way only: then its mean is what resists.
    """
    powers = [(torque - mean) * qd for mean in (torque.mean(), 0.0)]
    return max(float(power.sum()) / max(float(np.abs(power).sum()), 1e-300) for power in powers)


def opposed(runs: Sequence[Trajectory], settings: Settings) -> list[str]:
    """Runs whose torque drives the motion while that of others resists it, and that are passive with the other sign."""
    least, powers = settings.faults.drives, [resists(run.torque, run.qd) for run in runs]
    if max(powers) < least:
        return []
    turned = []
    for run in (run for run, power in zip(runs, powers, strict=True) if power < -least):
        free, passive = _plain_laws(run.q, run.qd, np.gradient(run.qd, run.dt), run.current)
        if _left(-run.torque, free, passive) < settings.gain.half * _left(run.torque, free, passive):
            turned.append(run.id)
    return turned


def _plain_laws(
    q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, current: np.ndarray
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Columns of the plainest laws of a passive joint: those of either sign, and those that only resist."""
    direction = np.sign(qd)
    return [np.ones_like(q), q, current], [qd, direction, qdd, current * direction, current * qd]


def _opposed_text(recording: Recording, turned: list[str]) -> str:
    """Note on runs with the other sign."""
    named = ", ".join(turned[:4]) + (", ..." if len(turned) > 4 else "")
    name, angle = (quantity(key, recording.units) for key in ("torque", "q"))
    return (
        f"runs of opposite sign: the {name} of {named} ({len(turned)} of {len(recording.trajectories)}) drives the "
        f"motion, that of the others resists it; turn the sign of the {name}, or of the {angle}, in these (eq. 14: "
        "positive against positive velocity), or leave them out, and try again"
    )


def _left(torque: np.ndarray, free: list[np.ndarray], passive: list[np.ndarray]) -> float:
    """Part of the torque's variance that columns leave; those of a passive joint have no negative factor."""
    table = np.stack([*free, *(-x for x in free), *passive], axis=1)
    table = table / np.maximum(np.abs(table).max(axis=0), 1e-300)
    gram, moment = table.T @ table, table.T @ torque
    root = np.linalg.cholesky(gram + 1e-10 * np.trace(gram) / len(gram) * np.eye(len(gram)))
    factors, _ = nnls(root.T, np.linalg.solve(root, moment))
    return float(np.mean((torque - table @ factors) ** 2) / torque.var())
