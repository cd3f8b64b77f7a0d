"""Bags that rosbags itself wrote become robot logs: JointState and Imu, Unitree's LowState and LowCmd, refusals."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import StoragePlugin, Writer

from mrwarp.cli import main
from mrwarp.recording.data import RecordingError
from mrwarp.robot_logs.forms.bag import UNITREE_JOINTS, read_bag, typestore
from mrwarp.robot_logs.forms.open_log import open_log
from mrwarp.robot_logs.forms.save_log import DIGITS
from mrwarp.robot_logs.robot_log import is_robot_log, load_log
from tests.messages import Refused, has_parts

STORE = typestore()
ROWS, DT = 120, 0.01
NANOSECOND = 1e-9
"""Rounding of two stamps, half of one each [s]."""
EPS = float(np.finfo(np.float32).eps)
JOINTS = ("hip", "knee")


def _nothing(node: Nodetype, of: Any) -> Any:
    """A field's zero: a number, an empty text, a message of zeros, or as many of them as it holds."""
    if node in (Nodetype.BASE, Nodetype.NAME):
        return _message(of) if node == Nodetype.NAME else "" if of[0] == "string" else 0
    (inner, each), count = of
    return np.zeros(count, each[0]) if inner == Nodetype.BASE else [_message(each) for _ in range(count)]


def _message(kind: str, **fields: Any) -> Any:
    """A message that holds nothing but these fields."""
    blank = {name: _nothing(*of) for name, of in STORE.fielddefs[kind][1] if name not in fields}
    return STORE.types[kind](**blank, **fields)


def _stamp(t: float) -> Any:
    time = _message("builtin_interfaces/msg/Time", sec=int(t), nanosec=round((t % 1.0) * 1e9))
    return _message("std_msgs/msg/Header", stamp=time, frame_id="")


def _joints(t: float, names: tuple[str, ...], q: list[float], qd: list[float], effort: list[float]) -> Any:
    return _message(
        "sensor_msgs/msg/JointState",
        header=_stamp(t),
        name=list(names),
        position=np.array(q),
        velocity=np.array(qd),
        effort=np.array(effort),
    )


def angle(t: float, k: int) -> float:
    """Of joint k at a time."""
    return float(0.4 * np.sin(5.0 * t + k))


def ros_bag(path: Path, plugin: StoragePlugin = StoragePlugin.MCAP, *, other: bool = False) -> Path:
    """State, commands 2 ms after it, and an inertial sensor between; stamps of the headers lie 5 s before the bag's."""
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        kinds = {"/joint_states": "JointState", "/joint_commands": "JointState", "/imu/data": "Imu"}
        kinds |= {"/arm/joint_states": "JointState", "/leg/joint_states": "JointState"} if other else {}
        topics = {t: writer.add_connection(t, f"sensor_msgs/msg/{k}", typestore=STORE) for t, k in kinds.items()}
        vector = STORE.types["geometry_msgs/msg/Vector3"]
        for row in range(ROWS):
            t = 100.0 + row * DT
            q = [angle(t, k) for k in range(2)]
            qd = [2.0 * float(np.cos(5.0 * t + k)) for k in range(2)]
            messages = [("/joint_states", t, _joints(t, JOINTS, q, qd, [1.0, 2.0]))]
            if row >= 5:  # the other order of names, as two programs may have it
                command = _joints(t + 0.002, JOINTS[::-1], [q[1] + 0.1, q[0] + 0.2], [], [])
                messages.append(("/joint_commands", t + 0.002, command))
            imu = _message(
                "sensor_msgs/msg/Imu",
                header=_stamp(t + 0.005),
                orientation=_message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.6, w=0.8),
                angular_velocity=vector(x=t + 0.005, y=0.0, z=0.0),
                linear_acceleration=vector(x=0.0, y=0.0, z=9.81),
            )
            messages.append(("/imu/data", t + 0.005, imu))
            if other:
                messages += [(x, t, messages[0][2]) for x in ("/arm/joint_states", "/leg/joint_states")]
            for topic, when, message in messages:
                raw = STORE.serialize_cdr(message, topics[topic].msgtype)
                writer.write(topics[topic], round((when + 5.0) * 1e9), raw)
    return path


