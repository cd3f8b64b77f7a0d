"""Robot logs are read with their units, and bad ones refused with place, value and remedy."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest

from mrwarp.cli import main
from mrwarp.recording.data import RecordingError
from mrwarp.robot_logs.robot_log import describe, load_log
from tests.messages import has_parts

SHARED = Path(__file__).resolve().parents[3] / "shared" / "robot_logs"

Columns = dict[str, np.ndarray]

STAMP = float(np.spacing(1.7e9))
"""Spacing of float64 stamps in seconds since 1970 [s]: two of them err by half of it each."""

ROUNDING = 8.0 * float(np.finfo(float).eps)
"""Relative, of a value by a factor there and another back, each a quotient."""


def good() -> tuple[dict[str, Any], Columns]:
    """A second of two joints and everything that the contract also allows."""
    t = np.arange(200) * 0.005
    q = 0.5 * np.sin(6.0 * t)
    columns: Columns = {"t": 1.7e9 + t}
    for k, joint in enumerate(("hip", "knee")):
        columns |= {f"q.{joint}": q + k, f"q_des.{joint}": q + k + 0.1, f"qd.{joint}": 3.0 * np.cos(6.0 * t)}
        columns |= {f"qd_des.{joint}": 0.0 * t, f"tau_ff.{joint}": 0.0 * t, f"tau.{joint}": 2.0 + 0.0 * t}
        columns |= {f"kp.{joint}": 20.0 + 0.0 * t, f"kd.{joint}": 1.0 + 0.0 * t, f"temperature.{joint}": 40.0 + t}
    columns |= {"current.knee": 0.0 * t + 0.5, "current_cmd.knee": 0.0 * t + 0.5, "battery": 29.0 - t}
    columns |= {"quat.w": 0.0 * t + 1.0, "quat.x": 0.0 * t, "quat.y": 0.0 * t, "quat.z": 0.0 * t}
    for axis in "xyz":
        columns |= {
            f"gyro.{axis}": 0.1 * t,
            f"acc.{axis}": 5.0 + 0.0 * t,
            f"pos.{axis}": t,
            f"vel.{axis}": 1.0 + 0.0 * t,
        }
    columns |= {"foot.left": 60.0 + 0.0 * t, "frame_id": t}
    header = {
        "robot": "two.xml", "base": "free", "joints": ["hip", "knee"], "kp": {"hip": 20.0, "knee": 20},
        "kd": {"hip": 1.0, "knee": 1.0}, "tau_is": "measured", "units": {}, "operator": {"name": "kept"},
    }  # fmt: skip
    return header, columns


def write(folder: Path, header: dict[str, Any], columns: Columns, name: str = "one.csv") -> Path:
    """A log of one recording."""
    folder.mkdir(exist_ok=True)
    (folder / "log.json").write_text(json.dumps(header))
    table = pa.table(columns)
    if name.endswith(".parquet"):
        pyarrow.parquet.write_table(table, folder / name)
    elif name.endswith(".gz"):
        with pa.CompressedOutputStream(str(folder / name), "gzip") as stream:
            pyarrow.csv.write_csv(table, stream)
    else:
        pyarrow.csv.write_csv(table, folder / name)
    return folder


@pytest.mark.parametrize("name", ["one.csv", "one.csv.gz", "one.parquet"])
def test_every_channel_of_the_contract_is_read(name: str, tmp_path: Path) -> None:
    """Stamps count from the first; unknown keys of log.json are kept, unknown columns left."""
    header, columns = good()
    log = load_log(write(tmp_path, header, columns, name))
    (run,) = log.runs
    assert run.id == "one" and run.t[0] == 0.0 and run.dt == pytest.approx(0.005, abs=STAMP)
    assert set(run.joint) == {*"q q_des qd qd_des tau_ff tau kp kd current current_cmd temperature".split()}
    assert np.isnan(run.joint["current"][:, 0]).all() and (run.joint["current"][:, 1] == 0.5).all()
    assert {k: v.shape[1] for k, v in run.base.items()} == {"quat": 4, "gyro": 3, "acc": 3, "pos": 3, "vel": 3}
    assert list(run.feet) == ["left"] and run.battery is not None and run.battery[0] == 29.0
    assert log.header["operator"] == {"name": "kept"} and log.joints == ("hip", "knee")
    assert log.kp.tolist() == [20.0, 20.0] and log.tau_is == "measured" and log.notes == ()
    assert any("hip, knee" in line for line in describe(log))


def test_a_drive_without_damping_is_told(tmp_path: Path) -> None:
    """Kd that nobody gives is 0, and that is said; a column or log.json gives it."""
    header, columns = good()
    columns = {name: column for name, column in columns.items() if not name.startswith("kd.")}
    header["kd"] = {"hip": 0.5}
    log = load_log(write(tmp_path / "a", header, columns))
    assert log.kd.tolist() == [0.5, 0.0]
    assert log.notes == ("Kd of knee is taken as 0: log.json gives none; kd of log.json does",)
    header["kd"]["knee"] = 0.0
    assert load_log(write(tmp_path / "b", header, columns)).notes == ()


def test_units_are_converted(tmp_path: Path) -> None:
    """Declarations of log.json, channel by channel."""
    header, columns = good()
    header["units"] = {"t": "ms", "q": "deg", "qd": "deg/s", "acc": "g", "tau": "mN·m", "current": "mA"}
    load = load_log(write(tmp_path / "plain", *good())).runs[0]
    columns["t"] = columns["t"] * 1e3
    for name in columns:
        factor = {"q": 180.0 / np.pi, "qd": 180.0 / np.pi, "acc": 1.0 / 9.80665, "tau": 1e3, "current": 1e3}
        columns[name] = columns[name] * factor.get(name.partition(".")[0], 1.0)
    run = load_log(write(tmp_path / "units", header, columns)).runs[0]
    for channel, values in load.joint.items():
        np.testing.assert_allclose(run.joint[channel], values, rtol=ROUNDING)
    np.testing.assert_allclose(run.base["acc"], load.base["acc"], rtol=ROUNDING)
    np.testing.assert_allclose(run.t, load.t, rtol=0, atol=2.0 * STAMP)


def _set(name: str, row: int, value: float) -> Callable[[dict, Columns], Any]:
    def change(_: dict, columns: Columns) -> None:
        columns[name] = columns[name].copy()
        columns[name][row] = value

    return change


def _drop(*names: str) -> Callable[[dict, Columns], Any]:
    return lambda _, columns: [
        columns.pop(name) for name in list(columns) if name.split(".")[0] in names or name in names
    ]


def _scale(name: str, by: float) -> Callable[[dict, Columns], Any]:
    return lambda _, columns: columns.update({k: by * v for k, v in columns.items() if k.startswith(name)})


def _header(**entries: Any) -> Callable[[dict, Columns], Any]:
    return lambda header, _: header.update(entries)


BAD: dict[str, tuple[Callable[[dict, Columns], Any], str]] = {
    "a joint without angle": (_drop("q.knee"), "one.csv .. q.knee is missing .. log the joint's angle"),
    "an unknown joint": (
        lambda _, c: c.update({"tau.kneee": c["t"]}), "one.csv, column 'tau.kneee' .. no joint 'kneee' .. is it knee?"
    ),
    "NaN": (_set("q.hip", 6, np.nan), "one.csv, row 7 (line 8), column 'q.hip' .. no number .. remove the row"),
    "infinity": (_set("tau.hip", 9, np.inf), "row 10 .. 'tau.hip' .. infinite .. leave the column out"),
    "time that stands": (
        lambda _, c: c["t"].__setitem__(50, c["t"][49]), "row 51 .. 't' .. s after .. time must increase"
    ),
    "angles in degrees": (_scale("q.", 180.0 / np.pi), "'q.hip' .. angles of up to .. \"units\": {\"q\": \"deg\""),
    "speeds in degrees": (_scale("qd.", 180.0 / np.pi), "'qd.hip' .. times .. \"units\": {\"qd\": \"deg/s\"}"),
    "a speed of the other sign": (_scale("qd.knee", -1.0), "'qd.knee' .. the other way .. change the sign"),
    "milliseconds": (
        lambda _, c: c.update(t=1000.0 * (c["t"] - c["t"][0])), "'t' .. between rows .. \"units\": {\"t\": \"ms\"}"
    ),
    "too short": (lambda _, c: c.update({k: v[:20] for k, v in c.items()}), "20 rows, 50 or more .. record longer"),
    "no command and no torque": (_drop("q_des", "tau_ff", "tau"), "no command and no torque .. add q_des.J"),
    "a torque that is the command, alone": (
        lambda h, c: (_drop("q_des", "tau_ff")(h, c), h.update(tau_is="command")),
        "no command and no torque .. estimate or measured",
    ),
    "no gain": (
        lambda h, c: (h["kp"].pop("knee"), _drop("kp")(h, c)),
        "log.json: knee has q_des but no gain .. a column kp.knee",
    ),
    "a gain of a joint that is not there": (
        _header(kp={"hip": 20.0, "knees": 1.0}), "log.json: kp of 'knees' .. no column q.knees .. is it knee?"
    ),
    "a gain that is no number": (_header(kd={"hip": "1"}), "log.json: kd of hip = '1' .. write a number"),
    "an unknown base": (_header(base="float"), "base = 'float' .. \"free\" .. \"fixed\""),
    "an unknown meaning of tau": (_header(tau_is="motor"), "tau_is = 'motor' .. allowed: command, estimate"),
    "an unknown unit": (_header(units={"q": "turns"}), "units: q in 'turns' .. allowed: rad, deg"),
    "an unknown channel's unit": (_header(units={"torque": "N·m"}), "no channel 'torque' .. channels: t, q"),
    "an orientation that is none": (_scale("quat.", 3.0), "'quat.w' .. length of 3 .. unit quaternion"),
    "half an orientation": (_drop("quat.z"), "quat.z is missing .. leave quat out"),
    "acceleration in g": (_scale("acc.", 0.11547), "'acc.z' .. is it in g? .. {\"acc\": \"g\"}"),
    "no joints": (
        lambda h, c: (h.pop("joints"), [c.pop(k) for k in list(c) if "." in k]),
        "no joint .. q.JOINT .. robot's own joint name",
    ),
    "no recordings": (lambda h, c: c.clear(), "no recordings next to log.json .. add .csv"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_bad_log_is_refused_in_one_line(case: str, tmp_path: Path) -> None:
    """The message names file, place and value, and what to do."""
    header, columns = good()
    change, said = BAD[case]
    change(header, columns)
    folder = write(tmp_path, header, columns) if columns else tmp_path
    if not columns:
        (tmp_path / "log.json").write_text(json.dumps(header))
    with pytest.raises(RecordingError) as refused:
        load_log(folder)
    message = str(refused.value)
    assert has_parts(message, said), message
    assert str(tmp_path) in message and "\n" not in message


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "log.json: is no JSON .. correct it"),
        ("[1]", "log.json: holds a list .. needed is an object"),
        ('{"robot": 3}', "log.json: robot = 3 .. as text"),
        ('{"robot": "a", "joints": ["x", "x"]}', "joints names x twice"),
    ],
)
def test_a_bad_description_is_refused(text: str, said: str, tmp_path: Path) -> None:
    """As the recordings are."""
    write(tmp_path, *good())
    (tmp_path / "log.json").write_text(text)
    with pytest.raises(RecordingError) as refused:
        load_log(tmp_path)
    assert has_parts(str(refused.value), said), str(refused.value)


def test_bad_files_can_be_left_out(tmp_path: Path) -> None:
    """By --skip-bad, with a note; without it the message offers that."""
    header, columns = good()
    write(tmp_path, header, columns, "a.csv")
    columns["t"] = columns["t"][::-1]
    write(tmp_path, header, columns, "b.csv")
    with pytest.raises(RecordingError, match="--skip-bad"):
        load_log(tmp_path)
    log = load_log(tmp_path, skip_bad=True)
    assert [run.id for run in log.runs] == ["a"] and "b.csv" in log.notes[0]


def test_lost_readings_of_slow_channels_are_filled(tmp_path: Path) -> None:
    """A marker that the cameras lost is no reason to refuse a log; the note says how many."""
    header, columns = good()
    _set("pos.x", 10, np.nan)(header, columns)
    log = load_log(write(tmp_path, header, columns))
    assert (
        log.runs[0].base["pos"][10, 0] == pytest.approx(0.05, abs=STAMP)
        and "1 missing readings of pos.x" in log.notes[0]
    )


def test_a_wheel_may_turn_on_and_on(tmp_path: Path) -> None:
    """An angle that grows in one direction is no angle in degrees."""
    header, columns = good()
    columns["q.knee"] = 60.0 * (columns["t"] - columns["t"][0])
    columns["q_des.knee"] = columns["q.knee"] + 0.1
    columns["qd.knee"] = 60.0 + 0.0 * columns["t"]
    assert load_log(write(tmp_path, header, columns)).runs


def test_check_explains_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """``mrwarp check`` knows a robot's log by its log.json."""
    write(tmp_path, *good())
    assert main(["check", str(tmp_path)]) == 0
    assert "two.xml, base free" in capsys.readouterr().out


def test_diagnose_refuses_a_robot_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Named by the log; nothing is written."""
    write(tmp_path / "log", *good())
    assert main(["diagnose", str(tmp_path / "log"), "--out", str(tmp_path / "out")]) == 2
    assert has_parts(capsys.readouterr().err, "two.xml .. --robot")
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not SHARED.is_dir(), reason="real logs lie next to the repository where they are at hand")
@pytest.mark.parametrize(
    ("name", "joints", "runs", "tau_is"), [("go2_air", 12, 5, "none"), ("double_pendulum", 2, 10, "estimate")]
)
def test_real_logs_are_read(name: str, joints: int, runs: int, tau_is: str) -> None:
    """A Go2 in the air and a torque-driven arm whose links turn more than once."""
    log = load_log(SHARED / name)
    assert (len(log.joints), len(log.runs), log.tau_is, log.notes) == (joints, runs, tau_is, ())
    assert log.seconds > 90.0 and "licence" in log.header
