"""Bouc-Wen torque (eq. 14) and state (eq. 15): closed forms, order, rate independence, bounds."""

import numpy as np
import pytest
import warp as wp

from mrwarp.kernels.bouc_wen import bouc_wen_rate, bouc_wen_torque
from tests.kernels.law_kernels import bouc_wen_step_kernel, f32

BETA, GAMMA, Z_MAX, DT = 16.50618, -10.53036, 5.0, 0.005
BOUND = 1.0 / (BETA + GAMMA)
EPS = float(np.finfo(np.float32).eps)


def step(z, qd, dt=DT, exact=True, beta=BETA, gamma=GAMMA) -> np.ndarray:
    """One step of z, shape (E, M), into an output poisoned with NaN."""
    z, qd = (wp.array(np.atleast_2d(f32(x)), dtype=float, device="cpu") for x in (z, qd))
    beta, gamma = (wp.full((1, z.shape[1]), float(x), dtype=float, device="cpu") for x in (beta, gamma))
    out = wp.full(z.shape, float("nan"), dtype=float, device="cpu")
    inputs = [beta, gamma, Z_MAX, dt, int(exact), qd, z]
    wp.launch(bouc_wen_step_kernel, dim=z.shape, inputs=inputs, outputs=[out], device="cpu")
    return out.numpy()


def rate(qd: np.ndarray, z: np.ndarray, beta=BETA, gamma=GAMMA) -> np.ndarray:
    """Eq. 15 in float64."""
    return qd - beta * abs(qd) * z - gamma * qd * abs(z)


def reference(z: np.ndarray, qd: np.ndarray, dt: float, substeps: int, beta=BETA, gamma=GAMMA) -> np.ndarray:
    """Eq. 15 over dt at constant qd by classical Runge-Kutta in float64."""
    h = dt / substeps
    for _ in range(substeps):
        k1 = rate(qd, z, beta, gamma)
        k2 = rate(qd, z + 0.5 * h * k1, beta, gamma)
        k3 = rate(qd, z + 0.5 * h * k2, beta, gamma)
        k4 = rate(qd, z + h * k3, beta, gamma)
        z = z + h / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
    return z


@wp.kernel
def laws_kernel(
    qd_in: wp.array[float],
    q_c_in: wp.array[float],
    current_in: wp.array[float],
    z_in: wp.array[float],
    rate_out: wp.array[float],
    tau_out: wp.array[float],
):
    """Eqs. 15 and 14 with the paper's coefficients."""
    i = wp.tid()
    rate_out[i] = bouc_wen_rate(qd_in[i], z_in[i], 16.50618, -10.53036)
    tau_out[i] = bouc_wen_torque(
        qd_in[i],
        q_c_in[i],
        current_in[i],
        z_in[i],
        -0.01917639,
        0.1013626,
        0.2160456,
        -7.681742e-4,
        0.3992754,
        10.413315,
        0.7777051,
    )


def test_rate_and_torque_equal_the_equations():
    """Eqs. 14 and 15 at 1000 random points, to the rounding of their largest term."""
    rng = np.random.default_rng(1)
    qd, q_c, z = rng.uniform(-20, 20, 1000), rng.uniform(-1, 1, 1000), rng.uniform(-0.2, 0.2, 1000)
    current = rng.uniform(0, 1.5, 1000)
    arrays = [wp.array(f32(x), dtype=float, device="cpu") for x in (qd, q_c, current, z)]
    outs = [wp.full(1000, float("nan"), dtype=float, device="cpu") for _ in range(2)]
    wp.launch(laws_kernel, dim=1000, inputs=arrays, outputs=outs, device="cpu")
    gain = (0.3992754 + 10.413315 * current) / (1 + 0.7777051 * abs(qd))
    want = -0.01917639 + 0.1013626 * qd + 0.2160456 * q_c - 7.681742e-4 * current + gain * z
    # the largest terms of the sums: beta*20*0.2 = 66 rad/s and 0.1*20 + 16*0.2 = 5 N·m
    np.testing.assert_allclose(outs[0].numpy(), rate(qd, z), rtol=0, atol=8 * EPS * 66)
    np.testing.assert_allclose(outs[1].numpy(), want, rtol=0, atol=8 * EPS * 5)


def test_euler_step_is_of_first_order():
    """Loading over 0.05 rad at 1 rad/s: the error against the closed form falls in proportion to the step."""
    steps = 0.05 / np.array([10, 20, 40, 80, 160])
    errors = []
    for dt in steps:
        z = np.zeros((1, 1))
        for _ in range(round(0.05 / dt)):
            z = step(z, [[1.0]], dt=float(dt), exact=False)
        errors.append(abs(z[0, 0] - BOUND * -np.expm1(-0.05 / BOUND)))
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(1.0, abs=0.03)


def test_euler_step_is_the_equation():
    """One explicit step from 1000 random states equals z + dt*rate, clipped to +-5 rad."""
    rng = np.random.default_rng(2)
    z, qd = f32(rng.uniform(-5, 5, (1000, 1))), f32(rng.uniform(-30, 30, (1000, 1)))
    want = np.clip(z + DT * rate(qd.astype(float), z.astype(float)), -Z_MAX, Z_MAX)
    np.testing.assert_allclose(step(z, qd, exact=False), want, rtol=0, atol=8 * EPS * 27 * 5 * 30 * DT)
    assert (abs(want) == Z_MAX).sum() > 50


