"""Same seed, same bits: the short version of ``benchmarks.determinism``."""

import ast
import math
from pathlib import Path

import pytest
import torch
import warp as wp

from benchmarks import determinism
from benchmarks.determinism import differing, in_processes, simulate, train
from mrwarp.env.backend import BackendKind, MjBatchBackend, MjWarpBackend
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.env.sim import Sim, robot_scene
from mrwarp.runtime import repeating_torch

ROOT = Path(__file__).parents[2]


def test_simulation_is_the_same_at_1_2_and_3_threads() -> None:
    """24 robots, kicks, noise and falls included, on more threads than cores too; another seed gives other bits."""
    runs = [simulate(threads=threads, num_envs=24, steps=100) for threads in (1, 2, 3)]
    assert differing(runs) == []
    assert int(runs[0]["ended"]) > 10
    other = simulate(threads=1, num_envs=24, steps=100, seed=8)
    assert differing([runs[0], other]) == ["way", "state", "ended"]


def test_training_is_the_same_at_any_thread_counts(tmp_path: Path) -> None:
    """64 robots, 2 updates: networks, optimiser, normalisers, draws, environment and log, bit by bit."""
    runs = [train(tmp_path / f"{a}-{b}", threads=a, torch_threads=b, updates=2) for a, b in ((1, 1), (2, 1), (3, 2))]
    assert differing(runs) == []
    other = train(tmp_path / "other", threads=1, torch_threads=1, updates=2, seed=6)
    assert set(differing([runs[0], other])) == set(runs[0])


@pytest.mark.slow
def test_training_of_many_robots_does_not_depend_on_torch_threads(tmp_path: Path) -> None:
    """704 robots make sums of more than 32,768 numbers, which torch would split among three threads of its own."""
    runs = [train(tmp_path / str(n), threads=2, torch_threads=n, num_envs=704, updates=1) for n in (1, 3)]
    assert differing(runs) == []


def test_torch_does_split_large_sums() -> None:
    """Why the trainer keeps torch on one thread: means over 200,000 numbers have other bits on three, though near.

    One mean may round to the same number by chance, 16 of them do not.
    """
    generator, before, found = torch.Generator().manual_seed(0), torch.get_num_threads(), []
    numbers = [torch.randn(200_000, generator=generator) for _ in range(16)]
    try:
        for threads in (1, 3):
            torch.set_num_threads(threads)
            found.append(torch.stack([row.mean() for row in numbers]))
    finally:
        torch.set_num_threads(before)
    assert not torch.equal(found[0], found[1])
    # a number passes through at most as many roundings as a sum in pairs has levels, of a partial sum below sum |x|
    levels = 2.0 * math.log2(numbers[0].numel()) * torch.finfo(torch.float32).eps
    torch.testing.assert_close(found[0], found[1], rtol=0.0, atol=levels * float(numbers[0].abs().mean()))


@pytest.mark.slow
@pytest.mark.parametrize("name", determinism.SIMULATIONS)
def test_simulation_is_the_same_in_any_process(name: str) -> None:
    """Fresh interpreters with other hash seeds: 64 robots, 200 steps, the learned torque, and MuJoCo-Warp."""
    assert differing(in_processes("simulate", determinism.SIMULATIONS[name])) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", determinism.TRAININGS)
def test_training_is_the_same_in_any_process(name: str) -> None:
    """Fresh interpreters with other hash seeds and thread counts: 64 robots for 4 updates, 704 for one."""
    assert differing(in_processes("train", determinism.TRAININGS[name])) == []


def test_deterministic_changes_no_bit_on_the_cpu() -> None:
    """MuJoCo-Warp's CPU kernels run in order: the option is accepted, set, and gives the bits of a run without it."""
    runs = [
        simulate(threads=1, num_envs=8, steps=20, backend="mjwarp", deterministic=wanted) for wanted in (False, True)
    ]
    assert differing(runs) == []


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
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            is_sum = isinstance(node, ast.Attribute) and node.attr.startswith("atomic_")
            found += [str(path.relative_to(ROOT))] if is_sum else []
    assert found == ["mrwarp/kernels/learned_torque.py"]


def test_cost_times_both() -> None:
    """One positive time each."""
    times = determinism.cost("cpu", num_envs=2, rounds=1, steps=4)
    assert list(times) == ["without", "with"] and min(times.values()) > 0.0
