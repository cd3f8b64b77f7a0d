"""When an episode ends: falls by height, tilt or broken state, and the time limit."""

import math
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from mrwarp.env import terminations
from mrwarp.env.cfg import EnvCfg

NAN, INF = float("nan"), float("inf")


def make_state(num_envs: int = 4) -> Any:
    """Robots that stand upright at 0.32 m, at rest."""
    return SimpleNamespace(
        cfg=EnvCfg(),
        root_pos=torch.tensor([0.0, 0.0, 0.32]).repeat(num_envs, 1),
        gravity=torch.tensor([0.0, 0.0, -1.0]).repeat(num_envs, 1),
        height=torch.full((num_envs,), 0.32),
        root_vel=torch.zeros(num_envs, 3),
        root_ang=torch.zeros(num_envs, 3),
        q=torch.zeros(num_envs, 12),
        qd=torch.zeros(num_envs, 12),
        episode_length_buf=torch.zeros(num_envs, dtype=torch.long),
        max_episode_length=10,
    )


def step(
    state: Any, broken: tuple[int, ...] = (), rewards: torch.Tensor | None = None
) -> tuple[terminations.Terminations, list[list[bool]]]:
    """One policy step, with a reward of 1 unless others are given: fallen, broken, time-out, done of each robot."""
    count = len(state.height)
    state.height.copy_(state.root_pos[:, 2])
    wrong = torch.tensor([int(env in broken) for env in range(count)], dtype=torch.int32)
    found = terminations.Terminations(state, wrong, torch.ones(count) if rewards is None else rewards)
    found.launch.launch()
    return found, [flag.tolist() for flag in found.flags()]


def fallen_now(state: Any) -> torch.Tensor:
    """Which robots of a state have fallen, bool, shape (E,)."""
    found, _ = step(state)
    return found.flags()[0]


def test_upright_robots_have_not_fallen() -> None:
    """The neutral state ends no episode; the answer is bool of shape (E,)."""
    fallen = fallen_now(make_state())
    assert fallen.dtype == torch.bool and fallen.tolist() == [False] * 4


def test_fallen_by_height_at_the_limit() -> None:
    """Just above the limit stands, at and below it has fallen."""
    state = make_state()
    limit = state.cfg.fall_height
    state.root_pos[:, 2] = torch.tensor([limit + 1e-3, limit, limit - 1e-3, -0.5])
    assert fallen_now(state).tolist() == [False, True, True, True]


def test_fallen_by_tilt_at_the_limit() -> None:
    """Leaning by less than the limit stands, by more has fallen, also upside down; the direction does not matter."""
    state = make_state(5)
    limit = state.cfg.fall_tilt
    for env, (tilt, heading) in enumerate([(limit - 0.01, 0), (limit + 0.01, 0), (limit + 0.01, 2), (3.1, 1), (0, 0)]):
        horizontal = math.sin(tilt)
        direction = [horizontal * math.cos(heading), horizontal * math.sin(heading), -math.cos(tilt)]
        state.gravity[env] = torch.tensor(direction)
    assert fallen_now(state).tolist() == [False, True, True, True, False]


@pytest.mark.parametrize("value", [NAN, INF, -INF])
@pytest.mark.parametrize("name", ["root_pos", "gravity", "root_vel", "root_ang", "q", "qd"])
def test_a_state_that_is_no_number_counts_as_fallen(name: str, value: float) -> None:
    """NaN or infinity in the pose, a velocity or a joint of one environment ends that one and no other."""
    state = make_state()
    getattr(state, name)[2, 2] = -value  # infinitely high is as broken as infinitely low
    getattr(state, name)[1, 2] = value
    fallen = fallen_now(state).tolist()
    assert (fallen[0], fallen[3]) == (False, False)
    assert (fallen[1], fallen[2]) == (True, True)


def test_timed_out_at_the_episodes_length() -> None:
    """The episode is over at its last step, not before; the step is counted."""
    state = make_state()
    state.episode_length_buf = torch.tensor([0, 8, 9, 10])
    found, (fallen, broken, time_out, done) = step(state)
    assert state.episode_length_buf.tolist() == [1, 9, 10, 11]
    assert time_out == done == [False, False, True, True]
    assert fallen == broken == [False] * 4


def test_a_fall_is_no_time_out() -> None:
    """Where both come in the same step, the episode is not bootstrapped."""
    state = make_state()
    state.episode_length_buf[:] = 9
    state.root_pos[1, 2] = 0.0
    _, (fallen, _, time_out, done) = step(state)
    assert fallen == [False, True, False, False] and time_out == [True, False, True, True] and done == [True] * 4


def test_a_wrong_number_is_a_fall_without_reward() -> None:
    """The others keep theirs."""
    found, (fallen, broken, time_out, done) = step(make_state(), broken=(2,))
    assert fallen == broken == done == [False, False, True, False] and time_out == [False] * 4
    assert found.reward().tolist() == [1.0, 1.0, 0.0, 1.0]


def test_a_robot_that_is_thrown_does_not_shake_the_learner() -> None:
    """What a solver's accident costs is bounded; what falls and noise cost reaches the learner as it is."""
    least = terminations.LEAST_REWARD
    rewards = torch.tensor([0.06, 0.9 * least, 1e4 * least, -INF])
    found, _ = step(make_state(), rewards=rewards)
    torch.testing.assert_close(found.reward(), torch.tensor([0.06, 0.9 * least, least, least]), rtol=0.0, atol=0.0)


def test_nothing_ends_a_quiet_step() -> None:
    """The flag that the host reads stays 0."""
    _, flags = step(make_state())
    assert flags == [[False] * 4] * 4
