"""Run a function in several processes that form one training, as ``torchrun`` does, but forked: seconds less."""

import multiprocessing
import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from mrwarp.rl.ranks import Ranks


def _enter(function: Callable[..., Any], rank: int, world: int, port: int, result: Path, args: tuple[Any, ...]) -> None:
    os.environ |= {
        "RANK": str(rank), "WORLD_SIZE": str(world), "LOCAL_RANK": str(rank), "LOCAL_WORLD_SIZE": str(world),
        "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port),
    }  # fmt: skip
    torch.set_num_threads(1)
    ranks = Ranks.join()
    value = function(ranks, *args)
    ranks.leave()
    torch.save(value, result)


def together(function: Callable[..., Any], folder: Path, *args: Any, world: int = 2, timeout: float = 120.0) -> list:
    """Call ``function(ranks, *args)`` in every process; returns their values in order of rank."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    context = multiprocessing.get_context("fork")
    results = [folder / f"rank{rank}.pt" for rank in range(world)]
    runs = [
        context.Process(target=_enter, args=(function, rank, world, port, results[rank], args)) for rank in range(world)
    ]
    for run in runs:
        run.start()
    for run in runs:
        run.join(timeout)
    codes = [run.exitcode for run in runs]
    for run in runs:
        if run.is_alive():
            run.kill()
    assert codes == [0] * world, f"exit codes {codes}"
    return [torch.load(result, weights_only=True) for result in results]
