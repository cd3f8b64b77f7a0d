"""The two ways of stepping one model: ``mujoco.batch`` on CPU threads, and MuJoCo-Warp on a GPU (or the CPU).

Both hold their state in MuJoCo's layout and hand it out as Warp arrays over the same memory: float64 views of the
batch's rows, or MuJoCo-Warp's own float32 arrays. A backend steps; what the numbers mean is :mod:`mrwarp.env.sim`'s.
"""

from __future__ import annotations

import copy
import os
import weakref
from typing import Protocol

import mujoco
import numpy as np
import warp as wp

from mrwarp.enums import BackendKind
from mrwarp.env.config.sim_cfg import has_batch
from mrwarp.runtime import uncollected

HAS_BATCH = has_batch()
"""Whether this MuJoCo has ``mujoco.batch``: it came with 3.17, after the oldest that a drive works with."""

if HAS_BATCH:
    import mujoco.batch


class Backend(Protocol):
    """An engine as :class:`mrwarp.env.sim.Sim` uses it."""

    kind: BackendKind
    num_envs: int
    residual_tolerance: float
    """Largest residual of a converged solve [N·m], by the engine's precision."""
    overflow: wp.array
    """The engine's flags of dropped contacts and constraint rows, int, shape (E, C); it rises and stays."""
    overflow_mask: int
    """Its bits that mean one was dropped."""

    def field(self, name: str) -> wp.array:
        """Live array of a field of MuJoCo's data, shape (E, ...)."""
        ...

    def expand(self, name: str) -> wp.array:
        """Live per-environment values of a model field, shape (E, ...)."""
        ...

    def set_const(self) -> None:
        """Recompute the constants that follow from expanded masses and inertias."""
        ...

    def step(self) -> None:
        """Advance every environment by one physics step."""
        ...


_batches: weakref.WeakSet[mujoco.batch.Batch] = weakref.WeakSet()
_inherited: list[mujoco.batch.Batch] = []
"""A forked process has none of its parent's threads; freeing a batch would wait for them for ever."""

os.register_at_fork(after_in_child=lambda: _inherited.extend(_batches))


def new_batch(model: mujoco.MjModel, num_envs: int, threads: int, *, keep_data: bool = False) -> mujoco.batch.Batch:
    """A ``mujoco.batch`` that a forked process never frees; arguments as for :class:`MjBatchBackend`.

    Raises:
        ValueError: this MuJoCo has none.
    """
    if not HAS_BATCH:
        raise ValueError(f"backend mjbatch needs MuJoCo 3.17 or newer, here is {mujoco.__version__}; use mjwarp")
    batch = mujoco.batch.Batch(model, num_envs, threads, persistent=keep_data)
    _batches.add(batch)
    return batch


class MjBatchBackend:
    """``mujoco.batch``: MuJoCo C over a pool of threads, float64, the same bits at any thread count.

    Args:
        model: The model to step.
        num_envs: Number of environments.
        threads: CPU threads; 0 = all.
        keep_data: Keep each environment's whole ``MjData``. Without, a thread's environments share one, which stays in
            the core's cache: the same bits, in less time and memory.
    """

    kind = BackendKind.MJBATCH
    residual_tolerance = 1e-3
    overflow_mask = -1

    def __init__(self, model: mujoco.MjModel, num_envs: int, *, threads: int = 0, keep_data: bool = False) -> None:
        self.num_envs = num_envs
        # a state that is no number has to show and to count as unsolved, not to jump back to the model's own start
        model = copy.copy(model)
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        # a robot's constraints all hang together: looking for islands among them costs up to a tenth of a step
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
        self.batch = new_batch(model, num_envs, threads, keep_data=keep_data)
        self._views: dict[str, wp.array] = {}
        first = int(mujoco.mjtWarning.mjWARN_CONTACTFULL)
        counts = self.batch.warning[:, first : int(mujoco.mjtWarning.mjWARN_CNSTRFULL) + 1, 1]
        self.overflow = wp.array(
            ptr=counts.ctypes.data, dtype=int, shape=counts.shape, strides=counts.strides, device="cpu", copy=False
        )

    def field(self, name: str) -> wp.array:
        """See :class:`Backend`."""
        return self._view(name, self.batch.bind)

    def expand(self, name: str) -> wp.array:
        """See :class:`Backend`."""
        return self._view(f"model.{name}", lambda _: self.batch.expand(name))

    def set_const(self) -> None:
        """See :class:`Backend`."""
        self.batch.set_const()

    def step(self) -> None:
        """See :class:`Backend`."""
        self.batch.step()

    def data(self, env: int, data: mujoco.MjData) -> None:
        """Copy what the last step left of an environment, its constraint rows too.

        Raises:
            RuntimeError: the data were not kept.
        """
        if not self.batch.persistent:
            raise RuntimeError("the last step's MjData was not kept; build the simulation with SimCfg(keep_data=True)")
        self.batch.get_data(env, data)

    def _view(self, key: str, get) -> wp.array:
        if key not in self._views:
            array: np.ndarray = get(key)
            self._views[key] = wp.array(
                ptr=array.ctypes.data,
                dtype=wp.float64,
                shape=array.shape,
                strides=array.strides,
                device="cpu",
                copy=False,
            )
        return self._views[key]


