"""A log's information on every number: many robots at once leave what each of them leaves alone."""

from pathlib import Path

import numpy as np
import pytest

from mrwarp.robot_logs.causes.parameter import parameters_of
from mrwarp.robot_logs.likelihood import fit, gather, left_by_each, losses, replayed
from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.window_replay import Replay
from mrwarp.robot_logs.windows import Windows, cut_windows
from tests.robot_logs.arm_log import KP, arm_log

EPS = float(np.finfo(np.float32).eps)


def test_robots_that_are_replayed_at_once_leave_what_each_leaves(tmp_path: Path) -> None:
    """Of windows that count; a robot that is far off leaves more.

    Where derivatives were taken, long steps leave what the windows' own do, as sums of three float32 mismatches whose
    squares count; a fifth of all faults away within 2 %. Every second window stands for all to four standard errors.
    """
    log = load_log(arm_log(tmp_path, seconds=3.0))
    model = replay_model(tmp_path / "arm.xml", log)
    parameters, groups = parameters_of(model, log), cut_windows(model, log)
    likelihood = gather(model, groups, parameters, np.zeros(len(parameters)), lambda _: None)
    thetas = np.zeros((2, len(parameters)))
    thetas[1] = [0.2 * p.fault for p in parameters]
    together = left_by_each(likelihood, model, groups, parameters, thetas)
    errors = []
    for theta, left, rel in zip(thetas, together, (6.0 * EPS, 0.02), strict=True):
        near, moved = replayed(likelihood, model, groups, parameters, theta)
        assert left == pytest.approx(near / likelihood.scale, rel=1e-9)
        assert near == pytest.approx(moved.at(theta))
        fine = losses(likelihood, model, groups, parameters, np.tile(theta, (len(likelihood.square), 1)))[0]
        assert near == pytest.approx(likelihood.weight @ fine, rel=rel)
        errors.append(np.sqrt(len(fine)) * np.std(likelihood.weight * fine) / likelihood.scale)
    assert together[1] > 2.0 * together[0]
    some = left_by_each(likelihood, model, groups, parameters, thetas, every=2)
    assert (abs(some - together) < 4.0 * np.array(errors)).all() and abs(some - together).min() > 0.0


def test_searches_take_the_long_steps_of_the_derivatives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No robot that is tried on the way is replayed by the windows' own steps of a millisecond."""
    log = load_log(arm_log(tmp_path, seconds=3.0))
    model = replay_model(tmp_path / "arm.xml", log)
    parameters, groups = parameters_of(model, log), cut_windows(model, log)
    likelihood = gather(model, groups, parameters, np.zeros(len(parameters)), lambda _: None)
    taken: list[float] = []
    begin = Replay.__init__

    def noted(self: Replay, of: ReplayModel, windows: Windows) -> None:
        taken.append(windows.h)
        begin(self, of, windows)

    monkeypatch.setattr(Replay, "__init__", noted)
    replayed(likelihood, model, groups, parameters, np.zeros(len(parameters)))
    left_by_each(likelihood, model, groups, parameters, np.zeros((2, len(parameters))))
    assert taken and min(taken) > 2.0 * max(w.h for w in groups)


@pytest.mark.parametrize(("kp", "fresh"), [(1.03, True), (1.4, False)])
def test_derivatives_hold_within_their_own_steps(kp: float, fresh: bool, tmp_path: Path) -> None:
    """They are differences over a step of each number, of 0.05 for a gain: nearer new ones would say nothing else."""
    log = load_log(arm_log(tmp_path, seconds=3.0, kp=kp * KP))
    model = replay_model(tmp_path / "arm.xml", log)
    parameters, groups = parameters_of(model, log), cut_windows(model, log)
    own = [k for k, p in enumerate(parameters) if p.cause == "kp"]
    low, high = (np.isin(range(len(parameters)), own) * end for end in (-0.5, 0.5))
    theta, nothing = np.zeros(len(parameters)), np.zeros((len(parameters), len(parameters)))
    likelihood = gather(model, groups, parameters, theta, lambda _: None)
    x, _, holds = fit(model, groups, parameters, theta, likelihood, nothing, low, high, lambda _: None, renew=0)
    assert x[own] == pytest.approx(kp - 1.0, abs=0.03) and holds == fresh
