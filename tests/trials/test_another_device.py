"""A robot with another device than the paper's: its figures without the paper's, with a note for the user."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import onnx
import pytest

from mrwarp.cli import main
from mrwarp.commands.run_walk import Walk
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.model_file import (
    load_model,
    make_effect,
    save_model,
)
from mrwarp.params import MrParams
from mrwarp.resources import DEFAULT_POLICY, META
from mrwarp.rl.task_record import differences, record, trained_device
from mrwarp.trials import energy_report, own_robot
from mrwarp.trials.walking import device_notes, devices_of, foreign_device, largest_difference, limit_note, task_devices
from mrwarp.usd.asset import most_current
from mrwarp.usd.robot import CURRENT_GROUPS
from tests.messages import Refused
from tests.models import LOOP, model_of, paper_model


@pytest.fixture(scope="module")
def small_brake(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A device a quarter as strong, measured up to 1 A, whose holding nobody measured."""
    values = {**MrParams().to_dict(), "K0": 0.1, "K1": 2.6}
    model = model_of({name: values[name] for name in LOOP}, rate=1000.0, current=(0.0, 1.0))
    return save_model(model, tmp_path_factory.mktemp("model") / "small.json")


def test_the_shipped_robot_has_the_papers_device() -> None:
    """No note, for any robot of the task; a lag as an effect makes it another."""
    devices = task_devices(TaskCfg())
    assert len(devices) == 4 and foreign_device(devices) == "" and not list(device_notes(TaskCfg(), 1.5))
    assert devices[1].mr is not None
    other = replace(devices[1], mr=devices[1].mr.replace(T_max=9.0))
    assert "FR_calf is not the paper's device (T_max 9 instead of 26.6)" in foreign_device([devices[0], other])


def test_the_note_names_what_changes_the_torque_most() -> None:
    """Not the first number that differs, nor two that print identically: a rounded q_offset next to 100 times K1."""
    paper = MrParams()
    stiff = paper.replace(q_offset=2.396e-4, K1=985.0, beta=1500.0, gamma=-900.0)
    assert largest_difference(stiff, paper) == "K1 985 instead of 10.4"
    assert largest_difference(paper.replace(q_offset=2.396e-4), paper) == "q_offset 0.0002396 instead of 0.00023964"
    assert largest_difference(paper.replace(D=0.3, I1=2.0), paper) == "I1 2 instead of -0.000768"
    assert largest_difference(paper.replace(coil_resistance=30.0), paper) == "coil_resistance 30 instead of 4"
    assert largest_difference(paper.replace(q_neutral=0.0), paper) == ""


def test_effects_make_another_device(small_brake: Path) -> None:
    """The paper's numbers with a coil that lags are not the paper's device."""
    plain = paper_model(more=("T_max", "K", "n", "coil_resistance"))
    lagging = replace(plain, effects=(make_effect("coil_lag", {"time_constant": 0.02}),))
    assert foreign_device(task_devices(TaskCfg(model=plain))) == ""
    assert "its effects" in foreign_device(task_devices(TaskCfg(model=lagging)))


