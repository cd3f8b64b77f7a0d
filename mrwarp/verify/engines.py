"""Do the engines agree, and are runs the same bits: float32 against float64, captured or eager, alone or in a batch.

Tolerance of the engines' agreement, a priori. Both engines solve ``M*qacc = forces`` at every step. In float32 the
solution carries a relative error of at most about ``kappa(M)*eps32`` (condition number of the inertia matrix times
2^-24), so that one step adds

    delta = dt * kappa(M) * eps32 * max|qacc| + eps32 * max|qvel|

to the velocities. How a small velocity error grows until the end of the run is measured, not assumed: the float64
engine repeats the run from velocities perturbed by PERTURBATION, which gives the amplifications A_v = max|d qvel| /
PERTURBATION and A_q = max|d qpos| / PERTURBATION [s]. The tolerances after n steps are ``A_v * sum(delta)`` and
``A_q * sum(delta) + n * eps32 * max|qpos|``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
import torch
import warp as wp

from mrwarp.env.backend import BackendKind
from mrwarp.env.cfg import make_walk_cfg
from mrwarp.env.sim import ActuatedSim, Sim, SimCfg, robot_scene
from mrwarp.env.sim_model import Scene
from mrwarp.env.vec_env import WalkEnv
from mrwarp.usd.robot import DEFAULT_Q
from mrwarp.verify.rigs import mass_matrix, stance

EPS32 = 2.0**-24
"""Largest relative rounding error of a float32."""

PERTURBATION = 1e-6
"""Change of the velocities that measures their amplification [rad/s, m/s]."""

DIRECTIONS = 8
"""Random directions of that change."""

STEPS = 20
"""Compared steps: 100 ms."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A start and what is applied from there."""

    name: str
    """What it shows."""
    qpos: np.ndarray
    """Positions, float32 values, shape (nq,)."""
    qvel: np.ndarray
    """Velocities, float32 values, shape (nv,)."""
    bound: float
    """Brake bound of the calves [N·m]."""


