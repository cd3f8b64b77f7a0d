"""Questions that a recording cannot answer: found before any fit, or by what a finished search predicts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mrwarp.diagnose.checks.recording_faults import turned_signs
from mrwarp.identify.checks.refusal_reason import explains_nothing, missed
from mrwarp.identify.contradictions import contradictions
from mrwarp.recording.blocks import in_blocks, is_cut
from mrwarp.recording.data import NO_INPUT, Recording, quantity, session_clock, true_names
from mrwarp.recording.saturation import saturated
from mrwarp.sysid.settings import Settings
from mrwarp.sysid.verdict import Error, NextExperiment

if TYPE_CHECKING:
    from mrwarp.diagnose.held_out import HeldOut
    from mrwarp.diagnose.problem import Problem
    from mrwarp.diagnose.result import Diagnosis

STANDARD = (
    "record at least 12 trajectories of 4 s or more: current steps while the joint moves, sines of several amplitudes "
    "at several constant currents, in random order"
)


def no_verdict_reasons(recording: Recording, settings: Settings | None = None) -> list[str]:
    """Reasons why no verdict can be given; each names the recording to make."""
    settings = settings or Settings()
    needed = settings.data
    runs = in_blocks(recording).trajectories
    seconds = sum(float(run.t[-1] - run.t[0]) + run.dt for run in runs)
    found = []
    if len(runs) < needed.runs:
        found.append(
            f"only {len(runs)} {'trajectory' if len(runs) == 1 else 'trajectories'}: an effect only counts when "
            f"it predicts a trajectory that it was not fitted to, so nothing can be named; {STANDARD}"
        )
    if seconds < needed.seconds or recording.samples < needed.samples:
        found.append(
            f"too little data: {seconds:.3g} s, {recording.samples} samples; a cause needs at least "
            f"{needed.seconds:g} s and {needed.samples} samples; {STANDARD}"
        )
    wrong = contradictions(turned_signs(recording, settings)[0], settings)
    if not wrong and (beyond := saturated(recording)):
        found.append(beyond)
    return [true_names(reason, recording.units) for reason in found] + wrong


def without_verdict(
    recording: Recording, reasons: list[str], settings: Settings, seed: int, seconds: float
) -> Diagnosis:
    """The result for data that cannot carry a verdict: why, and the recording to make."""
    from mrwarp.diagnose.result import Diagnosis  # `mrwarp check` does without

    nothing = Error(rmse=float("nan"), nrmse=float("nan"), unit=recording.units["torque"])
    to_make = reasons[0].rsplit("; ", 1)[-1] if "; " in reasons[0] else STANDARD
    following = NextExperiment(what=to_make, seconds=60.0, separates=(), kind="recording")
    sentence = "; ".join(reason.split(":")[0] for reason in reasons) if len(reasons) > 1 else reasons[0]
    return Diagnosis(
        verdict=None,
        sentence=f"No verdict: {sentence}.",
        cannot_know=tuple(reasons + gaps(recording, settings)),
        baseline=nothing,
        extended=nothing,
        next_experiment=None if to_make.endswith("try again") else following,  # these data only need a change
        recording=recording,
        seconds=seconds,
        seed=seed,
    )


def rejections(found: HeldOut, problem: Problem) -> list[str]:
    """Reasons not to believe a finished search: nothing is explained."""
    error, gain = found.predicted_extended - problem.measured, problem.settings.gain
    left = missed(error, problem.measured, problem.weight, gain.share)
    if left >= problem.settings.data.nothing:
        reason = explains_nothing(left, problem.motion, problem.units, gain, every_effect=True)
        return [reason if reason.endswith("try again") else f"{reason}; {STANDARD}"]
    return []


def gaps(recording: Recording, settings: Settings | None = None) -> list[str]:
    """Questions left open although a verdict can be given; each names the recording to make."""
    from mrwarp.identify.checks.run_levels import levels_without_clock

    unchanging = (settings or Settings()).gain.share
    runs = recording.trajectories
    current = np.concatenate([run.current for run in runs])
    top = float(np.abs(current).max())
    levels = np.unique(np.round(current / (top or 1.0), 2))
    name, found = quantity("current", recording.units), []
    if any(run.q_integrated for run in runs):
        found.append(
            "the angle was not logged but integrated from the velocity: it begins at 0 in each run and may drift, so "
            "what depends on the place (stiffness, cogging, friction over the angle) is not certain; log the angle"
        )
    if recording.one_way:
        found.append(
            "the joint moves one way only: its friction and an offset of the torque are one number; record motion "
            "both ways"
        )
    if recording.units["current"] == NO_INPUT:
        pass  # there is none to be changed
    elif len(levels) == 1:
        found.append(
            f"the {name} is {current[0]:.3g} throughout: nothing that depends on it can be known (coil lag, command "
            "delay, remanence, saturation, viscosity over current); record several constant levels and steps between "
            "them while the joint moves"
        )
    elif all(np.ptp(run.current) <= unchanging * top for run in runs):
        found.append(
            f"the {name} is constant within each trajectory: coil lag, command delay and remanence cannot be seen; "
            f"record steps of the {name} while the joint moves"
        )
    if is_cut(recording):
        found.append(
            "the blocks are of one set-up: what differs from one session to the next (wear, another zero or "
            "mounting, a cold start) cannot be seen; record several runs, some of them on another day"
        )
    if len(runs) > 1 and session_clock(recording) is None:
        found.append(
            levels_without_clock(recording, settings)
            or "the runs share no clock (their recorded times overlap, as where each begins at 0 s): wear, drift and "
            "warming from run to run cannot be seen, only within runs; record t by a clock that runs on from run to run"
        )
    return found
