"""The MR joint as a drive of ``newton.actuators``: any Newton scene can use one, with the coil current as an input.

In USD a ``NewtonActuator`` prim applies ``MrwarpMRDriveAPI`` and authors ``newton:mr:<name>`` for every parameter; in
Python it is ``builder.add_actuator(DriveMR, index=dof, K1=12.5)``. The laws are those of ``mrwarp.kernels``: motor PD
with the effective gain (eqs. 2, 9), gates (5, 8), coil, hysteresis (14, 15), device torque (6, 19). Per step::

    control.mr_current       # coil current the device may use [A], shape (joint_dof_count,); yours to write
    control.mr_foot_load     # norm of the contact force at the foot [N], shape (joint_dof_count,); yours to write
    control.joint_f.zero_()
    actuator.step(state, control, now, after, dt=dt)
    apply_brake_bounds(solver, actuator, dt)   # constraint coupling only
    solver.step(...)

With ``control.mr_foot_load = None`` there are no gates: a plain current-driven device whose coil command is
``mr_current``, with the motor at ``kp_base``. (Newton allocates both arrays with zeros: no current, gates closed.)

Couplings: ``explicit`` (the default here) adds the device's torque to the motor's. ``constraint`` gives the motor's
torque only and writes ``brake_bound``, which :func:`apply_brake_bounds` hands to a ``SolverMuJoCo`` as dry friction:
passive in discrete time, and it truly sticks.

A learned torque (``mrwarp learn``) runs in it after ``actuator.drive.use_learned(model, dt=...)``, with states made
afterwards.

This is the only file that touches Newton's actuator API, which is marked experimental. After an upgrade of Newton
check: the signature of ``DriveBase.compute`` and the name of the base class (``Controller`` until 1.8), that the USD
parser still hands attributes over as lower-case ``mr:<name>`` and takes a callable, that ``Control`` still gets the
``custom_inputs``, and ``SolverMuJoCo.mjc_dof_to_newton_dof``. ``tests/actuator/test_newton_drive.py`` covers each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import newton
import numpy as np
import warp as wp
from newton.actuators import Actuator, ComponentKind, DriveBase, register_actuator_component
from newton.actuators import DriveNeuralLSTM as DriveNeuralLSTM  # timed beside ours by benchmarks/perf/newton_lstm.py

import mrwarp.usd.open_stage  # registers the USD schema; must come before the first stage is opened
from mrwarp.actuator import brake_constraint
from mrwarp.actuator.mr_actuator import Coupling, HoldCurrent, ZStep
from mrwarp.actuator.residual import LearnedTorque, with_bouc_wen
from mrwarp.kernels.drive_mr import brake_bounds_kernel, drive_predict_kernel, drive_reset_kernel, drive_torque_kernel
from mrwarp.kernels.learned_torque import FEATURES, WINDOW
from mrwarp.kernels.mr_joint import FIELDS, JointParams
from mrwarp.kernels.mr_stages import advance_head_kernel
from mrwarp.nn.models import LstmState
from mrwarp.nn.network_file import LearnedModel
from mrwarp.params import MrParams, ParameterError

_CHOICES = {"coupling": Coupling, "hold_current": HoldCurrent, "z_step": ZStep}
_DEFAULTS = {"coupling": Coupling.EXPLICIT, "hold_current": HoldCurrent.SUPPORT, "z_step": ZStep.EULER}
_BY_LOWER = {spec.name.lower(): spec.name for spec in MrParams.specs()}
_WHERE = "DriveMR"
_Choice = TypeVar("_Choice", Coupling, HoldCurrent, ZStep)


class DriveMR(DriveBase):
    """Motor and MR device on one joint, batched over N actuators.

    Args:
        coupling: How the device acts on the joint; may be changed on the object (``drive.coupling``) until the first
            step, e.g. for a drive that came from USD.
        hold_current: Current while the holding gate is open.
        z_step: Step of the hysteresis state.
        params: One array per parameter of :class:`mrwarp.params.MrParams`, shape (N,), units as there.

    Attributes:
        brake_bound: Dry friction that the device may use [N·m], shape (N,), written by every step; 0 when explicit.

    Without a foot load and with the constraint coupling, the yield torque bounds the reaction below ``eps_hold`` and
    the sliding torque above it.
    """

    SHARED_PARAMS: ClassVar[set[str]] = set(_CHOICES)

    custom_inputs = ("mr_current", "mr_foot_load")

    @dataclass
    class State(DriveBase.State):
        """What the drive remembers."""

        z: wp.array[float] | None = None
        """Hysteresis state [rad], shape (N,)."""
        current: wp.array[float] | None = None
        """Coil current [A], shape (N,)."""
        fresh: wp.array[int] | None = None
        """1 where the history starts with the next step, shape (N,)."""
        ring: wp.array4d[float] | None = None
        """History, shape (N, 1, 50, 3), see ``mrwarp.kernels.learned_torque``; only with a learned torque."""
        head: wp.array[int] | None = None
        """Row of its newest sample, shape (1,)."""

        def reset(self, mask: wp.array[wp.bool] | None = None) -> None:
            """No stress and no current where ``mask`` (shape (N,), None = everywhere) is true; others stay bit-equal.

            Raises:
                ValueError: the mask is not a Boolean array of shape (N,).
            """
            assert self.z is not None and self.current is not None and self.fresh is not None  # set by DriveMR.state
            if mask is None:
                self.z.zero_()
                self.current.zero_()
                self.fresh.fill_(1)
                return
            if mask.dtype is not wp.bool or mask.shape != self.z.shape:
                raise ValueError(f"reset mask is {mask.dtype} of shape {mask.shape}; need bool of shape {self.z.shape}")
            outputs = [self.z, self.current, self.fresh]
            wp.launch(drive_reset_kernel, dim=len(mask), inputs=[mask], outputs=outputs, device=self.z.device)

    @classmethod
    def resolve_arguments(cls, args: dict[str, Any]) -> dict[str, Any]:
        """Check scalars and fill in defaults. Names as in ``MrParams`` or as Newton reads them from USD (``mr:k1``).

        Raises:
            ParameterError: a name is unknown (with the nearest one) or a value out of range (with the range).
        """
        choices = {name: _choice(kind, name, args.get(name, _DEFAULTS[name])) for name, kind in _CHOICES.items()}
        values = {_parameter(key): value for key, value in args.items() if key not in _CHOICES}
        return {**MrParams.from_dict({**MrParams().to_dict(), **values}, _WHERE).to_dict(), **choices}

    def __init__(
        self,
        *,
        coupling: Coupling = Coupling.EXPLICIT,
        hold_current: HoldCurrent = HoldCurrent.SUPPORT,
        z_step: ZStep = ZStep.EULER,
        **params: wp.array,
    ) -> None:
        if set(params) != set(FIELDS):
            raise ParameterError(f"{_WHERE}: got arrays {sorted(params)}; need exactly one for each of {list(FIELDS)}")
        first = params[FIELDS[0]]
        if wrong := {name: array.shape for name, array in params.items() if array.shape != (first.size,)}:
            raise ParameterError(f"{_WHERE}: parameter arrays differ in shape: {wrong}, need ({first.size},)")
        self.coupling, self.hold_current, self.z_step = coupling, hold_current, z_step
        self.params: wp.array = wp.empty(first.size, dtype=JointParams, device=first.device)  # pyright: ignore
        for name, array in params.items():
            wp.copy(self.param(name), array)
        self.brake_bound: wp.array = wp.zeros(first.size, dtype=float, device=first.device)
        self._z_next = wp.zeros_like(self.brake_bound)
        self._current_next = wp.zeros_like(self.brake_bound)
        self._m_hold = wp.zeros_like(self.brake_bound)
        self._m_dyn = wp.zeros((first.size, 1), dtype=float, device=first.device)
        self._sliding = wp.zeros_like(self._m_dyn)
        self._learned: LearnedTorque | None = None
        self._ring: wp.array | None = None
        self._head = wp.zeros(1, dtype=int, device=first.device)
        self._brake: _Brake | None = None

    def param(self, name: str) -> wp.array:
        """Live float view of one parameter, shape (N,); writing to it changes the device, unchecked."""
        size = 4 * len(FIELDS)
        ptr = self.params.ptr + 4 * FIELDS.index(name) if self.params.ptr else None
        return wp.array(
            ptr=ptr, dtype=float, shape=self.params.shape, strides=(size,), device=self.params.device, copy=False
        )

    def use_learned(self, model: LearnedModel, *, dt: float, threads: int = 0) -> None:
        """Run a learned torque in every joint of this drive, beside the Bouc-Wen coefficients of its file.

        It acts where the dynamic gate is open; without a foot load, always. Make the states afterwards.

        Args:
            model: The network.
            dt: Step [s].
            threads: CPU threads of the LSTM; 0 = all.

        Raises:
            SamplingRateError: the model was trained at another rate than 1/dt.
        """
        # its states are handed over twice in a step, so none is carried here
        self._learned = LearnedTorque(model, dt=dt, lstm_state=LstmState.WINDOW, threads=threads)
        for name, value in with_bouc_wen(MrParams(), model):
            if name in model.bouc_wen and name != "q_neutral":
                self.param(name).fill_(value)
        shape = (self.params.size, 1, WINDOW, FEATURES)
        self._ring = wp.zeros(shape, dtype=float, device=self.params.device)

    def finalize(self, device: wp.Device, num_actuators: int) -> None:
        """Check that there is one set of parameters per actuator."""
        if num_actuators != self.params.size:
            raise ParameterError(f"{_WHERE}: {self.params.size} sets of parameters for {num_actuators} actuators")

    def is_stateful(self) -> bool:
        """Yes: hysteresis state and coil current."""
        return True

    def is_graphable(self) -> bool:
        """Yes: launches only, no host read-back."""
        return True

    def state(self, num_actuators: int, device: wp.Device) -> DriveMR.State:
        """A state at rest."""
        return DriveMR.State(
            z=wp.zeros(num_actuators, dtype=float, device=device),
            current=wp.zeros(num_actuators, dtype=float, device=device),
            fresh=wp.full(num_actuators, 1, dtype=int, device=device),
            ring=None if self._ring is None else wp.zeros(self._ring.shape, dtype=float, device=device),  # pyright: ignore[reportArgumentType]
            head=wp.zeros(1, dtype=int, device=device),
        )

    def compute(
        self,
        positions: wp.array,
        velocities: wp.array,
        target_pos: wp.array,
        target_vel: wp.array,
        feedforward: wp.array | None,
        pos_indices: wp.array,
        vel_indices: wp.array,
        target_pos_indices: wp.array,
        target_vel_indices: wp.array,
        forces: wp.array,
        state: DriveBase.State | None,
        dt: float,
        device: wp.Device | None = None,
        *,
        custom_inputs: dict[str, Any] | None = None,
    ) -> None:
        """Write the effort [N·m] to ``forces`` and the brake bound to ``brake_bound``, both of shape (N,).

        Raises:
            ValueError: there is no state, no time step or no ``mr_current``.
        """
        inputs = custom_inputs or {}
        if not isinstance(state, DriveMR.State) or dt is None:
            raise ValueError(f"{_WHERE} needs its states and dt: actuator.step(state, control, now, after, dt=...)")
        if inputs.get("mr_current") is None:
            raise ValueError(f"{_WHERE} needs control.mr_current: coil current [A], shape (joint_dof_count,)")
        if self._ring is not None:
            if state.ring is None:
                raise ValueError(f"{_WHERE}: these states have no history; make them after use_learned()")
            wp.copy(self._ring, state.ring)  # pyright: ignore[reportArgumentType]
            wp.launch(advance_head_kernel, dim=1, inputs=[WINDOW, state.head], outputs=[self._head], device=device)
        foot_load = inputs.get("mr_foot_load")
        wp.launch(
            drive_predict_kernel,
            dim=len(forces),
            inputs=[
                self.params, pos_indices, vel_indices, target_pos_indices, float(dt),
                int(self.hold_current is HoldCurrent.FIXED), int(self.z_step is ZStep.EXACT), positions, velocities,
                target_pos, inputs["mr_current"], foot_load, state.z, state.current, state.fresh, self._head,
            ],
            outputs=[self._z_next, self._current_next, self._m_hold, self._m_dyn, self._sliding, self._ring],
            device=device,
        )  # fmt: skip
        if self._learned is not None and self._ring is not None:
            self._learned(self._ring, self._head, self._m_dyn, self._sliding)
        wp.launch(
            drive_torque_kernel,
            dim=len(forces),
            inputs=[
                self.params, pos_indices, vel_indices, target_pos_indices, target_vel_indices,
                int(self.coupling is Coupling.CONSTRAINT), positions, velocities, target_pos, target_vel, feedforward,
                foot_load, self._current_next, self._m_hold, self._sliding,
            ],
            outputs=[self.brake_bound, forces],
            device=device,
        )  # fmt: skip

    def update_state(self, current_state: DriveBase.State, next_state: DriveBase.State) -> None:
        """Hand z, the coil current and the history on."""
        assert isinstance(next_state, DriveMR.State) and next_state.z is not None and next_state.current is not None
        wp.copy(next_state.z, self._z_next)
        wp.copy(next_state.current, self._current_next)
        assert next_state.fresh is not None and next_state.head is not None  # set by DriveMR.state
        next_state.fresh.zero_()
        wp.copy(next_state.head, self._head)
        if self._ring is not None and next_state.ring is not None:
            wp.copy(next_state.ring, self._ring)  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True)
class _Brake:
    """Where the driven joints sit in a solver that was prepared for their brake constraint."""

    solver: newton.solvers.SolverMuJoCo
    dt: float
    world_of: wp.array
    mjc_dof_of: wp.array


def prepare_brake(solver: newton.solvers.SolverMuJoCo, actuator: Actuator, dt: float) -> None:
    """Make the dry friction of the driven joints a brake: reference damping 1/dt, MuJoCo's largest impedance.

    Done by the first :func:`apply_brake_bounds`. Call it yourself before a graph capture, and again after
    ``solver.notify_model_changed`` with joint flags, which rewrites the same solver arrays.

    Args:
        solver: Solver on the ``mujoco_warp`` backend.
        actuator: Actuator whose drive is a :class:`DriveMR` with the constraint coupling.
        dt: Physics step [s].

    Raises:
        ValueError: the drive is no constraint-coupled :class:`DriveMR`, or the solver runs MuJoCo C.
    """
    drive = _constraint_drive(actuator)
    if solver.use_mujoco_cpu:
        raise ValueError("the brake constraint needs the mujoco_warp backend: SolverMuJoCo(use_mujoco_cpu=False)")
    assert solver.mjc_dof_to_newton_dof is not None  # every solver of this backend has it
    newton_dof = np.asarray(solver.mjc_dof_to_newton_dof.numpy())  # pyright: ignore
    worlds, dofs = (
        np.array(index, dtype=np.int32)
        for index in zip(*(np.argwhere(newton_dof == dof)[0] for dof in actuator.indices.numpy()), strict=True)
    )
    mjw = solver.mjw_model
    for field, value in (
        (mjw.dof_solref, brake_constraint.solref(dt)),
        (mjw.dof_solimp, brake_constraint.SOLIMP),
        (mjw.dof_invweight0, brake_constraint.invweight(dt)),
    ):
        values = field.numpy()
        values[worlds, dofs] = value
        field.assign(values)
    mjw.opt.ls_iterations = max(mjw.opt.ls_iterations, brake_constraint.MIN_LS_ITERATIONS)
    device = actuator.device
    drive._brake = _Brake(solver, dt, wp.array(worlds, device=device), wp.array(dofs, device=device))


def apply_brake_bounds(solver: newton.solvers.SolverMuJoCo, actuator: Actuator, dt: float) -> None:
    """Hand the brake bounds of the last ``actuator.step`` to the solver, on top of the joints' own friction.

    Args:
        solver: Solver on the ``mujoco_warp`` backend, about to step.
        actuator: Actuator whose drive is a :class:`DriveMR` with the constraint coupling.
        dt: Physics step [s].

    Raises:
        ValueError: as :func:`prepare_brake`, or a graph is being captured and it was not called before.
    """
    drive = _constraint_drive(actuator)
    brake = drive._brake
    if brake is None or brake.solver is not solver or brake.dt != dt:
        if wp.get_device(drive.params.device).is_capturing:
            raise ValueError("call prepare_brake(solver, actuator, dt) before the capture")
        prepare_brake(solver, actuator, dt)
        brake = drive._brake
        assert brake is not None
    wp.launch(
        brake_bounds_kernel,
        dim=actuator.num_actuators,
        inputs=[brake.world_of, brake.mjc_dof_of, actuator.indices, drive.brake_bound, solver.model.joint_friction],
        outputs=[solver.mjw_model.dof_frictionloss],
        device=actuator.device,
    )


def register() -> None:
    """Make Newton and USD know the MR drive. Called on import of this module; a second call does nothing."""
    global _registered
    if not _registered:
        register_actuator_component(mrwarp.usd.open_stage.SCHEMA, _drive_from_usd, ComponentKind.DRIVE)
        _registered = True


_registered = False


def _drive_from_usd(kwargs: dict[str, Any]) -> type[DriveMR]:
    """Give attributes read from a prim their names in Python, in place; refuse what is missing, unknown, out of range.

    Newton puts the prim's path before the message. Without the schema in USD's registry it reads all of the prim's
    ``newton:`` attributes, those of other schemas included.
    """
    values = {_parameter(key): value for key, value in kwargs.items() if key.startswith("mr:")}
    MrParams.from_dict(values, mrwarp.usd.open_stage.SCHEMA)
    kwargs.clear()
    kwargs.update(values)
    return DriveMR


def _parameter(key: str) -> str:
    """Name in ``MrParams`` of a keyword argument, which Newton lower-cases when it comes from USD."""
    short = key.removeprefix("newton:").removeprefix("mr:")
    return _BY_LOWER.get(short.lower()) or MrParams.spec(short, _WHERE).name


def _choice(kind: type[_Choice], name: str, value: Any) -> _Choice:
    """An enum member from itself or its text."""
    try:
        return kind(value)
    except ValueError:
        allowed = ", ".join(repr(member.value) for member in kind)
        raise ParameterError(f"{_WHERE}: {name} = {value!r}; allowed: {allowed}") from None


def _constraint_drive(actuator: Actuator) -> DriveMR:
    """The actuator's drive, if it has a brake bound."""
    drive = actuator.drive
    if not isinstance(drive, DriveMR) or drive.coupling is not Coupling.CONSTRAINT:
        raise ValueError(
            f"{type(drive).__name__} has no brake bound; build the actuator with DriveMR and coupling='constraint'"
        )
    return drive


register()
