"""The built wheel holds all that its commands need: it runs in an empty folder, away from the repository."""

import os
import re
import subprocess
import sys
import zipfile
from importlib.metadata import distributions
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).resolve().parents[1]

COMMANDS = (
    "asset show",
    "robot show mr_go",
    "play --agent zero --seconds 1 --png zero.png",
    "impact --trials 1 --current 0 1.5 --coupling constraint --out impact",
    "bench --out bench --samples 6000 --trajectories 3 --evaluation-samples 1000",
    "check bench/fit",
)
"""Each opens another part of what is shipped: asset, schema, policy, bench."""


@pytest.mark.slow
def test_a_wheel_is_whole(wheel: Path, tmp_path: Path) -> None:
    """Unpacked, and run where nothing else is."""
    assert wheel.stat().st_size < 10e6
    site, empty = tmp_path / "site", tmp_path / "empty"
    empty.mkdir()
    with zipfile.ZipFile(wheel) as archive:
        assert not [
            name for name in archive.namelist() if name.split("/")[0] not in ("mrwarp",) and "dist-info" not in name
        ]
        archive.extractall(site)
    env = {**os.environ, "PYTHONPATH": str(site)}
    where = "import mrwarp, mrwarp.resources as r; print(mrwarp.__file__, *vars(r).values())"
    seen = subprocess.run([sys.executable, "-c", where], cwd=empty, env=env, capture_output=True, text=True, check=True)
    assert str(site) in seen.stdout and f"{ROOT}/policies" not in seen.stdout
    script = f"from mrwarp.cli import main\nfor line in {COMMANDS}: assert main(line.split()) == 0, line"
    line = [sys.executable, "-c", script]
    done = subprocess.run(line, cwd=empty, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_every_pin_installs_on_the_oldest_python() -> None:
    """Debian's Python 3.11 is 3.11.2: a pinned package that asks for a later one would stop the first command there."""
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    pinned = {re.sub(r"[-_.]+", "-", name).lower() for name in re.findall(r"^([\w.-]+)==", pins, re.MULTILINE)}
    asked = {x.name: x.metadata["Requires-Python"] or "" for x in distributions()}
    asked = {name: x for name, x in asked.items() if re.sub(r"[-_.]+", "-", name).lower() in pinned}
    assert len(asked) > 0.5 * len(pinned)
    assert not {name: x for name, x in asked.items() if not SpecifierSet(x).contains("3.11.0")}


def test_the_papers_policies_stay_in_the_checkout(wheel: Path) -> None:
    """Policies that only the laboratory reads are no part of the wheel; those that commands take are."""
    with zipfile.ZipFile(wheel) as archive:
        names = {name.removeprefix("mrwarp/policies/") for name in archive.namelist() if "/policies/" in name}
    folders = {name.partition("/")[0] for name in names if "/" in name}
    assert folders == {"energy"} and {"mr_go_walk.onnx", "energy/mr_go_seed0.onnx"} <= names
