"""Record logs of a virtual robot: one file per motion, ``log.json`` as the contract has it, the truth next to it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np

from mrwarp.rl.policy import OnnxPolicy
from mrwarp.robot_logs.forms.save_log import Kind, save_log
from mrwarp.robot_logs.robot_log import BASE_CHANNELS, JOINT_CHANNELS, LogRun, TauIs, make_log
from mrwarp.robot_logs.virtual.described_robot import STEP, Description, describe
from mrwarp.robot_logs.virtual.hidden_effects import Hidden, parse_all
from mrwarp.robot_logs.virtual.log_sensors import Clean, sense
from mrwarp.robot_logs.virtual.motions import AIR, WITH_DEVICES, Drives, Readings, make_motion
from mrwarp.robot_logs.virtual.true_robot import TrueRobot
from mrwarp.run_dir import write_text

TRUTH_FILE = "truth.json"
"""The hidden truth; no command but a benchmark reads it."""

SETTLE = 1.0
"""Time on the ground before a recording begins [s]."""

FALLEN = 0.5
"""A robot has fallen when its trunk is lower than this share of its stance, or leans further than 1 rad."""

TRIES = 4
"""Times that a motion in which the robot fell is started again."""


@dataclass(frozen=True, kw_only=True)
class LogCfg:
    """Settings of a recording."""

    robot: str = "mr_go"
    motions: tuple[tuple[str, float], ...] = (("stand", 10.0), ("squat", 15.0), ("walk", 35.0))
    """Names and lengths [s]."""
    hide: tuple[str, ...] = ()
    """Effects, see :func:`mrwarp.robot_logs.virtual.hidden_effects.parse_hidden`."""
    policy: Path | None = None
    rate: int = 200
    """Rows per second: a multiple of 50."""
    current: float = 1.5
    """Current that the devices may use [A]."""
    speeds: tuple[float, float] | None = None
    """Commanded forward speeds [m/s]; None: 0.2 to 0.6 of the shipped robot, in the robot's own units."""
    tau: TauIs = "estimate"
    noise: float = 1.0
    session: float = 0.004
    """Largest offset of a joint in this session [rad]."""
    leave_out: tuple[str, ...] = ()
    """Channels that the log does not have."""
    motion_capture: bool = False
    seed: int = 0
    kind: Kind = "csv"

    @property
    def base(self) -> Literal["free", "fixed"]:
        """Whether the trunk floats."""
        return "fixed" if all(name in AIR for name, _ in self.motions) else "free"


class FallError(RuntimeError):
    """The robot falls whenever it is asked to move so."""


def record(cfg: LogCfg, out: Path, progress: Callable[[str, float], None] = lambda *_: None) -> dict[str, Any]:
    """Record a log into a folder; returns the figures.

    Raises:
        LogError: the robot cannot be read.
        ValueError: an effect or a motion is not of this robot.
        FallError: it falls again and again.
    """
    description = describe(cfg.robot)
    hidden = parse_all(cfg.hide, description.places)
    policy = _policy(cfg, description)
    rng = np.random.default_rng([cfg.seed, 28])
    robot = TrueRobot(description, hidden, fixed=cfg.base == "fixed", rng=rng, session=cfg.session)
    runs: list[tuple[str, np.ndarray, dict[str, np.ndarray]]] = []
    total, before = sum(seconds for _, seconds in cfg.motions), 0.0
    shifts = {h.where: h.value for h in hidden if h.cause == "clock_shift"}
    for k, (name, seconds) in enumerate(cfg.motions):
        for attempt in range(TRIES):
            draws = np.random.default_rng([cfg.seed, k, attempt])
            clean = _run(robot, cfg, name, seconds, policy, draws, lambda s: progress(name, (before + s) / total))  # noqa: B023
            if clean is not None:
                break
        else:
            raise FallError(
                f"{cfg.robot}: it falls in each of {TRIES} tries of {name}; hide less or choose another --policy"
            )
        before += seconds
        runs.append((f"{k + 1:02d}_{name}", *sense(clean, shifts, cfg.noise, draws)))
    return _write(cfg, description, robot, hidden, runs, out)


