"""Lags of drives by their closed form, readings of the torque, and verdicts on logs that contradict themselves."""

import json
from pathlib import Path

import numpy as np
import pytest

from mrwarp.robot_logs.causes.parameter import parameters_of
from mrwarp.robot_logs.forms.open_log import open_log
from mrwarp.robot_logs.replay_model import replay_model
from mrwarp.robot_logs.robot_diagnosis import diagnose_log
from mrwarp.robot_logs.robot_log import RobotLog, load_log
from mrwarp.robot_logs.robot_verdict import RobotDiagnosis
from mrwarp.robot_logs.slopes import slopes_of
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from mrwarp.robot_logs.window_replay import ParameterBatch, Replay, nuisances
from mrwarp.robot_logs.windows import cut_windows, mismatch
from mrwarp.sysid.settings import RobotFit, Settings
from tests.robot_logs.arm_log import heavy_arm

CASES = Path(__file__).resolve().parents[4] / "shared" / "cases"
at_hand = pytest.mark.skipif(not CASES.is_dir(), reason="small inputs that failed lie next to the repository")

ROTOR = """<mujoco><worldbody><body><joint name="r" axis="0 0 1" armature="0.5"/>
 <geom type="sphere" size="0.01" mass="1e-6" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""
INERTIA, DT = 0.5, 0.002


def rotor_log(folder: Path) -> RobotLog:
    """A rotor without friction under a torque that steps to 2 N·m at 0.7 s; its readings are nothing but zeros."""
    (folder / "r.xml").write_text(ROTOR)
    (folder / "log.json").write_text(json.dumps({"robot": "r.xml", "base": "fixed", "tau_is": "none"}))
    t = DT * np.arange(700)
    rows = np.stack([t, 0.0 * t, 0.0 * t, np.where(t > 0.7, 2.0, 0.0)], axis=1)
    np.savetxt(folder / "run.csv", rows, "%.7g", ",", header="t,q.r,qd.r,tau_ff.r", comments="")
    return load_log(folder)


@pytest.mark.parametrize("name", ["command_lag", "torque_lag"])
def test_a_lag_follows_the_step_of_a_torque(name: str, tmp_path: Path) -> None:
    """The rotor's speed is torque/inertia*(t - T*(1 - exp(-t/T))) after the step, within a step's rounding of T."""
    log, late = rotor_log(tmp_path), 0.02
    model = replay_model(tmp_path / "r.xml", log)
    parameters = parameters_of(model, log)
    theta = np.array([late if p.cause == name else 0.0 for p in parameters])
    for windows in cut_windows(model, log):
        count = windows.count
        batch = ParameterBatch.of(parameters, np.tile(theta, (count, 1)), model)
        found = Replay(model, windows).run(batch, np.arange(count), np.zeros((count, len(nuisances(model)))))
        for w in range(count):
            begin = log.runs[0].t[windows.start[w]]
            if not 0.3 < 0.702 - begin < 0.7 * windows.t[w, -1] + 0.3:
                continue
            since = np.maximum(begin + windows.t[w] - 0.702, 0.0)
            want = 2.0 / INERTIA * (since - late * (1.0 - np.exp(-since / late)))
            np.testing.assert_allclose(found["qd"][w, :, 0], want, rtol=0, atol=2.0 / INERTIA * 0.001)


def test_derivatives_of_readings_are_those_of_replays(tmp_path: Path) -> None:
    """An offset, a gain and gravity in the torque channel, about a robot that has some of each."""
    arm = heavy_arm(tmp_path)
    record(LogCfg(robot=str(arm), motions=(("chirp", 3.0),), tau="measured", seed=1), tmp_path / "log")
    log = load_log(tmp_path / "log")
    model = replay_model(arm, log)
    parameters, (windows,) = parameters_of(model, log), cut_windows(model, log)
    reading = [k for k, p in enumerate(parameters) if p.declared.reads is not None]
    theta = np.zeros(len(parameters))
    theta[reading] = 0.1
    slopes, count = slopes_of(model, windows, parameters, theta, lambda _: None), windows.count
    replay = Replay(model, slopes.windows)

    def rows(x: np.ndarray) -> np.ndarray:
        batch = ParameterBatch.of(parameters, np.tile(x, (count, 1)), model)
        left = mismatch(windows.measured, replay.run(batch, np.arange(count), np.zeros((count, len(nuisances(model))))))
        return np.concatenate([v.reshape(count, -1) for v in left.values()], axis=1)

    here = rows(theta)
    assert {parameters[k].cause for k in reading} == {f"torque_channel_{x}" for x in ("offset", "gain", "gravity")}
    for k in reading:
        more = theta.copy()
        more[k] += 1.0
        np.testing.assert_allclose(slopes.j[:, k], here - rows(more), rtol=0, atol=2e-4)  # float32 of some N·m


def _diagnosed(folder: Path, *hide: str) -> RobotDiagnosis:
    arm = heavy_arm(folder)
    motions = (("chirp", 6.0), ("slow", 4.0))
    record(LogCfg(robot=str(arm), motions=motions, hide=hide, seed=11, tau="measured"), folder / "log")
    return diagnose_log(arm, load_log(folder / "log"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hide", "name", "where", "size"),
    [
        (["torque_channel_offset=j3:-4"], "torque_channel_offset", "j3", -4.0),
        (["torque_channel_gain=*:0.7"], "torque_channel_gain", "robot", 0.7),
        (["torque_channel_gravity=*:-1"], "torque_channel_gravity", "robot", -1.0),
        (["command_lag=*:0.02"], "command_lag", "robot", 0.02),
    ],
)
def test_a_contradiction_is_named_with_its_size(
    hide: list[str], name: str, where: str, size: float, tmp_path: Path
) -> None:
    """Of a virtual arm, whose joints give and whose sensors are noisy."""
    (cause,) = _diagnosed(tmp_path, *hide).causes
    assert (cause.name, cause.where) == (name, where)
    low, high = next(iter(cause.parameters.values())).ci95
    assert low < size < high


@pytest.mark.slow
def test_drives_that_compensate_gravity_are_no_fault(tmp_path: Path) -> None:
    """A note says the share; no gain, motor or mass is blamed."""
    d = _diagnosed(tmp_path, "gravity_compensation=*:1")
    assert d.causes == () and any("no fault: the drive adds 1.0" in note for note in d.notes)


@pytest.mark.slow
@at_hand
@pytest.mark.parametrize(
    ("log", "robot", "names"),
    [
        ("torque_channel/nograv", "torque_channel/xarm7_plain.urdf", [("torque_channel_gravity", "robot")]),
        ("lag_not_delay/lag15", "lag_not_delay/joint.xml", [("command_lag", "motor")]),
        ("inertia_log/mjcf", "inertia_log/mjcf/quad.xml", []),
    ],
)
def test_public_logs_that_were_read_wrongly(log: str, robot: str, names: list[tuple[str, str]]) -> None:
    """The contradiction is named from a part of the log, and nothing else."""
    d = diagnose_log(CASES / robot, open_log(CASES / log), settings=Settings(robot_fit=RobotFit(seconds=20.0)))
    assert [(c.name, c.where) for c in d.causes] == names
