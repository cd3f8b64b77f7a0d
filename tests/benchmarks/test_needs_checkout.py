"""A command whose code is not packed says so where only the package is installed."""

import sys

import pytest

from mrwarp.cli import main


def test_a_wheel_has_no_benchmarks(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """One line with the remedy, exit code 2."""
    monkeypatch.setitem(sys.modules, "benchmarks.perf.perf_cli", None)
    assert main(["perf"]) == 2
    message = capsys.readouterr().err
    assert message.startswith("mrwarp perf: ") and "checkout" in message and message.count("\n") == 1
