"""Robots side by side in rerun, as shapes in 3D and as time series on the timeline ``sim_time``, and their layout.

Entities, for every shown environment ``<k>_<current>A``, and ``ground`` if it has heights::

    robots/3_1.5A/                 place of the robot in the row
        body/<body>/               pose of a body; below it its shapes, logged once; calves take their gate's colour
        foot_force/                forces of the ground on the feet, as arrows
        series/<name>              time series, see SERIES; the unit is logged with each
        gate/<leg>                 state of a device's gates: off, dynamic, hold
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from mujoco import mjtGeom

from mrwarp.env.sim_model import Scene
from mrwarp.kernels import ledger
from mrwarp.viewing.frames import Frames, Gate
from mrwarp.viewing.shapes import (
    CURRENT_COLORS,
    GATE_COLORS,
    Color,
    Part,
    Shape,
    body_names,
    body_poses,
    device_colors,
    feet,
    ground_of,
    leg_colors,
    robot_shapes,
    rotate,
    trunk_height,
)

TIMELINE = "sim_time"
"""Name of the timeline: simulated time [s]."""

FORCE_SCALE = 0.25 / 100.0
"""Length of a foot force's arrow [m/N]: 100 N are 0.25 m."""

CAMERA = (2.0, -2.4, 1.05)
"""Position of the camera relative to the middle of the row [m]; it travels with the robots."""

SPACING = 1.0
"""Distance between neighbours in the row along y [m]; on a height field the robots stand where they are."""

WINDOW = 3.0
"""Time that the plots show up to the cursor [s]: four and a half strides."""

LABEL_COLOR: Color = (235, 235, 235)
ARROW_COLOR: Color = (225, 60, 90)
GROUND_COLOR: Color = (86, 92, 100)
COMMAND_COLOR: Color = (140, 145, 150)
ENERGY = {
    "motor": (ledger.MOTOR, (130, 130, 140)),
    "device, dynamic": (ledger.DYNAMIC, GATE_COLORS[Gate.DYNAMIC]),
    "device, hold": (ledger.HOLD, GATE_COLORS[Gate.HOLD]),
    "device, drag": (ledger.DRAG, (120, 90, 170)),
    "coil loss": (ledger.COIL, (60, 170, 130)),
}
"""Plotted ledger entries, work of motors and devices on the joints and the coils' loss, and their colours."""


@dataclass(frozen=True)
class Series:
    """One time series entity of a robot."""

    title: str
    """Name in the plots."""
    unit: str
    """Unit of its values."""
    lines: str
    """Owners of the lines: the ``robot`` itself, its ``command``, ``legs``, ``devices`` or ``energy`` entries."""
    values: Callable[[RobotLogger, Frames, int], np.ndarray]
    """Values of a logger's robot k in some frames, shape (T,) or (T, lines)."""


SERIES = {
    "trunk_height": Series("trunk height", "m", "robot", lambda log, f, k: trunk_height(log.ground, f.qpos[:, k])),
    "forward_velocity": Series("forward velocity", "m/s", "robot", lambda _, f, k: f.v_x[:, k]),
    "forward_velocity_command": Series(
        "commanded forward velocity", "m/s", "command", lambda _, f, k: f.v_x_command[:, k]
    ),
    "vertical_velocity": Series("vertical velocity", "m/s", "robot", lambda _, f, k: f.v_z[:, k]),
    "calf_motor_torque": Series("calf motor torque", "N·m", "legs", lambda log, f, k: f.tau_motor[:, k, log.calves]),
    "mr_torque": Series("MR torque", "N·m", "devices", lambda _, f, k: f.tau_mr[:, k]),
    "coil_current": Series("coil current", "A", "devices", lambda _, f, k: f.current[:, k]),
    "foot_force": Series("foot force", "N", "legs", lambda _, f, k: np.linalg.norm(f.foot_force[:, k], axis=-1)),
    "energy": Series(
        "work and coil loss",
        "J",
        "energy",
        lambda _, f, k: f.ledger[:, k].sum(1)[:, [int(entry) for entry, _ in ENERGY.values()]],
    ),
}
"""Time series of each robot by entity name."""