def cases(scene: Scene, seed: int) -> list[Case]:
    """In the air with tumbling limbs, standing held by the brakes, and one foot-fall at 1 m/s on uneven legs."""
    rng = np.random.default_rng(seed)
    rest, joints = stance(scene, 1).numpy()[0], len(scene.actuators)
    at_rest = np.zeros(scene.model.nv)
    air, tumbling = rest.copy(), rng.uniform(-2.0, 2.0, scene.model.nv)
    air[2] = 1.0
    air[scene.q_adr] += rng.uniform(-0.3, 0.3, joints)
    landing, falling = rest.copy(), at_rest.copy()
    landing[2] += 0.03
    landing[scene.q_adr] += rng.uniform(-0.1, 0.1, joints)
    falling[2], falling[scene.v_adr] = -1.0, rng.uniform(-1.0, 1.0, joints)
    starts = [
        ("in the air", air, tumbling, 3.0),
        ("standing", rest, at_rest, 25.0),
        ("foot-fall", landing, falling, 3.0),
    ]
    return [
        Case(name=name, qpos=qpos.astype(np.float32), qvel=qvel.astype(np.float32), bound=bound)
        for name, qpos, qvel, bound in starts
    ]


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Differences between the engines in one case."""

    name: str
    """The case."""
    difference: np.ndarray
    """Largest |d qpos| [m, rad] and |d qvel| [m/s, rad/s] after each step, shape (STEPS, 2)."""
    tolerance: np.ndarray
    """Their a-priori tolerances, shape (STEPS, 2)."""
    amplification: tuple[float, float]
    """A_q [s] and A_v [1]."""
    condition: float
    """kappa(M)."""
    foot_force: float
    """Largest foot force [N]."""

    def figures(self) -> dict[str, Any]:
        """The plain numbers."""
        names = ("qpos", "qvel")
        return {
            "after_1_step": dict(zip(names, self.difference[0].tolist(), strict=True)),
            "after_100_ms": dict(zip(names, self.difference[-1].tolist(), strict=True)),
            "tolerance_1_step": dict(zip(names, self.tolerance[0].tolist(), strict=True)),
            "tolerance_100_ms": dict(zip(names, self.tolerance[-1].tolist(), strict=True)),
            "amplification": list(self.amplification),
            "condition": self.condition,
            "foot_force": self.foot_force,
        }


def agreement(*, seed: int) -> list[Agreement]:
    """Step both engines from the same states under the same torques and compare them; see the head of this file."""
    scene = robot_scene()
    exact = Sim(scene, SimCfg(num_envs=1 + DIRECTIONS))
    single = Sim(scene, SimCfg(num_envs=1, backend=BackendKind.MJWARP))
    rng = np.random.default_rng(seed)
    return [_compare(case, exact, single, rng) for case in cases(scene, seed)]


def captured_equals_eager(counts: tuple[int, ...] = (1, 2, 3, 5)) -> dict[int, bool]:
    """Whether captured steps of MuJoCo-Warp leave the same bits as eager ones, by steps per launch."""
    captured, eager = (_robot(SimCfg(num_envs=2, backend=BackendKind.MJWARP, capture=c)) for c in (True, False))
    return {count: _same_after(captured, eager, count) for count in counts}


def alone_equals_batch(backend: BackendKind, *, steps: int = 60) -> float:
    """Largest difference of any state between an environment in a batch of three and the same one alone."""
    batch, alone = (_robot(SimCfg(num_envs=count, backend=backend)) for count in (3, 1))
    starts, currents = _landing(batch), np.array([0.0, 0.5, 1.5], dtype=np.float32)
    batch.current_e.assign(currents)
    _restart(batch, starts)
    for _ in range(steps):
        batch.step()
    together, worst = _everything(batch), 0.0
    for env in range(3):
        alone.current_e.fill_(float(currents[env]))
        _restart(alone, starts[env : env + 1])
        for _ in range(steps):
            alone.step()
        for name, value in _everything(alone).items():
            worst = max(worst, float(np.abs(value[0].astype(np.float64) - together[name][env]).max(initial=0.0)))
    return worst


@torch.no_grad()
def same_at_any_thread_count(*, seed: int, steps: int = 200, num_envs: int = 16) -> bool:
    """Whether 200 policy steps of random actions give the same bits at one and two threads (``mjbatch``)."""
    runs = []
    for threads in (1, 2):
        cfg = make_walk_cfg(num_envs=num_envs, seed=seed, threads=threads)
        env, generator = WalkEnv(replace(cfg, episode_seconds=2.0)), torch.Generator().manual_seed(seed)
        history = []
        for _ in range(steps):
            obs, reward, done, _ = env.step(torch.randn(num_envs, env.num_actions, generator=generator))
            history.append(torch.cat([obs["actor"], obs["critic"], reward[:, None], done[:, None].float()], dim=1))
        runs.append(torch.stack(history))
    return torch.equal(*runs)


def bit_figures(*, seed: int) -> dict[str, Any]:
    """All questions of sameness, answered."""
    captured = captured_equals_eager()
    alone = {kind.value: alone_equals_batch(kind) for kind in BackendKind}
    threads = same_at_any_thread_count(seed=seed)
    return {
        "captured_equals_eager": {str(count): same for count, same in captured.items()},
        "alone_minus_batch": alone,
        "same_at_1_and_2_threads": threads,
    }


def _compare(case: Case, exact: Sim, single: Sim, rng: np.random.Generator) -> Agreement:
    """Run one case on both engines; ``exact`` also carries the perturbed runs in its further environments."""
    scene, dt = exact.scene, exact.dt
    for sim in (exact, single):
        tile = np.tile(case.qpos, (sim.num_envs, 1)), np.tile(case.qvel, (sim.num_envs, 1))
        sim.reset(None, *(wp.array(values, dtype=float, device="cpu") for values in tile))
    qvel = exact.backend.field("qvel").numpy()
    qvel[1:] += PERTURBATION * rng.choice([-1.0, 1.0], (DIRECTIONS, scene.model.nv))

    data = mujoco.MjData(scene.model)
    data.qpos[:] = case.qpos
    mujoco.mj_forward(scene.model, data)
    condition = float(np.linalg.cond(mass_matrix(scene.model, data)))

    bound = np.array([case.bound if actuator.mr else 0.0 for actuator in scene.actuators])
    apply = {sim: _applier(sim, bound) for sim in (exact, single)}
    difference, added, amplification, force = np.zeros((STEPS, 2)), np.zeros((STEPS, 2)), np.zeros(2), 0.0
    for step in range(STEPS):
        tau = 35.0 * (np.array(DEFAULT_Q) - exact.q.numpy()[0]) - 0.6 * exact.qd.numpy()[0]
        for sim in (exact, single):
            apply[sim](tau)
        for column, name in enumerate(("qpos", "qvel")):
            runs = exact.backend.field(name).numpy()
            difference[step, column] = np.abs(single.backend.field(name).numpy()[0] - runs[0]).max()
            amplification[column] = max(amplification[column], np.abs(runs[1:] - runs[0]).max() / PERTURBATION)
        qacc = np.abs(exact.backend.field("qacc").numpy()[0]).max()
        added[step, 0] = EPS32 * np.abs(exact.backend.field("qpos").numpy()[0]).max()
        added[step, 1] = dt * condition * EPS32 * qacc + EPS32 * np.abs(qvel[0]).max()
        force = max(force, float(exact.f_foot.numpy()[0].max()))
    velocity_errors = np.cumsum(added[:, 1])[:, None]
    tolerance = amplification * velocity_errors + np.stack([np.cumsum(added[:, 0]), np.zeros(STEPS)], axis=1)
    return Agreement(
        name=case.name, difference=difference, tolerance=tolerance, condition=condition, foot_force=force,
        amplification=(float(amplification[0]), float(amplification[1])),
    )  # fmt: skip


def _applier(sim: Sim, bound: np.ndarray) -> Callable[[np.ndarray], None]:
    """A function that steps ``sim`` under joint torques (J,), the same in every environment."""
    shape = (sim.num_envs, len(bound))
    tau_array = wp.zeros(shape, dtype=float, device="cpu")
    bound_array = wp.array(np.tile(bound, (sim.num_envs, 1)), dtype=float, device="cpu")

    def apply(tau: np.ndarray) -> None:
        tau_array.assign(np.tile(tau, (sim.num_envs, 1)).astype(np.float32))
        sim.step(tau_array, bound_array)

    return apply


def _robot(cfg: SimCfg) -> ActuatedSim:
    robot = ActuatedSim(robot_scene(None, cfg), cfg)
    robot.q_des.assign(np.tile(np.array(DEFAULT_Q, dtype=np.float32), (cfg.num_envs, 1)))
    robot.current_e.fill_(1.0)
    return robot


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


def _same_after(captured: ActuatedSim, eager: ActuatedSim, count: int, launches: int = 12) -> bool:
    """Whether both robots hold the same bits after ``launches`` times ``count`` steps from the same foot-fall."""
    for robot in (captured, eager):
        _restart(robot, _landing(robot))
        for _ in range(launches):
            robot.step(count)
    left, right = _everything(captured), _everything(eager)
    return all(np.array_equal(left[name], right[name]) for name in left)


def _everything(robot: ActuatedSim) -> dict[str, np.ndarray]:
    """Copies of all that a step reads or writes, environments first."""
    sim, actuator = robot.sim, robot.actuator
    names = ("q", "qd", "friction", "f_foot", "root_pos", "root_quat", "root_vel", "root_ang", "residual", "unsolved")
    fields = ("qpos", "qvel", "qacc_warmstart", "qfrc_applied", "qacc")
    state = {name: value for name, value in actuator.state().items() if name not in ("head", "params")}
    state |= {name: getattr(sim, name).numpy().copy() for name in names}
    state |= {name: getattr(actuator, name).numpy().copy() for name in ("tau", "tau_motor", "bound")}
    return state | {name: sim.backend.field(name).numpy().copy() for name in fields}
