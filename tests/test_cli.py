"""The one entry: every command it names is there, and what it does not know is refused."""

import pytest

from mrwarp import cli


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
