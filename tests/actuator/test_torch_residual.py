"""A learned torque in torch: the kernels' function on the same arrays, and modules of any other shape."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import warp as wp
from torch import nn

from mrwarp.actuator.residual import KINDS, LearnedTorque, window_now
from mrwarp.enums import LstmState, ResidualEngine
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from tests.actuator.test_residual import DT, MR, Loop, evaluate, make_model, make_motion, make_window

ROUNDING = 1e-5
"""Two orders of summing 64 products in float32, torques of 10 N·m at most, fifty samples [N·m]."""


class Gru(nn.Module):
    """A network that no kernel knows: a GRU of 20 units whose state is carried."""

    state_size = 20

    def __init__(self, seed: int = 0) -> None:
        super().__init__()
        torch.manual_seed(seed)
        self.cell, self.out = nn.GRUCell(3, self.state_size), nn.Linear(self.state_size, 1)

    def step(self, x: torch.Tensor, state: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Torque and next state."""
        state = self.cell(x, state)
        return self.out(state)[:, 0], state


class Window(nn.Module):
    """A convolution over the whole window."""

    def __init__(self, outputs: int = 1) -> None:
        super().__init__()
        torch.manual_seed(3)
        self.net = nn.Sequential(nn.Conv1d(3, 4, 7), nn.Tanh(), nn.Flatten(), nn.Linear(4 * 44, outputs))

    def forward(self, window: torch.Tensor) -> torch.Tensor:
        """Torque of windows (N, 50, 3)."""
        return self.net(window.transpose(1, 2)).squeeze(1)


@pytest.mark.parametrize("lstm_state", list(LstmState))
@pytest.mark.parametrize("kind", KINDS)
def test_torch_gives_the_torques_of_the_kernels(kind: str, lstm_state: LstmState) -> None:
    """The paper's networks in the loop, with a reset midway: to rounding; and the same bits when it is repeated."""
    model, motion = make_model(kind, seed=40), make_motion(4, 120, seed=41)
    torques, opened = [], None
    for engine in (ResidualEngine.KERNELS, ResidualEngine.TORCH, ResidualEngine.TORCH):
        loop = Loop(4, LearnedTorque(model, dt=DT, engine=engine, lstm_state=lstm_state))
        loop.inputs.q.assign(motion["q"][0].astype(np.float32))
        loop.actuator.reset()
        first = loop.run(motion, 0, 70)
        loop.actuator.reset(wp.array([False, True, False, True], dtype=wp.bool, device="cpu"))
        rest = loop.run(motion, 70)
        torques.append(np.concatenate([first["tau_dyn"], rest["tau_dyn"]]))
        opened = np.concatenate([first["m_dyn"], rest["m_dyn"]])
    assert opened is not None and 0.2 < opened.mean() < 0.8
    kernels, by_torch, again = torques
    np.testing.assert_allclose(by_torch, kernels, rtol=0.0, atol=ROUNDING)
    np.testing.assert_array_equal(again, by_torch)


def test_a_gru_is_carried_from_sample_to_sample() -> None:
    """Any carried module: its torque along a motion is that of the module itself, led in by the rest of a reset."""
    net, motion = Gru(), make_motion(2, 60, seed=42)
    loop, plain = Loop(2, LearnedTorque(net, dt=DT)), Loop(2, None)
    for bench in (loop, plain):
        bench.inputs.q.assign(motion["q"][0].astype(np.float32))
        bench.actuator.reset()
    got, bouc_wen = loop.run(motion), plain.run(motion)
    x = np.stack([motion["q"] + 1.5, motion["qd"], got["current"]], axis=-1).astype(np.float32)  # q_neutral is -1.5 rad
    still = np.zeros_like(x[0])
    still[..., 0] = motion["q"][0] + 1.5
    state = torch.zeros(2 * MR, net.state_size)
    with torch.no_grad():
        for _ in range(49):
            _, state = net.step(torch.from_numpy(still.reshape(-1, 3)), state)
        for k in range(len(x)):
            torque, state = net.step(torch.from_numpy(x[k].reshape(-1, 3)), state)
            want = bouc_wen["tau_dyn"][k] + np.where(got["m_dyn"][k] > 0, torque.numpy().reshape(2, MR), 0.0)
            # the state at rest is interpolated between points every 1.5 mrad
            np.testing.assert_allclose(got["tau_dyn"][k], want, rtol=0.0, atol=5 * ROUNDING)
    assert np.abs(got["tau_dyn"] - bouc_wen["tau_dyn"]).max() > 0.05


