"""When an episode ends: falls by height, tilt or broken state, and the time limit."""

import math
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from mrwarp.env import terminations

NAN, INF = float("nan"), float("inf")
FALL_HEIGHT, FALL_TILT = 0.16, 0.9


def make_state(num_envs: int = 4) -> Any:
    """Robots that stand upright at 0.32 m, at rest, with a reward of 1."""
    return SimpleNamespace(
        root_pos=torch.tensor([0.0, 0.0, 0.32]).repeat(num_envs, 1),
        gravity=torch.tensor([0.0, 0.0, -1.0]).repeat(num_envs, 1),
        height=torch.full((num_envs,), 0.32),
        root_vel=torch.zeros(num_envs, 3),
        root_ang=torch.zeros(num_envs, 3),
        q=torch.zeros(num_envs, 12),
        qd=torch.zeros(num_envs, 12),
        episode_length_buf=torch.zeros(num_envs, dtype=torch.long),
        flags=torch.zeros(4, num_envs, dtype=torch.bool),
        diverged=torch.zeros(num_envs, dtype=torch.int32),
        total=torch.ones(num_envs),
        reward=torch.zeros(num_envs),
    )


def step(state: Any, fall_cost: float = 0.0) -> list[list[bool]]:
    """One policy step of episodes of ten: fallen, diverged, time-out, done of each robot."""
    state.height.copy_(state.root_pos[:, 2])
    terminations.terminate(state, fall_height=FALL_HEIGHT, fall_tilt=FALL_TILT, length=10, fall_cost=fall_cost)()
    assert not state.diverged.any() and not state.total.any()
    return [flag.tolist() for flag in state.flags]


def test_fallen_by_height_at_the_limit() -> None:
    """Just above the limit stands, at and below it has fallen."""
    state = make_state()
    limit = FALL_HEIGHT
    state.root_pos[:, 2] = torch.tensor([limit + 1e-3, limit, limit - 1e-3, -0.5])
    assert step(state)[0] == [False, True, True, True]


def test_a_fall_costs_once() -> None:
    """It is taken from the reward of the step in which the robot falls, and of no other."""
    state = make_state()
    state.root_pos[1, 2] = 0.1
    assert step(state, fall_cost=4.0)[0] == [False, True, False, False]
    assert state.reward.tolist() == [1.0, -3.0, 1.0, 1.0]


def test_fallen_by_tilt_at_the_limit() -> None:
    """Leaning by less than the limit stands, by more has fallen, also upside down; the direction does not matter."""
    state = make_state(5)
    limit = FALL_TILT
    for env, (tilt, heading) in enumerate([(limit - 0.01, 0), (limit + 0.01, 0), (limit + 0.01, 2), (3.1, 1), (0, 0)]):
        horizontal = math.sin(tilt)
        direction = [horizontal * math.cos(heading), horizontal * math.sin(heading), -math.cos(tilt)]
        state.gravity[env] = torch.tensor(direction)
    assert step(state)[0] == [False, True, True, True, False]


@pytest.mark.parametrize("value", [NAN, INF, -INF])
@pytest.mark.parametrize("name", ["root_pos", "gravity", "root_vel", "root_ang", "q", "qd"])
def test_a_state_that_is_no_number_counts_as_fallen(name: str, value: float) -> None:
    """NaN or infinity in the pose, a velocity or a joint of one environment ends that one and no other."""
    state = make_state()
    getattr(state, name)[2, 2] = -value  # infinitely high is as broken as infinitely low
    getattr(state, name)[1, 2] = value
    fallen = step(state)[0]
    assert (fallen[0], fallen[3]) == (False, False)
    assert (fallen[1], fallen[2]) == (True, True)


def test_a_robot_that_is_thrown_does_not_shake_the_learner() -> None:
    """The cost of a solver's accident is bounded; costs of falls and noise reach the learner unchanged."""
    least = terminations.LEAST_REWARD
    state = make_state()
    state.total = torch.tensor([0.06, 0.9 * least, 1e4 * least, -INF])
    step(state)
    torch.testing.assert_close(state.reward, torch.tensor([0.06, 0.9 * least, least, least]), rtol=0.0, atol=0.0)
