"""Questions that recordings cannot answer are named before any fit, with the recording to make."""

from dataclasses import replace

import numpy as np
import pytest

from mrwarp.diagnose import diagnose
from mrwarp.diagnose.data_checks import gaps, no_verdict_reasons
from mrwarp.recording.load import Recording, Trajectory
from mrwarp.sysid.settings import Data, Settings


def good(runs: int = 6, seconds: float = 4.0, dt: float = 0.005) -> Recording:
    """Swings with stepped current and noise."""
    rng = np.random.default_rng(1)
    t = np.arange(round(seconds / dt)) * dt
    found = []
    for k in range(runs):
        q = 0.4 * np.sin(2 * np.pi * (0.6 + 0.1 * k) * t)
        qd = np.gradient(q, dt)
        current = np.repeat(rng.choice([0.0, 0.5, 1.0, 1.5], len(t) // 80 + 1), 80)[: len(t)]
        torque = (0.4 + current) * np.tanh(4.0 * qd) + 0.02 * rng.normal(size=len(t))
        found.append(Trajectory(id=f"run{k}", t=k * seconds + t, q=q, qd=qd, current=current, torque=torque))
    return Recording(trajectories=tuple(found))


def changed(recording: Recording, **channels) -> Recording:
    """Every run with channels replaced by functions of the run."""
    runs = tuple(replace(run, **{name: make(run) for name, make in channels.items()}) for run in recording.trajectories)
    return replace(recording, trajectories=runs)


def test_nothing_keeps_a_verdict_from_a_good_recording() -> None:
    """Enough motion, current and torque: nothing stands against a verdict and nothing stays unknown."""
    assert no_verdict_reasons(good()) == [] and gaps(good()) == []


def test_runs_that_each_begin_at_zero_say_nothing_of_drifts_between_them() -> None:
    """Neither wear nor warming from run to run can be known; a single run needs no common clock."""
    [gap] = gaps(changed(good(), t=lambda run: run.t - run.t[0]))
    assert "share no clock" in gap and "wear" in gap and "runs on" in gap
    assert gaps(good(runs=1)) == []


@pytest.mark.parametrize(
    ("recording", "words"),
    [
        (good(runs=1, seconds=2.0), "only 1 trajectory"),
        (good(runs=2, seconds=2.0), "only 2 trajectories"),
        (good(runs=3, seconds=2.0), "too little data: 6 s"),
        (good(runs=4, seconds=4.0, dt=0.02), "800 samples"),
        (changed(good(), q=lambda run: 0.3 + 0.0 * run.q, qd=lambda run: 0.0 * run.q), "does not move"),
        (changed(good(), torque=lambda run: np.clip(run.torque, -0.3, 0.3)), "torque sensor is saturated"),
        (changed(good(), torque=lambda run: np.minimum(run.torque, 1.85)), "torque sensor is saturated"),
        (changed(good(), torque=lambda run: 0.0 * run.torque + 1.0), "torque is 1 throughout"),
        (changed(good(), torque=lambda run: 0.02 * np.sin(7e4 * run.t**2)), "torque does not follow"),
        (changed(good(), torque=lambda run: -run.torque), "drives the motion"),
    ],
)
def test_a_reason_without_a_verdict_is_named_with_a_remedy(recording: Recording, words: str) -> None:
    """The reason says what is wrong, with its number, and which recording to make."""
    found = [text for text in no_verdict_reasons(recording) if words in text]
    assert len(found) == 1
    assert any(verb in found[0] for verb in ("record", "move it", "use a larger", "try again"))


def test_joint_that_trembles_does_not_move() -> None:
    """Encoder noise around a fixed angle is no motion; a swing of a hundred steps is."""
    rng = np.random.default_rng(2)
    trembling = changed(
        good(), q=lambda run: 3e-4 * rng.integers(-1, 2, len(run.q)), qd=lambda run: 0.01 * rng.normal(size=len(run.q))
    )
    assert any("does not move" in text for text in no_verdict_reasons(trembling))
    small = changed(good(), q=lambda run: np.round(run.q / 8e-3) * 8e-3)
    assert no_verdict_reasons(small) == []


def test_limits_are_those_that_are_stated() -> None:
    """At the limits themselves a verdict is possible."""
    assert no_verdict_reasons(good(runs=3, seconds=4.0)) == []
    assert no_verdict_reasons(good(runs=5, seconds=2.0)) == []
    assert no_verdict_reasons(good(runs=3, seconds=4.0), Settings(data=Data(runs=40)))


@pytest.mark.parametrize(
    ("current", "words"),
    [
        (lambda run: 0.0 * run.t, "the current is 0 throughout"),
        (lambda run: 0.0 * run.t + 0.8, "the current is 0.8 throughout"),
        (lambda run: 0.0 * run.t + 0.2 * int(run.id[-1]), "constant within each trajectory"),
    ],
    ids=["none", "one level", "one level a run"],
)
def test_current_that_hides_effects_is_said(current, words: str) -> None:
    """With one level, or one in each run, what cannot be known is listed; a verdict is still possible."""
    recording = changed(good(), current=current)
    assert no_verdict_reasons(recording) == []
    (found,) = gaps(recording)
    assert words in found and "coil lag" in found and "record" in found


def test_diagnosis_refuses_a_verdict_with_its_reasons() -> None:
    """The typed result has no verdict, no causes and no model; it says why, and what to record."""
    found = diagnose(good(runs=1))
    assert found.verdict is None and not found.causes and found.model is None and found.traces is None
    assert len(found.cannot_know) == 2 and found.next_experiment is not None
    assert found.sentence.startswith("No verdict: only 1 trajectory; too little data")
    with pytest.raises(ValueError, match="no model"):
        found.extended_rmse(good())
