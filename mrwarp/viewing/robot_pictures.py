"""Pictures without a viewer: robots from the side at five instants, and what their joints did around them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon
from mujoco import mjtGeom
from PIL import Image

from mrwarp.env.natural_units import scales
from mrwarp.env.sim_model import Scene
from mrwarp.kernels import ledger
from mrwarp.run_dir import atomic_write
from mrwarp.runtime import panels
from mrwarp.usd.robot import GAIT_FREQUENCY, MR_GO
from mrwarp.viewing import shapes
from mrwarp.viewing.frames import Frames, Gate, gate_of
from mrwarp.viewing.shapes import CURRENT_COLORS, GATE_COLORS, Color, Part, Shape, ground_of, rotate

if TYPE_CHECKING:
    from mrwarp.trials.impact import ImpactSweep, ImpactTrace
    from mrwarp.usd.asset import JointActuator

INSTANTS = 5
"""Instants in a row."""

PITCH = 0.8
"""Distance between the drawn robots of a row [m]."""

AFTER_IMPACT = (0.0, 0.05, 0.1, 0.2, 0.4)
"""Instants after an impact's onset at which the robots are drawn [s]."""

COLORS = ("#7a7f87", "#3a8f3a", "#e08a1e", "#b4451f", "#1f6fb4", "#6a3d9a")
"""One colour per setting of an impact sweep."""

FORCE_SCALE = 0.16 / 100.0
"""Length of a drawn foot force [m/N]: 100 N are 0.16 m."""

FORCE_COLOR, GROUND_COLOR, GROUND_EDGE = "#d6335c", "#e4e6e9", "#9aa0a8"
"""Foot forces, the ground and its surface."""

FORCE_ARROW = {"arrowstyle": "-|>", "color": FORCE_COLOR, "lw": 1.3, "mutation_scale": 7, "shrinkA": 0, "shrinkB": 0}

GROUND_DRAWN = 0.38
"""Ground with heights is drawn this far before and behind the trunk [m]."""


LIGHT = np.array([0.3, 0.6, 0.74])
"""Where the light comes from: the drawing plane's x and z, and towards the reader."""

Rgb = tuple[float, float, float]
"""A colour as matplotlib wants it, in [0, 1]."""

