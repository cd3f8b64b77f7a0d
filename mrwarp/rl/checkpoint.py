"""Checkpoints: everything a training needs to go on as if it had never stopped, written atomically, read as data.

Checkpoints, exported policies and results all carry the task that a policy was trained on, see
:mod:`mrwarp.rl.task_record`. What cannot be resumed is refused before an environment is made.
"""

from __future__ import annotations

import io
import os
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from mrwarp.options.plain_values import plain, read
from mrwarp.rl.ppo_cfg import PpoCfg
from mrwarp.rl.task_record import differences, record, task_of
from mrwarp.rl.train_cfg import RunCfg, TrainCfg
from mrwarp.run_dir import atomic_write, no_file

FORMAT = 1
"""Version of the checkpoint's layout."""


class CheckpointError(ValueError):
    """A checkpoint cannot be used; the message names the file and the remedy."""


def save(path: Path, content: dict[str, Any]) -> None:
    """Write a checkpoint of tensors and plain values; the old file stays whole until the new one is complete."""
    # in memory first: torch answers a full disk with errors of its own, in a half-written archive
    data = io.BytesIO()
    torch.save({"format": FORMAT, **content}, data)
    with atomic_write(path) as partial, partial.open("wb") as file:
        file.write(data.getbuffer())
        file.flush()
        os.fsync(file.fileno())


def load(path: Path) -> dict[str, Any]:
    """Read a checkpoint as data only: nothing in the file is executed.

    Raises:
        CheckpointError: there is no such file, it is damaged, holds code, or is of another version.
    """
    if not path.is_file():
        raise CheckpointError(f"{path}: {no_file(path, 'checkpoint')}; name the file checkpoint.pt that training wrote")
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise CheckpointError(
            f"{path}: refused, it is no checkpoint or holds more than tensors and plain values; "
            "use a checkpoint that mrwarp wrote"
        ) from error
    except Exception as error:  # torch raises many types for damaged bytes, IndexError among them
        cause = str(error).partition("\n")[0]
        raise CheckpointError(f"{path}: damaged ({cause}); use an earlier checkpoint or start again") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = content.get("format") if isinstance(content, dict) else type(content).__name__
        raise CheckpointError(f"{path}: format {found!r} is not {FORMAT}; it was written by another version of mrwarp")
    return content


def random_state(device: torch.device) -> dict[str, torch.Tensor]:
    """State of torch's random generators: the CPU's, and that of ``device`` if it is a GPU."""
    state = {"torch_rng": torch.get_rng_state()}
    if device.type == "cuda":
        state["cuda_rng"] = torch.cuda.get_rng_state(device)
    return state


def set_random_state(content: dict[str, Any], device: torch.device) -> str:
    """Put back what :func:`random_state` gave; a note if there is none of the GPU's, as in earlier versions."""
    torch.set_rng_state(content["torch_rng"])
    if device.type != "cuda":
        return ""
    if "cuda_rng" not in content:
        return f"holds no random state of {device}, as earlier versions wrote it; goes on, but with other draws"
    torch.cuda.set_rng_state(content["cuda_rng"], device)
    return ""


def settings(cfg: TrainCfg) -> dict[str, Any]:
    """Entries of a checkpoint that keep the configuration; folder and command line are those of whoever goes on."""
    run = {name: value for name, value in plain(cfg.run).items() if name not in ("out", "command")}
    return {"seed": cfg.task.seed, "task": record(cfg.task), "learning": plain(cfg.ppo), "run": run}


def saved_cfg(content: Mapping[str, Any]) -> TrainCfg:
    """The configuration of a checkpoint, of this or an earlier version.

    Raises:
        KeyError: the checkpoint has no task or seed.
        ValueError: an entry cannot be used.
    """
    task = task_of({**content["task"], "seed": content["seed"]})
    return TrainCfg(task=task, ppo=ppo_of(content), run=read(RunCfg, content.get("run", {})))


def ppo_of(content: Mapping[str, Any]) -> PpoCfg:
    """How networks learned, by a checkpoint or result; earlier versions: the defaults, no symmetry.

    Raises:
        ValueError: an entry cannot be used.
    """
    said = content.get("learning")
    return read(PpoCfg, {"symmetry": False, **(said if isinstance(said, Mapping) else {})})


def check_same(path: Path, content: Mapping[str, Any], cfg: TrainCfg) -> None:
    """Compare a training's task, learning and seed with a checkpoint's.

    Raises:
        CheckpointError: one of them differs.
        KeyError: the checkpoint lacks what each holds.
        ValueError: an entry of it cannot be used.
    """
    own, said = plain(cfg.ppo), plain(ppo_of(content))
    others = [(name, said[name], own[name]) for name in own if said[name] != own[name]]
    if content["seed"] != cfg.task.seed:
        others.append(("seed", content["seed"], cfg.task.seed))
    for name, theirs, ours in (*differences(content["task"], cfg.task), *others):
        raise CheckpointError(f"{path}: trained with {name} = {theirs!r}, this run has {ours!r}; resume the same task")
