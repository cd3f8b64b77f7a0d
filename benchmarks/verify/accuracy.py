"""Accuracy: one MR joint at 5 ms against a 50 µs reference with true stick, for both couplings and several steps.

The reference is written in NumPy float64 and shares no code with the kernels: eqs. 14 and 15, and a friction that
stops the joint where its bound allows. Joint, loads, currents and start are the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from benchmarks.verify.rigs import LOADED, MOTORLESS, Link, Load, link_scene, root_mean_square
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.enums import Coupling
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.env.sim import ActuatedSim
from mrwarp.params import MrParams

SECONDS = 2.0
"""Length of a run [s]."""

SEGMENT = 0.25
"""Time between current steps [s]; a multiple of every step compared."""

REFERENCE_DT = 5e-5
"""Step of the reference [s]."""

STEPS = (0.01, 0.005, 0.0025, 0.001)
"""Steps compared [s]."""

HANGING = float(np.float32(np.pi / 2.0))
"""Start: the link hangs at rest [rad]."""

JOINT = MrParams().replace(**MOTORLESS, f_th=0.0, eps_e=0.0, eps_v=0.0, q_neutral=HANGING)
"""The paper's device without a motor; thresholds of the dynamic gate at zero, so that the current profile flows."""

LINK = Link()
"""The joint's load: a 0.3 kg rod of 0.4 m."""


@dataclass(frozen=True, kw_only=True)
class Profile:
    """Loads and currents of a batch of runs, drawn at random; E runs."""

    amplitude: np.ndarray
    """Amplitudes of two sinusoidal loads [N·m], shape (2, E)."""
    frequency: np.ndarray
    """Their frequencies [Hz], shape (2, E)."""
    pulse_at: np.ndarray
    """Start of a pulse of PULSE over 20 ms, an impact [s], shape (E,)."""
    currents: np.ndarray
    """Coil current per segment [A], shape (segments, E)."""

    PULSE = 10.0
    PULSE_SECONDS = 0.02

    @classmethod
    def draw(cls, num_envs: int, seed: int) -> Profile:
        """Random profiles; the currents are those of eq. 20 in random order."""
        rng = np.random.default_rng(seed)
        segments = round(SECONDS / SEGMENT)
        return cls(
            amplitude=rng.uniform(0.5, 1.5, (2, num_envs)),
            frequency=rng.uniform(0.5, 3.0, (2, num_envs)),
            pulse_at=0.01 * rng.integers(50, 150, num_envs),
            currents=rng.choice([0.0, 0.5, 1.0, 1.5], (segments, num_envs)),
        )

    def load(self, time: np.ndarray) -> np.ndarray:
        """Load at times of shape (T,) [N·m], shape (T, E)."""
        angle = 2.0 * np.pi * self.frequency * time[:, None, None]
        since = time[:, None] - self.pulse_at
        pulse = (since >= 0.0) & (since < self.PULSE_SECONDS)
        return (self.amplitude * np.sin(angle)).sum(axis=1) + self.PULSE * pulse

    def current(self, time: np.ndarray) -> np.ndarray:
        """Coil current at times of shape (T,) [A], shape (T, E)."""
        return self.currents[np.minimum(time / SEGMENT, len(self.currents) - 1).astype(int)]


def middles(dt: float) -> np.ndarray:
    """Middle of every step [s], where profiles are sampled: sampling them costs no accuracy."""
    return (np.arange(round(SECONDS / dt)) + 0.5) * dt


