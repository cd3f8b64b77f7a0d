"""Training of the studies' policies, one after another; any number of processes may share the work."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

from mrwarp.folder import FolderError, claim
from mrwarp.in_one_piece import write_bytes, write_text
from mrwarp.model_file import read_json_file
from mrwarp.rl import checkpoint
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.rl.trainer import TrainCfg, Trainer
from mrwarp.study.plan import StudyCfg, name, plant_cfg, policy_file, record_file

_REMEDY = "remove the folder to train anew"

_COPIED = (
    "command", "iterations", "environment_steps", "seconds", "task", "gate", "gate_passed", "broken_episodes",
    "unsolved_steps", "versions",
)  # fmt: skip
"""What a training's record takes from its result."""


POINTS = 100
"""Most points of the learning curves that a record keeps."""

KEPT = ("iteration", "reward", "v_x_rmse", "falls_per_hour", "clock_match", "level")
"""Figures of a learning curve in a record."""


def train(cfg: StudyCfg, out: Path, *, threads: int = 0, report: Callable[[str], None] = print) -> bool:
    """Train every policy that is not finished; go on from checkpoints, leave out what another process trains.

    Args:
        cfg: The trainings.
        out: Folder for the runs; each gets a subfolder.
        threads: CPU threads of the physics; 0 = all.
        report: Called with a line for each policy.

    Returns:
        Whether all policies are finished; False after Ctrl-C, or when others are still at work.

    Raises:
        CheckpointError: a checkpoint is of another task.
        PolicyError: a policy to start from is missing or unreadable.
        TrainingError: a training broke off.
    """
    if cfg.start_from is not None:
        for plant, seed in product(cfg.plants, cfg.seeds):
            OnnxPolicy(policy_file(cfg.start_from, plant, seed))  # all of them, before anything is written
    finished = True
    for seed in cfg.seeds:
        for plant in cfg.plants:
            run = out / name(plant, seed)
            if _iterations(run) >= cfg.iterations:
                report(f"{run.name}: finished")
                continue
            report(f"{run.name}: training")
            try:
                run.mkdir(parents=True, exist_ok=True)
                with claim(run):  # before its checkpoint is read
                    pass
                result = _trainer(cfg, plant, seed, run, threads).run()
            except FolderError as error:
                report(f"{run.name}: left out ({error})")
                finished = False
                continue
            if result["stopped"] == "interrupted":
                return False
    return finished


def collect(cfg: StudyCfg, out: Path, folder: Path) -> list[Path]:
    """Copy finished policies into a folder and write their training records beside them.

    Args:
        cfg: The trainings.
        out: Folder of the runs.
        folder: Where policies and records go.

    Raises:
        FileNotFoundError: a training is not finished.
    """
    runs = [(plant, seed, out / name(plant, seed)) for plant in cfg.plants for seed in cfg.seeds]
    for _, _, run in runs:
        if _iterations(run) < cfg.iterations:
            raise FileNotFoundError(f"{run}: not finished ({_iterations(run)} of {cfg.iterations} updates)")
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for plant, seed, run in runs:
        write_bytes(policy_file(folder, plant, seed), (run / "policy.onnx").read_bytes())
        write_text(record_file(folder, plant, seed), json.dumps(_record(run, plant, seed), indent=1) + "\n")
        written.append(policy_file(folder, plant, seed))
    return written


def _trainer(cfg: StudyCfg, plant: str, seed: int, run: Path, threads: int) -> Trainer:
    saved = run / "checkpoint.pt"
    begin = None if saved.is_file() or cfg.start_from is None else policy_file(cfg.start_from, plant, seed)
    train_cfg = TrainCfg(
        env=plant_cfg(plant, num_envs=cfg.num_envs, terrain=cfg.terrain, threads=threads, randomize=cfg.randomize),
        out=run,
        seed=seed,
        iterations=cfg.iterations,
        until_gate=False,
        check_every=float("inf"),
        command=f"mrwarp study train --plants {plant} --seeds {seed} --num-envs {cfg.num_envs} --iterations "
        f"{cfg.iterations} --terrain {cfg.terrain} --randomize {cfg.randomize}"
        + (f" --start-from {cfg.start_from}" if cfg.start_from else ""),
    )
    return Trainer(train_cfg, resume=saved if saved.is_file() else None, start_from=begin)


def _iterations(run: Path) -> int:
    """Updates of a run that ended by itself; 0 without one."""
    return int(_result(run)["iterations"]) if (run / "result.json").is_file() else 0


def _result(run: Path) -> dict[str, Any]:
    """What a training left in its folder.

    Raises:
        ValueError: it is no result of a training.
    """
    path = run / "result.json"
    content = read_json_file(path, _REMEDY)
    lacks = [key for key in _COPIED if not isinstance(content, dict) or key not in content]
    if lacks or not isinstance(content["iterations"], int):
        raise ValueError(f"{path}: no result of a training ({(lacks or ['iterations'])[0]} is missing); {_REMEDY}")
    return content


def _record(run: Path, plant: str, seed: int) -> dict[str, Any]:
    """What is kept of a training beside its policy."""
    result = _result(run)
    rows = checkpoint.load(run / "checkpoint.pt")["rows"]
    stride = max(-(-len(rows) // POINTS), 1)
    kept = rows[stride - 1 :: stride]
    return {
        "plant": plant,
        "seed": seed,
        **{key: result[key] for key in _COPIED},
        "started_from": result.get("started_from"),  # results of earlier versions have none
        "curve": {key: [row[key] for row in kept] for key in KEPT if kept and key in kept[0]},
    }
