"""Shared by the tests of the sweep."""

import sys
from pathlib import Path

import pytest

from mrwarp.sweep import runners


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trials run a counter of half a second instead of a training."""
    monkeypatch.setattr(runners, "LAUNCH", (sys.executable, str(Path(__file__).with_name("fake_command.py"))))