MAP = {
    "robot": "two.xml", "base": "free", "joints": {"hip": "left hip", "knee": "left knee"}, "kp": 20,
    "kd": {"left hip": 0.5, "left knee": 0.6}, "tau_is": "measured",
}  # fmt: skip


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_joint_states_and_commands_meet_on_the_state_s_stamps(plugin: StoragePlugin, tmp_path: Path) -> None:
    """By the headers' clock; a command that follows a row stands in that row, under the robot's own names."""
    log = read_bag(ros_bag(tmp_path / "bag", plugin), MAP)
    (run,) = log.runs
    t = 100.0 + np.arange(5, ROWS) * DT
    assert log.joints == ("left hip", "left knee") and log.tau_is == "measured" and log.base == "free"
    np.testing.assert_allclose(run.t, t - t[0], rtol=0, atol=NANOSECOND)
    q = np.array([[angle(x, k) for k in range(2)] for x in t])
    np.testing.assert_array_equal(run.joint["q"], q)
    np.testing.assert_array_equal(run.joint["q_des"], q + [0.2, 0.1])
    np.testing.assert_allclose(run.base["gyro"][:, 0], t, rtol=0, atol=NANOSECOND)  # which grows by 1 a second
    np.testing.assert_allclose(run.base["quat"][0], [0.8, 0.0, 0.0, 0.6])
    assert log.kp.tolist() == [20.0, 20.0] and log.kd.tolist() == [0.5, 0.6]
    assert "5 rows before the first command" in log.notes[0]


def test_import_writes_what_is_read_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command's log is the bag's; it says which topic became what."""
    bag = ros_bag(tmp_path / "bag")
    (tmp_path / "map.txt").write_text(json.dumps(MAP))
    out = tmp_path / "log"
    assert main(["log", "import", str(bag), "--map", str(tmp_path / "map.txt"), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "command       /joint_commands (sensor_msgs/msg/JointState)" in said
    ours, theirs = load_log(out), read_bag(bag, MAP)
    for channel, values in theirs.runs[0].joint.items():
        np.testing.assert_allclose(ours.runs[0].joint[channel], values, rtol=0, atol=0.51 * 10.0**-DIGITS)
    assert ours.header["source"]["imu"] == "/imu/data (sensor_msgs/msg/Imu)"
    assert json.loads((out / "result.json").read_text())["seconds"] == pytest.approx(1.14, abs=NANOSECOND)
    assert main(["log", "import", str(bag), "--out", str(out)]) == 2
    assert "--overwrite" in capsys.readouterr().err


def test_a_map_beside_the_bag_is_read_with_it(tmp_path: Path) -> None:
    """So that a bag can be diagnosed directly; an .mcap file of a folder, too."""
    bag = ros_bag(tmp_path / "bag")
    (bag / "map.json").write_text(json.dumps(MAP))
    assert is_robot_log(bag) and open_log(bag).joints == ("left hip", "left knee")
    (file,) = bag.glob("*.mcap")
    assert is_robot_log(file) and open_log(file).runs[0].samples == ROWS - 5


def unitree_bag(path: Path) -> Path:
    """A Go2's low-level state and commands in a bag without definitions, as ROS 2 Humble writes it."""
    with Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        state = writer.add_connection("/lowstate", "unitree_go/msg/LowState", typestore=STORE)
        command = writer.add_connection("/lowcmd", "unitree_go/msg/LowCmd", typestore=STORE)
        for row in range(ROWS):
            t = row * 0.002
            motors = [
                _message("unitree_go/msg/MotorState", mode=1, q=angle(t, k), tau_est=float(k), temperature=30 + k)
                for k in range(20)
            ]
            imu = _message(
                "unitree_go/msg/IMUState",
                quaternion=np.array([1, 0, 0, 0], np.float32),
                gyroscope=np.array([0.1, 0.2, 0.3], np.float32),
                accelerometer=np.array([0.0, 0.0, 9.8], np.float32),
            )
            force = np.array([10, 20, 30, 40], np.int16)
            low = _message(
                "unitree_go/msg/LowState", imu_state=imu, motor_state=motors, tick=row, foot_force=force, power_v=29.5
            )
            off = {3: 2.146e9}
            asked = [
                _message(
                    "unitree_go/msg/MotorCmd", mode=1, q=off.get(k, angle(t, k) + 0.1), tau=0.5, kp=20.0 + k, kd=1.0
                )
                for k in range(20)
            ]
            cmd = _message("unitree_go/msg/LowCmd", motor_cmd=asked)
            writer.write(state, round(t * 1e9), STORE.serialize_cdr(low, state.msgtype))
            writer.write(command, round((t + 3e-4) * 1e9), STORE.serialize_cdr(cmd, command.msgtype))
    return path


