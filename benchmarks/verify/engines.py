"""Do the engines agree, and are runs the same bits: float32 against float64, alone or in a batch.

Tolerance of the engines' agreement, a priori. Both engines solve ``M*qacc = forces`` at every step. In float32 the
solution carries a relative error of at most about ``kappa(M)*eps32`` (condition number of the inertia matrix times
2^-24), so that one step adds

    delta = dt * kappa(M) * eps32 * max|qacc| + eps32 * max|qvel|

to the velocities. One step from random states is compared.

Where a capsule stands on the ground, steeper than 60 degrees, the engines build different contacts: MuJoCo lays the
first tangent along its axis, MuJoCo-Warp along the world's y axis (google-deepmind/mujoco issue 2774). The friction
pyramid then stands otherwise, and the velocities differ by up to its anisotropy. It takes a thigh or calf upright in
the ground: a robot that lies on its back or side. Such states are counted separately.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import warp as wp

from benchmarks.verify.rigs import mass_matrix, stance, standing_robot
from mrwarp.env.backend import BackendKind
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.env.sim import ActuatedSim, Sim, robot_scene
from mrwarp.env.sim_model import Scene
from mrwarp.usd.robot import DEFAULT_Q

EPS32 = 2.0**-24
"""Largest relative rounding error of a float32."""

GROUPS = {"in the air": 400, "on its feet": 400, "lying": 200}
"""Number of random states by group; together 1,000."""

QUANTITIES = ("qpos", "qvel", "qacc", "foot force")
"""Quantities compared at random states: [m, rad], [m/s, rad/s], [m/s², rad/s²], [N]."""

STEEP = 0.5
"""Horizontal part of a unit capsule axis below which MuJoCo-Warp takes another tangent [1]."""

TORQUE = 20.0
"""Largest random joint torque [N·m]."""

BOUNDS = (0.0, 3.0, 25.0)
"""Brake bounds of the calves: off, sliding, held at 1.5 A [N·m]."""

DEPTH = 0.01
"""Largest depth of the lowest point in the ground [m]: 0.2 mm is what standing gives, a foot-fall 2 mm."""


@dataclass(frozen=True, kw_only=True)
class StateAgreement:
    """Differences after one step from the states of a group; N states."""

    name: str
    """The group."""
    difference: dict[str, np.ndarray]
    """Largest difference per state by quantity, shape (N,) each."""
    size: dict[str, np.ndarray]
    """Largest value per state, shape (N,) each."""
    tolerance: np.ndarray
    """A-priori tolerance of the velocities [m/s, rad/s], shape (N,)."""
    steep: np.ndarray
    """States with a steep capsule in the ground, bool, shape (N,)."""
    contacts: np.ndarray
    """Contacts per state, shape (N,)."""
    limits: np.ndarray
    """Joints at their limits per state, shape (N,)."""


def state_agreement(*, seed: int) -> list[StateAgreement]:
    """Step both engines once from every random state, under random joint torques and brake bounds, and compare."""
    scene, rng = robot_scene(), np.random.default_rng(seed)
    return [_compare_states(name, count, scene, rng) for name, count in GROUPS.items()]


def _compare_states(name: str, count: int, scene: Scene, rng: np.random.Generator) -> StateAgreement:
    model, joints = scene.model, len(scene.actuators)
    qpos, qvel = _draw(name, count, scene, rng)
    tau = rng.uniform(-TORQUE, TORQUE, (count, joints))
    bound = rng.choice(BOUNDS, (count, joints)) * np.array([actuator.mr is not None for actuator in scene.actuators])
    found = {kind: _one_step(scene, kind, qpos, qvel, tau, bound) for kind in BackendKind}
    exact, single = found[BackendKind.MJBATCH], found[BackendKind.MJWARP]

    condition, steep = np.zeros(count), np.zeros(count, dtype=bool)
    contacts, limits = np.zeros(count, dtype=int), np.zeros(count, dtype=int)
    data = mujoco.MjData(model)
    for i in range(count):
        data.qpos[:] = qpos[i]
        mujoco.mj_forward(model, data)
        condition[i] = np.linalg.cond(mass_matrix(model, data))
        steep[i] = any(_is_steep(model, data, int(contact.geom.max())) for contact in data.contact)
        contacts[i] = data.ncon
        limits[i] = (data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)).sum()
    size = {quantity: np.abs(values).max(axis=1) for quantity, values in exact.items()}
    return StateAgreement(
        name=name,
        difference={quantity: np.abs(exact[quantity] - single[quantity]).max(axis=1) for quantity in QUANTITIES},
        size=size,
        tolerance=model.opt.timestep * condition * EPS32 * size["qacc"] + EPS32 * np.abs(qvel).max(axis=1),
        steep=steep,
        contacts=contacts,
        limits=limits,
    )


def _draw(name: str, count: int, scene: Scene, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Random states, float32, shapes (N, nq) and (N, nv); those that touch reach up to DEPTH into the ground."""
    model, joints = scene.model, len(scene.actuators)
    qpos, qvel = np.tile(stance(scene, 1).numpy()[0], (count, 1)), np.zeros((count, model.nv))
    upright = name == "on its feet"
    axis, angle = rng.normal(size=(count, 3)), (0.3 if upright else np.pi) * rng.uniform(-1.0, 1.0, (count, 1))
    axis *= np.sin(0.5 * angle) / np.linalg.norm(axis, axis=1, keepdims=True)
    qpos[:, 3:7] = np.concatenate([np.cos(0.5 * angle), axis], axis=1)
    if upright:
        qpos[:, scene.q_adr] = np.array(DEFAULT_Q) + rng.uniform(-0.4, 0.4, (count, joints))
    else:
        # a little beyond the limits: one state in five has a joint there
        low, high = model.jnt_range[[int(np.flatnonzero(model.jnt_qposadr == adr)[0]) for adr in scene.q_adr]].T
        qpos[:, scene.q_adr] = rng.uniform(low - 0.03, high + 0.03, (count, joints))
    qpos[:, 2] = 5.0
    if name != "in the air":
        data = mujoco.MjData(model)
        for state in qpos:
            data.qpos[:] = state
            mujoco.mj_kinematics(model, data)
            state[2] -= _lowest(model, data) + rng.uniform(0.0, DEPTH)
    qvel[:, :3], qvel[:, 3:6] = rng.uniform(-1.0, 1.0, (count, 3)), rng.uniform(-3.0, 3.0, (count, 3))
    qvel[:, scene.v_adr] = rng.uniform(-8.0, 8.0, (count, joints))
    return qpos.astype(np.float32), qvel.astype(np.float32)


