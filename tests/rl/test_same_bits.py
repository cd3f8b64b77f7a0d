"""Same seed, same bits: simulation and training on any number of threads, in any process."""

import ast
import contextlib
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest
import torch
import warp as wp

from mrwarp.env.backend import BackendKind, MjBatchBackend, MjWarpBackend
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.env.sim import Sim, robot_scene
from mrwarp.env.vec_env import WalkEnv
from mrwarp.rl import checkpoint
from mrwarp.rl.train_cfg import RunCfg, TrainCfg
from mrwarp.rl.trainer import Trainer
from mrwarp.runtime import repeating_torch
from tests.rl.test_trainer import assert_same_bits, without_times

ROOT = Path(__file__).parents[2]


@torch.no_grad()
def simulate(*, steps: int, seed: int = 7, **cfg: Any) -> dict[str, Any]:
    """Random actions, randomised robots, noise, kicks, falls, time-outs: all on the way, and the state at the end."""
    env, generator = WalkEnv(TaskCfg(seed=seed, **cfg)), torch.Generator().manual_seed(seed)
    way, ended = [], 0
    for _ in range(steps):
        obs, reward, done, _ = env.step(torch.randn(env.num_envs, env.num_actions, generator=generator))
        way.append(torch.cat([obs["actor"], obs["critic"], reward[:, None], done[:, None].float()], dim=1))
        ended += int(done.sum())
    return {"way": torch.stack(way), "state": env.state(), "ended": ended}


def train(
    out: Path, *, threads: int, torch_threads: int, num_envs: int = 64, updates: int = 2, seed: int = 5
) -> dict[str, Any]:
    """Checkpoint of a short training without its gate check, where torch is left with ``torch_threads``."""
    task = TaskCfg(num_envs=num_envs, threads=threads, seed=seed)
    before = torch.get_num_threads()
    torch.set_num_threads(torch_threads)
    try:
        trainer: Any = Trainer(TrainCfg(task=task, run=RunCfg(out=out, iterations=updates, no_gate=True)))
        trainer._check_gate = lambda _: None
        trainer._finish = lambda: {"rows": trainer.progress.rows}
        with open(os.devnull, "w") as null, contextlib.redirect_stdout(null):
            trainer.run()
        content = checkpoint.load(trainer.save())
    finally:
        torch.set_num_threads(before)
    timed = {name: without_times(content[name]) for name in ("rows", "window")}
    return {name: value for name, value in content.items() if name not in ("seconds", "task")} | timed


def test_simulation_is_the_same_at_1_2_and_3_threads() -> None:
    """24 robots on rough ground, kicks, noise and falls included, on more threads than cores too.

    Another seed gives other bits.
    """
    runs = [simulate(threads=threads, num_envs=24, steps=100, terrain="rough") for threads in (1, 2, 3)]
    for run in runs[1:]:
        assert_same_bits(run, runs[0])
    assert runs[0]["ended"] > 10
    other = simulate(threads=1, num_envs=24, steps=100, terrain="rough", seed=8)
    assert not torch.equal(other["way"], runs[0]["way"])


def test_training_is_the_same_at_any_thread_counts(tmp_path: Path) -> None:
    """64 robots, 2 updates: all of its state and its log, bit by bit; another seed has other networks."""
    runs = [train(tmp_path / f"{a}-{b}", threads=a, torch_threads=b) for a, b in ((1, 1), (3, 2))]
    assert_same_bits(runs[1], runs[0])
    other = train(tmp_path / "other", threads=3, torch_threads=1, seed=6)
    weights = [run["algorithm"]["actor_state_dict"]["mlp.0.weight"] for run in (runs[0], other)]
    assert not torch.equal(*weights)


