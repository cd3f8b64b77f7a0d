"""MrActuator: independence of environments, masked reset, resume, capture, couplings and parameters."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.enums import Coupling, HoldCurrent, ZStep
from mrwarp.kernels.learned_torque import FEATURES, WINDOW
from mrwarp.kernels.ledger import ENTRIES
from mrwarp.kernels.mr_joint import FIELDS
from mrwarp.model_file import Effect
from mrwarp.params import MrParams
from mrwarp.runtime import DeviceWarning
from tests.actuator.actuator_bench import (
    CALVES,
    DT,
    EPS,
    Bench,
    assert_bit_equal,
    f32,
    make_joints,
    random_inputs,
    rows,
)
from tests.actuator.test_effect_runtime import ALL

CFGS = [
    MrActuatorCfg(coupling=coupling, hold_current=hold, z_step=z_step)
    for coupling, hold, z_step in [
        (Coupling.EXPLICIT, HoldCurrent.SUPPORT, ZStep.EULER),
        (Coupling.CONSTRAINT, HoldCurrent.FIXED, ZStep.EXACT),
        (Coupling.CONSTRAINT, HoldCurrent.SUPPORT, ZStep.EULER),
    ]
]
each_cfg = pytest.mark.parametrize("cfg", CFGS, ids=lambda c: f"{c.coupling.value}-{c.hold_current.value}")


each_device = pytest.mark.parametrize("effects", [(), ALL], ids=["plain", "effects"])
"""Devices by the kernels of the plain laws, and a second one with every effect by those with effects."""


@each_cfg
@each_device
@pytest.mark.parametrize("share_params", [True, False])
def test_environment_of_a_batch_equals_the_same_environment_alone(
    cfg: MrActuatorCfg, effects: tuple[Effect, ...], share_params: bool
):
    """8 environments together and one by one, 50 random steps: every array bit-equal."""
    together = Bench(8, cfg, make_joints(effects=effects), share_params=share_params)
    alone = [Bench(1, cfg, make_joints(effects=effects)) for _ in range(8)]
    rng, gates = np.random.default_rng(21), np.zeros(2)
    for _ in range(50):
        x = random_inputs(rng, 8)
        together.step(**x)
        gates += [together.actuator.m_dyn.numpy().sum(), together.actuator.m_hold.numpy().sum()]
        for k in range(8):
            alone[k].step(**rows(x, [k]))
    got = together.everything()
    assert np.isfinite(got["tau"]).all() and np.isfinite(got["tau_mr"]).all()
    assert gates.min() > 50
    numbers = ("params", "effects_values")
    for k in range(8):
        ours, want = rows(got, [k]), alone[k].everything()
        assert_bit_equal(*({name: x for name, x in found.items() if name not in numbers} for found in (ours, want)))


@each_device
def test_reset_of_a_mask_leaves_other_environments_bit_equal(effects: tuple[Effect, ...]):
    """After 61 steps (the ring has wrapped), reset 3 of 8: only they change, and all continue as if alone."""
    bench, twin = (Bench(8, joints=make_joints(effects=effects)) for _ in range(2))
    rng = np.random.default_rng(22)
    for _ in range(61):
        x = random_inputs(rng, 8)
        bench.step(**x)
        twin.step(**x)
    mask = np.isin(np.arange(8), [1, 4, 7])
    kept, hit = np.flatnonzero(~mask), np.flatnonzero(mask)
    bench.actuator.reset(wp.array(mask, dtype=wp.bool, device="cpu"))
    assert_bit_equal(rows(bench.everything(), kept), rows(twin.everything(), kept))
    state = rows(bench.actuator.state(), hit)
    memory = ("effects_heat", "effects_memory", "effects_commands", "effects_newest") if effects else ()
    for name in ("z", "current", "ledger", "m_dyn", "m_hold", "tau_dyn", "tau_mr", *memory):
        assert not state[name].any() and twin.actuator.state()[name][hit].any(), name
    neutral = MrParams().bouc_wen
    q_c = x["q"][hit][:, CALVES] - neutral.q_neutral - neutral.q_offset
    np.testing.assert_allclose(state["ring"][..., 0], np.repeat(q_c[:, :, None], WINDOW, axis=2), rtol=0, atol=1e-6)
    assert not state["ring"][..., 1:].any()
    for _ in range(5):
        x = random_inputs(rng, 8)
        bench.step(**x)
        twin.step(**x)
    assert_bit_equal(rows(bench.everything(), kept), rows(twin.everything(), kept))


def test_reset_of_all_equals_a_new_actuator():
    """reset() without a mask, then 5 steps: the same as a new actuator that was reset at the same pose."""
    used, new = Bench(3), Bench(3)
    rng = np.random.default_rng(23)
    for _ in range(WINDOW):
        used.step(**random_inputs(rng, 3))
    # after 50 steps the head stands where it began: the rings can be compared row by row
    for bench in (used, new):
        bench.write(q=np.full(6, -1.4))
        bench.actuator.reset()
    for _ in range(5):
        x = random_inputs(rng, 3)
        used.step(**x)
        new.step(**x)
    assert_bit_equal(used.everything(), new.everything())


@each_cfg
@each_device
def test_state_resumes_bit_equal(cfg: MrActuatorCfg, effects: tuple[Effect, ...]):
    """A new actuator that loads the state after 33 steps continues bit-equal, changed numbers and time included."""
    bench, resumed = (Bench(4, cfg, make_joints(effects=effects), share_params=False) for _ in range(2))
    rng = np.random.default_rng(24)
    bench.actuator.set_param("K1", rng.uniform(5, 15, (4, 2)))
    if bench.actuator.effects is not None:
        lag = bench.actuator.effects.value("coil_lag", "time_constant")
        lag.assign(rng.uniform(0.01, 0.05, lag.shape).astype(np.float32))
    for _ in range(33):
        bench.step(**random_inputs(rng, 4))
    state = bench.actuator.state()
    copy = {name: value.copy() for name, value in state.items()}
    resumed.actuator.load_state(state)
    for _ in range(20):
        x = random_inputs(rng, 4)
        bench.step(**x)
        resumed.step(**x)
    assert_bit_equal(resumed.everything(), bench.everything())
    # the state handed out is a copy: later steps do not change it
    assert_bit_equal(state, copy)


@pytest.mark.parametrize("substeps", [1, 2, 3, 5])
@each_cfg
@each_device
def test_captured_steps_equal_eager_steps(cfg: MrActuatorCfg, effects: tuple[Effect, ...], substeps: int):
    """A captured loop of steps, plant and account, replayed 12 times, is bit-equal to running it eagerly."""
    eager, captured = (Bench(4, cfg, make_joints(effects=effects)) for _ in range(2))
    start = random_inputs(np.random.default_rng(25), 4)
    for bench in (eager, captured):
        bench.write(**start)
        bench.substep()
    before = captured.everything()
    with wp.ScopedCapture(device="cpu") as capture:
        for _ in range(substeps):
            captured.substep()
    assert_bit_equal(captured.everything(), before)
    graph = capture.graph
    assert graph is not None
    for _ in range(12):
        wp.capture_launch(graph)
        for _ in range(substeps):
            eager.substep()
    assert_bit_equal(captured.everything(), eager.everything())
    assert eager.actuator.head.numpy()[0] == (1 + 12 * substeps) % WINDOW
    assert np.isfinite(eager.everything()["ledger"]).all()


def test_history_holds_what_the_joint_did():
    """After 70 steps the ring, read from the head, holds the last 50 (q_c, qd, I) of each device."""
    bench, rng, seen = Bench(3), np.random.default_rng(26), []
    for _ in range(70):
        x = random_inputs(rng, 3)
        bench.step(**x)
        p = MrParams().bouc_wen
        q_c = x["q"][:, CALVES] - p.q_neutral - p.q_offset - p.q_center
        seen.append(np.stack([q_c, x["qd"][:, CALVES], bench.actuator.current.numpy()], axis=-1))
    head = bench.actuator.head.numpy()[0]
    order = (head + 1 + np.arange(WINDOW)) % WINDOW
    ring = bench.actuator.ring.numpy()[:, :, order]
    assert ring.shape == (3, 2, WINDOW, FEATURES)
    np.testing.assert_allclose(ring, np.stack(seen[-WINDOW:], axis=2), rtol=1e-6, atol=1e-6)


def test_param_is_a_live_view_of_each_parameter():
    """Each name reads its own value, writing one changes that one alone; an unknown name is refused."""
    actuator = Bench(3, share_params=False).actuator
    devices = [dict(joint.mr) for joint in make_joints() if joint.mr]
    for name in FIELDS:
        want = f32([[device[name] for device in devices]] * 3)
        np.testing.assert_array_equal(actuator.param(name).numpy(), want, err_msg=name)
    before = {name: actuator.param(name).numpy().copy() for name in FIELDS}
    values = f32([[1, 2], [3, 4], [5, 6]])
    actuator.set_param("gamma", values)
    after = {name: actuator.param(name).numpy() for name in FIELDS}
    np.testing.assert_array_equal(after.pop("gamma"), values)
    before.pop("gamma")
    assert_bit_equal(after, before)
    with pytest.raises(KeyError, match="K2"):
        actuator.param("K2")


def test_robot_without_devices_is_plain_pd():
    """No joint with ``mr``: tau = clip(kp*e - kd*qd), no bound, only the motor's entries in the ledger."""
    bench, rng = Bench(4, joints=make_joints(mr=False)), np.random.default_rng(28)
    x = {}
    for _ in range(3):
        x = {name: f32(value) for name, value in random_inputs(rng, 4).items()}
        bench.step(**x)
    kp = np.array([joint.kp for joint in bench.joints])
    e, qd = x["q_des"].astype(float) - x["q"], x["qd"].astype(float)
    got = bench.everything()
    # half a rounding each of two gains, e, two products and a sum; none of them above the limit and the damping
    atol = 3 * EPS * (23.7 + 0.6 * abs(qd).max())
    np.testing.assert_allclose(got["tau"], np.clip(kp * e - 0.6 * qd, -23.7, 23.7), rtol=0, atol=atol)
    assert got["tau"].tobytes() == got["tau_motor"].tobytes()
    assert not got["bound"].any()
    assert not np.delete(got["ledger"], [ENTRIES.index("motor"), ENTRIES.index("motor_square")], axis=2).any()
    state = bench.actuator.state()
    bench.actuator.reset()
    assert not bench.actuator.state()["ledger"].any()
    bench.actuator.load_state(state)
    assert_bit_equal(bench.actuator.state(), state)


