"""The one entry: every command it names is there, and what it does not know is refused."""

import dataclasses
import errno
import os
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from mrwarp import cli
from mrwarp.enums import LEARNED
from mrwarp.options.command_line import option_fields, option_flags, parse, renamed_notes, values
from mrwarp.options.command_table import all_commands
from mrwarp.resources import DEFAULT_POLICY, shipped_model
from mrwarp.run_dir import claim


@pytest.mark.parametrize("name", [name for name in cli.COMMANDS if name not in dict(all_commands())])
def test_a_group_of_commands_answers_help(name: str, capsys: pytest.CaptureFixture) -> None:
    """``mrwarp asset --help`` prints its usage and ends with 0; ``test_every_option_is_explained`` asks the others."""
    assert cli.main([name, "--help"]) == 0
    assert "usage" in capsys.readouterr().out


def test_help_lists_every_command(capsys: pytest.CaptureFixture) -> None:
    """``mrwarp --help`` names each command once."""
    assert cli.main(["--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines if line.startswith("  ")] == list(cli.COMMANDS)


@pytest.mark.parametrize("argv", [[], ["fly"]])
def test_what_is_no_command_is_refused(argv: list[str]) -> None:
    """No command, or an unknown one: exit code 2."""
    assert cli.main(argv) == 2


@pytest.mark.parametrize("named", [None, "out/result.json"])
def test_a_full_disk_ends_in_one_line(
    named: str | None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """For any command: exit code 1, place, cause and remedy."""

    def run(options: object, line: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), named)

    monkeypatch.setattr("mrwarp.commands.run_fit.Check.run", run)
    assert cli.main(["check", "."]) == 1
    where = f"{named}: " if named else ""
    remedy = "make room or name another folder, then run it again"
    assert capsys.readouterr().err == f"mrwarp check: {where}No space left on device; {remedy}\n"


@pytest.mark.parametrize(
    "command", ["fit .", "learn . --kind mlp", "sweep --command fit --grid seed=0", "monitor .", "reproduce fig5"]
)
def test_a_second_run_in_the_same_folder_is_refused(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """For any command, before it does anything."""
    if command.startswith(("learn", "reproduce")):
        pytest.importorskip("torch", reason="needs mrwarp[sim]")
    monkeypatch.setattr("mrwarp.recording.records.check_count", lambda *_: None)
    (tmp_path / "a.csv").touch()
    monkeypatch.chdir(tmp_path)
    with claim(tmp_path / "out"):
        assert cli.main([*command.split(), "--out", "out"]) == 2
        assert list((tmp_path / "out").iterdir()) == []
    assert "out: another run writes here; wait for it or name another --out" in capsys.readouterr().err


def test_a_training_that_goes_on_elsewhere_is_not_read(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """The folder is that of the checkpoint, which is another's work until that ends: not even read."""
    pytest.importorskip("torch", reason="needs mrwarp[sim]")
    (tmp_path / "checkpoint.pt").write_bytes(b"half written")
    with claim(tmp_path):
        assert cli.main(["train", "--resume", str(tmp_path / "checkpoint.pt")]) == 2
    assert "another run writes here" in capsys.readouterr().err
    assert cli.main(["train", "--resume", str(tmp_path / "checkpoint.pt")]) == 2
    assert "checkpoint.pt: damaged" in capsys.readouterr().err


def test_a_model_file_is_read_before_an_engine_is_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """One with an entry that is missing: refused by its own message."""
    monkeypatch.setattr("mrwarp.cli.quiet_libraries", lambda **_: pytest.fail("an engine was loaded"))
    (tmp_path / "model.json").write_text('{"schema": 1, "parameters": {}, "units": {}, "fitted_on": {}}')
    assert cli.main(["walk", "--model", str(tmp_path / "model.json")]) == 2
    assert "model.json: effects is missing" in capsys.readouterr().err


@pytest.mark.parametrize("argv", [["bench", "--list-effects"], ["--help"], ["train", "--help"], ["asset"]])
def test_a_reader_that_has_gone_is_no_error(argv: list[str]) -> None:
    """``mrwarp COMMAND | true`` says nothing on stderr."""
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "mrwarp", *argv]
    done = subprocess.run(
        command, stdout=write, stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1], check=False
    )
    os.close(write)
    assert done.returncode == 1
    assert "Broken" not in done.stderr and "Traceback" not in done.stderr


def test_arguments_are_read_before_engines_are_loaded() -> None:
    """Help and refusals of the others take a fraction of a second: they load no torch, Warp, Newton or MuJoCo."""
    script = f"""
import contextlib, io, sys
from mrwarp import cli
for name in {sorted(name for name, _ in all_commands())}:
    for flag in ("--help", "--nonsense"):
        with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
            with contextlib.redirect_stderr(io.StringIO()):
                cli.main([*name.split(), flag])
    loaded = sorted({{"torch", "warp", "newton", "mujoco"}} & set(sys.modules))
    assert not loaded, (name, loaded)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_looking_at_an_asset_and_changing_it_load_no_engine(tmp_path: Path) -> None:
    """Show, set and diff take a second or two; the engines would take ten."""
    pytest.importorskip("newton_usd_schemas", reason="needs mrwarp[sim]")
    script = """
import shutil, sys
from mrwarp import cli
from mrwarp.usd.open_stage import ASSETS
shutil.copy(ASSETS / "mr_go.usda", "a.usda")
assert cli.main(["asset", "show", "a.usda"]) == 0
assert cli.main(["asset", "set", "a.usda", "FL_calf", "K1", "9"]) == 0
assert cli.main(["asset", "diff", "a.usda", str(ASSETS / "mr_go.usda")]) == 1
assert not {"torch", "newton", "mujoco_warp"} & set(sys.modules)  # the laws of effects import Warp
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_nobody_who_asked_for_no_gpu_is_told_that_there_is_none() -> None:
    """Warp's library says so on stderr when it begins."""
    pytest.importorskip("torch", reason="needs mrwarp[sim]")
    script = "from mrwarp.runtime import quiet_libraries; quiet_libraries(gpu=False); import warp; warp.zeros(1)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_version(capsys: pytest.CaptureFixture) -> None:
    """``mrwarp --version``."""
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"mrwarp {version('mrwarp')}\n"


def test_an_option_of_another_name_is_taken_and_the_new_one_named() -> None:
    """One word per thing; the kind of network keeps its earlier name next to the new one."""
    mission = dict(all_commands())["mission"].load()
    for words in (["--seeds", "2"], ["--seeds=2"]):
        assert values(parse(mission, words, "mrwarp mission"))["trials"] == 2
        assert renamed_notes(words, mission) == ["note: --seeds is called --trials now"]
    assert renamed_notes(["--trials", "2"], mission) == []
    learn = dict(all_commands())["learn"].load()
    for name in ("--kind", "--model"):
        assert vars(parse(learn, ["data", "--out", "o", name, "mlp"], "mrwarp learn"))["kind"] == "mlp"


def test_shipped_files_are_there() -> None:
    """The default policy and a network of every learned kind."""
    assert DEFAULT_POLICY.is_file() and all(shipped_model(kind) for kind in LEARNED)
    assert shipped_model("bouc_wen") is None


@pytest.mark.parametrize("name", [name for name, _ in all_commands()])
def test_every_option_is_explained(name: str, capsys: pytest.CaptureFixture) -> None:
    """The help names each option once, says what it is, and its default where it has one."""
    options = dict(all_commands())[name].load()
    assert cli.main([*name.split(), "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    for option in option_flags(options):
        said = re.findall(rf" --{option}[ ,](.*?)(?= --(?!no-)[a-z]|$)", text)
        assert any(re.search("[a-z]{2,},? [a-z(]|[a-z]{4}", own) for own in said), option
    for _, field, option in option_fields(options):
        if field.default not in (None, False, (), dataclasses.MISSING):
            assert "default" in text.partition(f"--{option.replace('_', '-')}")[2], option
    for private in ("default: None", "default: False", " cfg.", "argument can be overridden", "must be passed in"):
        assert private not in text, private