class MjWarpBackend:
    """MuJoCo-Warp: kernels over all environments, float32, on a GPU; on the CPU it is the slow reference.

    Args:
        model: The model to step.
        num_envs: Number of environments.
        device: Warp device.
        contacts: Contact points to allocate per environment (they share one pool).
        constraints: Constraint rows to allocate per environment.
        deterministic: Order contacts, and sum in an order that does not depend on the threads. MuJoCo-Warp 3.17 does
            not order constraint rows yet, so that bits still differ from run to run.
    """

    kind = BackendKind.MJWARP
    residual_tolerance = 0.05

    def __init__(
        self,
        model: mujoco.MjModel,
        num_envs: int,
        *,
        device: str = "cpu",
        contacts: int = 24,
        constraints: int = 112,
        deterministic: bool = False,
    ) -> None:
        with uncollected():
            import mujoco_warp  # it takes seconds to load, and a CPU does without
        self._engine, kinds = mujoco_warp, mujoco_warp.OverflowType
        self.overflow_mask = int(
            kinds.NEFC | kinds.NJMAX_NNZ | kinds.BROADPHASE | kinds.NARROWPHASE | kinds.CONTACT_MATCH
        )
        self.num_envs = num_envs
        self.device = wp.get_device(device)
        with wp.ScopedDevice(self.device):
            self.model = mujoco_warp.put_model(model)
            determinism = getattr(mujoco_warp, "DeterminismType", None)
            if determinism is not None:
                self.model.opt.deterministic = determinism.ALL if deterministic else determinism.NONE
            elif deterministic:
                raise ValueError(f"ordered sums need MuJoCo-Warp 3.17 or newer, here is that of {mujoco.__version__}")
            # float32 cannot reach the float64 tolerance; MuJoCo-Warp clamps it, we say it
            self.model.opt.tolerance.fill_(max(float(model.opt.tolerance), 1e-6))
            self.data = mujoco_warp.make_data(model, nworld=num_envs, nconmax=contacts, njmax=constraints)
            qpos0 = np.tile(model.qpos0, (num_envs, 1)).astype(np.float32)
            self.data.qpos.assign(qpos0)
        self.overflow = self.data.overflow.reshape((num_envs, 1))

    def field(self, name: str) -> wp.array:
        """See :class:`Backend`."""
        return getattr(self.data, name)

    def expand(self, name: str) -> wp.array:
        """See :class:`Backend`."""
        *above, own = name.split(".")  # as mujoco.batch has it: opt.gravity is the options' gravity
        holder = getattr(self.model, *above) if above else self.model
        shared = getattr(holder, own)
        if shared.shape[0] != self.num_envs or (self.num_envs > 1 and shared.strides[0] == 0):
            values = np.repeat(shared.numpy()[:1], self.num_envs, axis=0)
            setattr(holder, own, wp.array(values, dtype=shared.dtype, device=self.device))
        return getattr(holder, own)

    def set_const(self) -> None:
        """See :class:`Backend`."""
        # what follows from a mass per environment needs a row per environment too: MuJoCo-Warp makes none
        for name in ("body_subtreemass", "body_invweight0", "dof_invweight0"):
            self.expand(name)
        self._engine.set_const(self.model, self.data)

    def step(self) -> None:
        """See :class:`Backend`."""
        with wp.ScopedDevice(self.device):
            self._engine.step(self.model, self.data)
