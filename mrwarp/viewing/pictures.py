"""Pictures without a viewer: robots from the side at five instants, and what their joints did around them."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon
from PIL import Image

from mrwarp.env.sim_model import Scene
from mrwarp.kernels import ledger
from mrwarp.robot import CALVES, GAIT_FREQUENCY, LEGS
from mrwarp.viewing.frames import Frames, Gate
from mrwarp.viewing.shapes import (
    CURRENT_COLORS,
    GATE_COLORS,
    LEG_COLORS,
    Color,
    Kind,
    Kinematics,
    Part,
    Shape,
    compose,
    robot_shapes,
    rotate,
)

INSTANTS = 5
"""Instants in a row, evenly over one stride."""

PITCH = 0.8
"""Distance between the drawn robots of a row [m]."""

FORCE_SCALE = 0.16 / 100.0
"""Length of a drawn foot force [m/N]: 100 N are 0.16 m."""

FORCE_COLOR = "#d6335c"
"""Foot forces."""


class SideView:
    """Draws robots of a scene from their right side, as parallel projections of their shapes.

    Args:
        scene: What is simulated.
    """

    def __init__(self, scene: Scene) -> None:
        self._kinematics = Kinematics(scene.model)
        self._shapes = robot_shapes(scene)
        self._trunk = next((s.body for s in self._shapes if s.part is Part.TRUNK), 1)
        self._feet = [next((s for s in self._shapes if s.name == f"{leg}_foot"), None) for leg in LEGS]

    def draw(self, axis: Axes, qpos: np.ndarray, gate: np.ndarray, force: np.ndarray, *, x: float = 0.0) -> None:
        """Draw one robot with its trunk above ``x``, looking at its own right side whatever its heading.

        Args:
            axis: Axes in metres, equal aspect.
            qpos: Positions, shape (nq,).
            gate: Gates of its devices, shape (M,).
            force: Forces of the ground on its feet [N], shape (L, 3).
            x: Where to draw it [m].
        """
        pos, quat = self._kinematics(qpos)
        heading = rotate(quat[self._trunk], np.array([1.0, 0.0, 0.0]))
        yaw = np.arctan2(heading[1], heading[0])
        forward, right = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([np.sin(yaw), -np.cos(yaw), 0.0])
        origin = pos[self._trunk] * (1.0, 1.0, 0.0)

        def flat(points: np.ndarray) -> np.ndarray:
            relative = points - origin
            return np.stack([relative @ forward + x, relative[..., 2]], axis=-1)

        depth = {id(s): float((pos[s.body] + rotate(quat[s.body], s.pos) - origin) @ right) for s in self._shapes}
        for shape in sorted(self._shapes, key=lambda s: depth[id(s)]):
            centre = pos[shape.body] + rotate(quat[shape.body], shape.pos)
            color = GATE_COLORS[Gate(int(gate[shape.device]))] if shape.device >= 0 else shape.part.value
            # what lies behind the trunk fades towards the paper
            face = _fade(color, 0.5 if depth[id(shape)] < -0.03 else 0.0)
            edge = _fade(_darker(color), 0.5 if depth[id(shape)] < -0.03 else 0.0)
            for patch in _patches(shape, centre, compose(quat[shape.body], shape.quat), flat):
                patch.set(facecolor=face, edgecolor=edge, linewidth=0.5, zorder=2.0 + depth[id(shape)])
                axis.add_patch(patch)
        for leg, foot in enumerate(self._feet):
            if foot is None or leg >= len(force) or np.linalg.norm(force[leg]) < 5.0:
                continue
            start = flat(pos[foot.body] + rotate(quat[foot.body], foot.pos))
            end = start + FORCE_SCALE * np.array([force[leg] @ forward, force[leg][2]])
            arrow = {
                "arrowstyle": "-|>",
                "color": FORCE_COLOR,
                "lw": 1.3,
                "mutation_scale": 7,
                "shrinkA": 0,
                "shrinkB": 0,
            }
            axis.annotate("", xy=tuple(end), xytext=tuple(start), arrowprops=arrow, zorder=4.0)


def contact_sheet(
    scene: Scene, frames: Frames, currents: Sequence[float], path: Path, *, title: str = "", seconds: float = 2.0
) -> None:
    """Five instants of every robot, and the time series of the last ``seconds`` around them.

    Args:
        scene: What is simulated.
        frames: What happened; its last ``seconds`` are shown.
        currents: Current I_e of each robot [A].
        path: PNG to write.
        title: Title.
        seconds: Time shown [s].
    """
    frames = frames[frames.time >= frames.time[-1] - seconds - 1e-9]
    stride = min(1.0 / GAIT_FREQUENCY, float(frames.time[-1] - frames.time[0]))
    wanted = frames.time[-1] - stride * (1.0 - np.arange(INSTANTS) / INSTANTS)
    instants = [int(np.argmin(np.abs(frames.time - t))) for t in wanted]
    num = len(currents)
    has_device = frames.current.shape[2] > 0
    plots = 4 if has_device else 2
    heights = [0.3] + [1.12] * num + [0.5] + [1.25] * plots  # inches
    figure = Figure(figsize=(10.0, sum(heights) + 0.5), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.02, w_pad=0.04, hspace=0.02)  # type: ignore[union-attr]
    figure.suptitle(title, fontsize=10.5, x=0.012, ha="left", fontweight="bold")
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    _draw_times(figure.add_subplot(grid[0, :]), frames.time[instants])
    side = SideView(scene)
    for k, current in enumerate(currents):
        _draw_row(figure.add_subplot(grid[k + 1, :]), side, frames, k, instants, f"{current:g} A")
    _draw_legend(figure.add_subplot(grid[num + 1, :]), currents, has_device)
    axes = [[figure.add_subplot(grid[num + 2 + row, column]) for column in range(2)] for row in range(plots)]
    _plot_motion(axes[0], frames, currents)
    if has_device:
        legs = [LEGS[leg] for leg, a in zip(scene.legs, scene.actuators, strict=True) if a.mr is not None]
        _plot_devices(axes[1:3], frames, legs, num - 1, currents[-1])
    _plot_motor(axes[-1][0], scene, frames, num - 1, currents[-1])
    _plot_energy(axes[-1][1], frames, currents)
    for row in axes:
        for axis in row:
            _tidy(axis, frames.time, instants, last=row is axes[-1])
    _save(figure, path)


def _tidy(axis: Axes, time: np.ndarray, instants: Sequence[int], *, last: bool) -> None:
    """What all time series have in common."""
    axis.set_xlim(float(time[0]), float(time[-1]))
    axis.grid(alpha=0.25, linewidth=0.6)
    axis.tick_params(labelsize=7.5, labelbottom=last)
    for i in instants:
        axis.axvline(float(time[i]), color="0.55", linewidth=0.6, linestyle=(0, (2, 2)), zorder=0)
    for spine in ("top", "right"):
        axis.spines[spine].set_visible(False)
    if last:
        axis.set_xlabel("time [s]", fontsize=8)


def _save(figure: Figure, path: Path) -> None:
    """Write a PNG with a palette: a third of the size, for pictures that go into a repository."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=110, format="png", facecolor="white")
    image = Image.open(buffer).convert("RGB").quantize(255, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".part")
    image.save(partial, format="PNG", optimize=True)
    partial.replace(path)


