"""The one entry: every command it names is there, and what it does not know is refused."""

import dataclasses
import errno
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from tyro._docstrings import get_field_docstring

from mrwarp import cli
from mrwarp.enums import LEARNED
from mrwarp.options.command_line import option_flags
from mrwarp.options.command_table import all_commands
from mrwarp.resources import DEFAULT_POLICY, shipped_model


@pytest.mark.parametrize("name", list(cli.COMMANDS))
def test_every_command_answers_help(name: str, capsys: pytest.CaptureFixture) -> None:
    """``mrwarp COMMAND --help`` prints its usage and ends with 0."""
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
    """Whatever command it stops: exit code 1, place, cause and remedy."""

    def run(options: object, line: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), named)

    monkeypatch.setattr("mrwarp.commands.run_fit.Check.run", run)
    assert cli.main(["check", "x"]) == 1
    where = f"{named}: " if named else ""
    remedy = "make room or name another folder, then run it again"
    assert capsys.readouterr().err == f"mrwarp check: {where}No space left on device; {remedy}\n"


def test_a_reader_that_has_gone_is_no_error() -> None:
    """``mrwarp COMMAND | true`` says nothing on stderr."""
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "mrwarp.cli", "bench", "--list-effects"]
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
        assert re.search(rf"--{option}[ ,]", text), option
    for field in dataclasses.fields(options):
        assert get_field_docstring(options, field.name, ())
        if field.default not in (None, False, (), dataclasses.MISSING):
            assert "default" in text.partition(f"--{field.name.replace('_', '-')}")[2], field.name
    assert "default: None" not in text and "default: False" not in text
