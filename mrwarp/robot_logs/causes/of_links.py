"""Masses and lengths of links, and the trunk's mass."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from mrwarp.robot_logs.causes.cause import Cause, Replayed, Shown
from mrwarp.robot_logs.causes.edits import MjcfEdit, UsdEdit
from mrwarp.robot_logs.causes.places import Place
from mrwarp.robot_logs.replay_model import ReplayModel

WALK = Shown("walk on level ground", {"walk": 20.0})


def _free(at: Place) -> bool:
    return at.model.free


def _says_mass(value: float, _: str) -> str:
    return f"{abs(value):.3g} kg {'heavier' if value > 0.0 else 'lighter'}"


def _times(edit: MjcfEdit | UsdEdit, b: int, x: float) -> float:
    """Factor on the mass of body ``b``, and on its inertia."""
    mass = edit.robot.model.body_mass[b]
    return max(mass + x, 1e-4) / mass


def _mjcf_mass(edit: MjcfEdit, b: int, x: float) -> None:
    body, factor = edit.weighed(b), _times(edit, b, x)
    body.mass = body.mass * factor
    body.inertia, body.fullinertia = np.array(body.inertia) * factor, np.array(body.fullinertia) * factor


def _usd_mass(edit: UsdEdit, b: int, x: float) -> None:
    for name in ("physics:mass", "physics:diagonalInertia"):
        attribute = edit.body(b).GetAttribute(name)
        attribute.Set(attribute.Get() * _times(edit, b, x))


def _mjcf_com(edit: MjcfEdit, axis: int, x: float) -> None:
    body = edit.weighed(edit.robot.trunk)
    ipos = np.array(body.ipos)
    ipos[axis] += x
    body.ipos = ipos


def _usd_com(edit: UsdEdit, axis: int, x: float) -> None:
    center = edit.body(edit.robot.trunk).GetAttribute("physics:centerOfMass")
    value = center.Get()
    value[axis] += x
    center.Set(value)


def _weighted(mass: float, inertia: np.ndarray, more: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Principal inertias [kg·m²] of a link with a weight on it, about the centre of mass of both, shape (..., 3).

    A weight near the link's centre makes it denser; further off than its radius of gyration it is a point. Without a
    weight that is added, a moment is a centre that the description has wrong, and adds nothing.

    Args:
        mass: Of the link [kg].
        inertia: Of the link [kg·m²], shape (3,).
        more: Mass of the weight [kg], shape (...).
        moment: That of it about the link's centre, along the principal axes [kg·m], shape (..., 3).
    """
    added, square = np.maximum(more, 0.0), moment**2
    far = square / (added**2 + (0.1 * mass) ** 2)[..., None]  # of no weight none, and no infinite distance
    point = np.where(added > 0.0, np.exp(-far.sum(axis=-1) * 2.0 * mass / max(inertia.sum(), 1e-12)), 1.0)
    reduced = (mass * added / (mass + added))[..., None]
    return inertia * (1.0 + point * more / mass)[..., None] + reduced * (far.sum(axis=-1, keepdims=True) - far)


def _frame(robot: ReplayModel, b: int) -> np.ndarray:
    """Principal axes of a body, the columns, (3, 3)."""
    return Rotation.from_quat(np.roll(robot.model.body_iquat[b], -1)).as_matrix()


def _off_centre(replay: Replayed, change: np.ndarray) -> None:
    """Bodies of E robots with ``change``, (E, 3B), in addition to their static moments: centres of mass, inertias."""
    mj, moment = replay.robot.model, change.reshape(len(change), -1, 3)
    place, mass, inertia = (replay.model(f"body_{name}") for name in ("ipos", "mass", "inertia"))
    for b in np.flatnonzero(moment.any(axis=(0, 2))).tolist():
        place[:, b] += moment[:, b] / mass[:, b, None]
        along = moment[:, b] @ _frame(replay.robot, b)
        own = _weighted(float(mj.body_mass[b]), mj.body_inertia[b], mass[:, b] - mj.body_mass[b], along)
        inertia[:, b] = np.maximum(own, 1e-3 * mj.body_inertia[b])


def _written(robot: ReplayModel, column: int, x: float, mass: float, center: np.ndarray) -> tuple[np.ndarray, ...]:
    """Centre of mass and principal inertias of a body of some mass and centre, with ``x`` more along an axis."""
    b, mj = column // 3, robot.model
    center = center + x / mass * np.eye(3)[column % 3]
    along = mass * (center - mj.body_ipos[b]) @ _frame(robot, b)
    more = np.array(mass - mj.body_mass[b])
    return center, _weighted(float(mj.body_mass[b]), mj.body_inertia[b], more, along)