def test_walk_sets_nothing_of_the_paper_beside_it(
    small_brake: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Noted before the walk: what was not measured, the current that is used, and why the paper's columns are empty."""
    options = ["--distance", "0.3", "--trials", "1", "--speed", "0.5", "--payload", "0", "--threads", "1"]
    robots = ["--robot", "mr_go", "mr_go_sal"]
    assert main(["walk", "--model", str(small_brake), *options, *robots, "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert "no break-away test" in shown and "requested" not in shown
    assert (
        "is not the paper's device (T_max " in shown and "instead of 26.6): the paper's figures are left out" in shown
    )
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    for row in result["conditions"]:
        assert row["paper"] is None and row["difference"] is None and row["paper_hold_mean"] is None
    assert [saving["paper"] for saving in result["savings"]] == [None]
    off, on = result["conditions"]  # nobody stated the coil's resistance
    assert result["not_known"] == ["coil resistance", "mass"] and shown.count("not known of FL_calf") == 1
    assert off["power"]["mean"] > 0.0 and off["parts"]["coil"] == 0.0
    assert on["power"]["mean"] is None and on["cot"] == {"mean": None, "sd": None} and on["parts"]["coil"] is None
    assert on["parts"]["copper_calves"] > 0.0 and result["savings"][0]["saving"] is None
    assert " W + coils  " in shown and "less what the coils take, which is not known" in shown and "nan" not in shown
    assert "paper" not in shown.partition("figures are left out")[2]


def test_currents_end_at_what_the_device_takes(
    small_brake: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Refused
) -> None:
    """By default shares of it, a robot with each, with a note; a current that was typed is refused."""
    line = ["play", "--agent", "zero", "--model", str(small_brake), "--seconds", "1", "--out", str(tmp_path / "out")]
    assert main(line) == 0
    shown = capsys.readouterr().out
    assert "shares of the devices' 1 A: 0, 0.3333, 0.6667, 1 A" in shown and "4 of 4 robots" in shown
    currents = json.loads((tmp_path / "out" / "result.json").read_text())["currents"]
    assert currents == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0])
    assert "--current 1.2: FL_calf takes 0 to 1 A" in refused(*line, "--current", "0", "1.2")


def test_mission_and_impact_too(small_brake: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line says why, and the paper's figures are nowhere in tables and results."""
    options = ["--robot", "mr_go", "mr_go_sal", "--window", "0.3", "--trials", "1", "--threads", "1"]
    assert main(["mission", "--model", str(small_brake), *options, "--out", str(tmp_path / "mission")]) == 0
    result = json.loads((tmp_path / "mission" / "result.json").read_text())
    for row in result["robots"].values():
        assert {cell["paper"] for cell in (*row["power"].values(), *row["rise"].values(), row["depletion"])} == {None}
    assert {change["paper"] for change in result["changes"].values()} == {None}
    assert result["not_known"] == ["coil resistance", "mass", "heat capacity", "heat resistance"]
    sal = result["robots"]["mr_go_sal"]
    assert sal["depletion"]["mean"] is None and sal["rise"]["fluid"]["mean"] is None
    assert sal["rise"]["calf_walking"]["mean"] > 0.0  # of the motors
    shown = capsys.readouterr().out
    assert "is not the paper's device" in shown and "(paper" not in shown

    options = ["--trials", "1", "--coupling", "constraint"]
    assert main(["impact", "--model", str(small_brake), *options, "--out", str(tmp_path / "impact")]) == 0
    found = json.loads((tmp_path / "impact" / "result.json").read_text())
    assert found["paper_change"] is None
    rows = found["couplings"]["constraint"]["by_current"]
    assert [row["current"] for row in rows] == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0])
    assert rows[0]["energy"]["coil"] == 0.0 and rows[1]["energy"]["coil"] is rows[3]["energy"]["coil"] is None
    shown = capsys.readouterr().out
    assert "is not the paper's device" in shown and "(paper" not in shown


def test_training_groups_are_shares_of_what_the_device_takes(small_brake: Path) -> None:
    """Eq. 20's four groups stay four: of 1 A, and of a brake that takes more than the paper's; hers as they are."""
    env = WalkEnv(TaskCfg(num_envs=8, model=str(small_brake), randomize="none"))
    assert env.current_e.tolist() == pytest.approx([0.0, 0.0, 1 / 3, 1 / 3, 2 / 3, 2 / 3, 1.0, 1.0])
    assert env.cfg.currents == pytest.approx((0.0, 1 / 3, 2 / 3, 1.0))
    assert CURRENT_GROUPS.of(most_current(task_devices(TaskCfg()))) == (0.0, 0.5, 1.0, 1.5)
    assert CURRENT_GROUPS.of(3.0) == pytest.approx((0.0, 1.0, 2.0, 3.0))
    assert all(CURRENT_GROUPS.of(most)[-1] == most for most in (k / 10 for k in range(1, 31)))  # no more by rounding
    asked = replace(TaskCfg(num_envs=2, model=str(small_brake), randomize="none"), currents=(0.0, 0.4))
    assert WalkEnv(asked).current_e.tolist() == pytest.approx([0.0, 0.4])