def test_unitree_s_low_level_messages_need_no_map(tmp_path: Path) -> None:
    """Joints in Unitree's order, gains from the commands, a loop that is off has no gain; numbers are float32."""
    log = read_bag(unitree_bag(tmp_path / "bag"))
    (run,) = log.runs
    assert log.joints == UNITREE_JOINTS and log.base == "free" and log.tau_is == "estimate"
    assert run.samples == ROWS and run.dt == pytest.approx(0.002)
    np.testing.assert_array_equal(run.joint["kp"][0], [0.0 if k == 3 else 20.0 + k for k in range(12)])
    np.testing.assert_array_equal(run.joint["q_des"][:, 3], run.joint["q"][:, 3])
    np.testing.assert_allclose(run.joint["q_des"][:, 4] - run.joint["q"][:, 4], 0.1, rtol=0, atol=EPS)  # of 0.5 and 0.4
    assert run.joint["temperature"][0, 11] == 41.0 and run.joint["tau"][0, 5] == 5.0
    assert {name: x[0] for name, x in run.feet.items()} == {"FR": 10.0, "FL": 20.0, "RR": 30.0, "RL": 40.0}
    np.testing.assert_allclose(run.base["gyro"][0], [0.1, 0.2, 0.3], rtol=EPS)
    assert run.battery is not None and run.battery[0] == 29.5


@pytest.mark.parametrize(
    ("mapping", "said"),
    [
        ({}, 'bag: hip has targets but no gain .. {"kp": {"hip": NUMBER}} .. --map MAP.json .. map.json in the bag'),
        ({"kp": {"hipp": 20}}, "bag: the map: kp of 'hipp' .. is it hip?"),
        ({"kp": 20, "command": "/joint_comands"}, "no topic of the bag .. is it /joint_commands?"),
        ({"kp": 20, "joints": {"hipp": "hip"}}, "joint 'hipp' is not in the bag .. is it hip?"),
        ({"kp": 20, "joints": 3}, "joints = 3 .. write"),
        ({"kp": 20, "command": None}, ""),
    ],
)
def test_a_map_that_does_not_fit_is_refused(mapping: dict[str, Any], said: str, tmp_path: Path) -> None:
    """With the nearest name; without any command the torque drives the replay."""
    bag = ros_bag(tmp_path / "bag")
    if not said:
        assert "q_des" not in read_bag(bag, mapping).runs[0].joint
        return
    with pytest.raises(RecordingError) as refused:
        read_bag(bag, mapping)
    assert has_parts(str(refused.value), said), str(refused.value)


def test_the_usual_name_is_chosen_of_several_states(tmp_path: Path) -> None:
    """``/joint_states`` before others; where no name is usual, the map must choose."""
    assert read_bag(ros_bag(tmp_path / "bag", other=True), {"kp": 20}).runs[0].samples == ROWS - 5