def _mjcf_moment(edit: MjcfEdit, column: int, x: float) -> None:
    body = edit.weighed(column // 3)
    center, inertia = _written(edit.robot, column, x, float(body.mass), np.array(body.ipos))
    body.ipos = center
    if np.isnan(np.array(body.fullinertia)).any():  # else it has axes of its own
        body.inertia = inertia


def _usd_moment(edit: UsdEdit, column: int, x: float) -> None:
    prim = edit.body(column // 3)
    names = ("physics:mass", "physics:centerOfMass", "physics:diagonalInertia")
    mass, center, inertia = (prim.GetAttribute(name) for name in names)
    new = _written(edit.robot, column, x, float(mass.Get()), np.array(center.Get(), dtype=float))
    for attribute, value in zip((center, inertia), new, strict=True):
        attribute.Set(type(attribute.Get())(*map(float, value)))


def _mjcf_length(edit: MjcfEdit, b: int, x: float) -> None:
    body, far = edit.body(b), 1.0 + x / edit.robot.reach[b]
    for item in [*body.bodies, *body.geoms]:
        item.pos = np.array(item.pos) * far


CAUSES = (
    Cause(
        name="trunk_mass",
        title="trunk mass",
        field="mass",
        place="trunk",
        there=_free,
        number="mass",
        unit="kg",
        mechanical=True,
        step=lambda at: 0.02 * at.total,
        spread=lambda at: 0.008 * at.total,
        least=lambda at: 0.015 * at.total,
        fault=lambda at: 0.15 * at.total,
        possible=lambda at: at.total,
        payload=("mass",),
        central=True,
        through="trunk",
        shown=Shown("walk on level ground, with the motors' torque in the log", {"walk": 20.0}),
        says=_says_mass,
        mjcf=_mjcf_mass,
        usd=_usd_mass,
    ),
    Cause(
        name="trunk_com",
        title="trunk com",
        field="com",
        place="trunk_axis",
        there=_free,
        unit="m",
        step=0.01,
        spread=0.004,
        least=0.01,
        fault=0.04,
        payload=("x", "y"),
        through="trunk",
        shown=Shown("stand and lean to all sides on level ground", {"stand": 5.0, "lean": 15.0}),
        says=lambda value, axis: f"centre of mass {1e3 * value:+.0f} mm along {axis}",
        mjcf=_mjcf_com,
        usd=_usd_com,
    ),
    Cause(
        name="link_mass",
        title="link mass",
        field="mass",
        place="body",
        there=lambda at: at.mass > 0.02,
        number="mass",
        unit="kg",
        mechanical=True,
        step=lambda at: 0.05 * at.mass,
        spread=lambda at: 0.02 * at.mass,
        # a weight counts as friction does: where it makes less torque than the least friction, drives hide it
        least=lambda at: max(0.05 * at.mass + 0.02, at.hidden_mass),
        fault=lambda at: 0.3 * at.mass + 0.1,
        possible=lambda at: at.total,
        or_payload=True,
        central=True,
        shown=Shown("swing the link slowly through its range with the trunk fixed", {"slow": 20.0}),
        shown_by_arm=Shown("swing the link slowly through its range", {"slow": 20.0}),
        says=_says_mass,
        mjcf=_mjcf_mass,
        usd=_usd_mass,
    ),
    Cause(  # with a mass next to it a weight anywhere on the link
        name="link_com",
        title="static moment",
        field="moment",
        place="body_axis",
        there=lambda at: not at.model.free and at.link.mass > 0.02,
        unit="kg·m",
        step=lambda at: 0.01 * at.link.mass,
        spread=lambda at: 0.003 * at.link.mass,
        least=lambda at: max(0.01 * at.link.mass, at.link.hidden_moment),
        fault=lambda at: max(0.04 * at.link.mass, 5.0 * at.link.hidden_moment),
        central=True,
        shown=Shown("swing the link slowly through its range with the trunk fixed", {"slow": 20.0}),
        shown_by_arm=Shown("swing the link slowly through its range", {"slow": 20.0}),
        says=lambda value, axis: f"its weight sits off, a static moment of {value:+.2g} kg·m along {axis}",
        acts=_off_centre,
        mjcf=_mjcf_moment,
        usd=_usd_moment,
    ),
    Cause(
        name="link_length",
        title="link length",
        field="length",
        place="body",
        there=lambda at: at.model.free and at.mass > 0.02 and at.reach > 0.02,
        number="length",
        unit="m",
        step=0.005,
        spread=0.002,
        least=0.006,
        fault=lambda at: 0.1 * at.reach,
        possible=lambda at: at.reach,
        through="trunk",
        shown=WALK,
        mjcf=_mjcf_length,
    ),
)
