"""Pre-yield holding: capacity (eq. 18), its inverse with margin, and the clipped torque (eq. 19)."""

import numpy as np
import warp as wp

from tests.kernels.law_kernels import f32, hold_kernel

T_MAX, K, N, FACTOR, I_MAX = 26.59697, 0.51272, 2.87967, 1.2, 1.5


def yield_torque(current: np.ndarray) -> np.ndarray:
    """Eq. 18 in float64, as printed."""
    return T_MAX * current**N / (K**N + current**N)


def hold(need, current, factor=FACTOR, current_max=I_MAX) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Capacity, support current and holding torque, into outputs poisoned with NaN."""
    need, current = np.broadcast_arrays(np.atleast_2d(f32(need)), np.atleast_2d(f32(current)))
    arrays = [wp.array(np.ascontiguousarray(x), dtype=float, device="cpu") for x in (need, current)]
    outs = [wp.full(need.shape, float("nan"), dtype=float, device="cpu") for _ in range(3)]
    inputs = [T_MAX, K, N, factor, current_max, *arrays]
    wp.launch(hold_kernel, dim=need.shape, inputs=inputs, outputs=outs, device="cpu")
    capacity, support, tau = (x.numpy() for x in outs)
    return capacity, support, tau


def test_yield_torque_of_the_paper():
    """25.44 N·m at 1.5 A, half of T_max at I = K, nothing without current; the sign of the current does not count."""
    tau_y = hold(0.0, [1.5, K, 0.0, -1.5])[0][0]
    np.testing.assert_allclose(tau_y, [25.44, T_MAX / 2, 0.0, 25.44], rtol=0, atol=5e-3)


def test_yield_torque_equals_eq_18_and_is_monotone():
    """Against the printed form in float64 from 1 mA to 10 A; it never falls and stays below T_max."""
    current = np.linspace(1e-3, 10, 2000)
    tau_y = hold(0.0, current)[0][0]
    # float32 pow errs by a few eps, n times that of its argument
    np.testing.assert_allclose(tau_y, yield_torque(f32(current).astype(float)), rtol=2e-6)
    assert np.diff(tau_y).min() >= 0.0
    assert tau_y.max() < T_MAX


def test_support_current_holds_the_need_with_its_margin():
    """tau_y(support_current(tau)) = 1.2*tau until the controller's limit, and the limit from there on."""
    reach = yield_torque(np.array(I_MAX)) / FACTOR
    need = np.linspace(0.01, 0.999 * reach, 500)
    support = hold(need, 0.0)[1][0]
    np.testing.assert_allclose(hold(0.0, support)[0][0], FACTOR * need, rtol=1e-4)
    np.testing.assert_array_equal(hold(-need, 0.0)[1][0], support)
    beyond = np.linspace(1.001 * reach, 3 * T_MAX, 100)
    np.testing.assert_array_equal(hold(beyond, 0.0)[1][0], f32(I_MAX))
    assert hold(0.0, 0.0)[1][0, 0] == 0.0


def test_support_current_of_other_margins():
    """The inverse scales with the safety factor."""
    support = hold([5.0, 10.0], 0.0, factor=2.0, current_max=10.0)[1][0]
    np.testing.assert_allclose(yield_torque(support.astype(float)), [10.0, 20.0], rtol=1e-4)


def test_holding_torque_is_the_need_within_the_capacity():
    """Eq. 19 over random needs and currents: |tau| <= tau_y, and equal to the need where that fits."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        need, current = rng.uniform(-40, 40, (100, 4)), rng.uniform(0, 1.5, (100, 4))
        tau_y, _, tau = hold(need, current)
        assert (abs(tau) - tau_y).max() <= 0.0
        np.testing.assert_array_equal(tau, np.clip(f32(need), -tau_y, tau_y))
