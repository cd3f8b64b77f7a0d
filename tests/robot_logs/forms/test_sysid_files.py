"""Files as PACE's ``torch.save`` and Isaac Sim's system identification lay them out become robot logs."""

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from mrwarp.cli import main
from mrwarp.recording.data import RecordingError
from mrwarp.robot_logs.forms.open_log import open_log
from mrwarp.robot_logs.robot_diagnosis import robot_of
from mrwarp.robot_logs.robot_log import is_robot_log, load_log
from tests.messages import has_parts

ROWS, DT = 80, 0.005
T = DT * np.arange(ROWS)
Q = np.stack([0.4 * np.sin(5.0 * T), 0.3 * np.cos(4.0 * T)], axis=1)
HALF = 0.5001e-7
"""Half of a seventh decimal, and a rounding."""
MAP = {"joints": ["hip", "knee"], "kp": 20, "kd": 0.5, "robot": "two.xml"}


def pace(path: Path, **more: Any) -> Path:
    """A file as ``scripts/pace/data_collection.py`` saves it."""
    data = {"time": T, "dof_pos": Q, "des_dof_pos": Q + 0.1}
    torch.save({k: torch.from_numpy(x).float() for k, x in data.items()} | more, path)
    return path


def isaac(path: Path, *, groups: tuple[str, ...] = ("q", "dq", "cmd"), time: str = "Time") -> Path:
    """A table as ``trajectory_csv_core.py`` reads it."""
    values = {"q": Q, "dq": np.gradient(Q, DT, axis=0), "cmd": Q + 0.1}
    names = [time, *(f"{g}{k}" for g in groups for k in (1, 2))]
    rows = np.column_stack([T, *(values[g] for g in groups)])
    lines = ["# recorded on a bench", ",".join(names), *(",".join(f"{x:.7g}" for x in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("form", ["pace", "isaac"])
def test_columns_are_joints_by_the_map(form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file, or a folder of them; what the command writes is what is read back.

    Files have float32 or seven digits, and so has a log, of numbers below 1: half of the last one is rounded.
    """
    files = tmp_path / "files"
    files.mkdir()
    file = pace(files / "chirp.pt") if form == "pace" else isaac(files / "chirp.csv")
    assert is_robot_log(file) and is_robot_log(files)
    with pytest.raises(RecordingError, match=r'name the joints of its 2 columns; .*"joints": \[.*--map'):
        open_log(file)
    (files / "map.json").write_text(json.dumps(MAP))
    log = open_log(file)
    assert log.joints == ("hip", "knee") and log.robot == "two.xml" and log.base == "fixed"
    np.testing.assert_allclose(log.runs[0].joint["q"], Q, rtol=0, atol=HALF)
    np.testing.assert_allclose(log.runs[0].joint["q_des"], Q + 0.1, rtol=0, atol=HALF)
    assert ("qd" in log.runs[0].joint) == (form == "isaac")
    assert any("angles are taken in rad" in note for note in log.notes)
    with pytest.raises(RecordingError, match="its robot, two.xml, does not lie next to it"):
        robot_of(log, None)
    (files / "two.xml").write_text("<mujoco/>")
    assert robot_of(log, None) == files / "two.xml"
    assert main(["log", "import", str(files), "--out", str(tmp_path / "log")]) == 0
    np.testing.assert_allclose(load_log(tmp_path / "log").runs[0].joint["q"], Q, rtol=0, atol=2.0 * HALF)
    in_degrees = open_log(file, units={"q": "deg"})
    np.testing.assert_allclose(in_degrees.runs[0].joint["q"], np.radians(Q), rtol=0, atol=np.radians(HALF))
    assert not any("taken in rad" in note for note in in_degrees.notes)


def test_names_that_a_file_holds_need_no_map(tmp_path: Path) -> None:
    """Programs that write PACE's files add them; one is left out by the map."""
    file = pace(tmp_path / "named.pt", joint_names=["hip", "knee"], dof_vel=torch.zeros(ROWS, 2))
    (tmp_path / "map.json").write_text(json.dumps({"kp": 20, "joints": {"knee": "knee"}}))
    assert open_log(file).joints == ("knee",) and "qd" in open_log(file).runs[0].joint


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("data.pkl", {"time": T}, "a pickle can run any program .. torch.save"),
        ("data.pt", {"time": T, "dof_pos": Q, "des_dof_pos": Q}, "more than tensors .. for safety"),
        ("data.pt", {"time": torch.from_numpy(T)}, "there is no dof_pos (time)"),
        (
            "data.pt",
            {"time": torch.zeros(3), "dof_pos": torch.zeros(4, 2), "des_dof_pos": torch.zeros(4, 2)},
            "shapes do not fit: time (3,)",
        ),
        ("data.pt", b"nothing at all", "data.pt: is no file of tensors"),
    ],
)
def test_files_that_hold_anything_else_are_refused(name: str, content: Any, said: str, tmp_path: Path) -> None:
    """Above all what would run a program."""
    file = tmp_path / name
    if isinstance(content, bytes):
        file.write_bytes(content)
    elif name.endswith(".pkl"):
        file.write_bytes(pickle.dumps(content))
    else:
        torch.save(content, file)
    with pytest.raises(RecordingError) as refused:
        open_log(file)
    assert has_parts(str(refused.value), said), str(refused.value)


@pytest.mark.parametrize("groups", [("q",), ("q", "dq")])
def test_a_table_without_commands_is_refused(groups: tuple[str, ...], tmp_path: Path) -> None:
    """It is known as a log, and nothing could drive a simulation."""
    file = isaac(tmp_path / "passive.csv", groups=groups)
    (tmp_path / "map.json").write_text(json.dumps(MAP))
    with pytest.raises(RecordingError, match="no command and no torque"):
        open_log(file)


def test_the_recording_of_a_joint_is_no_robot_log(tmp_path: Path) -> None:
    """Columns that are numbered otherwise are left to the recordings of a joint."""
    for head in ("t,q,qd,current,torque", "time,q1,q3", "time,q1,cmd1", "q1,q2"):
        (tmp_path / "one.csv").write_text(f"{head}\n0,0,0,0,0\n")
        assert not is_robot_log(tmp_path / "one.csv") and not is_robot_log(tmp_path), head
