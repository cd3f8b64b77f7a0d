"""Recordings: what is read is what was written."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from pyarrow import csv, parquet

from mrwarp import cli
from mrwarp.recording.load import (
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
from tests.recording.recordings import DEG, columns, write

TURN = 1.0 / (2.0 * np.pi)
"""Turns in a radian."""


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
        ({"q": "rev"}, {"q": TURN, "qd": TURN}),
        ({"q": "turns", "qd": "rpm"}, {"q": TURN, "qd": 60.0 * TURN}),
        ({"torque": "N·cm"}, {"torque": 1e2}),
        ({"torque": "kgf·cm"}, {"torque": 1e2 / 9.80665}),
        ({"torque": "lbf·ft"}, {"torque": 0.7375621492772656}),
        ({"torque": "ozf·in"}, {"torque": 16.0 / (0.0254 * 4.4482216152605)}),
    ],
)
def test_declared_units_are_converted(tmp_path: Path, declared: dict[str, str], factor: dict[str, float]):
    """Columns named in units.json are converted to rad, A, N·m, s."""
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
    """200,000 samples in one file, of the paper's 665,442: the fast reader is used, not a Python loop."""
    import time

    run = Trajectory(id="long", **columns(200_000))
    save_recording(Recording(trajectories=(run,)), tmp_path / "long.parquet")
    csv.write_csv(parquet.read_table(tmp_path / "long.parquet"), tmp_path / "long.csv")  # faster than rows by Python
    for name in ("long.parquet", "long.csv"):
        started = time.process_time()
        assert load_recording(tmp_path / name).samples == 200_000
        assert time.process_time() - started < 4.0, name  # 0.2 s on an idle core, 2 s on a busy one


# --- check ---


def test_check_explains_a_good_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Counts, rate, ranges with units, currents, header, and what to know before using it."""
    data = columns()
    data.pop("qd")
    path = write(tmp_path / "a.csv", data)
    path.write_text("# seed: 7\n" + path.read_text())
    assert cli.main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    for part in (
        "trajectories  1 of 200",
        "at 200 Hz",
        "-0.5 to 0.5 rad",
        "levels 0, 1 A; 1 changes",
        "derived from q in 1 of 1 trajectories: zero phase",
        "seed          7",
        "record several",
        "no verdict by diagnose: only 1 trajectory",
    ):
        assert part in out, part


def test_check_does_not_call_good_what_fit_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """A turned sign and one file of three with another: shown, refused by check, fit and diagnose with one reason."""
    from mrwarp.diagnose import diagnose

    for k in range(3):
        data = columns(800)
        write(tmp_path / f"{k}.csv", {**data, "torque": data["torque"] * (-1.0 if k == 1 else 1.0)})
    one = load_recording(tmp_path / "1.csv")
    for path, words in ((tmp_path / "1.csv", "drives the motion instead"), (tmp_path, "runs of opposite sign")):
        for command in ("check", "fit"):
            out = ["--out", str(tmp_path / "out")] if command == "fit" else []
            assert cli.main([command, str(path), *out]) == 2
            shown = capsys.readouterr()
            assert words in shown.err and len(shown.err.splitlines()) == 1 and ": good" not in shown.out
            assert command != "check" or "cannot be used" in shown.out
    assert not (tmp_path / "out").exists()
    assert "the torque of 1 (1 of 3) drives" in " ".join(diagnose(load_recording(tmp_path)).cannot_know)
    assert one.trajectories[0].id == "1"


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
