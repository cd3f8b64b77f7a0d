"""Units that people declare: encoder counts, near misses, and values that are believed because they were declared."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrwarp import cli
from mrwarp.recording.load import RecordingError, load_recording
from tests.recording.recordings import columns, write


def _declared(folder: Path, data: dict[str, np.ndarray], units: dict[str, Any]) -> Path:
    (folder / "units.json").write_text(json.dumps(units))
    return write(folder / "a.csv", data)


@pytest.mark.parametrize(
    ("unit", "meant"),
    [
        ("milliamp", "mA"),
        ("Milliamperes", "mA"),
        ("miliamp", "mA"),
        ("ma", "mA"),
        ("amps", "A"),
        ("Volt", "V"),
        ("PSI", "psi"),
        ("Nm", "N·m"),
        ("None", "none"),
        ("milli amps", "mA"),
        ("m-A", "mA"),
        ("[mA]", "mA"),
        ("A rms", "A"),
        ("mA_cmd", "mA"),
        ("microamp", "uA"),
        ("kilovolt", "kV"),
    ],
)
def test_a_unit_near_a_known_one_is_asked_back(tmp_path: Path, unit: str, meant: str) -> None:
    """Nobody's unit is called milliamp: the question names what was meant, and the way out where it is one."""
    path = _declared(tmp_path, columns(), {"current": unit})
    with pytest.raises(RecordingError, match=f"did you mean {meant}.*trust_units"):
        load_recording(path)
    _declared(tmp_path, columns(), {"current": unit, "trust_units": True})
    assert load_recording(path).units["current"] == unit


@pytest.mark.parametrize(
    "unit", ["bar", "%", "V", "psi", "steps", "preload steps", "barg", "pwm", "gauss", "mbar", "1", "a.u.", "% duty"]
)
def test_a_unit_of_its_own_is_taken(tmp_path: Path, unit: str) -> None:
    """A control input may be in anything that is not nearly a known unit."""
    assert load_recording(_declared(tmp_path, columns(), {"current": unit})).units["current"] == unit


@pytest.mark.parametrize(("unit", "times", "base"), [("uA", 1e-6, "A"), ("µA", 1e-6, "A"), ("kV", 1e3, "V")])
def test_further_multiples_are_converted(tmp_path: Path, unit: str, times: float, base: str) -> None:
    """A microampere is no unit of its own."""
    plain, scaled = columns(), columns()
    scaled["current"] = plain["current"] / times
    found = load_recording(_declared(tmp_path, scaled, {"current": unit}))
    assert found.units["current"] == base
    np.testing.assert_allclose(found.trajectories[0].current, plain["current"], rtol=1e-6)  # seven digits in the file


@pytest.mark.parametrize(
    ("declared", "meant"),
    [({"torque": "oz-in"}, "ozf·in?"), ({"torque": "kg-cm"}, "kgf·cm?"), ({"torque": "ft-lb"}, "lbf·ft?"),
     ({"q": "revolutions"}, "rev?"), ({"qd": "RPM"}, "rpm?"), ({"qd": "rps"}, "rev/s?"), ({"q": "radians"}, "rad")],
)  # fmt: skip
def test_a_servo_s_unit_by_another_name_is_asked_back(tmp_path: Path, declared: dict[str, str], meant: str) -> None:
    """The question names the unit that was meant, not one that is a hundred times as large."""
    with pytest.raises(RecordingError, match=re.escape(f"did you mean {meant}")):
        load_recording(_declared(tmp_path, columns(), declared))


@pytest.mark.parametrize(
    "units",
    [
        {"q": "counts", "counts_per_revolution": 4096},
        {"q": "counts/4096"},
        {"counts_per_revolution": 4096},
        {"q": "ticks", "counts_per_revolution": 4096.0},
    ],
)
def test_encoder_counts_are_converted(tmp_path: Path, units: dict[str, Any]) -> None:
    """Counts of a declared size are an angle; the velocity, where there is one, follows in counts per second."""
    data, per = columns(), 4096.0 / (2.0 * np.pi)
    counted = {**data, "q": np.rint(data["q"] * per), "qd": data["qd"] * per}
    run = load_recording(_declared(tmp_path, counted, units)).trajectories[0]
    np.testing.assert_allclose(run.q, data["q"], atol=0.51 / per)
    np.testing.assert_allclose(run.qd, data["qd"], rtol=1e-9)


