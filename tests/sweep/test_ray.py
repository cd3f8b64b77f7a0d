"""The sweep on Ray: six trials survive a killed worker of Ray's; its servers listen on loopback alone."""

import json
import os
import signal
import sys
import threading
import time
from importlib.util import find_spec
from pathlib import Path

import psutil
import pytest

from mrwarp.cli import main
from mrwarp.sweep import runners
from mrwarp.sweep.grid import Trial
from mrwarp.sweep.runners import read_status
from tests.sweep.fake_remote import fake_remote

ROOT = Path(__file__).resolve().parents[2]


def kill_a_worker(out: Path, found: dict) -> None:
    """Kill the process of Ray that runs the first trial with a checkpoint; keeps where Ray's servers listen."""
    for _ in range(1200):
        for folder in sorted(out.glob("seed=*")):
            status = read_status(Trial(folder=folder, values={}, args=[]))
            if status.state == "running" and status.pid and (folder / "checkpoint.pt").is_file():
                worker = psutil.Process(status.pid).parent()
                assert worker is not None
                family = psutil.Process().children(recursive=True)
                found["addresses"] = {
                    connection.laddr.ip
                    for process in family
                    for connection in process.net_connections("inet")
                    if connection.status == psutil.CONN_LISTEN
                }
                found["trial"], found["pid"], found["name"] = folder.name, status.pid, worker.name()
                os.kill(worker.pid, signal.SIGKILL)
                return
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.skipif(find_spec("ray") is None, reason="Ray is an extra: pip install 'mrwarp[sweep]'")
def test_six_trials_survive_a_killed_worker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """SIGKILL to Ray's worker: its trial dies with it, Ray begins it again, it goes on from its checkpoint."""
    monkeypatch.setattr(runners, "run_trial", fake_remote)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    found: dict = {}
    watch = threading.Thread(target=kill_a_worker, args=(tmp_path, found))
    watch.start()
    args = ["--command", "train", "--grid", "seed=0,1,2", "actuator=none,bouc_wen"]
    assert main(["sweep", "--out", str(tmp_path), *args, "--workers", "2", "--runner", "ray"]) == 0
    watch.join()
    assert found["name"].startswith("ray::") and not psutil.pid_exists(found["pid"])
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["states"] == {"done": 6}
    assert all(trial["figures"]["iterations"] == 20 for trial in result["trials"])
    log = (tmp_path / found["trial"] / "log.txt").read_text()
    assert log.count("starts at step") == 2 and log.count("starts at step 0") == 1
    assert f"{found['trial']}: done" in capsys.readouterr().out
    assert found["addresses"] and all(ip in ("127.0.0.1", "::1", "::ffff:127.0.0.1") for ip in found["addresses"])


def test_without_ray_the_remedy_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line with the extra to install; nothing is left behind."""
    monkeypatch.setitem(sys.modules, "ray", None)
    out = tmp_path / "out"
    assert main(["sweep", "--out", str(out), "--command", "train", "--grid", "seed=0", "--runner", "ray"]) == 2
    assert (
        capsys.readouterr().err == "mrwarp sweep: --runner ray: Ray is not installed; run pip install 'mrwarp[sweep]'\n"
    )
    assert not out.exists()
