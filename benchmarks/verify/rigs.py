"""Rigs for the physics checks: a single link, the bench, the robot in its stance, loads, and a meter for MR work."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import warp as wp

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.enums import Coupling, HoldCurrent
from mrwarp.env.backend import MjBatchBackend, MjWarpBackend
from mrwarp.env.config.sim_cfg import SimCfg, SolverCfg
from mrwarp.env.sim import ActuatedSim, Sim, robot_scene
from mrwarp.env.sim_model import Scene, set_brake_constraint
from mrwarp.kernels import ledger
from mrwarp.paper import GRAVITY
from mrwarp.params import MrParams
from mrwarp.usd.asset import JointActuator
from mrwarp.usd.robot import CURRENT_GROUPS, DEFAULT_Q, MR_GO, STAND_HEIGHT

LOADED = 100.0
"""Foot force written to rigs without feet, so that their gates see a loaded leg [N]."""

MOTORLESS = {"kp_base": 0.0, "kp_low": 0.0, "kd": 0.0}
"""Parameters of a joint that its device has to hold alone."""


@dataclass(frozen=True, kw_only=True)
class Link:
    """One rigid link on a horizontal hinge; at q = 0 it points sideways, gravity turns it towards positive q."""

    mass: float = 0.3
    """Mass [kg]."""
    com: float = 0.2
    """Distance of the centre of mass from the axis [m]; 0 = balanced."""
    inertia: float = 0.016
    """Inertia about the axis [kg·m^2]; default: a uniform rod of 0.4 m, m*L^2/3, about what a calf has (0.0144)."""

    @property
    def weight_torque(self) -> float:
        """Torque of the weight at q = 0 [N·m]."""
        return self.mass * GRAVITY * self.com


def link_scene(mr: MrParams, *, dt: float, link: Link | None = None, brake: bool = True) -> Scene:
    """A scene with one MR joint and nothing else.

    Args:
        mr: The joint's device and motor.
        dt: Physics step [s].
        link: What the joint carries.
        brake: Make the joint's dry friction the brake constraint; False leaves MuJoCo's default friction.
    """
    link, solver = link or Link(), SolverCfg()
    across = link.inertia - link.mass * link.com**2
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco>
          <option timestep="{dt}" gravity="0 0 -{GRAVITY}" solver="Newton" iterations="{solver.iterations}"
                  ls_iterations="{solver.ls_iterations}" tolerance="{solver.tolerance}"/>
          <worldbody><body name="link">
            <joint name="joint" type="hinge" axis="0 1 0"/>
            <inertial pos="{link.com} 0 0" mass="{link.mass}" diaginertia="{across} {across} {across}"/>
          </body></worldbody>
        </mujoco>""")
    if brake:
        set_brake_constraint(model, [0], dt)
    kp, kd, limit = mr.motor.kp_base, mr.motor.kd, mr.motor.tau_limit
    joint = JointActuator(joint="joint", prim_path="", kp=kp, kd=kd, tau_limit=limit, mr=mr)
    at = np.zeros(1, dtype=np.int32)
    none, nothing = at[:0], np.zeros(1)
    return Scene(
        model=model,
        actuators=(joint,),
        layout=MR_GO,
        q_adr=at,
        v_adr=at,
        friction=nothing,
        damping=nothing,
        feet=none,
        foot_adr=none,
        floating=False,
    )


def yield_torque(mr: MrParams, current: float) -> float:
    """tau_y of eq. 18 in float64 [N·m]."""
    ratio = (current / mr.hold.K) ** mr.hold.n
    return mr.hold.T_max * ratio / (1.0 + ratio)


def root_mean_square(error: np.ndarray, axes: int | tuple[int, ...] | None = None) -> Any:
    """Root of the mean square over some axes; None: over all."""
    return np.sqrt(np.square(error).mean(axis=axes))


def convergence_order(steps: Sequence[float], errors: Any) -> np.ndarray:
    """Observed order of convergence: slope of log(error), shape (S,) or (S, N), over log(step), shape (S,)."""
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


def joint_inertia(scene: Scene, joint: str) -> float:
    """Inertia that a joint sees with every other joint locked, in the model's own pose [kg·m^2]."""
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    dof = scene.v_adr[scene.joints.index(joint)]
    return float(mass_matrix(scene.model, data)[dof, dof])


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Dense joint-space inertia, shape (nv, nv)."""
    dense = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, dense)
    return dense


class Load:
    """Torque on a rig's only joint from outside.

    Args:
        robot: A rig with one joint.
    """

    def __init__(self, robot: ActuatedSim) -> None:
        model = robot.sim.scene.model
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        joint = int(np.flatnonzero(model.jnt_dofadr == robot.sim.scene.v_adr[0])[0])
        self._body, self._axis = int(model.jnt_bodyid[joint]), data.xaxis[joint].copy()
        self._field = robot.sim.backend.field("xfrc_applied")
        self._values = np.zeros((robot.sim.num_envs, model.nbody, 6))

    def set(self, torque: np.ndarray) -> None:
        """Load the joint [N·m], shape (E,); stays until it is changed."""
        self._values[:, self._body, 3:] = torque[:, None] * self._axis
        self._field.assign(self._values.reshape(self._field.numpy().shape))


def stance(scene: Scene, num_envs: int, *, lift: float = 0.0) -> wp.array:
    """The robot's neutral stance, its feet ``lift`` [m] above touching the ground; qpos of shape (E, nq)."""
    qpos = np.array(scene.model.qpos0)
    qpos[2] = STAND_HEIGHT + lift
    qpos[scene.q_adr] = DEFAULT_Q
    return wp.array(np.tile(qpos, (num_envs, 1)), dtype=float, device="cpu")


