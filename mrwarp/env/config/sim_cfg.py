"""How the physics is stepped. Loads no engine, so that command lines are read from it."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, field
from functools import cache

from tyro.conf import Fixed

from mrwarp.actuator import brake_constraint
from mrwarp.enums import BackendKind
from mrwarp.options import option_types as opt


@cache
def has_batch() -> bool:
    """Whether this MuJoCo has ``mujoco.batch``, which 3.17 brought."""
    return importlib.util.find_spec("mujoco.batch") is not None


@dataclass(frozen=True, kw_only=True)
class SolverCfg:
    """Options of MuJoCo's constraint solver."""

    iterations: int = 30
    """Largest number of Newton iterations."""
    ls_iterations: int = 50
    """Largest number of line-search iterations. Below 30 the stiff brake constraint fails silently."""
    tolerance: float = 1e-8
    """Stop when the scaled gradient is below this; float32 stepping cannot use less than 1e-6."""

    def __post_init__(self) -> None:
        if self.ls_iterations < brake_constraint.MIN_LS_ITERATIONS:
            least = brake_constraint.MIN_LS_ITERATIONS
            raise ValueError(
                f"ls_iterations = {self.ls_iterations}: below {least} the brake constraint fails silently; "
                f"use {least} or more"
            )


@dataclass(frozen=True, kw_only=True)
class SimCfg:
    """How the physics is stepped."""

    num_envs: opt.Count = 64
    """parallel environments, in each process of torchrun"""
    device: str = "cpu"
    """cpu, cuda:N, or cuda: under torchrun a GPU for each process"""
    backend: BackendKind | None = None
    """physics engine (default: mjbatch on the CPU, mjwarp on a GPU and with MuJoCo before 3.17)"""
    dt: Fixed[float] = 0.005
    """Physics and torque step [s], paper section 5.1."""
    threads: opt.Whole = 0
    """CPU threads of the physics; 0 = all, the results are the same bits for any number"""
    solver: Fixed[SolverCfg] = field(default_factory=SolverCfg)
    """Constraint solver options."""
    capture: Fixed[bool] = True
    """Run what can be captured as graphs: MuJoCo-Warp's whole steps, with ``mjbatch`` the kernels around each."""
    keep_data: Fixed[bool] = False
    """Keep each environment's whole ``MjData`` after a step of ``mjbatch``, for checks that read the solver's rows."""
    deterministic: opt.Flag = False
    """order contacts and sums on a GPU; nine times slower, and its bits still differ (the CPU repeats them anyway)"""

    def __post_init__(self) -> None:
        if self.threads < 0:
            raise ValueError(f"threads = {self.threads} must be 0 (all) or more")
        if self.num_envs < 1:
            raise ValueError(f"num_envs = {self.num_envs} must be at least 1")
        if not 0.0 < self.dt <= 0.02:
            raise ValueError(f"dt = {self.dt} s must lie in (0, 0.02]")

    @property
    def engine(self) -> BackendKind:
        """The engine that ``backend`` and ``device`` choose.

        Raises:
            ValueError: ``mjbatch`` was asked for on a GPU.
        """
        batched = self.device == "cpu" and has_batch()
        kind = self.backend or (BackendKind.MJBATCH if batched else BackendKind.MJWARP)
        if kind is BackendKind.MJBATCH and self.device != "cpu":
            raise ValueError(f"backend mjbatch runs on the CPU, not on {self.device!r}; use mjwarp there")
        return kind