DETAILS = ("mr_torque", "coil_current", "calf_motor_torque", "foot_force", "energy")
"""Series that are plotted for each robot by itself."""


class RobotLogger:
    """Logs robots of one scene into a recording. Not thread-safe: use it from one thread at a time.

    Args:
        scene: What is simulated.
        currents: Current I_e of each shown environment [A]; length K.
        recording: rerun recording, its sinks set.

    Attributes:
        names: Entity name of each robot: its place in the row and its current.
        devices: Colour of each device by its name, see :attr:`Scene.device_names`.
        series: Names of the series that these robots have.
        calves: Joints that are followed, one of each leg.
        ground: Heights of the ground; None if it is a plane.
        trunk: Entity of the drawn trunk below a robot's own, for a camera to follow (rerun follows no bare pose).
    """

    def __init__(self, scene: Scene, currents: Sequence[float], recording: rr.RecordingStream) -> None:
        self.names = [f"{k}_{current:g}A" for k, current in enumerate(currents)]
        self.devices = dict(zip(scene.device_names, device_colors(scene), strict=True))
        self.series = [name for name, kind in SERIES.items() if self.devices or kind.lines != "devices"]
        self._recording, self._model = recording, scene.model
        self._bodies, self._shapes = body_names(scene), robot_shapes(scene)
        self._feet = feet(scene, self._shapes)
        self.calves, self._trunk = list(scene.watched), scene.layout.trunk
        self._legs = dict(zip(scene.layout.leg_names, leg_colors(scene), strict=True))
        self._gates: dict[str, np.ndarray] = {}
        self.ground = ground_of(scene.model)
        self.trunk = next((self._shape_path("", shape) for shape in self._shapes if shape.part is Part.TRUNK), None)
        self._log_static(currents)

    def place(self, k: int) -> tuple[float, float, float]:
        """Where robot k's world has its origin [m]: the row goes to the right of the walking direction."""
        return 0.0, -SPACING * k if self.ground is None else 0.0, 0.0

    def log(self, frames: Frames) -> None:
        """Add instants of all shown robots; several at once are cheaper than one by one."""
        times = np.round(1e9 * frames.time).astype("timedelta64[ns]")
        pos, quat = body_poses(self._model, frames.qpos)
        for k, name in enumerate(self.names):
            root = f"robots/{name}"
            for body in range(1, len(self._bodies)):
                poses = rr.Transform3D.columns(
                    translation=pos[:, k, body], quaternion=np.roll(quat[:, k, body], -1, axis=1)
                )
                self._send(f"{root}/body/{self._bodies[body]}", times, poses)
            self._log_forces(root, times, pos[:, k], quat[:, k], frames.foot_force[:, k])
            self._log_gates(root, times, frames.gate[:, k])
            self._log_series(root, times, frames, k)

    def _log_static(self, currents: Sequence[float]) -> None:
        """Log what never changes: shapes, places in the row, names, colours and units of the series."""
        log = self._recording.log
        log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        if self.ground is not None:
            vertices, triangles = self.ground.mesh()
            surface = rr.Mesh3D(vertex_positions=vertices, triangle_indices=triangles, albedo_factor=GROUND_COLOR)
            log("ground", surface, static=True)
        for k, (name, current) in enumerate(zip(self.names, currents, strict=True)):
            root = f"robots/{name}"
            log(root, rr.Transform3D(translation=self.place(k)), static=True)
            for shape in self._shapes:
                log(self._shape_path(root, shape), _primitive(shape), static=True)
            log(f"{root}/foot_force", rr.Arrows3D.from_fields(colors=[ARROW_COLOR], radii=[0.007]), static=True)
            if self._trunk in self._bodies:
                label = rr.Points3D(
                    [[0.0, 0.0, 0.16]], radii=0.0, labels=f"{current:.4g} A", show_labels=True, colors=[LABEL_COLOR]
                )
                log(f"{root}/body/{self._trunk}/label", label, static=True)
            self._log_series_style(root, f"{current:.4g} A", CURRENT_COLORS[k % len(CURRENT_COLORS)])

    def _log_series_style(self, root: str, label: str, color: Color) -> None:
        lines: dict[str, dict[str, Color]] = {
            "robot": {label: color},
            "command": {"command": COMMAND_COLOR},
            "legs": self._legs,
            "devices": self.devices,
            "energy": {name: color for name, (_, color) in ENERGY.items()},
        }
        for name in self.series:
            drawn = lines[SERIES[name].lines]
            style = rr.SeriesLines(names=list(drawn), colors=list(drawn.values()), widths=[1.5] * len(drawn))
            self._recording.log(f"{root}/series/{name}", style, rr.AnyValues(unit=SERIES[name].unit), static=True)
        states = rr.StateConfiguration(
            values=[gate.name.lower() for gate in Gate],
            colors=[GATE_COLORS[gate] for gate in Gate],
            visible=[gate is not Gate.OFF for gate in Gate],
        )
        for leg in self.devices:
            self._recording.log(f"{root}/gate/{leg}", states, static=True)

    def _log_forces(self, root: str, times: np.ndarray, pos: np.ndarray, quat: np.ndarray, force: np.ndarray) -> None:
        if not self._feet:
            return
        origins = [pos[:, foot.body] + rotate(quat[:, foot.body], foot.pos) for foot in self._feet.values()]
        arrows = rr.Arrows3D.columns(
            origins=np.stack(origins, axis=1).reshape(-1, 3),
            vectors=FORCE_SCALE * force[:, list(self._feet)].reshape(-1, 3),
        )
        self._send(f"{root}/foot_force", times, arrows.partition([len(self._feet)] * len(pos)))

    def _log_gates(self, root: str, times: np.ndarray, gate: np.ndarray) -> None:
        """Colours of the gated shapes and states of the gates, where they changed."""
        last = self._gates.get(root, np.full(gate.shape[1:], -1))
        self._gates[root] = gate[-1]
        changed = np.diff(gate, axis=0, prepend=last[None]) != 0
        for device, leg in enumerate(self.devices):
            rows = np.flatnonzero(changed[:, device])
            if not len(rows):
                continue
            gates = [Gate(value) for value in gate[rows, device]]
            states = rr.StateChange.columns(state=[g.name.lower() for g in gates])
            self._send(f"{root}/gate/{leg}", times[rows], states)
            colors = np.array([GATE_COLORS[g] for g in gates], dtype=np.uint8)
            for shape in self._shapes:
                if shape.device == device:
                    kind = _ARCHETYPES.get(shape.kind)
                    columns = kind.columns(colors=colors) if kind else rr.Mesh3D.columns(albedo_factor=colors)
                    self._send(self._shape_path(root, shape), times[rows], columns)

    def _log_series(self, root: str, times: np.ndarray, frames: Frames, k: int) -> None:
        for name in self.series:
            table = np.asarray(SERIES[name].values(self, frames, k), dtype=np.float64).reshape(len(frames), -1)
            columns = rr.Scalars.columns(scalars=table.ravel()).partition([table.shape[1]] * len(table))
            self._send(f"{root}/series/{name}", times, columns)

    def _shape_path(self, root: str, shape: Shape) -> str:
        return f"{root}/body/{self._bodies[shape.body]}/{shape.name}"

    def _send(self, path: str, times: np.ndarray, columns: rr.ComponentColumnList) -> None:
        self._recording.send_columns(path, [rr.TimeColumn(TIMELINE, duration=times)], columns)


