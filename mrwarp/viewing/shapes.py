"""The drawn part of a scene, from its MuJoCo model: shapes, where they are for a given qpos, and the ground."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from mujoco import mjtGeom
from pxr import Usd, UsdGeom, UsdPhysics

from mrwarp.env.sim_model import Scene, shape_name
from mrwarp.viewing.frames import Gate

Color = tuple[int, int, int]

GATE_COLORS: dict[Gate, Color] = {Gate.OFF: (152, 160, 168), Gate.DYNAMIC: (235, 126, 30), Gate.HOLD: (45, 125, 225)}
"""Colour of a calf by the state of its device's gates."""

LEG_COLORS: tuple[Color, ...] = ((214, 84, 80), (70, 150, 220), (226, 160, 50), (60, 170, 130))
"""Colours of the plotted lines of the legs; used in turn."""

CURRENT_COLORS: tuple[Color, ...] = ((160, 165, 70), (70, 185, 200), (150, 115, 235), (215, 60, 170))
"""Colours of lines that compare currents, from the smallest to the largest; used in turn."""

DEVICE_RADIUS, DEVICE_WIDTH = 0.034, 0.036
"""The disc that marks an MR device on its joint's axis [m]; a symbol, not the device's size."""

LINK_RADIUS = 0.022
"""Links of bodies without shapes of their own, e.g. the hips [m]; drawn from their joint to the next."""

CELLS = 40
"""Meshes are drawn with corners on a grid of the body's size by this number: what is smaller is not seen."""

SIZES = {mjtGeom.mjGEOM_BOX: 3, mjtGeom.mjGEOM_SPHERE: 1, mjtGeom.mjGEOM_CAPSULE: 2, mjtGeom.mjGEOM_CYLINDER: 2}
"""Geoms that are drawn, and how many numbers give the size of each."""


class Part(enum.Enum):
    """Part of the robot that a shape belongs to; decides its colour."""

    TRUNK = (74, 84, 98)
    LIMB = (108, 118, 130)
    FOOT = (40, 44, 50)
    GATED = GATE_COLORS[Gate.OFF]
    OTHER = (160, 130, 90)


@dataclass(frozen=True, kw_only=True)
class Shape:
    """One primitive or mesh, fixed to a body."""

    name: str
    """Unique on its body."""
    body: int
    """Body of the model that it moves with."""
    kind: mjtGeom
    """Form, of :data:`SIZES`, or a mesh."""
    size: tuple[float, ...]
    """Box: half lengths; sphere: radius; capsule, cylinder: radius, half length along z without caps [m]; mesh: ()."""
    pos: np.ndarray
    """Centre in the body's frame [m], shape (3,)."""
    quat: np.ndarray
    """Orientation in the body's frame, (w, x, y, z)."""
    part: Part
    """Part of the robot that it belongs to."""
    device: int = -1
    """Device whose gate it shows, or -1."""
    points: np.ndarray | None = None
    """Corners of a mesh [m], shape (N, 3)."""
    faces: np.ndarray | None = None
    """Triangles of a mesh, shape (F, 3)."""


def leg_colors(scene: Scene) -> list[Color]:
    """Colour of the plotted lines of each leg."""
    return [LEG_COLORS[k % len(LEG_COLORS)] for k in range(len(scene.layout.legs))]


def device_colors(scene: Scene) -> list[Color]:
    """Colour of the plotted lines of each device: its leg's, grey at a joint of no leg."""
    colors, devices = leg_colors(scene), [a.mr is not None for a in scene.actuators]
    return [colors[leg] if leg >= 0 else (128, 128, 128) for leg, mr in zip(scene.legs, devices, strict=True) if mr]


def body_names(scene: Scene) -> tuple[str, ...]:
    """Short name of each body, world first: the robot's without the path of its root, others as they are called."""
    names, trunk = [scene.model.body(i).name for i in range(scene.model.nbody)], scene.layout.trunk
    # Newton joins USD paths with underscores: the root's path is what stands before the trunk
    root = next((name.removesuffix(trunk) for name in names if name.endswith(f"_{trunk}")), "")
    return tuple(name.removeprefix(root).strip("/_") or f"body_{i}" for i, name in enumerate(names))


