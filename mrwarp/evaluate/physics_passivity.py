"""Passivity: an MR device only takes energy out, at every 5 ms step. Measured from the solver's own row forces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
import warp as wp

from mrwarp.actuator import Coupling, MrActuatorCfg
from mrwarp.env.backend import BackendKind
from mrwarp.env.cfg import make_walk_cfg
from mrwarp.env.sim import ActuatedSim, SimCfg
from mrwarp.evaluate.physics_rigs import Link, WorkMeter, link_scene, standing_robot
from mrwarp.evaluate.walking import Policy, make_env
from mrwarp.params import MrParams
from mrwarp.robot import CURRENT_GROUPS, JOINTS

DT = 0.005
"""Physics step [s], the paper's 200 Hz."""

FALLING_SPEED = 5.0
"""Speed of the falling link when the brake closes [rad/s]."""

ROUNDING = 1e-12
"""Work that counts as zero over one step [J]: far above float64 rounding (25 N·m * 1e-3 rad * 1e-16), far below use."""


@dataclass(frozen=True, kw_only=True)
class PassivityRun:
    """One run of a rig whose devices were metered."""

    name: str
    """What was run."""
    coupling: Coupling
    """How the devices acted."""
    dt: float
    """Step [s]."""
    q: np.ndarray
    """Angle of the first MR joint after each step [rad], shape (T,)."""
    work: np.ndarray
    """Work of the devices over each step [J], shape (T, E, M)."""
    figures: dict[str, float]
    """See :meth:`WorkMeter.figures`."""


def falling_link(
    coupling: Coupling, *, level: float = 2.7, seconds: float = 0.6, backend: BackendKind = BackendKind.MJBATCH
) -> PassivityRun:
    """A 0.3 kg link passes the horizontal at 5 rad/s, falling, as a device of constant torque level starts to brake it.

    The brake is five times stronger than the weight: a real one stops the link within 0.04 s and keeps it there.

    Args:
        coupling: How the device acts.
        level: |tau_dyn_hat| of eq. 6 [N·m]; 2.7 is about what the device slides at with 1.5 A.
        seconds: Length of the run [s].
        backend: The engine.
    """
    mr = MrParams().replace(kp_base=0.0, kp_low=0.0, kd=0.0, D=level, B=0.0, C=0.0, I1=0.0, K0=0.0, K1=0.0)
    scene = link_scene(mr, dt=DT, link=Link(), brake=coupling is Coupling.CONSTRAINT)
    cfg = SimCfg(num_envs=1, dt=DT, backend=backend)
    robot = ActuatedSim(scene, cfg, MrActuatorCfg(coupling=coupling, sal=False))
    robot.reset(None, qvel=wp.array([[FALLING_SPEED]], dtype=float, device="cpu"))
    return _run(f"falling link, {level:g} N·m", robot, round(seconds / DT))


def dropped_robot(
    coupling: Coupling, *, height: float = 0.3, seconds: float = 1.0, backend: BackendKind = BackendKind.MJBATCH
) -> PassivityRun:
    """The robot falls on its feet from ``height`` [m]: one environment per current of eq. 20."""
    robot = standing_robot(currents=CURRENT_GROUPS, coupling=coupling, lift=height, backend=backend)
    return _run(f"robot dropped from {height:g} m", robot, round(seconds / DT))


@torch.no_grad()
def walking_robot(coupling: Coupling, *, policy: Policy | None, seconds: float, seed: int) -> PassivityRun:
    """The robot walks with a policy at 0.4 m/s, or stands under random joint targets; one environment per current.

    Args:
        coupling: How the devices act.
        policy: What walks; None draws joint targets within 0.075 rad of the stance, new ones every 0.1 s.
        seconds: Length of the run [s].
        seed: Seed of the targets, initial poses and gait phases.
    """
    env = make_env(make_walk_cfg(num_envs=len(CURRENT_GROUPS), seed=seed, coupling=coupling), len(CURRENT_GROUPS), seed)
    meter, generator = WorkMeter(env.robot).attach(), torch.Generator().manual_seed(seed)
    env.set_command(torch.tensor([0.4, 0.0, 0.0]))
    obs, action = env.get_observations(), torch.zeros(env.num_envs, len(JOINTS))
    angles, falls = [], 0
    hold = round(0.1 / env.cfg.step_dt)
    for step in range(round(seconds / env.cfg.step_dt)):
        if policy is not None:
            action = policy(obs)
        elif step % hold == 0:
            action = 0.3 * (2.0 * torch.rand(action.shape, generator=generator) - 1.0)
        obs, _, _, _ = env.step(action)
        falls += int(env.fallen.sum())
        angles.append(float(env.q[0, env.actuator.mr_joints[0]]))
    name = "walking with the policy" if policy is not None else "standing, random joint targets"
    q = np.repeat(angles, env.cfg.decimation)
    return PassivityRun(
        name=name, coupling=coupling, dt=env.sim.dt, q=q, work=np.array(meter.work),
        figures={**meter.figures(), "falls": float(falls)},
    )  # fmt: skip


def passivity(*, seed: int, policy: Policy | None, walk_seconds: float = 20.0) -> list[PassivityRun]:
    """All rigs with both couplings, and the drop once more on MuJoCo-Warp."""
    runs = []
    for coupling in (Coupling.CONSTRAINT, Coupling.EXPLICIT):
        runs.append(falling_link(coupling))
        runs.append(dropped_robot(coupling))
        runs.append(walking_robot(coupling, policy=policy, seconds=walk_seconds, seed=seed))
    warp_run = dropped_robot(Coupling.CONSTRAINT, backend=BackendKind.MJWARP)
    return [*runs, replace(warp_run, name=f"{warp_run.name} (mjwarp)")]


def passivity_figures(runs: list[PassivityRun]) -> dict[str, Any]:
    """Figures by rig and coupling, and the verdict: no step of a constraint run does positive work."""
    figures: dict[str, Any] = {}
    for run in runs:
        figures.setdefault(run.name, {})[run.coupling.value] = run.figures
    passive = all(r.figures["largest_step_work"] <= ROUNDING for r in runs if r.coupling is Coupling.CONSTRAINT)
    return {"runs": figures, "rounding": ROUNDING, "passed": passive}


def _run(name: str, robot: ActuatedSim, steps: int) -> PassivityRun:
    meter, joint, angles = WorkMeter(robot), robot.actuator.mr_joints[0], []
    for _ in range(steps):
        meter.step()
        angles.append(float(robot.sim.q.numpy()[-1, joint]))
    return PassivityRun(
        name=name, coupling=robot.actuator.cfg.coupling, dt=robot.sim.dt, q=np.array(angles),
        work=np.array(meter.work), figures={**meter.figures(), "ledger_gap": meter.ledger_gap()},
    )  # fmt: skip
