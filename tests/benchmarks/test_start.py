"""Commands start quickly, in units of ``import numpy``; engines are loaded by those alone that use them."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.start import STARTS, measure, prepare
from mrwarp.usd.open_stage import ASSETS


@pytest.mark.parametrize("name", ["refuse", "check", "asset show", "robot show"])
def test_it_starts_within_its_limit(name: str, tmp_path: Path) -> None:
    """Processor time of the whole command, when caches are warm; a third try may be needed on a busy machine."""
    prepare(tmp_path)
    found = [measure(name, tmp_path, repeats=1)[1]]
    while found[-1] > STARTS[name].limit and len(found) < 3:
        found.append(measure(name, tmp_path, repeats=1)[1])
    assert min(found) <= STARTS[name].limit, found


@pytest.mark.slow
def test_a_policy_is_played_within_its_limit(tmp_path: Path) -> None:
    """Ten seconds of walking and their picture."""
    prepare(tmp_path)
    assert measure("play", tmp_path)[1] <= STARTS["play"].limit


@pytest.mark.parametrize(
    ("words", "unused"),
    [
        (["check", "recordings"], {"matplotlib", "torch", "newton", "mujoco", "pxr"}),
        (["asset", "show"], {"scipy", "torch", "newton", "mujoco"}),
        (["robot", "show", "mr_go", "--png", "robot.png"], {"torch", "newton", "mujoco_warp", "rerun"}),
        (
            ["robot", "fit-device", str(ASSETS / "mr_go.usda"), "--joint", "*_thigh", "--out", "out.usda"],
            {"torch", "newton", "mujoco_warp", "rerun"},
        ),
        (["play", "--agent", "zero", "--seconds", "1", "--out", "out"], {"newton", "mujoco_warp", "rerun"}),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else None,
)
def test_engines_that_are_not_used_are_not_loaded(words: list[str], unused: set[str], tmp_path: Path) -> None:
    """Newton converts a robot once; then the kept model is taken, and neither it nor its viewer is loaded."""
    prepare(tmp_path)
    script = (
        "import sys; from mrwarp.cli import main; code = main(sys.argv[1:]); "
        "print(code, *sorted(name for name in sys.modules if '.' not in name))"
    )
    for _ in range(2):  # the first one may convert
        run = [sys.executable, "-c", script, *words]
        done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=False)
    code, *loaded = done.stdout.splitlines()[-1].split()
    assert code == "0", done.stdout + done.stderr
    assert not unused & set(loaded)
