"""Figures of the falling mass, and the devices that bound them."""

import numpy as np
import pytest

from mrwarp.params import BoucWenParams, MrParams
from mrwarp.trials.falling_mass import contact_stiffness
from paper.reproduce.disturbance import drop_trials
from tests.trials.made_trace import trace


def test_masses_that_miss_leave_no_figure() -> None:
    """Neither a torque of 0 nor one of the walk; those and the fallen robots are counted in notes."""
    missed = trace(
        tau_motor=np.full((1, 3, 40, 4), 2.0),
        fell=np.array([[False, True, False]]),
        contact=np.array([[0.02, 0.02, np.nan]]),
    )
    found = drop_trials.measured(missed)
    for name in ("min_height", "peak_down_velocity", "acceleration", "FR", "RL"):
        assert np.isnan(found[name]).tolist() == [[False, False, True]]
    assert found["FR"][0, :2] == pytest.approx(2.0)
    assert drop_trials.lost([found]) == [
        "1 of 3 masses missed the robot and leave no figure.",
        "1 of 3 falling masses brought the trunk below 0.1 m; their figures count.",
    ]
    assert drop_trials.lost([{**found, "min_height": np.ones((1, 3)), "fell": found["fell"] & False}]) == []


def test_drop_is_measured_from_the_contact_on() -> None:
    """A torque that is 2 before the contact and 6 N·m after it has the mean 6; the trunk decelerates by 3 m/s^2."""
    t, contact = 0.005 * np.arange(1.0, 41.0), np.array([[0.05, 0.08, 0.1]])
    after = t > contact[..., None]
    found = drop_trials.measured(
        trace(
            tau_motor=np.where(after, 6.0, 2.0)[..., None] * np.ones(4),
            velocity=np.where(after, -3.0 * (t - contact[..., None]), 0.0),
            contact=contact,
        )
    )
    np.testing.assert_array_equal(found["FR"], 6.0)
    rounding = 8.0 * np.finfo(float).eps * t[-1] / 0.005  # of differences over a step of speeds and stamps
    np.testing.assert_allclose(found["acceleration"], 3.0, rtol=rounding)
    np.testing.assert_allclose(found["peak_down_velocity"], -3.0 * (t[-1] - contact))


@pytest.mark.parametrize("torque", drop_trials.BOUND)
def test_bounding_devices_slide_at_their_torque(torque: float) -> None:
    """At any speed, within the allowed range of every parameter, after a fiftieth of a radian."""
    variant = drop_trials.ideal(torque)
    for name, value in variant.params.items():
        MrParams.spec(name).check(value, "test")
    law = BoucWenParams(**variant.params)
    assert law.sliding_torque(variant.current) == pytest.approx(torque)
    assert law.alpha == 0.0 and law.z_bound == pytest.approx(1.0 / drop_trials.QUICK)


def test_two_masses_part_after_half_a_period() -> None:
    """Two free masses on such a spring, stepped finely, press on each other for 0.1 s."""
    k, (first, second), dt = contact_stiffness(10.0, 12.6, 0.1), (10.0, 12.6), 1e-5
    x, v, t = 0.0, 1.5, 0.0
    while x >= 0.0:
        v -= dt * k * x * (1.0 / first + 1.0 / second)
        x += dt * v
        t += dt
    assert t == pytest.approx(0.1, abs=2.0 * dt)
    assert drop_trials.STIFFNESS == pytest.approx(k)