def _policy(cfg: LogCfg, d: Description) -> OnnxPolicy | None:
    names = [name for name, _ in cfg.motions]
    grounded = [name for name in names if name not in AIR]
    if grounded and d.layout is None:
        raise ValueError(f"--motion {grounded[0]}: {d.path} stands on no feet; its motions are {', '.join(AIR)}")
    if grounded and len(grounded) < len(names):
        air = next(name for name in names if name in AIR)
        raise ValueError(
            f"--motion {grounded[0]} {air}: one needs the ground, the other a trunk held in the air; record two logs"
        )
    if "walk" not in names:
        return None
    if cfg.policy is None:
        raise ValueError("--motion walk: which policy? add --policy FILE.onnx")
    policy = OnnxPolicy(cfg.policy)
    if policy.joints != len(d.joints):
        raise ValueError(
            f"{cfg.policy}: made for {policy.joints} joints, {cfg.robot} has {len(d.joints)}; train one for it"
        )
    return policy


def _run(
    robot: TrueRobot,
    cfg: LogCfg,
    name: str,
    seconds: float,
    policy: OnnxPolicy | None,
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> Clean | None:
    """One motion, or None if the robot fell; the recording begins when it has settled."""
    d, dt = robot.description, 1.0 / cfg.rate
    robot.reset()
    motion, drives = (
        make_motion(name, d, rng, seconds, policy, cfg.speeds),
        Drives(d, cfg.current if name in WITH_DEVICES else 0.0),
    )
    settle = 0 if robot.fixed else round(SETTLE / dt)
    count = round(seconds / dt)
    height = float(robot.data.qpos[2]) if not robot.fixed else 0.0
    rows: dict[str, list[np.ndarray]] = {}
    for k in range(-settle, count):
        seen = _readings(robot, max(k, 0) * dt, cfg.noise, rng)
        q_des = motion(seen) if k >= 0 else d.neutral
        command = drives(q_des, seen)
        if k >= 0:
            values = _row(robot, seen) | {
                "q_des": q_des,
                "kp": command.kp,
                "kd": command.kd,
                "current_cmd": command.coil,
            }
            for column, value in values.items():
                rows.setdefault(column, []).append(value.copy())
        robot.send(command)
        robot.advance(dt)
        if not robot.fixed and (robot.data.qpos[2] < FALLEN * height or seen.gravity[2] > -0.54):
            return None
        if k % cfg.rate == 0:
            progress(max(k, 0) * dt)
    return Clean(t=np.arange(count) * dt, columns={column: np.array(values) for column, values in rows.items()})


def _readings(robot: TrueRobot, t: float, noise: float, rng: np.random.Generator) -> Readings:
    """Readings of the controller; they have noise of their own, as the log's is drawn later."""
    gyro, gravity = np.zeros(3), np.array([0.0, 0.0, -1.0])
    tilt = _tilt(robot)
    if not robot.fixed:
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, robot.data.qpos[3:7])
        gravity = tilt.T @ -turn.reshape(3, 3)[2]
        gyro = tilt.T @ robot.data.qvel[3:6] + _values(robot, "gyro_bias", 3)
    joints = len(robot.description.joints)
    return Readings(
        t=t,
        q=robot.q + noise * 8e-5 * rng.standard_normal(joints),
        qd=robot.speed + noise * 0.015 * rng.standard_normal(joints),
        gyro=gyro + noise * 0.004 * rng.standard_normal(3),
        gravity=gravity,
        forces=robot.foot_forces(),
    )


def _values(robot: TrueRobot, cause: str, count: int) -> np.ndarray:
    return np.array(robot.hidden[cause][0].values) if cause in robot.hidden else np.zeros(count)


def _tilt(robot: TrueRobot) -> np.ndarray:
    """Axes of the inertial sensor in the trunk's frame, shape (3, 3)."""
    roll, pitch = _values(robot, "imu_tilt", 2)
    matrix, quat = np.zeros(9), np.zeros(4)
    mujoco.mju_euler2Quat(quat, np.array([roll, pitch, 0.0]), "xyz")
    mujoco.mju_quat2Mat(matrix, quat)
    return matrix.reshape(3, 3)


