"""From a USD asset to the one MuJoCo model that both ways of stepping share.

Newton converts the USD stage (:mod:`mrwarp.usd.converted`); this file adds what the simulation needs on top: a
contact-force sensor per foot, the solver's options and, for the constraint coupling, the parameters of the brake
constraint.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from mrwarp.actuator import brake_constraint
from mrwarp.actuator.effect_runtime import added_inertia
from mrwarp.enums import Coupling
from mrwarp.env.config.sim_cfg import SolverCfg
from mrwarp.usd.asset import JointActuator, RobotAsset
from mrwarp.usd.converted import Field, converted
from mrwarp.usd.robot import Layout

Edit = Callable[[mujoco.MjSpec], None]
"""A change to the MuJoCo specification."""

FOOT_SENSOR = "{leg}_foot_force"
"""Name of the contact sensor of a leg: net force on its foot [N]."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """The simulated robot: the MuJoCo model and where the joints, feet and the floating base sit in it."""

    model: mujoco.MjModel
    actuators: tuple[JointActuator, ...]
    """Joint drives in the order of the joint axis; length J."""
    layout: Layout
    """Trunk, legs and neutral stance."""
    q_adr: np.ndarray
    """Address of each joint in qpos; shape (J,)."""
    v_adr: np.ndarray
    """Address of each joint in qvel; shape (J,)."""
    friction: np.ndarray
    """Dry friction of each joint without its device's [N·m]; shape (J,)."""
    damping: np.ndarray
    """Its damping without the drive's Kd [N·m·s/rad]; shape (J,)."""
    feet: np.ndarray
    """Shape of each foot, a sphere; shape (L,), empty without feet."""
    foot_adr: np.ndarray
    """Address of each foot's force in sensordata; shape (L,), empty without feet."""
    floating: bool
    """Whether qpos starts with a free joint."""
    stage: Any = None
    """USD stage of the asset: its meshes, which are drawn and do not collide, are not in the model."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names, length J."""
        return tuple(actuator.joint for actuator in self.actuators)

    @property
    def legs(self) -> tuple[int, ...]:
        """Leg of each joint, -1 for a joint of no leg; length J."""
        return tuple(self.layout.leg_of(joint) for joint in self.joints)

    @property
    def device_names(self) -> tuple[str, ...]:
        """Name of each device: its leg where that has one device, else its joint."""
        found = [(joint, leg) for joint, leg, a in zip(self.joints, self.legs, self.actuators, strict=True) if a.mr]
        legs = [leg for _, leg in found]
        return tuple(self.layout.leg_names[leg] if leg >= 0 and legs.count(leg) == 1 else joint for joint, leg in found)

    @property
    def watched(self) -> tuple[int, ...]:
        """Of each leg, the joint that trials follow, see :meth:`Layout.watched`; the calves of the shipped robot."""
        return self.layout.watched({actuator.joint for actuator in self.actuators if actuator.mr is not None})

    @cached_property
    def soles(self) -> np.ndarray:
        """Lowest point of each foot in the neutral stance, with the trunk at the origin [m]; shape (L, 3)."""
        data = mujoco.MjData(self.model)
        data.qpos[:] = self.model.qpos0
        data.qpos[:3] = 0.0
        data.qpos[self.q_adr] = self.layout.default_q
        mujoco.mj_kinematics(self.model, data)
        return data.geom_xpos[self.feet] - self.model.geom_size[self.feet, :1] * np.array([0.0, 0.0, 1.0])

    @cached_property
    def stand_height(self) -> float:
        """Trunk height in the neutral stance [m], to the millimetre: the lowest sole touches the ground.

        Raises:
            ValueError: it has no legs.
        """
        if not self.layout.legs:
            move = "'mrwarp play --agent sine' and 'mrwarp impact' move arms and legs on a rail"
            raise ValueError(f"{self.layout.trunk} has no legs to walk with; {move}")
        return round(-float(self.soles[:, 2].min()), 3)


def build_scene(
    asset: RobotAsset,
    *,
    dt: float,
    coupling: Coupling = Coupling.CONSTRAINT,
    solver: SolverCfg | None = None,
    ground: bool | Field = True,
    edit: Edit | None = None,
) -> Scene:
    """Convert an asset, its variants chosen, through Newton into a :class:`Scene`.

    Args:
        asset: The asset.
        dt: Physics step [s].
        coupling: With ``CONSTRAINT`` every MR joint gets :mod:`mrwarp.actuator.brake_constraint`.
        solver: Constraint solver options.
        ground: Add a ground plane at z = 0, or a height field.
        edit: Changes to the MuJoCo specification before it is compiled, e.g. a body that falls on the robot; bodies and
            joints it adds must come after the robot's.
    """
    if lost := [a.lost for a in asset.actuators if a.lost]:
        warnings.warn(f"simulated without effects: {lost[0]}", stacklevel=2)
    solver = solver or SolverCfg()
    model = _with_sensors(*converted(asset.stage, ground), asset.layout, edit)

    model.opt.timestep = dt
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.iterations = solver.iterations
    model.opt.ls_iterations = solver.ls_iterations
    model.opt.tolerance = solver.tolerance

    names = [model.joint(i).name for i in range(model.njnt)]
    ids = [named(names, actuator.joint, "joint") for actuator in asset.actuators]
    q_adr, v_adr = model.jnt_qposadr[ids], model.jnt_dofadr[ids]
    friction, damping = model.dof_frictionloss[v_adr].copy(), model.dof_damping[v_adr].copy()
    # a torque like Kd's: Euler steps stay exactly qd_next = qd + dt*qdd, as the brake constraint needs
    model.dof_damping[v_adr] = 0.0
    add_inertia(model, v_adr, asset.actuators)
    brakes = [a.mr is not None and coupling is Coupling.CONSTRAINT for a in asset.actuators]
    set_brake_constraint(model, list(v_adr[np.array(brakes) | (friction > 0.0)]), dt)
    feet = _feet(model, asset.layout)
    sensors = [model.sensor(FOOT_SENSOR.format(leg=leg.name)) for leg in asset.layout.legs] if len(feet) else []
    return Scene(
        model=model,
        actuators=asset.actuators,
        layout=asset.layout,
        q_adr=q_adr.astype(np.int32),
        v_adr=v_adr.astype(np.int32),
        friction=friction,
        damping=damping,
        feet=feet,
        foot_adr=np.array([sensor.adr[0] for sensor in sensors], dtype=np.int32),
        floating=bool(model.njnt and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE),
        stage=asset.stage,
    )


