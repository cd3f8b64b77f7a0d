"""The MR joint as a drive of ``newton.actuators``: any Newton scene can use one, with the coil current as an input.

In USD a ``NewtonActuator`` prim applies ``MrwarpMRDriveAPI`` and authors ``newton:mr:<name>`` for every parameter; in
Python it is ``builder.add_actuator(DriveMR, index=dof, K1=12.5)``, or, with the numbers and the named effects of a
model file, ``DriveMR.from_model("model.json", builder, index=dof)``. The step is the simulator's own
(:class:`mrwarp.actuator.mr_actuator.MrActuator`). Per step::

    inputs = drive_inputs(actuator, control)  # control itself; with Newton before 1.7 the drive, see there
    inputs.mr_current        # coil current the device may use [A], shape (joint_dof_count,); yours to write
    inputs.mr_foot_load      # norm of the contact force at the foot [N], shape (joint_dof_count,); yours to write
    control.joint_f.zero_()
    actuator.step(state, control, now, after, dt=dt)
    apply_brake_bounds(solver, actuator, dt)   # constraint coupling only
    solver.step(...)

With ``inputs.mr_foot_load = None`` there are no gates: a plain current-driven device whose coil command is
``mr_current``, with the motor at ``kp_base``. (Both arrays are made with zeros: no current, gates closed.)

Couplings: ``explicit`` (the default here) adds the device's torque to the motor's. ``constraint`` gives the motor's
torque only and writes ``brake_bound``, which :func:`apply_brake_bounds` hands to a ``SolverMuJoCo`` as dry friction:
passive in discrete time, and it stands still without creeping.

A learned torque (``mrwarp learn``) runs in it after ``actuator.drive.use_learned(model, dt=...)``, with states made
afterwards.

This is the only file that touches Newton's actuator API, which is marked experimental. After an upgrade of Newton
check: the signature of ``DriveBase.compute`` and the name of the base class (``Controller`` until 1.8), that the USD
parser still hands attributes over as lower-case ``mr:<name>`` and takes a callable, that ``Control`` still gets the
``custom_inputs`` (since 1.7), and ``SolverMuJoCo.mjc_dof_to_newton_dof``. Each is covered by
``tests/actuator/test_newton_drive.py``, which ``make test-oldest`` runs with the oldest Newton (1.6.1).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import newton
import numpy as np
import warp as wp
from newton.actuators import Actuator, ComponentKind, DriveBase, register_actuator_component

import mrwarp.usd.open_stage  # registers the USD schema; must come before the first stage is opened
from mrwarp.actuator import brake_constraint
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.effect_runtime import added_inertia
from mrwarp.actuator.mr_actuator import ActuatorInputs, DeviceAlone, MrActuator
from mrwarp.enums import Coupling, HoldCurrent, ZStep
from mrwarp.kernels.mr_joint import FIELDS
from mrwarp.kernels.mr_stages import brake_bounds_kernel, drive_gather_kernel, drive_reset_kernel, drive_torque_kernel
from mrwarp.model_file import Effect, check_effects, load_model
from mrwarp.params import MrParams, ParameterError

if TYPE_CHECKING:
    from mrwarp.actuator.residual import LearnedTorque
    from mrwarp.nn.network_file import LearnedModel

_CHOICES = {"coupling": Coupling, "hold_current": HoldCurrent, "z_step": ZStep}
_DEFAULTS = {"coupling": Coupling.EXPLICIT, "hold_current": HoldCurrent.SUPPORT, "z_step": ZStep.EXACT}
_BY_LOWER = {spec.name.lower(): spec.name for spec in MrParams.specs()}
_WHERE = "DriveMR"
_Choice = TypeVar("_Choice", Coupling, HoldCurrent, ZStep)

_OWNS_INPUTS = not hasattr(DriveBase, "custom_inputs")
"""Whether this Newton, one before 1.7, hands a drive no inputs from ``Control``: then the drive has its own arrays."""

SHORTEST_STEP = 5e-4
"""Step [s] down to which a drive remembers its commands for as long as ``command_delay`` delays them."""


class EffectSet(tuple[Effect, ...]):
    """Named effects as a key: Newton makes one drive of all actuators with the same."""

    def __hash__(self) -> int:
        return hash(str(self))


class DriveMR(DriveBase):
    """Motor and MR device on one joint, batched over N actuators.

    Example:
        >>> import mrwarp, newton, warp as wp
        >>> builder = newton.ModelBuilder()
        >>> arm = builder.add_link(mass=1.0, inertia=wp.mat33(0.1, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.1))
        >>> joint = builder.add_joint_revolute(parent=-1, child=arm, axis=(0.0, 1.0, 0.0))
        >>> builder.add_articulation([joint])
        >>> mrwarp.DriveMR.from_model("model.json", builder, index=builder.joint_qd_start[joint])
        >>> len(builder.finalize(device="cpu").actuators)
        1

    Args:
        coupling: How the device acts on the joint; may be changed on the object (``drive.coupling``) until the first
            step, e.g. for a drive that came from USD.
        hold_current: Current while the holding gate is open.
        z_step: Step of the hysteresis state.
        effects: Named effects of the devices, the same for all N; see :meth:`from_model`.
        params: One array per parameter of :class:`mrwarp.params.MrParams`, shape (N,), units as there.

    Attributes:
        brake_bound: Dry friction that the device may use [N·m], shape (N,), written by every step; 0 when explicit.
        mr_current, mr_foot_load: With Newton before 1.7 alone, see :func:`drive_inputs`.

    Without a foot load and with the constraint coupling, the yield torque bounds the reaction below ``eps_hold`` and
    where the joint turns round (:func:`mrwarp.kernels.mr_joint.stuck`), the sliding torque elsewhere.
    """

    SHARED_PARAMS: ClassVar[set[str]] = {*_CHOICES, "effects"}

    custom_inputs = ("mr_current", "mr_foot_load")

    @dataclass
    class State(DriveBase.State):
        """Memory of the drive."""

        z: wp.array[Any] | None = None
        """Hysteresis state [rad], shape (N,)."""
        current: wp.array[Any] | None = None
        """Coil current at the step's end [A], shape (N,)."""
        head: wp.array[Any] | None = None
        """Row of the history's newest sample, shape (1,)."""
        fresh: wp.array[Any] | None = None
        """Joints that forget all else with the next step, bool, shape (N,)."""
        history: wp.array[Any] | None = None
        """History, shape (N, 1, 50, 3), see ``mrwarp.kernels.learned_torque``: whether the joint turns round."""
        ring: wp.array[Any] | None = None
        """In its place with a learned torque, which reads all of it."""
        heat: wp.array[Any] | None = None
        """This and the following only with effects, see :class:`mrwarp.actuator.effect_runtime.DeviceEffects`."""
        newest: wp.array[Any] | None = None
        memory: wp.array[Any] | None = None
        commands: wp.array[Any] | None = None
        clock: wp.array[Any] | None = None

        def reset(self, mask: wp.array[wp.bool] | None = None) -> None:
            """No stress and no current where ``mask`` (shape (N,), None = everywhere) is true; others stay bit-equal.

            Raises:
                ValueError: the mask is not a Boolean array of shape (N,).
            """
            assert self.z is not None and self.current is not None and self.fresh is not None  # set by DriveMR.state
            shape = self.fresh.shape
            if mask is None:
                mask = wp.full(shape, True, dtype=wp.bool, device=self.z.device)
            if mask.dtype is not wp.bool or mask.shape != shape:
                raise ValueError(f"reset mask is {mask.dtype} of shape {mask.shape}; need bool of shape {shape}")
            outputs = [self.z, self.current, self.fresh]
            wp.launch(drive_reset_kernel, dim=len(mask), inputs=[mask], outputs=outputs, device=self.z.device)

    @classmethod
    def resolve_arguments(cls, args: dict[str, Any]) -> dict[str, Any]:
        """Check scalars and fill in defaults. Names as in ``MrParams`` or as Newton reads them from USD (``mr:k1``).

        Raises:
            ParameterError: a name is unknown (with the nearest one) or a value out of range (with the range).
        """
        choices = {name: _choice(kind, name, args.get(name, _DEFAULTS[name])) for name, kind in _CHOICES.items()}
        values = {_parameter(key): value for key, value in args.items() if key not in cls.SHARED_PARAMS}
        effects = EffectSet(args.get("effects", ()))
        check_effects(effects, _WHERE)
        device = MrParams.from_dict({**MrParams().to_dict(), **values}, _WHERE)
        return {**device.to_dict(), **choices, "effects": effects}

    @classmethod
    def from_model(
        cls, path: str | Path, builder: newton.ModelBuilder, *, index: int, extrapolate: bool = False, **arguments: Any
    ) -> None:
        """Put the device of a model file on a joint: its numbers, its named effects, and their inertia as armature.

        Effects of the bench's sensors and of its calibration are no part of the device and do not act. There is no
        motor unless ``arguments`` give it gains, even where the file holds some. The device's angle is the joint's;
        where its zero lies elsewhere, ``q_neutral`` says so.

        Args:
            path: A model.json of ``mrwarp fit`` or ``mrwarp diagnose``.
            builder: The scene.
            index: DOF of the joint.
            extrapolate: Let the coil take more current than the recordings held.
            arguments: Further ones of ``add_actuator``, which win over the file's. A motor's ``kp_low`` is at most its
                ``kp_base``.

        Raises:
            ModelFileError: the file cannot be used.
            ValueError: the effects would leave the joint a negative armature.
        """
        model = load_model(path)
        model.check_joint()
        check_effects(model.effects, str(path))
        armature = builder.joint_armature[index] + added_inertia(model.effects)
        if armature < 0.0:
            raise ValueError(f"{path}: its rotor_inertia leaves joint {index} an armature of {armature:g} kg·m²")
        params = model.to_params(extrapolate=extrapolate)
        kp = float(arguments.get("kp_base", 0.0))
        motor = {"kp_low": min(kp, params.motor.kp_low), "tau_limit": params.motor.tau_limit}
        values = {**params.alone().to_dict(), **motor}
        builder.add_actuator(cls, index=index, **{**values, "effects": model.effects, **arguments})
        builder.joint_armature[index] = armature

    def __init__(
        self,
        *,
        coupling: Coupling = Coupling.EXPLICIT,
        hold_current: HoldCurrent = HoldCurrent.SUPPORT,
        z_step: ZStep = ZStep.EXACT,
        effects: Iterable[Effect] = (),
        **params: wp.array,
    ) -> None:
        if set(params) != set(FIELDS):
            raise ParameterError(f"{_WHERE}: got arrays {sorted(params)}; need exactly one for each of {list(FIELDS)}")
        first = params[FIELDS[0]]
        if wrong := {name: array.shape for name, array in params.items() if array.shape != (first.size,)}:
            raise ParameterError(f"{_WHERE}: parameter arrays differ in shape: {wrong}, need ({first.size},)")
        self.coupling, self.hold_current, self.z_step = coupling, hold_current, z_step
        count, device = first.size, first.device
        names = ("q_des", "q", "qd", "f_foot", "friction")
        columns = {name: wp.zeros((count, 1), dtype=float, device=device) for name in names}
        self._inputs = ActuatorInputs(current_e=wp.zeros(count, dtype=float, device=device), **columns)
        # N environments of one joint: the simulator's own step
        self._effects = EffectSet(effects)
        self._joints = MrActuator(
            [DeviceAlone(mr=MrParams(), effects=self._effects)], [0], self._inputs, dt=SHORTEST_STEP, share_params=False
        )
        for name, array in params.items():
            wp.copy(self.param(name), array)
        beta, gamma = (params[name].numpy() for name in ("beta", "gamma"))
        self._joints.euler_rate = float(np.maximum(beta - gamma, beta + gamma).max())
        self.brake_bound: wp.array = wp.zeros(count, dtype=float, device=device)
        self._fresh = wp.zeros(count, dtype=wp.bool, device=device)
        if _OWNS_INPUTS:
            self.mr_current: wp.array | None = wp.zeros(count, dtype=float, device=device)
            self.mr_foot_load: wp.array | None = wp.zeros(count, dtype=float, device=device)
            self._own_indices = wp.array(np.arange(count), dtype=wp.uint32, device=device)
        self._learned: LearnedTorque | None = None
        self._brake: _Brake | None = None

    def param(self, name: str) -> wp.array:
        """Live float view of one parameter, shape (N,); writing to it changes the device, unchecked."""
        column = self._joints.param(name)[:, 0]
        assert isinstance(column, wp.array)
        return column

    def use_learned(self, model: LearnedModel, *, dt: float, threads: int = 0) -> None:
        """Run a learned torque in every joint of this drive, with the Bouc-Wen coefficients of its file.

        It acts where the dynamic gate is open; without a foot load, always. Make the states afterwards.

        Args:
            model: The network.
            dt: Step [s].
            threads: CPU threads of the LSTM; 0 = all.

        Raises:
            SamplingRateError: the model was trained at another rate than 1/dt.
            OtherDeviceError: it learned another device than one of the drive's.
        """
        from mrwarp.actuator.residual import LearnedTorque, with_bouc_wen  # torch and onnx: the drive does without
        from mrwarp.enums import LstmState
        from mrwarp.nn.network_file import DEVICE

        rows = np.unique(np.stack([self.param(name).numpy() for name in DEVICE], axis=1), axis=0)
        devices: list[dict[str, float]] = [dict(zip(DEVICE, row, strict=True)) for row in rows.tolist()]
        for device in devices:
            model.check_device(device)
        # its states are handed over twice in a step, so none is carried here
        self._learned = LearnedTorque(model, dt=dt, lstm_state=LstmState.WINDOW, threads=threads)
        for name, value in with_bouc_wen(MrParams().replace(**devices[0]), model, self._effects):
            if name in model.bouc_wen and name != "q_neutral":
                self.param(name).fill_(value)

    def finalize(self, device: wp.Device, num_actuators: int) -> None:
        """Check that there is one set of parameters per actuator."""
        if num_actuators != self.brake_bound.size:
            raise ParameterError(f"{_WHERE}: {self.brake_bound.size} sets of parameters for {num_actuators} actuators")

    def is_stateful(self) -> bool:
        """Yes: hysteresis state and coil current."""
        return True

    def is_graphable(self) -> bool:
        """Yes: launches only, no host read-back."""
        return True

    def state(self, num_actuators: int, device: wp.Device) -> DriveMR.State:
        """A state at rest."""
        state = DriveMR.State(fresh=wp.full(num_actuators, True, dtype=wp.bool, device=device))
        for name, array in self._remembered().items():
            setattr(state, name, wp.zeros_like(array))
        return state

    def _remembered(self) -> dict[str, wp.array]:
        """Arrays of the step that a :class:`State` holds between steps, by its names."""
        joints = self._joints
        arrays = {"z": joints.z.flatten(), "current": joints.coil.flatten(), "head": joints.head}
        arrays |= {"history" if self._learned is None else "ring": joints.ring}
        return arrays | (joints.effects.states if joints.effects is not None else {})

    def _prepare(self, dt: float, gated: bool) -> None:
        """Set the joints' step up for what the drive now is.

        Raises:
            ValueError: the step is too short for effects.
        """
        joints = self._joints
        choices = {name: getattr(self, name) for name in _CHOICES}
        cfg = MrActuatorCfg(**choices, gated=gated)
        if (dt, cfg, self._learned) == (joints.dt, joints.cfg, joints.residual):
            return
        if joints.effects is not None and dt < SHORTEST_STEP:
            raise ValueError(f"{_WHERE}: dt = {dt:g} s is too short for effects; take {SHORTEST_STEP:g} s or more")
        joints.configure(dt=dt, cfg=cfg, residual=self._learned)

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
        inputs = {name: getattr(self, name) for name in self.custom_inputs} if _OWNS_INPUTS else custom_inputs or {}
        if not isinstance(state, DriveMR.State) or dt is None:
            raise ValueError(f"{_WHERE} needs its states and dt: actuator.step(state, control, now, after, dt=...)")
        if inputs.get("mr_current") is None:
            raise ValueError(f"{_WHERE} needs {'drive' if _OWNS_INPUTS else 'control'}.mr_current: coil current [A]")
        if self._learned is not None and state.ring is None:
            raise ValueError(f"{_WHERE}: these states have no history; make them after use_learned()")
        foot_load, x, joints = inputs.get("mr_foot_load"), self._inputs, self._joints
        self._prepare(float(dt), foot_load is not None)
        for name, array in self._remembered().items():
            wp.copy(array, getattr(state, name))
        wp.copy(self._fresh, state.fresh)  # pyright: ignore[reportArgumentType]
        wp.launch(
            drive_gather_kernel,
            dim=len(forces),
            inputs=[
                *(pos_indices, vel_indices, target_pos_indices, self._own_indices if _OWNS_INPUTS else vel_indices),
                *(positions, velocities, target_pos),
                *(inputs["mr_current"], foot_load),
            ],
            outputs=[x.q, x.qd, x.q_des, x.current_e, x.f_foot],
            device=device,
        )
        joints.reset(self._fresh)
        joints.predict()
        joints.add_residual()
        wp.launch(
            drive_torque_kernel,
            dim=len(forces),
            inputs=[
                *(joints.device_params, target_vel_indices, int(joints.cfg.gated)),
                *(int(self.coupling is Coupling.CONSTRAINT), x.q, x.qd, x.q_des, target_vel, feedforward),
                *(joints.current, joints.m_hold, joints.tau_dyn, joints.ring, joints.head),
            ],
            outputs=[self.brake_bound, forces],
            device=device,
        )

    def update_state(self, current_state: DriveBase.State, next_state: DriveBase.State) -> None:
        """Hand on what the step left."""
        assert isinstance(next_state, DriveMR.State) and next_state.fresh is not None
        next_state.fresh.zero_()
        for name, array in self._remembered().items():
            wp.copy(getattr(next_state, name), array)


