"""Are two runs the same bits? ``python -m benchmarks.determinism`` compares simulations and trainings.

Each run is a process of its own, with another hash seed, other numbers of simulation threads and other numbers of
threads that torch may use. Compared are hashes of everything: observations, rewards and ends of episodes on the way,
the state at the end (physics, hysteresis, currents, history, ledger, random generator), and of a training the
networks, optimiser, normalisers, draws and logged figures.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.kills import TIMES, digest
from mrwarp.rl.train_cfg import RunCfg

SIMULATIONS: dict[str, list[dict[str, Any]]] = {
    "simulation, 64 robots, 1, 2 and 3 threads": [{"threads": n} for n in (1, 2, 3)],
    "the same with the learned torque, 1 and 3 threads": [{"threads": n, "actuator": "pg_rlstm"} for n in (1, 3)],
    "the same on MuJoCo-Warp, without and with --deterministic": [
        {"threads": 1, "backend": "mjwarp", "steps": 50, "deterministic": on} for on in (False, True)
    ],
}
"""Simulations that must be equal, by what they show."""

TRAININGS: dict[str, list[dict[str, Any]]] = {
    "training, 64 robots, 4 updates; threads of simulation and torch 1/1, 2/2, 3/3": [
        {"threads": n, "torch_threads": n} for n in (1, 2, 3)
    ],
    "training, 704 robots, 1 update; 1/1 and 2/3": [
        {"threads": n, "torch_threads": t, "num_envs": 704, "updates": 1} for n, t in ((1, 1), (2, 3))
    ],
}
"""Trainings that must be equal. From 698 robots on, torch's own threads would change the sums of the normalisers."""


def simulate(
    *,
    threads: int,
    num_envs: int = 64,
    steps: int = 200,
    seed: int = 7,
    actuator: str = "bouc_wen",
    backend: str | None = None,
    deterministic: bool = False,
) -> dict[str, str | int]:
    """Random actions, randomised robots, noise, kicks, falls and time-outs: hashes of the way and of the end.

    Returns:
        ``way`` and ``state`` hashes, and how many episodes ``ended``.
    """
    import torch

    from mrwarp.env.backend import BackendKind
    from mrwarp.env.cfg import TaskCfg
    from mrwarp.env.vec_env import WalkEnv

    cfg = TaskCfg(
        num_envs=num_envs,
        seed=seed,
        threads=threads,
        backend=BackendKind(backend) if backend else None,
        actuator=actuator,
        deterministic=deterministic,
    )
    with torch.no_grad():
        env, generator = WalkEnv(cfg), torch.Generator().manual_seed(seed)
        way, ended = [], 0
        for _ in range(steps):
            obs, reward, done, _ = env.step(torch.randn(num_envs, env.num_actions, generator=generator))
            way.append(torch.cat([obs["actor"], obs["critic"], reward[:, None], done[:, None].float()], dim=1))
            ended += int(done.sum())
    return {"way": digest({"way": way}), "state": digest(env.state()), "ended": ended}


def train(
    out: Path, *, threads: int, torch_threads: int, num_envs: int = 64, updates: int = 4, seed: int = 5
) -> dict[str, str]:
    """A short training without its gate check: a hash of every part of its checkpoint.

    Args:
        out: Folder to write to.
        threads: Simulation threads.
        torch_threads: Threads that torch is left with; the trainer must not depend on them.
        num_envs: Robots.
        updates: PPO updates.
        seed: Seed of the training.
    """
    import torch

    from mrwarp.env.cfg import TaskCfg
    from mrwarp.rl import checkpoint
    from mrwarp.rl.train_cfg import TrainCfg
    from mrwarp.rl.trainer import Trainer

    env = TaskCfg(num_envs=num_envs, threads=threads)
    cfg = TrainCfg(task=replace(env, seed=seed), run=RunCfg(out=out, iterations=updates, no_gate=True))
    before = torch.get_num_threads()
    torch.set_num_threads(torch_threads)
    try:
        trainer: Any = Trainer(cfg)
        trainer._check_gate = lambda _: None
        trainer._finish = lambda: {"rows": trainer.progress.rows}
        with open(os.devnull, "w") as null, contextlib.redirect_stdout(null):
            trainer.run()
        content = checkpoint.load(trainer.save())
    finally:
        torch.set_num_threads(before)
    algorithm = content["algorithm"]
    networks = {f"{net}.{k}": v for net in ("actor", "critic") for k, v in algorithm[f"{net}_state_dict"].items()}
    return {
        "networks": digest({k: v for k, v in networks.items() if "normalizer" not in k}),
        "normalisers": digest({k: v for k, v in networks.items() if "normalizer" in k}),
        "optimiser": digest({"state": algorithm["optimizer_state_dict"], "rate": content["learning_rate"]}),
        "draws": digest({"torch": content["torch_rng"], "env": content["env"]["key"]}),
        "environment": digest(content["env"]),
        "log": digest({"rows": content["rows"], "window": content["window"]}),
        "everything": digest(content),
    }


