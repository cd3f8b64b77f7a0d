"""MrActuator: independence of environments, masked reset, resume, capture, couplings and parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import warp as wp

from mrwarp.actuator import ActuatorInputs, Coupling, HoldCurrent, MrActuator, MrActuatorCfg, Residual, ZStep
from mrwarp.kernels.joint_params import FIELDS
from mrwarp.kernels.ledger import ENTRIES
from mrwarp.kernels.window import FEATURES, WINDOW
from mrwarp.model_file import Effect
from mrwarp.params import MrParams


def f32(values: Any) -> np.ndarray:
    """The values as a float32 array."""
    return np.asarray(values, dtype=np.float32)


DT = 0.005
LEGS = [0, 0, 0, 1, 1, 1]
CALVES = (2, 5)
INERTIA = 0.02
"""Inertia of a joint of the toy plant [kg·m^2], about that of a calf."""


@dataclass(frozen=True)
class Joint:
    """The least that an actuator needs to know of a joint."""

    joint: str
    kp: float
    kd: float
    tau_limit: float
    mr: MrParams | None
    effects: tuple[Effect, ...] = ()


def make_joints(mr: bool = True) -> list[Joint]:
    """Two legs of three joints; the calves carry a device, and the two devices differ."""
    devices = {2: MrParams(), 5: MrParams().replace(coil_time_constant=0.02, K1=5.0)}
    return [Joint(f"joint_{i}", 25.0 + i, 0.6, 23.7, devices.get(i) if mr else None) for i in range(6)]


@wp.kernel
def toy_plant_kernel(
    # parameters [kg·m^2, s]
    inertia: float,
    dt: float,
    # in, shape (E, J)
    tau_in: wp.array2d[float],
    bound_in: wp.array2d[float],
    # out, shape (E, J)
    q_out: wp.array2d[float],
    qd_out: wp.array2d[float],
    friction_out: wp.array2d[float],
):
    """Free joints with dry friction, by semi-implicit Euler: friction stops the joint if its bound allows."""
    env, joint = wp.tid()
    free = qd_out[env, joint] + dt * tau_in[env, joint] / inertia
    friction = wp.clamp(-free * inertia / dt, -bound_in[env, joint], bound_in[env, joint])
    qd = free + dt * friction / inertia
    qd_out[env, joint] = qd
    q_out[env, joint] = q_out[env, joint] + dt * qd
    friction_out[env, joint] = friction


class Bench:
    """An actuator on its own input arrays and the toy plant."""

    def __init__(
        self,
        num_envs: int,
        cfg: MrActuatorCfg | None = None,
        joints: Sequence[Joint] | None = None,
        residual: Residual | None = None,
        share_params: bool = True,
    ) -> None:
        def zeros(*shape: int) -> wp.array:
            return wp.zeros(shape, dtype=float, device="cpu")

        self.joints = list(joints or make_joints())
        self.inputs = ActuatorInputs(
            q_des=zeros(num_envs, 6), q=zeros(num_envs, 6), qd=zeros(num_envs, 6), f_foot=zeros(num_envs, 2),
            current_e=zeros(num_envs), friction=zeros(num_envs, 6),
        )  # fmt: skip
        self.actuator = MrActuator(
            self.joints, LEGS, self.inputs, dt=DT, cfg=cfg, residual=residual, share_params=share_params
        )
        for name in ("m_dyn", "m_hold", "tau_dyn", "tau_mr", "tau_motor", "tau", "bound"):
            getattr(self.actuator, name).fill_(float("nan"))

    def write(self, **values: np.ndarray | float) -> None:
        """Overwrite input arrays."""
        for name, value in values.items():
            array = getattr(self.inputs, name)
            array.assign(np.ascontiguousarray(np.broadcast_to(f32(value), array.shape)))

    def step(self, **values: np.ndarray | float) -> None:
        """One torque step and its account on inputs that the caller gives."""
        self.write(**values)
        self.actuator.step()
        self.actuator.account()

    def substep(self) -> None:
        """One torque step, one step of the toy plant, and the account."""
        self.actuator.step()
        i, a = self.inputs, self.actuator
        outputs = [i.q, i.qd, i.friction]
        wp.launch(toy_plant_kernel, dim=i.q.shape, inputs=[INERTIA, DT, a.tau, a.bound], outputs=outputs, device="cpu")
        a.account()

    def everything(self) -> dict[str, np.ndarray]:
        """State, outputs and inputs, copied."""
        outputs = {name: getattr(self.actuator, name).numpy().copy() for name in ("tau", "tau_motor", "bound")}
        inputs = {name: getattr(self.inputs, name).numpy().copy() for name in ("q", "qd", "friction")}
        return self.actuator.state() | outputs | inputs


def random_inputs(rng: np.random.Generator, num_envs: int) -> dict[str, np.ndarray]:
    """States that open and close both gates."""
    shape = (num_envs, 6)
    return {
        "q_des": rng.normal(-1.5, 0.1, shape),
        "q": rng.normal(-1.5, 0.2, shape),
        "qd": rng.normal(0, 1, shape) * rng.choice([0.1, 1.0, 10.0], shape),
        "f_foot": rng.uniform(0, 20, (num_envs, 2)),
        "current_e": rng.uniform(0.2, 2, num_envs),
        "friction": rng.normal(0, 3, shape),
    }


def rows(arrays: dict[str, np.ndarray], envs: Sequence[int] | np.ndarray) -> dict[str, np.ndarray]:
    """Rows of the arrays that have one per environment; head and shared parameters stay as they are."""
    return {name: x if name in ("head", "params") else x[list(envs)] for name, x in arrays.items()}


def assert_bit_equal(got: dict[str, np.ndarray], want: dict[str, np.ndarray]) -> None:
    """Same names and same bytes, NaN included."""
    assert got.keys() == want.keys()
    differing = [name for name in want if got[name].tobytes() != want[name].tobytes()]
    assert differing == []


CFGS = [
    MrActuatorCfg(coupling=coupling, hold_current=hold, z_step=z_step)
    for coupling, hold, z_step in [
        (Coupling.EXPLICIT, HoldCurrent.SUPPORT, ZStep.EULER),
        (Coupling.CONSTRAINT, HoldCurrent.FIXED, ZStep.EXACT),
        (Coupling.CONSTRAINT, HoldCurrent.SUPPORT, ZStep.EULER),
    ]
]
each_cfg = pytest.mark.parametrize("cfg", CFGS, ids=lambda c: f"{c.coupling.value}-{c.hold_current.value}")


@each_cfg
@pytest.mark.parametrize("share_params", [True, False])
def test_environment_of_a_batch_equals_the_same_environment_alone(cfg: MrActuatorCfg, share_params: bool):
    """8 environments together and one by one, 50 random steps: every array bit-equal."""
    together = Bench(8, cfg, share_params=share_params)
    alone = [Bench(1, cfg) for _ in range(8)]
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
    got.pop("params")
    for k in range(8):
        want = alone[k].everything()
        want.pop("params")
        assert_bit_equal(rows(got, [k]), want)


def test_reset_of_a_mask_leaves_other_environments_bit_equal():
    """After 60 steps (the ring has wrapped), reset 3 of 8: only they change, and all continue as if alone."""
    bench, twin = Bench(8), Bench(8)
    rng = np.random.default_rng(22)
    for _ in range(60):
        x = random_inputs(rng, 8)
        bench.step(**x)
        twin.step(**x)
    mask = np.isin(np.arange(8), [1, 4, 7])
    kept, hit = np.flatnonzero(~mask), np.flatnonzero(mask)
    bench.actuator.reset(wp.array(mask, dtype=wp.bool, device="cpu"))
    assert_bit_equal(rows(bench.everything(), kept), rows(twin.everything(), kept))
    state = rows(bench.actuator.state(), hit)
    for name in ("z", "current", "ledger", "m_dyn", "m_hold", "tau_dyn", "tau_mr"):
        assert not state[name].any(), name
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
def test_state_resumes_bit_equal(cfg: MrActuatorCfg):
    """A new actuator that loads the state after 33 steps continues bit-equal, changed parameters included."""
    bench, resumed = Bench(4, cfg, share_params=False), Bench(4, cfg, share_params=False)
    rng = np.random.default_rng(24)
    bench.actuator.set_param("K1", rng.uniform(5, 15, (4, 2)))
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
def test_captured_steps_equal_eager_steps(cfg: MrActuatorCfg, substeps: int):
    """A captured loop of steps, plant and account, replayed 12 times, is bit-equal to running it eagerly."""
    eager, captured = Bench(4, cfg), Bench(4, cfg)
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


def test_shared_and_own_parameters_give_the_same_result():
    """One row of parameters for all, or the same row for each environment: bit-equal over 30 steps."""
    shared, own = Bench(5, share_params=True), Bench(5, share_params=False)
    rng = np.random.default_rng(27)
    for _ in range(30):
        x = random_inputs(rng, 5)
        shared.step(**x)
        own.step(**x)
    a, b = shared.everything(), own.everything()
    assert (a.pop("params").shape, b.pop("params").shape) == ((1, 2, len(FIELDS)), (5, 2, len(FIELDS)))
    assert_bit_equal(a, b)


def one_tau_dyn(current: float, factor: float) -> np.ndarray:
    """Prediction at a given current with K1 scaled and I1 = 0, the same state otherwise."""
    bench = Bench(4, MrActuatorCfg(hold_current=HoldCurrent.FIXED))
    bench.actuator.set_param("I1", 0.0)
    bench.actuator.set_param("coil_time_constant", 0.0)
    bench.actuator.set_param("K1", factor * bench.actuator.param("K1").numpy())
    # loaded joints that escape from their target: the damping gate is open and takes all of the current
    bench.step(q_des=-1.5, q=-1.3, qd=2.0, f_foot=50.0, current_e=current, friction=0.0)
    np.testing.assert_array_equal(bench.actuator.current.numpy(), f32(current))
    return bench.actuator.tau_dyn.numpy()


def test_set_param_doubles_the_part_that_current_makes():
    """tau_dyn(I) - tau_dyn(0) is proportional to K1; its value by hand is K1*I/(1 + alpha*|qd|)*z with z = qd*dt."""
    single = one_tau_dyn(1.2, 1.0) - one_tau_dyn(0.0, 1.0)
    double = one_tau_dyn(1.2, 2.0) - one_tau_dyn(0.0, 2.0)
    # z = 2*0.005 after one Euler step from 0; K1 = 10.413315 and 5 of the two devices
    by_hand = np.array([10.413315, 5.0]) * 1.2 / (1 + 0.7777051 * 2) * 0.01
    np.testing.assert_allclose(single, np.tile(by_hand, (4, 1)), rtol=0, atol=2e-7)
    np.testing.assert_allclose(double, 2 * single, rtol=0, atol=4e-7)


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
    np.testing.assert_allclose(got["tau"], np.clip(kp * e - 0.6 * qd, -23.7, 23.7), rtol=0, atol=1e-5)
    assert got["tau"].tobytes() == got["tau_motor"].tobytes()
    assert not got["bound"].any()
    assert not np.delete(got["ledger"], [ENTRIES.index("motor"), ENTRIES.index("motor_square")], axis=2).any()
    state = bench.actuator.state()
    bench.actuator.reset()
    assert not bench.actuator.state()["ledger"].any()
    bench.actuator.load_state(state)
    assert_bit_equal(bench.actuator.state(), state)


class Shift:
    """A residual of 0.75 N·m that remembers nothing but its calls."""

    def __init__(self) -> None:
        self.calls: list[tuple[tuple[int, ...], int]] = []

    graphable = False

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
    np.testing.assert_allclose(got["bound"][:, CALVES], want, rtol=2e-5, atol=1e-6)
    assert not np.delete(got["bound"], CALVES, axis=1).any()
    # the account takes over the torque that the solver found
    bench.actuator.account()
    np.testing.assert_array_equal(bench.actuator.tau_mr.numpy(), bench.inputs.friction.numpy()[:, CALVES])


def test_constraint_coupling_is_passive_in_discrete_time():
    """Loaded light joints settle for 1 s: the constraint injects nothing, the explicit device does positive work."""
    works = {}
    for coupling in Coupling:
        bench, rng = Bench(16, MrActuatorCfg(coupling=coupling)), np.random.default_rng(31)
        bench.write(**random_inputs(rng, 16) | {"f_foot": np.full(2, 50.0)})
        for _ in range(200):
            bench.substep()
        ledger = np.moveaxis(bench.actuator.ledger.numpy()[:, CALVES], -1, 0)
        works[coupling] = dict(zip(ENTRIES, ledger, strict=True))
    brake, explicit = works[Coupling.CONSTRAINT], works[Coupling.EXPLICIT]
    # a stopped joint keeps a velocity of rounding, 2^-24 of its last one: 25 N·m * 1e-7 rad/s * 5 ms = 1e-8 J
    assert brake["injected"].max() < 1e-8
    assert (brake["dynamic"] + brake["hold"] + brake["drag"]).min() < -0.5
    # at the first instant eq. 6 opposes the motion; over the step it turns the joint around and pushes it
    assert explicit["dynamic"].max() > 1e-3
    assert explicit["injected"].max() > 1e-3


def test_explicit_coupling_adds_the_device_to_the_motor():
    """tau = motor + device at the calves, motor alone elsewhere, and no bound."""
    bench, rng = Bench(50, MrActuatorCfg(coupling=Coupling.EXPLICIT)), np.random.default_rng(32)
    bench.step(**random_inputs(rng, 50))
    got = bench.everything()
    device = np.zeros((50, 6), dtype=np.float32)
    device[:, CALVES] = got["tau_mr"]
    np.testing.assert_array_equal(got["tau"], got["tau_motor"] + device)
    assert not got["bound"].any()
    assert (abs(got["tau_mr"]) > 0).sum() > 80


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
    np.testing.assert_allclose(got["tau_motor"][:, CALVES], want, rtol=0, atol=1e-5)


def test_actuator_refuses_joints_that_do_not_match_its_arrays():
    """Six columns of state and five joints: both numbers are in the message."""
    inputs = Bench(2).inputs
    with pytest.raises(ValueError, match="5 joints and 6 legs given for arrays of 6 joints"):
        MrActuator(make_joints()[:5], LEGS, inputs, dt=DT)
