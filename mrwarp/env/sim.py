"""Sim: steps the physics of robots that act. One model, two engines, the same Warp arrays to read and write."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from mrwarp.actuator import brake_constraint
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.mr_actuator import ActuatorInputs, MrActuator
from mrwarp.enums import BackendKind, Coupling
from mrwarp.env import sim_kernels
from mrwarp.env.backend import Backend, MjBatchBackend, MjWarpBackend
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.env.sim_model import Edit, Scene, build_scene, named
from mrwarp.kernels.launch import Launch, StepGraph, in_one_thread, record, record_per_env
from mrwarp.usd.asset import RobotAsset, load_robot
from mrwarp.usd.converted import Field

if TYPE_CHECKING:
    from mrwarp.actuator.residual import LearnedTorque


class Sim:
    """Physics of E copies of a scene.

    Attributes (Warp arrays, float32, kept in place; E environments, J joints, L feet):
        q, qd: Joint positions [rad] and velocities [rad/s], shape (E, J).
        friction: Torque of the brake constraint in the last step [N·m], shape (E, J).
        f_foot: Norm of the contact force per foot in the last step [N], shape (E, L).
        root_pos, root_quat: Pose of the floating base [m], quaternion (w, x, y, z).
        root_vel, root_ang: Its linear velocity in the world [m/s] and angular velocity in its own frame [rad/s].
        residual: Largest component of the constraint solver's residual in the last step [N·m], shape (E,).
        unsolved: Number of steps whose residual was too large, per environment, shape (E,).

    Args:
        scene: The model.
        cfg: How to step it.
        coupling: Whether the brake bounds reach the solver.
    """

    def __init__(self, scene: Scene, cfg: SimCfg, *, coupling: Coupling = Coupling.CONSTRAINT) -> None:
        self.scene, self.cfg, self.coupling = scene, cfg, coupling
        self.num_envs, self.dt = cfg.num_envs, cfg.dt
        self.device = wp.get_device(cfg.device)
        self.backend: Backend
        if cfg.engine is BackendKind.MJBATCH:
            self.backend = MjBatchBackend(scene.model, cfg.num_envs, threads=cfg.threads, keep_data=cfg.keep_data)
        else:
            self.backend = MjWarpBackend(scene.model, cfg.num_envs, device=cfg.device, deterministic=cfg.deterministic)
        num_envs, num_joints, num_feet = cfg.num_envs, len(scene.actuators), max(len(scene.foot_adr), 1)

        def zeros(*shape: int) -> wp.array:
            return wp.zeros(shape, dtype=float, device=self.device)

        self.q, self.qd, self.friction = (zeros(num_envs, num_joints) for _ in range(3))
        self.f_foot = zeros(num_envs, num_feet)
        self.root_pos, self.root_quat = zeros(num_envs, 3), zeros(num_envs, 4)
        self.root_vel, self.root_ang = zeros(num_envs, 3), zeros(num_envs, 3)
        self.residual = zeros(num_envs)
        self.unsolved = wp.zeros(num_envs, dtype=int, device=self.device)
        self._frictionloss = self.backend.expand("dof_frictionloss")
        self._joint_friction, self._joint_damping = (
            wp.array(values, dtype=float, device=self.device) for values in (scene.friction, scene.damping)
        )
        self._no_bound = zeros(num_envs, num_joints)
        self._steps: dict[tuple[int | None, int | None], list[Launch]] = {}
        self._q_adr = wp.array(scene.q_adr, dtype=int, device=self.device)
        self._v_adr = wp.array(scene.v_adr, dtype=int, device=self.device)
        self._foot_adr = wp.array(scene.foot_adr, dtype=int, device=self.device)
        self._check, self._read_state = self._record_check(), self._record_gather(self._no_bound)
        self.reset()

    def step(self, tau: wp.array, bound: wp.array) -> None:
        """Advance by one step under joint torques and bounds of the brake constraint [N·m], shape (E, J)."""
        for launch in self.physics(tau, bound):
            launch()

    def physics(self, tau: wp.array, bound: wp.array) -> list[Launch]:
        """Launches of a step: torques and bounds to the solver, the engine, its state, a check of its solution."""
        key = (tau.ptr, bound.ptr)
        if key not in self._steps:
            self._steps[key] = [self._record_apply(tau, bound), self.engine, self._record_gather(bound), self._check]
        return self._steps[key]

    def engine(self) -> None:
        """The engine's step alone."""
        self.backend.step()

    def reset(self, mask: wp.array | None = None, qpos: wp.array | None = None, qvel: wp.array | None = None) -> None:
        """Put masked environments, bool (E,), into a state in MuJoCo's layout, (E, nq) and (E, nv), float32.

        None stands for all environments, the model's own position, and rest. The others stay bit-equal.
        """
        model = self.scene.model
        if mask is None:
            mask = wp.full(self.num_envs, True, dtype=wp.bool, device=self.device)
        if qpos is None:
            qpos = wp.array(np.tile(model.qpos0, (self.num_envs, 1)), dtype=float, device=self.device)
        if qvel is None:
            qvel = wp.zeros((self.num_envs, model.nv), dtype=float, device=self.device)
        self.record_reset(mask, qpos, qvel)()

    def record_reset(self, mask: wp.array, qpos: wp.array, qvel: wp.array) -> Launch:
        """Launch of a masked reset into given states, to be repeated: it reads mask, qpos and qvel each time."""
        # plain numbers, shape (E, 6*nbody): one engine has them so, the other six to an element
        pushes = wp.from_torch(wp.to_torch(self.backend.field("xfrc_applied")).view(self.num_envs, -1))
        return record_per_env(
            sim_kernels.reset_kernel,
            self.num_envs,
            inputs=[self._q_adr, self._v_adr, int(self.scene.floating), mask, qpos, qvel],
            outputs=[
                *(self.backend.field(name) for name in ("qpos", "qvel", "qacc_warmstart", "qfrc_applied")),
                pushes, self.f_foot, self.friction, self.q, self.qd,
                self.root_pos, self.root_quat, self.root_vel, self.root_ang,
            ],
        )  # fmt: skip

    def refresh(self) -> None:
        """Read the state again after somebody wrote to it; foot forces and brake torques keep their last value."""
        kept = [(array, wp.clone(array)) for array in (self.f_foot, self.friction)]
        self._read_state()
        for array, copy in kept:
            wp.copy(array, copy)

    def push(self, body: str, force: np.ndarray) -> None:
        """Apply a force at a body's centre of mass from now on, until called again [N], world frame, shape (E, 3)."""
        view = wp.to_torch(self.backend.field("xfrc_applied")).reshape(self.num_envs, -1, 6)
        view[:, self.body(body), :3] = view.new_tensor(force)

    def body_mass(self, body: str) -> float:
        """Nominal mass of a body [kg]."""
        return float(self.scene.model.body_mass[self.body(body)])

    def rescale_mass(self, body: str, mass: np.ndarray) -> None:
        """Give a body another mass per environment [kg], shape (E,), its inertia in proportion."""
        model = self.scene.model
        index = self.body(body)
        if not np.all(mass > 0.0):
            raise ValueError(f"mass of {body!r} must be positive, got {mass.min():g} kg")
        ratio = np.asarray(mass) / model.body_mass[index]
        for name in ("body_mass", "body_inertia"):
            array = self.backend.expand(name)
            values = array.numpy().reshape(self.num_envs, model.nbody, -1)
            values[:, index] = getattr(model, name)[index] * ratio[:, None]
            array.assign(values.reshape(array.numpy().shape))
        self.backend.set_const()
        if self.coupling is Coupling.CONSTRAINT:
            invweight = self.backend.expand("dof_invweight0")
            values = invweight.numpy()
            dofs = [v for v, a in zip(self.scene.v_adr, self.scene.actuators, strict=True) if a.mr]
            values[:, dofs] = brake_constraint.invweight(self.dt)
            invweight.assign(values)

    def set_friction(self, friction: np.ndarray) -> None:
        """Set the sliding friction of every geom per environment [1], shape (E,)."""
        array = self.backend.expand("geom_friction")
        values = array.numpy()
        values[..., 0] = np.asarray(friction)[:, None]
        array.assign(values)

    def body(self, body: str) -> int:
        """Index of a body in the model by its short name; ValueError if there is none."""
        model = self.scene.model
        return named([model.body(i).name for i in range(model.nbody)], body, "body")

    def _record_apply(self, tau: wp.array, bound: wp.array) -> Launch:
        lanes = 1 if in_one_thread(self.device) else len(self.scene.actuators)
        return record(
            sim_kernels.apply_kernel,
            (self.num_envs, lanes),
            [
                *(lanes, self._v_adr, self._joint_friction, self._joint_damping),
                *(int(self.coupling is Coupling.CONSTRAINT), tau, bound, self.qd),
            ],
            [self.backend.field("qfrc_applied"), self._frictionloss],
        )

    def _record_gather(self, bound: wp.array) -> Launch:
        fields = [self.backend.field(name) for name in ("qpos", "qvel", "sensordata")]
        floating = int(self.scene.floating)
        return record(
            sim_kernels.gather_kernel,
            self.num_envs,
            [self._q_adr, self._v_adr, self._foot_adr, floating, brake_constraint.CREEP, *fields, bound],
            [
                *(self.q, self.qd, self.friction, self.f_foot),
                *(self.root_pos, self.root_quat, self.root_vel, self.root_ang),
            ],
        )

    def _record_check(self) -> Launch:
        model, backend = self.scene.model, self.backend
        pattern = [wp.array(a, dtype=int, device=self.device) for a in (model.M_rowadr, model.M_rownnz, model.M_colind)]
        ends = model.M_colind[model.M_rowadr + model.M_rownnz - 1]
        assert np.array_equal(ends, np.arange(model.nv))  # the kernel relies on it
        fields = [backend.field(name) for name in ("M", "qacc", "qacc_smooth", "qfrc_constraint")]
        scratch = wp.zeros((self.num_envs, 2 * model.nv), dtype=wp.float64, device=self.device)
        outputs = [scratch, self.residual, self.unsolved]
        inputs = [*pattern, backend.residual_tolerance, *fields]
        return record(sim_kernels.residual_kernel, self.num_envs, inputs, outputs)


