"""Coil lag: the exact exponential, and no lag for a time constant of 0."""

import numpy as np
import warp as wp

from tests.kernels.law_kernels import coil_kernel, f32


def coil(command, current, time_constant: float, dt: float) -> np.ndarray:
    """Coil current after one step."""
    return coil_and_mean(command, current, time_constant, dt)[0]


def coil_and_mean(command, current, time_constant: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Coil current after one step and its mean over it, into outputs poisoned with NaN."""
    command, current = (wp.array(np.atleast_2d(f32(x)), dtype=float, device="cpu") for x in (command, current))
    out = [wp.full(command.shape, float("nan"), dtype=float, device="cpu") for _ in range(2)]
    inputs = [time_constant, dt, command, current]
    wp.launch(coil_kernel, dim=command.shape, inputs=inputs, outputs=out, device="cpu")
    return out[0].numpy(), out[1].numpy()


def test_coil_without_lag_follows_its_command():
    """Time constant 0: the current is the command, bit for bit."""
    command = f32(np.random.default_rng(1).uniform(0, 1.5, (5, 4)))
    for found in coil_and_mean(command, np.full((5, 4), 0.7), 0.0, 0.005):
        np.testing.assert_array_equal(found, command)


def test_coil_step_response_is_exponential():
    """60 steps of 5 ms up to 1.5 A and 60 down, T = 30 ms: the closed form, not its Euler approximation."""
    current = np.zeros((1, 1))
    tolerance = 60 * 2 * float(np.finfo(np.float32).eps) * 1.5
    for k in range(1, 61):
        current = coil([[1.5]], current, 0.03, 0.005)
        np.testing.assert_allclose(current, 1.5 * -np.expm1(-k * 0.005 / 0.03), rtol=0, atol=tolerance)
    top = current[0, 0]
    for k in range(1, 61):
        current = coil([[0.0]], current, 0.03, 0.005)
        np.testing.assert_allclose(current, top * np.exp(-k * 0.005 / 0.03), rtol=0, atol=tolerance)


def test_coil_step_does_not_depend_on_the_rate():
    """One step of 5 ms equals five of 1 ms; a time constant far below the step does not overshoot."""
    fine = np.full((1, 1), 0.2)
    for _ in range(5):
        fine = coil([[1.0]], fine, 0.01, 0.001)
    np.testing.assert_allclose(coil([[1.0]], [[0.2]], 0.01, 0.005), fine, rtol=1e-6)
    np.testing.assert_array_equal(coil([[1.0]], [[0.2]], 1e-5, 0.005), [[1.0]])


def test_mean_over_a_step_is_that_of_the_exact_current():
    """The mean over 5 ms equals that of 1,000 exact parts of it, for lags of a tenth to a hundred steps."""
    for lag in (0.0005, 0.005, 0.03, 0.5):
        mean = coil_and_mean([[1.2]], [[0.2]], lag, 0.005)[1]
        middles = (np.arange(1000) + 0.5) * 0.005 / 1000
        want = (1.2 + (0.2 - 1.2) * np.exp(-middles / lag)).mean()
        np.testing.assert_allclose(mean, want, rtol=0, atol=2e-6 + 2e-5 * (lag > 0.1))
