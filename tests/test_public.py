"""The public interface: a list that changes only on purpose, loaded on use, with examples that run."""

import doctest
import inspect
import pydoc
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import mrwarp
from mrwarp.diagnose.report.in_python import diagnose_files

NAMES = [
    "DriveMR", "EnvCfg", "JointBatch", "LearnedTorque", "Model", "MrParams", "OnnxPolicy", "TaskCfg", "WalkEnv",
    "diagnose", "fit", "load_model", "load_recording", "save_model",
]  # fmt: skip
"""Names that users import. A name that goes, or changes its meaning, is a break for them: say so in the changelog."""

MOST = 40


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where examples run: a folder of recordings, and a model fitted to them."""
    from mrwarp.bench.bench_effects import Effects
    from mrwarp.bench.virtual_bench import BenchCfg, run_bench
    from mrwarp.recording.write import save_recording

    made = tmp_path_factory.mktemp("examples")
    effects = Effects.defaults(0.0).replace(coil_lag=0.02, torque_noise=0.02)
    cfg = BenchCfg(trajectories=4, samples=3000, evaluation_samples=0, seed=3, effects=effects)
    save_recording(run_bench(cfg).fit, made / "recordings")
    mrwarp.save_model(mrwarp.fit(made / "recordings").model, made / "model.json")
    return made


def test_the_list_is_what_users_know() -> None:
    """At most forty names, and none that is not listed here."""
    assert mrwarp.__all__ == NAMES and sorted(dir(mrwarp)) == [*NAMES[:9], "__version__", *NAMES[9:]]
    assert len(NAMES) <= MOST
    with pytest.raises(AttributeError, match="no attribute 'JointBach'; it has DriveMR"):
        mrwarp.JointBach  # noqa: B018


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n == "diagnose")) for n in NAMES])
def test_an_example_in_the_docstring_runs(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every public name has one, and it prints what it says."""
    monkeypatch.chdir(folder)
    found = getattr(mrwarp, name)
    text = inspect.getdoc(type(found).__call__ if inspect.ismodule(found) else found) or ""
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    assert example.examples, f"mrwarp.{name} has no example"
    said: list[str] = []
    doctest.DocTestRunner(verbose=False).run(example, out=said.append)
    assert not said, "".join(said)


def test_nothing_is_loaded_before_it_is_used() -> None:
    """``import mrwarp`` costs nothing: no NumPy, no Warp, no engine."""
    script = "import sys, mrwarp; print(*sorted({'numpy', 'warp', 'torch', 'newton', 'scipy'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_help_begins_with_the_names() -> None:
    """``help(mrwarp)`` lists what users import, each with a line, before anything else; and there is a version."""
    shown = pydoc.plain(pydoc.render_doc(mrwarp)).partition("PACKAGE CONTENTS")[0]
    assert [name for name in NAMES if not re.search(rf"^ +{name}  +\w", shown, re.MULTILINE)] == []
    assert mrwarp.__version__ == version("mrwarp")


def test_the_first_lines_print_what_they_are_asked_to() -> None:
    """No start-up notes of the libraries on either stream."""
    script = "import mrwarp; print(mrwarp.JointBatch(dt=0.005).step(0.0, 1.0, 0.5).shape)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("(1,)\n", "")


def test_it_is_typed() -> None:
    """Type checkers read the package's annotations."""
    assert (Path(mrwarp.__file__).parent / "py.typed").is_file()


def test_the_package_is_called_as_its_function_is() -> None:
    """``mrwarp.diagnose`` is a package that is called: its help has the function's arguments."""
    shown, function = (inspect.signature(x).parameters for x in (type(mrwarp.diagnose).__call__, diagnose_files))
    assert [(p.name, p.kind, p.default) for p in shown.values()] == [
        (p.name, p.kind, p.default) for p in function.values()
    ]
