"""``torchrun`` from end to end: a killed process ends the others at once, with one message."""

import os
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from mrwarp.rl import checkpoint

ROOT = Path(__file__).resolve().parents[2]


def start(out: Path) -> subprocess.Popen[str]:
    """Two processes that train; returns once they have printed progress and written a checkpoint."""
    command = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", "train/ppo.py"]
    options = ["--num-envs", "4", "--iterations", "100000", "--no-gate", "--save-every", "0", "--out", str(out)]
    pipe = subprocess.PIPE
    run = subprocess.Popen(
        [sys.executable, *command, *options],
        cwd=ROOT,
        stdout=pipe,
        stderr=pipe,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1", "PYTHONPATH": str(ROOT)},
    )
    assert run.stdout is not None
    for line in run.stdout:
        if line.startswith("update"):
            while not (out / "checkpoint.pt").is_file() and run.poll() is None:
                time.sleep(0.01)
            return run
    raise AssertionError(run.communicate()[1])


@pytest.mark.slow
def test_a_killed_process_ends_the_others(tmp_path: Path) -> None:
    """SIGKILL to one process: the other says so once, names the checkpoint, and ends in seconds."""
    run = start(tmp_path)
    workers = psutil.Process(run.pid).children()
    assert len(workers) == 2
    killed = time.monotonic()
    workers[1].kill()
    _, err = run.communicate(timeout=60)
    assert time.monotonic() - killed < 20.0 and run.returncode != 0
    assert err.count("train/ppo.py: ") == 1
    assert f"another process of this training ended; go on from {tmp_path / 'checkpoint.pt'}" in err
    assert not any(worker.is_running() for worker in workers)
    kept = checkpoint.load(tmp_path / "checkpoint.pt")
    assert kept["iteration"] >= 1 and len(kept["other_ranks"]) == 1