def _frame_row(axis: Axes, height: float) -> None:
    """Axes of a row of drawn robots, in metres, without decoration."""
    axis.set(xlim=(-0.3, PITCH * INSTANTS), ylim=(-0.04, -0.04 + height), aspect="equal")
    axis.set_axis_off()


def _draw_times(axis: Axes, times: np.ndarray) -> None:
    _frame_row(axis, 0.1)
    for place, time in enumerate(times):
        axis.text(PITCH * (place + 0.5), 0.0, f"{time:.2f} s", ha="center", va="center", fontsize=8.5, color="0.3")
    arrow = {"arrowstyle": "-|>", "color": "0.45", "lw": 1.0, "mutation_scale": 8}
    axis.annotate("", xy=(PITCH * INSTANTS - 0.02, 0.0), xytext=(PITCH * INSTANTS - 0.22, 0.0), arrowprops=arrow)


def _draw_row(axis: Axes, side: SideView, frames: Frames, k: int, instants: Sequence[int], label: str) -> None:
    """One robot at the instants, from left to right."""
    axis.axhspan(-0.05, 0.0, color="#e4e6e9", zorder=0)
    axis.axhline(0.0, color="#9aa0a8", linewidth=0.8, zorder=1)
    for place, i in enumerate(instants):
        x = PITCH * (place + 0.5)
        side.draw(axis, frames.qpos[i, k], frames.gate[i, k], frames.foot_force[i, k], x=x)
    axis.text(-0.28, 0.2, label, ha="left", va="center", fontsize=11, fontweight="bold")
    _frame_row(axis, 0.48)


