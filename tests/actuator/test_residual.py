"""LearnedTorque: the torch module's function in the loop, for open windows only, regardless of the others."""

# Newton's arrays are Optional and its custom attributes dynamic; pyright cannot follow either
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportOptionalMemberAccess=false

import threading
import warnings
from dataclasses import asdict, replace
from functools import partial

import newton
import numpy as np
import pytest
import torch
import warp as wp

import mrwarp.actuator.residual
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.mr_actuator import MrActuator
from mrwarp.actuator.newton_drive import DriveMR, drive_inputs
from mrwarp.actuator.residual import KINDS, LearnedTorque, states_at_rest, window_now, with_bouc_wen
from mrwarp.enums import Coupling, HoldCurrent, LstmState
from mrwarp.identify import learn
from mrwarp.kernels import launch
from mrwarp.kernels.launch import capture
from mrwarp.model_file import make_effect
from mrwarp.nn.models import LstmTorque, make_net
from mrwarp.nn.network_file import DEVICE, LearnedModel, OtherDeviceError, SamplingRateError, load, shipped_model
from mrwarp.params import BoucWenParams, MrParams, ParameterError
from mrwarp.recording.load import Recording, Trajectory
from mrwarp.runtime import DeviceWarning
from tests.actuator.actuator_bench import Joint, make_inputs

DT = 0.005
MR = 4
PAPER = {name: value for name, value in MrParams() if name in DEVICE}


def make_model(kind: str, seed: int = 0, dt: float = DT) -> LearnedModel:
    """An untrained network with large weights and a scaler that is not the identity, so that errors show."""
    net = make_net(kind, seed)
    with torch.no_grad():
        for parameter in net.parameters():
            parameter.mul_(2.0)
    net.scaler.mean.copy_(torch.tensor([0.1, -0.4, 0.6]))
    net.scaler.std.copy_(torch.tensor([0.3, 2.5, 0.5]))
    return LearnedModel(kind=kind, net=net.eval(), dt=dt, bouc_wen=asdict(BoucWenParams(q_neutral=0.0)))


class Loop:
    """An actuator with four devices per environment on arrays that the test writes."""

    def __init__(
        self,
        num_envs: int,
        residual: LearnedTorque | None,
        coupling: Coupling = Coupling.EXPLICIT,
        device: str = "cpu",
    ) -> None:
        self.inputs = make_inputs(num_envs, MR, MR, device)
        cfg = MrActuatorCfg(coupling=coupling, hold_current=HoldCurrent.FIXED)
        self.actuator = MrActuator(
            [Joint("calf", MrParams())] * MR,
            list(range(MR)),
            self.inputs,
            dt=DT,
            cfg=cfg,
            residual=residual,
            share_params=False,
        )

    def run(
        self, motion: dict[str, np.ndarray], first: int = 0, last: int | None = None, account: bool = False
    ) -> dict[str, np.ndarray]:
        """Step through samples of a motion (arrays of shape (T, E, ...)); returns what each step gave, time first."""
        names = ("tau_dyn", "m_dyn", "current", "tau", "bound")
        rows: dict[str, list[np.ndarray]] = {name: [] for name in names}
        for k in range(first, len(motion["q"]) if last is None else last):
            for name, values in motion.items():
                getattr(self.inputs, name).assign(np.ascontiguousarray(values[k], dtype=np.float32))
            self.actuator.step()
            if account:
                self.actuator.account()
            for name, kept in rows.items():
                kept.append(getattr(self.actuator, name).numpy().copy())
        return {name: np.stack(kept) for name, kept in rows.items()}


