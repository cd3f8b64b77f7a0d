"""Who commands the coils: the law against eq. 18, the policy's actions, and an environment that has both."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp

from mrwarp.enums import CurrentCommand
from mrwarp.env import commands
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.kernels.mr_joint import JointParams
from mrwarp.params import MrParams
from mrwarp.resources import POLICIES
from mrwarp.rl.policy import OnnxPolicy, PolicyError
from mrwarp.rl.train_cfg import RunCfg, TrainCfg
from mrwarp.rl.trainer import Trainer


@wp.kernel
def law_kernel(
    params: wp.array[JointParams],
    e: wp.array[float],
    qd: wp.array[float],
    strength: wp.array[float],
    scheduled: wp.array[float],
    learned: wp.array[float],
):
    """The law for an error, speed and strength; the policy's current for the error taken as an action."""
    i = wp.tid()
    scheduled[i] = commands.scheduled_current(params[0], e[i], qd[i], strength[i], 1.5)
    learned[i] = commands.learned_current(e[i], 1.5)


def test_the_law_holds_12_times_the_need_of_a_slow_joint_and_gives_all_to_a_fast_one() -> None:
    """Eq. 18 at the law's current is 1.2 times the need of eq. 19, also of a device that has lost a fifth."""
    mr, rng = MrParams(), np.random.default_rng(3)
    values = np.zeros(1, dtype=JointParams.numpy_dtype())  # type: ignore[arg-type]
    for name, value in mr:
        values[name] = value
    e, qd = rng.uniform(-0.5, 0.5, 200), rng.uniform(-0.4, 0.4, 200)
    strength = rng.choice([1.0, 0.8], 200)
    out = [wp.zeros(200, dtype=float, device="cpu") for _ in range(2)]
    inputs = [wp.array(x, dtype=float, device="cpu") for x in (e, qd, strength)]
    wp.launch(law_kernel, 200, [wp.array(values, dtype=JointParams, device="cpu"), *inputs], out, device="cpu")
    scheduled, learned = (x.numpy().astype(float) for x in out)
    slow = abs(qd) < mr.gate.eps_v
    assert (scheduled[~slow] == 1.5).all()
    need = (mr.motor.kp_base - mr.motor.kp_low) * abs(e)
    hold, within = mr.hold, slow & (scheduled < 1.5) & (need > 0.1)
    holds = strength * hold.T_max * scheduled**hold.n / (hold.K**hold.n + scheduled**hold.n)
    assert within.sum() > 50
    np.testing.assert_allclose(holds[within], hold.safety_factor * need[within], rtol=2e-4)
    np.testing.assert_allclose(learned, np.clip(0.5 * (1.0 + e), 0.0, 1.5), rtol=1e-6)


def test_latched_gates_are_commanded_all_that_is_allowed() -> None:
    """I_e of each environment at every device, without further actions."""
    cfg = TaskCfg(num_envs=4, current_by=CurrentCommand.LATCHED, randomize="none")
    env = WalkEnv(replace(cfg, currents=(0.5, 1.0)))
    assert env.num_actions == 12
    env.step(torch.zeros(4, 12))
    assert env.arrays.current_command.tolist() == [[0.5] * 4] * 2 + [[1.0] * 4] * 2


def test_the_policy_commands_what_flows() -> None:
    """16 actions, 51 observations; no current where the policy wants none, its own where a gate is open."""
    env = WalkEnv(TaskCfg(num_envs=6, current_by=CurrentCommand.LEARNED, randomize="none"))
    assert env.num_actions == 16 and env.get_observations()["actor"].shape == (6, 51)
    env.current_e.fill_(1.5)
    actions = torch.zeros(6, 16)
    actions[:3, 12:] = -1.0  # none
    actions[3:, 12:] = torch.tensor([-0.5, 0.0, 0.5, 4.0])
    flowed = torch.zeros(6, 4)
    for _ in range(60):
        env.step(actions)
        flowed = torch.maximum(flowed, env.view(env.actuator.current))
    assert bool((flowed[:3] == 0.0).all())
    torch.testing.assert_close(flowed[3:], torch.tensor([0.25, 0.5, 0.75, 1.5]).expand(3, 4))


def test_without_a_command_nothing_is_launched() -> None:
    """The default has no launch of its own, and the actuator no command to read."""
    env = WalkEnv(TaskCfg(num_envs=2))
    assert env._command_current == [] and env.actuator.inputs.command is None


def test_coil_lag_and_hold_speed_reach_every_device() -> None:
    """Options of the task that the devices carry."""
    env = WalkEnv(TaskCfg(num_envs=2, coil_lag=0.02, hold_speed=0.5, randomize="none"))
    for name, value in (("coil_time_constant", 0.02), ("eps_hold", 0.5)):
        np.testing.assert_allclose(env.actuator.param(name).numpy(), value, rtol=1e-6)


@pytest.mark.usefixtures("short_gate")
def test_a_policy_without_currents_is_a_start_for_one_with(tmp_path: Path) -> None:
    """It begins with the same joint targets and a third of the current; its export runs, and is refused elsewhere."""
    start = POLICIES / "energy" / "mr_go_sal_seed0.onnx"
    env = TaskCfg(num_envs=4, current_by=CurrentCommand.LEARNED)
    trainer = Trainer(TrainCfg(task=env, run=RunCfg(out=tmp_path, iterations=0)), start_from=start)
    obs = trainer.env.get_observations()
    plain = torch.cat([obs["actor"][:, :45], obs["actor"][:, 49:]], dim=1)
    with torch.no_grad():
        actions = trainer.algorithm.get_policy()(obs)
    torch.testing.assert_close(actions[:, :12], OnnxPolicy(start)(plain), rtol=1e-4, atol=1e-4)
    assert bool((actions[:, 12:] == 0.0).all())
    trainer.run()
    policy = OnnxPolicy(tmp_path / "policy.onnx")
    assert (policy.joints, policy.currents) == (12, 4)
    torch.testing.assert_close(policy(obs), actions, rtol=1e-4, atol=1e-4)
    with pytest.raises(PolicyError, match="--current-by learned"):
        policy(torch.zeros(1, 47))
