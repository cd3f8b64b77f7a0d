"""The comparison of current commands: its tasks, its statistics, and what it takes from a folder."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from mrwarp.cli import main
from mrwarp.enums import ARMS, CurrentCommand, HoldCurrent
from mrwarp.study import currents
from mrwarp.study.currents import CurrentsCfg, arm_env, figures


def test_arms_differ_in_who_commands_the_coils() -> None:
    """Price, lag and rewards are the same; robot, command and current are the arm's."""
    envs = {arm: arm_env(CurrentsCfg(), arm, 0.5) for arm in ARMS}
    assert len({str(env.rewards) for env in envs.values()}) == 1 and {e.coil_lag for e in envs.values()} == {0.01}
    assert {arm: env.current for arm, env in envs.items() if env.current is not CurrentCommand.FIXED} == {
        "scheduled": CurrentCommand.SCHEDULED,
        "learned": CurrentCommand.LEARNED,
    }
    assert envs["fixed"].currents == (0.5,) and envs["fixed"].actuator.hold_current is HoldCurrent.FIXED
    assert envs["none"].robot == "go1" and envs["off"].currents == (0.0,)


def test_intervals_are_over_seeds_and_paired() -> None:
    """Student's t over seeds; the change against fixed currents seed by seed."""
    row = dict.fromkeys(currents.UNITS, 1.0)
    cots = {"fixed": (2.0, 3.0, 4.0), "learned": (1.8, 2.7, 3.7)}
    found = figures({arm: {s: {**row, "cot": c} for s, c in enumerate(values)} for arm, values in cots.items()})
    assert found["fixed"]["cot"]["half_width"] == pytest.approx(stats.t.ppf(0.975, 2) / np.sqrt(3))
    change = np.array([-0.1, -0.1, -0.075])
    assert found["learned"]["cot_change"]["mean"] == pytest.approx(change.mean())
    half = stats.t.ppf(0.975, 2) * change.std(ddof=1) / np.sqrt(3)
    assert found["learned"]["cot_change"]["half_width"] == pytest.approx(half)
    assert "cot_change" not in found["fixed"]


def test_what_is_in_the_folder_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second run measures nothing; another distance, or an arm that is not shipped, is refused."""
    measured = []
    row = dict.fromkeys(currents.UNITS, 1.0)
    monkeypatch.setattr(currents, "_sweep", lambda *_: {"0.5": {"cot": 2.0}, "1": {"cot": 3.0}})
    monkeypatch.setattr(currents, "_measure", lambda cfg, arm, *_: measured.append(arm) or row)
    line = [
        "study",
        "current",
        "--iterations",
        "0",
        "--arms",
        "fixed",
        "scheduled",
        "--seeds",
        "0",
        "--out",
        str(tmp_path),
    ]
    assert main(line) == 0 and measured == ["fixed", "scheduled"]
    assert json.loads((tmp_path / "result.json").read_text())["best_fixed"] == 0.5
    assert main(line) == 0 and len(measured) == 2
    assert main([*line, "--distance", "3"]) == 2
    assert main(["study", "current", "--iterations", "0", "--arms", "learned", "--out", str(tmp_path)]) == 2
    assert main(["study", "current", "--seeds", "7", "--out", str(tmp_path)]) == 2