class ActuatedSim:
    """A robot (or bench) with its actuators: torque stages, physics step and energy ledger as one ``step``.

    Args:
        scene: What is simulated, e.g. :func:`robot_scene`; built for the same step and coupling.
        cfg: How the physics is stepped.
        actuator_cfg: Choices of the MR joint's model.
        residual: Learned torque, see :class:`mrwarp.actuator.mr_actuator.MrActuator`.
        share_params: One set of actuator parameters for all environments.
        commanded: Whether coils get ``current_command`` while a gate is open.

    Attributes:
        sim: The physics.
        actuator: The joints' motors and devices.
        q_des: Joint targets [rad], shape (E, J); write them before stepping.
        current_e: Current each environment may use [A], shape (E,).
        current_command: Current commanded of each device [A], shape (E, M); unused without ``commanded``.
        physics: Launches of a physics step.
        before_hooks, hooks: Called on the host before and after every torque step, e.g. to record or to push; empty in
            training.
    """

    def __init__(
        self,
        scene: Scene,
        cfg: SimCfg,
        actuator_cfg: MrActuatorCfg | None = None,
        *,
        residual: LearnedTorque | None = None,
        share_params: bool = True,
        commanded: bool = False,
    ) -> None:
        actuator_cfg = actuator_cfg or MrActuatorCfg()
        self.sim = sim = Sim(scene, cfg, coupling=actuator_cfg.coupling)
        self.q_des = wp.zeros((cfg.num_envs, len(scene.actuators)), dtype=float, device=cfg.device)
        self.current_e = wp.zeros(cfg.num_envs, dtype=float, device=cfg.device)
        devices = sum(actuator.mr is not None for actuator in scene.actuators)
        self.current_command = wp.zeros((cfg.num_envs, devices), dtype=float, device=cfg.device)
        inputs = ActuatorInputs(
            q_des=self.q_des,
            q=sim.q,
            qd=sim.qd,
            f_foot=sim.f_foot,
            current_e=self.current_e,
            friction=sim.friction,
            command=self.current_command if commanded else None,
        )
        choices = {"cfg": actuator_cfg, "residual": residual, "share_params": share_params}
        self.actuator = MrActuator(scene.actuators, scene.legs, inputs, dt=cfg.dt, **choices)
        self.physics = sim.physics(self.actuator.tau, self.actuator.bound)
        self.before_hooks: list[Callable[[], object]] = []
        self.hooks: list[Callable[[], object]] = []
        self._graphs: dict[int, StepGraph] = {}
        self.actuator.reset()

    def step(self, count: int = 1) -> None:
        """``count`` times: one torque step, one physics step, one line in the ledger.

        With ``cfg.capture`` all this runs as captured graphs, bit-equal to the eager launches: on MuJoCo-Warp as one
        graph, with ``mjbatch`` as one before, between and after its steps.
        """
        if count not in self._graphs:
            a = self.actuator
            torque_step = [self.before_step, a.predict, a.add_residual, a.torque, *self.physics, a.account]
            self._graphs[count] = self.graph([*torque_step, self.after_step] * count)
        self._graphs[count].run(self.on_host())

    def graph(self, sequence: Sequence[Launch]) -> StepGraph:
        """A sequence that is run as ``cfg.capture`` says, see :meth:`on_host`."""
        return StepGraph(sequence, self.sim.device, eager=not self.sim.cfg.capture)

    def on_host(self) -> frozenset[Launch]:
        """Launches that no graph can take: ``mjbatch``, a learned torque in torch or with threads of its own, hooks."""
        found: list[Launch] = []
        if self.sim.backend.kind is BackendKind.MJBATCH:
            found.append(self.sim.engine)
        if self.actuator.residual is not None and not self.actuator.residual.graphable:
            found.append(self.actuator.add_residual)
        found += [self.before_step] * bool(self.before_hooks) + [self.after_step] * bool(self.hooks)
        return frozenset(found)

    def before_step(self) -> None:
        """Call what is hooked before a torque step."""
        for hook in self.before_hooks:
            hook()

    def after_step(self) -> None:
        """Call what is hooked after a torque step."""
        for hook in self.hooks:
            hook()

    def reset(self, mask: wp.array | None = None, qpos: wp.array | None = None, qvel: wp.array | None = None) -> None:
        """Masked reset of physics and actuators, see :meth:`Sim.reset`."""
        self.sim.reset(mask, qpos, qvel)
        self.actuator.reset(mask)


def robot_scene(
    asset: RobotAsset | None = None,
    cfg: SimCfg | None = None,
    coupling: Coupling = Coupling.CONSTRAINT,
    edit: Edit | None = None,
    ground: Field | None = None,
) -> Scene:
    """The robot of an asset (None: ``assets/usd/mr_go.usda``) on flat or other ground, see :func:`build_scene`."""
    cfg = cfg or SimCfg()
    return build_scene(
        asset or load_robot(), dt=cfg.dt, coupling=coupling, solver=cfg.solver, ground=ground or True, edit=edit
    )
