"""How long commands take to start: ``python -m benchmarks.start`` prints a table of their processor time.

The unit is the processor time of ``import numpy`` in the same run, so that figures of two machines can be compared.
Children count too. Each command runs once before it is timed: compiled modules, Warp's kernels and converted robots are
kept in caches.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mrwarp.resources import DEFAULT_POLICY
from mrwarp.runtime import text_table


@dataclass(frozen=True, kw_only=True)
class Start:
    """A command and what it may cost."""

    words: tuple[str, ...]
    """Its words after ``mrwarp``."""
    limit: float
    """Most processor time, in units of ``import numpy``: two to three times what was measured, since machines
    differ. Which engines are loaded is tested by name."""
    code: int = 0
    """Its exit code."""


UNCOMPILED = "PYTHONDONTWRITEBYTECODE"
"""Left out of the commands' environment: Python keeps compiled modules unless it is set, as in containers."""

STARTS = {
    "help": Start(words=("play", "--help"), limit=4.0),
    "refuse": Start(words=("impact", "--model", "result.json", "--out", "impact"), limit=20.0, code=2),
    "check": Start(words=("check", "recordings"), limit=18.0),
    "asset show": Start(words=("asset", "show"), limit=18.0),
    "robot show": Start(words=("robot", "show", "mr_go", "--png", "robot.png"), limit=34.0),
    "play": Start(words=("play", "--policy", str(DEFAULT_POLICY), "--png", "walk.png"), limit=108.0),
}
"""Timed commands, by name."""


def prepare(folder: Path) -> None:
    """Write what the commands read: ten short recordings and a result."""
    (folder / "recordings").mkdir()
    rng, time = np.random.default_rng(0), np.arange(0.0, 2.0, 0.005)
    for k in range(10):
        q, current = 0.5 * np.sin(2.0 * np.pi * (0.5 + 0.05 * k) * time), 0.1 * k + 0.5 * (time > 1.0)
        qd = np.gradient(q, time)
        torque = (1.0 + current) * np.tanh(20.0 * qd) + 0.3 * qd + 0.02 * rng.standard_normal(time.size)
        table, head = np.stack([time, q, qd, current, torque], axis=1), "t,q,qd,current,torque"
        np.savetxt(folder / f"recordings/{k}.csv", table, delimiter=",", header=head, comments="", fmt="%.6f")
    (folder / "result.json").write_text(json.dumps({"schema": 1, "verdict": "no model"}), encoding="utf-8")


def processor_time(words: list[str], folder: Path, code: int = 0) -> float:
    """Processor time of python with these words, its children included [s].

    Raises:
        RuntimeError: it ends with another exit code.
    """
    env = {name: value for name, value in os.environ.items() if name != UNCOMPILED}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, *words], cwd=folder, env=env, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != code:
        raise RuntimeError(f"{' '.join(words)} ended with {done.returncode}: {done.stdout[-500:]}{done.stderr[-500:]}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure(name: str, folder: Path, repeats: int = 3) -> tuple[float, float]:
    """Least processor time of a command [s], and the same in units of ``import numpy``; each is repeated by turns."""
    start, numpy_times, times = STARTS[name], [], []
    words = ["-m", "mrwarp", *start.words]
    processor_time(words, folder, start.code)
    for _ in range(repeats):
        numpy_times.append(processor_time(["-c", "import numpy"], folder))
        times.append(processor_time(words, folder, start.code))
    return min(times), min(times) / min(numpy_times)


def main() -> int:
    """Print the table; 1 where a command takes longer than it may."""
    rows, met = [], True
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        prepare(folder)
        for name, start in STARTS.items():
            seconds, units = measure(name, folder)
            met &= units <= start.limit
            shown = " ".join(Path(word).name for word in start.words)
            rows.append((f"mrwarp {shown}", f"{seconds:.2f}", f"{units:.1f}", f"{start.limit:.0f}"))
    print("\n".join(text_table(("command", "processor time [s]", "import numpy", "limit"), rows)))
    return int(not met)


if __name__ == "__main__":
    sys.exit(main())
