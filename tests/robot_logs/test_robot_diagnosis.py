"""What a diagnosis of an arm's log names; the truth is simulated by :mod:`tests.robot_logs.arm_log`."""

import json
from pathlib import Path

import pytest

from mrwarp.cli import main
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
    assert result["verdict"] == "named"
    cause = result["causes"][0]
    assert (cause["name"], cause["where"]) == ("link_mass", "lower")
    assert cause["parameters"]["mass"]["value"] == pytest.approx(0.15, abs=0.05)
