"""Spikes of a recording are counted, noted, kept out of the fits, and do not repeat."""

import dataclasses

import numpy as np
import pytest

from mrwarp.diagnose import diagnose
from mrwarp.diagnose.checks.spikes import spikes_of
from mrwarp.diagnose.problem import Fit
from mrwarp.recording.load import Recording, Trajectory
from tests.diagnose import known

pytestmark = pytest.mark.usefixtures("few_trees")
INERTIA, FRICTION = 0.0098, 0.36


def motor(share: float, *, runs: int = 5, seconds: float = 4.0) -> Recording:
    """A motor without control input, with inertia and dry friction, a share of its samples off by 1 to 9 N·m."""
    rng, dt = np.random.default_rng(4), 0.005
    t, found = np.arange(round(seconds / dt)) * dt, []
    for k in range(runs):
        q, qd, qdd = known.swing(rng, t)
        torque = INERTIA * qdd + FRICTION * np.tanh(qd / 0.05) + 0.02 * rng.normal(size=len(t))
        where = rng.random(len(t)) < share
        torque[where] += rng.uniform(1.0, 9.0, where.sum()) * rng.choice([-1.0, 1.0], where.sum())
        found.append(Trajectory(id=f"run{k}", t=k * seconds + t, q=q, qd=qd, current=0.0 * t, torque=torque))
    return Recording(trajectories=tuple(found), units={"q": "rad", "current": "none", "torque": "N·m"})


def test_a_strong_effect_is_no_spike() -> None:
    """A lag of the current that takes much of the torque for a sample or two after each step; with spikes, these."""
    at = known.motion(3, runs=6, seconds=3.0)
    lagging = known.problem({"coil_lag": {"time_constant": 0.02}}, seed=3, at=at, sigma=0.002)
    recording = known.recording(at, lagging.measured)
    base: Fit = known.fitted(lagging)
    assert spikes_of(lagging, base, recording) is None
    where = np.random.default_rng(1).choice(len(at.q), 25, replace=False)
    torque = lagging.motion.torque.copy()
    torque[where] += np.random.default_rng(2).choice([-4.0, 4.0], 25)
    off = lagging.with_motion(dataclasses.replace(lagging.motion, torque=torque))
    spikes = spikes_of(off, base, recording)
    assert spikes is not None and set(np.flatnonzero(spikes.at)) >= set(where) and spikes.samples <= 30
    assert sum(spikes.per_trajectory.values()) == spikes.samples and not spikes.known[where].any()


@pytest.mark.slow
def test_the_device_is_found_without_its_spikes() -> None:
    """Inertia as without them; they are counted and noted, not repeatable, and in no figure of error."""
    found = diagnose(motor(0.015), effects=("rotor_inertia",), settings=known.QUICK)
    spikes, account = found.spikes, found.account
    assert spikes is not None and 40 < spikes.samples < 80 and spikes.of_squared_mismatch > 0.8
    assert any("spikes" in note for note in found.notes)
    [inertia] = found.causes
    low, high = inertia.parameters["inertia"].ci95
    assert low < INERTIA < high and inertia.parameters["inertia"].value == pytest.approx(INERTIA, rel=0.15)
    assert account is not None and account.not_repeatable.share > account.spikes > 0.5 and not account.open
    assert found.extended.nrmse < 0.15 and "comes again" not in found.sentence
    # a device without control input has no lag of it to report, and no structure lies along an absent signal
    assert not any("coil lag" in text for text in (*found.cannot_know, *found.invisible.values()))
    assert "coil_lag" not in found.invisible and "coil_lag" not in found.detectable
    result = found.to_dict()
    assert result["spikes"]["samples"] == spikes.samples
