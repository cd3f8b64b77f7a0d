"""Time stamps as loggers write them: what is put on an even grid, what is split, what is left out by name."""

import json
from pathlib import Path

import numpy as np
import pytest

from mrwarp import cli
from mrwarp.recording.description import describe, notes
from mrwarp.recording.load import RecordingError, load_recording
from mrwarp.recording.resample import even_pieces
from tests.recording.recordings import columns, write


def _rows(keep: np.ndarray, n: int = 400) -> dict[str, np.ndarray]:
    return {name: x[keep] for name, x in columns(n).items()}


def test_lost_samples_are_filled_in_and_named(tmp_path: Path) -> None:
    """Three of 400 samples are missing: the run is whole again, true to the motion, and says where."""
    keep = np.delete(np.arange(400), [50, 51, 200])
    recording = load_recording(write(tmp_path / "a.csv", _rows(keep)))
    (run,), (repair,) = recording.trajectories, recording.repairs
    whole = columns(400)
    assert len(run.t) == 400
    np.testing.assert_allclose(run.t, whole["t"], atol=1e-12)
    np.testing.assert_allclose(run.q, whole["q"], atol=2e-4)
    assert (repair.kind, repair.count, repair.trajectory) == ("resampled", 2, "a")
    assert repair.at == pytest.approx((0.245, 0.995)) and "3 lost samples" in repair.text


def test_samples_are_taken_at_the_time_they_were_taken() -> None:
    """Samples that came up to two intervals late are interpolated at an even grid, not shifted."""
    rng = np.random.default_rng(1)
    t = np.arange(500) * 0.01
    late = rng.choice(498, 25, replace=False) + 1
    t[late] += 0.007
    (piece,), gaps = even_pieces({"t": t, "q": np.sin(t), "current": np.zeros(500)})
    grid = piece.columns["t"]
    assert not gaps and piece.moved >= 25 and np.ptp(np.diff(grid)) < 1e-12
    assert np.abs(piece.columns["q"] - np.sin(grid)).max() < 1e-4


@pytest.mark.parametrize(("rate", "tick"), [(3000.0, 1e-3), (700.0, 1e-3), (400.0, 16e-3)])
def test_rounded_stamps_are_spread_evenly(rate: float, tick: float) -> None:
    """A clock that ticks more slowly than the samples come: the sampling interval is that of the whole run."""
    t = np.arange(3000) / rate
    (piece,), gaps = even_pieces({"t": np.floor(t / tick) * tick, "q": np.sin(t)})
    assert not gaps and piece.rounded == pytest.approx(tick)
    assert np.mean(np.diff(piece.columns["t"])) == pytest.approx(1.0 / rate, rel=2e-3)
    assert np.abs(piece.columns["t"] - t).max() < 1.1 * tick
    assert (piece.columns["q"] == np.sin(t)).all()  # only the stamps were wrong


def test_a_long_gap_splits_the_trajectory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is made up across a tenth of a second; the two parts have names of their own."""
    keep = np.delete(np.arange(400), np.arange(150, 170))
    write(tmp_path / "a.csv", _rows(keep))
    recording = load_recording(tmp_path)
    assert [(run.id, len(run.t)) for run in recording.trajectories] == [("a#1", 150), ("a#2", 230)]
    (repair,) = recording.repairs
    assert (repair.kind, repair.count, repair.at) == ("split", 1, (pytest.approx(0.745),))
    assert cli.main(["check", str(tmp_path)]) == 0
    assert "note: a: split at 1 gaps (0.105 s at 0.745 s) into 2 trajectories" in capsys.readouterr().out


def test_repeated_rows_are_left_out(tmp_path: Path) -> None:
    """A row that a logger wrote twice is one sample; an even run is otherwise as it was."""
    recording = load_recording(write(tmp_path / "a.csv", _rows(np.sort([*range(400), 7, 90]))))
    assert (recording.trajectories[0].q == columns(400)["q"]).all()
    assert recording.repairs[0].text == "2 repeated rows left out"


def test_an_even_run_is_not_touched(tmp_path: Path) -> None:
    """Stamps within half an interval stay as they are, bit for bit."""
    data = columns()
    data["t"] = data["t"] + 0.001 * np.sin(np.arange(200))
    recording = load_recording(write(tmp_path / "a.csv", data))
    assert (recording.trajectories[0].t == data["t"]).all() and recording.repairs == ()


def test_one_bad_file_of_many_is_left_out_on_request(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The refusal names the option; with it the file is left out by name, in every command and in result.json."""
    folder = tmp_path / "data"
    folder.mkdir()
    for k in range(3):
        write(folder / f"run{k}.csv", columns(400))
    (folder / "run1.csv").write_text("t,q,current,torque\n0,nan,0,0\n" + "1,0,0,0\n" * 60)
    for command in ("check", "fit", "diagnose"):
        out = [] if command == "check" else ["--out", str(tmp_path / command)]
        assert cli.main([command, str(folder), *out]) == 2
        assert "leave this file out with --skip-bad" in capsys.readouterr().err
    assert cli.main(["check", str(folder), "--skip-bad"]) == 0
    assert "note: run1.csv: left out, row 1 (line 2), column 'q': an empty cell or NaN" in capsys.readouterr().out
    assert [run.id for run in load_recording(folder, skip_bad=True).trajectories] == ["run0", "run2"]
    assert cli.main(["diagnose", str(folder), "--skip-bad", "--out", str(tmp_path / "d")]) == 0
    found = json.loads((tmp_path / "d" / "result.json").read_text())["data"]["repairs"]
    assert [(repair["trajectory"], repair["kind"]) for repair in found] == [("run1.csv", "left_out")]
    for name in ("run0", "run2"):
        (folder / f"{name}.csv").unlink()
    write(folder / "run0.csv", columns(20))
    with pytest.raises(RecordingError, match="leaves nothing"):
        load_recording(folder, skip_bad=True)


