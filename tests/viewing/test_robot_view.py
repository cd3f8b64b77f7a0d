"""Recordings: what RobotLogger writes is read back, with rerun's reader, as it was simulated."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from mujoco import mjtGeom

from mrwarp.env.sim import robot_scene
from mrwarp.kernels import ledger
from mrwarp.usd.asset import load_robot
from mrwarp.usd.robot import LEGS
from mrwarp.viewing import live_view
from mrwarp.viewing.frames import Gate
from mrwarp.viewing.robot_view import ENERGY, FORCE_SCALE, SERIES, RobotLogger, make_blueprint
from mrwarp.viewing.shapes import GATE_COLORS, body_names, body_poses, robot_shapes

UNITS = {
    "trunk_height": "m", "forward_velocity": "m/s", "forward_velocity_command": "m/s", "vertical_velocity": "m/s",
    "calf_motor_torque": "N·m",
    "mr_torque": "N·m", "coil_current": "A", "foot_force": "N", "energy": "J",
}  # fmt: skip


NAMES = ("0_0A", "1_0.5A", "2_1A", "3_1.5A")
"""Entities of the four robots: place in the row and current."""


@pytest.fixture(scope="module")
def recording(walk: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The walk in a file, logged in pieces of different length."""
    path = tmp_path_factory.mktemp("rrd") / "walk.rrd"
    target = rr.RecordingStream("test")
    target.save(path)
    robots = RobotLogger(walk.env.sim.scene, walk.currents, target)
    target.send_blueprint(make_blueprint(robots))
    for piece in (slice(0, 1), slice(1, 26), slice(26, None)):
        robots.log(walk.frames[piece])
    assert live_view.disconnect(target)
    return path


def series(recorded: Any, entity: str, component: str = "Scalars:scalars") -> tuple[np.ndarray, np.ndarray]:
    """Times [ns] and values of one entity, in order."""
    times, values = zip(*sorted(recorded.columns(entity, component)), strict=True)
    return np.array(times), np.array(values)


def test_every_series_is_there_with_its_unit(walk: Any, recording: Path, read_rrd: Any) -> None:
    """All series of all robots, at 50 Hz on ``sim_time``, equal to the frames; the unit stands next to each."""
    recorded, frames = read_rrd(recording), walk.frames
    calves = [2, 5, 8, 11]
    for k, name in enumerate(NAMES):
        expected = {
            "trunk_height": frames.qpos[:, k, 2:3],
            "forward_velocity": frames.v_x[:, k, None],
            "forward_velocity_command": np.full((60, 1), 0.5),
            "vertical_velocity": frames.v_z[:, k, None],
            "calf_motor_torque": frames.tau_motor[:, k][:, calves],
            "mr_torque": frames.tau_mr[:, k],
            "coil_current": frames.current[:, k],
            "foot_force": np.linalg.norm(frames.foot_force[:, k], axis=-1),
            "energy": np.stack([frames.ledger[:, k, :, int(e)].sum(-1) for e, _ in ENERGY.values()], axis=-1),
        }
        assert set(expected) == set(UNITS) == set(SERIES)
        for quantity, values in expected.items():
            entity = f"/robots/{name}/series/{quantity}"
            times, found = series(recorded, entity)
            np.testing.assert_array_equal(times, 20_000_000 * np.arange(1, 61))
            np.testing.assert_allclose(found, values, rtol=1e-6, atol=1e-9)
            assert [unit for _, unit in recorded.columns(entity, "unit", static=True)] == [[UNITS[quantity]]]


def test_poses_are_there(walk: Any, recording: Path, read_rrd: Any) -> None:
    """Every body of every robot has its pose at every instant; the robots stand every 1 m."""
    recorded, scene = read_rrd(recording), walk.env.sim.scene
    pos, quat = body_poses(scene.model, walk.frames.qpos)
    for k, name in enumerate(NAMES):
        place = next(recorded.columns(f"/robots/{name}", "Transform3D:translation", static=True))[1]
        np.testing.assert_allclose(place, [[0.0, -1.0 * k, 0.0]])
        for body, part in enumerate(body_names(scene)[1:], start=1):
            entity = f"/robots/{name}/body/{part}"
            _, found = series(recorded, entity, "Transform3D:translation")
            np.testing.assert_allclose(found[:, 0], pos[:, k, body], atol=1e-6)
            _, found = series(recorded, entity, "Transform3D:quaternion")
            np.testing.assert_allclose(found[:, 0], quat[:, k, body][:, [1, 2, 3, 0]], atol=1e-6)


