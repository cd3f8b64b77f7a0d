"""Energy: does the ledger close? Motor, device, contact, limits and gravity against the change of kinetic energy.

Over a step from v to v' = v + dt*qdd the joints move by ``v'*dt``, so that a force f held over it does the work
``f*v'*dt``: the simulator books motors and devices so, and so are contacts and limits booked here, from the solver's
own rows. Gravity is what the potential energy loses. With ``M*(v' - v) = dt*(forces - bias)`` there remains::

    step = -(v'-v)*M*(v'-v)/2 + v'*(M' - M)*v'/2 - dt*v'*bias + V' - V

which no force did: semi-implicit Euler brakes (first term) and takes inertia, Coriolis forces and gravity where the
step began (the others). It falls with dt. The ledger closes when nothing else remains.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np
import torch

from benchmarks.verify.rigs import WorkMeter, mass_matrix, standing_robot
from mrwarp.enums import Coupling
from mrwarp.env.backend import MjBatchBackend
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.sim import ActuatedSim
from mrwarp.kernels import ledger
from mrwarp.trials.walking import Policy, make_env
from mrwarp.usd.robot import CURRENT_GROUPS, DEFAULT_Q

SOURCES = ("motor", "device", "contact", "limits", "gravity", "step")
"""Where the kinetic energy comes from and goes."""

DT = 0.005
"""The simulator's step [s]."""

FREE_FALL, STANDING, WALKING = 0.4, 2.0, 4.0
"""Length of the runs [s]."""


@dataclass(frozen=True, kw_only=True)
class LedgerRun:
    """Energies booked over a run; E robots."""

    dt: float
    """Step [s]."""
    work: dict[str, np.ndarray]
    """Work by source [J], shape (E,) each."""
    kinetic: np.ndarray
    """Change of kinetic energy [J], shape (E,)."""
    turnover: np.ndarray
    """Sum over steps and sources of the size of the work [J], shape (E,)."""

    @property
    def gap(self) -> np.ndarray:
        """Energy that no source explains [J], shape (E,)."""
        return self.kinetic - sum(self.work.values())


class EnergyMeter:
    """Books the energy of every step of a robot of nominal mass on ``mujoco.batch``.

    Args:
        robot: What is metered; its energy ledger may hold earlier entries.
    """

    def __init__(self, robot: ActuatedSim) -> None:
        self.robot = robot
        robot.before_hooks.append(self.before_step)
        robot.hooks.append(self.after_step)
        backend = robot.sim.backend
        assert isinstance(backend, MjBatchBackend)
        self.model, self._backend = robot.sim.scene.model, backend
        self._solved, self._state = mujoco.MjData(self.model), mujoco.MjData(self.model)
        self._qpos, self._qvel = (backend.field(name).numpy() for name in ("qpos", "qvel"))
        num_envs = robot.sim.num_envs
        self._work = {name: np.zeros(num_envs) for name in SOURCES}
        self._turnover = np.zeros(num_envs)
        self._inertia, self._potential = map(np.array, zip(*map(self._at, range(num_envs)), strict=True))
        self._start, self._before = self._kinetic(), (self._qvel.copy(), self._booked())

    def before_step(self) -> None:
        """Note velocities and ledger."""
        self._before = self._qvel.copy(), self._booked()

    def after_step(self) -> None:
        """Book the step for every robot."""
        before, booked = self._before
        work = dict(zip(("motor", "device"), self._booked() - booked, strict=True))
        rows = [self._book(env, before[env]) for env in range(len(before))]
        work |= {name: np.array([row[name] for row in rows]) for name in rows[0]}
        for name, value in work.items():
            self._work[name] += value
        self._turnover += sum(np.abs(value) for value in work.values())

    def run(self) -> LedgerRun:
        """All that was booked so far."""
        work = {source: value.copy() for source, value in self._work.items()}
        kinetic = self._kinetic() - self._start
        return LedgerRun(dt=self.robot.sim.dt, work=work, kinetic=kinetic, turnover=self._turnover.copy())

    def _book(self, env: int, before: np.ndarray) -> dict[str, float]:
        """Contact, limits, gravity and step of one robot's last step; moves its inertia and potential on."""
        solved, after, dt = self._solved, self._qvel[env], self.robot.sim.dt
        self._backend.data(env, solved)
        motion = dt * after
        friction, limit = (
            solved.efc_type == int(kind)
            for kind in (mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF, mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)
        )
        inertia, potential = self._at(env)
        change, old = after - before, self._inertia[env]
        numeric = -0.5 * change @ old @ change + 0.5 * after @ (inertia - old) @ after
        fall = self._potential[env] - potential
        self._inertia[env], self._potential[env] = inertia, potential
        return {
            "contact": self._row_force(~friction & ~limit) @ motion,
            "limits": self._row_force(limit) @ motion,
            "gravity": fall,
            "step": numeric - solved.qfrc_bias @ motion - fall,
        }

    def _row_force(self, rows: np.ndarray) -> np.ndarray:
        """Joint forces of some of the solver's rows, shape (nv,)."""
        force = np.zeros(self.model.nv)
        if rows.any():
            mujoco.mj_mulJacTVec(self.model, self._solved, force, np.where(rows, self._solved.efc_force, 0.0))
        return force

    def _at(self, env: int) -> tuple[np.ndarray, float]:
        """Inertia matrix and potential energy [J] of a robot's present pose."""
        self._state.qpos[:] = self._qpos[env]
        mujoco.mj_fwdPosition(self.model, self._state)
        weights = self.model.body_mass[:, None] * self._state.xipos
        return mass_matrix(self.model, self._state), -float(weights.sum(0) @ self.model.opt.gravity)

    def _kinetic(self) -> np.ndarray:
        return 0.5 * np.einsum("ei,eij,ej->e", self._qvel, self._inertia, self._qvel)

    def _booked(self) -> np.ndarray:
        """Work of motors and devices in the simulator's own ledger [J], shape (2, E)."""
        entries = self.robot.actuator.ledger.numpy().astype(np.float64).sum(1)
        devices = entries[:, int(ledger.DYNAMIC) : int(ledger.DRAG) + 1].sum(1)
        return np.stack([entries[:, int(ledger.MOTOR)], devices])


