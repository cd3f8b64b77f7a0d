"""A log's information on every number: many robots at once leave what each of them leaves alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mrwarp.robot_logs.causes import parameters_of
from mrwarp.robot_logs.evidence import gather, left_by_each, losses
from mrwarp.robot_logs.replay_model import replay_model
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.windows import cut_windows
from tests.robot_logs.arm_log import arm_log


def test_robots_that_are_replayed_at_once_leave_what_each_leaves(tmp_path: Path) -> None:
    """Of windows that count; a robot that is far off leaves more."""
    log = load_log(arm_log(tmp_path, seconds=3.0))
    model = replay_model(tmp_path / "arm.xml", log)
    parameters, groups = parameters_of(model, log), cut_windows(model, log)
    evidence = gather(model, groups, parameters, np.zeros(len(parameters)), lambda _: None)
    thetas = np.zeros((2, len(parameters)))
    thetas[1] = [0.2 * p.fault for p in parameters]
    together = left_by_each(evidence, model, groups, parameters, thetas)
    for theta, left in zip(thetas, together, strict=True):
        alone = losses(evidence, model, groups, parameters, np.tile(theta, (len(evidence.square), 1)))[0]
        assert left == pytest.approx(evidence.weight @ alone / evidence.scale, rel=1e-9)
    assert together[1] > 2.0 * together[0]