def robot_shapes(scene: Scene) -> tuple[Shape, ...]:
    """Drawn parts of the robot: its meshes, the shapes of bodies without meshes, the feet, and two kinds of symbols.

    The symbols are links of bodies that have no shapes, and a disc on the axis of each joint with an MR device.
    """
    model, names = scene.model, body_names(scene)
    device_of = {actuator.joint: i for i, actuator in enumerate(a for a in scene.actuators if a.mr is not None)}
    moved = dict(zip(model.dof_bodyid[scene.v_adr].tolist(), scene.joints, strict=True))
    shapes: list[Shape] = _meshes(scene, names, moved, device_of)
    in_mesh = {shape.body for shape in shapes}
    for geom in range(model.ngeom):
        if mjtGeom(model.geom_type[geom]) in SIZES:
            shape = _geom_shape(scene, geom, names, moved, device_of)
            if shape.body in in_mesh and shape.part is not Part.FOOT:
                continue
            taken = any(other.body == shape.body and other.name == shape.name for other in shapes)
            shapes.append(replace(shape, name=f"{shape.name}_{geom}") if taken else shape)
    used = {shape.body for shape in shapes}
    for child in range(1, model.nbody):
        parent, end = int(model.body_parentid[child]), model.body_pos[child]
        length = float(np.linalg.norm(end))
        if parent > 0 and parent not in used and length > 1e-6:
            shapes.append(
                Shape(
                    name=f"link_to_{names[child]}",
                    body=parent,
                    kind=mjtGeom.mjGEOM_CAPSULE,
                    size=(LINK_RADIUS, 0.5 * length),
                    pos=0.5 * end,
                    quat=_z_to(end),
                    part=Part.LIMB,
                )
            )
    for joint, device in device_of.items():
        # the scene knows a joint by its dof
        dof = int(scene.v_adr[scene.joints.index(joint)])
        body, index = int(model.dof_bodyid[dof]), int(model.dof_jntid[dof])
        shapes.append(
            Shape(
                name="mr_device",
                body=body,
                kind=mjtGeom.mjGEOM_CYLINDER,
                size=(DEVICE_RADIUS, 0.5 * DEVICE_WIDTH),
                pos=model.jnt_pos[index].copy(),
                quat=_z_to(model.jnt_axis[index]),
                part=Part.GATED,
                device=device,
            )
        )
    return tuple(shapes)


def feet(scene: Scene, shapes: tuple[Shape, ...]) -> dict[int, Shape]:
    """The shape of each leg's foot, by leg; a leg without one is left out."""
    return {k: shape for k, leg in enumerate(scene.layout.legs) for shape in shapes if shape.name == leg.foot}


def _geom_shape(
    scene: Scene, geom: int, names: tuple[str, ...], moved: dict[int, str], device_of: dict[str, int]
) -> Shape:
    """One geom; a leg's segment with a device on its joint shows the gate, its foot does not."""
    model, layout = scene.model, scene.layout
    body, kind = int(model.geom_bodyid[geom]), mjtGeom(model.geom_type[geom])
    name = shape_name(model.geom(geom).name) or f"geom_{geom}"
    foot = name in {leg.foot for leg in layout.legs}
    device = -1 if foot else device_of.get(moved.get(body, ""), -1)
    part = Part.LIMB if body in moved else Part.TRUNK if names[body] == layout.trunk else Part.OTHER
    return Shape(
        name=name,
        body=body,
        kind=kind,
        size=tuple(model.geom_size[geom][: SIZES[kind]].tolist()),
        pos=model.geom_pos[geom].copy(),
        quat=model.geom_quat[geom].copy(),
        part=Part.FOOT if foot else Part.GATED if device >= 0 else part,
        device=device,
    )


def _meshes(scene: Scene, names: tuple[str, ...], moved: dict[int, str], device_of: dict[str, int]) -> list[Shape]:
    """The meshes of the asset's bodies, in the bodies' frames, as coarse as they are drawn."""
    shapes: list[Shape] = []
    cache = UsdGeom.XformCache()
    for prim in scene.stage.Traverse() if scene.stage else []:
        body = next((p for p in _above(prim) if p.HasAPI(UsdPhysics.RigidBodyAPI)), None)
        if prim.GetTypeName() != "Mesh" or body is None or body.GetName() not in names:
            continue
        mesh, k = UsdGeom.Mesh(prim), names.index(body.GetName())
        counts, corners = mesh.GetFaceVertexCountsAttr().Get(), mesh.GetFaceVertexIndicesAttr().Get()
        if not counts or any(count != 3 for count in counts):
            continue
        place = np.array(cache.GetLocalToWorldTransform(prim) * cache.GetLocalToWorldTransform(body).GetInverse())
        points = np.array(mesh.GetPointsAttr().Get(), dtype=float) @ place[:3, :3] + place[3, :3]
        points, faces = _coarse(points, np.array(corners).reshape(-1, 3))
        device = device_of.get(moved.get(k, ""), -1)
        part = Part.TRUNK if body.GetName() == scene.layout.trunk else Part.LIMB if k in moved else Part.OTHER
        shapes.append(
            Shape(
                name=prim.GetName(),
                body=k,
                kind=mjtGeom.mjGEOM_MESH,
                size=(),
                pos=np.zeros(3),
                quat=np.array([1.0, 0.0, 0.0, 0.0]),
                part=Part.GATED if device >= 0 else part,
                device=device,
                points=points,
                faces=faces,
            )
        )
    return shapes