def _one_step(
    scene: Scene, kind: BackendKind, qpos: np.ndarray, qvel: np.ndarray, tau: np.ndarray, bound: np.ndarray
) -> dict[str, np.ndarray]:
    """All states one step later, by quantity, float64, shape (N, ...)."""
    sim = Sim(scene, SimCfg(num_envs=len(qpos), backend=kind, threads=1))
    qpos_in, qvel_in, tau_in, bound_in = (wp.array(x, dtype=float, device="cpu") for x in (qpos, qvel, tau, bound))
    sim.reset(None, qpos_in, qvel_in)
    sim.step(tau_in, bound_in)
    fields = {name: sim.backend.field(name) for name in ("qpos", "qvel", "qacc")}
    return {name: array.numpy().astype(np.float64) for name, array in (fields | {"foot force": sim.f_foot}).items()}


def _is_steep(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> bool:
    """Whether a geom is a capsule within 30 degrees of the vertical."""
    is_capsule = model.geom_type[geom] == int(mujoco.mjtGeom.mjGEOM_CAPSULE)
    return bool(is_capsule and np.hypot(*data.geom_xmat[geom].reshape(3, 3)[:2, 2]) < STEEP)


def _lowest(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Height of the robot's lowest point [m]; it is made of spheres, capsules and boxes."""
    heights = []
    for geom in range(model.ngeom):
        size, vertical = model.geom_size[geom], np.abs(data.geom_xmat[geom].reshape(3, 3)[2])
        below = {
            int(mujoco.mjtGeom.mjGEOM_SPHERE): size[0],
            int(mujoco.mjtGeom.mjGEOM_CAPSULE): size[0] + size[1] * vertical[2],
            int(mujoco.mjtGeom.mjGEOM_BOX): vertical @ size,
        }.get(int(model.geom_type[geom]))
        if below is not None:
            heights.append(data.geom_xpos[geom][2] - below)
    return float(min(heights))


def alone_equals_batch(backend: BackendKind) -> float:
    """Largest difference of any state between an environment in a batch of three and the same one alone."""
    currents = (0.0, 0.5, 1.5)
    batch, alone = (standing_robot(own, backend=backend) for own in (currents, currents[:1]))
    starts = _landing(batch)
    _restart(batch, starts)
    for _ in range(60):
        batch.step()
    together, worst = _everything(batch), 0.0
    for env in range(3):
        alone.current_e.fill_(currents[env])
        _restart(alone, starts[env : env + 1])
        for _ in range(60):
            alone.step()
        for name, value in _everything(alone).items():
            worst = max(worst, float(np.abs(value[0].astype(np.float64) - together[name][env]).max(initial=0.0)))
    return worst


def _landing(robot: ActuatedSim) -> np.ndarray:
    """A different foot-fall in every environment, shape (E, nq)."""
    starts = stance(robot.sim.scene, robot.sim.num_envs, lift=0.02).numpy()
    starts[:, 2] += 0.01 * np.arange(len(starts))
    starts[:, robot.sim.scene.q_adr] += 0.05 * np.arange(len(starts))[:, None]
    return starts


def _restart(robot: ActuatedSim, starts: np.ndarray) -> None:
    """Start all over from positions of shape (E, nq): also what a reset leaves alone, counter and place in the ring."""
    robot.sim.unsolved.zero_()
    robot.actuator.head.zero_()
    robot.reset(None, wp.array(starts, dtype=float, device="cpu"))


def _everything(robot: ActuatedSim) -> dict[str, np.ndarray]:
    """Copies of all that a step reads or writes, environments first."""
    sim, actuator = robot.sim, robot.actuator
    names = ("q", "qd", "friction", "f_foot", "root_pos", "root_quat", "root_vel", "root_ang", "residual", "unsolved")
    fields = ("qpos", "qvel", "qacc_warmstart", "qfrc_applied", "qacc")
    state = {name: value for name, value in actuator.state().items() if name not in ("head", "params")}
    state |= {name: getattr(sim, name).numpy().copy() for name in names}
    state |= {name: getattr(actuator, name).numpy().copy() for name in ("tau", "tau_motor", "bound")}
    return state | {name: sim.backend.field(name).numpy().copy() for name in fields}
