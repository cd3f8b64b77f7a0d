"""An MR brake at a joint of a plain MuJoCo model: a dry-friction row of the solver whose bound follows the current."""

from __future__ import annotations

import mujoco
import numpy as np

from mrwarp.actuator import brake_constraint
from mrwarp.actuator.joint_batch import JointBatch
from mrwarp.model_file import Device


class Brake:
    """A device at a hinge. Call :meth:`step` before every ``mujoco.mj_step``.

    The device can do no positive work, and a held joint sticks: it creeps by 1e-5 rad/s per N·m.

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

    Args:
        model: The compiled model; its friction at this joint, the solver's line search (30 iterations at least) and
            the joint's armature, which gets the inertia of the device's rotor, are changed.
        data: Its data.
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
        self._own_friction = float(model.dof_frictionloss[v])
        armature = float(model.dof_armature[v]) + self._joint.inertia
        if armature < 0.0:
            raise ValueError(f"joint {joint!r}: the device's inertia leaves it an armature of {armature:.4g} kg·m²")
        model.dof_armature[v] = armature
        mujoco.mj_setConst(model, data)  # masses of the dofs follow from it
        model.dof_solref[v] = brake_constraint.solref(dt)
        model.dof_solimp[v] = brake_constraint.SOLIMP
        model.dof_invweight0[v] = brake_constraint.invweight(dt)
        model.opt.ls_iterations = max(model.opt.ls_iterations, brake_constraint.MIN_LS_ITERATIONS)

    def step(self, current: float) -> float:
        """Set the friction of the step that follows; returns the device's bound [N·m].

        Args:
            current: Commanded coil current [A]; a negative one acts by its size.

        Raises:
            ValueError: the current, or the joint's state, is no finite number; the friction stays what it was.
        """
        q, qd = self.data.qpos[self._q], self.data.qvel[self._v]
        for name, value in (("current", current), ("angle", q), ("velocity", qd)):
            if not np.isfinite(value):
                raise ValueError(f"{name} = {value} is no finite number; the simulation or its controller has diverged")
        self._joint.step(np.array([q]), np.array([qd]), np.array([current]))
        self.bound = float(self._joint.bound()[0])
        self.model.dof_frictionloss[self._v] = self._own_friction + self.bound
        return self.bound

    def reset(self) -> None:
        """No stress and no current, as after ``mujoco.mj_resetData``."""
        self._joint.reset()