def _above(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Parents of a prim, innermost first."""
    while prim := prim.GetParent():
        yield prim


def _coarse(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with its corners moved together on a grid, see :data:`CELLS`; triangles without area are left out."""
    low, size = points.min(axis=0), max(float(np.ptp(points, axis=0).max()), 1e-9)
    _, group = np.unique(np.round((points - low) / size * CELLS).astype(int), axis=0, return_inverse=True)
    group = group.ravel()
    count = np.bincount(group)
    merged = np.stack([np.bincount(group, points[:, k]) / count for k in range(3)], axis=1)
    faces = group[faces]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return merged, faces[np.sort(first)]


def _z_to(direction: np.ndarray) -> np.ndarray:
    """Quaternion that turns z into a direction."""
    quat = np.empty(4)
    mujoco.mju_quatZ2Vec(quat, direction)
    return quat


def body_poses(model: mujoco.MjModel, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions of all bodies [m], shape (..., nbody, 3), and quaternions (w, x, y, z), shape (..., nbody, 4).

    ``qpos`` in MuJoCo's layout, shape (..., nq).
    """
    data = mujoco.MjData(model)
    pos, quat = np.empty((*qpos.shape[:-1], model.nbody, 3)), np.empty((*qpos.shape[:-1], model.nbody, 4))
    for index in np.ndindex(qpos.shape[:-1]):
        data.qpos[:] = qpos[index]
        mujoco.mj_kinematics(model, data)
        pos[index], quat[index] = data.xpos, data.xquat
    return pos, quat


def rotate(quat: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Vectors, shape (3,) or (N, 3), rotated by unit quaternions (w, x, y, z), shape (4,) or (N, 4)."""
    turns = np.empty((*quat.shape[:-1], 9))
    for index in np.ndindex(quat.shape[:-1]):
        mujoco.mju_quat2Mat(turns[index], quat[index])
    return np.einsum("...ij,...j->...i", turns.reshape(*quat.shape[:-1], 3, 3), vector)


@dataclass(frozen=True, kw_only=True)
class Ground:
    """Heights on a grid centred on the world's origin, as the model holds them; flat outside."""

    heights: np.ndarray
    """[m], shape (rows along y, columns along x)."""
    half: tuple[float, float]
    """Half the extent along x and y [m]."""

    def height(self, points: np.ndarray) -> np.ndarray:
        """Height below points [m], shape (...), by bilinear interpolation.

        ``points``: x and y [m], shape (..., 2).
        """
        from scipy.ndimage import map_coordinates  # pictures of flat ground do without

        last = np.array(self.heights.shape[::-1]) - 1
        column, row = np.moveaxis((points / self.half + 1.0) * 0.5 * last, -1, 0)
        height = map_coordinates(self.heights, [row.ravel(), column.ravel()], order=1, mode="nearest")
        return height.reshape(row.shape)

    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices [m], shape (N, 3), and triangles, shape (2 (rows - 1) (columns - 1), 3), seen from above."""
        rows, columns = self.heights.shape
        x, y = (np.linspace(-half, half, count) for half, count in zip(self.half, (columns, rows), strict=True))
        vertices = np.stack([*np.meshgrid(x, y), self.heights], axis=-1).reshape(-1, 3)
        corner = np.arange(rows * columns).reshape(rows, columns)[:-1, :-1].ravel()
        near = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
        far = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
        return vertices.astype(np.float32), np.concatenate([near, far]).astype(np.uint32)


def ground_of(model: mujoco.MjModel) -> Ground | None:
    """The model's first height field; None if its ground is a plane."""
    geoms = np.flatnonzero(model.geom_type == int(mjtGeom.mjGEOM_HFIELD))
    if not len(geoms):
        return None
    field = model.hfield(int(model.geom_dataid[geoms[0]]))
    half_x, half_y, top, _ = (float(size) for size in field.size)
    heights = field.data.astype(float) * top + model.geom_pos[geoms[0], 2]
    return Ground(heights=heights, half=(half_x, half_y))


def trunk_height(ground: Ground | None, qpos: np.ndarray) -> np.ndarray:
    """Height of the trunk over the ground below it [m], shape (...), from positions, shape (..., nq)."""
    return qpos[..., 2] - (0.0 if ground is None else ground.height(qpos[..., :2]))
