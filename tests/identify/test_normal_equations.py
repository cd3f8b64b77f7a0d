"""Normal equations per trajectory: against explicit covariance matrices and brute-force refits."""

import numpy as np
import pytest

from mrwarp.identify.dataset import Dataset, Scales
from mrwarp.identify.noise import Noise
from mrwarp.identify.normal_equations import NormalEquations, losses

RUNS, COUNT, COLUMNS = 5, 60, 4
FILTER = np.array([1.0, -0.5, 0.2])


@pytest.fixture
def table() -> tuple[np.ndarray, np.ndarray, Dataset]:
    """Four columns and a target, a torque, and five trajectories of different lengths."""
    rng = np.random.default_rng(1)
    start = np.cumsum([0, 50, 70, 40, 80, 60])
    zero = np.zeros(start[-1])
    samples = Dataset(q=zero, qd=zero, current=zero, torque=zero, start=start, dt=np.full(RUNS, 0.005), scales=Scales())
    rows = rng.normal(size=(COLUMNS + 1, start[-1]))
    rows[-1] += np.array([1.0, -2.0, 0.5, 0.0]) @ rows[:-1]
    return rows, rng.normal(size=start[-1]) + 1.0, samples


def whitened(rows: np.ndarray) -> np.ndarray:
    """Signals behind the filter, in units of sigma = 0.3."""
    return np.array([np.convolve(row, FILTER)[: rows.shape[1]] for row in rows]) / 0.3


def noise(offset: float, gain: float) -> Noise:
    """The noise model of the tests."""
    return Noise(whitening=FILTER, sigma=0.3, rms=0.4, offset=offset, gain=gain)


def test_offsets_and_factors_are_marginalised(table: tuple) -> None:
    """Each trajectory's matrix is X Cov^-1 X' with the covariance of noise, offset and factor written out."""
    rows, torque, samples = table
    found = NormalEquations([rows], torque, samples, noise(0.2, 0.1), np.ones(rows.shape[1]))
    shared = whitened(np.stack([np.ones(rows.shape[1]), torque]))
    for k, part in enumerate(samples.parts):
        part = slice(part.start + len(FILTER) - 1, part.stop)  # the first have no past
        one, f = shared[:, part]
        covariance = np.eye(len(one)) + 0.2**2 * np.outer(one, one) + 0.1**2 * np.outer(f, f)
        x = whitened(rows)[:, part]
        np.testing.assert_allclose(found.parts[k], x @ np.linalg.solve(covariance, x.T), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.total, found.parts.sum(0))


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_signals_that_are_not_finite_leave_an_infinite_loss(table: tuple) -> None:
    """A replay that overflows in one trajectory is judged as one that explains nothing, without a warning."""
    rows, torque, samples = table
    rows, torque = rows.copy(), torque.copy()
    rows[-1, samples.parts[1]] = torque[samples.parts[1]] = -np.inf
    weight = np.ones(rows.shape[1])
    found = NormalEquations([rows], torque, samples, noise(0.2, 0.1), weight, derivatives=True)
    assert found.total[-1, -1] == np.inf and np.isfinite(found.parts[-1]).all()
    _, inside, outside = losses(found, [0, 1, 2, 3], COLUMNS)
    assert inside[1] == outside[1] == np.inf and np.isfinite(outside[-1])


def test_derivatives_follow_the_factor_of_their_trajectory(table: tuple) -> None:
    """The slope of the loss over a model's numbers, where trajectories differ by large factors, is that of the loss."""
    rows, _, samples = table
    columns, weight = rows[:2] + 2.0, np.ones(rows.shape[1])
    measured = np.array([1.0, -0.4]) @ columns + 0.05 * rows[-1]
    for part, factor in zip(samples.parts, (0.5, 0.7, 0.8, 1.3, 0.6), strict=True):
        measured[part] *= factor

    def gram(x: np.ndarray, derivatives: bool) -> np.ndarray:
        torque = x @ columns
        blocks = [columns, (measured - torque)[None]]
        return NormalEquations(blocks, torque, samples, noise(0.1, 0.3), weight, derivatives=derivatives).total

    x, h = np.array([1.1, -0.3]), 1e-5
    loss = [[gram(x + sign * h * step, True)[-1, -1] for sign in (1.0, -1.0)] for step in np.eye(2)]
    slope = -np.diff(loss)[:, 0] / (2.0 * h)
    np.testing.assert_allclose(2.0 * gram(x, True)[:-1, -1], -slope, rtol=1e-4)
    assert np.abs(2.0 * gram(x, False)[:-1, -1] + slope).max() > 0.1 * np.abs(slope).max()


