"""The robot's motion converges in first order with the step, as semi-implicit Euler must."""

import numpy as np
import pytest

from benchmarks.verify.order import CASES, Order, orders

ORDER = (0.8, 1.2)
"""First, as semi-implicit Euler; stick events scatter it."""


@pytest.fixture(scope="module")
def measured() -> dict[str, Order]:
    """Both cases at 5, 2.5 and 1.25 ms against 39 µs."""
    return {case.name: case for case in orders(seed=0)}


@pytest.mark.parametrize("name", CASES)
def test_robot_converges_in_first_order(measured: dict[str, Order], name: str) -> None:
    """Motors, devices and contacts: halving the step halves the error.

    Measured over seeds 0 to 3: 1.02 to 1.05 (positions), 1.07 to 1.12 (velocities; the next order is not small yet).
    """
    low, high = ORDER
    assert (low <= measured[name].order).all() and (measured[name].order <= high).all()


@pytest.mark.parametrize("name", CASES)
def test_robot_errors_are_real_and_the_reference_is_one(measured: dict[str, Order], name: str) -> None:
    """At 5 ms the error is milliradians, far above rounding; the reference's own is a tenth of the smallest judged."""
    case = measured[name]
    assert (case.rms[0] > (1e-3, 1e-2)).all()
    assert (10.0 * case.reference_error < case.rms[-1]).all()
    assert np.isfinite(case.rms).all()
