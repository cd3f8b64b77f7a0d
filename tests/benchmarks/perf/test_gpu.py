"""The figures of a GPU, made on the CPU device: the same engine, graphs and kernels, a few robots."""

import json

import pytest

from benchmarks.perf import gpu
from benchmarks.perf.gpu import GpuCfg, Target
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy


@pytest.fixture(scope="module")
def figures() -> dict:
    """Figures of a run with two robots."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gpu, "AIMED_AT", 2)
        patch.setattr(gpu, "COPIED", 2**22)
        cfg = GpuCfg(device="cpu", num_envs=(2,), rounds=2, steps=2, updates=0)
        return gpu.run_all(cfg, OnnxPolicy(DEFAULT_POLICY), lambda text, share: None)


def test_robots_walk_and_their_rates_follow_from_the_times(figures: dict) -> None:
    """Physics steps per second are robots times torque steps over the robot's time; ratios are of what was timed."""
    found = figures["walking"]["2"]
    assert set(found["checks"]) == set(gpu.VARIANTS)
    assert all(row["falls_per_second"] == 0.0 for row in found["checks"].values())
    median = found["seconds"]["bouc_wen.robot"]["median"]
    assert found["physics_steps_per_second"] == pytest.approx(8 / median)
    ratios = ("explicit/pd @2", "bouc_wen/pd @2", "lstm/pd @2", "env/robot @2", "captured/eager @2")
    assert set(ratios) == set(figures["ratios"])
    assert figures["ratios"]["captured/eager @2"]["median"] < 1.0


def test_the_joints_kernels_are_timed_and_their_bytes_counted(figures: dict) -> None:
    """With the LSTM they take longer; the bytes are those of the arrays, the share of the bandwidth is theirs."""
    found = figures["joint"]["2"]
    assert 0.0 < found["microseconds"]["bouc_wen"]["median"] < found["microseconds"]["lstm"]["median"]
    assert 2 * 4 * (4 * 7 + 12 * 6) < found["bytes_moved"] < 20_000
    spent = 1e-6 * found["microseconds"]["bouc_wen"]["median"]
    assert found["share_of_bandwidth"] * found["copy_bandwidth"] * spent == pytest.approx(found["bytes_moved"])


def test_every_target_that_was_measured_is_judged(figures: dict) -> None:
    """Two robots on a CPU are far below the targets of 4096 on a GPU, but for the ratio."""
    rows = {row["figure"]: row for row in figures["targets"]}
    assert set(rows) == {"physics steps", "bouc_wen/pd", "gates, Bouc-Wen and LSTM"}
    assert not rows["physics steps"]["met"]
    json.dumps(figures)
    assert Target(unit="1/s", limit=2.0, least=True).met(2.1) and not Target(unit="s", limit=2.0, least=False).met(2.1)
