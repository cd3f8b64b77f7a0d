"""Masses and lengths of links, and the trunk's mass."""

from __future__ import annotations

import numpy as np

from mrwarp.robot_logs.causes.cause import Cause, Replayed, Shown
from mrwarp.robot_logs.causes.edits import MjcfEdit, UsdEdit
from mrwarp.robot_logs.causes.places import Place

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


def _centred(moment: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Way of the centre of mass [m], (..., 3), by what is added to static moments [kg·m], with ``mass`` (...) [kg]."""
    return moment / np.maximum(mass, 1e-4)[..., None]


def _off_centre(replay: Replayed, change: np.ndarray) -> None:
    """Centres of mass of E robots' B bodies, ``change`` (E, 3B) in addition to their static moments."""
    place = replay.model("body_ipos")
    place += _centred(change.reshape(place.shape), replay.model("body_mass"))


def _mjcf_moment(edit: MjcfEdit, column: int, x: float) -> None:
    body, way = edit.weighed(column // 3), np.zeros(3)
    way[column % 3] = x
    body.ipos = np.array(body.ipos) + _centred(way, np.array(body.mass))


def _usd_moment(edit: UsdEdit, column: int, x: float) -> None:
    prim = edit.body(column // 3)
    center = prim.GetAttribute("physics:centerOfMass")
    value = center.Get()
    value[column % 3] += x / max(prim.GetAttribute("physics:mass").Get(), 1e-4)
    center.Set(value)


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
