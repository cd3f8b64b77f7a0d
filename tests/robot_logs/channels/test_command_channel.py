"""Targets that resting joints contradict are refused with their size; those of healthy and faulty robots are kept.

A hand that moves a robot against its targets is no fault of them.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
import pytest

from mrwarp.robot_logs.causes.parameter import parameters_of
from mrwarp.robot_logs.channels.command_channel import check_commands
from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.robot_log import LogError, LogRun, RobotLog, load_log
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from tests.robot_logs.arm_log import heavy_arm

SHARED = Path(__file__).resolve().parents[4] / "shared"


def arm(
    folder: Path, *hide: str, tau: Literal["none", "measured"] = "none", seconds: float = 6.0
) -> tuple[ReplayModel, RobotLog]:
    """A held arm of three joints that goes to poses and rests there."""
    path = heavy_arm(folder)
    record(LogCfg(robot=str(path), motions=(("steps", seconds),), hide=hide, tau=tau, seed=5), folder / "log")
    log = load_log(folder / "log")
    return replay_model(path, log), log


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> tuple[ReplayModel, RobotLog]:
    """That arm without a fault."""
    return arm(tmp_path_factory.mktemp("healthy"), seconds=10.0)


HAND = 4.5, 13.5
"""Begin and end of a hand's grip [s]."""


def hand_held(folder: Path, lead: Callable[[float], float]) -> tuple[ReplayModel, RobotLog]:
    """An arm whose second joint a hand leads by ``lead`` of the time [s], rad; it moves by itself before and after."""
    dt, kp, kd = 0.005, np.array([120.0, 150.0, 60.0]), np.array([6.0, 8.0, 3.0])
    path, rng = heavy_arm(folder), np.random.default_rng(3)
    robot = mujoco.MjModel.from_xml_path(str(path))
    robot.opt.timestep = 0.1 * dt
    data, home = mujoco.MjData(robot), np.array([0.2, 0.5, 0.3])
    data.qpos[:], rows, at = home, [], home[1]
    for t in dt * np.arange(4000):
        wave = home + [0.4 * np.sin(1.1 * t), 0.3 * np.sin(1.7 * t), 0.3 * np.sin(2.3 * t)]
        target, held = wave if t < HAND[0] - 0.5 or t > HAND[1] + 0.5 else home, HAND[0] < t < HAND[1]
        at = at + np.clip(home[1] + lead(t) - at, -4.0 * dt, 4.0 * dt) if held else data.qpos[1]
        seen, data.ctrl[:] = np.stack([data.qpos, data.qvel]), target
        for _ in range(10):
            data.qfrc_applied[1] = (900.0 * (at - data.qpos[1]) - 30.0 * data.qvel[1]) if held else 0.0
            mujoco.mj_step(robot, data)
        tau = kp * (target - seen[0]) - kd * seen[1]
        noisy = np.stack([*seen, tau]) + rng.normal(size=(3, 3)) * [[2e-4], [0.01], [0.1]]
        rows.append(np.concatenate([noisy.ravel(), target]))
    table = np.array(rows).reshape(-1, 4, 3)
    run = LogRun(
        id="hand",
        t=dt * np.arange(len(table)),
        joint=dict(zip(("q", "qd", "tau", "q_des"), np.moveaxis(table, 1, 0), strict=True)),
    )
    log = RobotLog(
        path=folder, robot="", base="fixed", joints=("j1", "j2", "j3"), kp=kp, kd=kd, tau_is="measured", runs=(run,)
    )
    return replay_model(path, log), log


