"""Commands whose code is not packed say so where only the package is installed."""

import sys

import pytest

from mrwarp.cli import main


@pytest.mark.parametrize(
    ("command", "module"), [("perf", "benchmarks.perf.perf_cli"), ("verify", "benchmarks.verify.verify_cli")]
)
def test_a_wheel_has_no_benchmarks(
    command: str, module: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line with the remedy, exit code 2."""
    monkeypatch.setitem(sys.modules, module, None)
    assert main([command]) == 2
    message = capsys.readouterr().err
    assert message.startswith(f"mrwarp {command}: ") and "checkout" in message and message.count("\n") == 1
