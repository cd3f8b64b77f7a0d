"""PD torque within the motor's limit (eqs. 2, 10)."""

from typing import Any

import numpy as np
import warp as wp

from tests.kernels.law_kernels import pd_kernel


def f32(values: Any) -> np.ndarray:
    """The values as a float32 array."""
    return np.asarray(values, dtype=np.float32)


def pd(kp, kd, limit, q_des, q, qd) -> np.ndarray:
    """PD torque, into an output poisoned with NaN."""
    arrays = [wp.array(np.atleast_2d(f32(x)), dtype=float, device="cpu") for x in (kp, kd, limit, q_des, q, qd)]
    out = wp.full(arrays[-1].shape, float("nan"), dtype=float, device="cpu")
    wp.launch(pd_kernel, dim=out.shape, inputs=arrays, outputs=[out], device="cpu")
    return out.numpy()


def test_pd_torque_clips_at_the_limit():
    """kp*e - kd*qd by hand: inside, at either limit, and without a motor (limit 0)."""
    tau = pd([[25, 25, 25, 25]], [[0.5] * 4], [[30, 30, 30, 0]], [[0.2, 2, -2, 1]], [[0.0] * 4], [[2, 0, 0, 0]])
    np.testing.assert_allclose(tau, [[4, 30, -30, 0]], rtol=1e-6)


def test_pd_torque_of_random_joints():
    """Shared and per-environment gains agree with NumPy over 5 seeds; |tau| never passes the limit."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        kp, kd, limit = (f32(rng.uniform(0, top, (7, 3))) for top in (40, 1, 30))
        q_des, q, qd = (f32(rng.normal(0, s, (7, 3))) for s in (1, 1, 10))
        for rows in (7, 1):
            gains = [x[:rows].astype(float) for x in (kp, kd, limit)]
            want = np.clip(gains[0] * (q_des.astype(float) - q) - gains[1] * qd, -gains[2], gains[2])
            tau = pd(kp[:rows], kd[:rows], limit[:rows], q_des, q, qd)
            np.testing.assert_allclose(tau, want, rtol=0, atol=4 * float(np.finfo(np.float32).eps) * 200)
            assert (abs(tau) - limit[:rows]).max() <= 0.0