def asked(log: RobotLog, change: Callable[[np.ndarray], np.ndarray]) -> RobotLog:
    """The log with other targets, (N, J)."""
    return replace(
        log, runs=tuple(replace(run, joint={**run.joint, "q_des": change(run.joint["q_des"])}) for run in log.runs)
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (np.degrees, "q_des of j3 is 57"),
        (lambda x: x * [1.0, 57.3, 1.0], '"units": {"q_des": "deg"}'),
        (lambda x: x * [1.0, 1.0, -1.0], "q_des of j3 is -1 times"),
        (lambda x: x[:, [1, 2, 0]], "q_des of j2 is what j3 needs"),
        (lambda x: x + [0.0, 0.5, 0.0], "q_des of j2 is +0.5"),
        (lambda x: np.where([False, False, True], x[0], x), "q_des of j3 stands still while it rests from"),
        (lambda x: np.concatenate([x[20:], np.repeat(x[-1:], 20, axis=0)]), "q_des acts 1"),
        (lambda x: np.concatenate([np.repeat(x[:1], 20, axis=0), x[:-20]]), "ms before its row"),
    ],
    ids=["degrees", "one in degrees", "sign", "order", "offset", "frozen", "late", "early"],
)
def test_targets_that_rests_contradict_are_refused(
    change: Callable[[np.ndarray], np.ndarray], said: str, healthy: tuple[ReplayModel, RobotLog]
) -> None:
    """Each with its joint, its size and the remedy; joints whose targets are right are not named."""
    model, log = healthy
    check_commands(model, log)
    with pytest.raises(LogError) as refused:
        check_commands(model, asked(log, change))
    assert said in str(refused.value), str(refused.value)
    right = (change(log.runs[0].joint["q_des"]) == log.runs[0].joint["q_des"]).all(axis=0)
    assert not any(f"of {joint} " in str(refused.value) for joint, same in zip(log.joints, right, strict=True) if same)


@pytest.mark.parametrize(
    ("hide", "tau"),
    [
        ("encoder_offset=j2:0.1", "measured"),
        ("link_mass=l3:2", "measured"),
        ("kp=*:0.6", "measured"),
        ("coulomb_friction=j2:4", "measured"),
        ("coulomb_friction=j2:4", "none"),
        ("command_delay=0.02", "none"),
        ("command_lag=*:0.06", "none"),
        ("torque_lag=*:0.04", "none"),
    ],
)
def test_faults_of_robots_are_none_of_their_targets(
    hide: str, tau: Literal["none", "measured"], tmp_path: Path
) -> None:
    """They droop and stick, and are for the replay to name; no hand is taken for their reason."""
    model, log = arm(tmp_path, hide, tau=tau)
    assert check_commands(model, log) is log


LEADS: dict[str, Callable[[float], float]] = {
    "rests": lambda t: [0.0, 0.25, 0.5, 0.1, -0.3, 0.4][int(t / 2.0) % 6],
    "sways": lambda t: 0.4 * np.sin(3.0 * t),
}


@pytest.mark.parametrize("lead", LEADS)
def test_a_hand_is_left_out_where_the_torque_shows_it(lead: str, tmp_path: Path) -> None:
    """Under targets that stand still it moves the robot: by the torque channel they are right, without it unclear."""
    model, log = hand_held(tmp_path, LEADS[lead])
    seen = check_commands(model, log)
    assert "a hand or another force from outside moves j2" in seen.notes[-1]
    times = [float(run.id.split()[2]) + run.t for run in seen.runs]
    inside = [((t > HAND[0]) & (t < HAND[1])).sum() for t in times]
    outside = [((t < HAND[0]) | (t > HAND[1] + 0.5)).sum() for t in times]
    assert sum(inside) < 0.15 * (HAND[1] - HAND[0]) / log.runs[0].dt, "what it does not move may stay"
    assert sum(outside) > 0.85 * (20.0 - np.diff(HAND)[0] - 0.5) / log.runs[0].dt
    if lead == "rests":
        with pytest.raises(LogError, match="no command, or a hand moved it; a measured torque"):
            check_commands(model, replace(log, tau_is="none"))


