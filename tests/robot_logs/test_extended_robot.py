"""The robot that a verdict writes carries its corrections, and says which it cannot."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mrwarp.env.sim_model import build_scene
from mrwarp.robot_logs.causes.parameter import parameters_of
from mrwarp.robot_logs.extended_robot import write_extended
from mrwarp.robot_logs.replay_model import replay_model
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from mrwarp.usd.asset import load_robot

EPS = float(np.finfo(np.float32).eps)


def test_robot_usda_carries_gain_and_rotor_inertia_and_names_what_it_cannot(tmp_path: Path) -> None:
    """A delay has no place in the robot's USD file: the note says so.

    Its numbers are float32; MuJoCo read the described ones with six digits.
    """
    record(LogCfg(motions=(("chirp", 1.0),), seed=5), tmp_path / "log")
    log = load_log(tmp_path / "log")
    model = replay_model(Path("mr_go"), log)
    parameters = parameters_of(model, log)
    changed = {
        ("rotor_inertia", "FL_calf"): 0.004, ("kp", "FL_calf"): 0.2, ("coulomb_friction", "FL_calf"): 0.3,
        ("viscous_friction", "RR_hip"): 0.05, ("coil_dead", "RL_calf"): -1.0, ("device_drag", "RR_calf"): 0.4,
        ("coil_lag", "FR_calf"): 0.02, ("torque_limit", "FR_hip"): -0.1,
        ("motor_strength", "RL_hip"): -0.2, ("link_com", "RL_hip"): 0.002, ("command_delay", "robot"): 0.004,
    }  # fmt: skip
    theta = np.array([changed.get((p.cause, p.where), 0.0) for p in parameters])
    d = SimpleNamespace(parameters=parameters, theta=theta, model=model, log=log, session={})
    out = tmp_path / "out"
    out.mkdir()
    names, notes = write_extended(d, out)
    assert names == ["robot.usda", "model.json"]
    assert notes == ["robot.usda has no place for command_delay: model.json has the numbers"]
    old, new = load_robot(robot="mr_go"), load_robot(robot=str(out / "robot.usda"))
    for before, after in zip(old.actuators, new.actuators, strict=True):
        assert after.kp == pytest.approx(before.kp * {"FL_calf": 1.2, "RL_hip": 0.8}.get(after.joint, 1.0))
        j = log.joints.index(after.joint)
        limit = {"FR_hip": 0.9 * model.asked[j], "RL_hip": 0.8 * before.tau_limit}.get(after.joint, before.tau_limit)
        assert after.tau_limit == pytest.approx(limit)
    path = new.stage.GetDefaultPrim().GetPath().AppendPath("joints/FL_calf")
    armature = [a.stage.GetPrimAtPath(path).GetAttribute("newton:armature").Get() for a in (old, new)]
    assert armature[1] - armature[0] == pytest.approx(0.004, abs=(5e-6 + EPS) * armature[1])
    hip = new.stage.GetDefaultPrim().GetPath().AppendChild("RL_hip")
    centers = [np.array(a.stage.GetPrimAtPath(hip).GetAttribute("physics:centerOfMass").Get()) for a in (old, new)]
    mass = new.stage.GetPrimAtPath(hip).GetAttribute("physics:mass").Get()
    np.testing.assert_allclose(mass * (centers[1] - centers[0]), 0.002, rtol=1e-5)  # of float32 centres
    scene = build_scene(new, dt=0.005)
    joints = np.array([a.joint for a in new.actuators])
    np.testing.assert_allclose(scene.friction, 0.3 * (joints == "FL_calf") + 0.4 * (joints == "RR_calf"), rtol=EPS)
    dead = new.actuators[list(joints).index("RL_calf")].mr
    slow = new.actuators[list(joints).index("FR_calf")].mr
    assert slow is not None and slow.coil.coil_time_constant == pytest.approx(0.02)
    assert dead is not None and dead.bouc_wen.K1 == 0.0 and dead.hold.T_max <= 1e-6
    np.testing.assert_allclose(scene.damping, 0.05 * (joints == "RR_hip"), rtol=EPS)
