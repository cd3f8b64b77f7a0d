"""ROS 2 bags and MCAP files (ROS 1 bags too) as robot logs: read by rosbags, which needs no ROS.

Topics are known by their messages: JointState, Imu, Odometry and PoseStamped, Unitree's LowState and LowCmd. What a bag
does not say (which topic commands, gains, the robot's own joint names) stands in a map, see docs/robot_logs.md.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mrwarp.robot_logs.forms.joint_messages import ARRAYS, JointMessages, order_of
from mrwarp.robot_logs.forms.mapped_log import joints_of_map, map_of
from mrwarp.robot_logs.robot_log import MIN_SAMPLES, LogError, LogRun, RobotLog, check_run, factors, make_log
from mrwarp.run_dir import one_line

MAX_MESSAGES = 20_000_000
"""Most messages that are read of a bag: 5 hours of state and commands at 500 Hz."""

COMMANDING = re.compile(r"cmd|command|target|desired|reference|goal", re.IGNORECASE)
"""Names of topics whose JointState is a command."""

READABLE = {
    "state": ("JointState", "LowState"),
    "command": ("JointState", "LowCmd", *ARRAYS),
    "imu": ("Imu",),
    "pose": ("Odometry", "PoseStamped"),
}
"""Messages that are read, by role."""

UNITREE_JOINTS = tuple(f"{leg}_{part}_joint" for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf"))
"""Order of the motors of Unitree's quadrupeds (Go1, Go2, A1, B1, B2), by the joint names of its URDF files."""

UNITREE_FEET = ("FR", "FL", "RR", "RL")
"""Order of Unitree's foot forces."""

_UNITREE = {
    "IMUState": "f4[4] quaternion,f4[3] gyroscope,f4[3] accelerometer,f4[3] rpy,i1 temperature",
    "MotorState": "u1 mode,f4 q,f4 dq,f4 ddq,f4 tau_est,f4 q_raw,f4 dq_raw,f4 ddq_raw,i1 temperature,u4 lost,"
    "u4[2] reserve",
    "BmsState": "u1 version_high,u1 version_low,u1 status,u1 soc,i4 current,u2 cycle,i1[2] bq_ntc,i1[2] mcu_ntc,"
    "u2[15] cell_vol",
    "LowState": "u1[2] head,u1 level_flag,u1 frame_reserve,u4[2] sn,u4[2] version,u2 bandwidth,IMUState imu_state,"
    "MotorState[20] motor_state,BmsState bms_state,i2[4] foot_force,i2[4] foot_force_est,u4 tick,"
    "u1[40] wireless_remote,u1 bit_flag,f4 adc_reel,i1 temperature_ntc1,i1 temperature_ntc2,f4 power_v,f4 power_a,"
    "u2[4] fan_frequency,u4 reserve,u4 crc",
    "MotorCmd": "u1 mode,f4 q,f4 dq,f4 tau,f4 kp,f4 kd,u4[3] reserve",
    "BmsCmd": "u1 off,u1[3] reserve",
    "LowCmd": "u1[2] head,u1 level_flag,u1 frame_reserve,u4[2] sn,u4[2] version,u2 bandwidth,MotorCmd[20] motor_cmd,"
    "BmsCmd bms_cmd,u1[40] wireless_remote,u1[12] led,u1[2] fan,u1 gpio,u4 reserve,u4 crc",
}
"""Fields of the messages of ``unitree_go`` as its documentation lists them: bags of older ROS 2 hold no definitions."""

_TYPES = {"f4": "float32", "i1": "int8", "i2": "int16", "i4": "int32", "u1": "uint8", "u2": "uint16", "u4": "uint32"}


