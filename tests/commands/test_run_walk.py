"""Shared by ``mrwarp walk`` and ``mrwarp mission``: which policy drives which robot."""

import pytest
import torch

from mrwarp.commands.run_walk import Walk
from mrwarp.options.command_line import parse
from mrwarp.resources import ENERGY, policy_file
from mrwarp.rl.policy import OnnxPolicy
from paper.study.plan import EXPLICIT

OBS = torch.linspace(-1.0, 1.0, 94).reshape(2, 47)
"""Any observations."""


def drawn(*argv: str) -> dict[str, torch.Tensor]:
    """Actions of each robot's policy with these options."""
    options = parse(Walk, argv, "mrwarp walk")
    return {robot: policy(OBS) for robot, policy in options.read_policies().items()}


@pytest.mark.parametrize(("options", "plant"), [([], "mr_go_sal"), (["--coupling", "explicit"], EXPLICIT)])
def test_each_robot_walks_with_what_was_trained_on_it(options: list[str], plant: str) -> None:
    """MR_Go-SAL's policy knows how its devices act; the other robots' are the same with either coupling."""
    actions = drawn(*options)
    for robot, trained_on in (("go1", "go1"), ("mr_go", "mr_go"), ("mr_go_sal", plant)):
        assert torch.equal(actions[robot], OnnxPolicy(policy_file(ENERGY, trained_on, 0))(OBS)), robot


def test_a_named_policy_comes_before_the_default() -> None:
    """One for all, or for one robot."""
    path = policy_file(ENERGY, "go1", 1)
    named = OnnxPolicy(path)(OBS)
    assert all(torch.equal(action, named) for action in drawn("--policy", str(path)).values())
    some = drawn("--policy-mr-go-sal", str(path), "--coupling", "explicit")
    assert torch.equal(some["mr_go_sal"], named) and not torch.equal(some["go1"], named)