def make_motion(num_envs: int, steps: int, seed: int) -> dict[str, np.ndarray]:
    """Sines in every joint, with targets and loads that open the dynamic gate about half of the time."""
    rng = np.random.default_rng(seed)
    t = np.arange(steps)[:, None, None] * DT
    shape = (1, num_envs, MR)
    amplitude, frequency = rng.uniform(0.1, 0.6, shape), rng.uniform(0.5, 2.0, shape)
    phase = 2 * np.pi * (frequency * t + rng.uniform(0, 1, shape))
    q = -1.5 + amplitude * np.sin(phase)
    return {
        "q": q,
        "qd": 2 * np.pi * frequency * amplitude * np.cos(phase),
        "q_des": q + 0.3 * np.sign(np.sin(7.0 * t + 6.0 * rng.uniform(0, 1, shape))),
        "f_foot": np.broadcast_to(20.0, q.shape),
        "current_e": np.broadcast_to(rng.uniform(0.0, 1.5, num_envs), (steps, num_envs)),
    }


def make_window(num_envs: int, seed: int) -> tuple[wp.array, wp.array, np.ndarray, np.ndarray]:
    """History ring, its head, a dynamic gate that is open for a third, and a Bouc-Wen torque."""
    rng = np.random.default_rng(seed)
    ring = rng.normal(0.0, [0.3, 3.0, 0.6], (num_envs, MR, 50, 3)).astype(np.float32)
    m_dyn = (rng.random((num_envs, MR)) < 0.33).astype(np.float32)
    tau = rng.normal(0.0, 3.0, (num_envs, MR)).astype(np.float32)
    return wp.array(ring, device="cpu"), wp.array([17], dtype=int, device="cpu"), m_dyn, tau


