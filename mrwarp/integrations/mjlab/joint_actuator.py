"""The MR joint as an actuator of mjlab: motor and device on a group of joints, with the simulator's own laws.

Use it as any actuator of mjlab, in ``EntityArticulationInfoCfg(actuators=(MrJointActuatorCfg(...),))``, and with the
constraint coupling give the task the event :func:`brakes`. Then, for every environment and joint,
``entity.actuators[k].current[:] = 1.0`` [A], at any time. See ``docs/integrations.md``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

# pyright: reportMissingImports=false
import torch
import warp as wp
from mjlab.actuator import Actuator, ActuatorCfg, ActuatorCmd
from mjlab.managers.event_manager import requires_model_fields
from mjlab.utils.spec import create_motor_actuator

from mrwarp.actuator import brake_constraint
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.effect_runtime import added_inertia
from mrwarp.actuator.mr_actuator import ActuatorInputs, DeviceAlone, MrActuator
from mrwarp.enums import Coupling, ZStep
from mrwarp.kernels.mr_stages import drive_torque_kernel
from mrwarp.model_file import load_model
from mrwarp.params import MrParams


@dataclass(kw_only=True)
class MrJointActuatorCfg(ActuatorCfg):
    """A motor with an MR device in parallel, the same on all targets.

    ``armature`` replaces the joint's own; the rotor inertia of a device's effects comes on top.
    """

    stiffness: float
    """Kp of the motor [N·m/rad]."""
    damping: float
    """Kd of the motor [N·m·s/rad]."""
    effort_limit: float
    """Torque limit of the motor [N·m]; the device's torque comes on top."""
    model: str | Path | None = None
    """Device: model.json of ``mrwarp fit`` or ``diagnose``; None: the paper's."""
    parameters: dict[str, float] = field(default_factory=dict)
    """Parameters of :class:`mrwarp.params.MrParams` that differ, e.g. ``{"K1": 2.0}``; ``q_neutral`` [rad] where the
    device's zero is not the joint's."""
    current: float = 0.0
    """Coil current to begin with [A]."""
    gated: bool = False
    """Whether gates switch the current (eqs. 5, 8); they need ``foot_load``. Else the coil gets ``current``."""
    coupling: Coupling = Coupling.CONSTRAINT
    """``constraint``: the device is a dry friction of the solver, which sticks; ``explicit``: it is a torque."""
    z_step: ZStep = ZStep.EXACT
    """Step of the hysteresis state."""
    extrapolate: bool = False
    """Let the coil take more current than the recordings of ``model`` held."""

    def device(self) -> DeviceAlone:
        """Numbers and effects of the device.

        Raises:
            ModelFileError: the model file cannot be used.
            ParameterError: a parameter is unknown or out of range.
        """
        model = load_model(self.model) if self.model is not None else None
        mr = model.to_params(extrapolate=self.extrapolate) if model is not None else MrParams()
        motor = {
            "kp_base": self.stiffness,
            "kp_low": min(mr.motor.kp_low, self.stiffness),
            "kd": self.damping,
            "tau_limit": self.effort_limit,
        }
        values = {**mr.alone().to_dict(), **motor, **self.parameters}
        return DeviceAlone(
            mr=MrParams.from_dict(values, type(self).__name__), effects=model.effects if model is not None else ()
        )

    def build(self, entity: Any, target_ids: list[int], target_names: list[str]) -> MrJointActuator:
        """The actuator of a group of joints."""
        return MrJointActuator(self, entity, target_ids, target_names)


