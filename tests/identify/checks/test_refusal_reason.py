"""A model that explains next to nothing: the refusal names what the torque follows instead."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mrwarp.diagnose.data_checks import rejections
from mrwarp.diagnose.held_out import HeldOut
from mrwarp.identify.checks.refusal_reason import explains_nothing, followed_instead, missed
from mrwarp.identify.contradictions import contradictions, forewarning, refuse_unexplained
from mrwarp.identify.dataset import Dataset
from mrwarp.identify.fit import fit
from mrwarp.recording.load import Recording, RecordingError, Trajectory
from mrwarp.sysid.settings import Settings

Torque = Callable[[int, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def recorded(torque: Torque, *, reach: float = 0.5, runs: int = 6, noise: float = 1e-5) -> Recording:
    """Mixed motion of a joint at 200 Hz; the torque is a function of run, angle, velocity and acceleration."""
    found = []
    for k in range(runs):
        rng, t = np.random.default_rng([3, k]), np.arange(800) * 0.005
        q, qd, qdd = np.zeros((3, 800))
        for _ in range(3):
            w, phase, a = 2.0 * np.pi * rng.uniform(0.3, 1.5), rng.uniform(0.0, 6.0), reach / 3.0
            q, qd = q + a * np.sin(w * t + phase), qd + a * w * np.cos(w * t + phase)
            qdd = qdd - a * w**2 * np.sin(w * t + phase)
        tau = torque(k, q, qd, qdd) + 0.02 * rng.normal(size=800)
        read = q + noise * rng.normal(size=800)
        found.append(Trajectory(id=f"run{k}", t=t, q=read, qd=qd, current=np.zeros(800), torque=tau))
    return Recording(trajectories=tuple(found))


CASES: dict[str, tuple[Recording, str]] = {
    "a joint that hardly moves": (recorded(lambda k, q, qd, a: 0.0 * q, reach=4e-4), "hardly moves"),
    "torque below its noise": (recorded(lambda k, q, qd, a: 1e-3 * np.sign(qd)), "hardly rises above its own noise"),
    "inertia": (recorded(lambda k, q, qd, a: 0.05 * a + 0.05 * np.sign(qd)), "goes with the acceleration.*diagnose"),
    "cogging": (recorded(lambda k, q, qd, a: np.sin(20.0 * q)), "comes again at the same angle in all runs.*diagnose"),
    "a load that differs": (
        recorded(lambda k, q, qd, a: (-1.0) ** k * (1.0 + 0.3 * k) * np.sin(8.0 * q + k)),
        "a load that depends on the place, such as a weight or a spring, and differs between runs",
    ),
    "another joint's torque": (
        recorded(lambda k, q, qd, a: np.convolve(np.random.default_rng(k).normal(size=800), np.ones(40) / 9.0, "same")),
        "check that it was measured at this joint",
    ),
}


@pytest.mark.parametrize(("recording", "words"), CASES.values(), ids=CASES.keys())
def test_the_true_reason_is_named(recording: Recording, words: str) -> None:
    """Each torque by its own reason, and only the last by the general one."""
    with pytest.raises(RecordingError, match=words) as refusal:
        refuse_unexplained(recording, Dataset.of(recording), 0.95, 0.95)
    assert "measured at this joint" in words or "measured at this joint" not in str(refusal.value)


def test_fit_and_diagnosis_share_the_criterion() -> None:
    """Cogging explains what eq. 14 does not: fit refuses and points at diagnose, which says it without the pointer."""
    recording, words = CASES["cogging"]
    assert "comes again at the same angle in all runs" in forewarning(recording)  # check says it before any fit
    assert contradictions(recording) == []  # what comes again at its place belongs to the motion
    with pytest.raises(RecordingError, match=words):
        fit(recording)
    said = explains_nothing(0.95, Dataset.of(recording), recording.units, every_effect=True)
    assert "every effect of the catalogue" in said and "mrwarp diagnose" not in said


def test_runs_that_others_do_not_predict_are_refused_as_a_diagnosis_refuses_them() -> None:
    """The error of trajectories left out counts from three of them on."""
    recording = CASES["a load that differs"][0]
    data = Dataset.of(recording)
    refuse_unexplained(recording, data, 0.5, 0.89)
    with pytest.raises(RecordingError, match="NRMSE 243.7 %"):
        refuse_unexplained(recording, data, 0.607, 2.437)
    assert "a load that depends on the place" in forewarning(recording)
    two = Recording(trajectories=recording.trajectories[:2])
    refuse_unexplained(two, Dataset.of(two), 0.607, 2.437)


def test_spikes_decide_neither_a_fit_nor_a_diagnosis() -> None:
    """One sample in a hundred is far off: the same error, without it, keeps or refuses a model wherever one is written.

    By all samples the error is 0.5 + 0.01*81 of the variance, that is an NRMSE of 1.1.
    """
    rng, count = np.random.default_rng(1), 4000
    torque = rng.normal(size=count)
    error = np.where(np.arange(count) % 100 == 50, 9.0, 0.7 * rng.normal(size=count))
    weight = np.ones(count)
    weight[:10] = 0.0
    error[:10] = 1e3  # what does not count
    left = missed(error, torque, weight)
    assert 0.6 < left < 0.72 and np.sqrt(np.mean(error[10:] ** 2)) > 1.0
    squares = np.array([1.2, 1.2])
    held = HeldOut(
        baseline=squares, extended=squares, predicted_baseline=torque, predicted_extended=torque + error, agreed=1.0
    )
    problem: Any = SimpleNamespace(measured=torque, weight=weight, motion=None, units={}, settings=Settings())
    assert rejections(held, problem) == []


def cogging_motor(k: int, rng: np.random.Generator) -> Trajectory:
    """A drive holds a speed over 12 teeth per turn; in even runs it shakes the rotor, in odd ones it holds the teeth.

    Its torque goes with the acceleration in the former and against it in the latter. Each run's angle has its own zero.
    """
    t = np.arange(3000) * 1e-3
    speed, w = 20.0 + 1.7 * k, 12.0
    q = speed * t + rng.uniform(0.0, 6.0)
    size, drive = (2e-3, -0.3) if k % 2 == 0 else (4e-4, 0.1)
    tooth = np.sin(w * q)
    shaken, qd = q + size * tooth, speed + size * w * speed * np.cos(w * q)
    torque, zero = drive * tooth + 0.5 + 0.05 * rng.normal(size=len(t)), rng.uniform(0.0, 6.0)
    return Trajectory(id=f"run{k}", t=t, q=shaken + zero, qd=qd, current=np.zeros(len(t)), torque=torque)


def test_cogging_at_constant_speed_is_no_inertia() -> None:
    """A torque with the acceleration in some runs and against it in others is not said to go with it."""
    rng = np.random.default_rng(6)
    # large where it shakes, so that all runs together look like an inertia
    recording = Recording(trajectories=tuple(cogging_motor(k, rng) for k in range(6)))
    said = followed_instead(Dataset.of(recording), recording.units)
    assert "acceleration" not in said and "cogging that differs between runs" in said
    shaken = Recording(trajectories=recording.trajectories[::2])
    assert "goes with the acceleration" in followed_instead(Dataset.of(shaken), shaken.units)