def _feet(model: mujoco.MjModel, layout: Layout) -> np.ndarray:
    """Shape of each leg's foot, shape (L,); empty for a bench, which has none.

    Raises:
        ValueError: some legs have no foot of their own.
    """
    names = [model.geom(i).name for i in range(model.ngeom)]
    feet = [i for leg in layout.legs for i, name in enumerate(names) if shape_name(name) == leg.foot]
    if feet and len(feet) != len(layout.legs):
        wanted = ", ".join(leg.foot for leg in layout.legs)
        raise ValueError(f"{len(feet)} shapes are called after a foot; needed: one for each of {wanted}")
    return np.array(feet, dtype=np.int32)


def add_inertia(model: mujoco.MjModel, dofs: np.ndarray, actuators: Sequence[JointActuator]) -> None:
    """Give each joint the inertia that its device's effects add, as armature: the solver takes it implicitly.

    Raises:
        ValueError: a joint's armature would be negative.
    """
    added = np.array([added_inertia(a.effects) if a.effects else 0.0 for a in actuators])
    for actuator, own, more in zip(actuators, model.dof_armature[dofs], added, strict=True):
        if own + more < 0.0:
            raise ValueError(
                f"{actuator.joint}: effect rotor_inertia.inertia = {more:g} kg·m² leaves a negative armature; "
                f"allowed: {-own:g} or more"
            )
    if np.any(added):
        model.dof_armature[dofs] += added
        mujoco.mj_setConst(model, mujoco.MjData(model))


def set_brake_constraint(model: mujoco.MjModel, dofs: list[int], dt: float) -> None:
    """Make the dry friction of ``dofs`` a brake, see :mod:`mrwarp.actuator.brake_constraint`."""
    model.dof_solref[dofs] = brake_constraint.solref(dt)
    model.dof_solimp[dofs] = brake_constraint.SOLIMP
    model.dof_invweight0[dofs] = brake_constraint.invweight(dt)


def shape_name(geom: str) -> str:
    """A shape's name, of its geom's: Newton names geoms by the USD path and a running number."""
    return re.sub(r"_\d+$", "", geom.rsplit("/", 1)[-1])


def named(names: list[str], short: str, kind: str) -> int:
    """Index of the one name that is ``short``, or its USD path's last part (Newton joins paths with underscores).

    Of ``/robot/joints/knee`` and ``/robot/joints/left_knee`` the shorter one is ``knee``.

    Raises:
        ValueError: none or several match.
    """
    found = [i for i, name in enumerate(names) if name == short or name.endswith(f"_{short}")]
    found = [i for i in found if len(names[i]) == min(len(names[k]) for k in found)]
    if len(found) != 1:
        raise ValueError(f"{kind} {short!r} stands {len(found)} times in the converted model, among: {names}")
    return found[0]


def _with_sensors(mjcf: str, original: mujoco.MjModel, layout: Layout, edit: Edit | None) -> mujoco.MjModel:
    """The converted model plus one net contact force sensor per foot sphere.

    The model goes through its MJCF text because a compiled model cannot take sensors; every number of the compiled
    original is then copied back, so that nothing is rounded.
    """
    spec = mujoco.MjSpec.from_string(mjcf)
    for leg in layout.legs:
        feet = [geom for geom in spec.geoms if shape_name(geom.name) == leg.foot]
        if feet:
            sensor = spec.add_sensor(name=FOOT_SENSOR.format(leg=leg.name), type=mujoco.mjtSensor.mjSENS_CONTACT)
            sensor.objtype = mujoco.mjtObj.mjOBJ_XBODY if leg.sole else mujoco.mjtObj.mjOBJ_GEOM
            sensor.objname = feet[0].parent.name if leg.sole else feet[0].name
            sensor.intprm = _contact_force_intprm()
    if edit is not None:
        edit(spec)
    model = spec.compile()
    # an edited model has other sizes; it keeps the numbers of the text
    for name in dir(original) if edit is None else ():
        value = getattr(original, name)
        if isinstance(value, np.ndarray) and not name.startswith(("_", "names", "sensor")):
            copy = getattr(model, name)
            if copy.shape == value.shape and value.flags.writeable:
                copy[...] = value
    return model


def _contact_force_intprm() -> np.ndarray:
    """Integer parameters of a contact sensor that reports the net force: data spec, reduction, slots."""
    reference = mujoco.MjSpec.from_string(
        "<mujoco><worldbody><geom name='g' type='sphere' size='1'/></worldbody>"
        "<sensor><contact geom1='g' data='force' reduce='netforce'/></sensor></mujoco>"
    )
    return reference.sensors[0].intprm
