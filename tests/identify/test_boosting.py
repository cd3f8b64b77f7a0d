"""What repeats is foretold on trajectories that took no part; what differs from run to run is not."""

from dataclasses import replace

import numpy as np
import pytest

from mrwarp.identify.boosting import chosen_samples, features, foretold
from tests.diagnose import known


def test_a_law_of_the_motion_is_foretold_and_noise_is_not() -> None:
    """A torque that follows velocity and past angle is known to some per cent; white noise is not foretold at all."""
    motion = known.motion(3, runs=6, seconds=3.0)
    lag = round(0.08 / known.DT)
    law = np.tanh(motion.qd) + 0.5 * np.concatenate([motion.q[:lag], motion.q[:-lag]])
    noise = np.random.default_rng(0).normal(size=len(law))
    at = chosen_samples(motion, np.ones(len(law)), limit=800)
    assert 500 <= len(at) <= 800
    known_law, known_noise = (foretold(motion, at, target) for target in (law, noise))
    assert np.mean((known_law - law[at]) ** 2) < 0.1 * law.var()
    smooth = foretold(motion, at, law, smooth=np.stack([motion.qd, motion.q]))
    assert np.mean((smooth - law[at]) ** 2) < 0.1 * law.var()
    assert np.mean((known_noise - noise[at]) ** 2) > 0.95 * noise.var()


def test_samples_that_do_not_count_are_left_out() -> None:
    """Neither learned from nor foretold."""
    motion = known.motion(3, runs=3, seconds=2.0)
    weight = np.ones(len(motion.q))
    weight[: motion.start[1]] = 0.0
    assert chosen_samples(motion, weight).min() == motion.start[1]


@pytest.mark.parametrize("kept", ["q", "qd"])
def test_features_look_no_further_back_than_the_trajectory(kept: str) -> None:
    """What another trajectory did says nothing: a change in the first leaves what is foretold from the others."""
    motion = known.motion(3, runs=3, seconds=2.0)
    at = np.arange(motion.start[1], motion.start[3], 7)
    changed = getattr(motion, kept).copy()
    changed[: motion.start[1]] *= 0.5
    assert np.array_equal(features(motion, at), features(replace(motion, **{kept: changed}), at))