def drive_inputs(actuator: Actuator, control: newton.Control) -> Any:
    """Holder of an actuator's ``mr_current`` and ``mr_foot_load``, to be read and written there.

    That is ``control``, with arrays of shape (joint_dof_count,). Newton before 1.7 hands a drive nothing from there:
    then it is the drive itself, with arrays of shape (N,), a number for each of its joints.
    """
    return actuator.drive if _OWNS_INPUTS else control


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
    for values, value in (
        (mjw.dof_solref, brake_constraint.solref(dt)),
        (mjw.dof_solimp, brake_constraint.SOLIMP),
        (mjw.dof_invweight0, brake_constraint.invweight(dt)),
    ):
        changed = values.numpy()
        changed[worlds, dofs] = value
        values.assign(changed)
    mjw.opt.ls_iterations = max(mjw.opt.ls_iterations, brake_constraint.MIN_LS_ITERATIONS)
    device = actuator.device
    drive._brake = _Brake(solver, dt, wp.array(worlds, device=device), wp.array(dofs, device=device))


def apply_brake_bounds(solver: newton.solvers.SolverMuJoCo, actuator: Actuator, dt: float) -> None:
    """Hand the brake bounds of the last ``actuator.step`` to the solver, on top of the joints' own friction.

    The arguments are those of :func:`prepare_brake`; the solver is about to step.

    Raises:
        ValueError: as :func:`prepare_brake`, or a graph is being captured and it was not called before.
    """
    drive = _constraint_drive(actuator)
    brake = drive._brake
    if brake is None or brake.solver is not solver or brake.dt != dt:
        if wp.get_device(drive.brake_bound.device).is_capturing:
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