_ARCHETYPES = {
    mjtGeom.mjGEOM_BOX: rr.Boxes3D,
    mjtGeom.mjGEOM_SPHERE: rr.Ellipsoids3D,
    mjtGeom.mjGEOM_CAPSULE: rr.Capsules3D,
    mjtGeom.mjGEOM_CYLINDER: rr.Cylinders3D,
}


def _primitive(shape: Shape) -> rr.Mesh3D | rr.Boxes3D | rr.Ellipsoids3D | rr.Capsules3D | rr.Cylinders3D:
    """A shape as rerun draws it; the colour of a gated one comes with the gate."""
    if shape.points is not None and shape.faces is not None:
        color = None if shape.device >= 0 else shape.part.value
        return rr.Mesh3D(vertex_positions=shape.points, triangle_indices=shape.faces, albedo_factor=color)
    style: dict[str, Any] = {
        "colors": None if shape.device >= 0 else [shape.part.value],
        "quaternions": [rr.Quaternion(xyzw=np.roll(shape.quat, -1))],
        "fill_mode": rr.components.FillMode.Solid,
    }
    if shape.kind == mjtGeom.mjGEOM_BOX:
        return rr.Boxes3D(centers=[shape.pos], half_sizes=[shape.size], **style)
    if shape.kind == mjtGeom.mjGEOM_SPHERE:
        return rr.Ellipsoids3D(centers=[shape.pos], radii=list(shape.size), **style)
    radius, half = shape.size
    if shape.kind == mjtGeom.mjGEOM_CYLINDER:
        return rr.Cylinders3D(centers=[shape.pos], lengths=[2.0 * half], radii=[radius], **style)
    # rerun's capsule starts at its translation, MuJoCo's is centred
    start = shape.pos - rotate(shape.quat, np.array([0.0, 0.0, half]))
    return rr.Capsules3D(translations=[start], lengths=[2.0 * half], radii=[radius], **style)


