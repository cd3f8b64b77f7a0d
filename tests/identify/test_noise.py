"""Noise of a data set: whitening of coloured noise, spread of offsets and factors between trajectories."""

import numpy as np
import pytest
from scipy.signal import lfilter

from mrwarp.identify.noise import Noise, estimate_noise, trajectory_spread
from tests.identify.synthetic import DT, samples


def torque(runs: int, count: int) -> np.ndarray:
    """A torque that swings in every trajectory."""
    t = np.arange(count) * DT
    return np.concatenate([np.sin(2 * np.pi * (0.7 + 0.1 * k) * t) for k in range(runs)])


def correlation(x: np.ndarray, lag: int) -> float:
    """Autocorrelation at a lag."""
    return float(x[lag:] @ x[:-lag] / (x @ x))


def test_whitening_makes_coloured_noise_white() -> None:
    """White noise plus first-order noise of 50 ms: whitened, nothing up to 60 ms correlates; variance 1."""
    runs, count, rng = 12, 1500, np.random.default_rng(1)
    keep = np.exp(-DT / 0.05)
    noise = 0.01 * np.asarray(lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], rng.normal(size=runs * count)))
    noise = noise + 0.02 * rng.normal(size=runs * count)
    at = samples([count] * runs)
    found = estimate_noise(noise, torque(runs, count), at, offset=0.1, gain=0.2)
    assert found.rms == pytest.approx(np.sqrt(5e-4), rel=0.05) and (found.offset, found.gain) == (0.1, 0.2)
    parts = [found.white(noise[part])[4:] for part in at.parts]
    assert np.mean([part.var() for part in parts]) == pytest.approx(1.0, rel=0.03)
    assert correlation(noise, 1) > 0.15 and correlation(noise, 6) > 0.08
    for lag in range(1, 13):
        now = np.mean([correlation(part, lag) for part in parts])
        assert abs(now) < 0.06  # four coefficients approach the sum's infinite filter; 0.0075 is the standard error


@pytest.mark.parametrize("true", [(0.0,), (0.8,), (0.5, 0.2, -0.3)])
def test_autoregression_is_recovered(true: tuple[float, ...]) -> None:
    """The filter and the size of an autoregressive noise of up to fourth order, to their standard errors."""
    runs, count, rng = 10, 2000, np.random.default_rng(2)
    noise = lfilter([0.3], [1.0, *(-x for x in true)], rng.normal(size=runs * count))
    found = estimate_noise(noise, torque(runs, count), samples([count] * runs), 0.0, 0.0)
    want = np.zeros(5)
    want[0], want[1 : 1 + len(true)] = 1.0, np.negative(true)
    np.testing.assert_allclose(found.whitening, want, atol=4.0 / np.sqrt(runs * count))
    assert found.sigma == pytest.approx(0.3, rel=0.02)


def test_short_trajectories_take_a_shorter_filter() -> None:
    """A filter of order 4 needs 200 samples a trajectory; 60 give order 1."""
    noise = np.random.default_rng(3).normal(size=600)
    assert len(estimate_noise(noise, noise, samples([60] * 10), 0.0, 0.0).whitening) == 2
    assert len(estimate_noise(noise, noise, samples([300] * 2), 0.0, 0.0).whitening) == 5


def test_white_is_the_filter_in_units_of_sigma() -> None:
    """Each row by the filter, divided by sigma; the first samples have no past."""
    rows = np.random.default_rng(4).normal(size=(3, 40))
    noise = Noise(whitening=np.array([1.0, -0.6, 0.1]), sigma=0.2, rms=0.3, offset=0.0, gain=0.0)
    want = np.array([np.convolve(row, noise.whitening)[:40] for row in rows]) / 0.2
    np.testing.assert_allclose(noise.white(rows), want, rtol=1e-12)


def test_silence_has_a_noise_of_its_own() -> None:
    """Data without noise give a tiny sigma, not 0: nothing is divided by zero."""
    found = estimate_noise(np.zeros(800), torque(2, 400), samples([400] * 2), 0.0, 0.0)
    assert 0.0 < found.sigma < 1e-5 and np.isfinite(found.whitening).all()


@pytest.mark.parametrize(("offset", "gain"), [(0.03, 0.02), (0.005, 0.04), (0.03, 0.003)])
def test_spread_of_offsets_and_factors_is_recovered(offset: float, gain: float) -> None:
    """Over 80 trajectories both spreads come out, rather too large than too small by their standard error."""
    runs, count, rng = 80, 400, np.random.default_rng(5)
    tau = torque(runs, count)
    drawn = rng.normal(size=(2, runs, 1))
    mismatch = offset * drawn[0] + gain * drawn[1] * tau.reshape(runs, count)
    mismatch = mismatch.ravel() + 0.01 * rng.normal(size=runs * count)
    found = trajectory_spread(mismatch, tau, samples([count] * runs), np.empty((runs, 0)))
    for value, true in zip(found, (offset, gain), strict=True):
        assert 0.6 * true < value < 1.35 * true + 1.5e-3


def test_trends_are_no_spread() -> None:
    """Offsets and factors that follow what may change them from trajectory to trajectory do not count as noise."""
    runs, count, rng = 40, 400, np.random.default_rng(7)
    tau, trend = torque(runs, count), np.linspace(-1.0, 1.0, runs)[:, None]
    mismatch = (0.05 * trend - 0.08 * trend * tau.reshape(runs, count)).ravel()
    mismatch += 0.01 * rng.normal(size=runs * count)
    with_trend = trajectory_spread(mismatch, tau, samples([count] * runs), trend)
    without = trajectory_spread(mismatch, tau, samples([count] * runs), np.empty((runs, 0)))
    assert max(with_trend) < 4e-3 and without[0] > 0.02 and without[1] > 0.04


def test_noise_alone_gives_no_spread() -> None:
    """Noise's part in offsets and factors is taken out: the rest is below their standard error."""
    runs, count, rng = 60, 400, np.random.default_rng(6)
    keep = np.exp(-DT / 0.05)
    noise = 0.02 * np.asarray(lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], rng.normal(size=runs * count)))
    offset, gain = trajectory_spread(noise, torque(runs, count), samples([count] * runs), np.empty((runs, 0)))
    # a mean over 400 samples correlated over 10 on each side
    assert offset < 0.02 * np.sqrt(20.0 / count) and gain < 0.02 * np.sqrt(2.0 * 20.0 / count)
