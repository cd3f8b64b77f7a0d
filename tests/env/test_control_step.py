"""The control step as captured graphs: one on MuJoCo-Warp, no number read back, the bits of eager launches."""

from dataclasses import replace
from typing import Any

import pytest
import torch
import warp as wp

from mrwarp.enums import LstmState
from mrwarp.env import events, observations, rewards, sim
from mrwarp.env.backend import BackendKind
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.mdp_cfg import RandomizeCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.kernels.launch import Launch, record

MJBATCH, MJWARP = BackendKind


def make_cfg(
    backend: BackendKind, *, capture: bool = True, threads: int = 1, terrain: str = "flat", **changes: Any
) -> TaskCfg:
    """The training task with short episodes, many kicks and a new command every 0.1 s."""
    cfg = TaskCfg(num_envs=6, seed=3, backend=backend, threads=threads, terrain=terrain)
    often = replace(cfg.commands, period=0.1)
    shaken = RandomizeCfg(push_speed=1.0, push_interval=0.1)
    return replace(cfg, capture=capture, episode_seconds=0.3, commands=often, randomize=shaken, **changes)


def walk(env: WalkEnv, steps: int) -> tuple[torch.Tensor, dict[str, int]]:
    """Everything that strong random actions make the steps return, shape (steps, 6, D), and how episodes ended."""
    generator, rows = torch.Generator().manual_seed(1), []
    ends = {"falls": 0, "time_outs": 0}
    for step in range(steps):
        if step % 20 == 7:  # lay one on its back: falls of their own take longer than these episodes
            env.view(env.sim.backend.field("qpos"))[step % 6, 3:7] = env.root_quat.new_tensor([0, 1, 0, 0]).double()
        obs, reward, done, extras = env.step(3.0 * (2.0 * torch.rand(6, 12, generator=generator) - 1.0))
        flags = torch.stack([reward, done, extras["time_outs"], env.fallen, env.diverged], dim=1)
        rows.append(torch.cat([obs["actor"], obs["critic"], flags], dim=1))
        ends["falls"] += int(env.fallen.sum())
        ends["time_outs"] += int(extras["time_outs"].sum())
    return torch.stack(rows), ends


def assert_same(first: WalkEnv, second: WalkEnv, steps: int) -> None:
    """Two environments walk identically to the bit, with falls and time-outs, and end in the same state."""
    (ours, ends), (theirs, _) = walk(first, steps), walk(second, steps)
    assert ends["falls"] > 0 and ends["time_outs"] > 0
    assert torch.equal(ours, theirs)
    left, right = first.state(), second.state()
    assert all(torch.equal(left[name], right[name]) for name in left)


@pytest.mark.parametrize(("backend", "terrain"), [(MJBATCH, "rough"), (MJWARP, "flat")])
def test_graphs_give_the_bits_of_eager_launches(backend: BackendKind, terrain: str) -> None:
    """20 policy steps with kicks, new commands, falls and time-outs, on both engines and grounds in turn."""
    graphs, eager = (WalkEnv(make_cfg(backend, capture=capture, terrain=terrain)) for capture in (True, False))
    assert_same(graphs, eager, 20)


@pytest.mark.slow
def test_sixty_steps_on_mujoco_warp_with_resets() -> None:
    """One graph, replayed 60 times, on rough ground."""
    graphs, eager = (WalkEnv(make_cfg(MJWARP, capture=capture, terrain="rough")) for capture in (True, False))
    assert_same(graphs, eager, 60)


@pytest.mark.slow
def test_a_learned_residual_is_part_of_the_graph() -> None:
    """PG-RLSTM on MuJoCo-Warp: the same bits eager and captured, and one graph."""
    learned = {"actuator": "pg_rlstm"}
    graphs, eager = (WalkEnv(make_cfg(MJWARP, capture=capture, **learned)) for capture in (True, False))
    assert_same(graphs, eager, 40)


def test_a_thread_per_environment_gives_the_bits_of_one_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernels that a CPU launches as one thread, launched as on a GPU; on rough ground, with resets."""
    one_for_all = WalkEnv(make_cfg(MJBATCH, terrain="rough"))

    def a_thread_each(kernel: Any, num_envs: int, inputs: list[Any], outputs: list[Any]) -> Launch:
        return record(kernel, num_envs, [num_envs, *inputs], outputs)

    for module in (events, observations, rewards, sim):
        monkeypatch.setattr(module, "record_per_env", a_thread_each)
    assert_same(WalkEnv(make_cfg(MJBATCH, terrain="rough")), one_for_all, 20)


@pytest.mark.parametrize("backend", list(BackendKind))
def test_a_fall_changes_nothing_of_the_other_robots(backend: BackendKind) -> None:
    """One robot falls or not: noise, kicks, commands, devices and later starts of the others keep every bit."""
    env, twin = (WalkEnv(make_cfg(backend)) for _ in range(2))
    others = torch.arange(6) != 2
    for step in range(20):  # the 15th ends all other episodes
        if step == 4:
            env.view(env.sim.backend.field("qpos"))[2, 3:7] = env.root_quat.new_tensor([0, 1, 0, 0]).double()
        action = torch.full((6, 12), 0.5)
        ours, theirs = env.step(action), twin.step(action)
        assert ours[2].tolist() == [step in ((4, 19) if robot == 2 else (14,)) for robot in range(6)]
        assert theirs[2].tolist() == [step == 14] * 6
        for group in ("actor", "critic"):
            assert torch.equal(ours[0][group][others], theirs[0][group][others])
        assert torch.equal(ours[1][others], theirs[1][others])


def read_back(*_: Any, **__: Any) -> None:
    """In the place of what the host must not do in a step."""
    raise AssertionError("the host read a number, or launched a kernel by itself, within a step")


def test_a_step_on_mujoco_warp_is_one_graph_and_reads_nothing_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither while it is captured nor later does the host look at a number, for any end of an episode in the step."""
    env, done = WalkEnv(make_cfg(MJWARP)), []
    with monkeypatch.context() as patched:
        for owner, name in ((wp.array, "numpy"), (torch.Tensor, "__bool__"), (torch.Tensor, "item")):
            patched.setattr(owner, name, read_back)
        env.step(torch.zeros(6, 12))
        for name in ("launch", "copy", "synchronize"):
            patched.setattr(wp, name, read_back)
        patched.setattr(wp.Launch, "launch", read_back)
        for _ in range(31):
            done.append(env.step(torch.zeros(6, 12))[2])
    assert int(torch.stack(done).sum()) == 2 * 6
    assert len(env.step_graph.calls(env.robot.on_host())) == 1


@pytest.mark.parametrize("learned", [False, True])
def test_a_step_on_mjbatch_is_a_graph_before_between_and_after_its_physics(learned: bool) -> None:
    """Graphs before, between and after four steps of the engine, and around a learned torque that uses threads."""
    # whole windows at every step are so much work that a second thread helps
    model = {"actuator": "pg_rlstm", "lstm_state": LstmState.WINDOW} if learned else {}
    env = WalkEnv(make_cfg(MJBATCH, threads=2, **model))
    env.step(torch.zeros(6, 12))
    host = [*([env.actuator.add_residual] if learned else []), env.sim.engine]
    calls = env.step_graph.calls(env.robot.on_host())
    graphs = [call for call in calls if call not in host]
    assert (len(graphs), len(set(map(id, graphs)))) == ((9, 4) if learned else (5, 3))
    assert [call for call in calls if call in host] == host * 4