def test_shapes_are_logged_once(walk: Any, recording: Path, read_rrd: Any) -> None:
    """Each shape is static below its body, with the model's size; a capsule's length excludes its caps."""
    recorded, scene = read_rrd(recording), walk.env.sim.scene
    names = body_names(scene)
    size = {
        mjtGeom.mjGEOM_BOX: "Boxes3D:half_sizes",
        mjtGeom.mjGEOM_SPHERE: "Ellipsoids3D:half_sizes",
        mjtGeom.mjGEOM_CAPSULE: "Capsules3D:lengths",
        mjtGeom.mjGEOM_CYLINDER: "Cylinders3D:lengths",
    }
    for shape in robot_shapes(scene):
        entity = f"/robots/0_0A/body/{names[shape.body]}/{shape.name}"
        rows = [value for _, value in recorded.columns(entity, size[shape.kind], static=True)]
        expected = {3: [shape.size], 1: [shape.size * 3]}.get(len(shape.size), [2.0 * shape.size[-1]])
        assert len(rows) == 1
        np.testing.assert_allclose(rows[0], expected, rtol=1e-6)


def test_gates_and_colours_follow_each_other(walk: Any, recording: Path, read_rrd: Any) -> None:
    """State and calf colour at every instant, filled forward from the logged changes, are the gate's."""
    recorded = read_rrd(recording)
    for k, name in enumerate(NAMES):
        for device, leg in enumerate(LEGS):
            gate = walk.frames.gate[:, k, device]
            for entity, component, meaning in (
                (f"/robots/{name}/gate/{leg}", "StateChange:state", {g: g.name.lower() for g in Gate}),
                (f"/robots/{name}/body/{leg}_calf/mr_device", "Cylinders3D:colors", {g: packed(g) for g in Gate}),
            ):
                changes = {time: value[0] for time, value in recorded.columns(entity, component)}
                assert len(changes) == 1 + np.count_nonzero(np.diff(gate))
                now = None
                for i, value in enumerate(gate, start=1):
                    now = changes.get(20_000_000 * i, now)
                    assert now == meaning[Gate(value)]


def packed(gate: Gate) -> int:
    """Colour as rerun stores it: 0xRRGGBBAA."""
    red, green, blue = GATE_COLORS[gate]
    return red << 24 | green << 16 | blue << 8 | 0xFF


def test_foot_forces_are_arrows_at_the_feet(walk: Any, recording: Path, read_rrd: Any) -> None:
    """Four arrows that start in the feet and are 2.5 mm long per newton."""
    recorded = read_rrd(recording)
    model = walk.env.sim.scene.model
    pos, _ = body_poses(model, walk.frames.qpos)
    _, vectors = series(recorded, "/robots/2_1A/foot_force", "Arrows3D:vectors")
    _, origins = series(recorded, "/robots/2_1A/foot_force", "Arrows3D:origins")
    np.testing.assert_allclose(vectors, FORCE_SCALE * walk.frames.foot_force[:, 2], atol=1e-6)
    calf = [body_names(walk.env.sim.scene).index(f"{leg}_calf") for leg in LEGS]
    distance = np.linalg.norm(origins - pos[:, 2][:, calf], axis=-1)
    np.testing.assert_allclose(distance, 0.213, atol=1e-6)
    assert FORCE_SCALE == 0.0025


def test_blueprint_is_in_the_file(recording: Path, read_rrd: Any) -> None:
    """One layout, with the 3D view, every series' plot for each robot, the gates, and the right timeline."""
    recorded = read_rrd(recording)
    titles = [title[0] for title in recorded.blueprint("ViewBlueprint:display_name")]
    assert titles.count("robots") == 1 and titles.count("gates") == 4
    for once in ("trunk height [m]", "forward velocity [m/s]"):
        assert titles.count(once) == 1
    for each in (
        "MR torque [N·m]",
        "coil current [A]",
        "calf motor torque [N·m]",
        "foot force [N]",
        "work and coil loss [J]",
    ):
        assert titles.count(each) == 4
    assert recorded.blueprint("TimePanelBlueprint:timeline") == [["sim_time"]]
    tracked = recorded.blueprint("EyeControls3D:tracking_entity")
    assert tracked == [["/robots/2_1A/body/trunk/trunk_shape"]] and tracked[0][0] in recorded.entities()


def test_robot_without_devices(tmp_path: Path, walk: Any, read_rrd: Any) -> None:
    """``go1``: no MR series, no gates, and a layout without them; the rest is as ever."""
    scene = robot_scene(load_robot(robot="go1"))
    path = tmp_path / "go1.rrd"
    target = rr.RecordingStream("test")
    target.save(path)
    robots = RobotLogger(scene, [0.0], target)
    target.send_blueprint(make_blueprint(robots))
    robots.log(walk.without_devices())
    assert live_view.disconnect(target)
    found = {entity.split("/")[-1] for entity in read_rrd(path).entities() if "/series/" in entity}
    assert found == set(UNITS) - {"mr_torque", "coil_current"}
    assert not any("gate" in entity for entity in read_rrd(path).entities())
    assert "gates" not in [title[0] for title in read_rrd(path).blueprint("ViewBlueprint:display_name")]


def test_energy_entries_are_the_ledgers() -> None:
    """The plotted lines name the ledger entries they show."""
    names = [ledger.ENTRIES[int(entry)] for entry, _ in ENERGY.values()]
    assert names == ["motor", "dynamic", "hold", "drag", "coil"]
    for shown, name in zip(ENERGY, names, strict=True):
        assert name in shown