def typestore() -> Typestore:
    """Messages of ROS 2 Humble and Unitree's, for bags that hold no definitions of their own."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types: dict[str, Any] = {}
    for name, fields in _UNITREE.items():
        text = "\n".join(re.sub(r"^[fiu]\d", lambda m: _TYPES[m[0]], x.strip()) for x in fields.split(","))
        text = re.sub(r"^(IMUState|MotorState|BmsState|MotorCmd|BmsCmd)\b", r"unitree_go/\1", text, flags=re.MULTILINE)
        types.update(get_types_from_msg(text, f"unitree_go/msg/{name}"))
    store.register(types)
    return store


@dataclass
class _Series:
    """Messages of one topic as columns: shape (N,) and (N, C)."""

    t: list[float] = field(default_factory=list)
    columns: dict[str, list[Any]] = field(default_factory=dict)

    def add(self, t: float, values: Mapping[str, Any]) -> None:
        self.t.append(t)
        for name, value in values.items():
            self.columns.setdefault(name, []).append(value)

    def arrays(self) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Rising stamps and the columns that every message has."""
        t, first = np.unique(np.array(self.t), return_index=True)
        whole = {name: np.array(x, dtype=float)[first] for name, x in self.columns.items() if len(x) == len(self.t)}
        return t, whole


def read_bag(path: Path, mapping: Mapping[str, Any] | None = None) -> RobotLog:
    """Read a bag as a log of one recording.

    Args:
        path: The bag.
        mapping: A map; without one, ``map.json`` next to the bag's files if it is there.

    Raises:
        LogError: it cannot be read, or does not say enough; the message says what the map must add.
    """
    if not path.exists():
        raise LogError(f"{path}: there is no such bag; check the path")
    chosen = dict(map_of(path) if mapping is None else mapping)
    try:
        with AnyReader([path], default_typestore=typestore()) as reader:
            return _read(path, reader, chosen)
    except LogError:
        raise
    except Exception as error:  # rosbags and its storages raise many types for damaged files
        known = isinstance(error, AnyReaderError | OSError)
        reason = one_line(error) if known else f"{type(error).__name__}: {one_line(error)}"
        raise LogError(f"{path}: is no bag that can be read ({reason[:200]}); record or copy it again") from None


def _read(path: Path, reader: AnyReader, m: dict[str, Any]) -> RobotLog:
    topics = {c.topic: c.msgtype for c in reader.connections}
    if sum(c.msgcount for c in reader.connections) > MAX_MESSAGES:
        raise LogError(f"{path}: more than {MAX_MESSAGES:g} messages; cut it with 'ros2 bag convert'")
    role = _roles(path, topics, m)
    # further topics of a role, which the map names in a list, count as its first
    first = {t: own[0] for own in (_listed(m.get(x)) for x in ("state", "command")) for t in own}
    series = {name: _Series() for name in role.values()}
    joints = {name: JointMessages() for name in role.values() if _is(topics[name], "JointState", *ARRAYS)}
    by_header, behind = m.get("clock", "header") == "header", list[float]()
    for connection, stamp, raw in reader.messages(
        [c for c in reader.connections if first.get(c.topic, c.topic) in series]
    ):
        message: Any = reader.deserialize(raw, connection.msgtype)
        t, topic = 1e-9 * stamp, first.get(connection.topic, connection.topic)
        header = getattr(message, "header", None)
        if by_header and header is not None and (header.stamp.sec or header.stamp.nanosec):
            t = header.stamp.sec + 1e-9 * header.stamp.nanosec
            if topic == role["state"]:
                behind.append(1e-9 * stamp - t)
        if _is(connection.msgtype, *ARRAYS):
            order, meaning = order_of(path, connection.topic, m, len(message.data))
            taken = [k for k, name in enumerate(order) if name]
            # an array has no stamp: it is put on the state's clock by how much later that one was recorded
            t -= float(np.median(behind)) if behind else 0.0
            joints[topic].add(t, [order[k] or "" for k in taken], {meaning: np.asarray(message.data)[taken]})
            continue
        values = _values(message, connection.msgtype)
        if topic in joints:
            joints[topic].add(t, values.pop("names"), values)
        else:
            series[topic].add(t, values)
    return _joined(path, m, role, {k: s.arrays() for k, s in series.items() if k not in joints}, joints, topics)


