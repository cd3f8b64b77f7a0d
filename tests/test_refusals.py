"""Bad input to any command: exit code 2, one line that names place, value and remedy, nothing written."""

from pathlib import Path

import pytest

from mrwarp import cli


def refused(argv: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What a command says that must refuse its input."""
    try:
        code = cli.main(argv)
    except SystemExit as leaving:  # argparse ends this way
        code = leaving.code
    captured = capsys.readouterr()
    assert code == 2
    assert "Traceback" not in captured.err
    line = captured.err.splitlines()[-1]
    assert argv[0] in line.partition(":")[0]
    return line


SEEDED: dict[str, list[str]] = {
    "fit": ["data.csv"],
    "learn": ["data.csv", "--out", "out"],
    "bench": ["--out", "out"],
    "verify": ["--out", "out"],
    "impact": ["--out", "out"],
    "diagnose": ["data.csv"],
    "play": ["--agent", "zero"],
    "train": ["--out", "out"],
}
"""What else each command with a seed needs."""


@pytest.mark.parametrize("seed", ["-1", "9223372036854775808", "1.5"])
@pytest.mark.parametrize("command", SEEDED)
def test_a_seed_out_of_range(
    command: str, seed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every command refuses the same seeds in the same words."""
    monkeypatch.chdir(tmp_path)
    line = refused([command, *SEEDED[command], "--seed", seed], capsys)
    assert "--seed" in line and seed in line
    assert "from 0 to 2^63 - 1" in line or "not a whole number" in line
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["fit", "diagnose"])
@pytest.mark.parametrize("length", ["-1", "nan", "inf", "60.5", "short"])
def test_a_moving_average_out_of_range(command: str, length: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Refused before anything is read."""
    line = refused([command, "nowhere.csv", "--predict", "nowhere.csv", "--averaged", length], capsys)
    assert "--averaged" in line and length in line
    assert "allowed: 0 to 60 s" in line or "is not a number" in line
