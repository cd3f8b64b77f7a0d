"""The energy ledger adds each step's work to its branch, as NumPy does."""

import numpy as np
import pytest
import warp as wp

from mrwarp.kernels.ledger import COIL, DRAG, DYNAMIC, ENTRIES, HOLD, INJECTED, MOTOR, MOTOR_SQUARE, ledger_kernel
from tests.kernels.law_kernels import f32

E, SLOT_OF, DT = 6, np.array([-1, 1, 0]), 0.005
JOINT_OF = [2, 1]


def account(
    ledger: wp.array, tau_mr_out: wp.array, constraint: int, step: dict[str, np.ndarray], resistance, lanes: int = 1
) -> None:
    """Add one step given as NumPy arrays."""
    names = ("qd_next", "tau_motor", "friction", "tau_mr", "m_dyn", "m_hold", "current")
    arrays = [wp.array(f32(step[name]), dtype=float, device="cpu") for name in names]
    arrays.append(wp.array(f32(resistance), dtype=float, device="cpu"))
    slot_of = wp.array(SLOT_OF, dtype=int, device="cpu")
    inputs = [lanes, slot_of, DT, constraint, *arrays]
    wp.launch(ledger_kernel, dim=(E, lanes), inputs=inputs, outputs=[tau_mr_out, ledger], device="cpu")


def random_step(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """One step of 3 joints, two with a device; each device is in one branch."""
    branch = rng.integers(0, 3, (E, 2))
    step = {name: rng.normal(0, 5, (E, 3)) for name in ("qd_next", "tau_motor", "friction")}
    step |= {"tau_mr": rng.normal(0, 5, (E, 2)), "current": rng.uniform(0, 1.5, (E, 2))}
    return step | {"m_dyn": branch == 0, "m_hold": branch == 1}


def test_ledger_entries_are_named_in_order():
    """The names that reports use stand at the kernel's indices."""
    order = [MOTOR, DYNAMIC, HOLD, DRAG, INJECTED, MOTOR_SQUARE, COIL]
    assert ENTRIES == ("motor", "dynamic", "hold", "drag", "injected", "motor_square", "coil")
    assert [int(index) for index in order] == list(range(len(ENTRIES)))


@pytest.mark.parametrize("lanes", [1, 3])
@pytest.mark.parametrize("constraint", [0, 1])
@pytest.mark.parametrize("rows", [1, E])
def test_ledger_equals_numpy_sums(constraint: int, rows: int, lanes: int):
    """40 random steps: work per branch, positive work alone as injected, squared motor torque, coil loss."""
    rng = np.random.default_rng(5)
    resistance = rng.uniform(2, 6, (rows, 2))
    ledger = wp.zeros((E, 3, len(ENTRIES)), dtype=float, device="cpu")
    want = np.zeros((E, 3, len(ENTRIES)))
    for _ in range(40):
        step = random_step(rng)
        tau_mr = wp.full((E, 2), float("nan"), dtype=float, device="cpu")
        account(ledger, tau_mr, constraint, step, resistance, lanes)
        device = [step["tau_mr"], step["friction"][:, JOINT_OF]][constraint]
        np.testing.assert_array_equal(tau_mr.numpy(), f32(device))
        work = device * step["qd_next"][:, JOINT_OF] * DT
        want[:, :, MOTOR] += step["tau_motor"] * step["qd_next"] * DT
        want[:, :, MOTOR_SQUARE] += step["tau_motor"] ** 2 * DT
        want[:, JOINT_OF, DYNAMIC] += work * step["m_dyn"]
        want[:, JOINT_OF, HOLD] += work * step["m_hold"]
        want[:, JOINT_OF, DRAG] += work * ~(step["m_dyn"] | step["m_hold"])
        want[:, JOINT_OF, INJECTED] += np.maximum(work, 0.0)
        want[:, JOINT_OF, COIL] += resistance * step["current"] ** 2 * DT
    # 40 additions, each rounded at the size of the running sum, a few joules
    np.testing.assert_allclose(
        ledger.numpy(), want, rtol=1e-5, atol=40 * float(np.finfo(np.float32).eps) * abs(want).max()
    )


def test_ledger_of_a_joint_without_device_is_left_alone():
    """Only the motor's entries of a plain joint change."""
    ledger = wp.full((E, 3, len(ENTRIES)), 7.0, dtype=float, device="cpu")
    tau_mr = wp.full((E, 2), float("nan"), dtype=float, device="cpu")
    account(ledger, tau_mr, 1, random_step(np.random.default_rng(6)), np.full((1, 2), 4.0))
    untouched = ledger.numpy()[:, 0, [DYNAMIC, HOLD, DRAG, INJECTED, COIL]]
    np.testing.assert_array_equal(untouched, np.full((E, 5), 7.0))
