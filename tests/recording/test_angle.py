"""Angles that wrap and angles that only a speed gives."""

import json
from pathlib import Path

import numpy as np
import pytest

from mrwarp import cli
from mrwarp.diagnose.data_checks import gaps
from mrwarp.identify.fit import made_motion
from mrwarp.identify.kinematics import reconstruct
from mrwarp.recording.angle import undo_jumps, unwrapped, without_brief_pulses, without_wrong_readings
from mrwarp.recording.data import UNITS
from mrwarp.recording.load import RecordingError, load_recording, save_recording
from mrwarp.recording.units import Units
from tests.recording.recordings import columns, write

TURN = 2.0 * np.pi


def _swing() -> dict[str, np.ndarray]:
    """A joint that swings by 1.3 turns, at 200 Hz for 4 s."""
    data = columns(800)
    data.pop("qd")
    return {
        **data,
        "q": 8.2 * np.sin(2.0 * np.pi * 0.5 * data["t"]) + 0.4,
        "torque": (0.5 + data["current"]) * np.tanh(np.cos(2.0 * np.pi * 0.5 * data["t"]) / 0.1),
    }


@pytest.mark.parametrize(
    ("units", "per", "lowest", "period"),
    [
        ({"q": "deg"}, 180.0 / np.pi, -180.0, 360.0),
        ({"q": "deg"}, 180.0 / np.pi, 0.0, 360.0),
        ({}, 1.0, -np.pi, TURN),
        ({}, 1.0, 0.0, TURN),
        ({"q": "counts/4096"}, 4096 / TURN, 0.0, 4096.0),
        ({"q": "counts/30000"}, 30000 / TURN, -32768.0, 65536.0),
    ],
)
def test_an_angle_that_wraps_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], units: dict[str, str], per: float, lowest: float, period: float
) -> None:
    """Degrees, radians or counts, signed or not: the swing comes back, and a note says so."""
    data = _swing()
    read = np.rint(data["q"] * per) if "counts" in units.get("q", "") else data["q"] * per
    (tmp_path / "units.json").write_text(json.dumps(units))
    path = write(tmp_path / "a.csv", {**data, "q": (read - lowest) % period + lowest})
    recording = load_recording(path)
    (run,), (repair,) = recording.trajectories, recording.repairs
    np.testing.assert_allclose(run.q - run.q[0], data["q"] - data["q"][0], atol=1.1 / max(per, 1e6 * (per < 60)))
    assert repair.kind == "unwrapped" and repair.count > 2
    assert np.abs(run.qd).max() < 2.0 * 8.2 * np.pi  # a turn left over would be 1257 rad/s
    assert cli.main(["check", str(path)]) == 0
    assert "begins again after" in capsys.readouterr().out


def test_runs_on_both_sides_of_where_a_reading_begins_again_are_in_one_turn(tmp_path: Path) -> None:
    """A joint that swings by 20 deg about 3 deg: runs begin at 350 or 10 deg, and one never reaches the border."""
    t = np.arange(400) * 0.005
    swings = [0.05 + 0.35 * np.sin(TURN * t + phase) for phase in (0.3, 3.5, 5.0)]
    swings.append(-0.2 + 0.1 * np.sin(TURN * t))
    for k, q in enumerate(swings):
        data = {**columns(400), "q": np.rad2deg(q) % 360.0}
        data.pop("qd")
        write(tmp_path / f"{k}.csv", data)
    (tmp_path / "units.json").write_text(json.dumps({"q": "deg"}))
    recording = load_recording(tmp_path)
    first = recording.trajectories[0].q - swings[0]
    assert np.rint(first[0] / TURN) * TURN == pytest.approx(first[0])
    for run, q in zip(recording.trajectories, swings, strict=True):
        np.testing.assert_allclose(run.q, q + first[0], atol=1e-9)
    assert any("moved by whole turns to where 0 is" in note for note in recording.repaired())


