"""The list of the task's arrays: what a checkpoint saves, a reset clears and a copy copies follows from it."""

from dataclasses import fields

import pytest
import torch

from mrwarp.env.state import ArraySpec, WalkState
from mrwarp.env.vec_env import WalkEnv
from tests.env.env_bench import make_cfg

SPECS: dict[str, ArraySpec] = {entry.name: entry.metadata["array"] for entry in fields(WalkState)}

FLAT = {
    "action", "last_action", "last_qd", "command", "phase", "privileged", "episode_length_buf", "q_des", "effort",
    "power", "key", "last_actor", "last_critic", "sim/qpos", "sim/qvel", "sim/qacc_warmstart", "sim/qfrc_applied",
    "sim/xfrc_applied", "sim/q", "sim/qd", "sim/friction", "sim/f_foot", "sim/root_pos", "sim/root_quat",
    "sim/root_vel", "sim/root_ang", "sim/residual", "sim/unsolved",
}  # fmt: skip
"""Names in checkpoints of format 1, without those of the actuator."""


@pytest.fixture(scope="module")
def env() -> WalkEnv:
    """Three robots without randomisation."""
    return WalkEnv(make_cfg(3, randomize=None))


@pytest.mark.parametrize("terrain", [False, True])
def test_a_checkpoint_has_the_names_of_its_format(env: WalkEnv, terrain: bool) -> None:
    """Trainings of earlier versions can be resumed."""
    names = {name for name, _, _ in env.arrays.saved(terrain=terrain)} | {"last_actor", "last_critic"}
    assert names - FLAT == ({f"terrain/{n}" for n in ("level", "kind", "walked", "commanded")} if terrain else set())
    assert FLAT <= names and (terrain or FLAT == {name for name in env.state() if not name.startswith("actuator/")})


def test_arrays_have_the_shapes_and_types_that_are_said(env: WalkEnv) -> None:
    """Axes of one letter have one size; the task's own arrays have their type; all carry a unit's text."""
    sizes = {"E": 3, "J": 12, "A": 12, "L": 4, "M": 4, "T": 14, "O": 47, "C": 82}
    for name, spec in SPECS.items():
        value = getattr(env.arrays, name)
        axes = spec.shape.split()
        assert value.ndim == len(axes), name
        for axis, size in zip(axes, value.shape, strict=True):
            assert size == sizes.get(axis, int(axis) if axis.isdigit() else size), name
        assert spec.owner in ("sim", "engine", "robot", "device") or value.dtype == spec.dtype, name


def test_a_reset_clears_what_is_marked_in_masked_environments_alone(env: WalkEnv) -> None:
    """Every array that is marked is zero where an episode begins, and untouched elsewhere."""
    marked = {name: getattr(env.arrays, name) for name, spec in SPECS.items() if spec.cleared}
    assert marked
    for value in marked.values():
        value.fill_(7)
    env._reset(torch.tensor([False, True, False]))
    for name, value in marked.items():
        assert not bool(value[1].any()), name
        assert bool((value[[0, 2]] == 7).all()), name
    env.restart()


def test_a_copy_leaves_each_robot_its_own(env: WalkEnv) -> None:
    """Arrays marked as a robot's own stay; all else of its state follows the source."""
    state = env.arrays
    for name, spec in SPECS.items():
        if spec.saved and spec.owner == "task" and spec.shape[0] == "E":
            value = getattr(state, name)
            value.copy_(torch.arange(3).view(3, *[1] * (value.ndim - 1)).expand_as(value))
    key = state.key.clone()
    env.copy_envs(torch.tensor([2, 2, 0]))
    for name, spec in SPECS.items():
        if spec.saved and spec.owner == "task" and spec.shape[0] == "E":
            first = getattr(state, name).view(3, -1)[:, 0].tolist()
            assert first == ([0, 1, 2] if spec.own else [2, 2, 0]), name
    assert torch.equal(state.key, key)
