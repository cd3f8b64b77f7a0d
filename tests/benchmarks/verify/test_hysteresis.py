"""The hysteresis kernels against float64 references over random motions, currents, current steps and coil lags."""

import numpy as np
import pytest

from benchmarks.verify.hysteresis import (
    METHODS,
    PAPER,
    SEGMENT,
    STEPS,
    Excitation,
    Hysteresis,
    along_the_path,
    hysteresis,
    times,
)
from mrwarp.params import BoucWenParams

HYSTERESIS_ORDER = {"euler": (0.9, 1.1), "exact": (0.95, 1.05), "exact, interpolated": (1.9, 2.1)}
"""Order of the replayed torque: first with the newest velocity held, second with it interpolated."""

AT_5_MS = {"euler": 0.04, "exact": 0.027, "exact, interpolated": 1.3e-4}
"""Largest RMS error of the torque at 5 ms [N·m] (the torque itself: 0.63); measured: 0.027, 0.018, 8.4e-5.

It is the steps' truncation for these motions, half as much again for others; 200 roundings of 32 bits make 8e-6 of it.
"""


def finely_stepped(excitation: Excitation, t: np.ndarray, p: BoucWenParams = PAPER, *, dt: float) -> np.ndarray:
    """z at times of shape (T,), multiples of ``dt`` [rad], shape (N, T), by the midpoint rule."""

    def rate(qd: np.ndarray, z: np.ndarray) -> np.ndarray:
        return qd - p.beta * np.abs(qd) * z - p.gamma * qd * np.abs(z)

    at, chunk = np.rint(t / dt).astype(int), 20_000
    z, result = np.zeros(len(excitation.lag)), np.empty((len(excitation.lag), len(t)))
    wanted = {int(step): column for column, step in enumerate(at)}
    for first in range(0, int(at.max()) + 1, chunk):
        # columns 2k and 2k + 1: velocity at the start and in the middle of step first + k
        qd = np.ascontiguousarray(excitation.qd(0.5 * dt * np.arange(2 * first, 2 * (first + chunk))).T)
        for k in range(chunk):
            if (column := wanted.get(first + k)) is not None:
                result[:, column] = z
            z = z + dt * rate(qd[2 * k + 1], z + 0.5 * dt * rate(qd[2 * k], z))
    return result


@pytest.fixture(scope="module")
def measured() -> Hysteresis:
    """64 random motions replayed at 10 to 0.625 ms."""
    return hysteresis(seed=0)


@pytest.mark.parametrize("method", METHODS)
def test_hysteresis_converges_in_its_order(measured: Hysteresis, method: str) -> None:
    """Orders over 10 to 0.625 ms; measured: 1.035 (Euler), 1.005 (exact), 2.02 (exact, interpolated velocity)."""
    low, high = HYSTERESIS_ORDER[method]
    assert low <= measured.order(method) <= high


@pytest.mark.parametrize("method", METHODS)
def test_hysteresis_error_at_5_ms(measured: Hysteresis, method: str) -> None:
    """Errors against a torque of 0.63 N·m RMS; the largest is at most 60 times the RMS (at a reversal, at 1.5 A)."""
    rms, largest = (table[method][STEPS.index(0.005)] for table in (measured.rms, measured.largest))
    assert 0.3 < measured.size < 1.2
    assert rms < AT_5_MS[method]
    assert rms < largest < 60.0 * rms


def test_hysteresis_reference_equals_fine_steps() -> None:
    """The closed form along the path is what the midpoint rule finds at 100 µs, for the paper's and other loops.

    Its order is 2: from 200 µs it moves by three times what it is still off. Measured: 6.0e-7, 1.6e-7 and 1.2e-7 rad
    (|z| up to 0.17 rad).
    """
    excitation, t = Excitation.draw(16, 3), times(0.005)
    for p in (BoucWenParams(), BoucWenParams(beta=8.0, gamma=3.0), BoucWenParams(beta=5.0, gamma=4.9)):
        coarse, fine = (finely_stepped(excitation, t, p, dt=dt) for dt in (2e-4, 1e-4))
        assert np.abs(fine - along_the_path(excitation, t, p)).max() < np.abs(coarse - fine).max() < 1e-4 * p.z_bound
        assert np.abs(fine).max() > 0.5 * p.z_bound


def test_excitation_is_consistent() -> None:
    """qd is the derivative of q, motions begin at rest and reverse, lagging currents obey their equation.

    A central difference leaves a sixth of the third derivative times h^2, and over h a few roundings of the values and
    one of times up to 1 s.
    """
    excitation, h = Excitation.draw(16, 1), 1e-6
    t = np.linspace(0.02, 0.98, 97)
    slope = (excitation.q(t + h) - excitation.q(t - h)) / (2.0 * h)
    third = np.abs(excitation.amplitude * excitation.frequency**3).sum(axis=1).max()
    rounding = np.finfo(float).eps / h
    atol = third * h**2 / 6.0 + rounding * (4.0 * np.abs(excitation.q(t)).max() + np.abs(slope).max())
    np.testing.assert_allclose(excitation.qd(t), slope, rtol=0, atol=atol)
    assert not excitation.qd(np.zeros(1)).any()
    assert ((np.diff(np.sign(excitation.qd(times(0.001))[:, 1:])) != 0).sum(1) >= 1).all()
    inside = t[np.abs(t / SEGMENT - np.round(t / SEGMENT)) > 1e-3]
    rise = (excitation.current(inside + h) - excitation.current(inside - h)) / (2.0 * h)
    lagging = excitation.lag > 0.0
    missing = excitation.commanded(inside) - excitation.current(inside)
    expected = missing[lagging] / excitation.lag[lagging, None]
    rate = np.abs(expected).max()
    atol = rate / excitation.lag.max() ** 2 * h**2 / 6.0 + rounding * (4.0 * 1.5 + rate)
    np.testing.assert_allclose(rise[lagging], expected, rtol=0, atol=atol)
    assert not missing[~lagging].any() and np.abs(missing[lagging]).max() > 0.5
