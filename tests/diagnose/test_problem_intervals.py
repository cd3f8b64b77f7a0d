"""Intervals against the closed form of linear regression, and the scatter between trajectories."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import t as student

from mrwarp.diagnose.problem import covariance, interval
from mrwarp.identify.noise import Noise
from mrwarp.identify.normal_equations import NormalEquations
from tests.diagnose import known
from tests.identify.synthetic import samples

TRUE = np.array([1.0, -2.0, 0.5])


def regression(seed: int, runs: int, *, count: int = 100, sigma: float = 0.3, scatter: float = 0.0) -> Any:
    """A fit of three columns to runs * count samples; each run's true coefficients scatter."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(3, runs * count)) * np.array([1.0, 10.0, 0.1])[:, None]
    own = TRUE[:, None] + scatter * rng.normal(size=(3, runs)) / np.array([1.0, 10.0, 0.1])[:, None]
    y = (x * own.repeat(count, axis=1)).sum(0) + sigma * rng.normal(size=runs * count)
    noise = Noise(whitening=np.ones(1), sigma=sigma, rms=sigma, offset=0.0, gain=0.0)
    plain = np.linalg.lstsq(x.T, y, rcond=None)[0]
    equations = NormalEquations([x, (y - plain @ x)[None]], 0.0 * y, samples([count] * runs), noise, np.ones(len(y)))
    return SimpleNamespace(x=plain, equations=equations, table=x, sigma=sigma, least_variance=None)


def test_covariance_of_few_trajectories_is_that_of_the_noise() -> None:
    """With two trajectories: sigma^2 (X X')^-1."""
    fit = regression(1, 2)
    want = fit.sigma**2 * np.linalg.inv(fit.table @ fit.table.T)
    grown = max(1.0, float(fit.equations.total[3, 3]) / fit.equations.count)
    np.testing.assert_allclose(covariance(fit), grown * want, rtol=1e-5)


def test_covariance_of_equal_trajectories_is_that_of_the_noise() -> None:
    """Forty equal trajectories scatter as the noise says: the jackknife raises the error by its own scatter at most."""
    fit = regression(2, 40)
    want = fit.sigma**2 * np.linalg.inv(fit.table @ fit.table.T)
    ratio = np.sqrt(np.diag(covariance(fit)) / np.diag(want))
    assert (ratio > 0.999).all() and (ratio < 1.35).all()


def test_trajectories_that_disagree_widen_the_interval() -> None:
    """Coefficients that scatter by 0.2 between 40 trajectories are known to 0.2/sqrt(40), not to the noise's error."""
    fit = regression(3, 40, scatter=0.2)
    error = np.sqrt(np.diag(covariance(fit))) * np.array([1.0, 10.0, 0.1])
    assert error == pytest.approx(np.full(3, np.hypot(0.2, 0.3 / 10.0) / np.sqrt(40)), rel=0.4)


def test_interval_is_students() -> None:
    """Half of it is the quantile for the trajectories that count, times the error."""
    fit = regression(4, 12)
    spread = covariance(fit)
    low, high = interval(fit, 1, spread)
    information = fit.equations.parts[:, 1, 1]
    effective = information.sum() ** 2 / (information**2).sum()
    half = student.ppf(0.975, effective - 1.0) * np.sqrt(spread[1, 1])
    assert (low, high) == pytest.approx((fit.x[1] - half, fit.x[1] + half), rel=1e-4)


@pytest.mark.parametrize(
    ("runs", "scatter", "most"), [(6, 0.0, 1.0), (12, 0.2, 0.99), (32, 0.2, 0.98), (32, 0.0, 0.98)]
)
def test_intervals_cover_the_truth(runs: int, scatter: float, most: float) -> None:
    """Over 200 data sets the 95 % intervals of three coefficients hold the truth in 92 to 98 %; few runs are safer."""
    held = 0
    for seed in range(200):
        fit = regression(1000 + seed, runs, scatter=scatter)
        spread = covariance(fit)
        for i in range(3):
            low, high = interval(fit, i, spread)
            held += low <= TRUE[i] <= high
    assert 0.92 < held / 600 <= most


def test_redundant_column_has_a_finite_interval() -> None:
    """Two equal columns leave their difference open; nothing is infinite or NaN."""
    fit = regression(5, 6)
    table = np.vstack([fit.table, fit.table[0]])
    zero = np.zeros(table.shape[1])
    noise = Noise(whitening=np.ones(1), sigma=0.3, rms=0.3, offset=0.0, gain=0.0)
    rows = np.vstack([table, np.random.default_rng(6).normal(size=len(zero))])
    equations = NormalEquations([rows], zero, samples([100] * 6), noise, np.ones(len(zero)))
    twice: Any = SimpleNamespace(x=np.zeros(4), equations=equations, least_variance=None)
    assert np.isfinite(covariance(twice)).all()


def test_least_variance_is_kept() -> None:
    """A variance that is known to be larger widens its own coordinate alone."""
    fit = regression(1, 2)
    plain = covariance(fit)
    fit.least_variance = np.diag(plain) * [4.0, 1.0, 0.1]
    np.testing.assert_allclose(np.diag(covariance(fit)), np.diag(plain) * [4.0, 1.0, 1.0], rtol=1e-12)


def test_noise_of_the_joint_is_covered() -> None:
    """In 20 data sets of a joint with an inertia the 95 % interval of the inertia misses the truth at most 4 times."""
    hidden = {"rotor_inertia": {"inertia": 0.002}}
    motion = known.motion(9, runs=6, seconds=2.0)
    missed = 0
    for seed in range(20):
        problem = known.problem(hidden, seed=seed, at=motion)
        fit = known.fitted(problem, hidden)
        low, high = interval(fit, fit.parameters.own("rotor_inertia")[0], covariance(fit))
        assert high - low < 0.002
        missed += not low <= 0.002 <= high
    assert missed <= 4
