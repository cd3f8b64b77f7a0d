"""LeRobot's data sets, written here as its versions 2 and 3 lay them out, become robot logs; units are asked for."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from mrwarp.cli import main
from mrwarp.recording.data import RecordingError
from mrwarp.robot_logs.forms.open_log import open_log
from mrwarp.robot_logs.forms.save_log import DIGITS
from mrwarp.robot_logs.robot_log import is_robot_log, load_log
from tests.messages import Refused, has_parts

FPS, ROWS = 50, 60
EPS = float(np.finfo(np.float32).eps)
"""Of a data set's numbers."""
JOINTS = ("shoulder_pan", "elbow_flex", "gripper")


def angles(episode: int) -> np.ndarray:
    """Of three joints [deg], shape (N, 3); the last is a gripper's share of its range."""
    t = np.arange(ROWS) / FPS
    return np.stack([40.0 * np.sin(4.0 * t + episode), 30.0 * np.cos(3.0 * t), 50.0 + 0.0 * t], axis=1)


def data_set(
    path: Path,
    version: str,
    *,
    names: Any = tuple(f"{j}.pos" for j in JOINTS),
    change: dict[str, Any] | None = None,
    episodes: int = 2,
) -> Path:
    """Two episodes: a file for each in version 2, one of both in version 3; targets lead by 2 degrees."""
    vector = {"dtype": "float32", "shape": [3], "names": list(names) if isinstance(names, tuple) else names}
    info = {
        "codebase_version": version, "fps": FPS, "total_episodes": episodes, "robot_type": "so101_follower",
        "features": {
            "observation.state": vector, "action": vector, "observation.images.top": {"dtype": "video", "shape": [9]},
        },
    }  # fmt: skip
    (path / "meta").mkdir(parents=True)
    (path / "meta" / "info.json").write_text(json.dumps(info | (change or {})))
    tables = []
    for episode in range(episodes):
        q = angles(episode)
        columns = {
            "observation.state": pa.array(q.tolist(), pa.list_(pa.float32())),
            "action": pa.array((q + 2.0).tolist(), pa.list_(pa.float32(), 3)),
            "timestamp": pa.array(np.arange(ROWS) / FPS, pa.float32()),
            "frame_index": np.arange(ROWS),
            "episode_index": np.full(ROWS, episode),
        }
        tables.append(pa.table(columns))
    chunk = path / "data" / "chunk-000"
    chunk.mkdir(parents=True)
    if version.startswith("v2"):
        for episode, table in enumerate(tables):
            pyarrow.parquet.write_table(table, chunk / f"episode_{episode:06d}.parquet")
    else:
        pyarrow.parquet.write_table(pa.concat_tables(tables[::-1]), chunk / "file-000.parquet")
    return path


MAP = {"joints": {"shoulder_pan": "pan", "elbow_flex": "elbow"}, "kp": 20, "kd": 0.5, "units": {"q": "deg"}}


@pytest.mark.parametrize("version", ["v2.0", "v2.1", "v3.0"])
def test_episodes_become_recordings(version: str, tmp_path: Path) -> None:
    """In degrees, under the robot's own names, without the gripper; a row's action acts after its state was read."""
    log = open_log(_mapped(data_set(tmp_path / "set", version), MAP))
    assert log.joints == ("pan", "elbow") and [run.id for run in log.runs] == ["episode_000000", "episode_000001"]
    for episode, run in enumerate(log.runs):
        np.testing.assert_allclose(run.t, np.arange(ROWS) / FPS, rtol=EPS)
        np.testing.assert_allclose(run.joint["q"], np.radians(angles(episode)[:, :2]), rtol=EPS)
        lead = run.joint["q_des"] - run.joint["q"]
        np.testing.assert_allclose(lead, np.radians(2.0), rtol=0, atol=EPS)  # of angles below 1 rad
    assert log.base == "fixed" and log.kp.tolist() == [20.0, 20.0]


