"""The guided mass of the paper's hardware trial (section 6.3) as a real body that falls on the robot's back."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
import torch
import warp as wp

from mrwarp.env.natural_units import Scales
from mrwarp.env.sim_model import Edit, named
from mrwarp.env.vec_env import WalkEnv
from mrwarp.paper import GRAVITY
from mrwarp.usd.robot import MR_GO, Layout

JOINTS = ("mass_x", "mass_y", "mass_z")
"""Slide joints of the mass: the guide moves with the robot sideways, the mass falls in it."""

PLATE = "mass_plate"
"""Target of the mass on another robot than the shipped one."""

PAD, PAD_MASS, PAD_DAMPING = "mass_pad", 0.1, 0.1
"""Name, mass [kg] and damping ratio of the pad of a compliant contact: light against 10 kg; rubber and soft foam have a
loss factor of about 0.2."""

PARKED = 5.0
"""Height at which the mass waits [m]."""

HALF_SIZE = 0.05
"""Half the edge of the mass, a cube [m]; not in the paper, which states no size."""


@dataclass(frozen=True, kw_only=True)
class MassCfg:
    """The falling mass."""

    mass: float = 10.0
    """Mass [kg], paper section 6.3."""
    drop: float = 0.30
    """Distance from the contact surface at release [m], paper section 6.3."""
    contact_speed: float = 1.5
    """Speed at contact [m/s], paper section 6.3; less than free fall, so the guide brakes."""
    travel: float = 0.05
    """Further travel after contact until the stop [m], paper section 6.3."""
    stiffness: float | None = None
    """Of a light pad below the mass [N/m]; None: the mass meets the trunk as the engine's rigid bodies meet. The paper
    says nothing of the contact, see :func:`contact_stiffness`."""

    @property
    def guide_friction(self) -> float:
        """Friction of the guide [N] that turns free fall into ``contact_speed``: m*(g - v^2/(2*drop))."""
        return self.mass * (GRAVITY - self.contact_speed**2 / (2.0 * self.drop))

    def scaled(self, by: Scales) -> MassCfg:
        """The mass for a robot of another size."""
        if by == Scales():
            return self
        return MassCfg(
            mass=self.mass * by.mass,
            drop=self.drop * by.length,
            contact_speed=self.contact_speed * by.speed,
            travel=self.travel * by.length,
            stiffness=None if self.stiffness is None else self.stiffness * by.mass / by.time**2,
        )


def contact_stiffness(mass: float, body: float, seconds: float) -> float:
    """Stiffness [N/m] on which two free masses [kg] part again after some seconds, half a period: ``mu (pi/T)^2``."""
    return mass * body / (mass + body) * (math.pi / seconds) ** 2


def add_mass(cfg: MassCfg, layout: Layout = MR_GO) -> Edit:
    """The specification change that adds the parked mass; see ``build_scene(edit=...)``.

    It meets the shipped robot's trunk, and on another robot a plate of its own size on the trunk's highest shape.
    """

    def edit(spec: mujoco.MjSpec) -> None:
        body = spec.worldbody.add_body(name="mass", pos=[0.0, 0.0, PARKED])
        for name, axis in zip(JOINTS, np.eye(3), strict=True):
            body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        body.joints[2].range = [-PARKED, PARKED]
        body.joints[2].limited = mujoco.mjtLimited.mjLIMITED_TRUE
        body.add_geom(
            name="mass_geom",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[HALF_SIZE] * 3,
            mass=cfg.mass,
            contype=0,
            conaffinity=0,
        )
        meets = "mass_geom"
        if cfg.stiffness is not None:
            pad, meets = body.add_body(name=PAD), f"{PAD}_geom"
            pad.add_joint(
                name=PAD,
                type=mujoco.mjtJoint.mjJNT_SLIDE,
                axis=[0.0, 0.0, 1.0],
                stiffness=cfg.stiffness,
                damping=2.0 * PAD_DAMPING * math.sqrt(cfg.stiffness * cfg.mass),
            )
            pad.add_geom(
                name=meets,
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[HALF_SIZE, HALF_SIZE, 0.01],
                mass=PAD_MASS,
                pos=[0.0, 0.0, 0.01 - HALF_SIZE],
                contype=0,
                conaffinity=0,
            )
        # it meets the trunk and nothing else
        target = next((geom.name for geom in spec.geoms if layout == MR_GO and "/trunk_shape" in geom.name), PLATE)
        if target == PLATE:
            trunk = next(body for body in spec.bodies if body.name.endswith(f"_{layout.trunk}"))
            top = max((_top(geom) for geom in trunk.geoms), default=0.0)
            trunk.add_geom(
                name=PLATE,
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[HALF_SIZE, HALF_SIZE, 0.005],
                mass=0.0,
                pos=[0.0, 0.0, top],
                contype=0,
                conaffinity=0,
            )
        spec.add_pair(name="mass_on_trunk", geomname1=meets, geomname2=target)

    return edit


def _top(geom: mujoco.MjsGeom) -> float:
    """How high a shape reaches over its body's origin, its turn left out [m]; of a mesh its centre."""
    half = {
        mujoco.mjtGeom.mjGEOM_SPHERE: geom.size[0],
        mujoco.mjtGeom.mjGEOM_CAPSULE: geom.size[0],
        mujoco.mjtGeom.mjGEOM_BOX: geom.size[2],
        mujoco.mjtGeom.mjGEOM_CYLINDER: geom.size[0],
    }.get(geom.type, 0.0)
    return float(geom.pos[2] + half)