def _roles(path: Path, topics: Mapping[str, str], m: Mapping[str, Any]) -> dict[str, str]:
    """Topic of each role: state, command, imu, pose."""
    kinds = {
        "state": lambda t: _is(topics[t], "LowState") or (_is(topics[t], "JointState") and not COMMANDING.search(t)),
        "command": lambda t: (
            _is(topics[t], "LowCmd") or (_is(topics[t], "JointState", *ARRAYS) and COMMANDING.search(t))
        ),
        "imu": lambda t: _is(topics[t], "Imu"),
        "pose": lambda t: _is(topics[t], "Odometry", "PoseStamped"),
    }
    found: dict[str, str] = {}
    for role, fits in kinds.items():
        if role in m:
            if not m[role]:
                continue
            several = _listed(m[role]) if role in ("state", "command") else [m[role]]
            for name in several:  # several are merged by their joints' names
                readable = [kind for kind in READABLE[role] if len(several) == 1 or not kind.startswith("Low")]
                _check_topic(path, topics, role, name, readable)
            found[role] = several[0]
            continue
        fitting = [t for t in topics if fits(t)]
        named = [t for t in fitting if not _is(topics[t], *ARRAYS)]
        fitting = named or fitting  # an array says no joints: only where nothing else commands
        if role in ("state", "command") and any(not _is(topics[t], "JointState") for t in fitting):
            fitting = [t for t in fitting if not _is(topics[t], "JointState")]  # the robot's own hold gains too
        if len(fitting) > 1:
            shortest = [
                t for t in fitting if t.strip("/").lower() in ("joint_states", "lowstate", "lowcmd", "imu", "odom")
            ]
            fitting = shortest if len(shortest) == 1 else fitting
        if len(fitting) > 1:
            raise LogError(
                f"{path}: {len(fitting)} topics could be the {role}: {', '.join(fitting)}; "
                f'choose one in the map: {{"{role}": "{fitting[0]}"}}, or several in a list'
            )
        if fitting:
            found[role] = fitting[0]
    if "state" not in found:
        listed = ", ".join(f"{t} ({kind})" for t, kind in sorted(topics.items()))[:400]
        raise LogError(
            f'{path}: no JointState or LowState; name the topic in the map: {{"state": "/topic"}}; topics: {listed}'
        )
    return found


def _check_topic(path: Path, topics: Mapping[str, str], role: str, name: Any, readable: Sequence[str]) -> None:
    """Refuse a topic of the map that is none of the bag's, or of other messages than those ``readable``."""
    if not isinstance(name, str) or name not in topics:
        near = difflib.get_close_matches(str(name), list(topics), 1)
        hint = f"is it {near[0]}?" if near else f"topics: {', '.join(sorted(topics))[:300]}"
        raise LogError(f"{path}: the map's {role} {name!r} is no topic of the bag; {hint}")
    if not _is(topics[name], *readable):
        raise LogError(f"{path}: the map's {role} {name!r} is a {topics[name]}; read are {', '.join(readable)}")


def _is(kind: str, *names: str) -> bool:
    return kind.rpartition("/")[2] in names


def _get(message: Any, *names: str) -> Any:
    """The first of several spellings of a field."""
    for name in names:
        if hasattr(message, name):
            return getattr(message, name)
    raise AttributeError(names[0])


def _values(message: Any, kind: str) -> dict[str, Any]:
    """Numbers of a message by channel."""
    if _is(kind, "JointState"):
        found: dict[str, Any] = {"names": message.name}
        for channel, values in (("q", message.position), ("qd", message.velocity), ("tau", message.effort)):
            if len(values) == len(message.name):
                found[channel] = values
        return found
    if _is(kind, "Imu"):
        o, w, a = message.orientation, message.angular_velocity, message.linear_acceleration
        found = {"gyro": (w.x, w.y, w.z), "acc": (a.x, a.y, a.z)}
        return found | ({"quat": (o.w, o.x, o.y, o.z)} if abs(o.w) + abs(o.x) + abs(o.y) + abs(o.z) > 0.5 else {})
    if _is(kind, "Odometry"):
        p, o, v = message.pose.pose.position, message.pose.pose.orientation, message.twist.twist.linear
        return {"pos": (p.x, p.y, p.z), "turn": (o.w, o.x, o.y, o.z), "body_vel": (v.x, v.y, v.z)}
    if _is(kind, "PoseStamped"):
        p = message.pose.position
        return {"pos": (p.x, p.y, p.z)}
    motors = (
        _get(message, "motor_state", "motorState") if _is(kind, "LowState") else _get(message, "motor_cmd", "motorCmd")
    )
    if _is(kind, "LowCmd"):
        return {c: [getattr(x, c) for x in motors] for c in ("q", "dq", "tau", "kp", "kd")}
    imu = _get(message, "imu_state", "imu")
    heat = [np.max(np.atleast_1d(x.temperature)) for x in motors]
    found = {
        "q": [x.q for x in motors], "qd": [x.dq for x in motors],
        "tau": [_get(x, "tau_est", "tauEst") for x in motors], "temperature": heat,
        "quat": imu.quaternion, "gyro": imu.gyroscope, "acc": imu.accelerometer,
    }  # fmt: skip
    if hasattr(message, "foot_force") or hasattr(message, "footForce"):
        found["foot"] = _get(message, "foot_force", "footForce")
    return found | ({"battery": message.power_v} if hasattr(message, "power_v") else {})