Pose = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Positions, gates of the devices and forces on the feet of one robot, see :meth:`SideView.draw`."""


def _rgb(color: tuple[float, float, float], faded: float = 0.0) -> Rgb:
    """A colour of 0 to 255, mixed with a share of white."""
    red, green, blue = (c / 255.0 + (1.0 - c / 255.0) * faded for c in color)
    return red, green, blue


class SideView:
    """Draws robots of a scene from their right side, as parallel projections of their shapes.

    Args:
        scene: What is simulated.

    Attributes:
        unit: Size of the robot relative to the shipped one's.
    """

    def __init__(self, scene: Scene) -> None:
        self.unit = scales(scene).length if scene.floating else 1.0
        self._model, self._shapes, self._ground = scene.model, shapes.robot_shapes(scene), ground_of(scene.model)
        self._flat = bool((scene.model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE).any())
        self._trunk = next((s.body for s in self._shapes if s.part is Part.TRUNK), 1)
        self._feet = shapes.feet(scene, self._shapes)

    def draw(self, axis: Axes, qpos: np.ndarray, gate: np.ndarray, force: np.ndarray, *, x: float = 0.0) -> None:
        """Draw one robot with its trunk above ``x``, looking at its own right side for any heading.

        The ground, if there is one, is drawn in the plane of the trunk; it is at height 0 below the trunk.

        Args:
            axis: Axes in metres, equal aspect.
            qpos: Positions, shape (nq,).
            gate: Gates of its devices, shape (M,).
            force: Forces of the ground on its feet [N], shape (L, 3).
            x: Where to draw it [m].
        """
        pos, quat = shapes.body_poses(self._model, qpos)
        heading = rotate(quat[self._trunk], np.array([1.0, 0.0, 0.0]))
        yaw = np.arctan2(heading[1], heading[0])
        forward, right = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([np.sin(yaw), -np.cos(yaw), 0.0])
        origin = pos[self._trunk] * (1.0, 1.0, 0.0)
        if self._ground is not None:
            origin[2] = self._ground.height(origin[:2])

        def flat(points: np.ndarray) -> np.ndarray:
            """Points of the world in the drawing plane."""
            relative = points - origin
            return np.stack([relative @ forward + x, relative[..., 2]], axis=-1)

        if self._flat:
            axis.axhspan(-0.05, 0.0, color=GROUND_COLOR, zorder=0)
            axis.axhline(0.0, color=GROUND_EDGE, linewidth=0.8, zorder=1)
        elif self._ground is not None:
            along = np.linspace(-GROUND_DRAWN, GROUND_DRAWN, 61)
            height = self._ground.height(origin[:2] + along[:, None] * forward[:2]) - origin[2]
            axis.fill_between(along + x, height, -0.3, color=GROUND_COLOR, linewidth=0, zorder=0.5)
            axis.plot(along + x, height, color=GROUND_EDGE, linewidth=0.8, zorder=1)
        for shape in self._shapes:
            turn, centre = quat[shape.body], pos[shape.body] + rotate(quat[shape.body], shape.pos)
            depth = float((centre - origin) @ right)
            color = GATE_COLORS[Gate(int(gate[shape.device]))] if shape.device >= 0 else shape.part.value
            faded = 0.5 if depth < -0.03 else 0.0  # what lies behind the trunk fades towards the paper
            if shape.points is not None and shape.faces is not None:
                corners = centre + rotate(turn, shape.points)
                axis.add_collection(_facets(flat(corners), (corners - origin) @ right, shape.faces, _rgb(color, faded)))
                continue
            patch = _patch(shape, lambda points, c=centre, q=turn, s=shape: flat(c + rotate(q, rotate(s.quat, points))))
            edge = _rgb((0.6 * color[0], 0.6 * color[1], 0.6 * color[2]), faded)
            patch.set(facecolor=_rgb(color, faded), edgecolor=edge, linewidth=0.5, zorder=2.0 + depth)
            axis.add_patch(patch)
        for leg, foot in self._feet.items():
            if np.linalg.norm(force[leg]) < 5.0:
                continue
            start = flat(pos[foot.body] + rotate(quat[foot.body], foot.pos))
            end = start + FORCE_SCALE * np.array([force[leg] @ forward, force[leg][2]])
            axis.annotate("", xy=tuple(end), xytext=tuple(start), arrowprops=FORCE_ARROW, zorder=4.0)


def _patch(shape: Shape, flat: Callable[[np.ndarray], np.ndarray]) -> Patch:
    """Outline of a shape in the drawing plane; ``flat`` puts points of its own frame there."""
    if shape.kind == mjtGeom.mjGEOM_SPHERE:
        return Circle(tuple(flat(np.zeros(3))), shape.size[0])
    if shape.kind == mjtGeom.mjGEOM_BOX:
        corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * shape.size
        return _outline(flat(corners))
    radius, half = shape.size
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    circle = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if shape.kind == mjtGeom.mjGEOM_CAPSULE:
        ends = flat(np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]))
        return _outline((ends[:, None] + circle).reshape(-1, 2))
    rims = [np.pad(circle, ((0, 0), (0, 1)), constant_values=z) for z in (-half, half)]
    return _outline(flat(np.concatenate(rims)))


def _facets(flat: np.ndarray, depth: np.ndarray, faces: np.ndarray, color: Rgb) -> PolyCollection:
    """A mesh in the drawing plane: the triangles that look at the reader, the farthest first."""
    corners = np.column_stack([flat, depth])[faces]  # x, z and towards the reader
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    seen = normal[:, 2] > 0.0
    normal, corners = normal[seen], corners[seen]
    light = normal @ LIGHT / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    colors = np.clip(np.array(color) * (0.7 + 0.5 * np.clip(light, 0.0, 1.0))[:, None], 0.0, 1.0)
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    style = {"facecolors": colors[order], "edgecolors": colors[order], "linewidths": 0.2}
    return PolyCollection(list(corners[order][:, :, :2]), zorder=2.0 + float(depth.mean()), **style)


def _outline(points: np.ndarray) -> Polygon:
    """The points' convex hull, by Andrew's monotone chain."""
    ordered, hull = sorted(points.tolist()), []
    for chain in (ordered, ordered[::-1]):
        side: list[list[float]] = []
        for x, y in chain:
            while len(side) > 1 and _left_of(side[-2], side[-1], x, y) <= 0.0:
                side.pop()
            side.append([x, y])
        hull += side[:-1]
    return Polygon(hull)


def _left_of(start: list[float], end: list[float], x: float, y: float) -> float:
    """Positive where a point lies left of a line."""
    return (end[0] - start[0]) * (y - start[1]) - (end[1] - start[1]) * (x - start[0])


def device_title(actuators: Sequence[JointActuator]) -> str:
    """Devices of a model in a title, as " with lab, which holds 3.2 N·m at 1.5 A"; empty where there are none."""
    found = dict.fromkeys(
        f"{Path(a.model.fitted_on.source).name}, which holds {a.mr.hold.yield_torque(a.mr.coil.current_max):.3g} N·m "
        f"at {a.mr.coil.current_max:.3g} A"
        for a in actuators
        if a.mr is not None and a.model is not None
    )
    return f" with {'; '.join(found)}" if found else ""


def contact_sheet(
    scene: Scene, frames: Frames, currents: Sequence[float], path: Path, *, title: str = "", seconds: float = 2.0
) -> None:
    """Every robot at instants spread over one stride, and the time series of the last ``seconds`` around them.

    ``currents``: I_e of each robot [A].
    """
    frames = frames[frames.time >= frames.time[-1] - seconds - 1e-9]
    stride = min(1.0 / GAIT_FREQUENCY, float(frames.time[-1] - frames.time[0]))
    wanted = frames.time[-1] - stride * (1.0 - np.arange(INSTANTS) / INSTANTS)
    instants = [int(np.argmin(np.abs(frames.time - t))) for t in wanted]
    num, time, k = len(currents), frames.time, len(currents) - 1
    has_device = frames.current.shape[2] > 0
    plots = 4 if has_device else 2
    heights = [0.3] + [1.12] * num + [0.5] + [1.25] * plots  # inches
    figure = Figure(figsize=(10.0, sum(heights) + 0.5), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.02, w_pad=0.04, hspace=0.02)  # type: ignore[union-attr]
    figure.suptitle(title, fontsize=10.5, x=0.012, ha="left", fontweight="bold")
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    _draw_times(figure.add_subplot(grid[0, :]), time[instants])
    side = SideView(scene)
    for robot, current in enumerate(currents):
        poses = [(frames.qpos[i, robot], frames.gate[i, robot], frames.foot_force[i, robot]) for i in instants]
        _draw_row(figure.add_subplot(grid[robot + 1, :]), side, poses, f"{current:.4g} A")
    legs = dict(zip(scene.layout.leg_names, shapes.leg_colors(scene), strict=True))
    _draw_legend(figure.add_subplot(grid[num + 1, :]), currents, has_device, legs, watched_name(scene))
    axes = [[figure.add_subplot(grid[num + 2 + row, column]) for column in range(2)] for row in range(plots)]
    (velocity, height), (motor, work) = axes[0], axes[-1]
    of_robots = [_current_color(robot) for robot in range(num)]
    velocity.plot(time, frames.v_x_command[:, 0], color="0.4", linewidth=1, linestyle="--")
    _lines(velocity, "forward velocity [m/s]", time, frames.v_x, of_robots)
    _lines(height, "trunk height [m]", time, shapes.trunk_height(ground_of(scene.model), frames.qpos), of_robots)
    colors = list(legs.values())
    # the joints of the last robot, which has the largest current
    at, joint = f"at {currents[k]:g} A", watched_name(scene)
    if has_device:
        (torque, coil), (gates, force) = axes[1:3]
        of_devices = [_rgb(color) for color in shapes.device_colors(scene)]
        _lines(torque, f"MR torque {at} [N·m]", time, frames.tau_mr[:, k], of_devices)
        _lines(coil, f"coil current {at} [A]", time, frames.current[:, k], of_devices, drawstyle="steps-post")
        _lines(force, f"foot force {at} [N]", time, np.linalg.norm(frames.foot_force[:, k], axis=-1), map(_rgb, colors))
        _plot_gates(gates, f"gates {at}", time, frames.gate[:, k], scene.device_names)
    of_motors = frames.tau_motor[:, k, list(scene.watched)]
    _lines(motor, f"{joint} motor torque {at} [N·m]", time, of_motors, map(_rgb, colors))
    used = (frames.ledger - frames.ledger[:1]).sum(2)
    _lines(work, "work on the joints [J]", time, used[:, :, int(ledger.MOTOR)], of_robots)
    by_devices = used[:, :, int(ledger.DYNAMIC) : int(ledger.DRAG) + 1].sum(-1)
    _lines(work, "work on the joints [J]", time, by_devices, of_robots, linestyle=":")
    styles = [Line2D([], [], color="0.4", label="motors"), Line2D([], [], color="0.4", linestyle=":", label="devices")]
    # next to the title, above the lines
    work.legend(handles=styles, fontsize=7, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False)
    for axis in (axis for row in axes for axis in row):
        axis.set_xlim(float(time[0]), float(time[-1]))
        axis.grid(alpha=0.25, linewidth=0.6)
        axis.tick_params(labelsize=7.5, labelbottom=axis in axes[-1])
        axis.spines[["top", "right"]].set_visible(False)
        for i in instants:
            axis.axvline(float(time[i]), color="0.55", linewidth=0.6, linestyle=(0, (2, 2)), zorder=0)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]", fontsize=8)
    figure.set_dpi(110)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # once; `savefig` draws a figure with a layout twice
    # a palette: a third of the size, for pictures that go into a repository
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    image = image.quantize(255, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    with atomic_write(path) as partial:
        image.save(partial, format="PNG", optimize=True)


def impact_sheet(sweep: ImpactSweep, trace: ImpactTrace, path: Path, *, title: str = "") -> None:
    """The first trial per current at instants after the impact, and height and speed of all currents below."""
    currents = sweep.cfg.currents
    scene, devices = sweep.env.sim.scene, sweep.env.actuator.mr_joints
    followed = [(slot, scene.watched.index(joint)) for slot, joint in enumerate(devices) if joint in scene.watched]
    slots, legs = (list(places) for places in zip(*followed, strict=True)) if followed else ([], [])
    side = SideView(scene)
    figure = Figure(figsize=(12, 1.7 * len(currents) + 4.2), layout="constrained")
    grid = figure.add_gridspec(len(currents) + 1, 2, height_ratios=[1.0] * len(currents) + [2.0])
    instants = [min(int(np.searchsorted(trace.t, instant)), len(trace.t) - 1) for instant in AFTER_IMPACT]
    for row, current in enumerate(currents):
        gates = np.zeros((len(trace.t), len(devices)), dtype=int)
        gates[:, slots] = gate_of(trace.m_dyn[row, 0], trace.m_hold[row, 0])[:, legs]
        upward = trace.f_foot[row, 0, ..., None] * np.array([0.0, 0.0, 1.0])
        poses = [(trace.qpos[row, k], gates[k], upward[k]) for k in instants]
        notes = [
            f"{1e3 * instant:.0f} ms, z = {trace.height[row, 0, k]:.3f} m"
            for instant, k in zip(AFTER_IMPACT, instants, strict=True)
        ]
        _draw_row(figure.add_subplot(grid[row, :]), side, poses, f"{current:.4g} A", notes)
    series = {"trunk height [m]": trace.height, "vertical velocity [m/s]": trace.velocity}
    for column, (label, values) in enumerate(series.items()):
        axis = figure.add_subplot(grid[-1, column])
        for row, current in enumerate(currents):
            mean, sd = values[row].mean(axis=0), values[row].std(axis=0)
            color = COLORS[row % len(COLORS)]
            axis.plot(trace.t, mean, color=color, label=f"{current:.4g} A")
            axis.fill_between(trace.t, mean - sd, mean + sd, color=color, alpha=0.12, linewidth=0)
        axis.set(xlabel="time after onset [s]", ylabel=label)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8, title="mean, SD over trials", title_fontsize=8)
    colors = "first trial of every current; orange damps, blue holds; arrows are foot forces"
    figure.suptitle("\n".join(filter(None, (title, colors))), fontsize=11)
    figure.savefig(path, dpi=100)


def impact_loops(trace: ImpactTrace, currents: tuple[float, ...], path: Path) -> None:
    """Torque of the devices over velocity and angle of their joints during the impact, all trials and legs."""
    figure, (axes,) = panels((11, 4.5), 1, 2, sharey=True)
    for row, current in enumerate(currents):
        color = COLORS[row % len(COLORS)]
        for axis, values in zip(axes, (trace.qd[row], trace.q[row]), strict=True):
            style = {"color": color, "markersize": 2, "alpha": 0.35, "label": f"{current:.4g} A"}
            axis.plot(values.ravel(), trace.tau_mr[row].ravel(), ".", **style)
    axes[0].set(xlabel="joint velocity [rad/s]", ylabel="torque of the MR device [N·m]")
    axes[1].set(xlabel="joint angle [rad]")
    for axis in axes:
        axis.axhline(0.0, color="0.6", linewidth=0.8)
    axes[0].axvline(0.0, color="0.6", linewidth=0.8)
    axes[0].legend(markerscale=4)
    figure.savefig(path, dpi=110)


def impact_timeline(trace: ImpactTrace, currents: tuple[float, ...], path: Path) -> None:
    """When each leg's gates were open in the first trial, per current."""
    figure = Figure(figsize=(11, 1.2 * len(currents) + 1.2), layout="constrained")
    axes = figure.subplots(len(currents), 1, sharex=True, squeeze=False)[:, 0]
    for row, (axis, current) in enumerate(zip(axes, currents, strict=True)):
        # loaded feet lie below the gates, in a wider bar
        bars = (
            (trace.f_foot > 5.0, "0.85", 0.45, 0),
            (trace.m_dyn, "#e08a1e", 0.35, 1),
            (trace.m_hold, "#1f6fb4", 0.35, 1),
        )
        for leg in range(len(trace.legs)):
            for state, color, half, order in bars:
                where = state[row, 0, :, leg] > 0.0
                axis.fill_between(trace.t, leg - half, leg + half, where=where, color=color, linewidth=0, zorder=order)
        axis.set(
            yticks=range(len(trace.legs)),
            yticklabels=trace.legs,
            ylabel=f"{current:.4g} A",
            ylim=(-0.6, len(trace.legs) - 0.4),
        )
    axes[-1].set_xlabel("time after onset [s]")
    figure.suptitle("Gates of the first trial: damping orange, holding blue; grey = foot loaded", fontsize=11)
    figure.savefig(path, dpi=110)