def _row(robot: TrueRobot, seen: Readings) -> dict[str, np.ndarray]:
    """One row without noise."""
    found = {"q": robot.q, "qd": robot.speed, "tau": robot.torque_reading, "current": robot.coil}
    if robot.fixed:
        return found
    data, tilt, turn = robot.data, _tilt(robot), np.zeros(9)
    mujoco.mju_quat2Mat(turn, data.qpos[3:7])
    world = turn.reshape(3, 3) @ tilt
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, world.ravel())
    acceleration = world.T @ (data.qacc[:3] - robot.model.opt.gravity)
    gyro = tilt.T @ data.qvel[3:6] + _values(robot, "gyro_bias", 3)
    return found | {
        "quat": quat, "gyro": gyro, "acc": acceleration, "pos": data.qpos[:3], "vel": data.qvel[:3],
        "foot": seen.forces,
    }  # fmt: skip


def _write(
    cfg: LogCfg,
    d: Description,
    robot: TrueRobot,
    hidden: Sequence[Hidden],
    runs: list[tuple[str, np.ndarray, dict[str, np.ndarray]]],
    out: Path,
) -> dict[str, Any]:
    """Write recordings, ``log.json`` and the truth; returns the figures."""
    header = {
        "robot": cfg.robot, "base": cfg.base, "kp": _by(d.joints, d.kp), "kd": _by(d.joints, d.kd), "tau_is": cfg.tau,
        "source": "mrwarp log record",
    }  # fmt: skip
    logged = tuple(_logged(cfg, d, name, t, channels) for name, t, channels in runs)
    log = make_log(out, header, d.joints, logged)
    save_log(log, out, cfg.kind)
    truth = {
        "hidden": [h.to_dict() for h in hidden],
        "session": {"encoder": _by(d.joints, robot.encoder_zero), "drive": _by(d.joints, robot.drive_zero)},
        "engine": {"step": STEP, "cone": "elliptic", "integrator": "implicit"},
        "seed": cfg.seed,
    }
    write_text(out / TRUTH_FILE, json.dumps(truth, indent=1, ensure_ascii=False) + "\n")
    return {
        "recordings": [run.id for run in logged],
        "seconds": log.seconds,
        "rows": sum(run.samples for run in logged),
    }


def _logged(cfg: LogCfg, d: Description, name: str, t: np.ndarray, channels: dict[str, np.ndarray]) -> LogRun:
    """The channels that the log has."""
    if cfg.tau == "command":
        asked = channels["kp"] * (channels["q_des"] - channels["q"]) - channels["kd"] * channels["qd"]
        channels = channels | {"tau": asked}
    heat = np.cumsum(channels["tau"] ** 2, axis=0) * (t[-1] / max(len(t) - 1, 1)) * 5e-4
    channels = channels | {"temperature": np.round(30.0 + heat)}  # each motor is warmed by its torque, in whole degrees
    left_out = {"kd", *cfg.leave_out}  # kd never varies
    left_out |= {"tau"} if cfg.tau == "none" else set()
    left_out |= set() if cfg.motion_capture else {"pos", "vel"}
    left_out |= set() if d.devices else {"kp", "current", "current_cmd"}
    kept = {channel: x for channel, x in channels.items() if channel not in left_out}
    slots = [device.joint for device in d.devices]
    for channel in {"current", "current_cmd"} & kept.keys():  # of the joints with a device
        whole = np.full((len(t), len(d.joints)), np.nan)
        whole[:, slots] = kept[channel]
        kept[channel] = whole
    feet = (
        dict(zip([leg.name for leg in d.layout.legs], kept["foot"].T, strict=True))
        if d.layout and "foot" in kept
        else {}
    )
    return LogRun(
        id=name,
        t=t,
        joint={c: kept[c] for c in JOINT_CHANNELS if c in kept},
        base={c: kept[c] for c in BASE_CHANNELS if c in kept},
        feet=feet,
        battery=None if "battery" in left_out else np.round(29.4 - 0.004 * t, 2),
    )


def _by(names: Sequence[str], values: np.ndarray) -> dict[str, float]:
    return {name: float(f"{value:.6g}") for name, value in zip(names, values, strict=True)}