def test_counts_of_a_linear_scale_are_converted(tmp_path: Path) -> None:
    """A scale of 200,000 counts per metre gives metres."""
    data = columns()
    counted = {**data, "q": np.rint(2e3 * data["q"]), "qd": 2e3 * data["qd"]}
    units = {"q": "counts", "counts_per_metre": 200_000, "torque": "N"}
    recording = load_recording(_declared(tmp_path, counted, units))
    assert recording.units["q"] == "m"
    np.testing.assert_allclose(recording.trajectories[0].q, 0.01 * data["q"], atol=0.51 / 200_000)


@pytest.mark.parametrize(
    ("units", "words"),
    [
        ({"q": "counts"}, "how many are there in one revolution.*counts_per_revolution"),
        ({"q": "counts", "counts_per_revolution": 0}, "must be a number above 0"),
        ({"q": "counts", "counts_per_revolution": "many"}, "must be a number above 0"),
        ({"q": "deg", "counts_per_revolution": 4096}, "do not go with these units"),
    ],
)
def test_counts_without_their_size_are_asked_back(tmp_path: Path, units: dict[str, Any], words: str) -> None:
    """Nobody can guess the size of a count."""
    with pytest.raises(RecordingError, match=words):
        load_recording(_declared(tmp_path, columns(), units))


def test_whole_numbers_of_a_large_angle_are_asked_about_as_counts(tmp_path: Path) -> None:
    """Undeclared counts are no degrees for certain: the refusal names both."""
    data = columns()
    data.pop("qd")
    with pytest.raises(RecordingError, match="encoder counts.*counts_per_revolution"):
        load_recording(write(tmp_path / "a.csv", {**data, "q": np.rint(2000.0 * data["q"])}))


@pytest.mark.parametrize("units", [{"q": "deg"}, {"q": "rad", "trust_units": True}])
def test_a_declared_unit_is_believed(tmp_path: Path, capsys: pytest.CaptureFixture[str], units: dict[str, Any]) -> None:
    """A screw that turns fifteen times to and fro, or on and on, is one; no note asks for what was declared."""
    data, scale = columns(2000), 180.0 / np.pi if units["q"] == "deg" else 1.0
    swing = {**data, "q": 190.0 * scale * data["q"], "qd": 190.0 * scale * data["qd"]}
    (tmp_path / "swing").mkdir()
    load_recording(_declared(tmp_path / "swing", swing, units))
    on = {
        **data,
        "q": 40.0 * scale * data["t"],
        "qd": np.full(2000, 40.0 * scale),
        "torque": 0.5 + 0.5 * data["current"] + 0.05 * np.sin(7.0 * data["t"]),
    }
    assert cli.main(["check", str(_declared(tmp_path, on, units))]) == 0
    out = capsys.readouterr().out
    assert "turns in one direction: taken as a shaft that goes round" in out and "; declare" not in out


def test_a_number_that_no_unit_explains_is_refused(tmp_path: Path) -> None:
    """Also where the unit is declared: a damaged cell is no reading."""
    data = columns()
    data["torque"][17] = 1e250
    with pytest.raises(RecordingError, match="row 18.*'torque': 1e\\+250 is no measurement"):
        load_recording(_declared(tmp_path, data, {"torque": "N·m"}))


def test_the_screw_drive_is_read(shared_data: Path) -> None:
    """A lead screw in declared units that turns many times."""
    folder = shared_data / "cases" / "screw_drive"
    if not folder.is_dir():
        pytest.skip(f"no folder {folder}")
    recording = load_recording(folder)
    assert len(recording.trajectories) == 34 and recording.repairs == ()


def test_a_column_of_another_name_is_declared_as_the_message_says(tmp_path: Path) -> None:
    """A unit for the file's own name is refused; the declaration that is printed reads the file."""
    data = columns()
    data["my_tau"] = data.pop("torque")
    path = _declared(tmp_path, data, {"my_tau": "N·m"})
    with pytest.raises(RecordingError, match="there is no column 'my_tau'") as refused:
        load_recording(path)
    (tmp_path / "units.json").write_text(str(refused.value).partition("; write ")[2])
    assert load_recording(path).units["torque"] == "N·m"
