"""Velocity from angle: exact for cubics, no phase, known gain, usable ends."""

import numpy as np
import pytest

from mrwarp.recording.differentiate import differentiate, frequency_response, half_samples, quiet_half


@pytest.mark.parametrize("dt", [0.001, 0.005, 0.01])
def test_cubic_is_differentiated_exactly_up_to_the_ends(dt: float):
    """Each window fits a cubic, so a cubic's slope comes out to rounding, at the ends too."""
    t = np.arange(200) * dt
    x = 3.0 - 2.0 * t + 5.0 * t**2 - 7.0 * t**3
    # rounding of x (about 4) over one step
    assert np.abs(differentiate(x, dt) - (-2.0 + 10.0 * t - 21.0 * t**2)).max() < 100 * 4e-16 * 4.0 / dt


@pytest.mark.parametrize("f", [0.5, 2.0, 15.0])
def test_sine_has_no_phase_and_the_declared_gain(f: float):
    """Away from the ends the derivative of a sine is the cosine times the filter's real gain."""
    dt, n = 0.001, 4000
    t = np.arange(n) * dt
    omega = 2.0 * np.pi * f
    gain = frequency_response(np.array([f]), dt)[0]
    inside = slice(20, -20)
    out = differentiate(np.sin(omega * t), dt)[inside]
    assert np.abs(out - gain * omega * np.cos(omega * t[inside])).max() < 1e-9 * omega
    assert abs(gain - 1.0) < 0.02


def test_ends_of_a_sine_are_as_good_as_a_cubic_there():
    """The last half window follows one cubic over the last window of length 2w: its slope errs by f'''' w^3 at most."""
    dt, omega = 0.005, 2.0 * np.pi * 2.0
    t = np.arange(400) * dt
    error = np.abs(differentiate(np.sin(omega * t), dt) - omega * np.cos(omega * t))
    w = dt * half_samples(len(t), dt)
    assert error[:2].max() < omega**4 * w**3
    assert error[-2:].max() < omega**4 * w**3


def test_half_window_is_the_same_time_at_every_rate_and_fits_short_signals():
    """10 ms on each side, never less than two samples, never more than the signal holds."""
    assert [half_samples(1000, dt) for dt in (0.0005, 0.001, 0.005, 0.02)] == [20, 10, 2, 2]
    assert half_samples(7, 0.001) == 3


def test_noise_is_averaged_at_high_rates():
    """White noise of the encoder: at 1 kHz the slope's SD is far below the one of plain differences."""
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(20000) * 1e-4
    # by the coefficients of a cubic over 21 samples: 0.064
    assert differentiate(noise, 0.001).std() < 0.1 * np.diff(noise).std() / 0.001


def test_the_window_follows_the_noise_and_not_the_motion() -> None:
    """Slow motion under noise gets a longer window, quick or clean motion keeps its own."""
    dt, rng = 0.001, np.random.default_rng(0)
    t = np.arange(8000) * dt
    slow, quick = 1e-4 * np.sin(2.0 * np.pi * 0.25 * t), 1e-4 * np.sin(2.0 * np.pi * 20.0 * t)
    noise = 1e-6 * rng.normal(size=len(t))
    assert quiet_half(slow, dt) == quiet_half(quick, dt) == 10
    assert quiet_half(quick + noise, dt) == 10
    half = quiet_half(slow + noise, dt)
    truth = 2.0 * np.pi * 0.25 * 1e-4 * np.cos(2.0 * np.pi * 0.25 * t)
    narrow, wide = (np.std(differentiate(slow + noise, dt, h) - truth) / np.std(truth) for h in (10, half))
    assert narrow > 0.3 and wide < 0.1
    assert quiet_half(np.round(slow / 2e-6) * 2e-6, dt) > 10  # steps of an encoder
