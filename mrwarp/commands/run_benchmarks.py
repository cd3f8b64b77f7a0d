"""``mrwarp perf``: what the simulator costs, by the code of a checkout."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.resources import DEFAULT_POLICY

PARTS = ("walking", "joint", "training")
"""Options of ``mrwarp perf``."""


@dataclass(frozen=True, kw_only=True)
class Perf(Options):
    """Time physics, joints, environment and training, walking.

    Exit code 0 done, 1 a ratio regressed (--compare), 2 bad input.
    """

    out: opt.Folder = Path("runs/perf")
    """output folder"""
    num_envs: Annotated[tuple[int, ...] | None, opt.some(opt.count, "N")] = None
    """numbers of robots (default: 1 4 16 64 256 1024 4096; on a GPU 16 to 65536)"""
    rounds: Annotated[int | None, opt.one(opt.count, "N")] = None
    """turns of each variant (default: 30; on a GPU 10)"""
    parts: Annotated[tuple[str, ...], opt.some_of(PARTS)] = PARTS
    """what to measure"""
    quick: opt.Flag = False
    """64 and 256 robots, half of the turns, no training: one minute"""
    steps: opt.Whole = 0
    """policy steps per turn; 0 = about 640 robot steps"""
    mjwarp_up_to: Annotated[int | None, opt.one(opt.whole, "N")] = None
    """most robots on MuJoCo-Warp; on a GPU, on it without a graph"""
    threads: opt.Whole = 0
    """CPU threads of the simulation; 0 = all"""
    device: str = "cpu"
    """cpu, or a GPU such as cuda:0, which has figures of its own"""
    policy: opt.File = DEFAULT_POLICY
    """policy that walks"""
    compare: opt.OptionalFile = None
    """earlier result; exit with 1 if a ratio got worse"""

    def run(self, line: CommandLine) -> int:
        """0 done, 1 measured but missed, 2 on bad input, as without a checkout."""
        try:
            work = importlib.import_module("benchmarks.perf.perf_cli")
        except ModuleNotFoundError as error:
            if not (error.name or "").startswith("benchmarks"):
                raise
            raise ValueError("is part of a checkout, not of what is installed; run it in one") from None
        return work.run(self, line)
