"""``mrwarp diagnose``: what it writes, and that bad input or Ctrl-C leaves nothing behind."""

import json
import math
import types
from pathlib import Path

import numpy as np
import pytest

from mrwarp.cli import main
from mrwarp.commands.run_diagnose import Diagnose
from mrwarp.diagnose.report import overview_pictures
from mrwarp.diagnose.result import Diagnosis
from mrwarp.model_file import load_model, save_model
from mrwarp.nn.training import FitCfg
from mrwarp.options.command_line import option_types
from mrwarp.options.command_table import DIAGNOSE
from mrwarp.resources import DEFAULT_POLICY
from mrwarp.run_dir import write_result
from mrwarp.sysid.verdict import Suspect, Value
from tests.diagnose import made_up
from tests.messages import Refused


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A recording that can be read; what it holds does not matter here."""
    t = np.arange(100) * 0.005
    rows = "\n".join(f"{x:.3f},{np.sin(x):.6f},{np.cos(x):.6f},1.0,{np.cos(x):.6f}" for x in t)
    path = tmp_path / "run.csv"
    path.write_text(f"t,q,qd,current,torque\n{rows}\n")
    return path


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch):
    """Replaces the computation by one that answers with a made-up diagnosis; holds it and the arguments it got."""
    state = types.SimpleNamespace(diagnosis=made_up.make("named"), early=None, got={})

    def diagnose(recording, **options):
        state.got = options
        if state.early is not None and not options["answered"](state.early):
            return state.early
        if isinstance(state.diagnosis, BaseException):
            raise state.diagnosis
        options["progress"]("fitting")
        return state.diagnosis

    monkeypatch.setattr("mrwarp.diagnose.pipeline.diagnose", diagnose)
    return state


@pytest.fixture
def one_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw one picture instead of nine."""
    monkeypatch.setattr(overview_pictures, "draw", lambda d: ({"loops": b"drawn"}, []))


def test_everything_is_written(data: Path, tmp_path: Path, computed, capsys: pytest.CaptureFixture) -> None:
    """Result, report, model and pictures; the verdict is printed; the command is what was typed."""
    out = tmp_path / "out"
    argv = [str(data), "--out", str(out), "--seed", "7"]
    assert main(["diagnose", *argv]) == 0
    assert {p.name for p in out.iterdir()} == {"result.json", "report.html", "model.json", "pictures"}
    assert len(list((out / "pictures").iterdir())) == 9
    result = json.loads((out / "result.json").read_text())
    assert result["command"].startswith("mrwarp diagnose ") and "--seed 7" in result["command"]
    assert result["model"] == "model.json" and result["final"] is True
    assert load_model(out / "model.json").effects[0].name == "coil_lag"
    assert computed.got["seed"] == 7 and computed.got["model"] is None
    text = capsys.readouterr().out
    assert computed.diagnosis.sentence in text and "coil_lag.time_constant" in text and "10.00 ms" in text
    assert "fitting" in text and "s]" in text


