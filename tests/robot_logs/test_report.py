"""Verdict, page, pictures and rerun view, made once from an arm's log with a heavier lower arm."""

import contextlib
import io
import json
import re
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader

from mrwarp.cli import main
from mrwarp.robot_logs import robot_diagnosis, robot_proof
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.sysid.settings import Settings
from tests.robot_logs.arm_log import arm_log


@dataclass(frozen=True, kw_only=True)
class Written:
    """Output of the command."""

    folder: Path
    printed: str
    corrections: list[np.ndarray]
    """Parameters by which windows were replayed for errors, each (W, P)."""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """The command's output."""
    folder, corrections, losses = tmp_path_factory.mktemp("report"), [], robot_proof.losses

    def heavier(model) -> None:  # noqa: ANN001
        body = model.body("lower").id
        model.body_inertia[body] *= (model.body_mass[body] + 0.15) / model.body_mass[body]
        model.body_mass[body] += 0.15

    log = arm_log(folder / "log", seconds=8.0, change=heavier)
    out = folder / "out"
    words = ["diagnose", str(log), "--out", str(out), "--rrd", str(folder / "view.rrd")]
    with pytest.MonkeyPatch.context() as patched, contextlib.redirect_stdout(io.StringIO()) as printed:
        patched.setattr(robot_proof, "losses", lambda *args: corrections.append(args[-1]) or losses(*args))
        assert main(words) == 0
    return Written(folder=folder, printed=printed.getvalue(), corrections=corrections)


def test_the_command_writes_a_verdict_with_the_place_of_a_cause(written: Written) -> None:
    """A lower arm of 150 g more than described; keys as of a joint's verdict; errors of parts that took no part.

    Its mass is as well known as all drives' torques are relative to all masses, which a robot that is held does not
    show.
    """
    result = json.loads((written.folder / "out" / "result.json").read_text())
    assert result["sentence"] in written.printed
    keys = {"verdict", "sentence", "causes", "suspects", "unexplained", "cannot_know", "baseline", "extended", "gain"}
    assert keys <= set(result)
    assert set(result["per_channel"]) == {"q", "qd"}
    parts = np.unique(written.corrections[-1], axis=0)
    assert len(parts) == Settings().robot.parts  # each one is from the others
    assert result["per_channel"]["q"]["extended"] < 0.2 * result["per_channel"]["q"]["baseline"]
    assert result["next_experiment"]["what"] in "".join(result["cannot_know"])
    assert result["verdict"] == "named"
    cause = result["causes"][0]
    assert (cause["name"], cause["where"]) == ("link_mass", "lower")
    mass = cause["parameters"]["mass"]
    low, high = mass["ci95"]
    # all drives' torques and all masses are relative to each other, and healthy torques scatter by a tenth
    assert low < 0.15 < high < low + 0.5 * 0.15
    assert result["sentence"] == f"lower: {mass['value']:.3g} kg heavier."
    robot = mujoco.MjModel.from_xml_path(str(written.folder / "out" / "robot.xml"))
    # the file holds six digits
    assert robot.body("lower").mass[0] == pytest.approx(0.5 + cause["parameters"]["mass"]["value"], rel=1e-5)


def test_the_page_says_first_what_is_wrong_and_where(written: Written) -> None:
    """Sentence, number with interval and the map come before anything else; nothing is loaded from elsewhere."""
    page = (written.folder / "out" / "report.html").read_text()
    result = json.loads((written.folder / "out" / "result.json").read_text())
    cause = result["causes"][0]
    said = result["sentence"].partition(";")[0].rstrip(".")
    assert said.startswith(f"{cause['where']}: ") and said.endswith(" kg heavier")
    assert page.index(said) < page.index('id="where"') < page.index("What it is, and where")
    assert "95 %" in page[: page.index('id="where"')]
    for heading in ("Error before and after", "What cannot be known from this log", "Method"):
        assert heading in page
    assert "shoulder" in page and "elbow" in page and "the robot&#39;s base is fixed" in page
    assert re.findall(r'(?:src|href)="(?!data:)', page) == []


def test_the_pictures_are_files_too(written: Written) -> None:
    """Where, errors and a trace, as PNG."""
    for name in ("where", "errors", "trace"):
        assert (written.folder / "out" / "pictures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_both_robots_stand_side_by_side_in_rerun(written: Written) -> None:
    """Poses of both over time, the link in question in its colour on both, the mismatch of each joint."""
    stream = RrdReader(written.folder / "view.rrd").stream()
    chunks = [(c.entity_path, c.is_static, c.to_record_batch()) for c in stream]
    rows = {path: sum(t.num_rows for p, still, t in chunks if p == path and not still) for path, _, _ in chunks}
    moving = [f"/{robot}/{body}" for robot in ("logged", "simulated") for body in ("upper", "lower")]
    assert min(rows[path] for path in (*moving, "/mismatch/shoulder", "/mismatch/elbow")) > 100
    colors = {}
    for path, _, table in chunks:
        for name in table.schema.names:
            if "colors" in name and path.endswith("/link"):
                colors[path] = table.column(name).to_pylist()[0]
    assert colors["/logged/lower/link"] == colors["/simulated/lower/link"] == [0xEB7E1EFF]


def test_the_first_answer_of_a_log(written: Written, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """``--quick`` ends with it: the fault that stands out, its place and size; no robot, and the robot's file stays."""
    log, out = written.folder / "log", tmp_path / "out"
    out.mkdir()
    robot = out / "robot.xml"
    robot.write_bytes((log / "arm.xml").read_bytes())
    (out / "robot.usda").write_text("of an earlier diagnosis")
    assert main(["diagnose", str(log), "--robot", str(robot), "--out", str(out), "--quick"]) == 0
    assert sorted(p.name for p in out.iterdir()) == ["result.json", "robot.xml"]
    result = json.loads((out / "result.json").read_text())
    assert result["final"] is False and result["verdict"] is None and result["causes"] == []
    best = result["suspects"][0]
    assert best["name"] == "link_mass" and best["reason"].startswith("at lower: ")
    # by derivatives about the robot as described, before anything else is fitted: to a third
    assert best["parameters"]["mass"]["value"] == pytest.approx(0.15, rel=1 / 3)
    text = capsys.readouterr().out
    assert "likely: lower: " in text and "; checking" in text and "result.json (not final)" in text


def test_the_first_answer_names_what_descriptions_rarely_know(tmp_path: Path) -> None:
    """Dry friction of the elbow, three times the description's, to a third."""

    def rubs(model: mujoco.MjModel) -> None:
        model.dof_frictionloss[1] += 0.3

    log = load_log(arm_log(tmp_path, seconds=3.0, change=rubs))
    [best] = robot_diagnosis.diagnose_log(tmp_path / "arm.xml", log, answered=lambda _: False).suspects
    assert best.name == "coulomb_friction" and best.reason.startswith("at elbow: ")
    assert best.parameters["torque"].value == pytest.approx(0.3, rel=1 / 3)


def test_ctrl_c_keeps_the_first_answer_of_a_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """Exit code 130."""

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(robot_diagnosis, "fitted", stopped)
    log, out = arm_log(tmp_path / "log", seconds=3.0), tmp_path / "out"
    assert main(["diagnose", str(log), "--out", str(out)]) == 130
    assert "only result.json (not final)" in capsys.readouterr().err
    assert json.loads((out / "result.json").read_text())["final"] is False and len(list(out.iterdir())) == 1
