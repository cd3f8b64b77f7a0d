"""Training of the studies' policies, their training records, and figure 5 from these.

Policies are trained one after another; any number of processes may share the work.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.env.cfg import TaskCfg
from mrwarp.options.json_file import read_json_file, shown
from mrwarp.options.plain_values import plain
from mrwarp.resources import policy_file
from mrwarp.rl import checkpoint
from mrwarp.rl.checkpoint import ppo_of
from mrwarp.rl.task_record import identity, task_of
from mrwarp.rl.train_cfg import RunCfg, TrainCfg
from mrwarp.rl.trainer import Trainer
from mrwarp.rl.warm_start import read_networks
from mrwarp.run_dir import FolderError, claim, write_bytes, write_text
from mrwarp.runtime import panels
from paper.study.plan import (
    AWARE,
    CONVENTIONAL,
    PAYING,
    SEEDS,
    STUDY,
    StudyCfg,
    check_seeds,
    name,
    plant_cfg,
    record_file,
    start_file,
)

_REMEDY = "remove the folder to train again"

_COPIED = (
    *("command", "iterations", "environment_steps", "seconds", "task"),
    *("gate", "gate_passed", "diverged_episodes", "unsolved_steps", "versions"),
)
"""Entries of a result that the training's record repeats."""

POINTS = 100
"""Most points of the learning curves that a record keeps."""

KEPT = ("iteration", "reward", "v_x_rmse", "falls_per_hour", "clock_match", "level")
"""Figures of a learning curve in a record."""

_ORIGIN = ("task", "seed", "iteration")
"""Entries that distinguish the policies that trainings begin with; their files may have moved."""

TITLES = {CONVENTIONAL: "baseline Go1 policy", AWARE: "MRA-SAL policy"}
"""Names of figure 5's curves."""

COLOURS = ("#b4451f", "#1f6fb4", "#3a8f3a", "#7a4fa3", "#555555")
"""Of the curves in their order; a sixth begins again."""


class RunError(ValueError):
    """A run was trained with other choices than asked for, or its record cannot be used."""


@dataclass(frozen=True, kw_only=True)
class _Run:
    """A training as its folder has it."""

    ended: bool
    """By itself, with at least the updates asked for: policy and result lie there; else a checkpoint to go on from."""
    iterations: int
    started_from: dict[str, Any] | None
    remedy: str


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
        RunError: a run was trained with other choices; nothing has been written.
        ValueError: a result, a checkpoint or a policy to start from cannot be used, or a training broke off.
    """
    runs = [(plant, seed, out / name(plant, seed)) for seed in cfg.seeds for plant in cfg.plants]
    for plant, seed, run in runs:  # all of them, before anything is written
        _check_start(cfg, plant, seed, run)
    finished = True
    for plant, seed, run in runs:
        found = _found(cfg, plant, seed, run)
        if found and found.ended:
            report(f"{run.name}: finished")
            continue
        report(f"{run.name}: training")
        try:
            with claim(run):  # before its checkpoint is read
                result = _trainer(cfg, plant, seed, run, threads).run(claimed=True)
        except FolderError as error:
            report(f"{run.name}: left out ({error})")
            finished = False
            continue
        if result["stopped"] == "interrupted":
            return False
    return finished


def collect(cfg: StudyCfg, out: Path, folder: Path) -> list[Path]:
    """Copy finished policies into a folder and write their training records next to them.

    What trainings started from is not compared, the records say it. Nothing is written unless all can be.

    Raises:
        RunError: a run was trained with other choices.
        FileNotFoundError: a training is not finished.
        ValueError: a checkpoint or a result is damaged.
    """
    runs = [(plant, seed, out / name(plant, seed)) for plant in cfg.plants for seed in cfg.seeds]
    for plant, seed, run in runs:
        found = _found(cfg, plant, seed, run)
        if found is None or not found.ended:
            updates = found.iterations if found else 0
            raise FileNotFoundError(
                f"{run}: not finished ({updates} of {cfg.iterations} updates); 'mrwarp study train' with the same "
                "choices goes on"
            )
    files = [
        (plant, seed, (run / "policy.onnx").read_bytes(), json.dumps(_record(run, plant, seed), indent=1) + "\n")
        for plant, seed, run in runs
    ]
    for plant, seed, policy, record in files:
        write_bytes(policy_file(folder, plant, seed), policy)
        write_text(record_file(folder, plant, seed), record)
    return [policy_file(folder, plant, seed) for plant, seed, _, _ in files]


def failed_conditions(record: Path) -> list[str]:
    """Conditions of the walking gate that a collected policy did not meet, by its record."""
    gate = json.loads(record.read_text(encoding="utf-8"))["gate"]
    return [name for name, met in gate["conditions"].items() if not met]


def _found(cfg: StudyCfg, plant: str, seed: int, run: Path) -> _Run | None:
    """The training in a run's folder, None without anything to use or go on from; refused if made otherwise."""
    content = _result(run) if (run / "result.json").is_file() else {}
    ended = content.get("iterations", 0) >= cfg.iterations and content.get("stopped") != "interrupted"
    remedy = f"give the choices of '{content.get('command')}'"
    if not ended:
        remedy, saved = "give the choices that its training began with", run / "checkpoint.pt"
        if not saved.is_file():
            return None
        content = checkpoint.load(saved)
        if lacks := [key for key in _ORIGIN if key not in content]:
            raise checkpoint.CheckpointError(f"{saved}: no checkpoint of a training ({lacks[0]} is missing); {_REMEDY}")
    found = _Run(
        ended=ended,
        iterations=content["iterations" if ended else "iteration"],
        started_from=content.get("started_from"),  # files of earlier versions have none
        remedy=f"{remedy} or name another --runs to train again",
    )
    asked = {**identity(_env(cfg, plant)), **plain(cfg.learning), "seed": seed}
    own = {**identity(task_of(content["task"])), **plain(ppo_of(content)), "seed": content["seed"]}
    differs = [text for key in own for text in _differences(key, own[key], asked.get(key))]  # as resuming compares
    if found.iterations > cfg.iterations:
        differs.append(f"iterations = {found.iterations} (asked: {cfg.iterations})")
    if differs:
        raise RunError(f"{run}: trained with {', '.join(differs)}; {found.remedy}")
    return found


