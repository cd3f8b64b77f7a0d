"""A file of another kind than the option's is named as what it is, before anything is loaded."""

import json
from pathlib import Path

import pytest

from mrwarp.options.file_kinds import kind_of
from tests.messages import Refused

RESULT = {"schema": 1, "conditions": [], "seed": 0, "versions": {"python": "3.11"}, "command": "mrwarp walk --trials 1"}
FILES = {
    "result.json": (RESULT, "the result.json of 'mrwarp walk'"),
    "policy.json": ({"plant": "go1", "task": {}, **RESULT}, "the record of a policy's training"),
    "log.json": ({"robot": "arm.xml", "base": "fixed", "joints": ["a"]}, "the log.json of a robot's log"),
    "units.json": ({"q": "deg", "current": "mA"}, "the units.json of a recording"),
    "numbers.json": ({"electrical": {"electronics": 20.0}}, "a numbers.json of the energy model"),
}


def put(folder: Path, name: str) -> Path:
    """One of the files."""
    path = folder / name
    path.write_text(json.dumps(FILES[name][0]), encoding="utf-8")
    return path


TAKES_A_MODEL = (
    *("impact --model", "walk --model", "mission --model", "train --model", "play --agent zero --model"),
    *("learn . --out o --bouc-wen", "diagnose . --model", "asset apply a.usda"),
    "robot fit-device a.usda --joint a --model",
)


@pytest.mark.parametrize(
    ("command", "name"),
    [*((command, "result.json") for command in TAKES_A_MODEL), *(("walk --model", name) for name in [*FILES][1:])],
)
def test_json_in_the_place_of_a_model(
    command: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused
) -> None:
    """It is named, with what belongs there; nothing is written."""
    monkeypatch.chdir(tmp_path)
    put(tmp_path, name)
    (tmp_path / "a.usda").write_text("#usda 1.0\n", encoding="utf-8")
    line = refused(*command.split(), name)
    assert f"{name}: is {FILES[name][1]}, not a model.json; give the model.json that" in line
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.usda", name]


def test_a_first_answer_is_named_as_one(tmp_path: Path, refused: Refused) -> None:
    """A diagnosis that was stopped has a result, but no model: as the file and as the folder."""
    early = {**RESULT, "command": "mrwarp diagnose a --out o", "verdict": None, "final": False}
    (tmp_path / "result.json").write_text(json.dumps(early), encoding="utf-8")
    line = refused("impact", "--model", tmp_path / "result.json")
    assert "is the result.json of 'mrwarp diagnose', which is not final" in line
    assert "no model.json; result.json in it is not final" in refused("impact", "--model", tmp_path)
    (tmp_path / "result.json").write_text(json.dumps({**early, "final": True}), encoding="utf-8")
    assert "not final" not in refused("impact", "--model", tmp_path)


@pytest.mark.parametrize("option", ["--policy", "--numbers", "--model"])
def test_the_model_beside_is_proposed_for_a_model_alone(option: str, tmp_path: Path, refused: Refused) -> None:
    """A result of ``fit`` has a model.json next to it."""
    path = put(tmp_path, "result.json")
    (tmp_path / "model.json").write_text("{}", encoding="utf-8")
    assert (f"did you mean {tmp_path / 'model.json'}?" in refused("walk", option, path)) == (option == "--model")


def test_a_folder_in_the_place_of_a_model(tmp_path: Path, refused: Refused) -> None:
    """The model in it is proposed, where there is one."""
    assert f"{tmp_path}: is a folder, no model.json; give the model.json" in refused("impact", "--model", tmp_path)
    (tmp_path / "model.json").touch()
    assert f"did you mean {tmp_path / 'model.json'}?" in refused("impact", "--model", tmp_path)


@pytest.mark.parametrize(
    ("option", "content", "text"),
    [
        ("train --resume", b'{"electrical": {}}', "is a numbers.json of the energy model, no checkpoint"),
        ("train --actuator mlp --actuator-file", b"PAR1....", "is a recording in Parquet, no network"),
        ("impact --policy", b"#usda 1.0", "is a USD file, no policy"),
        ("robot show", b'{"q": "deg"}', "is neither mr_go"),
        ("robot fit-device --joint a", b'{"q": "deg"}', "is the units.json of a recording, no robot"),
        ("asset diff a.usda", b'{"q": "deg"}', "is the units.json of a recording, no USD file"),
    ],
)
def test_other_options(
    option: str,
    content: bytes,
    text: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    refused: Refused,
) -> None:
    """Policies, checkpoints, networks, robots and USD files too."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.usda").write_text("#usda 1.0\n", encoding="utf-8")
    path = tmp_path / "file"
    path.write_bytes(content)
    assert text in refused(*option.split(), path)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b'{"a": 1}', b"\xff\xfe", b"q,qd\n0,0\n"])
def test_what_is_not_recognised_is_left_to_its_reader(content: bytes, tmp_path: Path) -> None:
    """It says itself what is wrong."""
    (tmp_path / "file").write_bytes(content)
    assert kind_of(tmp_path / "file") == ("", "")
