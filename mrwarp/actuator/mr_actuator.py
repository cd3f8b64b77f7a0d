"""MrActuator: the torque stages of one 5 ms step, and the only owner of the actuator's state.

Stages, in the order of the paper: gate (eqs. 5, 8), coil, history (eq. 12), Bouc-Wen (eqs. 14, 15), learned residual
(eq. 16), torque (eqs. 2, 6, 9, 19). What the joint feels depends on the coupling:

* ``explicit``: the device's torque is computed from the state at the start of the step and applied (the paper's way).
* ``constraint``: the device is a dry friction whose bound is the yield torque (held) or the predicted torque
  (sliding, off); the solver finds the reaction. Passive in discrete time, and it stands still without creeping.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import warp as wp

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.effect_runtime import DeviceEffects, in_kernels
from mrwarp.effects.step_kernel import EffectArrays, effect_step_kernel, step_kernel
from mrwarp.enums import Coupling, HoldCurrent, ZStep
from mrwarp.kernels import ledger, mr_joint, mr_stages
from mrwarp.kernels.launch import Launch, in_one_thread, record
from mrwarp.kernels.learned_torque import FEATURES, WINDOW
from mrwarp.kernels.mr_joint import FIELDS, JointParams
from mrwarp.model_file import Effect
from mrwarp.params import MrParams
from mrwarp.runtime import DeviceWarning

if TYPE_CHECKING:
    from mrwarp.actuator.residual import LearnedTorque  # torch, which not every installation has


class DrivenJoint(Protocol):
    """Numbers of a joint that the actuator needs; ``mrwarp.usd.asset.JointActuator`` is one.

    Gains and limit are read from ``mr.motor`` where there is a device, else from the joint itself.
    """

    @property
    def joint(self) -> str:
        """Name."""
        ...

    @property
    def kp(self) -> float:
        """Proportional gain of the motor [N·m/rad]."""
        ...

    @property
    def kd(self) -> float:
        """Derivative gain [N·m·s/rad]."""
        ...

    @property
    def tau_limit(self) -> float:
        """Motor torque limit [N·m]."""
        ...

    @property
    def mr(self) -> MrParams | None:
        """The device, if there is one."""
        ...

    @property
    def effects(self) -> Sequence[Effect]:
        """Named effects of the device, see :mod:`mrwarp.actuator.effect_runtime`; empty without."""
        ...


@dataclass(frozen=True, kw_only=True)
class DeviceAlone:
    """A :class:`DrivenJoint` that is given by its device, outside an asset."""

    mr: MrParams
    effects: Sequence[Effect] = ()
    joint: str = "joint"
    kp: float = 0.0
    kd: float = 0.0
    tau_limit: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ActuatorInputs:
    """Arrays that the stages read at every step; the simulator keeps writing them in place."""

    q_des: wp.array
    """Joint targets [rad], shape (E, J)."""
    q: wp.array
    """Joint positions [rad], shape (E, J)."""
    qd: wp.array
    """Joint velocities [rad/s], shape (E, J)."""
    f_foot: wp.array
    """Norm of the contact force per leg [N], shape (E, L)."""
    current_e: wp.array
    """Current I_e each environment may use [A], shape (E,)."""
    friction: wp.array
    """Torque of the brake constraint during the last physics step [N·m], shape (E, J); unused when explicit."""
    command: wp.array | None = None
    """Current commanded of each device [A], shape (E, M), which its coil gets while a gate is open, or with the gates
    closed where it is negative; None leaves the current to the gates."""


FASTEST = 30.0
"""Speed that joints of legged robots reach [rad/s]: Go1's hips turn at up to 30.1 rad/s (its public description)."""


def warn_of_overshoot(rate: float, dt: float) -> None:
    """Say so where Euler's step overshoots at a speed that joints reach; Python shows the same text once.

    Args:
        rate: Largest :attr:`mrwarp.params.BoucWenParams.euler_rate` of the devices [1/rad].
        dt: Step [s].
    """
    if rate * FASTEST * dt > 1.0:
        text = (
            f"the Euler step of eq. 15 overshoots above {1.0 / (rate * dt):.3g} rad/s: there the devices bear more "
            "than their sliding torque; the exact step does not (z_step, --z-step exact)"
        )
        warnings.warn(text, DeviceWarning, stacklevel=3)


