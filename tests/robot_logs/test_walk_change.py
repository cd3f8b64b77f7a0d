"""The walks of a policy on the robot as it is described and on the one that a verdict corrects."""

from pathlib import Path

import numpy as np
import pytest

from mrwarp.rl.policy import DEFAULT_POLICY
from mrwarp.robot_logs.causes.parameter import parameters_of
from mrwarp.robot_logs.replay_model import replay_model
from mrwarp.robot_logs.report.walk_change import HEAD, walk_change
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.robot_verdict import RobotDiagnosis
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from mrwarp.sysid.verdict import Error


def test_friction_and_a_load_cost_power(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With 3 kg on the trunk and 1 N·m of dry friction in the calves the same walks of a metre take more power."""
    monkeypatch.setattr("mrwarp.robot_logs.report.walk_change.DISTANCE", 1.0)
    record(LogCfg(motions=(("stand", 1.0),), seed=5), tmp_path / "log")
    log = load_log(tmp_path / "log")
    model = replay_model(Path("mr_go"), log)
    parameters = parameters_of(model, log)
    sizes = {"trunk_mass": 3.0, "coulomb_friction": 1.0}
    hidden = [sizes.get(p.cause, 0.0) * (p.cause != "coulomb_friction" or "calf" in p.where) for p in parameters]
    error = Error(rmse=1.0, nrmse=1.0, unit="1")
    d = RobotDiagnosis(
        verdict="named",
        sentence="",
        causes=(),
        cannot_know=(),
        baseline=error,
        extended=error,
        per_joint={},
        session={},
        parameters=tuple(parameters),
        theta=np.array(hidden),
        model=model,
        log=log,
        windows=(),
        seconds=0.0,
    )
    found = walk_change(d, DEFAULT_POLICY, trials=1, progress=lambda _: None)
    assert found is not None and [len(row) for row in found.rows()] == [len(HEAD)] * 2
    for old, new in zip(found.described, found.extended, strict=True):
        assert old["fell"] == new["fell"] == old["late"] == 0
        assert new["power"] > 1.1 * old["power"]
