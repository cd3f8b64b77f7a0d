"""The whole command on a small recording with a hidden effect, as a user runs it."""

import json
from pathlib import Path

import pytest

from benchmarks.confusion.case import make_case, write_case
from mrwarp import cli
from mrwarp.model_file import load_model

KEYS = {
    "schema", "verdict", "causes", "parameter_shift", "unexplained", "detectable", "baseline", "extended", "gain",
    "next_experiment", "seconds", "seed", "versions", "command",
}  # fmt: skip


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that the command wrote for 12 trajectories of 4 s with a strong coil lag."""
    folder = tmp_path_factory.mktemp("command")
    write_case(make_case(kind="coil_lag", level=1.5, seed=5, size="small"), folder / "data")
    assert cli.main(["diagnose", str(folder / "data"), "--out", str(folder / "out"), "--seed", "3"]) == 0
    return folder / "out"


def test_the_hidden_effect_is_named(answer: Path) -> None:
    """The token, an interval in seconds, a gain on trajectories left out, and every key of the contract."""
    result = json.loads((answer / "result.json").read_text(encoding="utf-8"))
    assert set(result) >= KEYS
    assert result["verdict"] == "named" and result["seed"] == 3
    (cause,) = result["causes"]
    assert cause["name"] == "coil_lag"
    lag = cause["parameters"]["time_constant"]
    assert lag["unit"] == "s" and 0.0 < lag["ci95"][0] < lag["value"] < lag["ci95"][1]
    assert result["gain"]["rmse_reduction"] > 0.1 and len(result["gain"]["held_out"]) == 12
    assert result["extended"]["rmse"] < result["baseline"]["rmse"]
    assert "remanence" in result["detectable"] and "coil_lag" not in result["detectable"]


def test_the_extended_model_can_be_loaded(answer: Path) -> None:
    """model.json holds the effect with the value of the result."""
    model = load_model(answer / "model.json")
    result = json.loads((answer / "result.json").read_text(encoding="utf-8"))
    assert [e.name for e in model.effects] == ["coil_lag"]
    found = result["causes"][0]["parameters"]["time_constant"]["value"]
    assert model.effects[0].parameters["time_constant"].value == pytest.approx(found)


def test_the_report_shows_it(answer: Path) -> None:
    """One page with the verdict in words, and nine pictures."""
    page = (answer / "report.html").read_text(encoding="utf-8")
    assert "The model lacks coil lag" in page
    assert page.count("<img") == len(list((answer / "pictures").iterdir())) == 9


def test_the_extended_model_is_a_known_model(answer: Path, tmp_path: Path) -> None:
    """With it as the nominal model nothing is missing any more."""
    data = answer.parent / "data"
    assert (
        cli.main(["diagnose", str(data), "--model", str(answer / "model.json"), "--out", str(tmp_path / "again")]) == 0
    )
    again = json.loads((tmp_path / "again" / "result.json").read_text(encoding="utf-8"))
    assert again["verdict"] == "none" and not again["causes"]