def _joined(
    path: Path,
    m: dict[str, Any],
    role: Mapping[str, str],
    series: Mapping[str, tuple[np.ndarray, dict[str, np.ndarray]]],
    named: Mapping[str, JointMessages],
    topics: Mapping[str, str],
) -> RobotLog:
    """One recording on the state's stamps, from the first command on."""
    t, state, joints, source, notes = _states(path, m, role["state"], series, named)
    joint = {c: state[c] for c in ("q", "qd", "tau", "temperature") if c in state}
    base = {c: state[c] for c in ("quat", "gyro", "acc") if c in state}
    half = 0.5 * float(np.median(np.diff(t)))
    first = 0
    if "command" in role:
        asked, first = _asked(path, m, role["command"], series, named, source, t + half)
        joint |= {c: x for c, x in asked.items() if np.isfinite(x).any()}
        _switched_off(joint)
        if first:
            notes.append(f"{first} rows before the first command were left out")
    if "imu" in role:
        when, imu = series[role["imu"]]
        base |= {c: _resampled(t, when, x) for c, x in imu.items()}
    if "pose" in role:
        when, pose = series[role["pose"]]
        base["pos"] = _resampled(t, when, pose["pos"])
        if "body_vel" in pose:
            base["vel"] = _resampled(t, when, _turned(pose["turn"], pose["body_vel"]))
    notes += _not_read({t for x in (*role.values(), m.get("state"), m.get("command")) for t in _listed(x)}, topics)
    if "quat" in base:
        size = np.linalg.norm(base["quat"], axis=1, keepdims=True)
        base["quat"] = base["quat"] / np.where(size > 0.1, size, 1.0)
    feet = {}
    if "foot" in state:
        feet = dict(zip(m.get("feet", UNITREE_FEET), state["foot"].T, strict=False))
    keep = slice(first, None)
    factor = factors(f"{path}: the map or --units", m.get("units") or {})
    run = LogRun(
        id=path.stem or path.name,
        t=t[keep] - t[first],
        joint={c: factor.get(c, 1.0) * x[keep] for c, x in joint.items()},
        base={c: x[keep] for c, x in base.items()},
        feet={f: x[keep] for f, x in feet.items()},
        battery=state["battery"][keep] if "battery" in state else None,
    )
    run = check_run(
        run, joints, lambda text, column: LogError(f"{path}, {column!r}: {text.replace('log.json', 'the map')}")
    )
    header = {
        "robot": m.get("robot", ""), "base": m.get("base", "free" if base else "fixed"), "joints": list(joints),
        "kp": m.get("kp", {}), "kd": m.get("kd", {}),
        "tau_is": m.get("tau_is", "estimate" if "tau" in joint else "none"),
        "source": {r: f"{topic} ({topics[topic]})" for r, topic in role.items()},
    } | {k: v for k, v in m.items() if k.startswith("x_")}  # fmt: skip
    return make_log(path, header, joints, (run,), notes)