class MrJointActuator(Actuator[MrJointActuatorCfg]):
    """Motor and MR device, batched over environments and joints.

    Attributes:
        current: Coil current that may be used [A], shape (num_envs, num_targets); yours to write.
        foot_load: Norm of the contact force at the foot [N], shape (num_envs, num_targets); yours to write where gated.
        brake_bound: Dry friction that the device may use [N·m], shape (num_envs, num_targets); 0 when explicit.
    """

    def edit_spec(self, spec: Any, target_names: list[str]) -> None:
        """A motor per joint, whose control is the torque.

        Raises:
            ValueError: the device's effects leave a joint a negative armature.
        """
        device = self.cfg.device()
        # an explicit device acts through the control, so nothing may clip it
        limit = self.cfg.effort_limit if self.cfg.coupling is Coupling.CONSTRAINT else 1e6
        for name in target_names:
            motor = create_motor_actuator(
                spec,
                name,
                effort_limit=limit,
                armature=self.cfg.armature,
                frictionloss=self.cfg.frictionloss,
                viscous_damping=self.cfg.viscous_damping,
                transmission_type=self.cfg.transmission_type,
            )
            joint = spec.joint(name)
            joint.armature += added_inertia(device.effects)
            if joint.armature < 0.0:
                raise ValueError(f"joint {name}: the device's rotor_inertia leaves an armature of {joint.armature:g}")
            self._mjs_actuators.append(motor)

    def initialize(self, mj_model: Any, model: Any, data: Any, device: str) -> None:
        """Make the state."""
        super().initialize(mj_model, model, data, device)
        shape = (data.nworld, len(self.target_names))
        count, dt = shape[0] * shape[1], float(mj_model.opt.timestep)
        columns = {
            name: wp.zeros((count, 1), dtype=float, device=device)
            for name in ("q_des", "q", "qd", "f_foot", "friction")
        }
        self._inputs = ActuatorInputs(current_e=wp.zeros(count, dtype=float, device=device), **columns)
        cfg = MrActuatorCfg(coupling=self.cfg.coupling, z_step=self.cfg.z_step, gated=self.cfg.gated)
        self._joints = MrActuator([self.cfg.device()], [0], self._inputs, dt=dt, cfg=cfg, share_params=False)
        bound, tau, qd_des, effort = (wp.zeros(count, dtype=float, device=device) for _ in range(4))
        self._torque_arrays = qd_des, effort, bound, tau
        self._addresses = wp.array(list(range(count)), dtype=wp.uint32, device=device)

        def view(array: wp.array) -> torch.Tensor:
            return wp.to_torch(array).view(shape)

        self._written = tuple(view(a) for a in (*(columns[n] for n in ("q_des", "q", "qd")), qd_des, effort))
        self.current, self.foot_load = view(self._inputs.current_e), view(columns["f_foot"])
        self.brake_bound, self._tau = view(bound), view(tau)
        self.current.fill_(self.cfg.current)
        self._own_friction: torch.Tensor | None = None
        if self.cfg.coupling is Coupling.CONSTRAINT:
            names = [motor.target for motor in self._mjs_actuators]
            self._dofs = torch.tensor([int(mj_model.joint(name).dofadr[0]) for name in names], device=device)
            # mjlab hands over a bridge; the arrays behind it are replaced when they are expanded
            self._warp_model, self._dt = getattr(model, "_struct", model), dt
            option = self._warp_model.opt
            option.ls_iterations = max(option.ls_iterations, brake_constraint.MIN_LS_ITERATIONS)

    def _field(self, name: str) -> torch.Tensor:
        """An array of the solver's model, one row per environment."""
        return wp.to_torch(getattr(self._warp_model, name))

    def prepare_brake(self) -> None:
        """Make the joints' dry friction passive in discrete time (:mod:`brake_constraint`) and its bound writable.

        Called by :func:`brakes`; without an event manager, after
        ``sim.expand_model_fields(brakes.model_fields)``. Nothing with an explicit device.

        Raises:
            RuntimeError: the environments share the friction of their joints.
        """
        if self.cfg.coupling is not Coupling.CONSTRAINT:
            return
        friction = self._field("dof_frictionloss")
        if friction.shape[0] != self.current.shape[0]:
            raise RuntimeError(f"{friction.shape[0]} row of joint friction for {self.current.shape[0]} environments")
        self._own_friction = friction[:, self._dofs].clone()
        for name, value in (
            ("dof_solref", brake_constraint.solref(self._dt)),
            ("dof_solimp", brake_constraint.SOLIMP),
        ):
            self._field(name)[:, self._dofs] = torch.tensor(value, dtype=torch.float, device=self.current.device)

    def _apply_bound(self) -> None:
        """The friction of the next step, and its regularisation.

        mjlab derives that again from the inertia after each event that changes a mass.
        """
        if self._own_friction is None:
            raise RuntimeError(
                f"{type(self).__name__}: the brakes of {', '.join(self.target_names)} need a startup event of the task:"
                " cfg.events['mr_brakes'] = EventTermCfg(func=mrwarp.integrations.mjlab.brakes, mode='startup')"
            )
        self._field("dof_frictionloss")[:, self._dofs] = self._own_friction + self.brake_bound
        self._field("dof_invweight0")[:, self._dofs] = brake_constraint.invweight(self._dt)

    def compute(self, cmd: ActuatorCmd) -> torch.Tensor:
        """Torque of the motor [N·m], and of an explicit device, shape (num_envs, num_targets)."""
        commands = (cmd.position_target, cmd.pos, cmd.vel, cmd.velocity_target, cmd.effort_target)
        for array, values in zip(self._written, commands, strict=True):
            array.copy_(values)
        joints, x = self._joints, self._inputs
        joints.predict()
        qd_des, effort, bound, tau = self._torque_arrays
        wp.launch(
            drive_torque_kernel,
            dim=len(tau),
            inputs=[
                *(joints.device_params, self._addresses, int(joints.cfg.gated)),
                *(int(self.cfg.coupling is Coupling.CONSTRAINT), x.q, x.qd, x.q_des, qd_des, effort),
                *(joints.current, joints.m_hold, joints.tau_dyn, joints.ring, joints.head),
            ],
            outputs=[bound, tau],
            device=tau.device,
        )
        if self.cfg.coupling is Coupling.CONSTRAINT:
            self._apply_bound()
        return self._tau

    def reset(self, env_ids: torch.Tensor | slice | None = None) -> None:
        """No stress and no current in some environments; None: in all."""
        super().reset(env_ids)
        mask = torch.zeros(self.current.shape, dtype=torch.bool, device=self.current.device)
        mask[slice(None) if env_ids is None else env_ids] = True
        self._joints.reset(wp.from_torch(mask.flatten()))


def mr_actuators(env: Any) -> list[MrJointActuator]:
    """All MR joints of an environment's scene."""
    return [
        actuator
        for entity in env.scene.entities.values()
        for actuator in entity.actuators
        if isinstance(actuator, MrJointActuator)
    ]


@requires_model_fields("dof_frictionloss", "dof_solref", "dof_solimp", "dof_invweight0")
def brakes(env: Any, env_ids: torch.Tensor | None) -> None:
    """Startup event of a task with MR joints: mjlab gives each environment a joint friction of its own for it.

    All environments are prepared, regardless of ``env_ids``.
    """
    for actuator in mr_actuators(env):
        actuator.prepare_brake()