def watched_name(scene: Scene) -> str:
    """Names of the joints that are followed: the calves of the shipped robot."""
    return "calf" if scene.layout == MR_GO else "joint"


def _current_color(k: int) -> Rgb:
    return _rgb(CURRENT_COLORS[k % len(CURRENT_COLORS)])


def _frame_row(axis: Axes, height: float, unit: float = 1.0) -> None:
    """Axes of a row of drawn robots, in ``unit`` metres, without decoration."""
    axis.set(xlim=(-0.3 * unit, PITCH * INSTANTS * unit), ylim=(-0.04 * unit, (height - 0.04) * unit), aspect="equal")
    axis.set_axis_off()


def _draw_times(axis: Axes, times: np.ndarray) -> None:
    _frame_row(axis, 0.1)
    for place, time in enumerate(times):
        axis.text(PITCH * (place + 0.5), 0.0, f"{time:.2f} s", ha="center", va="center", fontsize=8.5, color="0.3")
    arrow = {"arrowstyle": "-|>", "color": "0.45", "lw": 1.0, "mutation_scale": 8}
    axis.annotate("", xy=(PITCH * INSTANTS - 0.02, 0.0), xytext=(PITCH * INSTANTS - 0.22, 0.0), arrowprops=arrow)


def _draw_row(axis: Axes, side: SideView, poses: Sequence[Pose], label: str, notes: Sequence[str] = ()) -> None:
    """One robot at the instants, from left to right, with a note above each, where no other robot's head comes."""
    unit = side.unit
    for place, (qpos, gate, force) in enumerate(poses):
        side.draw(axis, qpos, gate, force, x=unit * PITCH * (place + 0.5))
    for place, note in enumerate(notes):
        axis.text(unit * PITCH * (place + 0.5), 0.44 * unit, note, fontsize=8, ha="center", va="center")
    axis.text(-0.28 * unit, 0.2 * unit, label, va="center", fontsize=11, fontweight="bold")
    _frame_row(axis, 0.5, unit)