def test_weights_leave_samples_out(table: tuple) -> None:
    """Samples of weight 0 do not count, nor the first of each trajectory; without spread it is a plain sum."""
    rows, torque, samples = table
    weight = (np.arange(rows.shape[1]) % 3 > 0).astype(float)
    found = NormalEquations([rows], torque, samples, noise(0.0, 0.0), weight)
    counted = weight.copy()
    for part in samples.parts:
        counted[part.start : part.start + 2] = 0.0
    x = whitened(rows) * counted
    np.testing.assert_allclose(found.total, x @ x.T, rtol=1e-6, atol=1e-6)
    assert found.count == counted.sum()


def test_left_out_losses_are_those_of_refits(table: tuple) -> None:
    """Leave-one-trajectory-out losses equal refits without the trajectory, by least squares on the samples."""
    rows, torque, samples = table
    found = NormalEquations([rows], torque, samples, noise(0.0, 0.0), np.ones(rows.shape[1]))
    use = [0, 2, 3]
    solution, inside, outside = losses(found, use, COLUMNS, ridge=0.0)
    x = whitened(rows)
    parts = [slice(part.start + 2, part.stop) for part in samples.parts]
    every = np.concatenate([np.arange(part.start, part.stop) for part in parts])
    best = np.linalg.lstsq(x[use][:, every].T, x[-1, every], rcond=None)[0]
    np.testing.assert_allclose(solution, best, rtol=1e-7)
    for k, part in enumerate(parts):
        rest = np.concatenate([np.arange(p.start, p.stop) for j, p in enumerate(parts) if j != k])
        without = np.linalg.lstsq(x[use][:, rest].T, x[-1, rest], rcond=None)[0]
        assert inside[k] == pytest.approx(((x[-1, part] - best @ x[use, part]) ** 2).sum(), rel=1e-6)
        assert outside[k] == pytest.approx(((x[-1, part] - without @ x[use, part]) ** 2).sum(), rel=1e-6)
    assert (outside > inside).all()


def test_left_out_losses_with_marginalised_offsets(table: tuple) -> None:
    """With spreads too: a refit weighs each trajectory by its own covariance."""
    rows, torque, samples = table
    found = NormalEquations([rows], torque, samples, noise(0.3, 0.2), np.ones(rows.shape[1]))
    _, _, outside = losses(found, [0, 1], COLUMNS, ridge=0.0)
    for k in range(RUNS):
        rest = found.total - found.parts[k]
        b = np.linalg.solve(rest[:2, :2], rest[:2, COLUMNS])
        own = found.parts[k]
        vector = np.array([*-b, 1.0])
        keep = [0, 1, COLUMNS]
        assert outside[k] == pytest.approx(vector @ own[np.ix_(keep, keep)] @ vector, rel=1e-7)


def test_useless_column_gains_nothing_left_out(table: tuple) -> None:
    """A column of noise lowers the loss inside and, on average over many, raises the left-out loss by about 1."""
    rows, torque, samples = table
    rng = np.random.default_rng(2)
    added = []
    for _ in range(200):
        tried = np.vstack([rows[:-1], rng.normal(size=rows.shape[1]), rows[-1]])
        # the target's own noise: after the filter, of unit variance
        grams = NormalEquations(
            [tried],
            torque,
            samples,
            Noise(whitening=np.ones(1), sigma=1.0, rms=1.0, offset=0.0, gain=0.0),
            np.ones(rows.shape[1]),
        )
        inside = [losses(grams, list(range(n)), COLUMNS + 1)[1].sum() for n in (COLUMNS, COLUMNS + 1)]
        outside = [losses(grams, list(range(n)), COLUMNS + 1)[2].sum() for n in (COLUMNS, COLUMNS + 1)]
        assert inside[1] < inside[0]
        added.append(outside[1] - outside[0])
    assert 0.3 < np.mean(added) < 2.5