class FallingMass:
    """Holds, releases and stops the mass in every environment.

    The environments are built with :func:`add_mass`.
    """

    def __init__(self, env: WalkEnv, cfg: MassCfg) -> None:
        self.env, self.cfg = env, cfg
        model = env.sim.scene.model
        names = [model.joint(i).name for i in range(model.njnt)]
        self._joints = [named(names, name, "joint") for name in JOINTS]
        pad = [names.index(name) for name in names if name.endswith(PAD)]
        self._pad = torch.as_tensor(model.jnt_qposadr[pad]).long(), torch.as_tensor(model.jnt_dofadr[pad]).long()
        self._q = torch.as_tensor(model.jnt_qposadr[self._joints]).long()
        self._v = torch.as_tensor(model.jnt_dofadr[self._joints]).long()
        backend = env.sim.backend
        self._qpos, self._qvel = env.view(backend.field("qpos")), env.view(backend.field("qvel"))
        self._friction = env.view(backend.expand("dof_frictionloss"))
        self._range = wp.to_torch(backend.expand("jnt_range")).reshape(env.num_envs, model.njnt, 2)
        names = [model.geom(i).name for i in range(model.ngeom)]
        self._geom = next(i for i, name in enumerate(names) if name == PLATE or "/trunk_shape" in name)
        self._top = float(model.geom_size[self._geom][2] + model.geom_pos[self._geom][2])
        self.touched = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)
        self.released = False
        self.hold()

    def hold(self) -> None:
        """Park the mass: the guide's brake carries it."""
        self.released = False
        self.touched.zero_()
        self._friction[:, self._v] = 1e4
        self._qpos[:, self._q] = 0.0
        self._qvel[:, self._v] = 0.0
        self._qpos[:, self._pad[0]] = 0.0
        self._qvel[:, self._pad[1]] = 0.0
        self._range[:, self._joints[2], 0] = -PARKED
        self._range[:, self._joints[2], 1] = PARKED

    def release(self) -> None:
        """Put the mass over each robot's back, ``drop`` above it, moving along with the robot, and let it fall."""
        env = self.env
        height = env.root_pos[:, 2] + self._top + self.cfg.drop + HALF_SIZE
        self._qpos[:, self._q[:2]] = env.root_pos[:, :2].to(self._qpos.dtype)
        self._qpos[:, self._q[2]] = (height - PARKED).to(self._qpos.dtype)
        self._qvel[:, self._v] = 0.0
        self._qvel[:, self._v[:2]] = env.root_vel[:, :2].to(self._qvel.dtype)
        self._friction[:, self._v] = torch.tensor([0.0, 0.0, self.cfg.guide_friction], dtype=self._friction.dtype)
        self.released = True

    def update(self) -> None:
        """Call after every torque step: notice the contact and put the travel stop below it."""
        if not self.released:
            return
        env = self.env
        z = self._qpos[:, self._q[2]]
        bottom = z + PARKED - HALF_SIZE
        now = (bottom <= (env.root_pos[:, 2] + self._top).to(z.dtype)) & ~self.touched
        low = self._range[:, self._joints[2], 0]
        self._range[:, self._joints[2], 0] = torch.where(now, (z - self.cfg.travel).to(low.dtype), low)
        self.touched |= now

    @property
    def speed(self) -> torch.Tensor:
        """Downward speed of the mass [m/s], shape (E,)."""
        return -self._qvel[:, self._v[2]].float()
