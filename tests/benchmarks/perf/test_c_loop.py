"""The loop in C computes what the kernels do, or says why it cannot be had."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from benchmarks.perf import c_loop
from mrwarp.params import MrParams


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_c_and_kernels_give_the_same_numbers(tmp_path: Path) -> None:
    """All outputs of several steps, relative; all branches occur.

    C's powers and exponentials err by a rounding of their own, so n + 3 roundings on either side, in each step.
    """
    robot = c_loop.mixed_robots(16)
    loop = c_loop.CLoop(robot, tmp_path)
    rounding = 2.0 * (MrParams().hold.n + 3.0) * float(np.finfo(np.float32).eps)
    assert c_loop.largest_difference(robot, loop, steps=5) <= 5 * rounding
    held, damped = robot.actuator.m_hold.numpy(), robot.actuator.m_dyn.numpy()
    assert 0.2 < held.mean() < 0.8 and 0.02 < damped.mean()
    loop.out["tau"][3, 4] += 0.1  # a difference shows
    values = {name: array.copy() for name, array in loop.out.items()}
    assert not np.allclose(values["tau"], robot.actuator.tau.numpy(), atol=1e-3)


def test_without_a_compiler_the_reason_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No traceback: the benchmark leaves the comparison out."""
    robot = c_loop.mixed_robots(1)
    monkeypatch.setattr(c_loop.shutil, "which", lambda _: None)
    with pytest.raises(c_loop.NoCompilerError, match="no C compiler"):
        c_loop.CLoop(robot, tmp_path)
    monkeypatch.undo()
    monkeypatch.setattr(c_loop, "SOURCE", tmp_path / "none.c")
    monkeypatch.setattr(c_loop.shutil, "which", lambda _: "cc")
    with pytest.raises(c_loop.NoCompilerError, match="none.c is missing"):
        c_loop.CLoop(robot, tmp_path)
