"""A device only resists: eq. 6 never does positive work (eq. 7), and neither does the brake constraint."""

import numpy as np
import warp as wp

from mrwarp.kernels.brake import constraint_torque
from tests.kernels.law_kernels import f32, oppose_velocity_kernel


@wp.kernel
def constraint_torque_kernel(
    # parameters
    creep: wp.float64,
    # in, shape (N,)
    qd_next_in: wp.array[wp.float64],
    bound_in: wp.array[wp.float64],
    # out, shape (N,)
    tau_out: wp.array[wp.float64],
):
    """Torque of the brake constraint."""
    i = wp.tid()
    tau_out[i] = constraint_torque(qd_next_in[i], bound_in[i], creep)


def oppose(tau, qd) -> np.ndarray:
    """Projected torque, into an output poisoned with NaN."""
    tau, qd = (wp.array(np.atleast_2d(f32(x)), dtype=float, device="cpu") for x in (tau, qd))
    out = wp.full(tau.shape, float("nan"), dtype=float, device="cpu")
    wp.launch(oppose_velocity_kernel, dim=tau.shape, inputs=[tau, qd], outputs=[out], device="cpu")
    return out.numpy()


def constraint(qd_next: np.ndarray, bound: np.ndarray, creep: float) -> np.ndarray:
    """Constraint torque in float64, into an output poisoned with NaN."""
    arrays = [wp.array(np.asarray(x, dtype=float), dtype=wp.float64, device="cpu") for x in (qd_next, bound)]
    out = wp.full(len(qd_next), float("nan"), dtype=wp.float64, device="cpu")
    inputs = [wp.float64(creep), *arrays]
    wp.launch(constraint_torque_kernel, dim=len(qd_next), inputs=inputs, outputs=[out], device="cpu")
    return out.numpy()


def test_oppose_velocity_signs():
    """For any sign of the prediction the torque opposes the motion; at standstill there is none."""
    tau = oppose([2.0, 2.0, -2.0, -2.0, 2.0, -2.0, 2.0], [1.0, -1.0, 1.0, -1.0, 0.0, 0.0, -0.0])
    np.testing.assert_array_equal(tau[0], [-2.0, 2.0, -2.0, 2.0, 0.0, 0.0, 0.0])


def test_oppose_velocity_never_does_positive_work():
    """Eq. 7 over 5 seeds: power <= 0 at each of 10^5 points, velocities down to 1e-30 rad/s."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        qd = f32(rng.choice([-1, 1], 100_000) * 10.0 ** rng.uniform(-30, 2, 100_000))
        predicted = f32(rng.normal(0, 5, 100_000))
        tau = oppose(predicted, qd)[0]
        assert (tau.astype(float) * qd).max() <= 0.0
        np.testing.assert_array_equal(abs(tau), abs(predicted))


def test_constraint_torque_is_the_clipped_creep_law():
    """-qd_next/creep between the bounds, the bound beyond them, 0 for a bound of 0."""
    qd, bound = np.array([0.0, 1e-5, -1e-5, 1.0, -1.0, 1.0]), np.array([2.0, 2.0, 2.0, 2.0, 2.0, 0.0])
    tau = constraint(qd, bound, creep=1e-4)
    np.testing.assert_allclose(tau, [0.0, -0.1, 0.1, -2.0, 2.0, 0.0], rtol=1e-15, atol=0)


def test_constraint_torque_never_does_positive_work():
    """tau*qd_next <= 0 and |tau| <= bound over 5 seeds and creeps from 1e-9 to 1e-2 rad/s per N·m."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        qd = rng.choice([-1, 1], 10_000) * 10.0 ** rng.uniform(-12, 2, 10_000)
        bound = rng.uniform(0, 25, 10_000)
        tau = constraint(qd, bound, 10.0 ** rng.uniform(-9, -2))
        assert (tau * qd).max() <= 0.0
        assert (abs(tau) - bound).max() <= 0.0
