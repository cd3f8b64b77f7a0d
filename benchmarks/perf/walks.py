"""Walking robots as variants to time, and plain ``mujoco.batch`` steps over the very states that they went through."""

from __future__ import annotations

import time
from collections.abc import Callable, Set
from dataclasses import replace
from typing import Any

import numpy as np
import torch
import warp as wp

from mrwarp.enums import Coupling, LstmState
from mrwarp.env.backend import BackendKind, MjBatchBackend
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.kernels.launch import Launch
from mrwarp.trials.walking import Policy

VARIANTS: dict[str, dict[str, Any]] = {
    "pd": {"actuator": "none"},
    "bouc_wen": {},
    "explicit": {"coupling": Coupling.EXPLICIT},
    "lstm": {"actuator": "pg_rlstm"},
    "lstm_window": {"actuator": "pg_rlstm", "lstm_state": LstmState.WINDOW},
    "mjwarp_eager": {"backend": BackendKind.MJWARP},
    "mjwarp_captured": {"backend": BackendKind.MJWARP},
}
"""Robots by name: plain motors; Bouc-Wen, gates and hold as brake constraint and as explicit torque; with the LSTM
residual, its state carried on or made from 50 samples at every step; Bouc-Wen on MuJoCo-Warp, step by step and as a
captured graph."""

INPUTS = ("qpos", "qvel", "qacc_warmstart", "qfrc_applied", "xfrc_applied")
"""Inputs of a physics step, except the brake bounds."""

FALLS = 0.02
"""Largest share of robots that may fall in a second: a walking policy under training's pushes loses hardly any."""

HEIGHT = (0.25, 0.40)
"""Mean trunk height of robots that walk [m]."""

SPEED_ERROR = 0.15
"""Largest difference of mean and mean commanded forward speed [m/s]."""

UNSOLVED = 3e-3
"""Largest share of physics steps whose solve did not converge to the engine's own precision."""


class NotWalkingError(RuntimeError):
    """The timed robots do not walk: the times mean nothing."""

    exit_code = 1


def variant_cfg(
    name: str,
    *,
    num_envs: int,
    threads: int = 0,
    seed: int = 0,
    device: str = "cpu",
    backend: BackendKind | None = None,
) -> TaskCfg:
    """The training task (noise, random robots, pushes, resets) with one of :data:`VARIANTS`.

    ``backend`` is the engine of variants that do not name theirs; None takes the device's own.
    """
    settings = {"backend": backend, **VARIANTS[name]}
    cfg = TaskCfg(
        num_envs=num_envs,
        threads=threads,
        seed=seed,
        device=device,
        **settings,
    )
    return replace(cfg, capture=name != "mjwarp_eager")


def repeated(state: dict[str, torch.Tensor], count: int, wanted: int) -> dict[str, torch.Tensor]:
    """State of ``wanted`` environments by repeating that of ``count``."""
    rows = torch.arange(wanted) % count
    return {
        name: value[rows] if value.ndim and value.shape[0] == count and name != "key" else value
        for name, value in state.items()
    }


