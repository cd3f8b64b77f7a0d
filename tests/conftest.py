"""Shared by all tests: quiet Warp, one torch thread, skipped GPU tests, and the measured data next to the checkout."""

import gc
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

# before NumPy: the processes of `make test` share the cores
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest
import torch
import warp as wp
from matplotlib.figure import Figure

from mrwarp import cli, runtime
from tests.messages import Refused

# before the first kernel: Warp prints its banner and every compiled module at LOG_INFO
wp.config.log_level = wp.LOG_WARNING
wp.init()  # torch tensors are wrapped in some tests before anything of Warp has run
# results and timings must not depend on how many cores the machine has
torch.set_num_threads(1)
runtime.leave_compiler_out(torch)
runtime.core_count = lambda: 1  # nor start processes of their own where every core runs tests

# imports and tests make millions of objects that live on: looking for cycles among them took a quarter of the imports'
# time and a twentieth of the tests'
gc.set_threshold(100_000, 20, 20)

_savefig = Figure.savefig
_running: list[pytest.Item] = []


def savefig(figure: Figure, *args: object, **options: object) -> None:
    """Draw without a layout, which takes most of the time, but in tests that are about pictures by their names.

    In tests that are not, by their file's name either, are not slow and do not ask for ``drawn``, the picture is blank.
    """
    item = _running[-1] if _running else None
    if item is not None and "picture" not in item.name:
        figure._layout_engine = None  # type: ignore[attr-defined]  # "none" keeps its place, and everything is drawn twice
        if not ("picture" in item.nodeid or "slow" in item.keywords or "drawn" in item.fixturenames):  # type: ignore[attr-defined]
            figure = Figure(figsize=figure.get_size_inches())
    _savefig(figure, *args, **options)


Figure.savefig = savefig  # type: ignore[method-assign]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Note the test that runs."""
    _running.append(item)
    try:
        return (yield)
    finally:
        _running.pop()


SHARED = Path(__file__).resolve().parents[2] / "shared"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip tests marked ``gpu`` where Warp finds no CUDA device."""
    gpu = [item for item in items if "gpu" in item.keywords]
    if gpu and wp.get_cuda_device_count() == 0:
        for item in gpu:
            item.add_marker(pytest.mark.skip(reason="Warp finds no CUDA device"))


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Refused:
    """Run a command that must refuse its input: exit code 2 and one line on stderr, which comes back."""

    def run(*words: object) -> str:
        capsys.readouterr()
        try:
            code = cli.main([str(word) for word in words])
        except SystemExit as leaving:  # argparse ends this way
            code = leaving.code
        error = capsys.readouterr().err
        assert code == 2 and error.startswith(f"mrwarp {words[0]}"), error
        assert error.count("\n") == 1 and error.endswith("\n") and "Traceback" not in error, error
        return error

    return run


@pytest.fixture(scope="session")
def drawn() -> None:
    """For tests that look at a picture's content: it is drawn."""


@pytest.fixture
def short_gate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trainings check the gate for 0.1 s on 4 environments, and draw no picture."""
    _shorten_gate(monkeypatch)


@pytest.fixture(scope="module")
def short_gate_of_module() -> Iterator[None]:
    """As ``short_gate``, for all tests and fixtures of a file."""
    with pytest.MonkeyPatch.context() as patched:
        _shorten_gate(patched)
        yield


def _shorten_gate(monkeypatch: pytest.MonkeyPatch) -> None:
    from mrwarp.rl import progress, trainer
    from mrwarp.trials.walking import GateCheck, WalkingGate

    gate = WalkingGate(num_envs=4, warmup=0.0, seconds=0.1)
    monkeypatch.setattr(trainer, "GateCheck", lambda cfg: GateCheck(cfg, gate=gate))
    monkeypatch.setattr(progress, "plot", lambda *_: None)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder ``shared`` next to the checkout, which holds real measurements; skips where it is absent."""
    if not SHARED.is_dir():
        pytest.skip("no folder 'shared' with measurements next to the checkout")
    return SHARED


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built without a network; skips where hatchling is absent."""
    folder, root = tmp_path_factory.mktemp("wheel"), Path(__file__).resolve().parents[1]
    build = ["pip", "wheel", "--no-deps", "--no-build-isolation", "-q", "-w", str(folder), str(root)]
    built = subprocess.run([sys.executable, "-m", *build], capture_output=True, text=True, check=False)
    if "hatchling" in built.stderr and "No module named" in built.stderr:
        pytest.skip("hatchling, which builds the wheel, is not installed")
    assert built.returncode == 0, built.stderr
    (found,) = folder.glob("*.whl")
    return found