def test_maps_and_bags_that_are_none_are_refused(tmp_path: Path, refused: Refused) -> None:
    """One line, exit code 2, nothing written."""
    bag = ros_bag(tmp_path / "bag")
    (tmp_path / "map.json").write_text('{"joint": {}}')
    (tmp_path / "bad.mcap").write_bytes(b"no bag at all" * 50)
    for words, said in (
        ([str(bag), "--map", str(tmp_path / "map.json")], "'joint' means nothing; is it joints?"),
        ([str(bag), "--map", str(tmp_path / "no.json")], "no.json: no such file"),
        ([str(tmp_path / "bad.mcap"), "--map", str(tmp_path / "no.json")], "no.json: no such file"),
        ([str(tmp_path / "none.mcap")], "none.mcap: no such file"),
    ):
        assert said in refused("log", "import", *words, "--out", tmp_path / "log")
        assert not (tmp_path / "log").exists()
    (tmp_path / "map.json").unlink()
    assert "is no bag that can be read" in refused("check", tmp_path / "bad.mcap")


def two_publishers(path: Path, *, array: bool = False) -> Path:
    """An arm and wheels that publish in turn on one topic, wheels at another rate and without efforts that are numbers.

    With ``array`` commands are arrays without names or stamps, recorded 5 s after the states' stamps.
    """
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        state = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=STORE)
        other = writer.add_connection("/debug/joint_trajectory", "std_msgs/msg/Float64MultiArray", typestore=STORE)
        asked = writer.add_connection("/arm_controller/commands", "std_msgs/msg/Float64MultiArray", typestore=STORE)
        layout = _message("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
        for row in range(ROWS):
            t = 100.0 + row * DT
            arm = [angle(t, k) for k in range(2)]
            messages = [(state, t, _joints(t, JOINTS, arm, [0.0, 0.0], [1.0, 2.0]))]
            if row % 2 == 0:
                late = t + 0.3 * DT
                wheels = [angle(late, 2), float("nan") if row == 4 else 0.0]
                messages.append((state, late, _joints(late, ("wheel", "caster"), wheels, [0.0, 0.0], [np.nan, np.nan])))
            if array:
                data = np.array([arm[1] + 0.1, arm[0] + 0.2, 7.0])
                values = _message("std_msgs/msg/Float64MultiArray", layout=layout, data=data)
                messages += [(asked, t + 0.002, values), (other, t, values)]
            for topic, when, message in messages:
                writer.write(topic, round((when + 5.0) * 1e9), STORE.serialize_cdr(message, topic.msgtype))
    return path


def test_publishers_of_one_topic_are_merged_by_joint_and_stamp(tmp_path: Path) -> None:
    """Rows are the arm's, the wheel is interpolated; a joint that the map leaves out may hold no numbers."""
    names = {"hip": "hip", "wheel": "wheel", "knee": "knee"}
    log = read_bag(two_publishers(tmp_path / "bag"), {"joints": names, "tau_is": "measured", "command": None})
    (run,) = log.runs
    t = 100.0 + np.arange(1, ROWS - 1) * DT  # the wheel's first message comes after the arm's, its last one before
    assert log.joints == ("hip", "wheel", "knee")
    np.testing.assert_allclose(run.joint["q"][:, 0], [angle(x, 0) for x in t], rtol=0, atol=EPS)
    line = 0.4 * 25.0 * (2.0 * DT) ** 2 / 8.0  # of the interpolation: the angle's acceleration is 10 rad/s² at most
    np.testing.assert_allclose(run.joint["q"][:, 1], [angle(x, 2) for x in t], rtol=0, atol=1.01 * line)
    assert np.isnan(run.joint["tau"][:, 1]).all() and (run.joint["tau"][:, 2] == 2.0).all()
    assert any("wheel came in messages of their own" in note for note in log.notes)
    with pytest.raises(RecordingError, match="1 of 60 angles of caster are no number; leave the joint out"):
        read_bag(two_publishers(tmp_path / "all"), {"tau_is": "measured", "command": None})


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({}, "holds arrays of 3 numbers without names; name their joints in the map"),
        ({"command_order": ["knee", "hip"]}, "names 2 joints, /arm_controller/commands holds 3"),
        ({"command_order": ["knee", "hip", None], "command_is": "torque"}, "allowed: q_des, qd_des, tau_ff"),
        ({"command": "/debug/joint_trajectory", "command_order": ["a", "b", "c"]}, "commands no hip"),
        ({"state": "/arm_controller/commands"}, "is a std_msgs/msg/Float64MultiArray; read are JointState, LowState"),
        ({"command_order": ["knee", "hip", None]}, ""),
    ],
)
def test_an_array_of_commands_takes_its_order_from_the_map(more: dict[str, Any], said: str, tmp_path: Path) -> None:
    """It has no stamp: it comes as long after a state as it was recorded after it. What is not read is named."""
    bag, m = (
        two_publishers(tmp_path / "bag", array=True),
        {"joints": {"hip": "left", "knee": "right"}, "kp": 20, **more},
    )
    if said:
        with pytest.raises(RecordingError) as refused:
            read_bag(bag, m)
        assert said in str(refused.value)
        return
    log = read_bag(bag, m)
    joint = log.runs[0].joint
    np.testing.assert_allclose(joint["q_des"] - joint["q"], np.tile([0.2, 0.1], (ROWS, 1)), rtol=0, atol=EPS)
    assert any("not read: /debug/joint_trajectory (Float64MultiArray)" in note for note in log.notes)


