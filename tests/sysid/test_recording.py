"""Recordings: what is read is what was written, and every malformed file gets its one clear error."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from mrwarp.sysid import check_cli, recording
from mrwarp.sysid.recording import (
    COLUMNS,
    Holding,
    Recording,
    RecordingError,
    Trajectory,
    find_holding,
    load_holding,
    load_recording,
    save_holding,
    save_recording,
)

DEG = 180.0 / np.pi


def columns(n: int = 200, dt: float = 0.005) -> dict[str, np.ndarray]:
    """A plausible trajectory."""
    t = np.arange(n) * dt
    q, qd = 0.5 * np.sin(2 * np.pi * t), np.pi * np.cos(2 * np.pi * t)
    return {"t": t, "q": q, "qd": qd, "current": np.where(t < 0.5, 0.0, 1.0), "torque": np.tanh(qd)}


def write(path: Path, data: dict[str, np.ndarray]) -> Path:
    """A CSV as any logger writes it."""
    rows = np.column_stack(list(data.values()))
    path.write_text(",".join(data) + "\n" + "\n".join(",".join(repr(float(x)) for x in row) for row in rows) + "\n")
    return path


def random_recording(seed: int) -> Recording:
    """Two trajectories of random numbers: all digits count."""
    rng = np.random.default_rng(seed)
    runs = []
    for name in ("a", "b"):
        part = {key: rng.standard_normal(60) for key in COLUMNS[1:]}
        runs.append(Trajectory(id=name, t=np.arange(60) * 0.005, **part, temperature=rng.uniform(20, 30, 60)))
    return Recording(trajectories=tuple(runs))


# --- round trip ---


@pytest.mark.parametrize("name", ["one.csv", "one.csv.gz", "one.parquet", "folder"])
def test_saved_values_load_bit_equal(tmp_path: Path, name: str):
    """Every value, id, header entry and flag survives each file type."""
    kept = random_recording(seed=0)
    header = {"seed": 3, "effects": {"coil_lag": 0.018}, "note": "a: b, °"}
    files = save_recording(kept, tmp_path / name, header=header)
    back = load_recording(tmp_path / name)
    assert all(file.is_file() for file in files)
    assert back.header == header
    ids = [run.id for run in back.trajectories]
    assert ids == ["a", "b"]
    for old, new in zip(kept.trajectories, back.trajectories, strict=True):
        for key in (*COLUMNS, "temperature"):
            assert np.array_equal(getattr(old, key), getattr(new, key)), key
        assert not new.qd_derived


def test_same_recording_gives_the_same_bytes(tmp_path: Path):
    """No time stamps in compressed files."""
    one, two = (
        save_recording(random_recording(seed=1), tmp_path / n)[0].read_bytes() for n in ("1.csv.gz", "2.csv.gz")
    )
    assert one == two


def test_folder_of_parquet_and_units_load_back(tmp_path: Path):
    """A linear damper on a voltage driver keeps its units."""
    units = {"q": "m", "current": "V", "torque": "N"}
    kept = Recording(trajectories=random_recording(seed=2).trajectories, units=units)
    save_recording(kept, tmp_path, kind=".parquet")
    assert json.loads((tmp_path / "units.json").read_text()) == units
    assert load_recording(tmp_path).units == units
    with pytest.raises(RecordingError, match="other units"):
        save_recording(random_recording(seed=2), tmp_path / "more.csv")


def test_holding_loads_back_and_is_found_beside_recordings(tmp_path: Path):
    """Break-away tests lie in the folder above the recordings, and are no recording themselves."""
    holding = Holding(current=np.linspace(0, 1.5, 7), torque=np.linspace(0, 26, 7) / 3.0, header={"seed": 1})
    file = save_holding(holding, tmp_path)
    save_recording(random_recording(seed=0), tmp_path / "fit")
    back = load_holding(tmp_path)
    assert np.array_equal(back.torque, holding.torque)
    assert np.array_equal(back.current, holding.current)
    assert back.header == {"seed": 1}
    assert find_holding(tmp_path / "fit") == file
    with pytest.raises(RecordingError, match="name one of its folders: fit"):
        load_recording(tmp_path)


# --- what is accepted ---


def test_names_that_break_lines_are_shown_on_one(tmp_path: Path):
    """A Parquet file may call its columns anything; the refusal stays one line."""
    path = tmp_path / "a.parquet"
    pyarrow.parquet.write_table(pa.table({"t": [0.0], "q": [0.0], "cu\nrrent": [0.0], "torque": [0.0]}), path)
    with pytest.raises(RecordingError, match="'current' is missing") as refusal:
        load_recording(path)
    assert "\n" not in str(refusal.value) and r"'cu\nrrent'" in str(refusal.value)


def test_missing_velocity_is_derived_and_said(tmp_path: Path):
    """Without qd it is the derivative of q, and flagged; saving and loading keeps the flag."""
    data = columns()
    truth = data.pop("qd")
    run = load_recording(write(tmp_path / "a.csv", data)).trajectories[0]
    assert run.qd_derived
    # five-point cubic at 1 Hz: relative error about (omega*dt)^4/8, larger by its window's width at the ends
    assert np.abs(run.qd - truth).max() < 0.01 * np.pi
    save_recording(Recording(trajectories=(run,)), tmp_path / "b.csv")
    assert load_recording(tmp_path / "b.csv").trajectories[0].qd_derived


def test_trajectory_column_splits_interleaved_rows(tmp_path: Path):
    """Rows of two trajectories may come in any order between them."""
    data = columns(100)
    both = {key: np.repeat(values, 2) for key, values in data.items()}
    text = write(tmp_path / "a.csv", both).read_text().splitlines()
    lines = [text[0] + ",trajectory"] + [f"{line},{'xy'[k % 2]}" for k, line in enumerate(text[1:])]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    runs = load_recording(tmp_path / "a.csv").trajectories
    assert [run.id for run in runs] == ["x", "y"]
    assert all(np.array_equal(run.q, data["q"]) for run in runs)


def test_folder_prefixes_ids_with_the_file(tmp_path: Path):
    """Each file of a folder is a trajectory called after it; units.json and other files are no recordings."""
    for name in ("b.csv", "a.csv"):
        write(tmp_path / name, columns())
    (tmp_path / "LICENSE").write_text("text")
    assert [run.id for run in load_recording(tmp_path).trajectories] == ["a", "b"]


@pytest.mark.parametrize(
    ("declared", "factor"),
    [
        ({"q": "deg", "qd": "deg/s"}, {"q": DEG, "qd": DEG}),
        ({"q": "deg"}, {"q": DEG, "qd": DEG}),
        ({"current": "mA"}, {"current": 1e3}),
        ({"torque": "mN·m"}, {"torque": 1e3}),
        ({"torque": "mNm", "t": "ms"}, {"torque": 1e3, "t": 1e3}),
    ],
)
def test_declared_units_are_converted(tmp_path: Path, declared: dict[str, str], factor: dict[str, float]):
    """What units.json names is converted to rad, A, N·m, s."""
    data = columns()
    write(tmp_path / "a.csv", {key: values * factor.get(key, 1.0) for key, values in data.items()})
    (tmp_path / "units.json").write_text(json.dumps(declared))
    got = load_recording(tmp_path / "a.csv")
    assert got.units == {"q": "rad", "current": "A", "torque": "N·m"}
    for key, values in data.items():
        np.testing.assert_allclose(getattr(got.trajectories[0], key), values, rtol=1e-14, atol=1e-15)


def test_other_rates_and_small_jitter_are_accepted(tmp_path: Path):
    """100 Hz to 3 kHz, time stamps rounded to 0.1 ms."""
    for rate in (100, 1000, 3000):
        data = columns(200, 1.0 / rate)
        data["t"] = np.round(data["t"], 4)
        assert load_recording(write(tmp_path / f"{rate}.csv", data)).trajectories[0].dt == pytest.approx(
            1 / rate, rel=1e-2
        )


def test_paper_sized_recording_loads_in_seconds(tmp_path: Path):
    """665,442 samples in one file: the fast reader is used, not a Python loop."""
    import time

    run = Trajectory(id="long", **columns(665_442))
    save_recording(Recording(trajectories=(run,)), tmp_path / "long.parquet")
    save_recording(Recording(trajectories=(run,)), tmp_path / "long.csv")
    for name in ("long.parquet", "long.csv"):
        started = time.process_time()
        assert load_recording(tmp_path / name).samples == 665_442
        assert time.process_time() - started < 4.0, name  # 0.7 s on an idle core


# --- what is refused ---


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


REFUSED: dict[str, tuple[Callable[[Path], Path], tuple[str, ...]]] = {
    "missing column": (_without("torque"), ("'torque' is missing", "add it [N·m]")),
    "missing time": (_without("t"), ("'t' is missing",)),
    "renamed column": (
        _text_edit(lambda x: [x[0].replace("torque", "Tau"), *x[1:]]),
        ("'torque' is missing", "rename 'Tau' to 'torque'"),
    ),
    "semicolons": (_text_edit(lambda x: [line.replace(",", ";") for line in x]), ("separated by commas",)),
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
    "time going backwards": (_edited(t=_at(40, 0.001)), ("row 41", "'t'", "does not increase", "sort the rows")),
    "time standing still": (_edited(t=_at(40, 39 * 0.005)), ("row 41", "does not increase")),
    "20 samples": (_text_edit(lambda x: x[:21]), ("20 samples", "at least 50")),
    "one sample": (_text_edit(lambda x: x[:2]), ("1 samples", "at least 50")),
    "names only": (_text_edit(lambda x: x[:1]), ("no samples",)),
    "gap": (_text_edit(lambda x: x[:60] + x[70:]), ("row 60", "'t'", "a gap", "split the run")),
    "degrees": (_edited(q=lambda x: x * DEG, qd=lambda x: x * DEG), ("'q'", "look like deg", '{"q": "deg"}')),
    "small degrees": (_edited(q=lambda x: 0.1 * x * DEG, qd=lambda x: 0.1 * x), ("'q'", "looks like deg", "dq/dt")),
    "degrees per second": (_edited(qd=lambda x: x * DEG), ("'qd'", "looks like deg/s")),
    "milliamperes": (_edited(current=lambda x: 1e3 * x), ("'current'", "look like mA", '{"current": "mA"}')),
    "millinewtonmetres": (_edited(torque=lambda x: 1e3 * x), ("'torque'", "look like mN·m")),
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
    "unknown kind": (_bytes("bad.xlsx", b"x"), ("not a known kind", ".parquet")),
    "no file": (lambda folder: folder / "bad.csv", ("there is no such file",)),
}


@pytest.mark.parametrize("case", list(REFUSED))
def test_malformed_recording_is_refused_once_and_nothing_is_written(
    tmp_path: Path, case: str, capsys: pytest.CaptureFixture[str]
):
    """One message that names the file and what to do; exit code 2; the folder stays as it was."""
    make, parts = REFUSED[case]
    path = make(tmp_path)
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")}
    assert check_cli.main([str(path)]) == 2
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
        ("{", "not readable as JSON"),
        ("[1]", "must hold one object"),
        ('{"angle": "rad"}', "no column 'angle'"),
        ('{"q": "furlong"}', "'furlong' of q is not known"),
        ('{"q": "m"}', "declare torque in N"),
        ('{"trust_units": 1}', "must be true or false"),
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
    data["q"], data["qd"] = 20.0 * data["t"], np.full(200, 20.0)
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


# --- check ---


def test_check_explains_a_good_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Counts, rate, ranges with units, currents, header, and what to know before using it."""
    data = columns()
    data.pop("qd")
    data["torque"] = -data["torque"]
    path = write(tmp_path / "a.csv", data)
    path.write_text("# seed: 7\n" + path.read_text())
    assert check_cli.main([str(path)]) == 0
    out = capsys.readouterr().out
    for part in (
        "trajectories  1 of 200", "at 200 Hz", "-0.5 to 0.5 rad", "levels 0, 1 A; 1 changes",
        "derived from q in 1 of 1 trajectories: zero phase", "seed          7", "flip its sign", "record several",
    ):  # fmt: skip
        assert part in out, part


