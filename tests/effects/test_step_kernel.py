"""The fused stages against NumPy, and the property that matters most: the device does no positive work."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from mrwarp.effects.step_kernel import EffectArrays, step_kernel
from mrwarp.kernels.learned_torque import FEATURES, WINDOW
from mrwarp.kernels.ledger import ENTRIES
from mrwarp.kernels.mr_joint import FIXED, SUPPORT, JointParams
from mrwarp.kernels.mr_stages import learned_torque_kernel, reset_kernel
from mrwarp.params import MrParams
from tests.kernels.law_kernels import f32

DT = 0.005
# three joints of which joints 2 and 0 carry devices 0 and 1; the devices read legs 3 and 1
SLOT_OF, JOINT_OF, LEG_OF = [1, -1, 0], [2, 0], [3, 1]
KP, KD, TAU_LIMIT = [20.0, 30.0, 40.0], [0.5, 0.6, 0.7], [23.7, 30.0, 35.55]


def floats(values: Any) -> wp.array:
    """Float array on the CPU."""
    return wp.array(f32(values), dtype=float, device="cpu")


def ints(values: Any) -> wp.array:
    """Int array on the CPU."""
    return wp.array(np.asarray(values, dtype=np.int32), dtype=int, device="cpu")


def poisoned(*shape: int) -> wp.array:
    """Output array full of NaN."""
    return wp.full(shape, float("nan"), dtype=float, device="cpu")


def struct(*params: MrParams) -> wp.array:
    """One row of parameters, shape (1, M)."""
    dtype: Any = JointParams.numpy_dtype()
    values: Any = np.zeros((1, len(params)), dtype=dtype)
    for slot, mr in enumerate(params):
        for name, value in mr:
            values[name][0, slot] = value
    return wp.array(values, dtype=JointParams, device="cpu")


DEVICES = (MrParams(), MrParams().replace(coil_time_constant=0.02, K1=5.0, kp_base=30.0, q_neutral=-1.0))


def random_inputs(rng: np.random.Generator, num_envs: int) -> dict[str, np.ndarray]:
    """States around the thresholds: about half of the legs loaded, slow and fast joints."""
    shape = (num_envs, 3)
    inputs = {
        "q_des": rng.normal(-1.5, 0.1, shape),
        "q": rng.normal(-1.5, 0.2, shape),
        "qd": rng.normal(0, 1, shape) * rng.choice([0.1, 1.0, 10.0], shape),
        "f_foot": rng.uniform(0, 12, (num_envs, 4)),
        "current_e": rng.uniform(0, 2, num_envs),
        "z": rng.uniform(-0.16, 0.16, (num_envs, 2)),
        "current": rng.uniform(0, 1.5, (num_envs, 2)),
    }
    return {name: f32(value) for name, value in inputs.items()}


def step(
    x: dict[str, np.ndarray],
    *,
    sal: int = 1,
    hold: int = SUPPORT,
    exact: int = 0,
    constraint: int = 0,
    latch: float = 1.0,
    command: np.ndarray | None = None,
    held: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Outputs of the step kernel by name, poisoned before; a thread per joint, so the head stays at row 0.

    ``command`` [A] of each device and whether it was ``held``, shape (E, M).
    """
    num_envs = len(x["q"])
    shapes = {"m_dyn": 2, "m_hold": 2, "z": 2, "coil": 2, "current": 2, "tau_dyn": 2, "ring": 0, "head": 0}
    shapes |= {"tau_motor": 3, "tau_mr": 2, "tau": 3, "bound": 3}
    out = {name: poisoned(num_envs, columns) for name, columns in shapes.items() if columns}
    out |= {"ring": poisoned(num_envs, 2, WINDOW, FEATURES), "head": ints([0])}
    if held is not None:
        out["m_hold"].assign(held)
    arrays = [floats(x[name]) for name in ("q_des", "q", "qd", "f_foot", "current_e")]
    arrays.append(None if command is None else floats(command))
    inputs = [
        *(num_envs, 3, struct(*DEVICES), ints(SLOT_OF), ints(LEG_OF), floats([KP]), floats([KD]), floats([TAU_LIMIT])),
        *(DT, sal, sal, int(hold), exact, constraint, latch, *arrays, ints([0]), floats(x["z"]), floats(x["current"])),
    ]
    outputs = [EffectArrays(), *(out[name] for name in shapes)]
    wp.launch(step_kernel, dim=(num_envs, 3), inputs=inputs, outputs=outputs, device="cpu")
    return {name: array.numpy() for name, array in out.items()}


