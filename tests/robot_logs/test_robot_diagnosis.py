"""What a diagnosis of an arm's log names; the truth is simulated by :mod:`tests.robot_logs.arm_log`."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mrwarp.cli import main
from mrwarp.robot_logs.robot_diagnosis import diagnose_log
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.robot_verdict import RobotDiagnosis
from tests.robot_logs.arm_log import arm_log


def test_the_command_writes_a_verdict_with_the_place_of_a_cause(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A lower arm of 150 g more than described; the keys are those of a joint's verdict."""

    def heavier(model) -> None:  # noqa: ANN001
        body = model.body("lower").id
        model.body_inertia[body] *= (model.body_mass[body] + 0.15) / model.body_mass[body]
        model.body_mass[body] += 0.15

    log = arm_log(tmp_path / "log", change=heavier)
    assert main(["diagnose", str(log), "--out", str(tmp_path / "out")]) == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["sentence"] in capsys.readouterr().out
    keys = {"verdict", "sentence", "causes", "suspects", "unexplained", "cannot_know", "baseline", "extended", "gain"}
    assert keys <= set(result)
    assert set(result["per_channel"]) == {"q", "qd"}
    assert result["per_channel"]["q"]["extended"] < 0.2 * result["per_channel"]["q"]["baseline"]
    assert result["next_experiment"]["what"] in "".join(result["cannot_know"])
    assert result["verdict"] == "named"
    cause = result["causes"][0]
    assert (cause["name"], cause["where"]) == ("link_mass", "lower")
    assert cause["parameters"]["mass"]["value"] == pytest.approx(0.15, abs=0.015)
    robot = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "robot.xml"))
    assert robot.body("lower").mass[0] == pytest.approx(0.5 + cause["parameters"]["mass"]["value"], abs=1e-4)


def test_a_healthy_log_has_no_cause(tmp_path: Path) -> None:
    """Another step, cones and noise than the replay's; a command acts at once, which is no negative delay."""
    d = _diagnosed(arm_log(tmp_path, seconds=8.0))
    assert (d.verdict, d.causes) == ("none", ())
    assert not np.any(d.theta)
    assert any(text.startswith("trunk_mass") for text in d.cannot_know)


def test_gains_that_the_log_does_not_tell_come_back(tmp_path: Path) -> None:
    """The robot's Kp is 15, the log says 12."""
    d = _diagnosed(arm_log(tmp_path, seconds=8.0, kp=15.0))
    found = {c.where: c.parameters["gain"].value for c in d.causes if c.name == "kp"}
    assert found == {"robot": pytest.approx(15.0, rel=0.1)}


def test_a_delay_of_more_than_a_row_is_named(tmp_path: Path) -> None:
    """Commands act 14 ms late; a row is 5 ms."""
    d = _diagnosed(arm_log(tmp_path, seconds=8.0, late=0.014))
    assert [(c.name, c.where) for c in d.causes] == [("command_delay", "robot")]
    assert d.causes[0].parameters["delay"].value == pytest.approx(0.014, abs=0.001)


def _diagnosed(folder: Path) -> RobotDiagnosis:
    return diagnose_log(folder / "arm.xml", load_log(folder))
