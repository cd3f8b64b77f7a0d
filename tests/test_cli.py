"""The one entry: every command it names is there, and what it does not know is refused."""

import argparse
import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mrwarp import cli
from mrwarp.enums import LEARNED
from mrwarp.options.arguments import Parser
from mrwarp.resources import DEFAULT_POLICY, shipped_model


@pytest.mark.parametrize("name", list(cli.COMMANDS))
def test_every_command_answers_help(name: str, capsys: pytest.CaptureFixture) -> None:
    """``mrwarp COMMAND --help`` prints its usage and ends with 0."""
    try:
        code = cli.main([name, "--help"])
    except SystemExit as stop:  # argparse ends this way
        code = stop.code
    assert code in (0, None)
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

    def main(argv: list[str]) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), named)

    monkeypatch.setattr("mrwarp.commands.run_check.main", main)
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


SLOWER = ("fit", "learn", "diagnose")
"""Commands that load Warp or torch before they read their arguments, which takes a second or three."""


def test_arguments_are_read_before_engines_are_loaded() -> None:
    """Help and refusals of the others take a fraction of a second: they load no torch, Warp, Newton or MuJoCo."""
    script = f"""
import contextlib, io, sys
from mrwarp import cli
for name in {sorted(set(cli.COMMANDS) - set(SLOWER))}:
    for flag in ("--help", "--nonsense"):
        with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
            with contextlib.redirect_stderr(io.StringIO()):
                cli.main([name, flag])
    loaded = sorted({{"torch", "warp", "newton", "mujoco"}} & set(sys.modules))
    assert not loaded, (name, loaded)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_shipped_files_are_there() -> None:
    """The default policy and a network of every learned kind."""
    assert DEFAULT_POLICY.is_file() and all(shipped_model(kind) for kind in LEARNED)
    assert shipped_model("bouc_wen") is None


class Read(Exception):
    """Ends a command where it reads its arguments."""


@pytest.mark.parametrize("name", sorted({*cli.COMMANDS} - {"walk", "mission", "study", "reproduce"}))
def test_help_names_every_default(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each option is explained, with its default where it has one."""
    seen: list[argparse.ArgumentParser] = []

    def stop(parser: argparse.ArgumentParser, *_: object) -> None:
        seen.append(parser)
        raise Read

    monkeypatch.setattr(Parser, "parse_args", stop)
    with pytest.raises(Read):
        cli.main([name])
    for parser in seen:
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                seen += action.choices.values()
            elif action.option_strings:
                assert action.help
                needed = action.default not in (None, False, [], argparse.SUPPRESS)
                assert not needed or "default" in action.help, f"{parser.prog} {action.option_strings[0]}"
