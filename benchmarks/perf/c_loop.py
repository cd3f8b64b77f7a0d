"""Gates, coil, history, Bouc-Wen and hold of all calves: the kernels against the same loop in C at -O3, on one core."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import warp as wp

from benchmarks.perf.timing import Turn
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.enums import ZStep
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.env.sim import ActuatedSim, robot_scene
from mrwarp.usd.robot import DEFAULT_Q, STAND_HEIGHT

SOURCE = Path(__file__).resolve().parents[2] / "benchmarks" / "mr_loop.c"
"""The loop in C; it is in the repository, not in the installed package."""

COMPILE = ("-O3", "-march=native", "-shared", "-fPIC")
"""Compiler options; Warp compiles its kernels for the processor at hand, too."""


class NoCompilerError(RuntimeError):
    """The loop in C cannot be had; the message says why."""


class CLoop:
    """The compiled loop on the arrays of an actuator, with states and outputs of its own.

    Args:
        robot: Robots at whose inputs the loop looks.
        folder: Where the compiled library is put.

    Raises:
        NoCompilerError: there is no C compiler, no source, or it did not compile.
    """

    OUTPUTS = ("m_dyn", "m_hold", "z", "current", "tau_dyn", "ring", "tau_motor", "tau_mr", "tau", "bound")

    def __init__(self, robot: ActuatedSim, folder: Path) -> None:
        compiler = shutil.which("cc")
        if compiler is None:
            raise NoCompilerError("no C compiler (cc) is installed")
        if not SOURCE.is_file():
            raise NoCompilerError(f"{SOURCE} is missing: it comes with the repository, not with the package")
        library = folder / "mr_loop.so"
        command = [compiler, *COMPILE, str(SOURCE), "-o", str(library), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise NoCompilerError(f"cc failed: {' '.join(done.stderr.split())[:200]}")
        self._run = ctypes.CDLL(str(library)).mr_loop
        a, i = robot.actuator, robot.actuator.inputs
        self._head = a.head.numpy()
        self.out = {name: getattr(a, name).numpy().copy() for name in self.OUTPUTS}
        before = (a.params, a.slot_of, a.leg_of, a.kp, a.kd, a.tau_limit)
        inputs = (i.q_des, i.q, i.qd, i.f_foot, i.current_e)
        sizes = (*i.q.shape, len(a.mr_joints), i.f_foot.shape[1])
        if a.params.shape[0] != robot.sim.num_envs:
            raise ValueError("the loop wants a row of parameters per environment")
        self._sizes = [ctypes.c_int(size) for size in sizes]
        self._before = [ctypes.c_void_p(array.ptr) for array in before]
        self._dt = ctypes.c_float(a.dt)
        self._rest = [ctypes.c_void_p(array.ptr) for array in inputs]
        self._rest += [ctypes.c_void_p(array.ctypes.data) for array in self.out.values()]
        self._keep = robot

    def __call__(self) -> None:
        """One step, with the history's newest row where the actuator's is."""
        self._run(*self._sizes, *self._before, self._dt, ctypes.c_int(int(self._head[0])), *self._rest)


def mixed_robots(num_envs: int) -> ActuatedSim:
    """Robots of which half stand on held calves, and half fight targets that jump: all branches of the laws occur.

    With the paper's Euler step, as the loop in C has it.
    """
    cfg = SimCfg(num_envs=num_envs, threads=1)
    robot = ActuatedSim(robot_scene(None, cfg), cfg, MrActuatorCfg(z_step=ZStep.EULER), share_params=False)
    stance = np.tile(robot.sim.scene.model.qpos0.astype(np.float32), (num_envs, 1))
    stance[:, 2] = STAND_HEIGHT
    stance[:, robot.sim.scene.q_adr] = DEFAULT_Q
    robot.reset(None, wp.array(stance, device="cpu"))
    robot.current_e.fill_(1.5)
    rng = np.random.default_rng(0)
    targets = np.tile(np.array(DEFAULT_Q, dtype=np.float32), (num_envs, 1))
    for _ in range(60):
        targets[num_envs // 2 :] = DEFAULT_Q + rng.normal(0.0, 0.15, (num_envs - num_envs // 2, len(DEFAULT_Q)))
        robot.q_des.assign(targets)
        robot.step(2)
    return robot


def largest_difference(robot: ActuatedSim, loop: CLoop, steps: int = 5) -> float:
    """Largest relative difference of kernels and C over all outputs of a few steps from the same state.

    Relative to one where values are smaller; NaN must stand at the same places.
    """
    actuator, worst = robot.actuator, 0.0
    for name, values in loop.out.items():
        values[...] = getattr(actuator, name).numpy()
    for _ in range(steps):
        actuator.step()
        loop()
        for name, values in loop.out.items():
            found = getattr(actuator, name).numpy()
            if not np.array_equal(np.isnan(found), np.isnan(values)):
                return float("inf")
            error = np.abs(found - values) / np.maximum(np.abs(values), 1.0)
            worst = max(worst, float(np.nanmax(error)) if np.isfinite(error).any() else 0.0)
    return worst


def turns(robot: ActuatedSim, loop: CLoop | None, *, repeat: int) -> dict[str, Turn]:
    """Kernels and loop to be timed in turn, seconds per step of all robots."""

    def timed(step) -> Turn:
        def turn() -> dict[str, float]:
            begin = time.perf_counter()
            for _ in range(repeat):
                step()
            return {"step": (time.perf_counter() - begin) / repeat}

        return turn

    found = {"kernels": timed(robot.actuator.step)}
    return found if loop is None else {**found, "c": timed(loop)}