@each_cfg
def test_a_broken_wire_carries_no_current_and_never_holds(cfg: MrActuatorCfg):
    """Without a current of its own, one device damps by its drag alone; the other is as before."""
    broken, whole = Bench(8, cfg, share_params=False), Bench(8, cfg, share_params=False)
    broken.actuator.set_param("current_max", [[1.5, 0.0]] * 8)
    rng, drag = np.random.default_rng(27), 0.0
    for _ in range(60):
        x = random_inputs(rng, 8)
        broken.step(**x)
        whole.step(**x)
        got = {name: getattr(broken.actuator, name).numpy() for name in ("current", "m_hold", "tau_dyn", "tau")}
        assert all(np.isfinite(values).all() for values in got.values())
        assert not got["current"][:, 1].any() and not got["m_hold"][:, 1].any()
        np.testing.assert_array_equal(got["tau_dyn"][:, 0], whole.actuator.tau_dyn.numpy()[:, 0])
        drag = max(drag, np.abs(got["tau_dyn"][:, 1]).max())
    assert drag > 0.1


def test_the_euler_step_says_where_it_overshoots() -> None:
    """(beta - gamma)*|qd|*dt = 1 at 7.4 rad/s; not the exact step, nor a device that no joint is fast enough for."""
    with pytest.warns(DeviceWarning, match=r"overshoots above 7\.4 rad/s.*--z-step exact"):
        Bench(1, MrActuatorCfg(z_step=ZStep.EULER))
    slow = [replace(j, mr=j.mr.replace(beta=6.0, gamma=0.0)) if j.mr else j for j in make_joints()]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Bench(1).actuator.cfg.z_step is ZStep.EXACT
        Bench(1, MrActuatorCfg(z_step=ZStep.EULER), joints=slow)


