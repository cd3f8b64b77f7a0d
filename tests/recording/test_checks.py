"""Recordings that are malformed: each gets its one clear error, and nothing is written."""

import gzip
import random
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from mrwarp import cli
from mrwarp.recording import load as recording
from mrwarp.recording.column_checks import sized_currents
from mrwarp.recording.load import COLUMNS, RecordingError, load_holding, load_recording
from tests.identify.synthetic import bench_like
from tests.messages import Refused
from tests.recording.recordings import DEG, columns, write


def _edited(**changes: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], Path]:
    """A file in which columns are changed."""

    def make(folder: Path) -> Path:
        data = columns()
        return write(folder / "bad.csv", {k: changes.get(k, lambda x: x)(x) for k, x in data.items()})

    return make


def _at(row: int, value: float) -> Callable[[np.ndarray], np.ndarray]:
    def change(x: np.ndarray) -> np.ndarray:
        x = x.copy()
        x[row] = value
        return x

    return change


def _without(name: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        data = columns()
        data.pop(name)
        return write(folder / "bad.csv", data)

    return make


def _bytes(name: str, content: bytes) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        (folder / name).write_bytes(content)
        return folder / name

    return make


def _text_edit(edit: Callable[[list[str]], list[str]]) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = write(folder / "bad.csv", columns())
        path.write_text("\n".join(edit(path.read_text().splitlines())))
        return path

    return make


def _two_gigabytes(folder: Path) -> Path:
    path = folder / "bad.csv"
    with path.open("wb") as stream:
        stream.truncate(2 * 2**30)  # takes no space on the disk
    return path


def _parquet_bomb(folder: Path) -> Path:
    """Sixteen million equal rows in a small file."""
    part = pa.table({name: pa.array(np.zeros(2_000_000)) for name in COLUMNS})
    with pyarrow.parquet.ParquetWriter(folder / "bad.parquet", part.schema) as writer:
        for _ in range(8):
            writer.write_table(part)
    return folder / "bad.parquet"


def _parquet_text(folder: Path) -> Path:
    data = {name: pa.array(values) for name, values in columns().items()} | {"q": pa.array(["x"] * 200)}
    pyarrow.parquet.write_table(pa.table(data), folder / "bad.parquet")
    return folder / "bad.parquet"


def _cut_gzip(folder: Path) -> Path:
    data = gzip.compress(write(folder / "x.txt", columns()).read_bytes())
    (folder / "x.txt").unlink()
    (folder / "bad.csv.gz").write_bytes(data[: len(data) // 2])
    return folder / "bad.csv.gz"


def _swapped(folder: Path) -> Path:
    """At 1.2 Hz dq/dt is 57 times qd then, as where one is in degrees."""
    t = np.arange(400) * 0.005
    phase = 2.0 * np.pi * 1.2 * t
    q, qd = 0.3 * np.sin(phase), 0.3 * 2.0 * np.pi * 1.2 * np.cos(phase)
    return write(folder / "bad.csv", {"t": t, "q": qd, "qd": q, "current": np.ones(400), "torque": np.tanh(qd)})


REFUSED: dict[str, tuple[Callable[[Path], Path], tuple[str, ...]]] = {
    "missing column": (_without("torque"), ("'torque' is missing", "add it [N·m]")),
    "missing time": (_without("t"), ("'t' is missing",)),
    "renamed column": (
        _text_edit(lambda x: [x[0].replace("torque", "Tau"), *x[1:]]),
        ("'torque' is missing", "rename 'Tau' to 'torque'"),
    ),
    "no names": (_text_edit(lambda x: x[1:]), ("first line must name the columns",)),
    "double column": (_text_edit(lambda x: [f"{line},{line.split(',')[1]}" for line in x]), ("two columns", "'q'")),
    "NaN": (_edited(torque=_at(17, np.nan)), ("row 18", "line 19", "'torque'", "NaN", "cut it out")),
    "infinity": (_edited(current=_at(3, np.inf)), ("row 4", "'current'", "infinity")),
    "empty cell": (
        _text_edit(lambda x: [*x[:9], ",".join([*x[9].split(",")[:4], ""]), *x[10:]]),
        ("row 9", "'torque'", "empty cell"),
    ),
    "text cell": (
        _text_edit(lambda x: [*x[:9], ",".join([*x[9].split(",")[:4], "broken"]), *x[10:]]),
        ("row 9", "'torque'", "'broken' is no number"),
    ),
    "short line": (
        _text_edit(lambda x: [*x[:9], x[9].rpartition(",")[0], *x[10:]]),
        ("row 9", "line 10", "4 values for 5 columns"),
    ),
    "a mark of what was not read": (
        _edited(torque=lambda x: np.where(np.arange(200) % 40 == 9, -999.0, x)),
        ("row 10", "line 11", "'torque'", "-999 in 5 rows", "cut these rows out"),
    ),
    "marks of what was not read": (
        _edited(q=lambda x: np.where(np.arange(200) > 150, 9999.0, x)),
        ("row 152", "'q'", "9999 in 49 rows"),
    ),
    "unsigned": (
        _edited(torque=lambda x: np.rint(1e3 * x) % 65536.0),
        ("'torque'", "near 65536", "subtract 65536 from those above 32768"),
    ),
    "numbers of samples": (
        lambda folder: write(folder / "bad.csv", {**columns(), "t": np.arange(200.0)}),
        ("'t'", "1 s between samples", "numbers of samples by their rate"),
    ),
    "names with units": (
        _text_edit(lambda x: ["time (s),Angle [deg],qd,I (mA),Torque (Nm)", *x[1:]]),
        (
            "'time (s)' to 't', 'Angle [deg]' to 'q', 'I (mA)' to 'current', 'Torque (Nm)' to 'torque'",
            'declare {"q": "deg", "current": "mA"} in units.json',
        ),
    ),
    "a line of units": (
        _text_edit(lambda x: [x[0], "[s],[deg],[rad/s],[A],[N·m]", *x[1:]]),
        ("row 1", "line 2", "remove the line", 'declare {"q": "deg"} in units.json'),
    ),
    "time going backwards": (_edited(t=_at(40, 0.001)), ("row 41", "'t'", "does not increase", "sort the rows")),
    "two values of one stamp": (
        _edited(t=_at(40, 39 * 0.005)),
        ("row 41", "does not increase", "remove one of these rows"),
    ),
    "20 samples": (_text_edit(lambda x: x[:21]), ("20 samples", "at least 50")),
    "one sample": (_text_edit(lambda x: x[:2]), ("1 samples", "at least 50")),
    "names only": (_text_edit(lambda x: x[:1]), ("no samples",)),
    "nothing but gaps": (
        _text_edit(lambda x: [x[0], *(line for k, line in enumerate(x[1:]) if k % 60 < 40)]),
        ("'t'", "3 gaps", "no run of 50 samples"),
    ),
    "every other sample lost at random": (
        _text_edit(lambda x: [x[0], *(line for line in x[1:] if random.Random(line).random() < 0.5)]),
        ("'t'", "uneven sampling", "of the samples are missing"),
    ),
    "degrees": (
        lambda folder: write(
            folder / "bad.csv", {k: x * DEG if k == "q" else x for k, x in columns().items() if k != "qd"}
        ),
        ("'q'", "look like deg", '{"q": "deg"}'),
    ),
    "small degrees": (_edited(q=lambda x: 0.1 * x * DEG, qd=lambda x: 0.1 * x), ("'q'", "looks like deg", "dq/dt")),
    "degrees per second": (_edited(qd=lambda x: x * DEG), ("'qd'", "looks like deg/s")),
    "rpm": (_edited(qd=lambda x: x * 30.0 / np.pi), ("'qd'", "looks like rpm", '"qd": "rpm"')),
    "turns": (_edited(q=lambda x: x / (2.0 * np.pi)), ("'q'", "looks like rev", '"q": "rev"')),
    "milliamperes": (_edited(current=lambda x: 1e3 * x), ("'current'", "look like mA", '{"current": "mA"}')),
    "millinewtonmetres": (_edited(torque=lambda x: 1e3 * x), ("'torque'", "look like mN·m")),
    "microseconds": (_edited(t=lambda x: 1e6 * x), ("'t'", "look like microseconds", '{"t": "us"}')),
    "swapped angle and speed": (_swapped, ("are two columns swapped",)),
    "an epoch in steps of 1000 s": (
        _edited(t=lambda x: np.floor((1.79e9 + x) / 1e3) * 1e3),
        ("'t': time stands: 200 rows have 1 different stamps",),
    ),
    "an epoch in steps of half a second": (
        _edited(t=lambda x: np.floor((1.79e9 + x) / 0.5) * 0.5),
        ("'t': time stands: 200 rows have 2 different stamps",),
    ),
    "two joints": (
        _text_edit(lambda x: ["t,q1,q2,current,torque,tau2", *x[1:]]),
        ("'q' is missing", "q1, q2: a recording is of one joint"),
    ),
    "units in names": (
        _text_edit(lambda x: ["Zeit [s],Winkel [deg],qd,Strom (mA),torque", *x[1:]]),
        ("'t' is missing", "rename 'Zeit [s]' to 't'", '{"q": "deg", "current": "mA"}'),
    ),
    "units behind names": (
        _text_edit(lambda x: ["time_ms,angle_deg,qd,coil_current_mA,torque_Nm", *x[1:]]),
        ("rename 'time_ms' to 't', 'angle_deg' to 'q', 'coil_current_mA'", '{"t": "ms", "q": "deg", "current": "mA"}'),
    ),
    "a name that says its unit alone": (
        _text_edit(lambda x: ["time_ms,angle_deg,qd,coil_mA,load_Nm", *x[1:]]),
        ("'coil_mA' to 'current', 'load_Nm' to 'torque'", '"torque": "load_Nm"}'),
    ),
    "two that could be the torque": (
        _text_edit(lambda x: ["t,q,qd,current,load_Nm,brake_Nm", *x[1:]]),
        ("'torque' is missing", "add it [N·m]"),
    ),
    "milliseconds": (_edited(t=lambda x: 1e3 * x), ("'t'", "look like milliseconds")),
    "empty file": (_bytes("bad.csv", b""), ("the file is empty",)),
    "empty gzip": (_bytes("bad.csv.gz", gzip.compress(b"")), ("the file is empty",)),
    "binary file": (_bytes("bad.csv", bytes(range(256)) * 20), ("binary data", "export it as CSV")),
    "binary gzip": (_bytes("bad.csv.gz", gzip.compress(bytes(range(256)) * 20)), ("binary data",)),
    "2 GB": (_two_gigabytes, ("2.0 GiB", "512 MiB", "split it")),
    "parquet bomb": (_parquet_bomb, ("GiB", "split it")),
    "cut gzip": (_cut_gzip, ("gzip data is damaged",)),
    "not gzip": (_bytes("bad.csv.gz", b"t,q,current,torque\n"), ("not compressed with gzip",)),
    "not parquet": (_bytes("bad.parquet", b"t,q,current,torque\n" * 9), ("not a readable Parquet file",)),
    "parquet with text": (_parquet_text, ("'q'", "holds string, not numbers")),
    "unknown kind": (_bytes("bad.pdf", b"x"), ("not a known kind", ".parquet")),
    "not a sheet": (_bytes("bad.xlsx", b"x"), ("not a readable spreadsheet", "save the sheet as CSV")),
    "not MATLAB's": (_bytes("bad.mat", b"x" * 200), ("not a readable MATLAB file", "save it again")),
    "not numpy's": (_bytes("bad.npz", b"x"), ("not a readable .npz", "save it again")),
    "no file": (lambda folder: folder / "bad.csv", ("no such file or folder", "check the path")),
}


@pytest.mark.parametrize("case", list(REFUSED))
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_malformed_recording_is_refused_once_and_nothing_is_written(
    tmp_path: Path, case: str, capsys: pytest.CaptureFixture[str]
):
    """One message that names the file and what to do; exit code 2; the folder stays as it was."""
    make, parts = REFUSED[case]
    path = make(tmp_path)
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")}
    assert cli.main(["check", str(path)]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith(f"mrwarp check: {path}")
    assert len(shown.err.splitlines()) == 1
    for part in parts:
        assert part in shown.err
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")} == before


def test_compressed_bomb_is_stopped_at_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A small file that grows beyond the limit is refused after the limit, not after all of it."""
    monkeypatch.setattr(recording, "MAX_BYTES", 2**20)
    (tmp_path / "bad.csv.gz").write_bytes(gzip.compress(b"t,q,current,torque\n" + b"0,0,0,0\n" * 2**20))
    with pytest.raises(RecordingError, match="split it"):
        load_recording(tmp_path / "bad.csv.gz")


def test_limit_holds_for_all_files_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Two files that fit alone do not fit together."""
    size = write(tmp_path / "a.csv", columns()).stat().st_size
    write(tmp_path / "b.csv", columns())
    monkeypatch.setattr(recording, "MAX_BYTES", round(1.5 * size))
    assert load_recording(tmp_path / "a.csv").samples == 200
    with pytest.raises(RecordingError, match="b.csv.*split it"):
        load_recording(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "not JSON"),
        ("[1]", "must hold one object"),
        ('{"angle": "rad"}', "no column 'angle'"),
        ('{"q": "furlong"}', "'furlong' of q is not known"),
        ('{"q": "m"}', "declare torque in N"),
        ('{"trust_units": 1}', "must be true or false"),
        ("[" * 100_000, "units.json: not JSON: .*; repair or remove it"),
        ('{"q": ["deg"]}', r"the unit \['deg'\] of q is not known; use one of"),
    ],
)
def test_bad_units_file_is_refused(tmp_path: Path, content: str, message: str):
    """The message names units.json and what may stand there."""
    write(tmp_path / "a.csv", columns())
    (tmp_path / "units.json").write_text(content)
    with pytest.raises(RecordingError, match=message):
        load_recording(tmp_path / "a.csv")


def test_large_values_are_taken_when_their_unit_is_vouched_for(tmp_path: Path):
    """A joint that turns many times is no mistake when units.json says so."""
    data = columns()
    data["q"] = 20.0 * data.pop("qd")
    write(tmp_path / "a.csv", data)
    with pytest.raises(RecordingError, match="look like deg"):
        load_recording(tmp_path / "a.csv")
    (tmp_path / "units.json").write_text('{"trust_units": true}')
    assert load_recording(tmp_path / "a.csv").trajectories[0].q.max() == data["q"].max()


def test_holding_is_refused_with_the_reason(tmp_path: Path):
    """Break-away tests need both columns, numbers, and plausible units."""
    for text, message in (
        ("current,q\n1,2\n", "'torque' is missing"),
        ("current,torque\n1,2\n1,nan\n", "row 2"),
        ("current,torque\n", "no samples"),
        ("current,torque\n100,2\n500,9\n1000,20\n1500,25\n", "look like mA"),
    ):
        (tmp_path / "holding.csv").write_text(text)
        with pytest.raises(RecordingError, match=message):
            load_holding(tmp_path)


def test_a_header_nested_without_end_is_kept_as_text(tmp_path: Path) -> None:
    """A comment of 100,000 brackets is no JSON that Python can read: the recording is, and the comment stays text."""
    rows = "\n".join(f"{0.005 * k:.3f},{0.01 * k},0.5,{0.1 * k}" for k in range(60))
    path = tmp_path / "a.csv"
    path.write_text("# source: " + "[" * 100_000 + "\nt,q,current,torque\n" + rows + "\n")
    assert load_recording(path).header["source"] == "[" * 100_000


def _brake(folder: Path, units: str, scale: float, holding: str) -> Path:
    """Recordings of a brake that slides at 2.5 N·m with 1 A, in other units, and break-away tests."""
    data = columns()
    data["torque"], data["current"] = scale * 2.5 * np.tanh(data["qd"]) * data["current"], scale * data["current"]
    write(folder / "a.csv", data)
    (folder / "units.json").write_text(units)
    (folder / "holding.csv").write_text("current,torque\n" + holding)
    return folder


MILLI = '{"current": "mA", "torque": "mN·m"}'


def test_units_json_is_not_for_break_away_tests(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Recordings in mA and mN·m, break-away tests in A and N·m: both are of one brake."""
    folder = _brake(tmp_path, MILLI, 1e3, "0.25,1\n0.5,2\n1,3.4\n")
    assert load_holding(folder, load_recording(folder)).torque.tolist() == [1.0, 2.0, 3.4]
    assert cli.main(["check", str(folder)]) == 0
    assert "up to 3.4 N·m" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("holding", "parts"),
    [
        ("0.25,0.001\n0.5,0.002\n1,0.0034\n", ("'torque'", "up to 0.0034 N·m", "up to 2.4", "0.2 to 50")),
        ("0.25,100\n0.5,200\n1,299\n", ("'torque'", "up to 299 N·m", "a factor of 12")),
        ("10,1\n20,2\n40,3.4\n", ("'current'", "up to 40 A", "up to 1 A", "0.05 to 20")),
    ],
)
def test_break_away_tests_of_another_size_are_refused(
    tmp_path: Path, refused: Refused, holding: str, parts: tuple[str, ...]
):
    """0.0034 N·m of holding against 2.5 N·m of sliding: file, column, values, units and remedy; in every command."""
    folder = _brake(tmp_path, "{}", 1.0, holding)
    for command in ("check", "fit", "diagnose"):
        said = refused(command, folder, *(["--out", tmp_path / "out"] if command != "check" else []))
        for part in (f"{folder / 'holding.csv'}, column", *parts, "this file is in A and N·m regardless of units.json"):
            assert part in said
    assert not (tmp_path / "out").exists()
    (folder / "units.json").write_text('{"trust_units": true}')
    assert cli.main(["check", str(folder)]) == 0


def _lines(folder: Path, form: str = "%.6f", **more: np.ndarray) -> tuple[Path, list[str]]:
    """A file whose numbers have the same digits throughout, and its lines."""
    data = {**columns(), **more}
    rows = [",".join(form % x for x in row) for row in np.column_stack(list(data.values()))]
    return folder / "a.csv", [",".join(data), *rows]


@pytest.mark.parametrize("kept", [1, 4, 8, 14, 30])
def test_a_last_line_that_was_cut_off_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str], kept: int):
    """Within a number or between two: the line is no reading, and a note says so in every command."""
    path, lines = _lines(tmp_path)
    path.write_text("\n".join([*lines[:-1], lines[-1][:kept]]))
    found = load_recording(path)
    assert found.samples == 199 and found.repairs[0].kind == "left_out"
    assert cli.main(["check", str(path)]) == 0
    assert "the file ends within its last line" in capsys.readouterr().out


@pytest.mark.parametrize("end", ["", "\n", "\n\n"])
@pytest.mark.parametrize("form", ["%.6f", "%.6g", "%.9e", "%d"])
def test_a_whole_last_line_stays(tmp_path: Path, form: str, end: str):
    """With the line's end or without, of numbers with as many digits as the others, or of any."""
    path, lines = _lines(tmp_path, form)
    if form == "%d":  # a torque in whole mN·m, by a clock in ms
        lines[1:] = [f"{5 * k},{k % 70},{k % 7},{1000 * (k > 99)},{k % 90 - 45}" for k in range(200)]
        (tmp_path / "units.json").write_text('{"t": "ms", "current": "mA", "torque": "mN·m", "trust_units": true}')
    path.write_text("\n".join(lines) + end)
    found = load_recording(path)
    assert found.samples == 200 and not [x for x in found.repairs if x.kind == "left_out"]


@pytest.mark.parametrize(
    ("values", "words", "left"),
    [
        (lambda t: np.full(len(t), -127.0), "reads -127 degC in 200 of 200 samples", None),
        (lambda t: np.full(len(t), -999.0), "the column is left out", None),
        (lambda t: np.where(t == t[70], -127.0, 25.0 + t), "in 1 of 200 samples", (25.0, 26.0)),
        (lambda t: np.where(t < 0.02, 85.0, 25.0 + t), "reads 85 degC in 4 of 200", (25.0, 26.0)),
        (lambda t: np.where(t < 0.5, 84.0 + t, 85.0), "", (84.0, 85.0)),
        (lambda t: np.full(len(t), 85.0), "", (85.0, 85.0)),
    ],
)
def test_temperatures_of_a_sensor_that_does_not_answer(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    values: Callable[[np.ndarray], np.ndarray],
    words: str,
    left: tuple[float, float] | None,
):
    """A temperature that no bench has is none; a warm one stays."""
    data = columns()
    path = write(tmp_path / "a.csv", {**data, "temperature": values(data["t"])})
    (run,) = load_recording(path).trajectories
    assert cli.main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    assert words in out and ("the temperature reads" in out) == bool(words)
    if left is None:
        assert run.temperature is None
    else:
        assert run.temperature is not None and left[0] <= run.temperature.min() <= run.temperature.max() <= left[1]


@pytest.mark.parametrize(
    ("sign", "sized"),
    [(lambda t: -1.0, True), (lambda t: np.where(t % 2.0 < 1.0, 1.0, -1.0), True), (lambda t: 1.0, False)],
)
def test_a_negative_current_of_a_coil_counts_by_its_size(
    tmp_path: Path, sign: Callable[[np.ndarray], np.ndarray], sized: bool
) -> None:
    """Negative throughout, or a command that changes its direction: its size counts, and a note says so."""
    data = columns(1200)
    data["current"] = 0.5 + 0.5 * np.sin(3.0 * data["t"])
    data["torque"] = (0.3 + data["current"]) * np.tanh(4.0 * data["qd"])
    plain = load_recording(write(tmp_path / "plain.csv", data))
    data["current"] = data["current"] * sign(data["t"])
    found = load_recording(write(tmp_path / "signed.csv", data))
    np.testing.assert_array_equal(found.trajectories[0].current, plain.trajectories[0].current)
    assert any("which count by their size" in line for line in found.repaired()) is sized


@pytest.mark.parametrize("by_run", [True, False])
def test_a_bench_that_turns_its_current_round_counts_by_its_size(by_run: bool) -> None:
    """The paper's joint, whose hysteresis hides the motion's direction: every second run, or every half second."""
    plain = bench_like(1, runs=8, seconds=4.0)
    turned = tuple(
        replace(run, current=run.current * np.where((k if by_run else np.arange(len(run.t)) // 80) % 2, 1.0, -1.0))
        for k, run in enumerate(plain.trajectories)
    )
    found = sized_currents(replace(plain, trajectories=turned))
    assert all(
        np.array_equal(a.current, b.current) for a, b in zip(found.trajectories, plain.trajectories, strict=True)
    )
    assert [repair.kind for repair in found.repairs] == ["sized"]


@pytest.mark.parametrize("motor", [True, False])
def test_the_sign_stays_where_it_says_something(tmp_path: Path, motor: bool) -> None:
    """Of a motor whose torque follows it, and of a sensor whose zero is a little off."""
    data = columns(1200)
    data["current"] = np.sin(3.0 * data["t"]) if motor else np.where(data["t"] < 3.0, 1.0, -0.004)
    data["torque"] = (1.5 * data["current"] if motor else 0.4) + 0.1 * np.tanh(4.0 * data["qd"])
    found = load_recording(write(tmp_path / "log.csv", data))
    np.testing.assert_allclose(found.trajectories[0].current, data["current"], atol=1e-12)
    assert found.repairs == ()


def test_all_units_that_nobody_declared_are_named_at_once(tmp_path: Path) -> None:
    """One refusal with one units.json, which mends all columns when it is written as it stands."""
    data, wanted = columns(), load_recording(write(tmp_path / "plain.csv", columns()))
    (tmp_path / "log").mkdir()
    scales = {"q": DEG, "qd": DEG, "current": 1e3, "torque": 1e3}
    file = write(tmp_path / "log" / "run.csv", {name: x * scales.get(name, 1.0) for name, x in data.items()})
    with pytest.raises(RecordingError, match="q up to .* rad like deg, current up to 1000 A like mA, torque") as no:
        load_recording(file)
    declared = re.search(r"next to the file: (\{.*?\})", str(no.value))
    assert declared is not None
    (file.parent / "units.json").write_text(declared[1])
    found = load_recording(file).trajectories[0]
    for name in ("q", "qd", "current", "torque"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted.trajectories[0], name), atol=1e-9)
