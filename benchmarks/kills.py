"""Training that is killed at random moments: ``python -m benchmarks.kills --kills 200``.

A tiny training saves after every update. It is killed with SIGKILL at random moments, also while it writes a
checkpoint, and resumed, again and again. After every kill the checkpoint must be readable, at most one update older
than the last one that was finished, and bit-equal to that of a training that nobody killed: networks, optimiser,
normalisers, random generators, environment, actuator, progress.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import multiprocessing
import os
import random
import shutil
import signal
import sys
import time
from pathlib import Path
from typing import Any

TIMES = ("seconds", "collect_ms", "learn_ms", "steps_per_second")
"""Progress figures that measure wall time, which no two runs share."""


def digest(content: dict[str, Any]) -> str:
    """Hash of everything in a checkpoint but wall times."""
    import torch

    state = hashlib.sha256()

    def add(value: Any) -> None:
        if isinstance(value, torch.Tensor):
            state.update(str((value.dtype, tuple(value.shape))).encode())
            state.update(value.detach().cpu().contiguous().numpy().tobytes())
        elif isinstance(value, dict):
            for key in sorted(value, key=str):
                if key not in TIMES:
                    state.update(str(key).encode())
                    add(value[key])
        elif isinstance(value, list | tuple):
            state.update(b"[")
            for item in value:
                add(item)
        else:
            state.update(repr(value).encode())

    add(content)
    return state.hexdigest()


def make_trainer(
    out: Path, updates: int, *, actuator: str = "bouc_wen", terrain: str = "flat", resume: Path | None = None
) -> Any:
    """A training of a few robots that saves after every update; its gate check and picture are left out."""
    from dataclasses import replace

    from mrwarp.env.cfg import TaskCfg
    from mrwarp.env.config.mdp_cfg import make_terrain_cfg
    from mrwarp.rl.train_cfg import RunCfg, TrainCfg
    from mrwarp.rl.trainer import Trainer

    env = TaskCfg(num_envs=4, threads=1, actuator=actuator, terrain=make_terrain_cfg(terrain))
    env = replace(env, episode_seconds=1.0)
    cfg = TrainCfg(
        task=replace(env, seed=5),
        run=RunCfg(out=out, iterations=updates, no_gate=True, save_every=0.0, check_below=0.0),
    )
    return Trainer(cfg, resume=resume)


def train(out: Path, updates: int, task: dict[str, str], finished: Any, digests: Any = None) -> None:
    """Train from the folder's checkpoint, if there is one; prints the number of finished updates."""
    from mrwarp.rl import checkpoint

    path = out / "checkpoint.pt"
    trainer = make_trainer(out, updates, **task, resume=path if path.is_file() else None)
    save = trainer.save

    def saved() -> Path:
        finished.value = trainer.iteration
        save()
        if digests is not None:
            digests[trainer.iteration] = digest(checkpoint.load(path))
        if trainer.iteration == updates:
            os._exit(0)
        return path

    trainer.save = saved
    with open(os.devnull, "w") as null, contextlib.redirect_stdout(null):
        trainer.run()


def measure(
    kills: int, updates: int, out: Path, *, seed: int, longest: float, task: dict[str, str] | None = None
) -> dict[str, Any]:
    """Kill a training ``kills`` times and check every checkpoint it leaves.

    Args:
        kills: Number of kills.
        updates: Length of the training; a finished one starts over.
        out: Folder to work in.
        seed: Seed of the moments.
        longest: Longest life from the first update on [s].
        task: ``actuator`` and ``terrain`` of :func:`make_trainer`.

    Returns:
        ``kills``, ``unreadable``, ``old``, ``different``, ``in_write`` (kills that left a half-written file),
        ``rounds`` (trainings that reached their end).
    """
    from mrwarp.rl import checkpoint

    context, rng, task = multiprocessing.get_context("fork"), random.Random(seed), task or {}
    with context.Manager() as manager:
        digests = manager.dict()
        run = context.Process(target=train, args=(out / "whole", updates, task, context.Value("i", 0), digests))
        run.start()
        run.join()
        expected = dict(digests)
    if sorted(expected) != list(range(1, updates + 1)):
        raise RuntimeError(f"the training that nobody kills ended with {run.exitcode} after {len(expected)} updates")
    part, path = out / "part", out / "part" / "checkpoint.pt"
    found = {"kills": 0, "unreadable": 0, "old": 0, "different": 0, "in_write": 0, "rounds": 0, "updates_seen": 0}
    seen = set()
    while found["kills"] < kills:
        at = checkpoint.load(path)["iteration"] if path.is_file() else 0
        if at == updates:
            shutil.rmtree(part)
            at, found["rounds"] = 0, found["rounds"] + 1
        finished = context.Value("i", at)
        run = context.Process(target=train, args=(part, updates, task, finished))
        run.start()
        while finished.value == at and run.is_alive() and rng.random() < 0.9999:  # now and then already while it starts
            time.sleep(0.002)
        run.join(rng.uniform(0.0, longest))
        alive = run.is_alive()
        if alive and run.pid is not None:
            os.kill(run.pid, signal.SIGKILL)
            run.join()
        elif run.exitcode != 0:
            raise RuntimeError(f"the training ended by itself with {run.exitcode}")
        found["kills"] += int(alive)
        if alive and found["kills"] % 10 == 0:
            print(f"{found['kills']} of {kills} kills: {found}", flush=True)
        found["in_write"] += int(path.with_suffix(".pt.part").exists())
        last = finished.value
        if not path.is_file():
            found["old"] += int(last > 1)
            continue
        try:
            content = checkpoint.load(path)
        except checkpoint.CheckpointError:
            found["unreadable"] += 1
            shutil.rmtree(part)
            continue
        # `last` is sent when an update is finished, before its checkpoint is written
        found["old"] += int(content["iteration"] < last - 1)
        found["different"] += int(digest(content) != expected[content["iteration"]])
        seen.add(content["iteration"])
    found["updates_seen"] = len(seen)
    return found


def main(argv: list[str] | None = None) -> int:
    """Measure; 0 when every checkpoint was readable, young enough and bit-equal."""
    from mrwarp.enums import ACTUATORS, TERRAINS
    from mrwarp.runtime import quiet_libraries

    parser = argparse.ArgumentParser(prog="python -m benchmarks.kills", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kills", type=int, default=200, help="kills (default: 200)")
    parser.add_argument("--updates", type=int, default=60, help="length of the training (default: 60)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the moments (default: 0)")
    parser.add_argument("--longest", type=float, default=0.6, help="longest life after an update [s] (default: 0.6)")
    parser.add_argument("--actuator", choices=ACTUATORS, default="bouc_wen", help="torque model (default: bouc_wen)")
    parser.add_argument("--terrain", choices=TERRAINS, default="flat", help="ground; rough has a curriculum")
    parser.add_argument(
        "--out", type=Path, default=Path("out/kills"), help="folder, emptied first (default: out/kills)"
    )
    args = parser.parse_args(argv)
    quiet_libraries(gpu=False)
    for name in ("whole", "part"):
        shutil.rmtree(args.out / name, ignore_errors=True)
    import mrwarp.rl.trainer  # noqa: F401  once, not in every life

    start = time.perf_counter()
    task = {"actuator": args.actuator, "terrain": args.terrain}
    found = measure(args.kills, args.updates, args.out, seed=args.seed, longest=args.longest, task=task)
    print(json.dumps({**found, "seconds": round(time.perf_counter() - start)}))
    return int(any(found[name] for name in ("unreadable", "old", "different")))


if __name__ == "__main__":
    sys.exit(main())
