"""Editing USD assets: only the wanted number changes, or nothing is written; files of other USD tools load."""

import difflib
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd

import mrwarp.usd.edit
from mrwarp.params import MrParams
from mrwarp.usd.asset import load_robot
from mrwarp.usd.edit import edit_asset
from mrwarp.usd.open_stage import ASSETS, AssetError
from mrwarp.usd.record import PREFIX
from mrwarp.usd.robot import CALVES
from mrwarp.usd.scene_report import diff_assets

SHIPPED = ASSETS / "mr_go.usda"


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A copy of the robot's file, alone in its folder."""
    return Path(shutil.copy(SHIPPED, tmp_path / "robot.usda"))


def mr(path: Path) -> dict[str, MrParams]:
    """Parameters of the MR joints of a file."""
    return {a.joint: a.mr for a in load_robot(path).actuators if a.mr is not None}


def test_set_all_four(robot):
    """A class's number changes in its line, comment included; a leg with a number of its own is named and keeps it."""
    edit_asset(robot, "RR_calf", {"newton:mr:D": "-0.5"})
    report = edit_asset(robot, "MRDevice", {"D": "-1e-3"})
    assert [p.bouc_wen.D for p in mr(robot).values()] == [-1e-3, -1e-3, -1e-3, -0.5]
    assert report.kept == ("/mr_go/actuators/RR_calf keeps its own newton:mr:D = -0.5 N·m",)
    assert {change.prim.rsplit("/")[-1] for change in report.changes} == {"MRDevice", *CALVES[:3]}
    old, new, own = [
        line[2:].strip()
        for line in difflib.ndiff(*(p.read_text("utf-8").splitlines() for p in (SHIPPED, robot)))
        if line[0] in "+-"
    ]
    assert new == old.replace("-0.01917639", "-0.001     ")
    assert own == "double newton:mr:D = -0.5"


def test_set_motor(robot):
    """A plain motor's gain is set in its own precision; go1's calves, which inherit it, are reported too."""
    report = edit_asset(robot, "PDMotor", {"kp": "30.123456789"})
    assert load_robot(robot).actuators[0].kp == float(str(np.float32(30.123456789)))
    assert {change.prim.rsplit("/")[-1] for change in report.changes} >= {"PDMotor", "FL_hip", "FL_calf"}
    assert report.notice == ""


def test_an_edit_that_does_not_arrive_is_refused(robot, monkeypatch):
    """The edited copy is read back; when the number is not there, nothing is written."""
    monkeypatch.setattr(mrwarp.usd.edit, "set_values", lambda text, *_: text)
    with pytest.raises(AssetError, match=r"does not take effect.*nothing was written"):
        edit_asset(robot, "FL_calf", {"K1": 3.0})
    assert [p.name for p in robot.parent.iterdir()] == ["robot.usda"]
    assert robot.read_bytes() == SHIPPED.read_bytes()


def test_set_in_binary_file_and_in_sublayer(robot):
    """Where the text cannot be edited USD writes the file: the number arrives, and a notice says comments are gone."""
    binary = robot.with_suffix(".usdc")
    assert "not a text format" in edit_asset(robot, "MRDevice", {"K1": 4.0}, binary).notice
    assert "keeps no comments" in edit_asset(binary, "FL_calf", {"K1": 5.0}).notice
    assert binary.read_bytes()[:8] == b"PXR-USDC"
    assert [p.bouc_wen.K1 for p in mr(binary).values()] == [5.0, 4.0, 4.0, 4.0]
    top = robot.with_name("top.usda")
    top.write_text('#usda 1.0\n(\n    defaultPrim = "mr_go"\n    subLayers = [@./robot.usda@]\n)\n', encoding="utf-8")
    assert "/mr_go/actuators/FL_calf does not stand in the text" in edit_asset(top, "FL_calf", {"K1": 6.0}).notice
    assert mr(top)["FL_calf"].bouc_wen.K1 == 6.0
    assert robot.read_bytes() == SHIPPED.read_bytes()


def foreign(path: Path, kind: str, change: Callable[[Sdf.PrimSpec], None] = lambda _: None) -> Path:
    """The robot's file as another USD tool leaves it, which may change the class of the devices."""
    stage = Usd.Stage.Open(str(path))
    out = path.with_name(f"foreign{'.usdc' if kind == 'usdc' else '.usda'}")
    layer = stage.Flatten() if kind == "flattened" else stage.GetRootLayer()
    copy = Sdf.Layer.CreateAnonymous(".usda")
    copy.TransferContent(layer)
    device = copy.GetPrimAtPath("/mr_go/parts/MRDevice")
    for spec in [s for s in device.attributes if s.name.startswith(PREFIX)] if kind == "float" else ():
        spec.SetInfo("typeName", "float")
        spec.default = spec.default
    change(device)
    assert copy.Export(str(out))
    return out


@pytest.mark.parametrize(
    ("kind", "rounded"), [("exported", set()), ("usdc", set()), ("float", {"newton:mr:q_center", "newton:mr:q_offset"})]
)
def test_file_of_another_tool_loads(robot, kind, rounded):
    """Exported, binary and with 32-bit numbers (two have more digits) the file holds the same robot; edits work."""
    out = foreign(robot, kind)
    assert {line.split()[1].rstrip(":") for line in diff_assets(SHIPPED, out)} == rounded
    for joint, params in mr(SHIPPED).items():
        np.testing.assert_allclose([v for _, v in mr(out)[joint]], [v for _, v in params], rtol=1e-7)
    edit_asset(out, "MRDevice", {"K1": 20.82663})
    assert [p.bouc_wen.K1 for p in mr(out).values()] == [20.82663] * 4


def test_flattened_file_loads(robot):
    """Flattening fixes the variants: that choice is the same robot, another is refused, a leg can be edited."""
    out = foreign(robot, "flattened")
    assert mr(out) == mr(SHIPPED)
    gone = ["robot=go1 payload=0", "robot=go1 payload=3", "robot=mr_go payload=3"]
    assert diff_assets(SHIPPED, out) == [f"variant {name}: only in {SHIPPED}" for name in gone]
    with pytest.raises(AssetError, match="payload = '3'.*0"):
        load_robot(out, payload=3)
    with pytest.raises(AssetError, match="robot = 'go1'.*mr_go"):
        load_robot(out, robot="go1")
    with pytest.raises(AssetError, match="no actuator inherits /mr_go/parts/MRDevice"):
        edit_asset(out, "MRDevice", {"K1": 3.0})
    edit_asset(out, "FL_calf", {"K1": 3.0})
    assert [p.bouc_wen.K1 for p in mr(out).values()] == [3.0, 10.413315, 10.413315, 10.413315]