@pytest.mark.parametrize("everything", [False, True])
def test_a_module_over_windows_replaces_or_adds(everything: bool) -> None:
    """Open windows get the module's torque, added or in place of tau_BW; closed ones keep their bits."""
    net, (ring, head, m_dyn, tau) = Window(), make_window(6, seed=43)
    with torch.no_grad():
        torque = net(window_now(ring, head).flatten(0, 1)).reshape(6, MR).numpy()
    for adds in (False, True):
        got = evaluate(LearnedTorque(net, dt=DT, adds=adds, evaluate_all=everything), ring, head, m_dyn, tau)
        want = np.where(m_dyn > 0, torque + tau * adds, tau)
        np.testing.assert_allclose(got, want, rtol=0.0, atol=ROUNDING)
        np.testing.assert_array_equal(got[m_dyn == 0], tau[m_dyn == 0])


def test_a_torch_state_is_restored_bit_equal() -> None:
    """A loop that takes over another one's state goes on as it does."""
    motion = make_motion(3, 70, seed=44)
    first, second = (Loop(3, LearnedTorque(Gru(7), dt=DT)) for _ in range(2))
    first.run(motion, 0, 40)
    state = first.actuator.state()
    assert state["net_state"].shape == (3, MR, 20) and not state["net_fresh"].any()
    want = first.run(motion, 40)
    second.actuator.load_state(state)
    np.testing.assert_array_equal(second.run(motion, 40)["tau_dyn"], want["tau_dyn"])


def test_torch_works_on_warps_own_memory() -> None:
    """No copy: the tensors lie where the actuator's arrays lie."""
    loop = Loop(2, residual := LearnedTorque(Gru(), dt=DT))
    views = residual._torch
    assert views._tau.data_ptr() == loop.actuator.tau_dyn.ptr
    assert views._ring.data_ptr() == loop.actuator.ring.ptr
    assert views._gate.data_ptr() == loop.actuator.m_dyn.ptr


def test_a_module_of_another_output_is_refused() -> None:
    """One torque per window, or the message gives both shapes."""
    with pytest.raises(ValueError, match=r"shape \(2, 5\) for two windows of shape \(50, 3\)"):
        Loop(2, LearnedTorque(Window(outputs=5), dt=DT))
    net = Gru()
    net.state_size = 21
    with pytest.raises((ValueError, RuntimeError)):
        Loop(2, LearnedTorque(net, dt=DT))


def test_a_walk_with_a_module_runs_between_captured_graphs() -> None:
    """Captured and eager policy steps give the same bits; the module's torque is felt; two residuals are refused."""
    found = []
    for capture, net in ((True, Gru()), (False, Gru()), (True, None)):
        cfg = TaskCfg(num_envs=2, seed=5, randomize="none")
        cfg = replace(cfg, capture=capture)
        env = WalkEnv(cfg, residual=LearnedTorque(net, dt=cfg.dt) if net else None)
        for k in range(12):
            env.step(torch.full((2, 12), 0.6 * (-1) ** k))
        found.append(env.q.clone())
    assert torch.equal(found[0], found[1])
    assert not torch.equal(found[0], found[2])
    cfg = TaskCfg(num_envs=1, actuator="mlp", actuator_file="models/mlp.safetensors")
    with pytest.raises(ValueError, match="give no other residual"):
        WalkEnv(cfg, residual=LearnedTorque(Gru(), dt=cfg.dt))


@pytest.mark.gpu
@pytest.mark.parametrize("net", [Gru(), Window()], ids=["carried", "window"])
def test_torch_on_a_gpu_is_torch_on_a_cpu(net: nn.Module) -> None:
    """The captured CUDA graph, with a reset midway: equal to the CPU up to float32 rounding."""
    motion, found = make_motion(5, 90, seed=45), []
    for device in ("cpu", "cuda:0"):
        loop = Loop(5, LearnedTorque(net, dt=DT), device=device)
        torques = loop.run(motion, 0, 40)
        loop.actuator.reset(wp.array([False, True, False, True, False], dtype=wp.bool, device=device))
        found.append(np.concatenate([torques["tau_dyn"], loop.run(motion, 40)["tau_dyn"]]))
    np.testing.assert_allclose(found[1], found[0], rtol=2e-4, atol=2e-4)