# --- public sets ---


@pytest.mark.parametrize(
    ("name", "trajectories", "currents", "amplitude"),
    [
        ("mr_utfsm", 33, {0.0, 0.25, 0.5, 0.75, 1.0}, 0.0275),
        ("mr_utfsm_earthquake", 5, {0.2, 0.4, 0.6, 0.8, 1.0}, 0.0073),
        ("emps", 5, {0.0}, 0.123),
    ],
)
def test_public_set_loads(shared_data: Path, name: str, trajectories: int, currents: set[float], amplitude: float):
    """The real recordings follow the contract: linear, no velocity channel, known currents and stroke."""
    folder = shared_data / "data" / name
    if not folder.is_dir():
        pytest.skip(f"no folder {folder}")
    got = load_recording(folder)
    assert len(got.trajectories) == trajectories
    assert got.units == {"q": "m", "current": "A", "torque": "N"}
    assert all(run.qd_derived for run in got.trajectories)
    assert {float(x) for run in got.trajectories for x in np.unique(run.current)} == currents
    stroke = max(float(np.ptp(run.q)) for run in got.trajectories) / 2
    assert stroke == pytest.approx(amplitude, rel=0.25)


def test_a_header_nested_without_end_is_kept_as_text(tmp_path: Path) -> None:
    """A comment of 100,000 brackets is no JSON that Python can read: the recording is, and the comment stays text."""
    rows = "\n".join(f"{0.005 * k:.3f},{0.01 * k},0.5,{0.1 * k}" for k in range(60))
    path = tmp_path / "a.csv"
    path.write_text("# source: " + "[" * 100_000 + "\nt,q,current,torque\n" + rows + "\n")
    assert load_recording(path).header["source"] == "[" * 100_000
    (tmp_path / "units.json").write_text("[" * 100_000)
    with pytest.raises(RecordingError, match=r"units.json: not readable as JSON .*; repair or remove it"):
        load_recording(path)
    (tmp_path / "units.json").write_text('{"q": ["deg"]}')
    with pytest.raises(RecordingError, match=r"the unit \['deg'\] of q is not known; use one of"):
        load_recording(path)
