"""Elastic drives and a base that gives way are found by the torque that rigid bodies leave; in healthy arms none."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mrwarp.robot_logs.causes.of_hidden import DAMPING
from mrwarp.robot_logs.causes.parameter import parameters_of
from mrwarp.robot_logs.channels.hidden_dynamics import answered, behind, by_chance, with_oscillator
from mrwarp.robot_logs.channels.joint_torque import torques_along
from mrwarp.robot_logs.replay_model import Hidden, replay_model
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.unexplained import unconfirmed
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from tests.robot_logs.arm_log import arm_log, drawn_arm, heavy_arm


def found(folder: Path, *hide: str, seed: int = 3) -> Hidden | None:
    """The hidden motion of an arm of three joints, whose numbers are drawn for any other seed."""
    arm = heavy_arm(folder) if seed == 3 else drawn_arm(folder, seed)
    motions = (("chirp", 8.0), ("steps", 3.0))
    record(LogCfg(robot=str(arm), motions=motions, hide=hide, seed=seed, tau="none"), folder / "log")
    log = load_log(folder / "log")
    return with_oscillator(replay_model(arm, log), log).hidden


def test_an_oscillator_resonates_at_its_frequency() -> None:
    """Gain 1 at rest, 1/(2*damping) at its natural frequency, by the closed form of a forced oscillator."""
    t = np.arange(0.0, 40.0, 0.001)
    for ratio in (0.0, 0.5, 1.0, 2.0):
        x = behind(np.cos(2.0 * np.pi * 5.0 * ratio * t), 0.001, 5.0)[-10000:]
        gain = 1.0 / np.hypot(1.0 - ratio**2, 2.0 * DAMPING * ratio)
        assert np.abs(x).max() == pytest.approx(gain, rel=1e-2)


@pytest.mark.parametrize(
    ("hide", "joint", "frequency"),
    [("series_elasticity=j3:6", 2, 6.0), pytest.param("base_compliance=4", -1, 4.0, marks=pytest.mark.slow)],
)
def test_a_hidden_motion_is_found_with_its_frequency(hide: str, joint: int, frequency: float, tmp_path: Path) -> None:
    """Of a virtual robot with one hinge more; within a fifth, for a link's inertia changes with the pose."""
    seen = found(tmp_path, hide)
    assert seen is not None and joint in (seen.joint, *seen.rivals)
    assert seen.frequency == pytest.approx(frequency, rel=0.2)


@pytest.mark.parametrize("hide", [pytest.param("", marks=pytest.mark.slow), "command_delay=0.012"])
def test_rigid_robots_hide_no_motion(hide: str, tmp_path: Path) -> None:
    """Healthy or with another fault, which its own cause explains."""
    assert found(tmp_path, *([hide] if hide else [])) is None


@pytest.mark.parametrize("width", [1, 30])
def test_what_chance_explains_is_rarely_more_than_its_limit(width: int) -> None:
    """Of independent series, white or smooth over 30 samples: in about one of ten tries."""
    rng, beyond = np.random.default_rng(0), 0
    for _ in range(300):
        x, y = (np.convolve(rng.normal(size=1200), np.ones(width), "same") for _ in range(2))
        beyond += int((x @ y) ** 2 / ((x @ x) * (y @ y)) > by_chance(x, y, 1, 0.1))
    assert 10 <= beyond <= 50
    assert by_chance(x, y, 100, 0.1) > 2.0 * by_chance(x, y, 1, 0.1)


def test_the_described_robot_answers_targets_as_the_healthy_one_did(tmp_path: Path) -> None:
    """Of plain MuJoCo, with readings of 0.2 mrad; no speeds are left, which have another noise."""
    log = load_log(arm_log(tmp_path, seconds=3.0))
    model, run = replay_model(tmp_path / "arm.xml", log), log.runs[0]
    own = answered(model, log, run, torques_along(model, log, run, 0.03))
    assert np.abs(own.joint["q"] - run.joint["q"]).max() < 0.005 and "qd" not in own.joint


