"""The task of Ray's workers with the stand-in for a training."""

import sys
from pathlib import Path

from mrwarp.sweep import trial


def fake_remote(task: trial.Trial, folder: str, retries: int, variables: dict[str, str]) -> str:
    """As the runner's own, see ``tests/sweep/conftest.py``."""
    trial.LAUNCH = (sys.executable, str(Path(__file__).with_name("fake_command.py")))
    variables = {**variables, "FAKE_STEP_TIME": "0.1"}
    return trial.run_trial(task, Path(folder), retries=retries, environment=variables).value