def _draw_legend(axis: Axes, currents: Sequence[float], has_device: bool, legs: dict[str, Color], joint: str) -> None:
    axis.set_axis_off()
    robot: list[Patch | Line2D] = []
    if has_device:
        names = {Gate.OFF: "gates closed", Gate.DYNAMIC: "dynamic gate open", Gate.HOLD: "holding gate open"}
        robot = [Patch(facecolor=_rgb(GATE_COLORS[gate]), label=f"{joint}: {text}") for gate, text in names.items()]
    robot.append(Line2D([], [], color=FORCE_COLOR, marker="^", markersize=4, label="foot force"))
    lines = [Line2D([], [], color="0.4", linestyle="--", linewidth=1, label="command")]
    lines += [Line2D([], [], color=_current_color(k), label=f"{current:.4g} A") for k, current in enumerate(currents)]
    lines += [Line2D([], [], color=_rgb(color), label=name) for name, color in legs.items()]
    style = {"fontsize": 8, "frameon": False, "borderpad": 0.0, "borderaxespad": 0.0, "handlelength": 1.6}
    axis.add_artist(axis.legend(handles=robot, loc="upper center", ncols=len(robot), **style))
    axis.legend(handles=lines, loc="lower center", ncols=len(lines), **style)


def _lines(axis: Axes, title: str, time: np.ndarray, values: np.ndarray, colors: Iterable[Rgb], **style: Any) -> None:
    for column, color in zip(values.T, colors, strict=False):
        axis.plot(time, column, color=color, linewidth=1.2, **style)
    axis.set_title(title, fontsize=8.5, loc="left", pad=3)


def _plot_gates(axis: Axes, title: str, time: np.ndarray, gate: np.ndarray, legs: Sequence[str]) -> None:
    """Bars where a device's gate is open, the first leg at the top."""
    for device in range(len(legs)):
        for state in (Gate.DYNAMIC, Gate.HOLD):
            spans = _spans(time, gate[:, device] == state)
            axis.broken_barh(spans, (len(legs) - 1 - device + 0.12, 0.76), color=_rgb(GATE_COLORS[state]), linewidth=0)
    axis.set_yticks([len(legs) - 1 - i + 0.5 for i in range(len(legs))], legs)
    axis.set_ylim(0, len(legs))
    axis.set_title(title, fontsize=8.5, loc="left", pad=3)


def _spans(time: np.ndarray, active: np.ndarray) -> list[tuple[float, float]]:
    """Begin and length of every run of True; an instant lasts until the next one."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], active.astype(int), [0]])))
    step = float(time[1] - time[0]) if len(time) > 1 else 0.0
    return [(float(time[a]), float(time[b - 1] - time[a]) + step) for a, b in edges.reshape(-1, 2)]
