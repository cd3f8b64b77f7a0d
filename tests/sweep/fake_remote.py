"""The task of Ray's workers with the stand-in for a training."""

import sys
from pathlib import Path

from mrwarp.sweep import runners
from mrwarp.sweep.grid import Trial


def fake_remote(trial: Trial, mark: Path, retries: int, variables: dict[str, str]) -> None:
    """As the runner's own, see ``tests/sweep/conftest.py``."""
    runners.LAUNCH = (sys.executable, str(Path(__file__).with_name("fake_command.py")))
    runners.run_trial(trial, mark, retries, {**variables, "FAKE_STEP_TIME": "0.1"})