def evaluate(residual: LearnedTorque, ring: wp.array, head: wp.array, m_dyn: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """The prediction for all windows."""
    out = wp.array(tau, dtype=float, device="cpu")
    residual(ring, head, wp.array(m_dyn, dtype=float, device="cpu"), out)
    return out.numpy().copy()


@pytest.mark.parametrize("kind", KINDS)
def test_learned_torque_is_the_torch_module(kind: str) -> None:
    """Open windows get the module's output (added for pg_rlstm), closed ones keep tau_BW to the bit; float32 rounding.

    The tolerance is 100 roundings of the largest torque.
    """
    model = make_model(kind, seed=1)
    ring, head, m_dyn, tau = make_window(16, seed=2)
    got = evaluate(LearnedTorque(model, dt=DT), ring, head, m_dyn, tau)
    with torch.no_grad():
        net = model.net(window_now(ring, head)[:, :, -model.samples :].flatten(0, 1)).reshape(16, MR).numpy()
    want = net + (tau if kind == "pg_rlstm" else 0.0)
    is_open = m_dyn > 0.0
    assert 0 < is_open.sum() < is_open.size
    np.testing.assert_allclose(got[is_open], want[is_open], rtol=0.0, atol=1e-5)
    np.testing.assert_array_equal(got[~is_open], tau[~is_open])


@pytest.mark.parametrize("gpu_layout", [False, True])
@pytest.mark.parametrize("lstm_state", list(LstmState))
@pytest.mark.parametrize("kind", KINDS)
def test_learned_torque_in_the_loop_equals_offline_prediction(
    kind: str, lstm_state: LstmState, gpu_layout: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A motion in the loop and the same motion offline, led in by the rest that a reset assumes: 1e-5 N·m."""
    monkeypatch.setattr(launch, "GPU_LAYOUT", gpu_layout)
    model = make_model(kind, seed=3)
    motion = make_motion(2, 150, seed=4)
    loop = Loop(2, LearnedTorque(model, dt=DT, lstm_state=lstm_state))
    loop.inputs.q.assign(motion["q"][0].astype(np.float32))
    loop.actuator.reset()
    got = loop.run(motion)
    rest = model.samples - 1
    runs = []
    for env in range(2):
        for joint in range(MR):
            q = np.concatenate([np.full(rest, motion["q"][0, env, joint]), motion["q"][:, env, joint]])
            qd = np.concatenate([np.zeros(rest), motion["qd"][:, env, joint]])
            current = np.concatenate([np.zeros(rest), got["current"][:, env, joint]])
            t = DT * np.arange(len(q))
            name = f"{env}/{joint}"
            runs.append(Trajectory(id=name, t=t, q=q + 1.5, qd=qd, current=current, torque=np.zeros_like(q)))
    offline = learn.predict(model, Recording(trajectories=tuple(runs)), lstm_state=lstm_state)
    want = np.stack([tau[rest:] for tau in offline], axis=1).reshape(-1, 2, MR)
    is_open = got["m_dyn"] > 0.0
    assert is_open.mean() > 0.2
    assert np.abs(got["tau_dyn"] - want)[is_open].max() < 1e-5


@pytest.mark.parametrize("kind", KINDS)
def test_learned_torque_of_open_windows_is_bit_equal_to_all(kind: str) -> None:
    """Evaluating all windows, any number of threads or each window alone gives the same bits."""
    model = make_model(kind, seed=5)
    ring, head, m_dyn, tau = make_window(16, seed=6)
    want = evaluate(LearnedTorque(model, dt=DT, threads=1), ring, head, m_dyn, tau)
    for threads, everything in ((1, True), (2, False), (2, True), (3, False)):
        other = LearnedTorque(model, dt=DT, threads=threads, evaluate_all=everything)
        np.testing.assert_array_equal(evaluate(other, ring, head, m_dyn, tau), want)
    alone = LearnedTorque(model, dt=DT)
    for env, joint in np.argwhere(m_dyn > 0.0):
        single = np.zeros_like(m_dyn)
        single[env, joint] = 1.0
        assert evaluate(alone, ring, head, single, tau)[env, joint] == want[env, joint]


def test_learned_torque_is_bit_equal_for_any_threads_when_calls_follow_each_other() -> None:
    """Helpers that wake up late, after other gates have opened, take only work that is there: 200 calls in a row."""
    model, rng = make_model("pg_rlstm", seed=16), np.random.default_rng(17)
    ring, head, _, tau = make_window(16, seed=18)
    gate, out = wp.zeros((16, MR), dtype=float, device="cpu"), wp.array(tau, dtype=float, device="cpu")
    windows = partial(LearnedTorque, model, dt=DT, lstm_state=LstmState.WINDOW)
    alone = evaluate(windows(threads=1), ring, head, np.ones_like(tau), tau)
    for threads in (2, 4):
        residual = windows(threads=threads)
        for _ in range(100):
            m_dyn = rng.permuted(np.arange(tau.size) < rng.integers(0, tau.size)).reshape(tau.shape)
            gate.assign(m_dyn.astype(np.float32))
            out.assign(tau)
            residual(ring, head, gate, out)
            np.testing.assert_array_equal(out.numpy(), np.where(m_dyn, alone, tau))


@pytest.mark.parametrize("gpu_layout", [False, True])
def test_carried_states_are_bit_equal_for_any_threads_and_gates(
    gpu_layout: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """36 joints, three parts of the work: every joint's torque is that of a joint alone, for any open gates."""
    monkeypatch.setattr(launch, "GPU_LAYOUT", gpu_layout)
    monkeypatch.setattr(mrwarp.actuator.residual, "_WORTH_WAKING", 1)
    model, rng = make_model("pg_rlstm", seed=22), np.random.default_rng(23)
    ring, head, _, tau = make_window(9, seed=24)
    gate, out = wp.zeros(tau.shape, dtype=float, device="cpu"), wp.array(tau, dtype=float, device="cpu")
    ones, alone = wp.ones(tau.shape, dtype=float, device="cpu"), wp.array(tau, dtype=float, device="cpu")
    want = LearnedTorque(model, dt=DT, threads=1)
    others = [LearnedTorque(model, dt=DT, threads=threads) for threads in (1, 2, 4)]
    for k in range(60):
        head.assign([k % 50])
        values = ring.numpy()
        values[:, :, k % 50] = rng.normal(0.0, [0.3, 3.0, 0.6], (9, MR, 3))
        ring.assign(values)
        alone.assign(tau)
        want(ring, head, ones, alone)
        m_dyn = rng.random(tau.shape) < 0.3
        gate.assign(m_dyn.astype(np.float32))
        begun = rng.random(9) < 0.05
        for residual in others:
            out.assign(tau)
            residual(ring, head, gate, out)
            np.testing.assert_array_equal(out.numpy(), np.where(m_dyn, alone.numpy(), tau))
        for residual in (want, *others):
            residual.reset(wp.array(begun, dtype=wp.bool, device="cpu"))


@pytest.mark.parametrize("kind", ["lstm", "pg_rlstm"])
def test_states_at_rest_lie_close_enough_to_interpolate(kind: str) -> None:
    """The torque of a shipped network after resting anywhere within half a turn, against its own LSTM: 1e-3 N·m."""
    path = shipped_model(kind)
    assert path is not None
    net = load(path).net
    assert isinstance(net, LstmTorque)
    table = states_at_rest(net)
    q_c = np.random.default_rng(27).uniform(-3.1, 3.1, 1000)
    x = torch.zeros(50, len(q_c), 3)
    x[:, :, 0] = torch.from_numpy(q_c)
    at = (q_c + np.pi) / (2.0 * np.pi) * (table.shape[2] - 1)
    low = at.astype(int)
    hidden, cell = (
        torch.from_numpy(table[:, :, low] * (1.0 - at + low) + table[:, :, low + 1] * (at - low)).float().mT
    ).contiguous()
    with torch.no_grad():
        output, _ = net.lstm(net.scaler(x[-1:]), (hidden[None], cell[None]))
        np.testing.assert_allclose(net.out(output[0])[:, 0], net.scaled(net.scaler(x)), rtol=0.0, atol=1e-3)


@pytest.mark.parametrize("gpu_layout", [False, True])
def test_a_carried_state_is_restored_bit_equal(gpu_layout: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A loop that takes over another one's state goes on as it does, on the CPU's kernel and on the GPU's."""
    monkeypatch.setattr(launch, "GPU_LAYOUT", gpu_layout)
    model, motion = make_model("lstm", seed=25), make_motion(3, 70, seed=26)
    first, second = (Loop(3, LearnedTorque(model, dt=DT)) for _ in range(2))
    first.run(motion, 0, 40)
    state = first.actuator.state()
    assert np.abs(state["lstm"]).max() > 0.1
    assert not state["lstm_fresh"].any()
    want = first.run(motion, 40)
    second.actuator.load_state(state)
    np.testing.assert_array_equal(second.run(motion, 40)["tau_dyn"], want["tau_dyn"])


def test_helper_threads_end_with_their_torque() -> None:
    """A learned torque that nobody holds leaves no thread behind."""
    before = set(threading.enumerate())
    ring, head, m_dyn, tau = make_window(16, seed=19)
    residual = LearnedTorque(make_model("lstm"), dt=DT, lstm_state=LstmState.WINDOW, threads=3)
    evaluate(residual, ring, head, m_dyn, tau)
    helpers = set(threading.enumerate()) - before
    assert len(helpers) == 2
    del residual
    for helper in helpers:
        helper.join(timeout=10.0)
        assert not helper.is_alive()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("captured", [False, True])
def test_a_full_set_of_open_windows_overflows_into_later_turns(
    kind: str, captured: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Room for 1, 3 or 13 of 64 windows gives the bits of room for all, with none, a third or all of them open."""
    monkeypatch.setattr(launch, "GPU_LAYOUT", True)
    model, (ring, head, some, tau) = make_model(kind, seed=20), make_window(16, seed=21)
    gate, out = wp.zeros(some.shape, dtype=float, device="cpu"), wp.array(tau, dtype=float, device="cpu")
    windows = partial(LearnedTorque, model, dt=DT, lstm_state=LstmState.WINDOW)
    whole = windows()
    for capacity in (1 / 64, 3 / 64, 0.2):
        small = windows(capacity=capacity)
        evaluate_small = partial(small, ring, head, gate, out)
        if captured:
            evaluate_small()
            evaluate_small = partial(wp.capture_launch, capture(evaluate_small, "cpu"))
        for m_dyn in (np.zeros_like(some), some, np.ones_like(some)):
            gate.assign(m_dyn)
            out.assign(tau)
            evaluate_small()
            want = evaluate(whole, ring, head, m_dyn, tau)
            np.testing.assert_array_equal(out.numpy(), want)
            assert ((out.numpy() != tau) == (m_dyn > 0.0)).all()


@pytest.mark.parametrize("capacity", [0.0, -0.5, 1.5, float("nan")])
def test_a_capacity_out_of_range_is_refused(capacity: float) -> None:
    """It is a share of all windows."""
    with pytest.raises(ValueError, match="capacity"):
        LearnedTorque(make_model("mlp"), dt=DT, capacity=capacity)


@pytest.mark.parametrize("coupling", list(Coupling))
@pytest.mark.parametrize("kind", ["mlp", None])
def test_an_actuator_in_a_gpus_threads_gives_the_bits_of_one_thread(
    kind: str | None, coupling: Coupling, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thread per joint, here on the CPU, and one for all: torques, bounds, state and ledger, with a reset midway."""
    motion, states = make_motion(5, 60, seed=30), []
    for gpu_layout in (False, True):
        monkeypatch.setattr(launch, "GPU_LAYOUT", gpu_layout)
        loop = Loop(5, LearnedTorque(make_model(kind), dt=DT) if kind else None, coupling)
        torques = loop.run(motion, 0, 40, account=True)
        assert torques["m_dyn"].any() and not torques["m_dyn"].all()
        loop.actuator.reset(wp.array([False, True, False, True, False], dtype=wp.bool, device="cpu"))
        states.append(torques | loop.run(motion, 40, account=True) | loop.actuator.state())
        assert loop.actuator.state()["ledger"].any()
    for name, want in states[0].items():
        np.testing.assert_array_equal(states[1][name], want, name)


@pytest.mark.gpu
@pytest.mark.parametrize("coupling", list(Coupling))
@pytest.mark.parametrize("kind", [*KINDS, None])
def test_an_actuator_on_a_gpu_is_that_of_a_cpu(kind: str | None, coupling: Coupling) -> None:
    """Torques, bounds, state and ledger of a real GPU after 90 steps with a reset midway: up to float32 rounding."""
    motion, found = make_motion(5, 90, seed=31), []
    for device in ("cpu", "cuda:0"):
        loop = Loop(5, LearnedTorque(make_model(kind), dt=DT) if kind else None, coupling, device)
        torques = loop.run(motion, 0, 40, account=True)
        loop.actuator.reset(wp.array([False, True, False, True, False], dtype=wp.bool, device=device))
        found.append(torques | loop.run(motion, 40, account=True) | loop.actuator.state())
    assert found[0]["m_dyn"].any() and not found[0]["m_dyn"].all()
    for name, want in found[0].items():
        np.testing.assert_allclose(found[1][name], want, rtol=2e-4, atol=2e-4, err_msg=name)


def test_reset_of_one_environment_leaves_the_others_history_and_torque() -> None:
    """Masked reset in the middle: the other environments' history and later torque keep every bit."""
    model, motion = make_model("pg_rlstm", seed=10), make_motion(3, 90, seed=11)
    plain, reset = (Loop(3, LearnedTorque(model, dt=DT)) for _ in range(2))
    for loop in (plain, reset):
        loop.run(motion, 0, 60)
    before = reset.actuator.ring.numpy().copy()
    reset.actuator.reset(wp.array([False, True, False], dtype=wp.bool, device="cpu"))
    after = reset.actuator.ring.numpy()
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    assert np.all(after[1, :, :, 1:] == 0.0)
    want, got = plain.run(motion, 60), reset.run(motion, 60)
    np.testing.assert_array_equal(got["tau_dyn"][:, [0, 2]], want["tau_dyn"][:, [0, 2]])
    assert not np.array_equal(got["tau_dyn"][:, 1], want["tau_dyn"][:, 1])


@pytest.mark.parametrize("lstm_state", list(LstmState))
def test_learned_torque_in_a_captured_step_is_bit_equal(lstm_state: LstmState) -> None:
    """Recorded once and replayed on other gates, the evaluation gives the same bits as a direct call."""
    model = make_model("lstm", seed=12)
    ring, head, m_dyn, tau = make_window(8, seed=13)
    residual = LearnedTorque(model, dt=DT, lstm_state=lstm_state, threads=2)
    gate, out = wp.zeros(m_dyn.shape, dtype=float, device="cpu"), wp.array(tau, dtype=float, device="cpu")
    residual(ring, head, gate, out)
    residual.reset(wp.full(8, True, dtype=wp.bool, device="cpu"))
    with wp.ScopedDevice("cpu"), wp.ScopedCapture() as capture:
        residual(ring, head, gate, out)
    assert capture.graph is not None
    gate.assign(m_dyn)
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(out.numpy(), evaluate(LearnedTorque(model, dt=DT), ring, head, m_dyn, tau))


def test_learned_torque_refuses_another_rate() -> None:
    """A model of 200 Hz does not run in a loop of 400 Hz, and the message says both."""
    with pytest.raises(SamplingRateError, match="200 Hz.*400 Hz"):
        LearnedTorque(make_model("lstm"), dt=0.0025)


def test_bouc_wen_of_the_model_replaces_the_joints() -> None:
    """The joint takes the coefficients the model was trained with, and keeps its own neutral angle."""
    model = replace(make_model("pg_rlstm"), device=PAPER)
    model.bouc_wen["K1"] = 8.0
    mr = with_bouc_wen(MrParams(), model)
    assert mr.bouc_wen.K1 == 8.0
    assert mr.bouc_wen.q_neutral == MrParams().bouc_wen.q_neutral
    assert mr.hold == MrParams().hold


def test_a_network_is_refused_for_another_device() -> None:
    """By the number that differs and the remedy; the zeros of a bench, and what holds, are no part of a device."""
    model = make_model("lstm")
    with pytest.raises(OtherDeviceError, match=r"K1 10\.41 instead of 985, beta .*learn DATA --bouc-wen MODEL\.json"):
        with_bouc_wen(MrParams().replace(K1=985.0, beta=300.0), model)
    moved = MrParams().replace(q_offset=0.3, q_center=0.1, T_max=4.0, coil_resistance=30.0, kd=1.0)
    assert with_bouc_wen(moved, model).hold.T_max == 4.0
    own = replace(model, device={**PAPER, "K1": 985.0})  # any fit of the device with which it was trained
    assert with_bouc_wen(MrParams().replace(K1=985.0), own).bouc_wen.K1 == model.bouc_wen["K1"]
    with pytest.raises(OtherDeviceError, match=r"K1 985 instead of 10\.41"):
        with_bouc_wen(MrParams(), own)


def test_a_drive_refuses_the_network_of_another_device() -> None:
    """One of its joints is another device than the others."""
    builder = newton.ModelBuilder()
    for k1 in (MrParams().bouc_wen.K1, 20.0):
        body = builder.add_link(mass=1.0, inertia=wp.mat33(np.eye(3) * 0.2))
        joint = builder.add_joint_revolute(parent=-1, child=body, axis=(0.0, 0.0, 1.0))
        builder.add_articulation([joint])
        builder.add_actuator(DriveMR, index=builder.joint_qd_start[joint], K1=k1)
    (actuator,) = builder.finalize(device="cpu").actuators
    with pytest.raises(OtherDeviceError, match=r"K1 10\.41 instead of 20"):
        actuator.drive.use_learned(make_model("mlp"), dt=DT)


def test_a_residual_on_a_law_runs_with_that_law_only() -> None:
    """The joint must have the law with the same numbers; plain residuals run with effects, but with no law."""
    numbers = {"slope": 3.0, "width": 0.4}
    law, plain = (make_effect("kwok", numbers),), make_model("pg_rlstm")
    model = replace(plain, trained_with={"kwok": numbers})
    assert with_bouc_wen(MrParams(), model, law).bouc_wen == with_bouc_wen(MrParams(), plain).bouc_wen
    other = (make_effect("kwok", {**numbers, "slope": 2.0}),)
    for trained, joint, said in (
        (model, (), "kwok, the joint has eqs. 14 and 15 alone"),
        (model, other, "with other numbers"),
        (plain, law, "eqs. 14 and 15 alone, the joint has kwok"),
    ):
        with pytest.raises(ParameterError, match=said):
            with_bouc_wen(MrParams(), trained, joint)
    inertia = (make_effect("rotor_inertia", {"inertia": 0.01}),)
    assert with_bouc_wen(MrParams(), plain, inertia).hold == MrParams().hold


@pytest.mark.parametrize("kind", KINDS)
def test_newton_drive_with_a_learned_torque_is_the_actuator_with_it(kind: str) -> None:
    """Same inputs, same efforts, through a masked reset; the drive's coefficients become the model's."""
    model, num, steps = replace(make_model(kind, seed=14), device=PAPER), 3, 70
    model.bouc_wen["K1"] = 8.0
    builder = newton.ModelBuilder()
    for _ in range(num):
        builder.begin_world()
        body = builder.add_link(mass=1.0, inertia=wp.mat33(np.eye(3) * 0.2))
        joint = builder.add_joint_revolute(parent=-1, child=body, axis=(0.0, 0.0, 1.0), armature=0.0)
        builder.add_articulation([joint])
        builder.add_actuator(DriveMR, index=builder.joint_qd_start[joint], hold_current="fixed")
        builder.end_world()
    scene = builder.finalize(device="cpu")
    (actuator,) = scene.actuators
    actuator.drive.use_learned(model, dt=DT)
    state, control, now, after = scene.state(), scene.control(), actuator.state(), actuator.state()
    given = drive_inputs(actuator, control)
    motion = {name: values[..., :1] for name, values in make_motion(num, steps, seed=15).items() if values.ndim == 3}
    motion["current_e"] = np.broadcast_to([0.5, 1.0, 1.5], (steps, num))
    inputs = make_inputs(num, 1)
    cfg = MrActuatorCfg(coupling=Coupling.EXPLICIT, hold_current=HoldCurrent.FIXED)
    joints = [Joint("calf", with_bouc_wen(MrParams(), model))]
    residual = LearnedTorque(model, dt=DT, lstm_state=LstmState.WINDOW)
    other = MrActuator(joints, [0], inputs, dt=DT, cfg=cfg, residual=residual)
    inputs.q.assign(motion["q"][0].astype(np.float32))
    other.reset()
    mask = wp.array([False, True, False], dtype=wp.bool, device="cpu")
    opened = 0.0
    for k in range(steps):
        for name, values in motion.items():
            getattr(inputs, name).assign(np.ascontiguousarray(values[k], dtype=np.float32))
        for array, name in (
            (state.joint_q, "q"),
            (state.joint_qd, "qd"),
            (control.joint_target_q, "q_des"),
            (given.mr_foot_load, "f_foot"),
            (given.mr_current, "current_e"),
        ):
            array.assign(np.ascontiguousarray(motion[name][k], dtype=np.float32).reshape(-1))
        if k == 40:
            other.reset(mask)
            now.drive_state.reset(mask)
        other.step()
        control.joint_f.zero_()
        actuator.step(state, control, now, after, dt=DT)
        now, after = after, now
        np.testing.assert_array_equal(control.joint_f.numpy(), other.tau.numpy()[:, 0])
        opened += other.m_dyn.numpy().mean() / steps
    assert opened > 0.2


def test_a_residual_on_another_step_is_noted() -> None:
    """A network that was trained on top of Euler's step runs on the exact one with a warning, else without."""
    model = make_model("pg_rlstm", seed=3)
    assert model.z_step == "exact"
    euler = replace(model, z_step="euler")
    with pytest.warns(DeviceWarning, match="trained on top of the euler step of eq. 15 and runs on the exact one"):
        Loop(1, LearnedTorque(euler, dt=DT))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Loop(1, LearnedTorque(model, dt=DT))
        Loop(1, LearnedTorque(replace(make_model("lstm", seed=3), z_step="euler"), dt=DT))  # no residual