def differing(runs: list[dict[str, Any]]) -> list[str]:
    """Parts in which not all runs are equal."""
    return [part for part in runs[0] if any(run[part] != runs[0][part] for run in runs[1:])]


def in_processes(kind: str, settings: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """One process after the other, each with another hash seed."""
    return [one_process(kind, setting, hash_seed=i) for i, setting in enumerate(settings)]


def one_process(kind: str, setting: dict[str, Any], *, hash_seed: int) -> dict[str, Any]:
    """Result of ``simulate`` or ``train`` in a fresh interpreter.

    Raises:
        RuntimeError: it ended with an error.
    """
    env = {**os.environ, "PYTHONHASHSEED": str(hash_seed), "OMP_NUM_THREADS": str(setting.get("torch_threads", 1))}
    command = [sys.executable, "-m", "benchmarks.determinism", "--one", kind, json.dumps(setting)]
    done = subprocess.run(command, env=env, capture_output=True, text=True, cwd=Path(__file__).parents[1], check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{kind} {setting} ended with {done.returncode}:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def cost(device: str, *, num_envs: int = 64, rounds: int = 25, steps: int = 40) -> dict[str, float]:
    """Time of a captured MuJoCo-Warp step of falling robots, without and with ``deterministic`` [ms].

    Both take turns, and the best round counts: other work on the machine only adds.
    """
    import warp as wp

    from mrwarp.env.backend import BackendKind
    from mrwarp.env.config.sim_cfg import SimCfg
    from mrwarp.env.sim import ActuatedSim, robot_scene

    best: dict[str, float] = {}
    robots = {}
    for name, wanted in (("without", False), ("with", True)):
        cfg = SimCfg(num_envs=num_envs, device=device, backend=BackendKind.MJWARP, deterministic=wanted)
        robots[name] = ActuatedSim(robot_scene(None, cfg), cfg)
        robots[name].step(4)
    for _ in range(rounds):
        for name, robot in robots.items():
            robot.reset()
            wp.synchronize_device(device)
            begin = time.perf_counter()
            for _ in range(steps // 4):
                robot.step(4)
            wp.synchronize_device(device)
            best[name] = min(best.get(name, float("inf")), 1e3 * (time.perf_counter() - begin) / steps)
    return best


def main(argv: list[str] | None = None) -> int:
    """Compare; 0 when all runs of every row are the same bits."""
    summary = (__doc__ or "").splitlines()[0]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.determinism", description=summary)
    parser.add_argument("--one", nargs=2, metavar=("KIND", "SETTING"), help=argparse.SUPPRESS)
    timing = "only time MuJoCo-Warp's step on a device, without and with --deterministic"
    parser.add_argument("--cost", metavar="DEVICE", help=timing)
    args = parser.parse_args(argv)
    if args.cost:
        from mrwarp.runtime import quiet_libraries

        quiet_libraries(gpu=False)
        found = cost(args.cost)
        times = ", ".join(f"{name} {ms:.3f} ms" for name, ms in found.items())
        print(f"{times}: {found['with'] / found['without']:.3f} times as long")
        return 0
    if args.one:
        from mrwarp.runtime import quiet_libraries

        quiet_libraries(gpu=False)
        kind, setting = args.one[0], json.loads(args.one[1])
        with tempfile.TemporaryDirectory() as folder:
            print(json.dumps(simulate(**setting) if kind == "simulate" else train(Path(folder), **setting)))
        return 0
    wrong, begin = 0, time.perf_counter()
    for kind, rows in (("simulate", SIMULATIONS), ("train", TRAININGS)):
        for name, settings in rows.items():
            runs = in_processes(kind, settings)
            parts = differing(runs)
            wrong += bool(parts)
            verdict = f"DIFFER in {', '.join(parts)}" if parts else f"same bits in {', '.join(runs[0])}"
            print(f"[{time.perf_counter() - begin:4.0f} s] {name}: {len(runs)} runs, {verdict}", flush=True)
    print(f"wall times are not compared: {', '.join(TIMES)}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