def test_a_walk_lists_currents_that_flow(small_brake: Path) -> None:
    """Thirds of what the devices take, where 1.5 A are asked for; a note names both."""
    devices = task_devices(TaskCfg(model=str(small_brake)))
    assert own_robot.currents_of(devices, 1.5) == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0])
    assert own_robot.currents_of(devices, 0.6) == pytest.approx([0.0, 0.2, 0.4, 0.6])
    assert list(limit_note(devices, 1.5)) == ["note: requested 1.5 A, limited to the devices' 1 A"]
    assert list(limit_note(devices, 0.6)) == []


def test_nobody_arrived(small_brake: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Too slow for the distance, next to Go1: no nan in the table, which explains why, and nothing of the paper."""
    options = ["--distance", "0.3", "--trials", "1", "--speed", "0.05", "--payload", "0", "--threads", "1"]
    policy = ["--policy", str(DEFAULT_POLICY)]
    walk = ["walk", "--model", str(small_brake), *options, *policy, "--robot", "go1", "mr_go_sal"]
    code = main([*walk, "--out", str(tmp_path / "out")])
    shown = capsys.readouterr().out
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert all(row["paper"] is None for row in result["conditions"]) and result["current"] == 1.0
    assert "nan" not in shown and not {"consistency", "paper_bounds", "calibration"} & result.keys()
    assert ("late: trials" in shown) == any(row["late"] for row in result["conditions"])
    assert code == int(any(not row["trials"] for row in result["conditions"]))
    row = {**result["conditions"][0], "trials": 0, "late": 2, "fell": 1}
    nobody = {**row, **{name: {"mean": float("nan"), "sd": float("nan")} for name in ("speed", "power", "cot")}}
    lines = energy_report.walk_lines({"conditions": [nobody, {**nobody, "hold_mean": nobody["cot"]}]})
    text = "\n".join(lines)
    assert "nan" not in text and "fell 1  late 2" in text
    assert "late: trials that had not covered the distance after 2 times distance over command" in lines[-1]


def trained_with(task: dict[str, Any], path: Path) -> Path:
    """The shipped policy, as if its training had had this in its task."""
    proto = onnx.load(str(DEFAULT_POLICY))
    entry = next(entry for entry in proto.metadata_props if entry.key == META)
    description = json.loads(entry.value)
    entry.value = json.dumps(description | {"task": description["task"] | task})
    onnx.save(proto, str(path))
    return path


def test_a_policy_brings_the_device_of_its_training(
    small_brake: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Refused
) -> None:
    """Played and walked with it, also where its file is gone; an option or another robot's file goes first."""
    model = load_model(small_brake)
    task = record(TaskCfg(model=str(small_brake)))
    assert trained_device(task, "x.onnx") == model and not list(differences(task, TaskCfg(model=str(small_brake))))
    policy = trained_with({"model": "gone.json", "mr_model": task["mr_model"]}, tmp_path / "policy.onnx")
    assert main(["play", "--seconds", "1", "--policy", str(policy), "--out", str(tmp_path / "play")]) == 0
    assert "shares of the devices' 1 A" in capsys.readouterr().out
    walk = Walk(policy=policy)
    assert walk.env_cfg().model == model and walk.used(devices_of(walk.env_cfg())) == 1.0
    assert Walk(policy=policy, model="paper").env_cfg().model == "paper"
    assert Walk(policy=policy, asset="other.usda").env_cfg().model is None
    lost = trained_with({"model": "gone.json", "mr_model": None}, tmp_path / "lost.onnx")
    said = refused("play", "--policy", lost, "--out", tmp_path / "no")
    assert "lost.onnx: was trained with --model gone.json; name that device with --model" in said