class MrActuator:
    """Motor and MR device of every joint, batched over environments.

    Args:
        joints: The joints in the simulator's order; those with ``mr`` parameters carry a device. Length J.
        legs: Column of ``inputs.f_foot`` of each joint, whose load opens the gates; length J. -1: no foot is below the
            joint, so its device has no gates: the coil gets ``inputs.current_e``, and a brake holds where it is slow or
            turns round.
        inputs: Arrays read at each step.
        dt: Torque step [s].
        cfg: Choices of the model.
        residual: Learned torque that is added to the Bouc-Wen prediction, or None.
        share_params: Keep one row of parameters for all environments; False gives each its own row (randomisation).

    Attributes:
        coil: Current of the coil at the step's end [A], shape (E, M).
        current: Current that the laws take [A], shape (E, M): the mean over the step, after the effects.
        euler_rate: Largest rate of eq. 15 [1/rad], see :func:`warn_of_overshoot`.
        effects: Values and states of the devices' effects; None if no device has one that acts in the kernels. Then
            the kernels are those of the plain laws.
    """

    def __init__(
        self,
        joints: Sequence[DrivenJoint],
        legs: Sequence[int],
        inputs: ActuatorInputs,
        *,
        dt: float,
        cfg: MrActuatorCfg | None = None,
        residual: LearnedTorque | None = None,
        share_params: bool = True,
    ) -> None:
        self.inputs, self.device = inputs, inputs.q.device
        num_envs, num_joints = inputs.q.shape
        if not all(x.is_contiguous for x in (inputs.q_des, inputs.q, inputs.qd, inputs.f_foot)):
            raise ValueError("the actuator's inputs are views with gaps; give contiguous arrays")
        if len(joints) != num_joints or len(legs) != num_joints:
            raise ValueError(f"{len(joints)} joints and {len(legs)} legs given for arrays of {num_joints} joints")
        self.num_envs = num_envs
        self.mr_joints = tuple(i for i, joint in enumerate(joints) if joint.mr is not None)
        num_mr = len(self.mr_joints)

        slot_of = np.full(num_joints, -1, dtype=np.int32)
        slot_of[list(self.mr_joints)] = np.arange(num_mr)
        self.slot_of = self._array(slot_of, int)
        self.joint_of = self._array(np.array(self.mr_joints, dtype=np.int32), int)
        self.leg_of = self._array(np.array([legs[i] for i in self.mr_joints], dtype=np.int32), int)
        self._without_foot = any(legs[i] < 0 for i in self.mr_joints)

        rows = 1 if share_params else num_envs
        self.kp = self._array(np.tile([j.kp for j in joints], (rows, 1)), float)
        self.kd = self._array(np.tile([j.kd for j in joints], (rows, 1)), float)
        self.tau_limit = self._array(np.tile([j.tau_limit for j in joints], (rows, 1)), float)
        devices = [mr for joint in joints if (mr := joint.mr) is not None]
        self.params = self._param_array(devices, rows)
        self.euler_rate = max((mr.bouc_wen.euler_rate for mr in devices), default=0.0)
        self.effects = None
        effects = [joints[i].effects for i in self.mr_joints]
        if any(in_kernels(found) for found in effects):
            self.effects = DeviceEffects(effects, num_envs=num_envs, dt=dt, device=self.device, rows=rows)

        self._saved: dict[str, wp.array] = {}

        def zeros(*shape: int, dtype: type = float) -> wp.array:
            return wp.zeros(shape, dtype=dtype, device=self.device)

        def saved(name: str, *shape: int, dtype: type = float) -> wp.array:
            self._saved[name] = zeros(*shape, dtype=dtype)
            return self._saved[name]

        self.z, self.coil = saved("z", num_envs, num_mr), saved("coil", num_envs, num_mr)
        self.ring = saved("ring", num_envs, num_mr, WINDOW, FEATURES)
        self.head = saved("head", 1, dtype=int)
        self.ledger = saved("ledger", num_envs, num_joints, len(ledger.ENTRIES))
        # outputs of the last step
        self.current = saved("current", num_envs, num_mr)
        self.m_dyn, self.m_hold = saved("m_dyn", num_envs, num_mr), saved("m_hold", num_envs, num_mr)
        self.tau_dyn, self.tau_mr = saved("tau_dyn", num_envs, num_mr), saved("tau_mr", num_envs, num_mr)
        self.tau_motor, self.tau, self.bound = (zeros(num_envs, num_joints) for _ in range(3))
        self.configure(dt=dt, cfg=cfg or MrActuatorCfg(), residual=residual)

    def configure(self, *, dt: float, cfg: MrActuatorCfg, residual: LearnedTorque | None) -> None:
        """Take another step [s], other choices or another learned torque; the state stays."""
        if residual is not None:
            residual.bind(self.ring, self.head, self.m_dyn, self.tau_dyn)
        self.dt, self.cfg, self.residual = dt, cfg, residual
        if cfg.z_step is ZStep.EULER:
            warn_of_overshoot(self.euler_rate, dt)
        trained = residual.trained_step if residual is not None else None
        if trained not in (None, cfg.z_step.value):
            text = f"the pg_rlstm network was trained on top of the {trained} step of eq. 15"
            remedy = f"give that (--z-step {trained}), or train it again"
            warnings.warn(f"{text} and runs on the {cfg.z_step.value} one: {remedy}", DeviceWarning, stacklevel=2)
        self._record_launches()

    def step(self) -> None:
        """Run the stages: writes ``tau`` to apply [N·m] and the brake ``bound`` [N·m], both of shape (E, J)."""
        self.predict()
        self.add_residual()
        self.torque()

    def predict(self) -> None:
        """Gates (eqs. 5, 8), coil, history (eq. 12), laws (eqs. 14, 15); and the torques that follow."""
        for launch in self._predict:
            launch()

    def add_residual(self) -> None:
        """Learned residual (eq. 16) of the open dynamic gates; nothing without."""
        if self.residual is not None and self.mr_joints:
            self.residual(self.ring, self.head, self.m_dyn, self.tau_dyn)

    def torque(self) -> None:
        """Torques of motor (eqs. 2, 9) and device (eqs. 6, 19), or the brake's bound, again where the residual acts."""
        for launch in self._torque:
            launch()

    def account(self) -> None:
        """Add the physics step that followed :meth:`step` to the energy ledger, from ``inputs.qd`` and ``friction``."""
        self._ledger()

    def reset(self, mask: wp.array | None = None) -> None:
        """Forget the past of masked environments: z = 0, no current, a history at rest, an empty ledger.

        Args:
            mask: Environments to reset, bool, shape (E,); None resets all. Others stay bit-equal.
        """
        if mask is None:
            mask = wp.full(self.num_envs, True, dtype=wp.bool, device=self.device)
        wp.launch(
            mr_stages.reset_kernel,
            dim=self._lanes,
            inputs=[*self._lanes, self.params, self.slot_of, mask, self.inputs.q],
            outputs=[
                *(self.z, self.coil, self.current, self.m_dyn, self.m_hold, self.tau_dyn, self.tau_mr),
                *(self.ring, self.ledger),
            ],
            device=self.device,
        )
        if self.effects is not None:
            self.effects.reset(mask)
        if self.residual is not None:
            self.residual.reset(mask)

    @property
    def device_params(self) -> wp.array:
        """The devices' parameters as the effects leave them in a step, shape (E or 1, M)."""
        return self.params if self.effects is None else self.effects.params

    def begin_session(self) -> None:
        """Set the time in the session, with which devices wear, to 0."""
        if self.effects is not None:
            self.effects.clock.zero_()

    def param(self, name: str) -> wp.array:
        """Live float view of one MR parameter, shape (E or 1, M); writing to it changes the device.

        Raises:
            KeyError: there is no such parameter.
        """
        if name not in FIELDS:
            raise KeyError(f"no MR parameter {name!r}; known: {', '.join(FIELDS)}")
        rows, num_mr = self.params.shape
        size = 4 * len(FIELDS)
        ptr, shape, strides = self.params.ptr, (rows, num_mr), (num_mr * size, size)
        first = ptr + 4 * FIELDS.index(name) if ptr else None
        return wp.array(ptr=first, dtype=float, shape=shape, strides=strides, device=self.device, copy=False)

    def set_param(self, name: str, values: Any) -> None:
        """Write one MR parameter [unit as in ``mrwarp.params``], broadcast to shape (E or 1, M), unchecked."""
        view = self.param(name)
        wp.copy(view, self._array(np.broadcast_to(np.asarray(values, dtype=np.float32), view.shape), float))

    def state(self) -> dict[str, np.ndarray]:
        """Copy of everything a resumed run needs, by name."""
        arrays = {name: array.numpy().copy() for name, array in self._saved.items()}
        # the number of fields by name: a robot without devices has an empty array, whose -1 numpy cannot infer
        shape = (*self.params.shape, len(FIELDS))
        arrays |= self.effects.state() if self.effects is not None else {}
        arrays |= self.residual.state() if self.residual is not None else {}
        return {**arrays, "params": self.params.numpy().view(np.float32).reshape(shape).copy()}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore :meth:`state`, bit-equal."""
        for name, array in self._saved.items():
            array.assign(state[name])
        if self.effects is not None:
            self.effects.load_state(state)
        if self.residual is not None:
            self.residual.load_state(state)
        self.params.assign(np.ascontiguousarray(state["params"]).view(_RECORD).reshape(self.params.shape))

    def _record_launches(self) -> None:
        """Prepare the launches of :meth:`step` and :meth:`account`."""
        cfg, i = self.cfg, self.inputs
        rows, lanes = (1, 1) if in_one_thread(self.device) else self.inputs.q.shape
        self._lanes, one_thread = (rows, lanes), rows * lanes == 1  # see step_kernel
        constraint = int(cfg.coupling is Coupling.CONSTRAINT)
        fixed = int(cfg.hold_current is HoldCurrent.FIXED or i.command is not None)
        exact = int(cfg.z_step is ZStep.EXACT)
        damping = int(cfg.sal and cfg.damping) if cfg.gated else mr_joint.UNGATED
        switches = [self.dt, damping, int(cfg.sal and cfg.holding), fixed, exact]
        read = [i.q_des, i.q, i.qd, i.f_foot, i.current_e, i.command, self.head]
        outputs = [self.m_dyn, self.m_hold, self.z, self.coil, self.current, self.tau_dyn, self.ring, self.head]
        torques = [self.tau_motor, self.tau_mr, self.tau, self.bound]
        motors = [self.kp, self.kd, self.tau_limit]
        kernel, arrays, counters = step_kernel, EffectArrays(), [(WINDOW, self.head)]
        if self.effects is not None:
            kernel, arrays = effect_step_kernel, self.effects.arrays
            counters.append((2**31 - 1, self.effects.clock))
        switches += [constraint, cfg.latch]
        inputs = [rows, lanes, self.params, self.slot_of, self.leg_of, *motors, *switches, *read]
        step = record(kernel, (rows, lanes), [*inputs, self.z, self.coil], [arrays, *outputs, *torques])
        self._predict: list[Launch] = [step]
        if not one_thread:
            advance = [record(mr_stages.advance_head_kernel, 1, [length, at], [at]) for length, at in counters]
            self._predict = [*advance, step]
        self._torque: list[Launch] = []
        if self.residual is not None and self.mr_joints:
            lanes_mr = min(lanes, len(self.mr_joints))
            read = [i.q_des, i.q, i.qd, self.m_dyn, self.m_hold, self.current, self.tau_dyn, self.tau_motor]
            inputs = [rows, lanes_mr, self.device_params, self.joint_of, constraint, *read]
            learned = record(mr_stages.learned_torque_kernel, (rows, lanes_mr), inputs, [self.tau_mr, *torques[2:]])
            self._torque.append(learned)
            if constraint and (not cfg.gated or self._without_foot):
                read = [i.qd, self.current, self.tau_dyn, self.ring, self.head]
                inputs = [self.device_params, self.joint_of, self.leg_of, int(cfg.gated), *read]
                every = (self.num_envs, len(self.mr_joints))
                self._torque.append(record(mr_stages.learned_hold_kernel, every, inputs, [self.bound]))
        self._ledger = record(
            ledger.ledger_kernel,
            (self.num_envs, lanes),
            [
                *(lanes, self.slot_of, self.dt, constraint, i.qd, self.tau_motor, i.friction, self.tau_mr),
                *(self.m_dyn, self.m_hold, self.current, self.param("coil_resistance")),
            ],
            [self.tau_mr, self.ledger],
        )

    def _array(self, values: np.ndarray, dtype: type) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)

    def _param_array(self, params: Sequence[MrParams], rows: int) -> wp.array:
        values = np.zeros((rows, len(params)), dtype=_RECORD)
        for slot, mr in enumerate(params):
            for name, value in mr:
                values[name][:, slot] = value
        return wp.array(values, dtype=JointParams, device=self.device)


_RECORD: np.dtype = np.dtype(JointParams.numpy_dtype())  # pyright: ignore[reportCallIssue,reportArgumentType]
"""The parameter struct as a NumPy record."""

PROPERTIES = ("params", "effects_values")
"""Arrays of :meth:`MrActuator.state` that are properties of the robots, not of what happened to them."""
