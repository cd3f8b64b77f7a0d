"""Files that a command reads are looked at before an engine is loaded, for any command."""

import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest

from mrwarp.options.command_line import INPUTS, OUTPUTS, option_types
from mrwarp.options.command_table import all_commands
from tests.messages import Refused

COMMANDS = [(name, entry) for name, own in all_commands() for entry in (own, *own.variants.values())]

MISSPELT = {
    "check": "none",
    "fit": "none",
    "monitor": "none",
    "learn": "none --out o",
    "diagnose": "none",
    "diagnose joint": "none",
    "diagnose robot": "none",
    "play": "--policy none.onnx",
    "impact": "--policy none.onnx",
    "walk": "--policy-go1 none.onnx",
    "mission": "--numbers none.json",
    "train": "--start-from none.onnx",
    "reproduce": "all --policy-aware none.onnx",
    "bench": "--asset none.usda",
    "perf": "--compare none.json",
    "replay-dump": "none.safetensors",
    "sweep": "--out o --command fit --grid seed=0,1 -- none",
    "study train": "--start-from none",
    "asset show": "none.usda",
    "asset set": "none.usda FL_calf K1 1",
    "asset check": "none.usda",
    "asset diff": "none.usda none.usda",
    "asset apply": "none.usda none.json",
    "asset export": "none.usda --out o.json",
    "export": "none",
    "device make": "new --data none --results none",
    "log import": "none.bag",
    "log record": "--policy none.onnx",
    "robot import": "none.xml --out o.usda",
    "robot show": "none.usda",
    "robot fit-device": "none.usda --joint knee",
}
"""A misspelt path for every command that reads a file."""


def test_every_path_is_known_as_input_or_output() -> None:
    """A new option that names a file or folder belongs into one of the two lists."""
    unknown = []
    for name, entry in COMMANDS:
        for option, kind in option_types(entry.load()).items():
            known = option in (*INPUTS, *OUTPUTS) or option.startswith("policy_")
            if "Path" in str(get_args(kind)[:1] or kind) and not known:
                unknown.append(f"{name}: {option}")
    assert unknown == []


def test_every_command_that_reads_is_tried() -> None:
    """But for those that make something of nothing, or read what has a name of its own."""
    reads = {name for name, own in COMMANDS if INPUTS.keys() & option_types(own.load()).keys()}
    assert reads <= set(MISSPELT)


@pytest.mark.parametrize("command", MISSPELT)
def test_a_misspelt_path(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused) -> None:
    """One line with the path, exit code 2, nothing written."""
    monkeypatch.chdir(tmp_path)
    line = refused(*command.split(), *MISSPELT[command].split())
    assert "none" in line and "no such" in line, line
    assert not list(tmp_path.iterdir())


ENGINES = ("torch", "warp", "newton", "mujoco")
OTHERS = (
    *("train --device cuda:99", "train --out file", "play --agent zero --device cuda:99", "impact --out file"),
    *("fit . --out file", "diagnose . --predict none.csv", "perf --device cuda:99", "reproduce all --out file"),
    *("study collect --out file", "fit .", "diagnose ."),
)
"""Devices that are not there, an output folder that is a file, and a folder without recordings."""


def test_no_engine_is_loaded_for_a_refusal(tmp_path: Path) -> None:
    """For a path nor USD, whose readers take half a second: all commands in one process, which loads none of them."""
    (tmp_path / "file").write_text("")
    lines = [f"{command} {words}" for command, words in MISSPELT.items()]
    code = (
        "import sys; from mrwarp.cli import main\n"
        f"for lines, engines in (({lines!r}, {(*ENGINES, 'pxr', 'scipy')}), ({OTHERS!r}, {ENGINES})):\n"
        "    codes = {line: main(line.split()) for line in lines}\n"
        "    loaded = [name for name in engines if name in sys.modules]\n"
        "    if loaded or set(codes.values()) != {2}: sys.exit(f'{codes} {loaded}')\n"
    )
    run = [sys.executable, "-c", code]
    done = subprocess.run(run, capture_output=True, text=True, timeout=120, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