def yield_torque(current: np.ndarray, mr: MrParams) -> np.ndarray:
    """Eq. 18 in float64."""
    p = mr.hold
    return p.T_max * current**p.n / (p.K**p.n + current**p.n)


def expected_prediction(x: dict[str, np.ndarray], slot: int, sal: int, hold: int, exact: int) -> dict[str, np.ndarray]:
    """Gates, current, z and tau_BW of one device, from the equations in float64; comparisons as in float32."""
    mr = DEVICES[slot]
    bw, gate, joint = mr.bouc_wen, mr.gate, JOINT_OF[slot]
    q, qd = x["q"][:, joint], x["qd"][:, joint]
    e = x["q_des"][:, joint] - q
    loaded = x["f_foot"][:, LEG_OF[slot]] > f32(gate.f_th)
    limit = np.minimum(x["current_e"], f32(mr.coil.current_max))
    fast = abs(qd) > f32(gate.eps_v)
    m_dyn = sal * (loaded & (abs(e) > f32(gate.eps_e)) & fast & (e * qd < 0))
    m_hold = sal * (loaded & (abs(qd) < f32(gate.eps_hold)) & (m_dyn == 0) & (limit > 0))
    e, qd, q_c = e.astype(float), qd.astype(float), q.astype(float) - bw.q_neutral - bw.q_offset - bw.q_center
    wanted = mr.hold.safety_factor * (mr.motor.kp_base - mr.motor.kp_low) * abs(e)
    share = np.minimum(wanted / mr.hold.T_max, 1 - 1e-12)
    support = np.minimum(mr.hold.K * (share / (1 - share)) ** (1 / mr.hold.n), limit)
    command = m_dyn * limit + m_hold * (support if hold == SUPPORT else limit)
    lag = mr.coil.coil_time_constant
    kept = np.exp(-DT / lag) if lag else 0.0
    coil = command + (x["current"][:, slot] - command) * kept
    current = command + (x["current"][:, slot] - command) * lag / DT * (1.0 - kept)
    z, steps = x["z"][:, slot].astype(float), 2000 if exact else 1
    for _ in range(steps):
        z = z + DT / steps * (qd - bw.beta * abs(qd) * z - bw.gamma * qd * abs(z))
    tau = bw.D + bw.B * qd + bw.C * q_c + bw.I1 * current + (bw.K0 + bw.K1 * current) / (1 + bw.alpha * abs(qd)) * z
    features = np.stack([q_c, qd, current], axis=-1)
    device = {"z": z, "coil": coil, "current": current, "tau_dyn": tau}
    return {"m_dyn": m_dyn, "m_hold": m_hold, **device, "features": features}


@pytest.mark.parametrize(("sal", "hold", "exact"), [(1, SUPPORT, 0), (1, FIXED, 0), (0, SUPPORT, 0), (1, SUPPORT, 1)])
def test_predict_equals_the_equations(sal: int, hold: int, exact: int):
    """Gates exactly, current, z, tau_BW and the history row to float32 rounding; nothing else in the ring changes."""
    x = random_inputs(np.random.default_rng(7), 300)
    got = step(x, sal=sal, hold=hold, exact=exact)
    for slot in range(2):
        want = expected_prediction(x, slot, sal, int(hold), exact)
        np.testing.assert_array_equal(got["m_dyn"][:, slot], want["m_dyn"])
        np.testing.assert_array_equal(got["m_hold"][:, slot], want["m_hold"])
        for name in ("coil", "current"):
            np.testing.assert_allclose(got[name][:, slot], want[name], rtol=1e-4, atol=1e-6)
        # the exact step is checked against 2000 Euler steps of 2.5 us: x/2 = 30 rad/s*2.5e-6*27/2 = 1e-3 of 0.17 rad
        np.testing.assert_allclose(got["z"][:, slot], want["z"], rtol=0, atol=[5e-6, 2e-4][exact])
        np.testing.assert_allclose(got["tau_dyn"][:, slot], want["tau_dyn"], rtol=2e-5, atol=[1e-4, 3e-3][exact])
        np.testing.assert_allclose(got["ring"][:, slot, 0], want["features"], rtol=1e-4, atol=1e-6)
    assert np.isnan(got["ring"][:, :, 1:]).all()
    assert (got["m_dyn"].sum() > 20, got["m_hold"].sum() > 20) == (sal == 1, sal == 1)