def _draw_legend(axis: Axes, currents: Sequence[float], has_device: bool) -> None:
    """What the colours of robots, currents and legs mean."""
    axis.set_axis_off()
    robot: list[Patch | Line2D] = []
    if has_device:
        names = {Gate.OFF: "gates closed", Gate.DYNAMIC: "dynamic gate open", Gate.HOLD: "holding gate open"}
        robot = [Patch(facecolor=_rgb(GATE_COLORS[gate]), label=f"calf: {text}") for gate, text in names.items()]
    robot.append(Line2D([], [], color=FORCE_COLOR, marker="^", markersize=4, label="foot force"))
    lines = [Line2D([], [], color="0.4", linestyle="--", linewidth=1, label="command")]
    lines += [
        Line2D([], [], color=_rgb(CURRENT_COLORS[k % len(CURRENT_COLORS)]), label=f"{current:g} A")
        for k, current in enumerate(currents)
    ]
    lines += [Line2D([], [], color=_rgb(LEG_COLORS[leg]), label=name) for leg, name in enumerate(LEGS)]
    style = {"fontsize": 8, "frameon": False, "borderpad": 0.0, "borderaxespad": 0.0, "handlelength": 1.6}
    axis.add_artist(axis.legend(handles=robot, loc="upper center", ncols=len(robot), **style))
    axis.legend(handles=lines, loc="lower center", ncols=len(lines), **style)


def _plot_motion(axes: Sequence[Axes], frames: Frames, currents: Sequence[float]) -> None:
    """Forward velocity and trunk height of all robots."""
    axes[0].plot(frames.time, frames.v_x_command[:, 0], color="0.4", linewidth=1, linestyle="--")
    for k, _ in enumerate(currents):
        color = _rgb(CURRENT_COLORS[k % len(CURRENT_COLORS)])
        axes[0].plot(frames.time, frames.v_x[:, k], color=color, linewidth=1.2)
        axes[1].plot(frames.time, frames.qpos[:, k, 2], color=color, linewidth=1.2)
    _title(axes[0], "forward velocity [m/s]")
    _title(axes[1], "trunk height [m]")


def _plot_devices(axes: Sequence[Sequence[Axes]], frames: Frames, legs: Sequence[str], k: int, current: float) -> None:
    """Torque, current and gates of one robot's devices."""
    (torque, coil), (gates, force) = axes
    for device, leg in enumerate(legs):
        color = _rgb(LEG_COLORS[LEGS.index(leg)])
        torque.plot(frames.time, frames.tau_mr[:, k, device], color=color, linewidth=1.2)
        coil.step(frames.time, frames.current[:, k, device], color=color, linewidth=1.2, where="post")
        for gate in (Gate.DYNAMIC, Gate.HOLD):
            spans = _spans(frames.time, frames.gate[:, k, device] == gate)
            gates.broken_barh(spans, (len(legs) - 1 - device + 0.12, 0.76), color=_rgb(GATE_COLORS[gate]), linewidth=0)
    for leg in range(len(LEGS)):
        norm = np.linalg.norm(frames.foot_force[:, k, leg], axis=-1)
        force.plot(frames.time, norm, color=_rgb(LEG_COLORS[leg]), linewidth=1.2)
    gates.set_yticks([len(legs) - 1 - i + 0.5 for i in range(len(legs))], legs)
    gates.set_ylim(0, len(legs))
    _title(torque, f"MR torque at {current:g} A [N·m]")
    _title(coil, f"coil current at {current:g} A [A]")
    _title(gates, f"gates at {current:g} A")
    _title(force, f"foot force at {current:g} A [N]")


