"""Recordings that are no bench data, or whose columns contradict each other: no model, and what to check."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mrwarp.diagnose import diagnose
from mrwarp.identify.contradictions import contradictions
from mrwarp.identify.fit import fit
from mrwarp.recording.description import notes
from mrwarp.recording.load import Recording, RecordingError, Trajectory
from tests.identify import synthetic

GOOD = synthetic.bench_like(3, runs=8, seconds=4.0)
Columns = dict[str, np.ndarray]


def changed(change: Callable[[Trajectory], Columns], recording: Recording = GOOD) -> Recording:
    """Every run with some columns replaced."""
    return replace(recording, trajectories=tuple(replace(run, **change(run)) for run in recording.trajectories))


def noise(run: Trajectory, size: float) -> np.ndarray:
    """White noise that differs between runs."""
    return size * np.random.default_rng([5, len(run.id), int(run.id[-1])]).normal(size=len(run.t))


def walking_log(runs: int = 8, seconds: float = 4.0, dt: float = 0.005) -> Recording:
    """A leg's joint on the ground: a drive holds a gait, steps hit it, and the motion answers to the drive's torque."""
    found = []
    for k in range(runs):
        rng = np.random.default_rng([9, k])
        t = np.arange(round(seconds / dt)) * dt
        q, qd, torque = np.zeros((3, len(t)))
        hits = np.convolve(rng.normal(size=len(t)) * (rng.random(len(t)) < 0.1), np.ones(6), "same") * 8.0
        goal = (
            0.3 * np.sin(2.0 * np.pi * 1.5 * t + rng.uniform(0.0, 6.0)) + 0.15 * rng.normal(size=len(t)).cumsum() * dt
        )
        for i in range(1, len(t)):
            torque[i] = 25.0 * (goal[i] - q[i - 1]) - 0.5 * qd[i - 1]
            qd[i] = qd[i - 1] + dt * (torque[i] + hits[i]) / 0.05
            q[i] = q[i - 1] + dt * qd[i]
        current = np.repeat(rng.choice([0.0, 0.5, 1.0], len(t) // 40), 40)
        found.append(Trajectory(id=f"run {k}", t=t, q=q, qd=qd, current=current, torque=torque))
    return Recording(trajectories=tuple(found))


WRONG = {
    "some torques turned": (changed(lambda r: {"torque": r.torque * (-1.0) ** int(r.id[-1])}), "of opposite sign"),
    "angle jumps": (changed(lambda r: {"q": r.q + 4.0 * (r.t > 2.0)}), "jumps by"),
    "torque sign turned": (changed(lambda r: {"torque": -r.torque}), "drives the motion"),
    "angle sign turned": (changed(lambda r: {"q": -r.q, "qd": -r.qd}), "drives the motion"),
    "q and qd swapped": (changed(lambda r: {"q": r.qd, "qd": r.q}), "qd is not the derivative"),
    "qd of another joint": (changed(lambda r: {"qd": np.roll(r.qd, 300)}), "qd is not the derivative"),
    "qd in degrees": (changed(lambda r: {"qd": np.degrees(r.qd)}), "another unit"),
    "constant qd": (changed(lambda r: {"qd": 0.0 * r.qd}), "qd is 0 throughout"),
    "constant torque": (changed(lambda r: {"torque": 0.0 * r.torque + 0.3}), "torque is 0.3 throughout"),
    "constant angle": (changed(lambda r: {"q": 0.0 * r.q, "qd": 0.0 * r.qd}), "does not move"),
    "torque is a command": (changed(lambda r: {"torque": 2.5 * r.current}), "column current times a factor"),
    "torque is the velocity": (changed(lambda r: {"torque": 2.5 * r.qd}), "column qd times a factor"),
    "current and torque swapped": (
        changed(lambda r: {"current": r.torque, "torque": r.current + 1e-3 * np.abs(noise(r, 1.0))}),
        "look swapped",
    ),
    "current not connected": (changed(lambda r: {"current": noise(r, 0.003)}), "as noise does"),
    "coil not connected": (
        changed(lambda r: {"torque": np.tanh(20.0 * r.qd) + 0.1 * r.qd + noise(r, 0.02)}),
        "does not depend on the current",
    ),
    "a load that differs between runs": (
        changed(
            lambda r: {
                "current": np.arange(len(r.t)) // 8 % 2.0,
                "torque": 3.0 * np.cos(1.5 * r.q + int(r.id[-1])) + 0.1 * np.tanh(20.0 * r.qd),
            }
        ),
        "a load that depends on the place",
    ),
    "torque of another motion": (changed(lambda r: {"torque": noise(r, 1.0)}), "does not follow"),
    "walking log": (walking_log(), "prescribe"),
}


def test_bench_data_are_bench_data() -> None:
    """Noisy runs, runs without current, and a single run have nothing against them."""
    for recording in (
        GOOD,
        changed(lambda r: {"current": 0.0 * r.current}),
        replace(GOOD, trajectories=GOOD.trajectories[:1]),
    ):
        assert contradictions(recording) == []


def test_spikes_of_a_torque_are_not_what_it_follows() -> None:
    """A shaft that goes one way, friction and cogging of 0.1 N·m, and readings 1 to 4 N·m too high: a bench's data."""
    rng, runs = np.random.default_rng(3), []
    for k in range(6):
        t = np.arange(2000) * 0.002
        qd = 7.0 + 1.5 * np.sin(2.0 * np.pi * (0.3 + 0.1 * k) * t)
        q = np.cumsum(qd) * 0.002
        torque = 0.3 + 0.04 * qd + 0.08 * np.sin(14.0 * q) + 0.01 * rng.normal(size=2000)
        torque[rng.choice(2000, 25, replace=False)] += rng.uniform(1.0, 4.0, 25)
        runs.append(Trajectory(id=f"run {k}", t=t, q=q, qd=qd, current=np.zeros(2000), torque=torque))
    spiky = Recording(trajectories=tuple(runs), units={"q": "rad", "current": "none", "torque": "N·m"})
    assert contradictions(spiky) == []
    assert any("readings of the torque go far off and come back at once" in note for note in notes(spiky))
    assert not any("come back at once" in note for note in notes(GOOD))


@pytest.mark.parametrize(("recording", "words"), WRONG.values(), ids=WRONG.keys())
def test_what_is_wrong_is_said_and_no_model_is_given(recording: Recording, words: str) -> None:
    """One reason with what to check; ``fit`` refuses with it, a diagnosis has no verdict and no model."""
    with pytest.raises(RecordingError, match=words):
        fit(recording)
    found = diagnose(recording)
    assert found.verdict is None and found.model is None and not found.causes
    assert words in found.sentence and any(word in found.sentence for word in ("again", "record", "check", "move it"))