@pytest.mark.parametrize("wraps", [False, True])
def test_single_wrong_readings_are_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str], wraps: bool) -> None:
    """Four readings of an encoder that go off by 0.3 to 3 rad: the swing is there without them, and a note says so."""
    data, rng = _swing(), np.random.default_rng(3)
    data["q"] *= 1.0 if wraps else 0.5
    at = np.sort(rng.choice(np.arange(50, 750), 4, replace=False))
    read = data["q"] % TURN if wraps else data["q"].copy()
    read[at] += [1.5, -0.9, -3.0, 2.0]
    recording = load_recording(write(tmp_path / "a.csv", {**data, "q": read}))
    (run,), repair = recording.trajectories, recording.repairs[0]
    assert (repair.kind, repair.count) == ("replaced", 4) and repair.at == pytest.approx(tuple(data["t"][at]))
    # the middle of two neighbours is off by half of what the speed changes between them: 8.2*(pi*dt)**2/2
    np.testing.assert_allclose(run.q - run.q[0], data["q"] - data["q"][0], atol=8.2 * (np.pi * 0.005) ** 2 / 2.0 + 1e-9)
    assert run.qd_half == 2 and cli.main(["check", str(tmp_path / "a.csv")]) == 0
    assert "come back at once" in capsys.readouterr().out


