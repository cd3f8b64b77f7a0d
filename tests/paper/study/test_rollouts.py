"""Rollouts: figures against NumPy, independence of the company, and what a fall leaves."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from mrwarp.env.cfg import TaskCfg
from mrwarp.resources import policy_file
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy, PolicyError
from mrwarp.trials.power_meter import MotionMeter
from paper.study.plan import CONVENTIONAL, STUDY
from paper.study.rollouts import METRICS, STEPS, EvaluationCfg, causes, evaluate, roll_out, step_plant

ROUNDING = 4.0 * float(np.finfo(np.float32).eps)
"""Of numbers of order one [m, m/s, rad, rad/s]: their own, and half of one each of two operations and a target."""

PLANT = TaskCfg()
CFG = EvaluationCfg(rollouts=2, warmup=0.1, seconds=0.4, seed=5)


@pytest.fixture(scope="module")
def policy() -> OnnxPolicy:
    """The shipped policy."""
    return OnnxPolicy(DEFAULT_POLICY)


def still(obs: TensorDict) -> torch.Tensor:
    """A policy that stands."""
    return torch.zeros(obs.batch_size[0], 12)


def jump(obs: TensorDict) -> torch.Tensor:
    """A policy that throws the robot over."""
    return torch.full((obs.batch_size[0], 12), 12.0) * torch.tensor([1.0, -1.0, 1.0] * 4)


def test_figures_equal_those_of_the_recorded_states(policy: OnnxPolicy, monkeypatch: pytest.MonkeyPatch) -> None:
    """RMSE, bias, height, tilt and yaw rate of 20 steps, from the states that the rollout went through.

    States are float32, squares and angles of them round as much: by size of what is subtracted, not of what is left.
    """
    seen: list[dict[str, np.ndarray]] = []
    original = MotionMeter.add

    def spy(meter: MotionMeter, counted: torch.Tensor) -> None:
        env = meter._env
        up = -env.gravity.double().numpy()
        state = {"v": env.body_velocity, "z": env.root_pos[:, 2:], "yaw": env.root_ang[:, 2:]}
        seen.append({"up": up, **{name: value.double().numpy().copy() for name, value in state.items()}})
        original(meter, counted)

    monkeypatch.setattr(MotionMeter, "add", spy)
    found = roll_out(CFG, PLANT, [policy], [1.5])
    assert len(seen) == 20
    v, z, yaw, up = (np.stack([state[name] for state in seen]) for name in ("v", "z", "yaw", "up"))
    roll, pitch = np.arctan2(up[..., 1], up[..., 2]), np.arcsin(-up[..., 0])
    expected = {
        "v_x_rmse": np.sqrt(((v[..., 0] - 0.5) ** 2).mean(0)),
        "v_x_bias": (v[..., 0] - 0.5).mean(0),
        "height": z[..., 0].mean(0),
        "height_rmse": np.sqrt(((z[..., 0] - PLANT.rewards.target_height) ** 2).mean(0)),
        "tilt_rms": np.degrees(np.sqrt((roll**2 + pitch**2).mean(0))),
        "yaw_rate_rmse": np.sqrt((yaw[..., 0] ** 2).mean(0)),
    }
    assert set(expected) == set(METRICS)
    for name, value in expected.items():
        size = np.degrees(1.0) if name == "tilt_rms" else 1.0
        np.testing.assert_allclose(found.figures[name][0], value, rtol=0, atol=ROUNDING * size, err_msg=name)
    assert not found.fell.any()


def test_figures_do_not_depend_on_the_company(policy: OnnxPolicy) -> None:
    """A policy alone and next to others, and two copies of it: the same bits."""
    alone = roll_out(CFG, PLANT, [policy], [1.5])
    together = roll_out(CFG, PLANT, [still, policy, policy], [0.0, 1.5, 1.5])
    for name in METRICS:
        np.testing.assert_array_equal(together.figures[name][1], alone.figures[name][0], err_msg=name)
        np.testing.assert_array_equal(together.figures[name][2], alone.figures[name][0], err_msg=name)
    assert (np.abs(together.figures["v_x_bias"][0]) > 0.3).all()  # it stands


def test_rollout_that_falls_says_so_and_counts_up_to_there() -> None:
    """Within 2 s; its figures stay finite, and those of the other policy too."""
    cfg = replace(CFG, warmup=0.0, seconds=2.0)
    found = roll_out(cfg, PLANT, [jump, still], [0.0, 0.0])
    assert found.fell[0].all() and not found.fell[1].any()
    for name in METRICS:
        assert np.isfinite(found.figures[name]).all(), name


def test_every_step_changes_one_thing() -> None:
    """Robot, then devices, then current with one branch or both."""
    cfgs = {step: step_plant(step, EvaluationCfg()) for step in STEPS}
    assert [cfg.robot for cfg, _ in cfgs.values()] == ["go1"] + ["mr_go"] * 5
    assert [cfg.actuator for cfg, _ in cfgs.values()] == ["none"] * 2 + ["bouc_wen"] * 4
    assert [current for _, current in cfgs.values()] == [0.0, 0.0, 0.0, 1.5, 1.5, 1.5]
    branches = [(cfg.damping, cfg.holding) for cfg, _ in list(cfgs.values())[2:]]
    assert branches == [(True, True), (True, False), (False, True), (True, True)]


@pytest.mark.slow
def test_first_and_last_plant_of_mr_go_are_those_of_table_2(tmp_path: Path) -> None:
    """Devices at 0 A and at 1.5 A with both branches: the figures of ``evaluate``.

    A figure is a mean over 15 control steps in 32 bits: in another order of the sum it is off by 15 roundings of 6e-8,
    relative to the largest of the summed numbers, about 1.
    """
    shutil.copyfile(DEFAULT_POLICY, policy_file(tmp_path, CONVENTIONAL, 0))
    cfg = EvaluationCfg(folder=tmp_path, seeds=(0,), rollouts=2, plant="bouc_wen", warmup=0.0, seconds=0.3)
    rows = causes(cfg, [CONVENTIONAL])[CONVENTIONAL]
    assert list(rows) == list(STEPS)
    off, on = evaluate(cfg, [(CONVENTIONAL, 0.0), (CONVENTIONAL, 1.5)])
    for step, row in (("drag", off), ("both", on)):
        for metric, values in row.rollouts.items():
            found, roundings = rows[step].rollouts[metric], 15 * 6e-8
            np.testing.assert_allclose(found, values, rtol=1e-6, atol=roundings, err_msg=f"{step} {metric}")
    assert not np.array_equal(rows["go1"].rollouts["v_x_rmse"], off.rollouts["v_x_rmse"])


def test_missing_policy_is_named(tmp_path: Path) -> None:
    """The file that is not there; conventional policies, whose robot has no devices, are the study's."""
    cfg = EvaluationCfg(folder=tmp_path, seeds=(7,), warmup=0.0, seconds=0.1)
    for plant, folder in (("pg_rlstm", tmp_path), (CONVENTIONAL, STUDY)):
        with pytest.raises(PolicyError, match=rf"{folder}/{plant}_seed7\.onnx: no such policy"):
            evaluate(cfg, [(plant, 0.0)])