def _states(
    path: Path,
    m: dict[str, Any],
    topic: str,
    series: Mapping[str, tuple[np.ndarray, dict[str, np.ndarray]]],
    named: Mapping[str, JointMessages],
) -> tuple[np.ndarray, dict[str, np.ndarray], tuple[str, ...], list[tuple[int, str, str]], list[str]]:
    """Stamps, channels of the joints that the map takes, these and how the bag has them, and remarks."""
    if topic in named:
        source, notes = named[topic].names, list[str]()
        joints, columns = joints_of_map(path, m, source, len(source))
        taken = [source[k] for k in columns]
        t, state, notes = named[topic].merged(path, topic, taken)
        return t, state, joints, list(zip(columns, taken, joints, strict=True)), notes
    t, state = series[topic]
    if len(t) < MIN_SAMPLES:
        raise LogError(f"{path}: {topic} holds {len(t)} messages, {MIN_SAMPLES} or more are needed; record longer")
    joints, columns = joints_of_map(path, m, list(UNITREE_JOINTS), state["q"].shape[1])
    own = ("q", "qd", "tau", "temperature")
    state = {c: x[:, columns] if c in own else x for c, x in state.items()}
    return t, state, joints, [(k, UNITREE_JOINTS[k], name) for k, name in zip(columns, joints, strict=True)], []


def _asked(
    path: Path,
    m: dict[str, Any],
    topic: str,
    series: Mapping[str, tuple[np.ndarray, dict[str, np.ndarray]]],
    named: Mapping[str, JointMessages],
    joints: list[tuple[int, str, str]],
    until: np.ndarray,
) -> tuple[dict[str, np.ndarray], int]:
    """The last commands of each joint until given times, shape (N, J) by channel, and the first row that has them all.

    Of each of ``joints`` there are its place in the bag's messages, its name there, and the robot's own; the map's
    order of an array may have either. A command that follows a row by less than half a row was computed from it.
    """
    rename, found, first = {"q": "q_des", "qd": "qd_des", "dq": "qd_des", "tau": "tau_ff"}, {}, 0
    for k, (column, theirs, ours) in enumerate(joints):
        if topic in named:
            given = named[topic]
            name = next((x for x in (theirs, ours) if x in given.t), None)
            if name is None:
                raise LogError(
                    f"{path}: {topic} commands no {theirs}; leave it out of the map's joints, or name another command"
                )
            when, command = given.of(name)
        else:
            when, every = series[topic]
            command = {c: x[:, column] for c, x in every.items()}
        for channel, x in command.items():
            given_ = np.isfinite(x)  # what is no number is no command: the last one holds
            if not given_.any():
                continue
            at = np.searchsorted(when[given_], until, side="right") - 1
            first = max(first, int(np.searchsorted(at, 0)))
            blank = np.full((len(until), len(joints)), np.nan)
            found.setdefault(rename.get(channel, channel), blank)[:, k] = x[given_][np.maximum(at, 0)]
    return found, first


def _listed(named: Any) -> list[Any]:
    """Topics of a role, as the map names one or several."""
    return named if isinstance(named, list) else [named]


def _not_read(taken: set[Any], topics: Mapping[str, str]) -> list[str]:
    """A remark on topics that could hold readings or commands and are not taken."""
    kinds = {"JointTrajectory", "JointTrajectoryControllerState", *(kind for own in READABLE.values() for kind in own)}
    left = [f"{t} ({kind.rpartition('/')[2]})" for t, kind in topics.items() if t not in taken and _is(kind, *kinds)]
    return [f"not read: {', '.join(sorted(left))}; the map names other topics"] if left else []


def _switched_off(joint: dict[str, np.ndarray]) -> None:
    """Unitree's targets of 2.146e9 rad and 16000 rad/s stand for a loop that is off."""
    for target, gain, limit, rest in (("q_des", "kp", 1e6, joint["q"]), ("qd_des", "kd", 1e4, 0.0)):
        if target in joint and gain in joint:
            off = np.abs(joint[target]) > limit
            joint[target] = np.where(off, rest, joint[target])
            joint[gain] = np.where(off, 0.0, joint[gain])


def _resampled(t: np.ndarray, when: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A sensor's readings on other stamps, on a line between neighbours."""
    if x.shape[1] == 4:  # of the two quaternions of a rotation the nearer one
        x = x * np.cumprod(np.r_[1.0, np.where((x[1:] * x[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)])[:, None]
    return np.stack([np.interp(t, when, column) for column in x.T], axis=1)


def _turned(quat: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vectors of the body's frame in the world's; quaternions w, x, y, z, shapes (N, 4) and (N, 3)."""
    w, u = quat[:, :1], quat[:, 1:]
    side = 2.0 * np.cross(u, v)
    return v + w * side + np.cross(u, side)
