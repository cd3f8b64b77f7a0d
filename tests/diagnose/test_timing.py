"""Torque that is logged ahead of the motion by part of a sample."""

import dataclasses

import numpy as np
import pytest

from mrwarp.diagnose.timing import find_timing, timing_note
from mrwarp.identify.dataset import Motion
from tests.diagnose import known

INERTIA = {"rotor_inertia": {"inertia": 0.02}}


def _late(at: Motion, samples: float) -> Motion:
    """The motion as it is logged by clocks that are late."""
    return dataclasses.replace(at.later(-samples), ahead=0.0)


def test_shifted_motion_is_that_between_the_samples() -> None:
    """Linear in between, trajectory by trajectory; the last sample is held."""
    at = known.motion(runs=2, seconds=1.0)
    late = at.later(0.25)
    q, size = at.q, 200
    assert late.ahead == 0.25
    np.testing.assert_allclose(late.q[: size - 1], 0.75 * q[: size - 1] + 0.25 * q[1:size])
    assert late.q[size - 1] == q[size - 1] and late.q[-1] == q[-1]


@pytest.mark.parametrize("ahead", [0.4, 0.75])
def test_torque_ahead_of_the_motion_is_found(ahead: float) -> None:
    """To a tenth of a sample, and the motion is shifted by it."""
    made = known.engine(INERTIA, sigma=2e-3, at=known.motion(3, runs=6))
    logged = _late(made.motion, ahead)
    engine = known.engine(INERTIA, sigma=2e-3, at=logged)
    samples = dataclasses.replace(engine.samples, torque=made.samples.torque)
    engine.samples, engine.measured = samples, made.samples.torque
    found = find_timing(engine, known.fitted(engine, INERTIA))
    assert found == pytest.approx(ahead, abs=0.1)
    assert engine.motion.ahead == found
    np.testing.assert_allclose(engine.samples.qd[10:700], made.samples.qd[10:700], atol=0.05)
    assert np.array_equal(engine.samples.torque, made.samples.torque)


@pytest.mark.parametrize("effects", [{}, INERTIA, {"torque_sensor_lag": {"time_constant": 0.003}}])
def test_a_log_with_one_clock_stays_as_it_is(effects: dict) -> None:
    """Whether the model fits it, or lacks a lag."""
    engine = known.engine(effects)
    motion = engine.motion
    assert find_timing(engine, known.fitted(engine)) == 0.0
    assert engine.motion is motion


def test_note_states_samples_and_time() -> None:
    """Both are needed to correct a log."""
    assert "0.40 samples (0.4 ms)" in timing_note(0.4, 1e-3)