def test_dry_friction_of_a_slide_is_no_hand(tmp_path: Path) -> None:
    """Its speeds are metres per second: at none of them would friction be full, were they taken for a hinge's."""
    (tmp_path / "log").mkdir()
    joint = '<joint name="z" type="slide" axis="0 0 1"/><geom size="0.05" mass="2"/>'
    (tmp_path / "robot.xml").write_text(f"<mujoco><worldbody><body>{joint}</body></worldbody></mujoco>")
    t, rng, kp, kd = 0.004 * np.arange(3000), np.random.default_rng(2), 12000.0, 300.0
    q = 0.06 * np.sin(2.1 * t) + 0.01 * np.sin(9.0 * t)
    qd = np.gradient(q, t)
    tau = 2.0 * (np.gradient(qd, t) + 9.81) + 15.0 * np.sign(qd)
    rows = np.stack([t, q, qd, tau + rng.normal(0.0, 0.05, len(t)), q + (tau + kd * qd) / kp], axis=1)
    np.savetxt(tmp_path / "log" / "run.csv", rows, delimiter=",", header="t,q.z,qd.z,tau.z,q_des.z", comments="")
    (tmp_path / "log" / "log.json").write_text(
        json.dumps({"robot": "../robot.xml", "base": "fixed", "kp": kp, "kd": kd, "tau_is": "estimate"})
    )
    log = load_log(tmp_path / "log")
    model = replay_model(tmp_path / "robot.xml", log)
    seen = check_commands(model, log)
    assert sum(run.samples for run in seen.runs) == len(t)
    units = {p.cause: p.unit for p in parameters_of(model, log) if p.where == "z"}
    assert (units["coulomb_friction"], units["viscous_friction"], units["encoder_offset"]) == ("N", "N·s/m", "m")
    assert units["kp"] == "N/m" and units["torque_lag"] == "s"


@pytest.mark.parametrize("seed", [2, 3, 5])
def test_the_constant_weight_on_a_slide_is_no_hand(seed: int, tmp_path: Path) -> None:
    """It looks like an offset: how much of the torque is which is not known, and that it is one of them is."""
    slide = '<body><joint name="z" type="slide" armature="3"/><geom size="0.05" mass="1.3"/></body>'
    (tmp_path / "robot.xml").write_text(f"<mujoco><worldbody>{slide}</worldbody></mujoco>")
    t, rng = 0.01 * np.arange(600), np.random.default_rng(seed)
    waves = ((0.06, 2.1), (0.01, 9.0))
    q, qd, qdd = (np.sum([s * w**k * np.sin(w * t + 0.5 * np.pi * k) for s, w in waves], axis=0) for k in range(3))
    tau = 4.3 * qdd + 1.3 * 9.81 + 20.0 * qd + 5.0 * np.tanh(qd / 0.003)
    q_des, read = q + (tau + 300.0 * qd) / 12000.0, [q + rng.normal(0.0, 2e-4, 600), qd + rng.normal(0.0, 0.02, 600)]
    rows = np.column_stack([t, *read, q_des, tau])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,q.z,qd.z,q_des.z,tau.z", comments="")
    header = {"robot": "robot.xml", "base": "fixed", "kp": 12000.0, "kd": 300.0, "tau_is": "measured"}
    (tmp_path / "log.json").write_text(json.dumps(header))
    log = load_log(tmp_path)
    assert check_commands(replay_model(tmp_path / "robot.xml", log), log) is log


def test_a_torque_that_targets_do_not_ask_for_is_no_hand(tmp_path: Path) -> None:
    """Targets that stand still in a log whose torque is that of the links: they are no command."""
    model, log = arm(tmp_path, tau="measured")
    frozen = asked(log, lambda x: np.where([False, False, True], x[0], x))
    with pytest.raises(LogError, match="q_des of j3 stands still"):
        check_commands(model, frozen)


@pytest.mark.parametrize(
    ("log", "robot"),
    [
        ("robot_logs/go2_air", "robots/go2/go2.xml"),
        ("robot_logs/double_pendulum", "robot_logs/double_pendulum/dfki_double_pendulum_C1.xml"),
        ("cases/gravity_in_drive/log", "cases/torque_channel/xarm7_plain.urdf"),
        ("cases/inertia_log/mjcf", "cases/inertia_log/mjcf/quad.xml"),
    ],
)
def test_real_logs_are_kept(log: str, robot: str) -> None:
    """Robots that were diagnosed, and one whose drives add gravity's torque by themselves."""
    if not ((SHARED / log).is_dir() and (SHARED / robot).is_file()):
        pytest.skip("logs of robots lie next to the repository where at hand")
    read = load_log(SHARED / log)
    check_commands(replay_model(SHARED / robot, read), read)
