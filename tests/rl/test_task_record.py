"""The task as checkpoints, policies and results keep it: round trip, earlier versions, and what is no task."""

from dataclasses import replace
from typing import Any

import pytest

from mrwarp.enums import CurrentCommand, LstmState
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.mdp_cfg import RewardCfg, TerrainCfg, make_randomize_cfg
from mrwarp.env.rewards import TERMS
from mrwarp.resources import POLICIES
from mrwarp.rl.policy_file import read_policy
from mrwarp.rl.task_record import differences, record, task_of
from mrwarp.usd.robot import CurrentShares

VARIANTS: dict[str, dict[str, Any]] = {
    "nothing chosen": {},
    "on rough ground": {"terrain": TerrainCfg()},
    "on ground of one's own": {"terrain": TerrainCfg(levels=3)},
    "randomised in part": {"randomize": make_randomize_cfg("ground")},
    "without noise": {"noise": None, "randomize": None},
    "other rewards": {"rewards": RewardCfg(weights={"tilt": -9.0}, step_height=0.1)},
    "a learned torque": {"actuator": "lstm", "lstm_state": LstmState.WINDOW},
    "commanded coils": {"current_by": CurrentCommand.LEARNED, "coil_lag": 0.01, "currents": (0.3, 1.0)},
    "gains": {"gains": (20.0, 0.5), "sal": False},
}


@pytest.mark.parametrize("name", VARIANTS)
def test_a_task_comes_back_from_its_record(name: str) -> None:
    """Equal to what was written, but for the engine, which is the one that was taken."""
    cfg = TaskCfg(num_envs=3, **VARIANTS[name])
    back = task_of(record(cfg))
    assert back == replace(cfg, backend=cfg.engine) and not list(differences(record(cfg), cfg))
    assert isinstance(back.currents, CurrentShares) == ("currents" not in VARIANTS[name])


def test_what_differs_is_named_with_both_values() -> None:
    """Threads and the like are no part of the task."""
    cfg = TaskCfg(num_envs=8)
    other = replace(cfg, num_envs=4, payload=3, threads=1, deterministic=True, seed=9)
    assert list(differences(record(cfg), other)) == [("num_envs", 8, 4), ("payload", 0, 3)]


def test_records_of_earlier_versions_are_read() -> None:
    """Other names, fewer entries: no step was Euler's, a missing reward had no weight, a shipped network its path."""
    old: dict[str, Any] = {
        "robot": "go1", "payload": 3, "actuator": "pg_rlstm", "actuator_file": "models/pg_rlstm.safetensors",
        "lstm_state": None, "current": "scheduled", "engine": "mjwarp", "terrain": "rough", "sal": False,
        "rewards": {name: term.weight for name, term in TERMS.items() if name != "tilt"}, "step_dt": 0.02,
    }  # fmt: skip
    found = task_of(old)
    assert (found.robot, found.payload, found.terrain, found.sal) == ("go1", 3, TerrainCfg(), False)
    assert (found.z_step.value, found.current_by.value, found.engine.value) == ("euler", "scheduled", "mjwarp")
    assert found.actuator_file is None and found.lstm_state is LstmState.CARRIED
    assert found.rewards == RewardCfg(weights={"tilt": 0.0})


def test_every_shipped_policy_names_its_task() -> None:
    """The metadata of all policies that come with the package, written by any version."""
    files = sorted(POLICIES.rglob("*.onnx"))
    assert files
    for file in files:
        said = read_policy(file)[1]["task"]
        found = task_of(said)
        assert (found.robot, found.actuator, found.payload) == (said["robot"], said["actuator"], said["payload"])


@pytest.mark.parametrize(
    "wrong",
    [
        {"robot": []},
        {"payload": "3"},
        {"sal": 1},
        {"coupling": "glue"},
        {"rewards": 3},
        {"terrain": "hilly"},
        {"randomize": {"friction": 1, "colour": 2}},
        {"rewards": {"tlt": 1.0}},
        {"coil_lag": -1.0},
    ],
)
def test_what_is_no_task_is_refused(wrong: dict[str, Any]) -> None:
    """A policy's file may say anything."""
    with pytest.raises(ValueError, match=r"\w"):
        task_of({**record(TaskCfg()), **wrong})