@pytest.mark.parametrize("names", [{"motors": list(JOINTS)}, None, ("a.pos", "a.vel", "a.torque")])
def test_names_may_be_grouped_missing_or_say_what_a_number_is(names: Any, tmp_path: Path) -> None:
    """A map's list names what the data set does not; velocities and torques stand next to angles."""
    path = data_set(tmp_path / "set", "v3.0", names=names)
    if isinstance(names, tuple):
        log = open_log(_mapped(path, {"kp": 20, "units": {"q": "mrad", "qd": "deg/s"}, "tau_is": "estimate"}))
        assert log.joints == ("a",) and {"q", "qd", "tau", "q_des", "qd_des", "tau_ff"} <= set(log.runs[0].joint)
        np.testing.assert_allclose(log.runs[0].joint["qd"][:, 0], np.radians(angles(0)[:, 1]), rtol=EPS)
        return
    if names is None:
        with pytest.raises(RecordingError, match=r'does not name the 3 numbers .*\{"joints": \["NAME", ...\]\}'):
            open_log(path)
        mapped = _mapped(path, MAP | {"joints": ["pan", "elbow", None]})
    else:
        mapped = _mapped(path, MAP)
    assert open_log(mapped).joints == ("pan", "elbow")


def test_units_are_asked_for_and_shares_of_a_range_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Refused
) -> None:
    """One line with the option; the log that is written is the data set's; ``check`` takes the same option."""
    path = _mapped(data_set(tmp_path / "set", "v3.0"), {k: v for k, v in MAP.items() if k != "units"})
    out = tmp_path / "log"
    assert is_robot_log(path)
    for words, said in (
        ([], "does not say the unit of observation.state (values -40 to 50) .. --units q=deg .. --units q=rad"),
        (["--units", "q=range_m100_100"], "share of the robot's calibrated range .. convert it by the calibration's"),
        (["--units", "q=rad"], "angles of up to 39.99 rad .. degrees? .. into the map, or give it by --units"),
        (["--units", "q=furlong"], "q in 'furlong'; allowed: rad, deg"),
    ):
        err = refused("log", "import", path, "--out", out, *words)
        assert has_parts(err, said) and not out.exists(), err
    assert main(["log", "import", str(path), "--out", str(out), "--units", "q=deg"]) == 0
    ours, theirs = load_log(out), open_log(path, units={"q": "deg"})
    found, expected = (log.runs[1].joint["q_des"] for log in (ours, theirs))
    np.testing.assert_allclose(found, expected, rtol=0, atol=0.51 * 10.0**-DIGITS)
    assert main(["check", str(path), "--units", "q=deg"]) == 0
    assert "recordings    2" in capsys.readouterr().out
    assert "--units is for logs without log.json" in refused("check", out, "--units", "q=deg")


@pytest.mark.parametrize(
    ("change", "mapping", "said"),
    [
        ({"codebase_version": "v1.6"}, MAP, "codebase_version = 'v1.6' .. v2.x and v3.x .. convert"),
        ({"features": {"action": {}}}, MAP, "no feature 'observation.state'"),
        ({}, {"units": {"q": "deg"}}, "gripper is no joint"),
        ({}, {"units": {"q": "deg"}, "joints": {"elbow": "elbow"}}, "'elbow' is not in the log .. is it elbow_flex?"),
        ({}, {**MAP, "kp": {}}, 'pan has targets but no gain; a map gives it, {"kp": {"pan": NUMBER}}'),
    ],
)
def test_what_a_data_set_does_not_say_is_refused(
    change: dict[str, Any], mapping: dict[str, Any], said: str, tmp_path: Path
) -> None:
    """With place and remedy; of grippers, whose numbers may be shares of a range, a note says so."""
    path = _mapped(data_set(tmp_path / "set", "v3.0", change=change), mapping)
    if "gripper" in said:
        notes = open_log(_mapped(path, {**mapping, "kp": 20})).notes
        assert any(note.startswith("gripper is taken as an angle") for note in notes)
        return
    with pytest.raises(RecordingError) as refused:
        open_log(path)
    assert has_parts(str(refused.value), said), str(refused.value)


def test_files_that_are_not_there_are_said(tmp_path: Path) -> None:
    """A part of a data set is read as what it is; none of it, or a damaged file, is refused."""
    path = _mapped(data_set(tmp_path / "set", "v2.1", change={"total_episodes": 9}), MAP)
    assert any("lists 9 episodes, the files here hold 2" in note for note in open_log(path).notes)
    (path / "data" / "chunk-000" / "episode_000001.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(RecordingError, match="episode_000001.parquet: cannot be read"):
        open_log(path)
    for file in path.rglob("*.parquet"):
        file.unlink()
    with pytest.raises(RecordingError, match="no Parquet files; copy the data set with its data"):
        open_log(path)


def _mapped(path: Path, mapping: dict[str, Any]) -> Path:
    (path / "map.json").write_text(json.dumps(mapping))
    return path
