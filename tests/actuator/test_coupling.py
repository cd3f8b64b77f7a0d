"""Torque at the joint: the residual, the device as explicit torque or as brake constraint, SAL off."""

import numpy as np
import pytest
import warp as wp

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.mr_actuator import MrActuator
from mrwarp.enums import Coupling
from mrwarp.kernels.learned_torque import FEATURES, WINDOW
from mrwarp.params import MrParams
from tests.actuator.actuator_bench import CALVES, DT, EPS, LEGS, Bench, f32, make_joints, random_inputs


class Shift:
    """A residual of 0.75 N·m that remembers nothing but its calls."""

    def __init__(self) -> None:
        self.calls: list[tuple[tuple[int, ...], int]] = []

    graphable, trained_step = False, None

    def bind(self, *arrays: wp.array) -> None:
        """Nothing to prepare."""

    def __call__(self, ring: wp.array, head: wp.array, m_dyn: wp.array, tau_dyn: wp.array) -> None:
        """Count the call, shift the torque."""
        self.calls.append((ring.shape, int(head.numpy()[0])))
        tau_dyn.assign(tau_dyn.numpy() + f32(0.75) * m_dyn.numpy())

    def reset(self, mask: wp.array) -> None:
        """Nothing to forget."""

    def state(self) -> dict[str, np.ndarray]:
        """Nothing to keep."""
        return {}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Nothing to restore."""


@pytest.mark.parametrize("coupling", list(Coupling))
def test_residual_is_added_to_the_prediction_alone(coupling: Coupling):
    """A residual that adds 0.75 N·m where the damping gate is open: tau_dyn shifts by that, the state does not."""
    residual = Shift()
    calls = residual.calls
    cfg = MrActuatorCfg(coupling=coupling)
    plain, learned = Bench(6, cfg), Bench(6, cfg, residual=residual)
    rng = np.random.default_rng(29)
    for _ in range(20):
        x = random_inputs(rng, 6)
        plain.step(**x)
        learned.step(**x)
    a, b = plain.everything(), learned.everything()
    shift = f32(0.75) * a["m_dyn"]
    assert a["m_dyn"].any()
    np.testing.assert_array_equal(b["tau_dyn"], a["tau_dyn"] + shift)
    for name in ("z", "current", "ring", "m_dyn", "m_hold", "tau_motor"):
        assert a[name].tobytes() == b[name].tobytes(), name
    # what the joint feels follows the sum: the bound, or the torque against the motion
    felt = {Coupling.CONSTRAINT: b["bound"][:, CALVES], Coupling.EXPLICIT: abs(b["tau_mr"])}[coupling]
    sliding = b["m_hold"] == 0
    np.testing.assert_array_equal(felt[sliding], abs(b["tau_dyn"])[sliding])
    assert calls == [((6, 2, WINDOW, FEATURES), k % WINDOW) for k in range(1, 21)]


def test_constraint_coupling_leaves_the_device_to_the_solver():
    """tau is the motor alone; the bound is the yield torque where held (at least the drag), |tau_dyn| elsewhere."""
    bench, rng = Bench(50, MrActuatorCfg(coupling=Coupling.CONSTRAINT)), np.random.default_rng(30)
    bench.write(**random_inputs(rng, 50))
    bench.actuator.step()
    got = bench.everything()
    assert got["tau"].tobytes() == got["tau_motor"].tobytes()
    assert np.isnan(got["tau_mr"]).all()
    p = MrParams().hold
    current = got["current"].astype(float)
    tau_y = p.T_max * current**p.n / (p.K**p.n + current**p.n)
    sliding, held = abs(got["tau_dyn"]), got["m_hold"] > 0
    assert held.sum() > 10
    want = np.where(held, np.maximum(tau_y, sliding), sliding)
    # two float32 powers err by n + 2 roundings each, their quotient times T_max by both
    np.testing.assert_allclose(got["bound"][:, CALVES], want, rtol=2 * (p.n + 3) * EPS)
    assert not np.delete(got["bound"], CALVES, axis=1).any()
    # the account takes over the torque that the solver found
    bench.actuator.account()
    np.testing.assert_array_equal(bench.actuator.tau_mr.numpy(), bench.inputs.friction.numpy()[:, CALVES])


def test_a_device_without_gates_holds_next_to_a_learned_torque_too():
    """Slow joints get the yield torque, those that slide the learned torque's size."""
    cfg = MrActuatorCfg(coupling=Coupling.CONSTRAINT, gated=False)
    qd, current = np.tile([0.1, 3.0], (6, 3)), np.full(6, 1.0)
    for residual in (None, Shift()):
        bench = Bench(6, cfg, residual=residual)
        bench.step(qd=qd[:, :6], q=-1.5, current_e=current)
        bound, tau = bench.actuator.bound.numpy()[:, CALVES], abs(bench.actuator.tau_dyn.numpy())
        held = np.array([abs(qd[0, joint]) < 0.2 for joint in CALVES])
        # the coil of the second lags
        most = MrParams().hold.yield_torque(bench.actuator.current.numpy().astype(float))
        np.testing.assert_allclose(bound, np.where(held, np.maximum(most, tau), tau), rtol=1e-5)
        assert held.any() and not held.all()


def test_sal_off_keeps_the_drag():
    """SAL off: both gates closed, no current, full motor gain, and the drag at 0 A remains."""
    bench, rng = Bench(50, MrActuatorCfg(sal=False)), np.random.default_rng(33)
    x = {name: f32(value) for name, value in random_inputs(rng, 50).items()}
    bench.step(**x)
    got = bench.everything()
    assert not (got["m_dyn"].any() or got["m_hold"].any() or got["current"].any())
    assert got["bound"][:, CALVES].min() > 0.0
    e, qd = (x["q_des"].astype(float) - x["q"])[:, CALVES], x["qd"].astype(float)[:, CALVES]
    kp_base = MrParams().motor.kp_base
    want = np.clip(kp_base * e - 0.6 * qd, -23.7, 23.7)
    # half a rounding each of two gains, e, two products and a sum; none of them above the limit and the damping
    atol = 3 * EPS * (23.7 + 0.6 * abs(qd).max())
    np.testing.assert_allclose(got["tau_motor"][:, CALVES], want, rtol=0, atol=atol)


def test_actuator_refuses_joints_that_do_not_match_its_arrays():
    """Six columns of state and five joints: both numbers are in the message."""
    inputs = Bench(2).inputs
    with pytest.raises(ValueError, match="5 joints and 6 legs given for arrays of 6 joints"):
        MrActuator(make_joints()[:5], LEGS, inputs, dt=DT)
