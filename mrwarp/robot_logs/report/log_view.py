"""The logged robot and the extended simulation side by side in rerun: links as lines, the blamed part coloured.

Entities: ``logged/<body>`` and ``simulated/<body>`` with poses, ``mismatch/<joint>`` before and after, on the timeline
``log_time`` [s], on which recordings stand end to end. Every window of the simulation begins from the logged state.
"""

from __future__ import annotations

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mrwarp.robot_logs.report.compared_replays import Compared
from mrwarp.robot_logs.report.log_pictures import accused
from mrwarp.robot_logs.robot_verdict import RobotDiagnosis
from mrwarp.viewing.shapes import body_poses

TIMELINE = "log_time"
"""Time of the log, recordings end to end [s]."""

PLAIN, SIMULATED, BLAMED = (120, 130, 142), (70, 150, 220), (235, 126, 30)
"""Colours of the logged robot, the simulated one and what differs."""

DISTANCE = 0.8
"""Distance between both robots along y, in lengths of the robot."""

RATE = 50.0
"""Instants per second that are shown."""


def log_view(d: RobotDiagnosis, compared: list[Compared], recording: rr.RecordingStream) -> None:
    """Send both robots, their mismatch and a layout to a recording whose sinks are set."""
    blamed, model = accused(d), d.model.model
    bodies = {int(model.dof_bodyid[d.model.v_adr[j]]) for j in blamed} if d.causes else set()
    bodies |= {b for b in range(1, model.nbody) if any(c.where == model.body(b).name for c in d.causes)}
    size = _size(d)
    for k, (root, color) in enumerate((("logged", PLAIN), ("simulated", SIMULATED))):
        recording.log(root, rr.Transform3D(translation=[0.0, -DISTANCE * size * k, 0.0]), static=True)
        label = "log" if root == "logged" else "extended simulation"
        recording.log(f"{root}/name", rr.Points3D([[0.0, 0.0, 0.9 * size]], labels=[label], radii=0.0), static=True)
        for body in range(1, d.model.model.nbody):
            strips = _links(d.model.model, body)
            if strips:
                drawn = rr.LineStrips3D(strips, colors=[BLAMED if body in bodies else color], radii=0.02 * size)
                recording.log(f"{root}/{_name(d, body)}/link", drawn, static=True)
    shown = [*blamed, *(j for j in range(len(d.model.joints)) if j not in blamed)]
    for j in shown:
        style = rr.SeriesLines(names=["description", "extended"], colors=[[213, 94, 0], [0, 114, 178]])
        recording.log(f"mismatch/{d.model.joints[j]}", style, rr.AnyValues(unit="mrad"), static=True)
    for c in compared:
        _send(d, c, recording)
    views = [f"/mismatch/{d.model.joints[j]}" for j in blamed[:4]]
    recording.send_blueprint(
        rrb.Blueprint(
            rrb.Vertical(
                rrb.Spatial3DView(
                    origin="/", contents=["/logged/**", "/simulated/**"], name="log and extended simulation"
                ),
                rrb.Horizontal(*[rrb.TimeSeriesView(origin=v, name=f"{v[10:]}: mismatch [mrad]") for v in views]),
                row_shares=[3, 2],
            ),
            rrb.BlueprintPanel(state="collapsed"),
            rrb.SelectionPanel(state="collapsed"),
            rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="playing"),
        )
    )


def _send(d: RobotDiagnosis, c: Compared, recording: rr.RecordingStream) -> None:
    """Poses and mismatch of a group of windows."""
    every = max(1, round(1.0 / (RATE * float(np.median(np.diff(c.windows.t[0]))))))
    order = np.argsort(c.offset)
    time = c.time[order][:, ::every].ravel()
    times = [rr.TimeColumn(TIMELINE, duration=np.round(1e9 * time).astype("timedelta64[ns]"))]
    for root, values in (("logged", c.windows.measured), ("simulated", c.after)):
        qpos = np.tile(d.model.model.qpos0, (len(time), 1))
        if d.model.free:
            held = np.repeat(c.windows.root[order][:, None, :7], c.windows.t.shape[1], axis=1)[:, ::every]
            qpos[:, :7] = held.reshape(-1, 7)
            qpos[:, :2] = 0.0
            if "quat" in values:
                qpos[:, 3:7] = values["quat"][order][:, ::every].reshape(-1, 4)
        qpos[:, d.model.q_adr] = values["q"][order][:, ::every].reshape(len(time), -1)
        pos, quat = body_poses(d.model.model, np.nan_to_num(qpos))
        for body in range(1, d.model.model.nbody):
            poses = rr.Transform3D.columns(translation=pos[:, body], quaternion=np.roll(quat[:, body], -1, axis=1))
            recording.send_columns(f"{root}/{_name(d, body)}", times, poses)
    before, after = (1e3 * c.left(k)["q"][order][:, ::every].reshape(len(time), -1) for k in (False, True))
    for j, joint in enumerate(d.model.joints):
        both = np.stack([before[:, j], after[:, j]], axis=1)
        columns = rr.Scalars.columns(scalars=both.ravel()).partition([2] * len(both))
        recording.send_columns(f"mismatch/{joint}", times, columns)


def _name(d: RobotDiagnosis, body: int) -> str:
    return d.model.model.body(body).name.strip("/_") or f"body_{body}"


def _links(model: mujoco.MjModel, body: int) -> list[list[np.ndarray]]:
    """Lines from a body's origin to its children; of a body without any, to its furthest shape."""
    children = [model.body_pos[k] for k in range(1, model.nbody) if model.body_parentid[k] == body]
    if not children:
        geoms = np.flatnonzero(model.geom_bodyid == body)
        children = sorted((model.geom_pos[g] for g in geoms), key=lambda x: float(np.linalg.norm(x)))[-1:]
        if not children or np.linalg.norm(children[0]) < 1e-3:
            children = [2.0 * model.body_ipos[body]]
    return [[np.zeros(3), np.array(end)] for end in children if np.linalg.norm(end) > 1e-4]


def _size(d: RobotDiagnosis) -> float:
    """Length of the robot [m]."""
    pos, _ = body_poses(d.model.model, d.model.model.qpos0[None])
    return max(float(np.ptp(pos[0, 1:], axis=0).max()), 0.2)