def make_blueprint(robots: RobotLogger, *, live: bool = False, impact: bool = False) -> rrb.Blueprint:
    """Layout for what a logger shows.

    Args:
        robots: The logger.
        live: Follow the newest data instead of playing from the start.
        impact: Compare the vertical velocity instead of the forward velocity.
    """
    names = robots.names
    compared = ["trunk_height", "vertical_velocity" if impact else "forward_velocity"]
    views = {series: [f"/robots/{name}/series/{series}" for name in names] for series in compared}
    if not impact:
        views["forward_velocity"].append(f"/robots/{names[0]}/series/forward_velocity_command")
    right = rrb.Vertical(
        rrb.Horizontal(*[_plot(series, contents) for series, contents in views.items()]),
        # the largest current stands last and has most to show
        rrb.Tabs(*[_details(name, robots) for name in names], active_tab=len(names) - 1, name="joints"),
        row_shares=[1.0, 3.0],
    )
    return rrb.Blueprint(
        rrb.Horizontal(_scene(robots), right, column_shares=[5, 6]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline=TIMELINE,
            play_state="following" if live else "playing",
            loop_mode="off" if live else "all",
        ),
    )


def _scene(robots: RobotLogger) -> rrb.Spatial3DView:
    """The robots on a grid; the camera travels with the one in the middle of the row."""
    middle = len(robots.names) // 2
    y = robots.place(middle)[1]
    return rrb.Spatial3DView(
        origin="/",
        contents=["/ground", "/robots/**", "- /robots/*/series/**", "- /robots/*/gate/**"],
        name="robots",
        background=rrb.Background(color=[24, 27, 32]),
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, plane=rr.components.Plane3D.XY, color=[120, 130, 140, 90]),
        eye_controls=rrb.EyeControls3D(
            position=[CAMERA[0], y + CAMERA[1], CAMERA[2]],
            look_target=[0.0, y, 0.2],
            tracking_entity=None if robots.trunk is None else f"/robots/{robots.names[middle]}{robots.trunk}",
        ),
    )


def _details(name: str, robots: RobotLogger) -> rrb.Grid:
    views: list[rrb.View] = [_plot(s, [f"/robots/{name}/series/{s}"]) for s in DETAILS if s in robots.series]
    if robots.devices:
        gates = rrb.StateTimelineView(origin=f"/robots/{name}/gate", name="gates", time_view=_time_axis())
        views.insert(2, gates)
    return rrb.Grid(*views, grid_columns=2, name=name.partition("_")[2].replace("A", " A"))


def _plot(series: str, contents: Sequence[str]) -> rrb.TimeSeriesView:
    kind = SERIES[series]
    return rrb.TimeSeriesView(
        origin="/",
        contents=list(contents),
        name=f"{kind.title} [{kind.unit}]",
        axis_x=_time_axis(),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
    )


def _time_axis() -> rrb.archetypes.TimeAxis:
    """The last seconds up to the time shown, in all plots."""
    window = rr.TimeRange(
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-WINDOW), end=rr.TimeRangeBoundary.cursor_relative()
    )
    return rrb.archetypes.TimeAxis(link=rrb.components.LinkAxis.Independent, view_range=window)
