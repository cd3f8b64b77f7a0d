"""The engines agree, and runs repeat: float32 and float64, captured and eager, batch and alone, any thread count."""

import numpy as np
import pytest

from mrwarp.env.backend import BackendKind
from mrwarp.verify.engines import (
    STEPS,
    Agreement,
    agreement,
    alone_equals_batch,
    captured_equals_eager,
    same_at_any_thread_count,
)

CASES = ("in the air", "standing", "foot-fall")


@pytest.fixture(scope="module")
def compared() -> dict[str, Agreement]:
    """Both engines from the same states under the same torques, 100 ms."""
    return {case.name: case for case in agreement(seed=0)}


@pytest.mark.parametrize("name", CASES)
def test_engines_agree_to_float32(compared, name):
    """After every step up to 100 ms the engines differ by less than the tolerance that rounding gives.

    The derivation stands at the head of physics_engines: dt*kappa(M)*eps32*|qacc| per step, times the growth of a
    small velocity error, which the float64 engine measures.
    """
    case = compared[name]
    assert case.difference.shape == case.tolerance.shape == (STEPS, 2)
    assert (case.difference <= case.tolerance).all()


@pytest.mark.parametrize("name", CASES)
def test_engines_tolerance_is_tight_enough_to_mean_something(compared, name):
    """The tolerance stays far below the motion it judges: 0.1 rad/s against speeds of 2 rad/s, 5 mrad against 0.1 rad.

    (A wrong sign or a missed contact would differ by the whole motion.)
    """
    assert compared[name].tolerance[-1, 0] < 5e-3
    assert compared[name].tolerance[-1, 1] < 0.1


def test_engines_cases_are_what_they_say(compared):
    """No foot touches the ground in the air; standing loads feet by about a quarter of the weight; a foot-fall more."""
    quarter = 12.6 * 9.81 / 4.0
    assert compared["in the air"].foot_force == 0.0
    assert 0.8 * quarter < compared["standing"].foot_force < 1.5 * quarter
    assert compared["foot-fall"].foot_force > 2.0 * quarter


def test_engines_captured_step_equals_eager():
    """MuJoCo-Warp's captured graph of 1, 2, 3 and 5 steps leaves the same bits as the eager steps."""
    same = captured_equals_eager((1, 2, 3, 5))
    assert same == {1: True, 2: True, 3: True, 5: True}


@pytest.mark.parametrize("kind", list(BackendKind))
def test_engines_environment_alone_equals_batch(kind):
    """Environment k of a batch of three foot-falls with different currents is bit-equal to the same one alone."""
    assert alone_equals_batch(kind) == 0.0


def test_engines_same_bits_at_any_thread_count():
    """200 policy steps of random actions, falls and resets included: same seed, same bits with one and two threads."""
    assert same_at_any_thread_count(seed=7)


def test_engines_differences_are_finite(compared):
    """A run that blew up in both engines would compare as NaN, which no comparison above would catch as agreement."""
    assert np.isfinite([case.difference for case in compared.values()]).all()
