"""Shared by the viewing tests: four robots that move at random, and everything they did."""

import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from rerun.chunk import RrdReader

from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.trials.walking import make_env
from mrwarp.usd.robot import CURRENT_GROUPS
from mrwarp.viewing.frames import FrameReader, Frames
from mrwarp.viewing.viewer import Viewer


@dataclass(frozen=True)
class Walk:
    """Environments, the frames of 60 steps, and the environments' own numbers at each of them."""

    env: WalkEnv
    frames: Frames
    truth: list[dict[str, Any]]
    currents: tuple[float, ...] = CURRENT_GROUPS

    def without_devices(self) -> Frames:
        """The frames of the first robot, as of one that has none."""
        part = {name: value[:, :1] if value.ndim > 1 else value for name, value in vars(self.frames).items()}
        none = np.zeros((len(self.frames), 1, 0))
        return Frames(**{**part, "tau_mr": none, "current": none, "gate": none.astype(int)})


@pytest.fixture(scope="session")
def walk() -> Walk:
    """Four robots, one per current; random actions first, then the neutral stance, so that all gates occur."""
    env = make_env(TaskCfg(num_envs=4), 4, seed=5)
    reader = FrameReader(env.robot, range(4))
    generator = torch.Generator().manual_seed(5)
    frames, truth = [], []
    for step in range(60):
        scale = 1.5 if step < 40 else 0.0
        env.step(scale * (2.0 * torch.rand(4, 12, generator=generator) - 1.0))
        frames.append(reader.read(0.02 * (step + 1), [0.5] * 4))
        now = {"v_x": env.body_velocity[:, 0], "height": env.root_pos[:, 2], "f_foot": env.f_foot}
        now |= {name: env.view(getattr(env.actuator, name)) for name in ("m_dyn", "m_hold", "tau_motor", "ledger")}
        truth.append({name: value.clone().numpy() for name, value in now.items()})
    return Walk(env, Frames.join(frames), truth)


@cache
def tables(path: Path) -> tuple[list[tuple[str, bool, Any]], list[Any]]:
    """Everything in an ``.rrd`` file: entity, whether static, and table of each chunk; and the layouts' tables."""
    reader = RrdReader(path)
    chunks = [(chunk.entity_path, chunk.is_static, chunk.to_record_batch()) for chunk in reader.stream()]
    layouts = [chunk.to_record_batch() for store in reader.blueprints() for chunk in reader.stream(store=store)]
    return chunks, layouts


@dataclass(frozen=True)
class Recorded:
    """Content of an ``.rrd`` file, read with rerun's own reader."""

    path: Path

    def columns(self, entity: str, component: str, *, static: bool = False) -> Iterator[tuple[Any, Any]]:
        """Time [ns] (None if static) and value of every row of one component."""
        for path, is_static, table in tables(self.path)[0]:
            if path == entity and is_static is static and component in table.schema.names:
                times = [None] * table.num_rows if static else table.column("sim_time").cast("int64").to_pylist()
                yield from zip(times, table.column(component).to_pylist(), strict=True)

    def entities(self) -> set[str]:
        """Paths of all entities."""
        return {path for path, _, _ in tables(self.path)[0]}

    def blueprint(self, component: str) -> list[Any]:
        """Values of one component in all layouts of the file."""
        found = [
            table.column(component).to_pylist() for table in tables(self.path)[1] if component in table.schema.names
        ]
        return [value for rows in found for value in rows]


@pytest.fixture
def read_rrd() -> type[Recorded]:
    """Reader of recordings."""
    return Recorded


@pytest.fixture
def viewer() -> Iterator[Viewer]:
    """rerun's server, as a viewer without a window."""
    running = Viewer("--serve-grpc")
    yield running
    if running.process.poll() is None:
        os.killpg(running.process.pid, signal.SIGCONT)
        os.killpg(running.process.pid, signal.SIGKILL)
        running.process.wait()
