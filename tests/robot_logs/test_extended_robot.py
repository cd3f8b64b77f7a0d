"""The robot that a verdict writes carries its corrections, and says which it cannot."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mrwarp.robot_logs.causes import parameters_of
from mrwarp.robot_logs.extended_robot import write_extended
from mrwarp.robot_logs.replay_model import replay_model
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from mrwarp.usd.asset import load_robot


def test_robot_usda_carries_gain_and_rotor_inertia_and_names_what_it_cannot(tmp_path: Path) -> None:
    """Dry friction has no place in the robot's USD file: the note says so."""
    record(LogCfg(motions=(("chirp", 1.0),), seed=5), tmp_path / "log")
    log = load_log(tmp_path / "log")
    model = replay_model(Path("mr_go"), log)
    parameters = parameters_of(model, log)
    changed = {("rotor_inertia", "FL_calf"): 0.004, ("kp", "FL_calf"): 0.2, ("coulomb_friction", "FL_calf"): 0.3}
    theta = np.array([changed.get((p.cause, p.where), 0.0) for p in parameters])
    d = SimpleNamespace(parameters=parameters, theta=theta, model=model, log=log, session={})
    out = tmp_path / "out"
    out.mkdir()
    names, notes = write_extended(d, out)
    assert names == ["robot.usda", "model.json"]
    assert notes == ["robot.usda has no place for coulomb_friction: model.json has the numbers"]
    old, new = load_robot(robot="mr_go"), load_robot(robot=str(out / "robot.usda"))
    for before, after in zip(old.actuators, new.actuators, strict=True):
        assert after.kp == pytest.approx(before.kp * (1.2 if after.joint == "FL_calf" else 1.0))
    path = new.stage.GetDefaultPrim().GetPath().AppendPath("joints/FL_calf")
    armature = [a.stage.GetPrimAtPath(path).GetAttribute("newton:armature").Get() for a in (old, new)]
    assert armature[1] - armature[0] == pytest.approx(0.004, abs=1e-6)