@pytest.mark.parametrize(
    ("unit", "shown", "stiffness"),
    [
        ("bar", "0 to 1 bar (pressure)", "N/(m·bar)"),
        ("%", "0 to 1 % (control input)", "N/(m·%)"),
        ("N·m", "0 to 1 N·m (load torque)", "N/(m·(N·m))"),
        ("1", "0 to 1 (control input)", "N/m"),
        ("preload steps", "0 to 1 preload steps (control input)", "N/(m·(preload steps))"),
    ],
)
def test_the_control_input_keeps_the_unit_it_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], unit: str, shown: str, stiffness: str
) -> None:
    """Bar is bar in the recording, in what is printed and in the units of parameters."""
    from mrwarp.model_file import parameter_unit

    write(tmp_path / "a.csv", columns())
    (tmp_path / "units.json").write_text(json.dumps({"q": "m", "torque": "N", "current": unit}))
    recording = load_recording(tmp_path)
    assert recording.units == {"q": "m", "current": unit, "torque": "N"}
    assert cli.main(["check", str(tmp_path)]) == 0
    assert shown in capsys.readouterr().out
    assert parameter_unit("K1", recording.units) == stiffness


def test_a_device_without_control_input_needs_no_column(tmp_path: Path) -> None:
    """Declared as having none, the column may be missing; else the refusal names that way out."""
    data = columns()
    data.pop("current")
    path = write(tmp_path / "a.csv", data)
    with pytest.raises(RecordingError, match="a device without a control input"):
        load_recording(path)
    (tmp_path / "units.json").write_text('{"current": "none", "torque": "A"}')
    recording = load_recording(path)
    assert not recording.trajectories[0].current.any()
    assert recording.units == {"q": "rad", "current": "none", "torque": "A"}
    shown = "\n".join([*describe(recording), *notes(recording)])
    assert "none: a device without a control input" in shown
    assert not any(word in shown for word in ("coil", "levels", "same current", "current is constant"))


def test_a_shaft_that_goes_round_is_no_angle_in_degrees(tmp_path: Path) -> None:
    """Ten turns at constant speed are read; a motion to and fro of that size is still refused as degrees."""
    data = columns(2000)
    data["q"], data["qd"] = 6.3 * data["t"], np.full(2000, 6.3)
    assert load_recording(write(tmp_path / "a.csv", data)).trajectories[0].q[-1] > 60.0


@pytest.mark.parametrize(
    ("kinds", "share"),
    [((4.2e-3, 10e-3), 0.16), ((10.7e-3, 20e-3), 0.2), ((10.7e-3, 20e-3), 0.5), ((5e-3, 10e-3), 0.4)],
)
def test_two_typical_intervals_are_resampled(kinds: tuple[float, float], share: float) -> None:
    """Nothing is missing where a logger takes its time by turns: as many samples, true to the motion."""
    step = np.random.default_rng(3).choice(kinds, 600, p=[1.0 - share, share])
    t = np.concatenate([[0.0], np.cumsum(step)])
    levels = np.array([0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2])
    current = levels[(t / 0.31).astype(int) % 7]
    (piece,), gaps = even_pieces({"t": t, "q": np.sin(7.0 * t), "current": current})
    grid = piece.columns["t"]
    assert not gaps and len(grid) == len(t) and piece.filled == 0 and np.ptp(np.diff(grid)) < 1e-12
    assert np.abs(piece.columns["q"] - np.sin(7.0 * grid)).max() < 2e-3
    # a command keeps its levels: none that was never asked for, and each as it was at that time, up to the stamps
    assert np.isin(piece.columns["current"], levels).all()
    wrong = piece.columns["current"] != levels[(grid / 0.31).astype(int) % 7]
    assert wrong.mean() < 0.06


