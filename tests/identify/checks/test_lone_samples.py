"""Spikes: what stands out without a law is found, what a missing mechanism leaves is not."""

import dataclasses

import numpy as np
import pytest

from mrwarp.identify.checks.lone_samples import beside_spikes, find_spikes
from mrwarp.identify.dataset import Motion
from tests.diagnose import known


def measured(seed: int = 1) -> tuple[Motion, np.ndarray]:
    """Six runs with stepped current and a torque of 1 N·m, and noise of 0.02 N·m that a model leaves."""
    at = known.motion(seed, runs=6, seconds=4.0)
    return dataclasses.replace(at, torque=np.sign(at.qd)), 0.02 * np.random.default_rng(seed).normal(size=len(at.qd))


def found(at: Motion, left: np.ndarray) -> np.ndarray:
    """The spikes of what is left."""
    off = dataclasses.replace(at, torque=at.torque + left)
    return find_spikes(left, at.torque, off, np.ones(len(left), dtype=bool))


@pytest.mark.parametrize("number", [1, 40])
def test_a_few_samples_far_off_are_found(number: int) -> None:
    """One of 30 N·m, and one in a hundred of 1 to 9 N·m with either sign: these and no other."""
    at, left = measured()
    rng = np.random.default_rng(5)
    where = np.sort(rng.choice(len(left), number, replace=False))
    left[where] += 30.0 if number == 1 else rng.uniform(1.0, 9.0, number) * rng.choice([-1.0, 1.0], number)
    spikes = found(at, left)
    np.testing.assert_array_equal(np.flatnonzero(spikes), where)
    wide = beside_spikes(spikes, at)
    assert spikes.sum() < wide.sum() <= 6 * number and wide[where].all()


@pytest.mark.parametrize("at_reversals", [False, True])
def test_spikes_are_found_among_what_a_mechanism_leaves(at_reversals: bool) -> None:
    """After each reversal a mechanism leaves 0.6 N·m that fade over 40 ms: spikes anywhere, or there, stand out.

    They have either sign, which no mechanism has; those that were taken for the mechanism bent every fit.
    """
    at, left = measured()
    turned = np.flatnonzero(np.diff(np.sign(at.qd)) != 0.0) + 1
    turned = np.setdiff1d(turned, at.start)
    for k in turned:
        rest = left[k : k + 40]
        rest += 0.6 * np.sign(at.qd[k]) * np.exp(-np.arange(len(rest)) * at.dt[0] / 0.04)
    rng = np.random.default_rng(9)
    where = turned if at_reversals else np.sort(rng.choice(len(left), 40, replace=False))
    left[where] += rng.uniform(2.0, 6.0, len(where)) * rng.choice([-1.0, 1.0], len(where))
    assert set(np.flatnonzero(found(at, left))) >= set(where) and found(at, left).sum() < 1.5 * len(where)


@pytest.mark.parametrize("value", [0.0, -1.75])
def test_samples_that_were_not_read_are_spikes(value: float) -> None:
    """One in a hundred samples is 0, or another number, regardless of the torque: always against it, with no law."""
    at, left = measured()
    where = np.sort(np.random.default_rng(8).choice(len(left), 48, replace=False))
    left[where] = value - at.torque[where]
    np.testing.assert_array_equal(np.flatnonzero(found(at, left)), where)


def test_spikes_of_one_sign_are_found_where_a_joint_goes_one_way() -> None:
    """They are along the motion as they are anywhere; what lasts for some samples is still no spike."""
    at, left = measured()
    at = dataclasses.replace(at, qd=np.abs(at.qd) + 0.1, torque=np.ones(len(left)))
    where = np.sort(np.random.default_rng(10).choice(len(left), 40, replace=False))
    spiky = left.copy()
    spiky[where] += 3.0
    np.testing.assert_array_equal(np.flatnonzero(found(at, spiky)), where)
    for k in where:
        left[k : k + 6] += 3.0
    assert not found(at, left).any()


def test_glitches_of_the_motion_are_spikes_of_no_sign() -> None:
    """The model makes a torque of them that was never there: against its own sign in each, with no law in the rest."""
    at, left = measured()
    rng = np.random.default_rng(2)
    where = np.sort(rng.choice(len(left), 40, replace=False))
    glitch = np.zeros(len(left))
    glitch[where] = rng.uniform(2.0, 6.0, 40) * rng.choice([-1.0, 1.0], 40)
    off = dataclasses.replace(at, torque=at.torque + left)
    spikes = find_spikes(left - glitch, at.torque + glitch, off, np.ones(len(left), dtype=bool))
    np.testing.assert_array_equal(np.flatnonzero(spikes), where)


def test_what_has_a_law_is_no_spike() -> None:
    """After each step of the current, after each reversal, along the motion, too many, or too small."""
    at, noise = measured()
    stepped = np.flatnonzero(np.diff(at.current) != 0.0) + 1
    turned = np.flatnonzero(np.diff(np.sign(at.qd)) != 0.0) + 1
    some = np.random.default_rng(2).choice(len(noise), 60, replace=False)
    many = np.random.default_rng(3).choice(len(noise), len(noise) // 12, replace=False)
    assert not found(at, noise).any()
    for where, size in (
        (stepped, 3.0),
        (turned, 3.0 * np.sign(at.qd[turned])),
        (some, 3.0 * np.sign(at.qd[some])),
        (many, 3.0),
        (some, 0.3),
    ):
        left = noise.copy()
        left[where] += size
        assert not found(at, left).any()
