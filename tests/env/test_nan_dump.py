"""Dumps: written in one piece, read as data only, refused with a remedy, and shown by ``mrwarp replay-dump``."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mrwarp.cli import main
from mrwarp.env import nan_dump
from mrwarp.env.nan_dump import Column, Divergence
from tests.messages import Refused

COLUMNS = (
    Column(quantity="time", part="", unit="s"),
    Column(quantity="position", part="trunk z", unit="m"),
    Column(quantity="velocity", part="FL_calf", unit="rad/s"),
    Column(quantity="torque", part="FL_calf", unit="N·m"),
)


def make_divergence(count: int = 30) -> Divergence:
    """A calf that swings ever faster, until its speed is no number."""
    time = 0.005 * np.arange(count)
    states = np.stack([time, 0.3 + 0.0 * time, np.exp(20.0 * time), np.sin(time)], axis=1).astype(np.float32)
    states[-2, 3] = 20.0
    states[-1, 2:] = np.nan
    bounds = np.array([[-np.inf, -10.0, -400.0, -np.inf], [np.inf, 10.0, 400.0, np.inf]])
    return Divergence(env=3, columns=COLUMNS, states=states, bounds=bounds)


def test_a_dump_comes_back_as_it_was(tmp_path: Path) -> None:
    """All fields, bit for bit; nothing but the file is left."""
    found, path = make_divergence(), tmp_path / "diverged" / "a.safetensors"
    nan_dump.save(found, path, {"update": 12, "seed": 0, "task": {"robot": "mr_go"}})
    again = nan_dump.load(path)
    assert again.run == {"update": 12, "seed": 0, "task": {"robot": "mr_go"}}
    np.testing.assert_array_equal(again.states, found.states)
    np.testing.assert_array_equal(again.bounds, found.bounds)
    for name in ("env", "column", "finite", "columns"):
        assert getattr(again, name) == getattr(found, name)
    assert [file.name for file in path.parent.iterdir()] == ["a.safetensors"]


def test_replay_dump_says_what_went_wrong_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Environment, time, quantity and joint, what else was wrong, what changed before, the last rows, and a picture."""
    path, png = tmp_path / "a.safetensors", tmp_path / "a.png"
    nan_dump.save(make_divergence(), path, {"update": 12, "seed": 7})
    assert main(["replay-dump", str(path), "--rows", "3", "--png", str(png)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "first wrong: environment 3, 0.145 s into its episode: velocity of FL_calf is nan rad/s"
    assert "update 12, seed 7" in lines[1]
    assert any("1 more, torque of FL_calf" in line for line in lines)
    assert any("torque of FL_calf from" in line and "to 20 N·m in one step" in line for line in lines)
    assert len(lines[lines.index("") + 1 :]) == 1 + 3 + 1  # heads, rows, picture
    assert png.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("count", [1, 2, 100])
def test_short_and_full_histories_are_shown(tmp_path: Path, count: int) -> None:
    """A break in the first step has one row; a full history a hundred."""
    path = tmp_path / "a.safetensors"
    nan_dump.save(make_divergence(max(count, 2)), path, {})
    if count == 1:
        nan_dump.save(replace(make_divergence(2), states=make_divergence(2).states[-1:]), path, {})
    assert main(["replay-dump", str(path), "--png", str(tmp_path / "a.png")]) == 0


@pytest.mark.parametrize("args", [["{tmp}/none"], ["{text}"], ["{good}", "--png", "{tmp}/a.jpg"], ["{tmp}"]])
def test_bad_input_is_refused_in_one_line(tmp_path: Path, args: list[str], refused: Refused) -> None:
    """Exit code 2, one line that names the file; nothing written."""
    text, good = tmp_path / "text", tmp_path / "good.safetensors"
    text.write_text("no dump")
    nan_dump.save(make_divergence(), good, {})
    before = sorted(tmp_path.iterdir())
    assert str(tmp_path) in refused("replay-dump", *(arg.format(tmp=tmp_path, text=text, good=good) for arg in args))
    assert sorted(tmp_path.iterdir()) == before
