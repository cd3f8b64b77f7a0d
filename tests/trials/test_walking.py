"""Walking gate: stride frequency, verdicts at their limits, the gate on a robot that stands, repeatable figures."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from mrwarp.env.cfg import TaskCfg
from mrwarp.resources import DEFAULT_POLICY, POLICIES
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.rl.task_record import task_of
from mrwarp.trials.walking import GateCheck, WalkingGate, make_env, measure, stride_frequency

DT = 0.02
SMALL = WalkingGate(num_envs=8, warmup=0.5, seconds=3.0)


def zero_policy(obs: TensorDict) -> torch.Tensor:
    """The robot stands in its neutral stance."""
    return torch.zeros(len(obs["actor"]), 12)


def trotting_policy(obs: TensorDict) -> torch.Tensor:
    """An open-loop trot: legs bend in turn with the gait clock that the policy sees."""
    sin = obs["actor"][:, 45:46]
    bend = torch.cat([-sin, sin, sin, -sin], dim=1).clamp(min=0.0)  # FL and RR swing in the clock's second half
    action = torch.zeros(len(sin), 12)
    action[:, 1::3], action[:, 2::3] = 2.0 * bend, -4.0 * bend
    return action


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mr_go_walk", "mr_go_rough"])
def test_shipped_policies_keep_the_rules_of_a_good_gait(name: str) -> None:
    """On flat ground, with the step and the devices of their training."""
    policy = OnnxPolicy(POLICIES / f"{name}.onnx")
    result = GateCheck(replace(task_of(policy.description["task"]), terrain=None))(lambda obs: policy(obs["actor"]))
    assert result["passed"] and result["rules_not_kept"] == []


@pytest.mark.gpu
def test_the_shipped_policy_walks_on_a_gpu() -> None:
    """Trained on the CPU's engine, it meets the whole walking gate on a GPU's."""
    cfg = TaskCfg(num_envs=64, device="cuda:0")
    result = GateCheck(cfg)(OnnxPolicy(DEFAULT_POLICY))
    assert result["passed"], result["conditions"]


def trot_contact(frequency: float, seconds: float, *, duty: float = 0.5, num_envs: int = 6) -> np.ndarray:
    """Contact of four feet in a trot, environments at different phases, bool, shape (T, E, 4)."""
    time = np.arange(round(seconds / DT)) * DT
    start = np.linspace(0.0, 1.0, num_envs, endpoint=False)
    phase = frequency * time[:, None, None] + start[None, :, None] + np.array([0.0, 0.5, 0.5, 0.0])
    return phase % 1.0 < duty


@pytest.mark.parametrize("duty", [0.35, 0.5, 0.7])
@pytest.mark.parametrize("frequency", [0.9, 1.5, 1.6, 2.2])
def test_stride_frequency_of_a_synthetic_trot(frequency: float, duty: float) -> None:
    """20 s resolve 0.05 Hz: the strongest line of a square wave at any duty is its fundamental."""
    assert stride_frequency(trot_contact(frequency, 20.0, duty=duty), DT) == pytest.approx(frequency, abs=0.025)


def test_stride_frequency_survives_chattering_feet() -> None:
    """One contact sample in ten flipped at random does not move the line of a 1.5 Hz trot."""
    contact = trot_contact(1.5, 20.0)
    flips = np.random.default_rng(0).uniform(size=contact.shape) < 0.1
    assert stride_frequency(contact ^ flips, DT) == pytest.approx(1.5, abs=1e-9)


def test_stride_frequency_of_feet_that_never_move_is_zero() -> None:
    """A robot that stands has no stride: 0 Hz, far from the gate."""
    assert stride_frequency(np.ones((1000, 4, 4), dtype=bool), DT) == 0.0


def measured(**changes: Any) -> dict[str, Any]:
    """Figures of a robot that passes the gate."""
    figures = {
        "never_fell": 1.0,
        "v_x_rmse": {"0.3": 0.2, "0.5": 0.05},
        "height": 0.325,
        "stride_frequency": 1.5,
        "clock_match": 0.9,
    }
    return {**figures, **changes}


GATE = WalkingGate()
EPS = 1e-9
LIMITS = {
    "never_fell": [(GATE.never_fell, True), (GATE.never_fell - EPS, False)],
    "v_x_rmse": [({"0.5": GATE.rmse}, True), ({"0.5": GATE.rmse + EPS}, False)],
    "height": [
        (GATE.height[0], True), (GATE.height[0] - EPS, False), (GATE.height[1], True), (GATE.height[1] + EPS, False),
    ],
    "stride_frequency": [(1.41, True), (1.39, False), (1.59, True), (1.61, False), (0.0, False)],
    "clock_match": [(GATE.clock_match, True), (GATE.clock_match - EPS, False)],
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "value", "holds"), [(name, value, holds) for name, pairs in LIMITS.items() for value, holds in pairs]
)
def test_judge_flips_each_condition_at_its_limit(name: str, value: Any, holds: bool) -> None:
    """A figure at its limit holds, just beyond it does not, and the other four conditions do not care."""
    condition = {"v_x_rmse": "rmse", "stride_frequency": "frequency"}.get(name, name)
    verdicts = GATE.judge(measured(**{name: value}))
    assert verdicts == {**GATE.judge(measured()), condition: holds}
    assert all(GATE.judge(measured()).values()) and len(verdicts) == 5


@pytest.mark.parametrize("name", LIMITS)
def test_judge_refuses_a_figure_that_is_no_number(name: str) -> None:
    """NaN never passes: a diverged policy cannot meet the gate."""
    value = {"v_x_rmse": {"0.5": math.nan}}.get(name, math.nan)
    assert sum(GATE.judge(measured(**{name: value})).values()) == 4


def test_gate_limits_are_those_of_the_paper() -> None:
    """The limits are the task's acceptance: they do not drift with the training."""
    assert (GATE.num_envs, GATE.speeds, GATE.rmse_at, GATE.rmse) == (64, (0.3, 0.5), 0.5, 0.107)
    assert (GATE.never_fell, GATE.height, GATE.clock_match) == (0.95, (0.30, 0.35), 0.80)
    assert (GATE.frequency, GATE.frequency_tolerance, GATE.seconds) == (1.5, 0.1, 20.0)