def brake(z_step: ZStep) -> np.ndarray:
    """Torque of a stiff brake that slides at 4.1 N·m along a sine of 0.5 rad and 1 Hz [N·m], shape (T,)."""
    stiff = {"D": 0.0, "C": 0.0, "I1": 0.0, "B": 0.05, "alpha": 0.0, "beta": 200.0, "gamma": -50.0}
    mr = MrParams().replace(**stiff, K0=0.0, K1=4.1 * 150.0)
    bench = Bench(
        1,
        MrActuatorCfg(coupling=Coupling.EXPLICIT, z_step=z_step, gated=False),
        joints=[replace(j, mr=mr) if j.mr else j for j in make_joints()],
    )
    found = []
    for k in range(400):
        phase = 2.0 * np.pi * DT * k
        bench.step(q=0.5 * np.sin(phase), qd=np.pi * np.cos(phase), current_e=1.0)
        found.append(np.abs(bench.actuator.tau_dyn.numpy()).max())
    return np.array(found)


def test_a_stiff_brake_bears_what_it_slides_with() -> None:
    """4.1 N·m and 0.05*pi of viscosity; with the paper's step a third more, beta*|qd|*dt being pi."""
    exact = brake(MrActuatorCfg().z_step)
    assert exact.max() == pytest.approx(4.1 + 0.05 * np.pi, rel=1e-3)
    with pytest.warns(DeviceWarning):
        euler = brake(ZStep.EULER)
    assert euler.max() > 1.2 * exact.max()
