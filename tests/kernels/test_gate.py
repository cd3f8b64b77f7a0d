"""Gates of eqs. 5 and 8 as a truth table, and the gain switch of eq. 9."""

import itertools

import numpy as np
import warp as wp

from tests.kernels.law_kernels import f32, gate_kernel

F_TH, EPS_E, EPS_V, EPS_HOLD = f32([5.0, 0.05, 0.2, 0.2])


def around(threshold: np.ndarray) -> list[np.ndarray]:
    """The threshold, its two neighbours in float32, and values well below and above it."""
    return [
        f32(0),
        f32(np.nextafter(threshold, f32(0))),
        threshold,
        f32(np.nextafter(threshold, f32(1e3))),
        f32(3) * threshold,
    ]


def gates(f_foot, e, qd, eps_hold=EPS_HOLD) -> tuple[np.ndarray, np.ndarray]:
    """Both gates from the kernel, into outputs poisoned with NaN."""
    arrays = [wp.array(np.atleast_2d(f32(x)), dtype=float, device="cpu") for x in (f_foot, e, qd)]
    m_dyn, m_hold = (wp.full(arrays[0].shape, float("nan"), dtype=float, device="cpu") for _ in range(2))
    inputs = [F_TH, EPS_E, EPS_V, float(eps_hold), *arrays]
    wp.launch(gate_kernel, dim=m_dyn.shape, inputs=inputs, outputs=[m_dyn, m_hold], device="cpu")
    return m_dyn.numpy(), m_hold.numpy()


def test_gate_truth_table():
    """All sides of all thresholds, the thresholds themselves included (closed there: strict inequalities)."""
    signed_e = [s * x for s in (-1, 1) for x in around(EPS_E)]
    signed_v = [s * x for s in (-1, 1) for x in around(EPS_V)]
    f, e, qd = f32(list(itertools.product(around(F_TH), signed_e, signed_v))).T
    m_dyn, m_hold = gates(f, e, qd)
    loaded = f > F_TH
    want_dyn = loaded & (abs(e) > EPS_E) & (abs(qd) > EPS_V) & (np.sign(e) * np.sign(qd) == -1)
    want_hold = loaded & (abs(qd) < EPS_HOLD) & ~want_dyn
    np.testing.assert_array_equal(m_dyn[0], want_dyn)
    np.testing.assert_array_equal(m_hold[0], want_hold)
    # 2 forces * 2 errors * 2 speeds * 2 opposite signs; 2 forces * 10 errors * 2 speeds * 2 signs
    assert (m_dyn.sum(), m_hold.sum()) == (16, 80)


def test_gates_are_binary_and_never_both_open():
    """Over 5 seeds, with a holding threshold above the damping one, so that the last factor of eq. 8 decides."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        shape = (200, 12)
        m_dyn, m_hold = gates(rng.uniform(0, 20, shape), rng.normal(0, 0.2, shape), rng.normal(0, 1, shape), 1.0)
        assert set(np.unique(m_dyn)) == {0.0, 1.0} == set(np.unique(m_hold))
        assert (m_dyn * m_hold).max() == 0.0
