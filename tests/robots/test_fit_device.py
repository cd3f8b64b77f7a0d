"""A device on a robot of one's own: every number, effect and law arrives, and what nobody measured is said."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from mrwarp.cli import main
from mrwarp.model_file import Model, make_effect, save_model
from mrwarp.params import MrParams
from mrwarp.usd.asset import JointActuator, load_robot
from tests.commands.test_device_carried import device, small
from tests.robots.conftest import Robot


@pytest.fixture(scope="module")
def beast(robot: Robot) -> Path:
    """An imported robot."""
    out = robot().with_suffix(".usda")
    assert main(["robot", "import", str(out.with_suffix(".xml")), "--out", str(out)]) == 0
    return out


def knees(model: Model, beast: Path, folder: Path) -> list[JointActuator]:
    """The knees of an imported robot with the device on them."""
    file, path = Path(shutil.copy(beast, folder)), save_model(model, folder / "model.json")
    assert main(["robot", "fit-device", str(file), "--joint", "*_knee", "--model", str(path)]) == 0
    found = [a for a in load_robot(robot=str(file)).actuators if a.mr]
    assert [a.joint for a in found] == [f"leg_{name}_knee" for name in "dcba"]
    return found


def test_every_number_arrives(beast: Path, tmp_path: Path) -> None:
    """None of them is the paper's."""
    model, paper = device(), MrParams().to_dict()
    for knee in knees(model, beast, tmp_path):
        assert knee.model == model and knee.mr is not None
        found = knee.mr.to_dict()
        assert {name: found[name] for name in model.values} == model.values
        assert all(found[name] != pytest.approx(paper[name], rel=1e-3) for name in model.values)


def test_a_law_and_its_effects_arrive(beast: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As attribute and in the record; that nobody measured how the device holds is said here as by ``asset apply``."""
    law = make_effect("kwok", {"slope": 0.7, "width": 0.2})
    model = replace(
        small(alpha=0.0, beta=1.0, gamma=0.0), effects=(law, make_effect("coil_lag", {"time_constant": 0.01}))
    )
    for knee in knees(model, beast, tmp_path):
        assert knee.model is not None and knee.model.law == law and knee.effects == model.effects
    assert 'newton:mr:law = "kwok"' in (tmp_path / "beast.usda").read_text()
    out = capsys.readouterr().out
    assert "no break-away test" in out and "yields at 25 N·m with 1 A" in out and "coil_lag" in out