@pytest.mark.parametrize(("beta", "gamma"), [(BETA, GAMMA), (8.0, 3.0), (5.0, 5.0), (4.0, 7.0)])
def test_exact_step_equals_a_fine_reference(beta: float, gamma: float):
    """Ten steps of random velocity with reversals, zero crossings and standstill, against Runge-Kutta at 5e-6 s."""
    rng = np.random.default_rng(3)
    bound = 1.0 / (beta + gamma)
    z_ref = rng.uniform(-bound, bound, (256, 1))
    z = z_ref
    crossings = 0
    for _ in range(10):
        qd = f32(rng.uniform(-20, 20, (256, 1)) * rng.choice([0.0, 0.01, 1.0], (256, 1))).astype(float)
        before, z_ref = z_ref, reference(z_ref, qd, DT, 1000, beta, gamma)
        z = step(z, qd, beta=beta, gamma=gamma)
        # the reference's step that meets the kink errs by about |gamma|*(20 rad/s * 5e-6 s)^2 = 1e-7 rad
        np.testing.assert_allclose(z, z_ref, rtol=0, atol=1e-6)
        crossings += int((before * z_ref < 0).sum())
    assert crossings > 200


def test_exact_step_is_rate_independent():
    """A path of 0.3 rad out and 0.3 rad back, at 0.05 and at 10 rad/s, ends in the same state."""

    def travel(speed: float) -> list[float]:
        steps = round(0.3 / (speed * DT))
        z, turn = np.zeros((1, 1)), []
        for direction in (1, -1):
            for _ in range(steps):
                z = step(z, [[direction * speed]])
            turn.append(z[0, 0])
        return turn

    # 1200 slow steps, each rounds z once or twice by eps*0.1 rad
    np.testing.assert_allclose(travel(0.05), travel(10.0), rtol=0, atol=4e-6)


def test_exact_step_keeps_its_precision_at_any_speed():
    """From z = 0 at 4000 speeds from 1e-4 to 100 rad/s, where 1 - exp(-x) would lose up to 3e-4 by cancellation."""
    speed = f32(10.0 ** np.linspace(-4, 2, 4000)).astype(float)
    want = BOUND * -np.expm1(-speed * DT / BOUND)
    # the series ends at x = 0.05; above it 1 - exp(-x) errs by eps/2/0.05; the float32 coefficients add 1e-7
    np.testing.assert_allclose(step(np.zeros(4000), speed)[0], want, rtol=1.5e-6)


@pytest.mark.parametrize("exact", [True, False])
def test_a_step_keeps_the_bound(exact: bool):
    """|z| <= 1/(beta+gamma) over 5 seeds, 200 steps and random coefficients: exactly at up to 1000 rad/s.

    Euler's step while max(beta, beta+gamma)*|qd|*dt <= 1; 12.1 rad/s with the paper's.
    """
    for seed in range(5):
        rng = np.random.default_rng(seed)
        beta = rng.uniform(1, 30)
        gamma = rng.uniform(-0.9, 0.9) * beta
        bound, limit = 1.0 / (beta + gamma), 1.0 / (max(beta, beta + gamma) * DT)
        z = rng.uniform(-bound, bound, (64, 4))
        peak = 0.0
        for _ in range(200):
            quick = rng.normal(0, 1, z.shape) * 10.0 ** rng.uniform(-2, 3, z.shape)
            qd = quick if exact else rng.choice([-1, 1, 0.3], z.shape) * limit
            z = step(z, qd, exact=exact, beta=beta, gamma=gamma)
            peak = max(peak, abs(z).max())
        assert 0.99 * bound * exact < peak <= bound * (1 + (8 if exact else 16) * EPS)
    assert 1.0 / (BETA * DT) == pytest.approx(12.1, abs=0.05)


def test_euler_step_overshoots_at_20_rad_s():
    """One reversal at 20 rad/s overshoots 2.3-fold; five in a row reach the clip at 5 rad, 30 times the bound."""
    z = np.full((1, 1), BOUND)
    peaks = []
    for k in range(6):
        z = step(z, [[-20.0 * (-1) ** k]], exact=False)
        peaks.append(abs(z[0, 0]) / BOUND)
    # by hand: u -> u + 0.1*(1 + (beta - gamma)*|u|) with u = -|z|, so |z| -> 0.1 + 1.704*|z|
    want, by_hand = BOUND, []
    for _ in range(6):
        want = min(20 * DT + (20 * DT * (BETA - GAMMA) - 1) * want, Z_MAX)
        by_hand.append(want / BOUND)
    np.testing.assert_allclose(peaks, by_hand, rtol=1e-5)
    assert peaks[0] == pytest.approx(2.30, abs=0.01)
    assert peaks[-1] == pytest.approx(Z_MAX / BOUND, rel=1e-6)
    assert Z_MAX / BOUND == pytest.approx(29.9, abs=0.1)


def test_step_takes_one_row_of_coefficients_per_environment():
    """With coefficients of shape (E, M) each environment advances as it would with its own shared row."""
    rng = np.random.default_rng(4)
    beta, gamma = rng.uniform(5, 20, (6, 2)), rng.uniform(-4, 4, (6, 2))
    z, qd = f32(rng.uniform(-0.05, 0.05, (6, 2))), f32(rng.uniform(-5, 5, (6, 2)))
    arrays = [wp.array(f32(x), dtype=float, device="cpu") for x in (beta, gamma, qd, z)]
    out = wp.full((6, 2), float("nan"), dtype=float, device="cpu")
    inputs = [*arrays[:2], Z_MAX, DT, 1, *arrays[2:]]
    wp.launch(bouc_wen_step_kernel, dim=(6, 2), inputs=inputs, outputs=[out], device="cpu")
    alone = [step(z[k, j], qd[k, j], beta=beta[k, j], gamma=gamma[k, j]) for k in range(6) for j in range(2)]
    np.testing.assert_array_equal(out.numpy().ravel(), np.ravel(alone))