def _differences(key: str, own: Any, asked: Any) -> list[str]:
    """Where two values differ, entry by entry in tables, each as a text."""
    if isinstance(own, dict) and isinstance(asked, dict):
        both = dict.fromkeys([*own, *asked])
        return [text for k in both for text in _differences(f"{key}.{k}", own.get(k), asked.get(k))]
    return [] if own == asked else [f"{key} = {shown(own)} (asked: {shown(asked)})"]


def _check_start(cfg: StudyCfg, plant: str, seed: int, run: Path) -> None:
    """Raise RunError if a run began with other networks than asked for."""
    asked = None
    if cfg.start_from:
        path = start_file(cfg.start_from, plant, seed)
        asked = {"file": str(path), **read_networks(path).origin}
    if (found := _found(cfg, plant, seed, run)) is None:
        return
    own = found.started_from
    if (own and [own.get(key) for key in _ORIGIN]) != (asked and [asked.get(key) for key in _ORIGIN]):
        said = [f"{o['file']} (update {o.get('iteration')})" if o else "networks as drawn" for o in (own, asked)]
        raise RunError(f"{run}: started from {said[0]}, asked for is {said[1]}; {found.remedy}")


def _env(cfg: StudyCfg, plant: str, threads: int = 0) -> TaskCfg:
    return plant_cfg(
        plant,
        num_envs=cfg.num_envs,
        terrain=cfg.terrain,
        threads=threads,
        randomize=cfg.randomize,
        power_price=cfg.power_price,
        coupling=cfg.coupling,
    )


def _trainer(cfg: StudyCfg, plant: str, seed: int, run: Path, threads: int) -> Trainer:
    saved = run / "checkpoint.pt"
    begin = None if saved.is_file() or cfg.start_from is None else start_file(cfg.start_from, plant, seed)
    command = (
        f"mrwarp study train --plants {plant} --seeds {seed} --num-envs {cfg.num_envs} --iterations "
        f"{cfg.iterations} --terrain {cfg.terrain} --randomize {cfg.randomize}"
        + (f" --power-price {cfg.power_price:g}" if plant in PAYING else f" --coupling {cfg.coupling.value}")
        + f" --desired-kl {cfg.learning.desired_kl:g} --entropy {cfg.learning.entropy:g}"
        + ("" if cfg.learning.symmetry else " --symmetry off")
        + (f" --start-from {cfg.start_from}" if cfg.start_from else "")
    )
    train_cfg = TrainCfg(
        task=replace(_env(cfg, plant, threads), seed=seed),
        ppo=cfg.learning,
        run=RunCfg(out=run, iterations=cfg.iterations, no_gate=True, check_every=float("inf"), command=command),
    )
    return Trainer(train_cfg, resume=saved if saved.is_file() else None, start_from=begin)