def test_predict_without_current_holds_nothing():
    """I_e = 0 A: no holding gate, no coil current, and the off-current drag stays."""
    x = random_inputs(np.random.default_rng(8), 300) | {"current_e": np.zeros(300, dtype=np.float32)}
    got = step(x | {"current": np.zeros((300, 2), dtype=np.float32)})
    assert got["m_hold"].max() == 0.0
    assert abs(got["current"]).max() == 0.0
    assert abs(got["tau_dyn"]).min() > 0.0
    assert got["m_dyn"].sum() > 20


@pytest.mark.parametrize("constraint", [0, 1])
def test_torque_equals_the_equations(constraint: int):
    """Motor PD with the switched gain, device torque of eqs. 6 and 19 or the brake's bound; plain PD elsewhere."""
    x = random_inputs(np.random.default_rng(9), 300)
    got = prediction = step(x, constraint=constraint)
    e, qd = x["q_des"].astype(float) - x["q"], x["qd"].astype(float)
    gain, device, bound = np.tile(KP, (300, 1)), np.zeros((300, 3)), np.zeros((300, 3))
    # a joint with a device has its motor's damping and limit in the device's parameters
    damping, limit = np.array(KD, dtype=float), np.array(TAU_LIMIT, dtype=float)
    for slot, joint in enumerate(JOINT_OF):
        mr, held = DEVICES[slot], prediction["m_hold"][:, slot] > 0
        damping[joint], limit[joint] = mr.motor.kd, mr.motor.tau_limit
        motor, sliding = mr.motor, abs(prediction["tau_dyn"][:, slot].astype(float))
        tau_y = yield_torque(prediction["current"][:, slot].astype(float), mr)
        gain[:, joint] = np.where(held, motor.kp_low, motor.kp_base)
        need = np.clip((motor.kp_base - motor.kp_low) * e[:, joint], -tau_y, tau_y)
        device[:, joint] = (1 - constraint) * np.where(held, need, -np.sign(qd[:, joint]) * sliding)
        bound[:, joint] = constraint * np.where(held, np.maximum(tau_y, sliding), sliding)
    tau_motor = np.clip(gain * e - damping * qd, -limit, limit)
    np.testing.assert_allclose(got["tau_motor"], tau_motor, rtol=1e-5, atol=2e-5)
    np.testing.assert_allclose(got["tau"], tau_motor + device, rtol=1e-5, atol=2e-5)
    np.testing.assert_allclose(got["bound"], bound, rtol=1e-5, atol=2e-5)
    # the constraint's torque is unknown before the step
    want_mr = np.where(constraint, np.nan, device[:, JOINT_OF])
    np.testing.assert_allclose(got["tau_mr"], want_mr, rtol=1e-5, atol=2e-5)


def test_explicit_device_never_does_positive_work_at_an_instant():
    """10^5 random states, currents and gates: tau_mr*qd <= 0 wherever the joint is not held (eq. 7)."""
    rng, num = np.random.default_rng(10), 50_000
    x = random_inputs(rng, num)
    got = step(x)
    # also predictions that no Bouc-Wen model makes: a learned residual is free in sign and size
    learned = got["tau_dyn"] + f32(rng.normal(0, 3, (num, 2)))
    out = [floats(got[name]) for name in ("tau_mr", "tau", "bound")]
    state = [floats(got[name]) for name in ("m_dyn", "m_hold", "current")]
    inputs = [
        *(num, 2, struct(*DEVICES), ints(JOINT_OF), 0, *(floats(x[name]) for name in ("q_des", "q", "qd"))),
        *(*state, floats(learned), floats(got["tau_motor"])),
    ]
    wp.launch(learned_torque_kernel, dim=(num, 2), inputs=inputs, outputs=out, device="cpu")
    for tau_mr in (got["tau_mr"], out[0].numpy()):
        power = np.where(got["m_hold"] > 0, -0.0, tau_mr.astype(float) * x["qd"][:, JOINT_OF])
        assert power.max() <= 0.0
        assert (got["m_dyn"] > 0).sum() > 5_000
        assert power[got["m_dyn"] > 0].max() < 0.0


