"""Changes that are tried one by one: the best of many go on."""

from types import SimpleNamespace

import numpy as np
import pytest

from mrwarp.robot_logs import single_changes
from mrwarp.robot_logs.selection import Hypothesis
from mrwarp.robot_logs.single_changes import screened
from mrwarp.sysid.settings import RobotFit, Settings


def test_of_many_changes_the_best_by_some_windows_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Best first, by what windows are left with and how unlikely a change is; one window of three is replayed."""
    asked = []

    def left(described, model, groups, parameters, robots: np.ndarray, *, every: int) -> np.ndarray:  # noqa: ANN001, ARG001
        asked.append(every)
        return np.abs(robots[:, 0] - 7.0)

    monkeypatch.setattr(single_changes, "left_by_each", left)
    d = Hypothesis(cause="kp", where="a", members=(0,))
    tried = [(np.array([float(k)]), d, 100.0 * (k == 7)) for k in range(30)]
    settings = RobotFit(kept=5)
    described = SimpleNamespace(settings=Settings(robot_fit=settings))
    found = screened(tried, described, SimpleNamespace(), [], [])
    assert (asked, len(found)) == ([settings.screened], 5)
    assert found[0][0][0] in (6.0, 8.0) and all(robot[0] != 7.0 for robot, _, _ in found)
