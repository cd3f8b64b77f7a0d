"""How the whole robot's motion converges when the step is made smaller: in the air, and landing on its feet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from benchmarks.verify.rigs import convergence_order, root_mean_square, stance
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.env.sim import ActuatedSim, robot_scene
from mrwarp.usd.robot import CURRENT_GROUPS, DEFAULT_Q

STEPS = (0.005, 0.0025, 0.00125)
"""Compared steps [s]; all of them, torque loop included."""

REFERENCE_DT = 0.005 / 128
"""Step of the reference [s]; its own error lifts the observed order by 0.02."""

SECONDS = 0.15
"""Length of a run [s]."""

NUM_RUNS = 4
"""Runs with different targets and starts."""

CASES = ("in the air", "landing")
"""Legs on the move in a tumbling robot; a fall of 2 cm onto the feet. Gates closed: devices drag as without current."""


@dataclass(frozen=True, kw_only=True)
class Order:
    """Errors against the reference in one case."""

    name: str
    """The case."""
    rms: np.ndarray
    """RMS over runs and time by step: positions [m, rad] and velocities [m/s, rad/s], shape (len(STEPS), 2)."""
    reference_error: np.ndarray
    """RMS change of the reference when its step is doubled, shape (2,)."""

    @property
    def order(self) -> np.ndarray:
        """Observed order of convergence: positions, velocities."""
        return convergence_order(STEPS, self.rms)


def orders(*, seed: int) -> list[Order]:
    """Run both cases at every step."""
    return [_order(name, seed) for name in CASES]


def _order(name: str, seed: int) -> Order:
    truth, coarser = _path(name, REFERENCE_DT, seed), _path(name, 2.0 * REFERENCE_DT, seed)
    errors = np.array([_rms(_path(name, dt, seed), truth) for dt in STEPS])
    return Order(name=name, rms=errors, reference_error=_rms(coarser, truth))


Motion = tuple[np.ndarray, np.ndarray]
"""Positions and velocities of all runs every 5 ms, shapes (T, NUM_RUNS, nq) and (T, NUM_RUNS, nv)."""


def _path(name: str, dt: float, seed: int) -> Motion:
    """Simulate all runs at a step."""
    rng = np.random.default_rng(seed)
    cfg = SimCfg(num_envs=NUM_RUNS, dt=dt, threads=1)
    scene = robot_scene(None, cfg)
    # a gate that opens is an event: runs of different steps part company where one of them just misses it
    robot = ActuatedSim(scene, cfg, MrActuatorCfg(sal=False))
    robot.current_e.assign(np.resize(CURRENT_GROUPS, NUM_RUNS).astype(np.float32))
    flying = name == "in the air"
    qpos = stance(scene, NUM_RUNS, lift=5.0 if flying else 0.02)
    qvel = np.zeros((NUM_RUNS, scene.model.nv), dtype=np.float32)
    swing = rng.uniform(-1.0, 1.0, (NUM_RUNS, len(scene.actuators)))
    qvel[:, 3:6] = rng.uniform(-2.0, 2.0, (NUM_RUNS, 3)) if flying else 0.0
    robot.q_des.assign((np.array(DEFAULT_Q) + (0.5 if flying else 0.1) * swing).astype(np.float32))
    robot.reset(None, qpos, wp.array(qvel, dtype=float, device="cpu"))
    fields, path = [robot.sim.backend.field(field).numpy() for field in ("qpos", "qvel")], []
    for _ in range(round(SECONDS / STEPS[0])):
        robot.step(round(STEPS[0] / dt))
        path.append([field.copy() for field in fields])
    qpos_path, qvel_path = zip(*path, strict=True)
    return np.array(qpos_path), np.array(qvel_path)


def _rms(path: Motion, truth: Motion) -> np.ndarray:
    return np.array([root_mean_square(a - b) for a, b in zip(path, truth, strict=True)])
