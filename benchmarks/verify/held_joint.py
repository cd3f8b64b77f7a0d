"""Holding: a held joint creeps by microradians, lets go at tau_y, and carries the robot; and the line-search trap."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from benchmarks.verify.rigs import (
    LOADED,
    MOTORLESS,
    Link,
    Load,
    joint_inertia,
    link_scene,
    standing_robot,
    yield_torque,
)
from mrwarp.actuator import brake_constraint
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.enums import Coupling, HoldCurrent
from mrwarp.env.backend import BackendKind
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.env.sim import ActuatedSim, robot_scene
from mrwarp.env.sim_model import Scene, build_scene
from mrwarp.params import MrParams
from mrwarp.usd.asset import load_bench

DT = 0.005
"""Physics step [s]."""

CURRENT = 1.5
"""Holding current [A]; tau_y = 25.4 N·m."""

LOADS = (0.3, 0.9)
"""Loads on the held joint, shares of tau_y."""

CREEP_LIMITS = (1.0e-4, 3.0e-4)
"""Largest creep under these loads [rad/s]."""

BREAKAWAY_LIMITS = (0.99, 1.01)
"""Where the joint has to let go, shares of tau_y."""

RAMP = (0.95, 1.05)
"""Load of the break-away run, from start to end, shares of tau_y."""

MOVING = 0.05
"""Speed at which the joint counts as moving [rad/s]: 150 times the creep limit, a quarter of the gate's eps_hold."""

ANGLE_ULP = 2.0**-23
"""Spacing of float32 angles between 1 and 2 rad: MuJoCo-Warp rounds each step's motion to it [rad]."""

HOLDING = 1.0
"""Time over which creep is measured, and length of the ramp [s]."""

SETTLE, STANDING = 0.1, 1.0
"""Time before the creep is measured, and before the calf motors of the standing robot are switched off [s]."""


@dataclass(frozen=True, kw_only=True)
class HoldRun:
    """One loaded joint: creep at two loads, break-away on a ramp."""

    creep: list[float]
    """Creep under LOADS [rad/s]."""
    breakaway: float
    """Load at which the joint starts to move, share of tau_y; one end of RAMP if it always moved or never."""
    unsolved: int
    """Steps that did not converge."""


def calf_rig(*, brake: bool = True) -> Scene:
    """A balanced link with the inertia of the robot's calf; ``brake`` False keeps MuJoCo's default dry friction."""
    inertia = joint_inertia(robot_scene(), "FL_calf")
    link = Link(com=0.0, inertia=inertia)
    return link_scene(MrParams().replace(**MOTORLESS), dt=DT, link=link, brake=brake)


def bench_rig(*, brake: bool = True) -> Scene:
    """The torque bench of ``mr_bench.usda``: 0.01 kg·m^2 on a vertical axis."""
    coupling = Coupling.CONSTRAINT if brake else Coupling.EXPLICIT
    return build_scene(load_bench(), dt=DT, coupling=coupling, ground=False)


def hold(scene: Scene, backend: BackendKind, *, brake: bool = True) -> HoldRun:
    """Load a held joint: two environments at LOADS, a third on the ramp.

    Args:
        scene: A rig with one MR joint and no weight.
        backend: The engine.
        brake: Whether the scene has the brake constraint. Without it the joint creeps faster than the holding gate
            allows: the gate is kept open at any speed.
    """
    mr = scene.actuators[0].mr
    assert mr is not None
    tau_y, steps, settle = yield_torque(mr, CURRENT), round(HOLDING / DT), round(SETTLE / DT)
    cfg = SimCfg(num_envs=3, dt=DT, backend=backend)
    robot = ActuatedSim(scene, cfg, MrActuatorCfg(hold_current=HoldCurrent.FIXED))
    outside = Load(robot)
    robot.sim.f_foot.fill_(LOADED)
    robot.current_e.fill_(CURRENT)
    if not brake:
        for threshold in ("eps_hold", "eps_e"):
            robot.actuator.set_param(threshold, 1e6)
    load, q = np.zeros((settle + steps, 3)), np.zeros((settle + steps, 3))
    ramp = np.zeros((settle + steps, 2))
    load[:, :2] = LOADS
    load[:, 2] = RAMP[0] + (RAMP[1] - RAMP[0]) * np.clip(np.arange(-settle, steps) / steps, 0.0, 1.0)
    for step in range(settle + steps):
        outside.set(load[step] * tau_y)
        robot.step()
        q[step] = robot.sim.q.numpy()[:, 0]
        ramp[step] = load[step, 2], robot.sim.qd.numpy()[2, 0]
    moving = np.flatnonzero(np.abs(ramp[:, 1]) > MOVING)
    return HoldRun(
        creep=((q[-1] - q[settle - 1]) / (steps * DT))[:2].tolist(),
        breakaway=float(ramp[moving[0] if moving.size else -1, 0]),
        unsolved=int(robot.sim.unsolved.numpy().sum()),
    )


@dataclass(frozen=True, kw_only=True)
class StandRun:
    """The robot on its four brakes, calf motors off."""

    backend: BackendKind
    """The engine."""
    calf: np.ndarray
    """Calf angles after the motors were switched off [rad], shape (T, 4)."""
    height: np.ndarray
    """Trunk height [m], shape (T,)."""
    torque: np.ndarray
    """Mean brake torques [N·m], shape (4,)."""
    unsolved: int
    """Steps that did not converge."""

    @property
    def expected_drift(self) -> np.ndarray:
        """Drift that the constraint's creep predicts for the measured torques [rad], shape (4,)."""
        return brake_constraint.CREEP * np.abs(self.torque) * len(self.calf) * DT

    @property
    def drift_tolerance(self) -> np.ndarray:
        """How far the drift may be from the expected one [rad], shape (4,).

        1 % for torques that change over time. MuJoCo-Warp also rounds each step's motion, about 2e-7 rad, to a multiple
        of the spacing of float32 angles: up to half of one is lost or gained per step.
        """
        rounding = len(self.calf) * ANGLE_ULP / 2.0 if self.backend is BackendKind.MJWARP else ANGLE_ULP
        return 0.01 * self.expected_drift + rounding


def stand_on_brakes(backend: BackendKind, *, seconds: float = 10.0, ls_iterations: int = 50) -> StandRun:
    """The robot stands on its four brakes alone: zero calf stiffness and damping, hips and thighs under PD.

    It settles with stiff calf motors while the devices already hold; then the calf motors are switched off.

    Args:
        backend: The engine.
        seconds: Time without calf motors [s].
        ls_iterations: Line-search iterations forced on the model, past the check of ``SolverCfg``.
    """

    def options(model: mujoco.MjModel) -> None:
        model.opt.ls_iterations = ls_iterations

    robot = standing_robot((CURRENT,), backend=backend, options=options)
    robot.actuator.set_param("kp_low", robot.actuator.param("kp_base").numpy())
    for _ in range(round(STANDING / DT)):
        robot.step()
    for name, value in MOTORLESS.items():
        robot.actuator.set_param(name, value)
    calves, sim = list(robot.actuator.mr_joints), robot.sim
    calf, height, torque = [], [], []
    for _ in range(round(seconds / DT)):
        robot.step()
        calf.append(sim.q.numpy()[0, calves].astype(np.float64))
        height.append(float(sim.root_pos.numpy()[0, 2]))
        torque.append(sim.friction.numpy()[0, calves].astype(np.float64))
    return StandRun(
        backend=backend,
        calf=np.array(calf),
        height=np.array(height),
        torque=np.mean(torque, axis=0),
        unsolved=int(sim.unsolved.numpy().sum()),
    )