@pytest.mark.slow
def test_training_of_many_robots_is_the_same_in_any_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """704 robots make sums of more than 32,768 numbers, which torch would split among its threads; other hash seeds."""
    runs = []
    for number, torch_threads in enumerate((1, 3)):
        monkeypatch.setenv("PYTHONHASHSEED", str(number))
        settings: dict[str, Any] = {"threads": 2, "torch_threads": torch_threads, "num_envs": 704, "updates": 1}
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
            runs.append(process.submit(train, tmp_path / str(number), **settings).result())
    assert_same_bits(runs[1], runs[0])


def test_deterministic_reaches_the_engine_that_has_it() -> None:
    """MuJoCo-Warp gets all three of its switches, or none; ``mjbatch`` repeats its bits without."""
    scene = robot_scene()
    for wanted, switches in ((False, 0), (True, 7)):
        sim = Sim(scene, SimCfg(num_envs=1, backend=BackendKind.MJWARP, deterministic=wanted))
        assert isinstance(sim.backend, MjWarpBackend)
        assert sim.backend.model.opt.deterministic == switches
    assert isinstance(Sim(scene, SimCfg(num_envs=1, deterministic=True)).backend, MjBatchBackend)
    assert not TaskCfg().deterministic


def test_repeating_torch_is_asked_for_and_given_back() -> None:
    """Inside, torch takes algorithms that repeat; afterwards all is as before."""
    with repeating_torch(True):
        assert torch.are_deterministic_algorithms_enabled()
        with repeating_torch(False):
            assert torch.are_deterministic_algorithms_enabled()
    assert not torch.are_deterministic_algorithms_enabled()


@pytest.mark.slow
def test_deterministic_kernels_compile_for_a_gpu(tmp_path: Path) -> None:
    """The kernels that MuJoCo-Warp makes for ``deterministic`` compile to PTX with the pinned Warp; no GPU is needed.

    22 of them, each with Warp's scatter, sort and reduce in the place of an atomic sum.
    """
    from warp._src.context import user_modules

    sim = Sim(robot_scene(), SimCfg(num_envs=2, backend=BackendKind.MJWARP, deterministic=True, capture=False))
    torques = wp.zeros((2, len(sim.scene.actuators)), dtype=float, device="cpu")
    sim.step(torques, torques)
    modules = [
        m for m in set(user_modules.values()) if m.options.get("deterministic") == wp.DeterministicMode.RUN_TO_RUN
    ]
    assert len(modules) > 10
    for module in modules:
        wp.compile_aot_module(module, arch=80, module_dir=tmp_path, use_ptx=True)
    assert len(list(tmp_path.glob("*.ptx"))) == len(modules)
    assert any("det_scatter" in source.read_text() for source in tmp_path.glob("*.cu"))


@pytest.mark.gpu
@pytest.mark.xfail(strict=True, reason="MuJoCo-Warp 3.17 does not order constraint rows (constraint._sort_constraints)")
def test_deterministic_repeats_on_a_gpu() -> None:
    """Two runs of 64 robots with ``deterministic`` on the GPU would leave the same bits: see docs/determinism.md."""
    states = []
    for _ in range(2):
        sim = Sim(robot_scene(), SimCfg(num_envs=64, device="cuda:0", deterministic=True))
        torques = wp.zeros((64, len(sim.scene.actuators)), dtype=float, device="cuda:0")
        for _ in range(200):
            sim.step(torques, torques)
        states.append([sim.backend.field(name).numpy() for name in ("qpos", "qvel", "qacc")])
    assert all((a == b).all() for a, b in zip(*states, strict=True))


def test_kernels_sum_nothing_atomically() -> None:
    """Each cell of our kernels is written by one thread: on a GPU their bits do not depend on the order of threads.

    The one atomic counts open windows; each window's torque is its own cell, at any place in the list.
    """
    found = []
    for path in sorted((ROOT / "mrwarp").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "atomic_" in text else ():
            is_sum = isinstance(node, ast.Attribute) and node.attr.startswith("atomic_")
            found += [str(path.relative_to(ROOT))] if is_sum else []
    assert found == ["mrwarp/kernels/learned_torque.py"]
