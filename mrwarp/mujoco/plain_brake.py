"""An MR brake at a joint of a plain MuJoCo model: a dry-friction row of the solver whose bound follows the current."""

from __future__ import annotations

import copy
from weakref import WeakKeyDictionary

import mujoco
import numpy as np

from mrwarp.actuator import brake_constraint
from mrwarp.actuator.joint_batch import JointBatch
from mrwarp.model_file import Device

_OWN: WeakKeyDictionary[mujoco.MjModel, dict[int, tuple[float, float]]] = WeakKeyDictionary()
"""Friction [N·m] and armature [kg·m²] that braked dofs of a model have without their devices."""

_OF_INERTIA = ("dof_M0", "dof_invweight0", "body_invweight0", "tendon_invweight0", "actuator_acc0")
"""Numbers of a model that MuJoCo derives from its joints' inertia."""


class Brake:
    """A device at a hinge. Call :meth:`step` before every ``mujoco.mj_step``, for each brake of the model.

    The device can do no positive work, and a held joint sticks: it creeps by 1e-5 rad/s per N·m. A second brake at a
    joint takes the place of the first.

    Example:
        >>> import mujoco, mrwarp.mujoco
        >>> model = mujoco.MjModel.from_xml_string(
        ...     '<mujoco><option timestep="0.002"/><worldbody><body><joint name="knee" axis="0 1 0"/>'
        ...     '<geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="1"/></body></worldbody></mujoco>'
        ... )
        >>> data = mujoco.MjData(model)
        >>> brake = mrwarp.mujoco.Brake(model, data, "knee")  # or a model.json as the fourth argument
        >>> for _ in range(500):
        ...     brake.step(current=1.0)
        ...     mujoco.mj_step(model, data)
        >>> bool(abs(data.qpos[0]) < 1e-3)  # 1.5 N·m of gravity, held for a second
        True
        >>> round(brake.torque, 2)  # what it held with
        -1.47

    Args:
        model: The compiled model; its friction at this joint, the solver's line search (30 iterations at least) and
            the joint's armature, which gets the inertia of the device's rotor, are changed. What MuJoCo derived from
            that armature follows it, unless somebody has set it since.
        data: Its data, which are only read.
        joint: Name or number of a hinge.
        device: A model.json or a name of the library, a model, what :func:`mrwarp.fit` returned, or parameters; None is
            the paper's device.

    Attributes:
        bound: Dry friction that the device may use in this step [N·m].

    Raises:
        ValueError: there is no such joint, it is no hinge, or the rotor's inertia leaves no positive armature.
        ModelFileError: the model file cannot be used.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        joint: str | int,
        device: Device = None,
    ) -> None:
        number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint) if isinstance(joint, str) else joint
        if not 0 <= number < model.njnt:
            names = [model.joint(k).name for k in range(model.njnt)]
            raise ValueError(f"joint {joint!r}: the model has none such; choose from {', '.join(map(repr, names))}")
        if model.jnt_type[number] != mujoco.mjtJoint.mjJNT_HINGE:
            raise ValueError(f"joint {joint!r} is no hinge; a device turns")
        self.model, self.data, self.bound = model, data, 0.0
        self._q, self._v = int(model.jnt_qposadr[number]), int(model.jnt_dofadr[number])
        dt, v = model.opt.timestep, self._v
        self._joint = JointBatch(device, dt=dt)
        own = (float(model.dof_frictionloss[v]), float(model.dof_armature[v]))
        self._own_friction, own_armature = _OWN.setdefault(model, {}).setdefault(v, own)
        armature = own_armature + self._joint.inertia
        if armature < 0.0:
            raise ValueError(f"joint {joint!r}: the device's inertia leaves it an armature of {armature:.4g} kg·m²")
        _set_armature(model, v, armature)
        model.opt.ls_iterations = max(model.opt.ls_iterations, brake_constraint.MIN_LS_ITERATIONS)
        self._prepare()

    def _prepare(self) -> None:
        """Make the joint's dry friction a brake (:mod:`brake_constraint`).

        Repeated in every step: MuJoCo derives the row's regularisation again whenever somebody recomputes constants.
        """
        model, v, dt = self.model, self._v, self._joint.dt
        model.dof_solref[v] = brake_constraint.solref(dt)
        model.dof_solimp[v] = brake_constraint.SOLIMP
        model.dof_invweight0[v] = brake_constraint.invweight(dt)

    @property
    def torque(self) -> float:
        """Torque that the solver gave the joint through the device in the last step [N·m], against its motion.

        Of a joint with a dry friction of its own it is the device's share of both, by their bounds; 0 before a step.
        """
        rows = (self.data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF) & (self.data.efc_id == self._v)
        both = self._own_friction + self.bound
        return float(self.data.efc_force[rows].sum()) * self.bound / both if both > 0.0 else 0.0

    def step(self, current: float) -> float:
        """Set the friction of the step that follows; returns the device's bound [N·m].

        Args:
            current: Commanded coil current [A]; a negative one acts by its size.

        Raises:
            TypeError: the current is no number.
            ValueError: the current, or the joint's state, is no finite number, and the friction stays what it was; or
                the model's time step is no longer the one that the brake was made for.
        """
        if np.ndim(current) or np.asarray(current).dtype.kind not in "fiu":
            raise TypeError(f"current = {current!r}: give one number [A]")
        if self.model.opt.timestep != self._joint.dt:
            given, made = self.model.opt.timestep, self._joint.dt
            raise ValueError(f"the model's timestep is {given:g} s, the brake was made for {made:g} s; make it again")
        q, qd = self.data.qpos[self._q], self.data.qvel[self._v]
        for name, value in (("current", current), ("angle", q), ("velocity", qd)):
            if not np.isfinite(value):
                raise ValueError(f"{name} = {value} is no finite number; the simulation or its controller has diverged")
        self._prepare()
        self._joint.step(np.array([q]), np.array([qd]), np.array([current]))
        self.bound = float(self._joint.bound()[0])
        self.model.dof_frictionloss[self._v] = self._own_friction + self.bound
        return self.bound

    def reset(self) -> None:
        """No stress and no current; call it with ``mujoco.mj_resetData``."""
        self._joint.reset()
        self.bound = 0.0
        self.model.dof_frictionloss[self._v] = self._own_friction


def _set_armature(model: mujoco.MjModel, dof: int, armature: float) -> None:
    """Change a joint's armature [kg·m²], and what MuJoCo derives from it, where nobody has set that to another number.

    So the brakes that are there keep their rows, and the data their pose.
    """
    if armature == model.dof_armature[dof]:
        return
    derived = []
    for value in (model.dof_armature[dof], armature):
        changed = copy.copy(model)
        changed.dof_armature[dof] = value
        mujoco.mj_setConst(changed, mujoco.MjData(changed))
        derived.append(changed)
    for name in _OF_INERTIA:
        before, after, here = (getattr(of, name) for of in (*derived, model))
        here[...] = np.where(np.isclose(here, before, rtol=1e-9, atol=0.0), after, here)
    model.dof_armature[dof] = armature
    model.stat.meaninertia = derived[1].stat.meaninertia
