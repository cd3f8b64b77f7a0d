"""Angle against velocity against time: units, factors and wraps are found, and each remedy that is named works."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrwarp import cli
from mrwarp.identify.contradictions import contradictions
from mrwarp.recording.load import RecordingError, load_recording
from tests.recording.recordings import DEG, write

TURN = 2.0 * np.pi
Change = Callable[[np.ndarray], np.ndarray]


def _joint(seed: int = 0, size: float = 1.0, samples: int = 1500, rate: float = 250.0) -> dict[str, np.ndarray]:
    """A joint that swings by about ``size`` rad, with dry friction that its current changes, and noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) / rate
    waves = [(rng.uniform(0.2, 0.4), rng.uniform(0.5, 1.5), rng.uniform(0.0, TURN)) for _ in range(3)]
    q = size * sum(a * np.sin(TURN * f * t + p) for a, f, p in waves)
    qd = size * sum(TURN * f * a * np.cos(TURN * f * t + p) for a, f, p in waves)
    current = np.repeat(rng.uniform(0.0, 1.5, 10), -(-samples // 10))[:samples]
    torque = (0.4 + 1.2 * current) * np.tanh(qd / (0.05 * size)) + 0.02 * rng.normal(size=samples)
    q, qd = q + 5e-4 * size * rng.normal(size=samples), qd + 0.01 * size * rng.normal(size=samples)
    return {"t": t, "q": q, "qd": qd, "current": current, "torque": torque}


def _folder(
    path: Path, joints: list[dict[str, np.ndarray]], changes: dict[str, Change | None], units: dict[str, Any] | None
) -> Path:
    """Files of these joints in which columns are changed, or left out."""
    for k, data in enumerate(joints):
        kept = {key: x for key, x in data.items() if changes.get(key, 1) is not None}
        write(path / f"{k}.csv", {key: f(x) if (f := changes.get(key)) else x for key, x in kept.items()})
    if units is not None:
        (path / "units.json").write_text(json.dumps(units))
    return path


def _declarations(text: str) -> list[dict[str, Any]]:
    """Objects of JSON within a message."""
    found, decoder, at = [], json.JSONDecoder(), 0
    while (at := text.find("{", at)) >= 0:
        try:
            content, length = decoder.raw_decode(text[at:])
            found.append(content)
        except ValueError:
            length = 1
        at += length
    return found


def _same(path: Path, joints: list[dict[str, np.ndarray]]) -> bool:
    """Whether what is read is the joints' motion."""
    for run, data in zip(load_recording(path).trajectories, joints, strict=True):
        size, reach = float(np.sqrt(np.mean(run.qd**2) / np.mean(data["qd"] ** 2))), np.ptp(run.q) / np.ptp(data["q"])
        if abs(size - 1.0) > 0.03 or abs(reach - 1.0) > 0.02 or abs(run.dt / np.diff(data["t"]).mean() - 1.0) > 0.01:
            return False
    return True


def _wrap(length: float, low: float) -> Change:
    return lambda x: (x - low) % length + low


CASES: dict[str, tuple[float, dict[str, Change | None], dict[str, Any] | None]] = {
    "angle in degrees": (1.0, {"q": lambda x: x * DEG}, None),
    "speed in degrees": (1.0, {"qd": lambda x: x * DEG}, None),
    "degrees and rpm": (1.0, {"q": lambda x: x * DEG, "qd": lambda x: x * 60 / TURN}, None),
    "turns and rpm": (1.0, {"q": lambda x: x / TURN, "qd": lambda x: x * 60 / TURN}, {"current": "A"}),
    "declared degrees, speed in rad/s": (1.0, {"q": lambda x: x * DEG}, {"q": "deg"}),
    "milliradians": (1.0, {"q": lambda x: x * 1e3}, None),
    "counts": (1.0, {"q": lambda x: np.rint(x * 4096 / TURN)}, None),
    "counts that begin again": (20.0, {"q": lambda x: np.rint(x * 4096 / TURN) % 4096}, None),
    "degrees that begin again": (20.0, {"q": lambda x: _wrap(360.0, -180.0)(x * DEG), "qd": lambda x: x * DEG}, None),
    "degrees that begin again, no speed": (20.0, {"q": lambda x: _wrap(360.0, 0.0)(x * DEG), "qd": None}, None),
    "milliseconds of a quick log": (1.0, {"t": lambda x: x * 100.0}, None),
    "numbers of samples": (1.0, {"t": lambda x: np.arange(len(x)) * 1.0}, None),
    "microseconds": (1.0, {"t": lambda x: x * 1e6}, None),
    "a gear between both": (1.0, {"q": lambda x: x * 9.0}, None),
    "opposite signs": (1.0, {"qd": lambda x: -x}, None),
}


@pytest.mark.parametrize("size", [1.0, 3.0])
@pytest.mark.parametrize("case", list(CASES))
def test_a_remedy_that_is_named_works(tmp_path: Path, case: str, size: float) -> None:
    """The refusal's declaration, copied as it stands, gives the joint that moved."""
    swing, changes, units = CASES[case]
    joints = [_joint(k, swing * size) for k in range(2)]
    if case == "milliseconds of a quick log":
        joints = [_joint(k, size, rate=2500.0) for k in range(2)]
        changes = {"t": lambda x: x * 1e3}
    path = _folder(tmp_path, joints, changes, units)
    with pytest.raises(RecordingError) as refused:
        load_recording(path)
    found = _declarations(str(refused.value))
    assert found, str(refused.value)
    right = []
    for declared in found:
        (path / "units.json").write_text(json.dumps(declared))
        right.append(_same(path, joints))  # none is refused
    assert any(right), str(refused.value)
    if "gear" not in case:  # there nobody knows which side is the joint's
        assert right[0], str(refused.value)


@pytest.mark.parametrize("velocity", [True, False])
@pytest.mark.parametrize(("length", "low"), [(25.0, -12.5), (191.0, -95.5), (2 * TURN, 0.0), (17.3, -3.0), (TURN, 0.0)])
def test_a_reading_that_begins_again_is_found_by_its_size(
    tmp_path: Path, length: float, low: float, velocity: bool
) -> None:
    """Drives begin again at 12.5 rad or anywhere: the angle goes on, in the unit that it has."""
    joints = [_joint(k, 3.0 * length) for k in range(2)]
    changes: dict[str, Change | None] = {"q": _wrap(length, low)}
    recording = load_recording(_folder(tmp_path, joints, {**changes, **({} if velocity else {"qd": None})}, None))
    for run, data in zip(recording.trajectories, joints, strict=True):
        np.testing.assert_allclose(run.q - run.q[0], data["q"] - data["q"][0], atol=1e-6 * length)
    assert any("begins again after" in note for note in recording.repaired())


def test_an_encoder_set_to_zero_is_no_reading_that_begins_again(tmp_path: Path) -> None:
    """A jump in the middle of the motion, not from end to end, is moved back and said as one."""
    data = _joint(3)
    jumped = data["q"] + np.where(data["t"] > 2.5, 7.0, 0.0)
    (run,) = load_recording(write(tmp_path / "a.csv", {**data, "q": jumped})).trajectories
    assert np.ptp(run.q) == pytest.approx(np.ptp(data["q"]), abs=0.1)


@pytest.mark.parametrize("size", [12.0, 60.0, 250.0])
def test_many_turns_with_a_velocity_that_agrees_are_a_motor_s(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], size: float
) -> None:
    """No degrees: the columns stay, and every command says how to declare them if they are."""
    joints = [_joint(k, size) for k in range(3)]
    path = _folder(tmp_path, joints, {}, None)
    assert _same(path, joints)
    assert cli.main(["check", str(path)]) == 0
    assert '"q": "deg", "qd": "deg/s"' in capsys.readouterr().out


@pytest.mark.parametrize("factor", [1.66, 0.7, 1.2])
def test_a_factor_between_both_is_said_and_offered(tmp_path: Path, factor: float) -> None:
    """Constant over the runs: the declaration that makes them one was tried. Filters of drives leave less."""
    joints = [_joint(k) for k in range(3)]
    path = _folder(tmp_path, joints, {"qd": lambda x: x / factor}, None)
    (note,) = [repair.text for repair in load_recording(path).repairs if repair.kind == "factor"]
    first, second = _declarations(note)
    assert first["scale"]["qd"] == pytest.approx(factor, rel=0.01)
    assert second["scale"]["q"] == pytest.approx(1.0 / factor, rel=0.01)
    (path / "units.json").write_text(json.dumps(first))
    assert _same(path, joints) and not load_recording(path).repairs
    smooth = _folder(tmp_path, joints, {"qd": lambda x: np.convolve(x, np.ones(7) / 7.0, "same")}, {})
    assert not load_recording(smooth).repairs


def test_one_file_in_another_unit_keeps_the_others(tmp_path: Path) -> None:
    """A declaration for the folder would break the files that are right: the remedy is a folder of its own."""
    joints = [_joint(k) for k in range(3)]
    path = _folder(tmp_path, joints, {}, None)
    write(path / "1.csv", {**joints[1], "q": joints[1]["q"] * DEG})
    with pytest.raises(RecordingError, match=r"in a folder of its own \(the other files are right"):
        load_recording(path)


def test_a_velocity_that_shows_many_turns_of_one_file_shows_them_of_all(tmp_path: Path) -> None:
    """All files have one unit: the velocity of one of them only makes noise."""
    joints = [_joint(k, 12.0) for k in range(3)]
    noise = {**joints[0], "qd": np.random.default_rng(0).normal(size=1500)}
    path = _folder(tmp_path, [noise, *joints[1:]], {}, None)
    assert np.ptp(load_recording(path).trajectories[0].q) == pytest.approx(np.ptp(noise["q"]))
    with pytest.raises(RecordingError, match="look like deg"):
        load_recording(_folder(tmp_path, [noise] * 3, {}, None))


def test_a_shaft_that_goes_on_and_on_in_one_file_does_so_in_all(tmp_path: Path) -> None:
    """One that turns slowly goes on, too; next to a ramp in degrees, swings of that size would be in degrees."""
    t = np.arange(1500) / 250.0
    ways = [3.0 * t, -9.0 * t, 8.0 * t]
    runs = [{"t": t, "q": q, "current": np.ones(1500), "torque": 0.5 + 0.1 * np.cos(t)} for q in ways]
    found = load_recording(_folder(tmp_path, runs, {}, None)).trajectories
    assert [round(float(np.ptp(run.q))) for run in found] == [18, 54, 48]
    swing = {**runs[0], "q": 9.0 * np.sin(t)}
    with pytest.raises(RecordingError, match=r"0\.csv, column 'q'.* look like deg"):
        load_recording(_folder(tmp_path, [swing, *runs[1:]], {}, None))


def test_swapped_columns_are_exchanged_by_their_names(tmp_path: Path) -> None:
    """The declaration of the refusal reads the file as it stands."""
    joints = [_joint(k) for k in range(2)]
    path = _folder(tmp_path, [{**x, "q": x["qd"], "qd": x["q"]} for x in joints], {}, None)
    with pytest.raises(RecordingError, match="are two columns swapped") as refused:
        load_recording(path)
    (path / "units.json").write_text(json.dumps(_declarations(str(refused.value))[0]))
    assert _same(path, joints)


@pytest.mark.parametrize("times", [2, 3, 7])
@pytest.mark.parametrize("own", [False, True])
def test_rows_that_are_logged_several_times_are_thinned(tmp_path: Path, times: int, own: bool) -> None:
    """With the drive's stamp, or each with its own: one of each is used, and that is said once."""
    data = _joint(1)
    rows = {key: np.repeat(x, times) for key, x in data.items()}
    if own:
        rows["t"] = np.arange(len(rows["t"])) / (250.0 * times)
    recording = load_recording(write(tmp_path / "a.csv", rows))
    (repair,) = recording.repairs
    assert repair.kind == "thinned" and repair.count == len(rows["t"]) - len(data["t"])
    np.testing.assert_array_equal(recording.trajectories[0].q, data["q"])


def test_a_run_at_rest_is_no_jump(tmp_path: Path) -> None:
    """An encoder on its edge flips by one step: next to the motion of the other runs that is nothing."""
    joints = [_joint(k) for k in range(3)]
    rest = {**joints[0], "q": np.full(1500, 0.2), "qd": np.zeros(1500), "torque": 0.01 * np.sin(joints[0]["t"])}
    rest["q"][700:1100] += 4e-4
    recording = load_recording(_folder(tmp_path, [*joints, rest], {}, None))
    assert contradictions(recording) == []


@pytest.mark.parametrize("case", ["motor_side_rad", "rest_flip", "crash_dup_rows"])
def test_the_recordings_that_failed_are_read(shared_data: Path, capsys: pytest.CaptureFixture[str], case: str) -> None:
    """A motor's angle of thirty turns, a run at rest, and every row twice."""
    folder = shared_data / "cases" / case
    if not folder.is_dir():
        pytest.skip(f"no folder {folder}")
    assert cli.main(["check", str(folder)]) == 0
    out = capsys.readouterr().out
    assert "good" in out and out.count("one of each is used") == (case == "crash_dup_rows")
    if case == "motor_side_rad":
        assert max(np.ptp(run.q) for run in load_recording(folder).trajectories) > 30.0 * TURN