def test_gate_env_is_the_nominal_task() -> None:
    """Evaluation has no noise, randomisation or time limit, and both speeds in each of the four current groups."""
    check = GateCheck(TaskCfg(num_envs=4, seed=9))
    env = check.env
    assert env.cfg.noise is None and env.cfg.randomize is None and env.num_envs == 64
    assert env.max_episode_length * env.cfg.step_dt > 1e5
    rows = torch.stack([check.command[:, 0], env.current_e], dim=1).tolist()
    pairs = [(round(speed, 3), amps) for speed, amps in rows]
    assert {pair: pairs.count(pair) for pair in pairs} == {
        (speed, amps): 8 for speed in (0.3, 0.5) for amps in (0.0, 0.5, 1.0, 1.5)
    }
    assert not bool(check.command[:, 1:].any())


@pytest.fixture(scope="module")
def standing() -> tuple[GateCheck, dict[str, Any]]:
    """A small gate and its verdict on a robot that stands still."""
    check = GateCheck(TaskCfg(num_envs=4), gate=SMALL)
    return check, check(zero_policy)


def test_gate_fails_a_robot_that_stands(standing: tuple[GateCheck, dict[str, Any]]) -> None:
    """It never falls, but does not follow the speed, has no stride and matches the clock half of the time."""
    found = standing[1]
    assert found["passed"] is False
    verdicts = {**found["conditions"]}
    del verdicts["height"]  # the neutral stance sinks to about the lower limit
    assert verdicts == {"never_fell": True, "rmse": False, "frequency": False, "clock_match": False}
    assert found["never_fell"] == 1.0
    for speed in (0.3, 0.5):
        # it sways by less than 3 cm/s
        assert found["v_x_rmse"][f"{speed:g}"] == pytest.approx(speed, abs=0.03)
        assert found["v_x_bias"][f"{speed:g}"] == pytest.approx(-speed, abs=0.03)
    mixed = (0.5 * (0.3**2 + 0.5**2)) ** 0.5
    assert {name: pytest.approx(value, abs=0.03) for name, value in found["v_x_rmse_by_current"].items()} == {
        "0": mixed,
        "0.5": mixed,
        "1": mixed,
        "1.5": mixed,
    }
    assert found["clock_match"] == pytest.approx(0.5, abs=0.02)  # four feet down, two wanted
    assert found["work_mr"] < 0.0 and found["injected"] <= 1e-6 * abs(found["work_mr"])  # devices only dissipate
    assert found["unsolved_steps"] <= 1e-3 * 8 * 175 * 4  # a few solves of a resting contact stop at the iteration cap


def test_gate_measures_the_same_figures_twice(standing: tuple[GateCheck, dict[str, Any]]) -> None:
    """The gate's batch is used again and again in a training: every check starts from the same state, to the bit."""
    check, first = standing
    trot = check(trotting_policy)
    assert trot != first
    assert check(zero_policy) == first
    assert check(trotting_policy) == trot
    other = GateCheck(TaskCfg(num_envs=4, seed=5), gate=SMALL)
    assert other(trotting_policy) == trot  # the training's seed and batch size do not matter


def test_gate_depends_on_its_seed() -> None:
    """Other initial poses give other figures."""
    gate = replace(SMALL, warmup=0.0, seconds=0.5)
    first, other = (GateCheck(TaskCfg(num_envs=4), gate=gate, seed=seed)(zero_policy) for seed in (1, 2))
    assert first["height"] != other["height"]