def test_noise_of_encoders_hides_no_motion(tmp_path: Path) -> None:
    """It is in the oscillator's torque and in the torque that is left, and no answer to the targets."""
    inner = '<body pos="0.25 0 0"><joint name="z" type="slide"/><geom size="0.04" mass="1.3"/></body>'
    for name, length, mass in (("b", 0.25, 2.5), ("a", 0.3, 4.0)):
        rod = f'<geom type="capsule" size="0.045" fromto="0 0 0 {length} 0 0" mass="{mass}"/>'
        inner = f'<body pos="{"0.3 0 0" if name == "b" else "0 0 0.4"}"><joint name="{name}"/>{rod}{inner}</body>'
    (tmp_path / "robot.xml").write_text(f"<mujoco><worldbody>{inner}</worldbody></mujoco>")
    robot, t, kp, kd = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml")), 0.004 * np.arange(2000), 400.0, 12.0
    data, rng, w, tau = mujoco.MjData(robot), np.random.default_rng(0), np.array([1.3, 1.7, 2.1]), np.zeros((2000, 3))
    parts = [(size * np.array([0.9, 0.9, 0.06]), times * w) for size, times in ((1.0, 1.0), (0.12, 4.0))]
    motion = [np.sum([s * v**k * np.sin(np.outer(t, v) + 0.5 * k * np.pi) for s, v in parts], 0) for k in range(3)]
    for k, row in enumerate(np.stack(motion, axis=1)):
        data.qpos[:], data.qvel[:], data.qacc[:] = row
        mujoco.mj_inverse(robot, data)
        tau[k] = data.qfrc_inverse
    read = [x + rng.normal(0.0, noise, x.shape) for x, noise in zip(motion, (2e-4, 0.02), strict=False)]
    names = ",".join(["t", *(f"{channel}.{x}" for channel in ("q", "qd", "q_des") for x in "abz")])
    rows = np.column_stack([t, *read, motion[0] + (tau + kd * motion[1]) / kp])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=names, comments="")
    (tmp_path / "log.json").write_text(json.dumps({"robot": "robot.xml", "base": "fixed", "kp": kp, "kd": kd}))
    log = load_log(tmp_path)
    assert with_oscillator(replay_model(tmp_path / "robot.xml", log), log).hidden is None


@pytest.mark.parametrize(("left", "reported"), [(1.0, True), (0.5, True), (0.01, False)])
def test_what_causes_explain_is_no_hidden_motion(left: float, reported: bool, tmp_path: Path) -> None:
    """A lag of a drive moves much as a link on a spring: once it is named, little is left for a spring to explain."""
    arm = heavy_arm(tmp_path)
    record(LogCfg(robot=str(arm), motions=(("slow", 1.0),), seed=3, tau="none"), tmp_path / "log")
    log = load_log(tmp_path / "log")
    blank = tuple(np.zeros((run.samples, 3)) for run in log.runs)
    hidden = Hidden(joint=1, frequency=9.0, torque=blank, share=0.3, rivals=())
    model = replace(replay_model(arm, log), hidden=hidden)
    seen = unconfirmed(model, parameters_of(model, log), log, left)
    assert (seen is not None) == reported and (seen is None or "9.0 Hz" in seen.form)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "hide", "joint", "frequency"),
    [
        (121, "series_elasticity=j2:6.83", 1, 6.83),
        (123, "series_elasticity=j1:3.65", 0, 3.65),
        (132, "base_compliance=7.42", -1, 7.42),
        (103, "", None, None),
        (112, "coulomb_friction=j2:2", None, None),
        (113, "link_mass=l3:0.4", None, None),
    ],
)
def test_arms_of_drawn_numbers(
    seed: int, hide: str, joint: int | None, frequency: float | None, tmp_path: Path
) -> None:
    """None of them was there when a threshold was chosen; a base may pass for a drive, with itself as alternative."""
    seen = found(tmp_path, *([hide] if hide else []), seed=seed)
    assert (seen is None) == (joint is None)
    if seen is not None:
        assert joint in (seen.joint, *seen.rivals) and seen.frequency == pytest.approx(frequency, rel=0.1)