def test_reset_overwrites_masked_environments_only():
    """Masked environments come to rest with a history at their angle; NaN elsewhere shows that nothing was written."""
    q = f32(np.random.default_rng(11).normal(-1.5, 0.3, (5, 3)))
    mask = np.array([True, False, True, False, False])
    state = [poisoned(5, 2) for _ in range(7)]
    ring, ledger = poisoned(5, 2, WINDOW, FEATURES), poisoned(5, 3, len(ENTRIES))
    inputs = [5, 3, struct(*DEVICES), ints(SLOT_OF), wp.array(mask, dtype=wp.bool, device="cpu"), floats(q)]
    wp.launch(reset_kernel, dim=(5, 3), inputs=inputs, outputs=[*state, ring, ledger], device="cpu")
    for array in [*state, ledger]:
        assert (array.numpy()[mask] == 0.0).all()
    for array in [*state, ring, ledger]:
        assert np.isnan(array.numpy()[~mask]).all()
    offset = np.array([mr.bouc_wen.q_neutral + mr.bouc_wen.q_offset + mr.bouc_wen.q_center for mr in DEVICES])
    want = np.zeros((2, 2, WINDOW, FEATURES))
    want[..., 0] = (q[mask][:, JOINT_OF] - offset)[:, :, None]
    np.testing.assert_allclose(ring.numpy()[mask], want, rtol=0, atol=1e-6)


def test_a_commanded_device_gets_its_current_while_a_gate_is_open():
    """The coil of device 0, which has no lag: its own command where a gate is open, up to I_e, else none."""
    rng = np.random.default_rng(12)
    x = random_inputs(rng, 400)
    command = f32(rng.uniform(0.1, 2.0, (400, 2)))
    out = step(x, hold=FIXED, command=command, held=np.zeros((400, 2)))
    want = np.minimum(np.minimum(command[:, 0], x["current_e"]), f32(DEVICES[0].coil.current_max))
    gate = np.maximum(out["m_dyn"], out["m_hold"])[:, 0]
    np.testing.assert_array_equal(out["current"][:, 0], gate * want)
    assert 0.1 < gate.mean() < 0.9


def test_a_negative_command_demagnetises_with_the_gates_closed():
    """It flows regardless of the gates, and neither damps nor holds; other devices are as they were."""
    x = random_inputs(np.random.default_rng(14), 400)
    command = np.full((400, 2), 1.0)
    before = step(x, hold=FIXED, command=command, held=np.zeros((400, 2)))
    command[:, 0] = -0.3
    out = step(x, hold=FIXED, command=command, held=np.ones((400, 2)), latch=5.0)
    np.testing.assert_array_equal(out["current"][:, 0], np.full(400, f32(-0.3)))
    assert not out["m_dyn"][:, 0].any() and not out["m_hold"][:, 0].any() and before["m_hold"][:, 0].any()
    unheld = step(x, hold=FIXED, command=command, held=np.zeros((400, 2)))
    np.testing.assert_array_equal(unheld["m_hold"][:, 1], before["m_hold"][:, 1])


def test_a_device_that_holds_lets_go_at_a_higher_speed():
    """With a latch of 5, between 0.2 and 1 rad/s only what held goes on holding, and it does not damp meanwhile."""
    rng = np.random.default_rng(13)
    x, gate = random_inputs(rng, 400), DEVICES[0].gate
    held = f32(rng.integers(0, 2, (400, 2)))
    command = np.full((400, 2), 1.0)
    out = step(x, hold=FIXED, latch=5.0, command=command, held=held)
    qd, loaded = abs(x["qd"][:, JOINT_OF[0]]), x["f_foot"][:, LEG_OF[0]] > gate.f_th
    allowed = loaded & (x["current_e"] > 0.0)
    between = allowed & (qd > gate.eps_hold) & (qd < 5.0 * gate.eps_hold)
    assert 20 < between.sum()
    np.testing.assert_array_equal(out["m_hold"][between, 0], held[between, 0])
    assert (out["m_dyn"][between & (held[:, 0] == 1.0), 0] == 0.0).all()
    fast = qd > 5.0 * gate.eps_hold
    assert fast.sum() > 20 and (out["m_hold"][fast, 0] == 0.0).all()