def _result(run: Path) -> dict[str, Any]:
    """Result of a training in its folder; ValueError if it is none."""
    path = run / "result.json"
    content = read_json_file(path, _REMEDY)
    lacks = [key for key in (*_COPIED, "seed") if not isinstance(content, dict) or key not in content]
    if lacks := lacks or [k for k, kind in (("iterations", int), ("task", dict)) if not isinstance(content[k], kind)]:
        raise ValueError(f"{path}: no result of a training ({lacks[0]} is missing or wrong); {_REMEDY}")
    return content


def _record(run: Path, plant: str, seed: int) -> dict[str, Any]:
    result = _result(run)
    rows = checkpoint.load(run / "checkpoint.pt")["rows"][: result["iterations"]]  # it may have gone on since
    stride = max(-(-len(rows) // POINTS), 1)
    kept = rows[stride - 1 :: stride]
    return {
        "plant": plant,
        "seed": seed,
        **{key: result[key] for key in _COPIED},
        "learning": plain(ppo_of(result)),
        "started_from": result.get("started_from"),  # results of earlier versions have none
        "curve": {key: [row[key] for row in kept] for key in KEPT if kept and key in kept[0]},
    }


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Reward per second over the updates of one plant's trainings."""

    update: np.ndarray
    """PPO updates, shape (n,)."""
    reward: np.ndarray
    """Reward per second, shape (seeds, n)."""

    @property
    def mean(self) -> np.ndarray:
        """Mean over seeds, shape (n,)."""
        return self.reward.mean(axis=0)

    @property
    def sd(self) -> np.ndarray:
        """Sample standard deviation over seeds, 0 for one, shape (n,)."""
        return self.reward.std(axis=0, ddof=1) if len(self.reward) > 1 else np.zeros(self.reward.shape[1])


def figure5(
    folder: Path = STUDY, *, plants: Sequence[str] = (CONVENTIONAL, AWARE), seeds: Sequence[int] = SEEDS
) -> dict[str, Curve]:
    """Read the learning curves of some plants' trainings from their records; one curve per plant.

    Raises:
        RunError: a record is missing or damaged, or records differ in length.
        ValueError: a seed is named twice.
    """
    check_seeds(seeds)
    found = {}
    for plant in plants:
        curves = [_read_curve(record_file(folder, plant, seed)) for seed in seeds]
        if any(not np.array_equal(update, curves[0][0]) for update, _ in curves):
            raise RunError(f"{folder}: records of {plant} differ in length; train all with the same --iterations")
        found[plant] = Curve(update=curves[0][0], reward=np.stack([reward for _, reward in curves]))
    return found


def _read_curve(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Updates, and reward per second after each."""
    try:
        curve = json.loads(path.read_text(encoding="utf-8"))["curve"]
        return np.asarray(curve["iteration"], dtype=float), np.asarray(curve["reward"], dtype=float)
    except FileNotFoundError as error:
        raise RunError(f"{path}: no such record; 'mrwarp study train' and 'collect' make it") from error
    except (ValueError, KeyError, TypeError) as error:
        raise RunError(f"{path}: no training record ({error!r}); collect it again") from error


def plot(curves: dict[str, Curve], path: Path) -> None:
    """Draw the curves of :func:`figure5` with bands of one standard deviation."""
    figure, ((axes,),) = panels((7, 4.2))
    for (plant, curve), colour in zip(curves.items(), cycle(COLOURS), strict=False):
        axes.plot(curve.update, curve.mean, color=colour, label=TITLES.get(plant, plant), linewidth=1.4)
        axes.fill_between(curve.update, curve.mean - curve.sd, curve.mean + curve.sd, color=colour, alpha=0.2)
    axes.set_xlabel("PPO update")
    axes.set_ylabel("reward [1/s]")
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=120)
