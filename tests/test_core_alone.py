"""Commands on recordings run with the core's dependencies alone; commands that need more name it."""

import importlib.metadata
import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from mrwarp.options.extras import EXTRAS

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

MAX_DIRECT = 10
"""Direct dependencies of the core."""

MAX_BYTES = 800e6
"""Size of the core with all that it depends on, unpacked; Warp is half of it."""


def closure(requirements: list[str]) -> dict[str, importlib.metadata.Distribution]:
    """Installed distributions that requirements need here, without extras, by name."""
    found: dict[str, importlib.metadata.Distribution] = {}
    todo = [Requirement(text) for text in requirements]
    while todo:
        asked = todo.pop()
        name = asked.name.lower().replace("_", "-")
        if name in found or (asked.marker and not asked.marker.evaluate({"extra": ""})):
            continue
        found[name] = importlib.metadata.distribution(name)
        todo += [Requirement(text) for text in found[name].requires or []]
    return found


@pytest.fixture(scope="module")
def core(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with nothing but the wheel, unpacked, and what its core depends on, as links to what is installed."""
    site = tmp_path_factory.mktemp("core")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    for distribution in closure(PROJECT["dependencies"]).values():
        for file in distribution.files or []:
            top = file.parts[0]
            if top != ".." and top != "__pycache__" and not (site / top).is_symlink():
                (site / top).symlink_to(Path(str(distribution.locate_file(top))))
    return site


def python(core: Path, folder: Path, script: str, *words: str) -> subprocess.CompletedProcess[str]:
    """A script with the core alone: no site-packages."""
    env = {**os.environ, "PYTHONPATH": str(core)}
    line = [sys.executable, "-S", "-c", script, *words]
    return subprocess.run(line, cwd=folder, env=env, capture_output=True, text=True, check=False)


def run(core: Path, folder: Path, *lines: str) -> None:
    """Commands of mrwarp with the core alone, in one process, which all succeed."""
    script = f"from mrwarp.cli import main\nfor line in {lines}: assert main(line.split()) == 0, line"
    done = python(core, folder, script)
    assert done.returncode == 0, done.stderr


def test_the_core_is_small() -> None:
    """Few direct dependencies, and none of the heavy engines among what they bring."""
    assert len(PROJECT["dependencies"]) <= MAX_DIRECT
    brought = closure(PROJECT["dependencies"]).values()
    files = [Path(str(d.locate_file(file))) for d in brought for file in d.files or [] if file.suffix != ".pyc"]
    assert sum(path.stat().st_size for path in files if path.is_file()) <= MAX_BYTES
    heavy = {"torch", "newton", "rerun-sdk", "rsl-rl-lib", "onnx", "onnxruntime", "mujoco", "usd-core", "pyarrow"}
    assert not heavy & closure(PROJECT["dependencies"]).keys()


def test_recordings_need_the_core_alone(core: Path, tmp_path: Path) -> None:
    """Record, check and fit; the model is written."""
    bench = "bench --out bench --trajectories 4 --samples 2000 --evaluation-samples 0 --scale-effects 0"
    run(core, tmp_path, bench, "check bench/fit", "fit bench/fit --out fit")
    assert (tmp_path / "fit" / "model.json").is_file()


def test_joints_need_the_core_alone(core: Path, tmp_path: Path) -> None:
    """A batch of joints steps without torch."""
    script = "import mrwarp, sys; print(mrwarp.JointBatch(dt=0.005).step(0.0, 1.0, 1.0).shape, 'torch' in sys.modules)"
    done = python(core, tmp_path, script)
    assert "(1,) False" in done.stdout, done.stderr


@pytest.mark.slow
def test_a_diagnosis_needs_the_core_alone(core: Path, tmp_path: Path) -> None:
    """A coil's lag is found, and the report is whole."""
    bench = "bench --out bench --trajectories 6 --samples 2400 --evaluation-samples 0 --scale-effects 0"
    run(core, tmp_path, f"{bench} --effect coil_lag=0.02 --effect torque_noise=0.02", "diagnose bench/fit --out found")
    assert "coil_lag" in (tmp_path / "found" / "result.json").read_text(encoding="utf-8")
    assert (tmp_path / "found" / "report.html").is_file()


@pytest.mark.parametrize(
    ("words", "library", "extra"),
    [("walk", "torch", "sim"), ("asset show", "newton_usd_schemas", "sim"), ("bench --policy p.onnx", "torch", "sim")],
)
def test_a_missing_extra_is_named_in_one_line(core: Path, tmp_path: Path, words: str, library: str, extra: str) -> None:
    """Exit code 2, one line with the library and the command that installs it; nothing is written."""
    (tmp_path / "p.onnx").write_bytes(b"")
    done = python(core, tmp_path, "import sys; from mrwarp.cli import main; sys.exit(main())", *words.split())
    assert done.returncode == 2, done.stderr
    assert (
        done.stderr.strip()
        .splitlines()[-1]
        .endswith(f"needs {library}, which is not installed: pip install 'mrwarp[{extra}]'")
    )
    assert [path.name for path in tmp_path.iterdir()] == ["p.onnx"]


def test_every_library_of_an_extra_has_its_extra() -> None:
    """The table of the message and pyproject.toml agree: each extra exists, and brings what it is named for."""
    named = {
        "rsl_rl": "rsl-rl-lib",
        "pxr": "usd-core",
        "rerun": "rerun-sdk",
        "newton_usd_schemas": "newton-usd-schemas",
    }
    brought = {"mujoco_warp": "newton", "tensordict": "rsl-rl-lib"}  # as dependencies of these
    for library, extra in EXTRAS.items():
        names = [Requirement(text).name for text in PROJECT["optional-dependencies"][extra]]
        assert brought.get(library) or named.get(library, library) in names, (library, extra)
