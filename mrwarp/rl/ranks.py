"""Several processes that train one policy: what they share, and how they end together.

``torchrun`` starts the processes and names them by environment variables; each is one *rank* with environments and
random draws of its own. rsl-rl averages gradients, KL divergence and observation statistics over the ranks and hands
the learning rate of rank 0 to all. Here is the rest: the group itself, one seed per rank, advantages that are
normalised over all environments, small agreements, and one message when a rank is lost.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from datetime import timedelta
from typing import Any

import numpy as np
import torch
import torch.distributed as dist
from tensordict import TensorDict
from torch.distributed.rendezvous import rendezvous

from mrwarp.rl.ppo import PPO
from mrwarp.run_dir import one_line
from mrwarp.runtime import one_of_several

TIMEOUT = timedelta(minutes=10)
"""Longest wait for another rank, e.g. while rank 0 checks the gate or compiles kernels."""


class RankLostError(RuntimeError):
    """Another rank of this training ended, or the launcher ends this one."""

    exit_code = 1


class Ranks:
    """The processes of one training. A lone process (the default) agrees with itself at no cost.

    Attributes:
        rank: Number of this process, from 0; rank 0 writes and prints.
        world: Number of processes.
        local_rank: Number of this process on its machine, which is also that of its GPU.
        local_world: Number of processes on this machine.
    """

    def __init__(self, *, rank: int = 0, world: int = 1, local_rank: int = 0, local_world: int = 1) -> None:
        self.rank, self.world, self.local_rank, self.local_world = rank, world, local_rank, local_world
        self._store: Any = None

    @classmethod
    def join(cls) -> Ranks:
        """Meet the other ranks that torchrun started; a lone process where nothing says that there are others.

        Raises:
            RankLostError: the others cannot be met.
        """
        if not one_of_several():
            return cls()
        rank, world = int(os.environ["RANK"]), int(os.environ["WORLD_SIZE"])
        local = {name: int(os.environ.get(name.upper()) or 0) for name in ("local_rank", "local_world_size")}
        ranks = cls(rank=rank, world=world, local_rank=local["local_rank"], local_world=local["local_world_size"] or 1)
        signal.signal(signal.SIGTERM, ranks._end)
        try:
            store, _, _ = next(iter(rendezvous("env://", timeout=TIMEOUT)))
            ranks._store = store
            gpu = torch.cuda.is_available()
            if gpu:
                torch.cuda.set_device(ranks.local_rank % torch.cuda.device_count())
            dist.init_process_group(
                "cpu:gloo,cuda:nccl" if gpu else "gloo", store=store, rank=rank, world_size=world, timeout=TIMEOUT
            )
        except RankLostError:
            raise
        except (RuntimeError, ValueError) as error:
            raise RankLostError(f"{ranks} cannot meet the others ({one_line(error)})") from error
        return ranks

    def leave(self) -> None:
        """Part in peace, after the last agreement."""
        if self.world > 1:
            self.total(0.0)
            dist.destroy_process_group()

    def __str__(self) -> str:
        return f"process {self.rank} of {self.world}"

    @property
    def main(self) -> bool:
        """Whether this rank writes and prints."""
        return self.rank == 0

    @property
    def ppo(self) -> type[PPO]:
        """The algorithm."""
        return PPO if self.world == 1 else RanksPPO

    @property
    def ppo_setting(self) -> dict[str, int] | None:
        """rsl-rl's setting ``multi_gpu``."""
        if self.world == 1:
            return None
        return {"global_rank": self.rank, "local_rank": self.local_rank, "world_size": self.world}

    def seed(self, seed: int) -> int:
        """This rank's own seed: that of the run for rank 0, for others a draw that no other run and rank shares."""
        if self.main:
            return seed
        sequence = np.random.SeedSequence(seed % 2**64, spawn_key=(self.rank,))
        return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))

    def device(self, wanted: str) -> str:
        """The device of this rank: ``cuda`` gives every process of a machine a GPU of its own.

        Raises:
            ValueError: several processes would share a GPU.
        """
        if wanted == "cuda":
            return f"cuda:{self.local_rank}"
        if self.local_world > 1 and wanted.startswith("cuda"):
            raise ValueError(f"--device {wanted}: {self.local_world} processes would share it; give --device cuda")
        return wanted

    def threads(self, wanted: int) -> int:
        """CPU threads of this rank's physics: what is wanted, or (0) an equal share of this machine's."""
        return wanted or (0 if self.local_world == 1 else max((os.cpu_count() or 1) // self.local_world, 1))

    def total(self, *values: float) -> list[float]:
        """Sums over the ranks."""
        if self.world == 1:
            return list(values)
        sums = torch.tensor(values, dtype=torch.float64)
        dist.all_reduce(sums)
        return sums.tolist()

    def means(self, values: dict[str, float]) -> dict[str, float]:
        """Means over the ranks, by name."""
        if self.world == 1:
            return values
        return {name: total / self.world for name, total in zip(values, self.total(*values.values()), strict=True)}

    def any(self, flag: bool) -> bool:
        """Whether the flag is set on any rank."""
        return flag if self.world == 1 else self.total(flag)[0] > 0.0

    def decided(self, *flags: bool) -> list[bool]:
        """The decisions of rank 0, for all: clocks differ between ranks."""
        return (
            list(flags) if self.world == 1 else [flag > 0.0 for flag in self.total(*(f and self.main for f in flags))]
        )

    def gather(self, value: Any) -> list[Any]:
        """The ranks' values in their order on rank 0; empty elsewhere. Tensors must lie on the CPU."""
        if self.world == 1:
            return [value]
        found: list[Any] = [None] * self.world if self.main else []
        dist.gather_object(value, found if self.main else None)
        return found

    def share(self, value: Any) -> list[Any]:
        """The ranks' values in their order, on every rank."""
        found: list[Any] = [value] * self.world
        if self.world > 1:
            dist.all_gather_object(found, value)
        return found

    def lost(self, error: BaseException) -> bool:
        """Whether an error says that another rank is gone."""
        if self.world == 1:
            return False
        text = str(error)
        lost = isinstance(error, RankLostError | dist.DistError) or any(word in text for word in _LOST)
        if lost:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the launcher's follows, and must not cut the clean-up short
        return lost

    def complain(self, message: str) -> None:
        """Print a message to stderr, unless another rank has already said why the training ends."""
        first = True
        if self._store is not None:
            with contextlib.suppress(Exception):  # the launcher that keeps the store is gone: better twice than never
                first = self._store.add("mrwarp/complaints", 1) == 1
        if first:
            print(message, file=sys.stderr, flush=True)

    def exit(self, code: int) -> int:
        """``code``; with other ranks, ends at once with it: the libraries of a broken group may wait for ever."""
        if self.world > 1:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        return code

    def _end(self, *_: Any) -> None:
        """The launcher ends this rank, mostly because another one has ended."""
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        raise RankLostError("another process of this training ended, or the launcher was stopped")


_LOST = ("gloo", "NCCL", "Connection closed", "Connection reset", "Broken pipe", "Socket Timeout", "wait timeout")


class RanksPPO(PPO):
    """rsl-rl's PPO with advantages normalised over the environments of all ranks; rsl-rl takes each rank's own."""

    def compute_returns(self, obs: TensorDict) -> None:
        """Returns and advantages of the rollout; see :meth:`rsl_rl.algorithms.PPO.compute_returns`."""
        super().compute_returns(obs)
        storage = self.storage
        advantages = storage.returns - storage.values
        count = advantages.numel() * self.gpu_world_size
        mean = advantages.sum(dtype=torch.float64)
        dist.all_reduce(mean)
        mean /= count
        square = (advantages - mean).square().sum(dtype=torch.float64)
        dist.all_reduce(square)
        deviation = (square / (count - 1)).sqrt()
        storage.advantages = ((advantages - mean) / (deviation + 1e-8)).to(advantages.dtype)