def standing_robot(
    currents: Sequence[float] = CURRENT_GROUPS,
    *,
    coupling: Coupling = Coupling.CONSTRAINT,
    lift: float = 0.0,
    options: Callable[[mujoco.MjModel], None] | None = None,
    **cfg: Any,
) -> ActuatedSim:
    """The robot in its stance, one environment per holding current [A]; its motors hold the stance.

    Args:
        currents: Current each environment may use, and uses while holding [A].
        coupling: How the devices act.
        lift: Height of the feet above the ground [m].
        options: Changes the compiled model's options, past every check.
        **cfg: Settings of :class:`mrwarp.env.sim.SimCfg`.
    """
    settings = SimCfg(num_envs=len(currents), keep_data=True, **cfg)
    scene = robot_scene(None, settings, coupling)
    if options is not None:
        options(scene.model)
    robot = ActuatedSim(scene, settings, MrActuatorCfg(coupling=coupling, hold_current=HoldCurrent.FIXED))
    robot.current_e.assign(np.array(currents, dtype=np.float32))
    robot.q_des.assign(np.tile(np.array(DEFAULT_Q, dtype=np.float32), (len(currents), 1)))
    robot.reset(None, stance(scene, len(currents), lift=lift))
    return robot


def solver_friction(sim: Sim) -> np.ndarray:
    """Dry friction per joint as the engine's own solver left it in its constraint rows [N·m], shape (E, J).

    This is ``efc_force`` of the rows of type FRICTION_DOF: nothing of ``mrwarp`` takes part in it.
    """
    backend, kind = sim.backend, int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
    torque = np.zeros((sim.num_envs, sim.scene.model.nv))
    if isinstance(backend, MjWarpBackend):
        efc = backend.data.efc
        types, dofs, forces = efc.type.numpy(), efc.id.numpy(), efc.force.numpy()
        for env, rows in enumerate(backend.data.nefc.numpy()):
            used = np.flatnonzero(types[env, :rows] == kind)
            torque[env, dofs[env, used]] = forces[env, used]
    else:
        assert isinstance(backend, MjBatchBackend)
        data = mujoco.MjData(sim.scene.model)
        for env in range(sim.num_envs):
            backend.data(env, data)
            used = data.efc_type == kind
            torque[env, data.efc_id[used]] = data.efc_force[used]
    return torque[:, sim.scene.v_adr]


class WorkMeter:
    """Measures the work of a robot's MR devices over every physics step.

    The work is ``torque * (joint motion of the step)``. The torque is the solver's own row force (constraint coupling)
    or what was applied (explicit); the motion ``qd_next*dt`` is the engine's velocity in its own precision, and
    ``motion_gap`` checks it against the change of position.

    Attributes:
        work: Work per step, one (E, M) array each [J].
        friction_gap: Largest difference between ``sim.friction`` and the solver's row force [N·m].
        motion_gap: Largest difference between ``qd_next*dt`` and the change of q [rad].
    """

    def __init__(self, robot: ActuatedSim) -> None:
        self.robot = robot
        robot.before_hooks.append(self.before_step)
        robot.hooks.append(self.after_step)
        self.work: list[np.ndarray] = []
        self.friction_gap = self.motion_gap = 0.0
        self._start = self._positions()

    def before_step(self) -> None:
        """Note the joint positions."""
        self._start = self._positions()

    def after_step(self) -> None:
        """Book the devices' work."""
        sim, actuator = self.robot.sim, self.robot.actuator
        mr = list(actuator.mr_joints)
        motion = sim.backend.field("qvel").numpy()[:, sim.scene.v_adr].astype(np.float64) * sim.dt
        self.motion_gap = max(self.motion_gap, float(np.abs(self._positions() - self._start - motion).max()))
        if actuator.cfg.coupling is Coupling.CONSTRAINT:
            torque = solver_friction(sim)[:, mr]
            self.friction_gap = max(self.friction_gap, float(np.abs(torque - sim.friction.numpy()[:, mr]).max()))
        else:
            torque = actuator.tau_mr.numpy().astype(np.float64)
        self.work.append(torque * motion[:, mr])

    def _positions(self) -> np.ndarray:
        return self.robot.sim.backend.field("qpos").numpy()[:, self.robot.sim.scene.q_adr].copy()

    def figures(self) -> dict[str, float]:
        """Work of the devices: largest work in one step, injected and net energy per environment [J], and the gaps."""
        work, sim = np.array(self.work), self.robot.sim
        return {
            "steps": float(len(work)),
            "largest_step_work": float(work.max()),
            "injected": float(np.maximum(work, 0.0).sum() / sim.num_envs),
            "net_work": float(work.sum() / sim.num_envs),
            "friction_gap": self.friction_gap,
            "motion_gap": self.motion_gap,
            "unsolved_share": float(sim.unsolved.numpy().sum() / (sim.num_envs * len(work))),
        }

    def ledger_gap(self) -> float:
        """Largest difference between the simulator's own ledger and the meter, per device [J]; without resets only."""
        entries = self.robot.actuator.ledger.numpy()[:, list(self.robot.actuator.mr_joints)]
        net = entries[:, :, int(ledger.DYNAMIC) : int(ledger.DRAG) + 1].sum(-1)
        work = np.array(self.work)
        injected = np.maximum(work, 0.0).sum(0)
        return float(max(np.abs(net - work.sum(0)).max(), np.abs(entries[:, :, int(ledger.INJECTED)] - injected).max()))