def test_open_loop_trot_shows_the_clocks_frequency(standing: tuple[GateCheck, dict[str, Any]]) -> None:
    """Legs that bend with the gait clock are measured at 1.5 Hz and match the clock more often than a stance does."""
    found = standing[0](trotting_policy)
    assert found["stride_frequency"] == pytest.approx(1.5, abs=0.17)  # 3 s resolve 0.33 Hz
    assert found["clock_match"] > standing[1]["clock_match"] + 0.1


def rollout(cfg: TaskCfg, policy: Callable[[TensorDict], torch.Tensor]) -> dict[str, Any]:
    """An independent measurement: 0.2 s of warm-up, 1 s measured, in NumPy."""
    env = make_env(cfg, 8, 3)
    env.set_command(torch.tensor([0.5, 0.0, 0.0]))
    obs, rows = env.get_observations(), []
    for _ in range(60):
        obs = env.step(policy(obs))[0]
        assert not bool(env.fallen.any())
        w, x, y, z = env.root_quat.double().numpy().T
        forward = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z)], axis=1)
        forward /= np.linalg.norm(forward, axis=1, keepdims=True)
        v_x = (env.root_vel.double().numpy()[:, :2] * forward).sum(1)
        rows.append((v_x, env.root_pos[:, 2].double().numpy(), env.f_foot.numpy() > 5.0, env.phase.numpy().copy()))
    v_x, height, contact, phase = (np.array([row[k] for row in rows[10:]]) for k in range(4))
    stance = (phase[:, :, None] + np.array([0.0, 0.5, 0.5, 0.0])) % 1.0 < 0.5
    return {
        "rmse": np.sqrt(((v_x - 0.5) ** 2).mean()),
        "height": height.mean(),
        "clock_match": (contact == stance).mean(),
    }


def test_measure_equals_an_independent_rollout() -> None:
    """Error, height and clock match are those of a plain loop over the same steps, up to float32 means (1e-5)."""
    cfg = TaskCfg(num_envs=4)
    command = torch.tensor([0.5, 0.0, 0.0]).repeat(8, 1)
    found = measure(make_env(cfg, 8, 3), trotting_policy, command, warmup=0.2, seconds=1.0)
    expected = rollout(cfg, trotting_policy)
    assert found["v_x_rmse"] == {"0.5": pytest.approx(expected["rmse"], rel=1e-5)}
    assert found["height"] == pytest.approx(expected["height"], rel=1e-5)
    # a foot whose phase is exactly at a switch may differ by rounding: one of 1600 samples
    assert found["clock_match"] == pytest.approx(expected["clock_match"], abs=1.1 / 1600)
    assert found["duration"] == 1.0 and found["num_envs"] == 8


def test_measure_counts_a_fall_once() -> None:
    """A policy that folds the legs falls in every environment: none of them never fell, also during the warm-up."""
    folded = torch.zeros(12)
    folded[1::3], folded[2::3] = 8.0, -5.0
    env = make_env(TaskCfg(num_envs=4), 4, 0)
    command = torch.tensor([0.3, 0.0, 0.0]).repeat(4, 1)
    script = iter([folded] * 40 + [torch.zeros(12)] * 70)
    found = measure(env, lambda _: next(script).expand(4, 12), command, warmup=2.0, seconds=0.2)
    assert found["never_fell"] == 0.0
    assert not bool(env.fallen.any()) and bool((env.root_pos[:, 2] > 0.2).all())  # they stand again


def test_measure_tells_the_reward_per_second() -> None:
    """The mean over the measured steps and robots, without those of the warm-up."""
    envs = [make_env(TaskCfg(num_envs=2), 2, 0) for _ in range(2)]
    command = torch.tensor([0.3, 0.0, 0.0]).repeat(2, 1)
    found = measure(envs[0], zero_policy, command, warmup=0.1, seconds=0.2)
    envs[1].set_command(command)
    rewards = []
    for _ in range(15):
        rewards.append(envs[1].step(torch.zeros(2, 12))[1].clone())
        envs[1].set_command(command)
    assert found["reward"] == pytest.approx(float(torch.stack(rewards[5:]).mean()) / 0.02, rel=1e-6)
    assert found["reward"] != pytest.approx(float(torch.stack(rewards).mean()) / 0.02, rel=1e-3)


def test_measure_of_a_robot_without_devices() -> None:
    """``go1`` is measured with closed gates and no work of devices."""
    env = make_env(TaskCfg(num_envs=4, robot="go1"), 4, 0)
    found = measure(env, zero_policy, torch.tensor([0.3, 0.0, 0.0]).repeat(4, 1), warmup=0.1, seconds=0.2)
    assert (found["hold_share"], found["dynamic_share"], found["work_mr"], found["injected"]) == (0.0, 0.0, 0.0, 0.0)