def separate_topics(path: Path) -> Path:
    """An arm and a wheel, each with topics of its own; the arm's first commands, and one later, are no numbers."""
    kinds = {"/arm/states": "sensor_msgs/msg/JointState", "/wheel/states": "sensor_msgs/msg/JointState"}
    kinds |= dict.fromkeys(("/arm/commands", "/wheel/commands"), "std_msgs/msg/Float64MultiArray")
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {t: writer.add_connection(t, kind, typestore=STORE) for t, kind in kinds.items()}
        for row in range(ROWS):
            t = 100.0 + row * DT
            arm, wheel = [angle(t, k) for k in range(2)], [angle(t, 2)]
            asked = [np.nan if row < 3 or row == 50 else 0.001 * row, arm[1] + 0.1]
            for topic, when, message in (
                ("/arm/states", t, _joints(t, JOINTS, arm, [0.0, 0.0], [1.0, 2.0])),
                ("/wheel/states", t, _joints(t, ("wheel",), wheel, [0.0], [np.nan])),
                ("/arm/commands", t + 0.002, _message(kinds["/arm/commands"], data=np.array(asked))),
                ("/wheel/commands", t + 0.002, _message(kinds["/wheel/commands"], data=np.array([wheel[0] + 0.2]))),
            ):
                raw = STORE.serialize_cdr(message, topics[topic].msgtype)
                writer.write(topics[topic], round((when + 5.0) * 1e9), raw)
    return path


def test_topics_that_the_map_lists_are_merged(tmp_path: Path) -> None:
    """Each array of commands has its own order; what is no number is no command, and the last one holds."""
    bag, states = separate_topics(tmp_path / "bag"), ["/arm/states", "/wheel/states"]
    order = {"/arm/commands": ["hip", "knee"], "/wheel/commands": ["wheel"]}
    log = read_bag(bag, {"state": states, "command": list(order), "command_order": order, "kp": 20})
    joint, rows = log.runs[0].joint, np.arange(3, ROWS)
    assert log.joints == ("hip", "knee", "wheel") and not any("not read" in note for note in log.notes)
    np.testing.assert_allclose(joint["q_des"][:, 0], 0.001 * np.where(rows == 50, 49, rows), rtol=0, atol=EPS)
    np.testing.assert_allclose(
        (joint["q_des"] - joint["q"])[:, 1:], np.tile([0.1, 0.2], (ROWS - 3, 1)), rtol=0, atol=EPS
    )
    for more, said in (
        ({"state": ["/arm/states", "/wheel/state"]}, "the map's state '/wheel/state' is no topic of the bag; is it"),
        ({"state": [*states, "/arm/commands"]}, "is a std_msgs/msg/Float64MultiArray; read are JointState"),
        ({}, "2 topics could be the state"),
    ):
        with pytest.raises(RecordingError) as refused:
            read_bag(bag, {"command": None, "tau_is": "measured", **more})
        assert said in str(refused.value)