def _plot_motor(axis: Axes, scene: Scene, frames: Frames, k: int, current: float) -> None:
    """Calf motors of one robot."""
    for joint, name in enumerate(scene.joints):
        if name in CALVES:
            color = _rgb(LEG_COLORS[scene.legs[joint]])
            axis.plot(frames.time, frames.tau_motor[:, k, joint], color=color, linewidth=1.2)
    _title(axis, f"calf motor torque at {current:g} A [N·m]")


def _plot_energy(axis: Axes, frames: Frames, currents: Sequence[float]) -> None:
    """Work of motors and devices since the start of the window."""
    used = (frames.ledger - frames.ledger[:1]).sum(2)
    device = used[:, :, int(ledger.DYNAMIC) : int(ledger.DRAG) + 1].sum(-1)
    for k, _ in enumerate(currents):
        color = _rgb(CURRENT_COLORS[k % len(CURRENT_COLORS)])
        axis.plot(frames.time, used[:, k, int(ledger.MOTOR)], color=color, linewidth=1.2)
        axis.plot(frames.time, device[:, k], color=color, linewidth=1.2, linestyle=":")
    styles = [Line2D([], [], color="0.4", label="motors"), Line2D([], [], color="0.4", linestyle=":", label="devices")]
    axis.legend(handles=styles, fontsize=7, ncols=2, loc="upper left", framealpha=0.8, borderpad=0.3)
    _title(axis, "work on the joints [J]")


def _title(axis: Axes, text: str) -> None:
    axis.set_title(text, fontsize=8.5, loc="left", pad=3)


def _spans(time: np.ndarray, active: np.ndarray) -> list[tuple[float, float]]:
    """Begin and length of every run of True; an instant lasts until the next one."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], active.astype(int), [0]])))
    step = float(time[1] - time[0]) if len(time) > 1 else 0.0
    return [(float(time[a]), float(time[b - 1] - time[a]) + step) for a, b in edges.reshape(-1, 2)]


def _patches(
    shape: Shape, centre: np.ndarray, quat: np.ndarray, flat: Callable[[np.ndarray], np.ndarray]
) -> list[Patch]:
    """Outline of a shape in the drawing plane."""
    if shape.kind is Kind.SPHERE:
        return [Circle(tuple(flat(centre)), shape.size[0])]
    if shape.kind is Kind.BOX:
        corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * shape.size
        return [Polygon(_hull(flat(centre + rotate(quat, corners))))]
    radius, half = shape.size
    ends = flat(centre + rotate(quat, np.array([[0.0, 0.0, -half], [0.0, 0.0, half]])))
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    if shape.kind is Kind.CAPSULE:
        circle = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return [Polygon(_hull(np.concatenate([ends[0] + circle, ends[1] + circle])))]
    rim = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    sides = [flat(centre + rotate(quat, rim + [0.0, 0.0, z])) for z in (-half, half)]
    return [Polygon(_hull(np.concatenate(sides)))]


def _hull(points: np.ndarray) -> np.ndarray:
    """Convex hull of points in the plane, counter-clockwise (monotone chain)."""
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]

    def chain(rows: np.ndarray) -> list[np.ndarray]:
        kept: list[np.ndarray] = []
        for row in rows:
            while len(kept) > 1 and _turn(kept[-2], kept[-1], row) <= 0.0:
                kept.pop()
            kept.append(row)
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _rgb(color: Color) -> tuple[float, float, float]:
    return color[0] / 255.0, color[1] / 255.0, color[2] / 255.0


def _fade(color: Color, share: float) -> tuple[float, float, float]:
    """A colour mixed with white."""
    r, g, b = (c + (1.0 - c) * share for c in _rgb(color))
    return r, g, b


def _darker(color: Color) -> Color:
    r, g, b = (int(0.6 * c) for c in color)
    return r, g, b
