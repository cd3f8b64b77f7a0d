"""The comparison of current commands: its tasks, its statistics, and what it takes from a folder."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from mrwarp.cli import main
from mrwarp.enums import ARMS, CurrentCommand, HoldCurrent
from mrwarp.resources import ENERGY, policy_file
from paper.study import currents
from paper.study.currents import CurrentsCfg, arm_env, figures


def test_arms_differ_in_who_commands_the_coils() -> None:
    """Price, lag and rewards are the same; robot, command and current are the arm's."""
    envs = {arm: arm_env(CurrentsCfg(), arm, 0.5) for arm in ARMS}
    assert len({str(env.rewards) for env in envs.values()}) == 1 and {e.coil_lag for e in envs.values()} == {0.01}
    assert {arm: env.current_by for arm, env in envs.items() if env.current_by is not CurrentCommand.FIXED} == {
        "latched": CurrentCommand.LATCHED,
        "scheduled": CurrentCommand.SCHEDULED,
        "learned": CurrentCommand.LEARNED,
    }
    assert envs["fixed"].currents == (0.5,) and envs["fixed"].hold_current is HoldCurrent.FIXED
    assert replace(envs["latched"], current_by=CurrentCommand.FIXED, hold_speed=None) == envs["fixed"]
    assert envs["latched"].hold_speed == envs["learned"].hold_speed == 1.0 and envs["scheduled"].hold_speed is None
    assert envs["none"].robot == "go1" and envs["off"].currents == (0.0,)


def test_intervals_are_over_seeds_and_paired() -> None:
    """Student's t over seeds; the change against fixed currents seed by seed."""
    row = dict.fromkeys(currents.UNITS, 1.0)
    cots = {"fixed": (2.0, 3.0, 4.0), "learned": (1.8, 2.7, 3.7)}
    found = figures({arm: {s: {**row, "cot": c} for s, c in enumerate(values)} for arm, values in cots.items()})
    assert found["fixed"]["cot"]["half_width"] == pytest.approx(stats.t.ppf(0.975, 2) / np.sqrt(3))
    change = np.array([-0.1, -0.1, -0.075])
    against = found["learned"]["against_fixed"]
    assert against["cot"]["mean"] == pytest.approx(change.mean()) and against["cot"]["clear"]
    half = stats.t.ppf(0.975, 2) * change.std(ddof=1) / np.sqrt(3)
    assert against["cot"]["half_width"] == pytest.approx(half)
    assert against["v_x_rmse"]["mean"] == 0.0 and not against["v_x_rmse"]["clear"]
    assert "against_fixed" not in found["fixed"]
    others = figures(
        {arm: {s: {**row, "cot": c} for s, c in enumerate(cots["fixed"])} for arm in ("latched", "scheduled")}
        | {"learned": {s: {**row, "cot": c} for s, c in enumerate(cots["learned"])}}
    )
    assert others["learned"]["against_latched"]["cot"]["mean"] == pytest.approx(change.mean())
    assert "against_latched" not in others["scheduled"], "its gates are the paper's"
    single = figures({arm: {0: {**row, "cot": values[0]}} for arm, values in cots.items()})
    assert not single["learned"]["against_fixed"]["cot"]["clear"], "one seed has no interval"
    whole = {"best_fixed": 0.5, "arms": found, "power_price": 0.01, "seeds": [0, 1, 2]}
    text = currents.lines({**whole, "more_prices": [{"arms": single, "power_price": 0.03, "seeds": [0]}]})
    title = currents.TITLES["learned"]
    cots_shown = [line.removeprefix(title).strip().split("  ")[0] for line in text if line.startswith(title)]
    assert cots_shown == ["2.733 ± 2.361", "-9.2% ± 3.6%*", "1.800", "-10.0%"]


def test_the_front_holds_what_nothing_beats_in_both() -> None:
    """Less of the first; more or less of the second."""
    points = np.array([(3.0, 1.0), (1.0, 2.0), (2.0, 2.5), (2.5, 1.5), (1.0, 2.2)])
    assert currents._front(points, -1.0).tolist() == [[1.0, 2.0], [2.5, 1.5], [3.0, 1.0]]
    assert currents._front(points, 1.0).tolist() == [[1.0, 2.2], [2.0, 2.5]]


def test_an_arm_begins_with_the_policy_of_its_robot_and_seed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every seed of every arm is shipped; without updates an arm is that policy."""
    begun: list[Path] = []
    monkeypatch.setattr(currents, "settled", lambda *asked: begun.append(asked[4]) or asked[5] / "policy.onnx")
    cfg = CurrentsCfg()
    for arm, robot in (("none", "go1"), ("off", "mr_go"), ("fixed", "mr_go_sal"), ("learned", "mr_go_sal")):
        assert currents._trained(cfg, arm, 4, 0.5, tmp_path) == tmp_path / "policy.onnx"
        own = policy_file(ENERGY, robot, 4)
        assert begun.pop() == own and own.is_file()
        assert currents._trained(replace(cfg, iterations=0), arm, 4, 0.5, tmp_path) == own
    assert not begun


def test_what_is_in_the_folder_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second run measures nothing; another distance, or an arm that is not shipped, is refused."""
    measured = []
    row = dict.fromkeys(currents.UNITS, 1.0)
    price = ["--more-prices", "0.03", "--more-seeds", "0"]
    monkeypatch.setattr(currents, "sweep_currents", lambda *_: {"0.5": {"cot": 2.0}, "1": {"cot": 3.0}})
    monkeypatch.setattr(currents, "measure_policy", lambda cfg, arm, *_: measured.append(arm) or row)
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
    assert main([*line, *price]) == 0 and len(measured) == 4
    assert (tmp_path / "price_0.03" / "scheduled_seed0" / "measured.json").is_file()
    found = json.loads((tmp_path / "result.json").read_text())
    assert found["power_price"] == 0.01 and [part["power_price"] for part in found["more_prices"]] == [0.03]
    assert (tmp_path / "current.png").is_file()
    assert main([*line, "--distance", "3"]) == 2
    assert main(["study", "current", "--iterations", "0", "--arms", "learned", "--out", str(tmp_path)]) == 2
    assert main(["study", "current", "--seeds", "7", "--out", str(tmp_path)]) == 2
