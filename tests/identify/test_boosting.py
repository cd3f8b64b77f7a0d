"""A part that repeats is predicted on held-out trajectories; a part that differs from run to run is not."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from mrwarp.identify.boosting import (
    chosen_samples,
    cross_predicted,
    end_processes,
    features,
    spread_where_it_repeats,
)
from mrwarp.identify.dataset import sample_noise
from tests.diagnose import known


def test_a_law_of_the_motion_is_foretold_and_noise_is_not() -> None:
    """A torque that follows velocity and past angle is known to some per cent; white noise is not predicted at all."""
    motion = known.motion(3, runs=6, seconds=3.0)
    lag = round(0.08 / known.DT)
    law = np.tanh(motion.qd) + 0.5 * np.concatenate([motion.q[:lag], motion.q[:-lag]])
    noise = np.random.default_rng(0).normal(size=len(law))
    at = chosen_samples(motion, np.ones(len(law)), limit=400)
    assert 300 <= len(at) <= 400
    known_law, known_noise = (cross_predicted(motion, at, target) for target in (law, noise))
    assert np.mean((known_law - law[at]) ** 2) < 0.1 * law.var()
    smooth = cross_predicted(motion, at, law, smooth=np.stack([motion.qd, motion.q]))
    assert np.mean((smooth - law[at]) ** 2) < 0.1 * law.var()
    assert np.mean((known_noise - noise[at]) ** 2) > 0.95 * noise.var()


@pytest.mark.slow
def test_processes_predict_the_same_and_end() -> None:
    """Folds that two processes share; they would wait for more work."""
    motion = known.motion(3, runs=6, seconds=3.0)
    at = chosen_samples(motion, np.ones(len(motion.q)), limit=400)
    alone, shared = (cross_predicted(motion, at, np.tanh(motion.qd), threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(shared, alone)
    end_processes()
    assert not [thread for thread in threading.enumerate() if "Executor" in thread.name]


def test_samples_that_do_not_count_are_left_out() -> None:
    """Neither learned from nor predicted."""
    motion = known.motion(3, runs=3, seconds=2.0)
    weight = np.ones(len(motion.q))
    weight[: motion.start[1]] = 0.0
    assert chosen_samples(motion, weight, limit=400).min() == motion.start[1]


@pytest.mark.parametrize("kept", ["q", "qd"])
def test_features_look_no_further_back_than_the_trajectory(kept: str) -> None:
    """Another trajectory's motion says nothing: a change in the first leaves the prediction from the others."""
    motion = known.motion(3, runs=3, seconds=2.0)
    at = np.arange(motion.start[1], motion.start[3], 7)
    changed = getattr(motion, kept).copy()
    changed[: motion.start[1]] *= 0.5
    assert np.array_equal(features(motion, at), features(replace(motion, **{kept: changed}), at))


def cycles(rates: tuple[float, ...]):
    """Runs of 6 s of a swing at these rates [Hz], and a mismatch that follows the motion, with noise of 0.05."""
    motion = known.motion(8, runs=len(rates), seconds=6.0, current=0.5)
    t = motion.time - motion.time[motion.start[:-1]].repeat(np.diff(motion.start))
    w = 2.0 * np.pi * np.repeat(rates, np.diff(motion.start))
    q, qd, qdd = 0.4 * np.sin(w * t), 0.4 * w * np.cos(w * t), -0.4 * w**2 * np.sin(w * t)
    noise = 0.05 * np.random.default_rng(0).normal(size=len(t))
    return replace(motion, q=q, qd=qd, qdd=qdd), np.tanh(qd) * (1.0 + q) + noise


def test_spread_where_a_motion_comes_again_is_that_of_the_noise() -> None:
    """Cycles of no whole number of samples: what follows the motion is no spread, however large; noise is."""
    motion, mismatch = cycles((0.61, 0.83, 1.27))
    counts, spreads = spread_where_it_repeats(motion, mismatch, np.arange(len(mismatch)))
    assert (counts > 0).all() and np.sqrt(counts @ spreads / counts.sum()) == pytest.approx(0.05, rel=0.15)
    assert sample_noise(motion, mismatch) == pytest.approx(0.05, rel=0.07)


def test_motion_that_never_comes_again_says_nothing() -> None:
    """Two runs alone, or a motion that wanders: no pairs."""
    two = cycles((0.61, 0.83))
    wandering = known.motion(8, runs=4, seconds=3.0)
    for motion, mismatch in (two, (wandering, wandering.q)):
        counts, _ = spread_where_it_repeats(motion, mismatch, np.arange(len(mismatch)))
        assert not counts.any()