def reference(profile: Profile, dt: float) -> np.ndarray:
    """The joint with true stick, shape (T + 1, E, 2): angle [rad] and velocity [rad/s] at every step.

    ``J*qdd = load + weight - f``, with ``|f| <= |tau_BW|`` and f is the friction that keeps the joint at rest where
    that suffices. Time stepping after Moreau: the free velocity, then as much friction as stops it, at most the bound.
    """
    p, num_envs = JOINT.bouc_wen, profile.pulse_at.size
    loads, currents = profile.load(middles(dt)), profile.current(middles(dt))
    steps = len(loads)
    q, qd, z = np.full(num_envs, HANGING), np.zeros(num_envs), np.zeros(num_envs)
    path = np.zeros((steps + 1, num_envs, 2))
    path[0, :, 0] = q
    for step in range(steps):
        current, speed = currents[step], np.abs(qd)
        z = z + dt * (qd - p.beta * speed * z - p.gamma * qd * np.abs(z))
        q_c = q - p.q_neutral - (p.q_offset + p.q_center)
        hysteretic = (p.K0 + p.K1 * current) / (1.0 + p.alpha * speed) * z
        bound = np.abs(p.D + p.B * qd + p.C * q_c + p.I1 * current + hysteretic) * dt / LINK.inertia
        free = qd + dt * (loads[step] + LINK.weight_torque * np.cos(q)) / LINK.inertia
        qd = np.sign(free) * np.maximum(np.abs(free) - bound, 0.0)
        q = q + dt * qd
        path[step + 1, :, 0], path[step + 1, :, 1] = q, qd
    return path


def simulated(profile: Profile, coupling: Coupling, dt: float) -> np.ndarray:
    """The simulator's joint under the same profile, as :func:`reference` returns it.

    The joint target is kept behind the motion, which holds the dynamic gate of eq. 5 open: the coil carries the
    profile's current at every step.
    """
    num_envs = profile.pulse_at.size
    loads, currents = profile.load(middles(dt)), profile.current(middles(dt)).astype(np.float32)
    robot, outside, qpos, qvel = _loaded_link(LINK, coupling, dt, np.full(num_envs, HANGING))
    path = np.zeros((len(loads) + 1, num_envs, 2))
    path[0, :, 0] = qpos[:, 0]
    for step, (load, current) in enumerate(zip(loads, currents, strict=True)):
        robot.current_e.assign(current)
        robot.q_des.assign((qpos - np.sign(qvel)).astype(np.float32))
        outside.set(load)
        robot.step()
        path[step + 1] = np.stack([qpos[:, 0], qvel[:, 0]], axis=1)
    return path


def hysteresis_kept(coupling: Coupling, dt: float = 0.005) -> float:
    """Share of the hysteresis state z that is left after 0.5 s at rest under a third of the sliding torque.

    A joint at rest keeps z, and with it the torque that holds it. An explicit torque makes the joint chatter by
    ``tau*dt/J`` instead, and eq. 15 wears z down at ``beta*|qd|``: the brake lets go.
    """
    robot, outside, qpos, qvel = _loaded_link(Link(com=0.0), coupling, dt, np.zeros(1))
    robot.current_e.fill_(1.5)
    z = []
    for step in range(round(1.0 / dt)):
        outside.set(np.array([6.0 if step * dt < 0.1 else 1.0]))  # sets it going, then only loads it
        robot.q_des.assign((qpos - np.sign(qvel)).astype(np.float32))
        robot.step()
        z.append(float(robot.actuator.z.numpy()[0, 0]))
    return z[-1] / z[round(0.5 / dt)]


def _loaded_link(
    link: Link, coupling: Coupling, dt: float, start: np.ndarray
) -> tuple[ActuatedSim, Load, np.ndarray, np.ndarray]:
    """The joint at rest at ``start`` [rad], shape (E,), its gates on a loaded leg; its load; live views of q and qd."""
    scene = link_scene(JOINT, dt=dt, link=link, brake=coupling is Coupling.CONSTRAINT)
    robot = ActuatedSim(scene, SimCfg(num_envs=len(start), dt=dt), MrActuatorCfg(coupling=coupling))
    robot.reset(None, wp.array(start[:, None], dtype=float, device="cpu"))
    robot.sim.f_foot.fill_(LOADED)
    qpos, qvel = (robot.sim.backend.field(name).numpy() for name in ("qpos", "qvel"))
    return robot, Load(robot), qpos, qvel


def errors(profile: Profile, truth: np.ndarray, coupling: Coupling, dt: float) -> np.ndarray:
    """RMS over runs and time of angle [rad] and velocity [rad/s] from a reference at :data:`REFERENCE_DT`, (2,)."""
    return root_mean_square(simulated(profile, coupling, dt) - truth[:: round(dt / REFERENCE_DT)], (0, 1))