class Walk:
    """Robots of the training task that a policy walks, timed while they do.

    Args:
        name: One of :data:`VARIANTS`.
        policy: Policy that walks them.
        num_envs: Robots.
        steps: Policy steps per turn.
        threads: CPU threads of the simulation; 0 = all.
        seconds: How long they walk before anything is timed [s].
        like: Walking robots of the same kind whose state they take over first, repeated where they are more.
        device, backend: As of :func:`variant_cfg`.
    """

    def __init__(
        self,
        name: str,
        policy: Policy,
        *,
        num_envs: int,
        steps: int,
        threads: int = 0,
        seconds: float = 2.0,
        like: Walk | None = None,
        device: str = "cpu",
        backend: BackendKind | None = None,
    ) -> None:
        self.name, self.policy, self.steps = name, policy, steps
        self.env = WalkEnv(variant_cfg(name, num_envs=num_envs, threads=threads, device=device, backend=backend))
        env = self.env
        # spread the episodes, as a training does
        generator = torch.Generator().manual_seed(0)
        env.episode_length_buf = torch.randint(env.cfg.episode_steps, (num_envs,), generator=generator)
        if like is not None:
            env.load_state(repeated(like.env.state(), like.env.num_envs, num_envs))
        self._obs = env.get_observations()
        self._falls, self._walked = 0, 0
        self._error, self._height, self._open = 0.0, 0.0, 0.0
        self._robot_seconds, self._physics_seconds = 0.0, 0.0
        self._apart = False
        self._on_physics: Callable[[], None] | None = None
        self._step_physics, env.sim.backend.step = env.sim.backend.step, self._timed_physics
        # the robot's torque steps by themselves, between what the task does before and after them
        sequence, robot = env.step_graph.sequence, env.robot
        first, last = sequence.index(robot.before_step), len(sequence) - sequence[::-1].index(robot.after_step)
        self._parts = [robot.graph(part) for part in (sequence[:first], sequence[first:last], sequence[last:])]
        self._whole, env.step_graph.run = env.step_graph.run, self._timed_step
        for _ in range(round(seconds / env.cfg.step_dt)):
            self._walk()
        self._unsolved = float(env.sim.unsolved.numpy().sum())
        self._falls, self._walked = 0, 0
        self._error, self._height, self._open = 0.0, 0.0, 0.0

    def turn(self) -> dict[str, float]:
        """A few policy steps; seconds per policy step of environment, robot (torques and physics) and physics.

        The task's launches are part of the robot's graphs. So the robot is timed in as many further policy steps, in
        which they are launched by themselves.
        """
        spent = sum(self._walk() for _ in range(self.steps))
        self._robot_seconds = self._physics_seconds = 0.0
        self._apart = True
        for _ in range(self.steps):
            self._walk()
        self._apart = False
        return {
            "env": spent / self.steps,
            "robot": self._robot_seconds / self.steps,
            "physics": self._physics_seconds / self.steps,
        }

    def plain_turn(self) -> dict[str, float]:
        """A few policy steps, and then their physics steps again by ``Batch.step`` alone, which are timed.

        Every step begins from the state and the torques that it had while walking, so the solver's work is the same.

        Raises:
            NotWalkingError: a plain step did not give the bits of the walk.
        """
        backend = self.env.sim.backend
        assert isinstance(backend, MjBatchBackend)  # nothing else is stepped plainly
        arrays = [backend.field(name).numpy() for name in INPUTS]
        arrays.append(backend.expand("dof_frictionloss").numpy())
        records: list[list[np.ndarray]] = []
        results: list[np.ndarray] = []

        def record() -> None:
            records.append([array.copy() for array in arrays])
            self._step_physics()
            results.append(arrays[0].copy())

        self._on_physics = record
        for _ in range(self.steps):
            self._walk()
        self._on_physics = None
        last = [array.copy() for array in arrays]
        spent, step = 0.0, backend.batch.step
        for values, result in zip(records, results, strict=True):
            for array, value in zip(arrays, values, strict=True):
                array[...] = value
            begin = time.perf_counter()
            step()
            spent += time.perf_counter() - begin
            if not np.array_equal(arrays[0], result):
                raise NotWalkingError(f"{self.name}: a physics step repeated from the same state gave other bits")
        for array, value in zip(arrays, last, strict=True):
            array[...] = value
        return {"plain": spent / self.steps}

    def check(self) -> dict[str, float]:
        """Check that the robots walk: share that falls per second, mean height [m] and error of the speed [m/s].

        Also the mean number of open dynamic gates, and the share of steps whose solve did not converge.

        Raises:
            NotWalkingError: it does not, or the state is not finite, or the solver did not converge.
        """
        env = self.env
        seconds, per_step = self._walked * env.cfg.step_dt, env.cfg.decimation * env.num_envs
        figures = {
            "falls_per_second": self._falls / env.num_envs / seconds,
            "height": self._height / self._walked,
            "speed_error": self._error / self._walked,
            "open_gates": self._open / self._walked,
            "unsolved_share": (float(env.sim.unsolved.numpy().sum()) - self._unsolved) / (self._walked * per_step),
        }
        finite = all(np.isfinite(array.numpy()).all() for array in (env.sim.q, env.sim.qd, env.sim.root_pos))
        good = (
            finite
            and figures["falls_per_second"] <= FALLS
            and HEIGHT[0] <= figures["height"] <= HEIGHT[1]
            and abs(figures["speed_error"]) <= SPEED_ERROR
            and figures["unsolved_share"] <= UNSOLVED
        )
        if not good:
            raise NotWalkingError(f"{self.name}, {env.num_envs} robots: timed, but not walking: {figures}")
        return figures

    def _walk(self) -> float:
        """One policy step; its time without the policy [s]."""
        env = self.env
        action = self.policy(self._obs)
        begin = self._now()
        self._obs, _, _, _ = env.step(action)
        spent = self._now() - begin
        self._walked += 1
        self._falls += int(env.fallen.sum())
        self._height += float(env.root_pos[:, 2].mean())
        self._open += float(env.actuator.m_dyn.numpy().sum())
        self._error += float((env.body_velocity[:, 0] - env.command[:, 0]).mean())
        return spent

    def _timed_step(self, host: Set[Launch] = frozenset()) -> None:
        if not self._apart:
            self._whole(host)
            return
        before, torque_steps, after = self._parts
        before.run(host)
        begin = self._now()
        torque_steps.run(host)
        self._robot_seconds += self._now() - begin
        after.run(host)

    def _now(self) -> float:
        """Time when all that was launched is done [s]; a CPU does it at once."""
        if not self.env.sim.device.is_cpu:
            wp.synchronize_device(self.env.sim.device)
        return time.perf_counter()

    def _timed_physics(self) -> None:
        if self._on_physics is not None:
            self._on_physics()
            return
        begin = time.perf_counter()
        self._step_physics()
        self._physics_seconds += time.perf_counter() - begin
