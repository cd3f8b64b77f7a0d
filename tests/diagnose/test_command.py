"""The whole command on a small recording with a hidden effect, as a user runs it."""

import json
import re
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.confusion.case import make_case, write_case
from mrwarp import cli
from mrwarp.model_file import JOINT_UNITS, Parameter, load_model, parameter_unit, save_model

KEYS = {
    "schema", "verdict", "causes", "parameter_shift", "unexplained", "detectable", "baseline", "extended", "gain",
    "next_experiment", "seconds", "seed", "versions", "command",
}  # fmt: skip


@pytest.fixture(scope="module")
def answer(few_trees: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that the command wrote for 8 trajectories of 4 s with a strong coil lag."""
    folder = tmp_path_factory.mktemp("command")
    write_case(make_case(kind="coil_lag", level=1.5, seed=5, size="small"), folder / "data")
    for file in sorted((folder / "data").glob("*.csv"))[8:]:
        file.unlink()
    with (folder / "printed").open("w", encoding="utf-8") as printed, redirect_stdout(printed):
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
    assert result["gain"]["rmse_reduction"] > 0.1 and len(result["gain"]["held_out"]) == 8
    assert result["extended"]["rmse"] < result["baseline"]["rmse"]
    assert "remanence" in result["detectable"] and "coil_lag" not in result["detectable"]


def test_sentence_table_and_file_say_the_same(answer: Path) -> None:
    """One definition of error and gain: the same digits in the sentence, the table, the page and ``result.json``."""
    result = json.loads((answer / "result.json").read_text(encoding="utf-8"))
    printed = (answer.parent / "printed").read_text(encoding="utf-8")
    before, after, gain = result["baseline"], result["extended"], result["gain"]
    reduction = 100.0 * (1.0 - after["rmse"] / before["rmse"])
    assert reduction == pytest.approx(100.0 * gain["rmse_reduction"])
    assert after["nrmse"] / before["nrmse"] == pytest.approx(after["rmse"] / before["rmse"])
    low, high = (f"{100.0 * x:.1f}" for x in gain["ci95"])
    assert (
        f"falls by {reduction:.1f} % (95 %: {low} % to {high} %)" in result["sentence"]
        and result["sentence"] in printed
    )
    assert re.search(rf"baseline +\S+ \S+ +NRMSE {before['nrmse']:.2%}\n", printed)
    assert re.search(rf"with the extension +\S+ \S+ +NRMSE {after['nrmse']:.2%}\n", printed)
    assert re.search(rf"change +-{reduction:.1f} % +-{high} to -{low} %\n", printed)
    assert f"falls by {reduction:.1f} %" in (answer / "report.html").read_text(encoding="utf-8").split("gains</h2>")[1]
    assert gain["per_regime"] == result["per_regime"]
    runs = list(result["per_trajectory"].values())  # of one length
    for name, whole in (("baseline", before), ("extended", after)):
        assert (sum(run[name] ** 2 for run in runs) / len(runs)) ** 0.5 == pytest.approx(whole["rmse"], rel=0.02)


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


@pytest.mark.slow
def test_the_extended_model_is_a_known_model(answer: Path, tmp_path: Path) -> None:
    """With it as the nominal model nothing is missing any more, and its further numbers of the device stay known."""
    data, nominal = answer.parent / "data", load_model(answer / "model.json")
    further = {
        name: Parameter(value=value, unit=parameter_unit(name, JOINT_UNITS), ci95=(0.9 * value, 1.1 * value))
        for name, value in {"T_max": 3.4, "K": 0.21, "n": 2.2, "coil_resistance": 7.0, "current_max": 1.1}.items()
    }
    known = save_model(replace(nominal, parameters={**nominal.parameters, **further}), tmp_path / "known.json")
    assert cli.main(["diagnose", str(data), "--model", str(known), "--out", str(tmp_path / "again")]) == 0
    carried = load_model(tmp_path / "again" / "model.json")
    assert {name: carried.parameters[name] for name in further} == further
    assert carried.fitted_on.current == nominal.fitted_on.current is not None
    again = json.loads((tmp_path / "again" / "result.json").read_text(encoding="utf-8"))
    assert again["verdict"] == "none" and not again["causes"]


def test_a_cause_that_is_not_looked_for_or_kept_is_not_answered(
    answer: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """``--keep`` takes the true cause, ``--without`` its rival out of the first answer; what needs more is refused.

    ``test_first_answer`` shows that it is there by default.
    """
    data, out = answer.parent / "data", tmp_path / "out"
    words = ["--without", "command_delay", "--keep", "coil_lag"]
    assert cli.main(["diagnose", "joint", str(data), "--quick", "--out", str(out), *words]) == 0
    suspects = json.loads((out / "result.json").read_text())["suspects"]
    assert not {"coil_lag", "command_delay"} & {suspect["name"] for suspect in suspects}
    capsys.readouterr()
    wrong = ["--keep", "wear", "current_gain", "--out", str(tmp_path / "x")]
    assert cli.main(["diagnose", "joint", str(data), *wrong]) == 2
    assert "--keep current_gain" in capsys.readouterr().err and not (tmp_path / "x" / "result.json").exists()


@pytest.mark.slow
def test_a_kept_cause_has_its_size_in_the_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A lag of 12 ms that is kept is fitted, stated in the notes, and nothing else is missing."""
    options = ["--trajectories", "16", "--samples", "16000", "--evaluation-samples", "0", "--only", "coil_lag=0.012"]
    assert cli.main(["bench", "--out", str(tmp_path / "bench"), *options]) == 0
    out = tmp_path / "found"
    words = ["diagnose", "joint", str(tmp_path / "bench" / "fit"), "--keep", "coil_lag", "--out", str(out)]
    assert cli.main(words) == 0
    result, model = json.loads((out / "result.json").read_text()), load_model(out / "model.json")
    assert result["verdict"] == "none" and any("--keep" in note for note in result["notes"])
    lag = next(effect for effect in model.effects if effect.name == "coil_lag")
    assert lag.values["time_constant"] == pytest.approx(0.012, rel=0.05)
    assert "--keep" in capsys.readouterr().out