def test_an_angle_that_jumps_goes_on_from_where_it_was(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An encoder that slips twice by 0.2 and -0.35 rad; quick motion, one move of a resting joint, noise stay."""
    data = _swing()
    slip = 0.2 * (np.arange(800) > 240) - 0.35 * (np.arange(800) > 600)
    recording = load_recording(write(tmp_path / "a.csv", {**data, "q": 0.3 * data["q"] + slip}))
    (run,), (repair,) = recording.trajectories, recording.repairs
    assert repair.kind == "shifted" and repair.at == pytest.approx(tuple(data["t"][[240, 600]]))
    # each jump leaves what the step differs from the mean of its neighbours: 0.3*8.2*(pi*dt)**3/2
    np.testing.assert_allclose(run.q, 0.3 * data["q"], atol=0.3 * 8.2 * (np.pi * 0.005) ** 3 + 1e-9)
    assert cli.main(["check", str(tmp_path / "a.csv")]) == 0 and "q jumps 2 times" in capsys.readouterr().out
    t, rng = data["t"], np.random.default_rng(7)
    moved = 1.0 * (t > 2.0) + 0.001 * rng.normal(size=800)
    jerk = np.where((t > 2.0) & (t < 2.1), 0.4 * np.sin(10.0 * np.pi * (t - 2.0)), 0.0)
    for q in (moved, jerk, np.zeros(800), np.round(data["q"], 1), rng.normal(size=800), np.sign(np.sin(t))):
        run = {"q": q, "t": t, "current": data["current"], "torque": data["torque"]}
        pieces, repairs = undo_jumps("a", run, Units(UNITS))
        assert run["q"] is q and pieces == [slice(0, 800)] and not repairs


@pytest.mark.parametrize("offset", [0.0, 3.0])
@pytest.mark.parametrize("seed", range(4))
def test_two_runs_in_one_file_are_taken_apart(tmp_path: Path, seed: int, offset: float) -> None:
    """By stamps that go on, with another motion from the 300th sample on: two runs as they are, and the reason."""
    data, rng, parts = columns(800), np.random.default_rng(seed), []
    for length, zero, began in ((300, 0.0, 0.0), (500, offset, 2.0)):
        t, f = np.arange(length) * 0.005, rng.uniform(0.4, 1.2)
        phase = (
            began + rng.uniform(-0.5, 0.5) - TURN * f * 1.5 * (began == 0.0)
        )  # it ends near 0, the other begins high
        q = zero + 0.6 * np.sin(TURN * f * t + phase)
        qd = 0.6 * TURN * f * np.cos(TURN * f * t + phase)
        parts.append(np.stack([q, 0.5 * np.tanh(qd / 0.2) + 0.01 * rng.normal(size=length)]))
    q, torque = np.concatenate(parts, axis=1)
    path = write(tmp_path / "a.csv", {"t": data["t"], "q": q, "current": np.zeros(800), "torque": torque})
    recording = load_recording(path)
    assert [(run.id, len(run.t)) for run in recording.trajectories] == [("a#1", 300), ("a#2", 500)]
    (repair,) = recording.repairs
    assert repair.kind == "split" and "two runs stand in one file" in repair.text
    assert np.array_equal(np.concatenate([run.q for run in recording.trajectories]), q)
    assert cli.main(["check", str(path)]) == 0


def test_a_reading_of_the_angle_that_was_stuck_is_left_out(tmp_path: Path) -> None:
    """It stands still for half a second of a swing and goes on where the joint is: nothing is moved."""
    data = _swing()
    q = 0.3 * data["q"]
    read = np.where((data["t"] > 1.1) & (data["t"] < 1.6), q[220], q)
    recording = load_recording(write(tmp_path / "a.csv", {**data, "q": read}))
    first, second = recording.trajectories
    (repair,) = recording.repairs
    assert repair.kind == "split" and "was stuck: 99 samples" in repair.text
    np.testing.assert_array_equal(first.q, q[:221])
    np.testing.assert_array_equal(second.q, q[320:])
    # a joint that rests on its count before the encoder slips is not stuck
    rests = np.where(data["t"] < 1.0, q[200], q) + 0.5 * (data["t"] > 0.7)
    run = {"q": rests, **{key: data[key] for key in ("t", "current", "torque")}}
    pieces, (repair,) = undo_jumps("a", run, Units(UNITS))
    assert repair.kind == "shifted" and pieces == [slice(0, 800)]


def test_a_channel_that_is_held_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A torque that is read at 50 Hz, in a log of 200 Hz; neither what is coarse nor what is whole is."""
    data = _swing()
    noisy = data["torque"] + 0.01 * np.random.default_rng(0).normal(size=800)
    data["q"] *= 0.5
    path = write(tmp_path / "a.csv", {**data, "torque": np.repeat(noisy[::4], 4)})
    (repair,) = load_recording(path).repairs
    assert repair.kind == "held" and "torque changes every 4 samples only, as where it is read at 50 Hz" in repair.text
    assert cli.main(["check", str(path)]) == 0 and "7.5 ms late" in capsys.readouterr().out
    counts = np.repeat(np.abs(np.arange(200) % 100 - 50.0), 4) / 100.0  # an encoder at a steady speed
    assert not [x for x in load_recording(write(tmp_path / "c.csv", {**data, "q": counts})).repairs if x.kind == "held"]
    for torque in (noisy, np.round(noisy, 1)):
        assert not load_recording(write(tmp_path / "b.csv", {**data, "torque": torque})).repairs


def test_single_wrong_samples_of_a_command_are_replaced(tmp_path: Path) -> None:
    """Eight dropouts and bit errors of a stepped command go, one of them at a step; of a measured current, too."""
    data, rng = columns(1600), np.random.default_rng(5)
    asked = np.repeat(rng.permutation([0.0, 0.4, 0.8, 1.2]), 400)
    measured = asked + 0.01 * rng.normal(size=1600)
    for name, current, tolerance in (("asked", asked, 0.0), ("measured", measured, 0.06)):
        at = np.array([60, 333, 400 if name == "asked" else 420, 702, 980, 1111, 1300, 1500])
        read = current.copy()
        read[at] += [3.0, -2.0, 8.0, -1.5, 2.5, 8.0, -2.0, 4.0]
        recording = load_recording(write(tmp_path / f"{name}.csv", {**data, "current": read}))
        (run,), (repair,) = recording.trajectories, recording.repairs
        assert repair.count == 8 and repair.at == pytest.approx(tuple(data["t"][at]))
        assert np.delete(np.abs(run.current - current), 400).max() <= tolerance
        assert abs(run.current[400] - asked[399:402].mean()) < np.ptp(asked[399:402])
        assert "8 single readings of current go off by up to 8" in recording.repaired()[0]


def test_a_command_of_any_length_is_no_wrong_reading() -> None:
    """Levels that hold for one sample and more, ramps and a step that is followed by another one stay."""
    rng = np.random.default_rng(6)
    lengths = rng.geometric(0.1, 400)
    switched = np.repeat(rng.choice([0.0, 1.0], 400), lengths)
    ramp = np.clip(np.repeat(np.arange(-20.0, 40.0), 1), 0.0, 20.0)
    ramp = np.concatenate([np.zeros(200), ramp, np.full(200, 20.0)])
    stair = np.repeat([0.0, 1.0, 2.0, 1.0], [300, 1, 300, 300])
    for x in (switched, ramp, stair, np.zeros(100)):
        assert without_brief_pulses(x)[0] is x


def test_motion_and_noise_are_no_wrong_readings() -> None:
    """A joint that rests and jerks, noise, an edge of the encoder, wraps to and fro, and too many that are off."""
    t, rng = np.arange(800) * 0.005, np.random.default_rng(4)
    jerks = np.where((t > 2.0) & (t < 2.1), 0.4 * np.sin(10.0 * np.pi * (t - 2.0)), 0.0)
    many = np.sin(t)
    many[rng.choice(799, 20, replace=False)] += 2.0
    edge = np.where(np.isin(np.arange(800), (100, 300, 301, 500)), 0.0015, 0.0) + (t > 3.0) * 0.0015
    border = (0.02 * rng.normal(size=800)) % TURN
    for x in (jerks, rng.normal(size=800), rng.standard_t(4, size=800), many, edge, np.zeros(800), border):
        assert without_wrong_readings(x, [TURN])[0] is x


def test_only_wraps_are_unwrapped() -> None:
    """Swings of less than a turn, steps, single wrong samples and noise stay as they are."""
    t = np.arange(400) * 0.005
    rng = np.random.default_rng(0)
    spike = np.sin(t)
    spike[70] += 5.0
    for q in (3.0 * np.sin(TURN * t), np.where(t < 1.0, -2.5, 2.5), spike, 2.0 * rng.normal(size=400)):
        assert unwrapped(t, q, [TURN])[1] == 0 and unwrapped(t, q, [TURN])[0] is q
    fast = 0.3 * TURN * np.arange(400)  # a shaft that turns by a third of a turn from sample to sample
    np.testing.assert_allclose(unwrapped(t, fast % TURN, [TURN])[0], fast, atol=1e-9)
    # over a gap nobody knows how often it turned: the stretches go on each for itself
    slow = 9.0 * np.sin(2.0 * t)
    keep = np.delete(np.arange(400), np.r_[70:110, 200:202])
    q, wraps, _ = unwrapped(t[keep], slow[keep] % TURN, [TURN])
    assert wraps > 0
    for part in (slice(0, 70), slice(70, None)):
        np.testing.assert_allclose(np.diff(q[part]), np.diff(slow[keep][part]), atol=1e-9)


def test_a_speed_without_an_angle_is_integrated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Speed alone, in rpm: the angle is its integral from 0, `check` says so, and the written file records it."""
    data = columns(400)
    q, rng = data.pop("q"), np.random.default_rng(1)
    (tmp_path / "units.json").write_text('{"qd": "rpm"}')
    noisy = data["qd"] + 0.05 * rng.normal(size=400)
    path = write(tmp_path / "a.csv", {**data, "qd": noisy * 60.0 / TURN})
    recording = load_recording(path)
    assert all("integrated" in said[0] for said in (gaps(recording), made_motion(recording)))
    (run,) = recording.trajectories
    assert run.q_integrated and not run.qd_derived and run.q[0] == 0.0
    np.testing.assert_allclose(run.q, q - q[0], atol=0.02)  # four standard deviations of the walk
    assert [repair.kind for repair in recording.repairs] == ["integrated"]
    assert cli.main(["check", str(path)]) == 0
    assert "there is no angle: q was integrated from qd" in capsys.readouterr().out
    save_recording(recording, tmp_path / "out" / "b.csv")
    assert load_recording(tmp_path / "out" / "b.csv").trajectories[0].q_integrated
    # what is not known by the angle is smoothed as by the speed alone
    left = reconstruct(recording).qd - data["qd"]
    assert np.std(left[20:-20]) < 0.6 * 0.05  # of white noise up to 100 Hz, 25 Hz pass: sqrt(25/100)


def test_a_speed_by_another_name_or_an_angle_by_another_is_asked_for(tmp_path: Path) -> None:
    """An angle that is there under another name is not integrated from the speed."""
    data = columns()
    q = data.pop("q")
    with pytest.raises(RecordingError, match="rename 'position' to 'q'"):
        load_recording(write(tmp_path / "a.csv", {**data, "position": q}))
    speed = data.pop("qd")
    with pytest.raises(RecordingError, match="rename 'speed' to 'qd' and it is integrated"):
        load_recording(write(tmp_path / "b.csv", {**data, "speed": speed}))


def test_times_since_1970_count_from_the_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Files of one clock keep their distance, and no place is called 1.79e+09."""
    start = 1_790_000_000.25
    for k in range(2):
        data = columns(400)
        keep = np.delete(np.arange(400), [50, 51])
        write(tmp_path / f"{k}.csv", {name: x[keep] + (start + 60.0 * k) * (name == "t") for name, x in data.items()})
    first, second = load_recording(tmp_path).trajectories
    assert first.t[0] == pytest.approx(0.25) and second.t[0] == pytest.approx(60.25)
    assert cli.main(["check", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "e+09" not in out and "it counts from 2026-09-21" in out
