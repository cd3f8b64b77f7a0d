"""Passivity: an MR device only takes energy out, at every 5 ms step. Measured from the solver's own row forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from benchmarks.verify.rigs import MOTORLESS, Link, WorkMeter, link_scene, standing_robot
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.enums import Coupling
from mrwarp.env.backend import BackendKind
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.env.sim import ActuatedSim
from mrwarp.params import MrParams

DT = 0.005
"""Physics step [s], the paper's 200 Hz."""

LEVEL = 2.7
"""|tau_dyn_hat| of eq. 6 of the device that brakes it [N·m]; about what the device slides at with 1.5 A."""

FALLING_SPEED = 5.0
"""Speed of the falling link when the brake closes [rad/s]."""

ROUNDING = {BackendKind.MJBATCH: 1e-15, BackendKind.MJWARP: 1e-9}
"""Work that counts as zero over one step, by engine [J].

Where the velocity after the step vanishes, rounding leaves ``eps*|qacc|*dt`` of it, and the row answers with
``eps*|qacc|*dt/creep``: their product over a step is ``(eps*|qacc|)^2*dt^3/creep``. For 4000 rad/s^2 (an impact) that
is 7e-10 J in float32 and 2e-27 J in float64; 1e-15 J leaves room for the rounding of torque times motion.
"""


@dataclass(frozen=True, kw_only=True)
class PassivityRun:
    """One run of a rig whose devices were metered."""

    backend: BackendKind
    """The engine."""
    q: np.ndarray
    """Angle of the first MR joint after each step [rad], shape (T,)."""
    figures: dict[str, float]
    """See :meth:`WorkMeter.figures`; ``ledger_gap`` is :meth:`WorkMeter.ledger_gap`."""


def falling_link(coupling: Coupling) -> PassivityRun:
    """A 0.3 kg link passes the horizontal at 5 rad/s, falling, as a device of constant torque starts to brake it.

    The brake is five times stronger than the weight: a real one stops the link within 0.04 s and keeps it there.
    """
    mr = MrParams().replace(**MOTORLESS, D=LEVEL, B=0.0, C=0.0, I1=0.0, K0=0.0, K1=0.0)
    scene = link_scene(mr, dt=DT, link=Link(), brake=coupling is Coupling.CONSTRAINT)
    cfg = SimCfg(num_envs=1, dt=DT, keep_data=True)
    robot = ActuatedSim(scene, cfg, MrActuatorCfg(coupling=coupling, sal=False))
    robot.reset(None, qvel=wp.array([[FALLING_SPEED]], dtype=float, device="cpu"))
    return _run(robot, round(0.6 / DT))


def dropped_robot(coupling: Coupling, *, backend: BackendKind = BackendKind.MJBATCH) -> PassivityRun:
    """The robot falls on its feet from 0.3 m: one environment per current of eq. 20, 1 s."""
    return _run(standing_robot(coupling=coupling, lift=0.3, backend=backend), round(1 / DT))


def _run(robot: ActuatedSim, steps: int) -> PassivityRun:
    meter, joint, angles = WorkMeter(robot), robot.actuator.mr_joints[0], []
    for _ in range(steps):
        robot.step()
        angles.append(float(robot.sim.q.numpy()[-1, joint]))
    return PassivityRun(
        backend=robot.sim.backend.kind,
        q=np.array(angles),
        figures={**meter.figures(), "ledger_gap": meter.ledger_gap()},
    )
