"""Steps within bounds and damped searches, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from mrwarp.sysid.least_squares import Rules, minimise, minimum_within, ridge_solve
from mrwarp.sysid.pieces import Quadratic


def test_ridge_solve_is_scale_free() -> None:
    """Columns of sizes 1e-6 and 1e6 and a stack of systems are solved as each alone in units of its own."""
    rng = np.random.default_rng(3)
    x = rng.normal(size=(3, 50, 4))
    b = rng.normal(size=(3, 50))
    scale = np.array([1.0, 1e-6, 1e6, 1.0])
    gram, moment = np.einsum("tni,tnj->tij", x * scale, x * scale), np.einsum("tni,tn->ti", x * scale, b)
    found = ridge_solve(gram, moment)
    for k in range(3):
        want = np.linalg.lstsq(x[k], b[k], rcond=None)[0] / scale
        np.testing.assert_allclose(found[k], want, rtol=1e-5)
        np.testing.assert_allclose(found[k], ridge_solve(gram[k], moment[k]), rtol=1e-12)


def test_ridge_solve_survives_a_column_twice() -> None:
    """Two equal columns share their coefficient; a column of zeros gets none."""
    x = np.random.default_rng(4).normal(size=(50, 1))
    table = np.column_stack([x, x, 0.0 * x])
    found = ridge_solve(table.T @ table, table.T @ (3.0 * x[:, 0]))
    np.testing.assert_allclose(found, [1.5, 1.5, 0.0], atol=1e-5)


def test_derivatives_are_asked_for_at_better_points_only() -> None:
    """With a loss that is looked at first the search takes the same steps to the same end; worse points cost that."""

    def about(x: np.ndarray) -> Quadratic:  # too long a first step: the slope of arctan falls with x
        slope = 1.0 / (1.0 + x**2)
        return Quadratic(loss(x), np.diag(slope**2), -slope * np.arctan(x))

    def loss(x: np.ndarray) -> float:
        return float(np.arctan(x) @ np.arctan(x))

    asked: list[tuple[float, float]] = []

    def counted(x: np.ndarray) -> Quadratic:
        found = about(x)
        asked.append((found.loss, min([y for y, _ in asked], default=np.inf)))
        return found

    bounds = np.full(2, -50.0), np.full(2, 50.0)
    every = minimise(counted, np.array([2.0, 3.0]), *bounds).x
    worse = [a for a, best in asked if a >= best]
    assert worse
    count, asked[:] = len(asked), []
    found = minimise(counted, np.array([2.0, 3.0]), *bounds, seen=lambda x, here: replace(here, loss=loss(x)))
    np.testing.assert_array_equal(found.x, every)
    assert found.fresh
    assert all(a < best for a, best in asked) and len(asked) == count - len(worse)


def test_a_number_that_is_drawn_inwards_is_let_go_of_its_bound() -> None:
    """The free minimum leaves a bound of the first number, and once the second is held too it comes back inside."""
    normal, low, high = np.array([[1.0, 0.9], [0.9, 1.0]]), np.zeros(2), np.full(2, np.inf)
    descent = normal @ np.array([-0.1, -1.0])
    x, held = minimum_within(normal, descent, low, high)
    tried = [np.zeros(2), *(np.where(np.arange(2) == k, max(descent[k], 0.0), 0.0) for k in range(2))]
    worth = [y @ normal @ y - 2.0 * descent @ y for y in tried]
    np.testing.assert_allclose(x, tried[int(np.argmin(worth))], atol=1e-8)
    np.testing.assert_array_equal(held, x == 0.0)


@pytest.mark.parametrize("seed", range(5))
def test_the_minimum_within_bounds_is_that_of_every_set_of_held_numbers(seed: int) -> None:
    """Six numbers with random bounds: no other combination of held and free ones that is inside is better."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 6))
    normal, descent = root @ root.T + 0.1 * np.eye(6), rng.normal(size=6)
    low, high = -rng.uniform(0.0, 0.3, 6), rng.uniform(0.0, 0.3, 6)
    x, _ = minimum_within(normal, descent, low, high)
    gradient = normal @ x - descent  # the conditions of Karush, Kuhn and Tucker
    assert ((x >= low) & (x <= high)).all()
    assert (np.abs(gradient[(x > low) & (x < high)]) < 1e-7).all()
    assert (gradient[x == low] >= -1e-7).all() and (gradient[x == high] <= 1e-7).all()


def test_derivatives_that_keep_their_promise_are_not_taken_again() -> None:
    """Of a nearly linear plant they are taken once, of a bent one as often as is allowed; both end at the truth."""
    truth, taken = np.array([0.7, -0.4]), list[np.ndarray]()

    def search(bend: float, renewals: int) -> tuple[np.ndarray, int]:
        taken.clear()

        def mismatch(x: np.ndarray) -> np.ndarray:
            return truth + bend * truth**3 - x - bend * x**3

        def about(x: np.ndarray) -> Quadratic:
            taken.append(x)
            return seen(x, Quadratic(0.0, np.eye(2), np.zeros(2), np.diag(1.0 + 3.0 * bend * x**2)))

        def seen(x: np.ndarray, here: Quadratic) -> Quadratic:
            left, slope = mismatch(x), here.content
            return Quadratic(float(left @ left), slope.T @ slope, slope.T @ left, slope)

        rules = Rules(iterations=30, stale=lambda gain, promised: gain < 0.9 * promised, renewals=renewals)
        found = minimise(about, np.zeros(2), np.full(2, -2.0), np.full(2, 2.0), rules=rules, seen=seen)
        return found.x, len(taken)

    for bend, renewals, count in ((0.01, 3, 1), (2.0, 1, 2)):
        x, derivatives = search(bend, renewals)
        assert derivatives == count
        np.testing.assert_allclose(x, truth, atol=2e-2)