def test_each_command_has_its_own_options(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture, refused: Refused
) -> None:
    """The help of neither names the other's, the alias says which are whose, and each refuses the other's data."""
    joint, robot = (set(option_types(DIAGNOSE[(kind,)].load())) for kind in ("joint", "robot"))
    said = (Diagnose.__doc__ or "").partition("takes ")[2].partition("Only a robot's log")
    for part, own in ((said[0], joint - robot), (said[2], robot - joint)):
        assert {word.strip(".,")[2:] for word in part.split() if word.startswith("--")} == own
    for kind, others in (("joint", robot - joint), ("robot", joint - robot)):
        assert main(["diagnose", kind, "--help"]) == 0
        text = capsys.readouterr().out
        assert text.startswith(f"usage: mrwarp diagnose {kind} ") and "--quick" in text
        assert [name for name in others if f"--{name} " in text] == []
    log = tmp_path / "log"
    log.mkdir()
    (log / "log.json").write_text("{}")
    for kind, path, other in (("joint", log, "robot"), ("robot", data, "joint")):
        error = refused("diagnose", kind, path, "--out", tmp_path / "out")
        assert error.startswith(f"mrwarp diagnose {kind}: {path}: ") and f"'mrwarp diagnose {other}'" in error
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("one_picture")
def test_data_may_be_called_as_a_command_is(
    data: Path, tmp_path: Path, computed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``diagnose joint joint`` reads the folder of that name; the command is written as it was typed."""
    (tmp_path / "joint").mkdir()
    data.rename(tmp_path / "joint" / "run.csv")
    monkeypatch.chdir(tmp_path)
    assert main(["diagnose", "joint", "joint", "--out", "out"]) == 0
    assert json.loads(Path("out/result.json").read_text())["command"] == "mrwarp diagnose joint joint --out out"


def test_the_alias_refuses_options_of_the_other_kind(data: Path, tmp_path: Path, refused: Refused) -> None:
    """One line with option, data and remedy; nothing is written."""
    log = tmp_path / "log"
    log.mkdir()
    (log / "log.json").write_text("{}")
    out = ["--out", str(tmp_path / "out")]
    joints = (["--model", "emps"], ["--predict", str(log)], ["--averaged", "0.01"], ["--impact"], ["--learn"])
    robots = (["--live"], ["--policy", str(DEFAULT_POLICY)], ["--units", "q=deg"])
    for path, options, said in (
        (log, joints, f" is for the recording of a joint; {log} is a robot's log: leave it out"),
        (data, robots, f": {data} is the recording of a joint, no robot's log; leave it out"),
    ):
        for words in options:
            assert refused("diagnose", path, *words, *out) == f"mrwarp diagnose: {words[0]}{said}\n"
    assert not (tmp_path / "out").exists()


def test_no_verdict_is_an_answer(data: Path, tmp_path: Path, computed, capsys: pytest.CaptureFixture) -> None:
    """Exit code 0, no model, and pictures of an earlier diagnosis are gone."""
    out = tmp_path / "out"
    (out / "pictures").mkdir(parents=True)
    (out / "pictures" / "evidence.png").write_bytes(b"old")
    computed.diagnosis = made_up.make(None)
    assert main(["diagnose", str(data), "--out", str(out)]) == 0
    assert {p.name for p in out.rglob("*.*")} == {"result.json", "report.html", "data.png"}
    assert json.loads((out / "result.json").read_text())["verdict"] is None
    assert "record 30 s" in capsys.readouterr().out


def test_the_nominal_model_is_not_overwritten(data: Path, tmp_path: Path, computed) -> None:
    """An output folder whose model.json is the nominal model is refused."""
    model = tmp_path / "model.json"
    save_model(made_up.make().model, model)
    before = model.read_bytes()
    assert main(["diagnose", str(data), "--model", str(model), "--out", str(tmp_path)]) == 2
    assert model.read_bytes() == before
    assert not (tmp_path / "report.html").exists()


def test_an_output_that_is_a_file_is_refused(data: Path, computed) -> None:
    """Before anything is computed."""
    assert main(["diagnose", str(data), "--out", str(data)]) == 2
    assert computed.got == {}


def test_ctrl_c_leaves_nothing(data: Path, tmp_path: Path, computed, capsys: pytest.CaptureFixture) -> None:
    """Exit code 130 and one line."""
    computed.diagnosis = KeyboardInterrupt()
    assert main(["diagnose", str(data), "--out", str(tmp_path / "out")]) == 130
    assert "nothing was written" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def early_answer() -> Diagnosis:
    """A first answer as the command gets it."""
    lag = Value(value=0.014, ci95=(math.nan, math.nan), unit="s")
    suspect = Suspect(name="coil_lag", reason="not checked", parameters={"time_constant": lag}, gain=0.5)
    sentence = "Likely: coil lag about 14 ms; not checked."
    return made_up.make(None, final=False, sentence=sentence, suspects=(suspect,), cannot_know=(), next_experiment=None)


def test_ctrl_c_keeps_the_first_answer(data: Path, tmp_path: Path, computed, capsys: pytest.CaptureFixture) -> None:
    """It is there before the verdict; nothing of an earlier diagnosis stays next to it. Exit code 130 as ever."""
    out = tmp_path / "out"
    (out / "pictures").mkdir(parents=True)
    for name in ("result.json", "model.json", "report.html", "pictures/evidence.png"):
        (out / name).write_text("old")
    computed.early, computed.diagnosis = early_answer(), KeyboardInterrupt()
    assert main(["diagnose", str(data), "--out", str(out)]) == 130
    assert f"only result.json (not final) in {out} was written" in capsys.readouterr().err
    assert {p.name for p in out.rglob("*.*")} == {"result.json"}
    result = json.loads((out / "result.json").read_text())
    assert result["final"] is False and result["verdict"] is None and result["causes"] == []
    assert result["suspects"][0]["parameters"]["time_constant"]["ci95"] == [None, None]


def test_the_verdict_takes_the_place_of_the_first_answer(
    data: Path, tmp_path: Path, computed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the end it is one file again, and final."""
    written: list[bool] = []
    monkeypatch.setattr(
        "mrwarp.sysid.verdict.write_result",
        lambda out, figures, **known: written.append(figures["final"]) or write_result(out, figures, **known),
    )
    monkeypatch.setattr(overview_pictures, "draw", lambda d: ({}, []))
    computed.early = early_answer()
    assert main(["diagnose", str(data), "--out", str(tmp_path / "out")]) == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert written == [False, True] and result["final"] is True and result["verdict"] == "named"


def test_quick_stops_at_the_first_answer(data: Path, tmp_path: Path, computed, capsys: pytest.CaptureFixture) -> None:
    """Exit code 0, one file, and the terminal says that nothing was checked."""
    computed.early, computed.diagnosis = early_answer(), AssertionError("it went on")
    out = tmp_path / "out"
    assert main(["diagnose", str(data), "--out", str(out), "--quick"]) == 0
    assert [p.name for p in out.iterdir()] == ["result.json"]
    assert json.loads((out / "result.json").read_text())["final"] is False
    text = capsys.readouterr().out
    assert "Likely: coil lag about 14 ms; not checked." in text and f"result.json (not final) in {out}" in text


def test_what_was_found_is_written_before_anything_is_drawn(
    data: Path, tmp_path: Path, computed, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """A picture that fails costs a note in all three places; Ctrl-C while drawing keeps the verdict."""
    out = tmp_path / "out"

    def fails(d):
        assert json.loads((out / "result.json").read_text())["verdict"] == "named"
        assert load_model(out / "model.json").effects and not (out / "report.html").exists()
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(overview_pictures, "MAKERS", {"loops": fails})
    assert main(["diagnose", str(data), "--out", str(out)]) == 0
    [note] = [x for x in json.loads((out / "result.json").read_text())["notes"] if "'loops'" in x]
    assert note in (out / "report.html").read_text().replace("&#39;", "'") and note in capsys.readouterr().out
    assert len(list((out / "pictures").iterdir())) == 4

    def stopped(d):
        raise KeyboardInterrupt

    monkeypatch.setattr(overview_pictures, "MAKERS", {"loops": stopped})
    assert main(["diagnose", str(data), "--out", str(out)]) == 130
    assert {p.name for p in out.rglob("*.*")} == {"result.json", "model.json"}
    assert "only result.json and model.json" in capsys.readouterr().err


@pytest.mark.usefixtures("one_picture")
def test_recordings_that_took_no_part(data: Path, tmp_path: Path, computed, capsys: pytest.CaptureFixture) -> None:
    """``--predict`` gives both models' errors there."""

    class Perfect:
        """Predicts the cosine that the recording holds, the baseline half of it."""

        def torque(self, recording):
            torque = np.concatenate([run.torque for run in recording.trajectories])
            return np.stack([0.5 * torque, torque])

    computed.diagnosis = made_up.make("named", predictor=Perfect())
    out = tmp_path / "out"
    assert main(["diagnose", str(data), "--out", str(out), "--predict", str(data)]) == 0
    [mean] = json.loads((out / "result.json").read_text())["predicted"]["mean"].values()
    assert mean["extended"] == 0.0 and mean["baseline"] > 0.1 and mean["better"] == mean["trajectories"] == 1
    assert "Recordings that took no part" in (out / "report.html").read_text()


@pytest.mark.usefixtures("one_picture")
def test_learning_tells_how_much_less_is_left(
    data: Path, tmp_path: Path, computed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The learned residual's target is smaller on top of the extension, by as much as the mismatch is."""
    from mrwarp.identify import learn as learned

    few = FitCfg(epochs=1, windows_per_epoch=256, validation_windows=256)
    monkeypatch.setattr(
        learned.left_to_learn, "__kwdefaults__", {**learned.left_to_learn.__kwdefaults__, "recipe": few}
    )
    out = tmp_path / "out"
    assert main(["diagnose", str(data), "--out", str(out), "--learn"]) == 0
    found = json.loads((out / "result.json").read_text())["learned"]
    d = computed.diagnosis
    assert found["target"] == pytest.approx([d.baseline.rmse, d.extended.rmse])
    assert found["less"] == pytest.approx(1.0 - d.extended.rmse / d.baseline.rmse)
    assert "left for the learned model" in (out / "report.html").read_text()