def free_fall(*, dt: float = DT, moving: bool) -> LedgerRun:
    """The robot falls through the air, at rest in its stance or with legs on the move to random targets."""
    robot = standing_robot(lift=5.0, dt=dt, threads=1)
    targets = np.tile(np.array(DEFAULT_Q), (len(CURRENT_GROUPS), 1))
    if moving:
        targets += np.random.default_rng(0).uniform(-0.5, 0.5, targets.shape)
    robot.q_des.assign(targets.astype(np.float32))
    meter = EnergyMeter(robot)
    robot.step(round(FREE_FALL / dt))
    return meter.run()


def standing(*, lift: float = 0.0, coupling: Coupling = Coupling.CONSTRAINT) -> LedgerRun:
    """The robot sinks into its stance, or drops into it from ``lift`` [m]; one robot per current."""
    meter = EnergyMeter(standing_robot(coupling=coupling, lift=lift, dt=DT, threads=1))
    meter.robot.step(round(STANDING / DT))
    return meter.run()


@torch.no_grad()
def walking(policy: Policy, *, seed: int, dt: float = DT) -> tuple[LedgerRun, WorkMeter]:
    """The robot walks at 0.4 m/s; one robot per current. The torque loop runs at ``dt`` too, the policy at 50 Hz.

    Returns:
        What was booked, and the devices' work by the solver's own row forces.

    Raises:
        RuntimeError: a robot fell, and its ledger was emptied on the way.
    """
    num_envs = len(CURRENT_GROUPS)
    cfg = TaskCfg(num_envs=num_envs, seed=seed, threads=1)
    cfg = replace(cfg, dt=dt, keep_data=True, decimation=round(cfg.step_dt / dt))
    env = make_env(cfg, num_envs, seed)
    meter, devices = EnergyMeter(env.robot), WorkMeter(env.robot)
    env.set_command(torch.tensor([0.4, 0.0, 0.0]))
    obs = env.get_observations()
    for _ in range(round(WALKING / env.cfg.step_dt)):
        obs, _, done, _ = env.step(policy(obs))
        if bool(done.any()):
            raise RuntimeError("a robot fell while its energy was booked; use a policy that walks")
    return meter.run(), devices