@pytest.mark.parametrize("kinds", [(3e-3, 7e-3, 12e-3), (5e-3, 10e-3, 15e-3), (4e-3, 5e-3, 5e-3, 7.5e-3), None])
def test_no_sample_is_lost_where_no_clock_is(kinds: tuple[float, ...] | None) -> None:
    """Three or four typical intervals, or any from 2 to 14 ms: as many samples as were taken, at their mean rate.

    Samples lost one by one leave longer intervals, too; 5, 10 and 15 ms and none beyond are the logger's own.
    """
    rng = np.random.default_rng(6)
    step = (
        rng.choice(kinds, 700, p=[0.4, *([0.6 / (len(kinds) - 1)] * (len(kinds) - 1))])
        if kinds
        else rng.uniform(2e-3, 14e-3, 700)
    )
    t = np.concatenate([[0.0], np.cumsum(step)])
    (piece,), gaps = even_pieces({"t": t, "q": np.sin(7.0 * t), "current": np.zeros(len(t))})
    assert not gaps and piece.filled == 0 and len(piece.columns["t"]) == len(t) and "lost" not in piece.text()
    assert np.abs(piece.columns["q"] - np.sin(7.0 * piece.columns["t"])).max() < 3e-3


@pytest.mark.parametrize("stray", [0.0, 0.1, 0.3, 0.45])
def test_lost_samples_are_counted_however_stamps_stray(stray: float) -> None:
    """One sample in thirty lost by an even clock: the clock's own rate, and about as many filled in as were lost."""
    rng, n = np.random.default_rng(7), 1500
    kept = rng.random(n) > 1.0 / 30.0
    t = (np.arange(n) + rng.uniform(-stray, stray, n))[kept] * 5e-3
    (piece,), _ = even_pieces({"t": t, "q": np.sin(7.0 * t), "current": np.zeros(len(t))})
    assert piece.filled == pytest.approx(n - kept.sum(), rel=0.5)


def test_a_measured_current_is_interpolated() -> None:
    """A column that changes with every sample is no command."""
    t = np.cumsum(np.random.default_rng(4).choice([4.2e-3, 10e-3], 400))
    (piece,), _ = even_pieces({"t": t, "q": np.sin(t), "current": np.sin(5.0 * t)})
    assert np.abs(piece.columns["current"] - np.sin(5.0 * piece.columns["t"])).max() < 2e-3


@pytest.mark.parametrize("tick", [0.5e-3, None])
def test_jitter_of_a_quarter_of_an_interval_loses_no_samples(tick: float | None) -> None:
    """Stamps that stray by a quarter of an interval both ways, on a coarse clock or not: still 500 Hz, nothing lost."""
    rng, n = np.random.default_rng(5), 3000
    stray = rng.integers(-1, 2, n) * tick if tick else rng.uniform(-0.5e-3, 0.5e-3, n)
    t = np.arange(n) * 2e-3 + stray
    (piece,), _ = even_pieces({"t": t, "q": np.sin(7.0 * t), "current": np.zeros(n)})
    assert np.mean(np.diff(piece.columns["t"])) == pytest.approx(2e-3, rel=1e-3) and piece.filled <= 1
    # between two samples, at a distance of at most 3 ms, a line misses a sine by (w*dt)^2/8
    assert np.abs(piece.columns["q"] - np.sin(7.0 * piece.columns["t"])).max() < (7.0 * 3e-3) ** 2 / 8.0


@pytest.mark.parametrize("jitter", [0.05e-3, 0.3e-3])
def test_a_command_does_not_come_late_by_resampling(jitter: float) -> None:
    """On average a step lies in the middle of the two samples that show it, on the grid as in the log.

    Each lies anywhere between its two samples: the mean of S steps is known to dt/sqrt(12 S), here 0.03 of an interval.
    Held until the stamp of the second sample it was half an interval late.
    """
    rng, dt, n = np.random.default_rng(8), 2e-3, 12_000
    t = np.arange(n) * dt + rng.uniform(-jitter, jitter, n)
    steps = np.sort(rng.uniform(0.1, n * dt - 0.1, 400))
    steps = steps[np.diff(steps, prepend=0.0) > 3.0 * dt]
    current = np.searchsorted(steps, t, side="right") % 2
    t[n // 2] += 0.6 * dt  # one that came late, so that the run is resampled
    (piece,), _ = even_pieces({"t": t, "q": np.sin(7.0 * t), "current": current.astype(float)})
    seen = np.flatnonzero(np.diff(piece.columns["current"])) + 0.5
    assert piece.moved and len(seen) == len(steps)
    late = (np.interp(seen, np.arange(len(piece.columns["t"])), piece.columns["t"]) - steps).mean() / dt
    assert abs(late) < 0.1
