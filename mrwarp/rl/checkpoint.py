"""Checkpoints: everything a training needs to go on as if it had never stopped, written atomically, read as data.

Checkpoints, exported policies and results all carry the task that a policy was trained on, see :func:`task`. Loads no
engine: what cannot be resumed is refused before one is loaded.
"""

from __future__ import annotations

import io
import json
import os
import pickle
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from mrwarp.resources import MODELS, shipped_model
from mrwarp.rl.ppo_cfg import LearningCfg
from mrwarp.run_dir import atomic_write, no_file

if TYPE_CHECKING:
    from mrwarp.env.cfg import EnvCfg

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


def task(cfg: EnvCfg) -> dict[str, Any]:
    """The task that a policy was trained on, as JSON gives it back, so that it can be compared with a saved one."""
    file = cfg.actuator_file
    if file and file == shipped_model(cfg.actuator_model):
        file = portable(file)
    content = {
        "robot": cfg.robot,
        "payload": cfg.payload,
        "asset": cfg.asset,
        "actuator": cfg.actuator_model,
        "actuator_file": file,
        "lstm_state": cfg.lstm_state.value if "lstm" in cfg.actuator_model else None,
        "residual_engine": cfg.residual_engine.value if file else None,
        "model": cfg.model if isinstance(cfg.model, str | None) else cfg.model.fitted_on.source,
        "extrapolate": cfg.extrapolate,
        "coupling": cfg.actuator.coupling.value,
        "hold_current": cfg.actuator.hold_current.value,
        "z_step": cfg.actuator.z_step.value,
        "sal": cfg.actuator.sal,
        "current": cfg.current.value,
        "coil_lag": cfg.coil_lag,
        "hold_speed": cfg.hold_speed,
        "terrain": "rough" if cfg.terrain else "flat",
        "gains": list(cfg.gains) if cfg.gains else None,
        "randomize": asdict(cfg.randomize) if cfg.randomize else None,
        "rewards": cfg.rewards.flat(),
        "num_envs": cfg.sim.num_envs,
        "device": cfg.sim.device,
        "engine": cfg.sim.engine.value,
        "action_scale": cfg.action_scale,
        "step_dt": cfg.step_dt,
        "gait_frequency": cfg.gait_frequency,
    }
    return json.loads(json.dumps(content))


def portable(shipped: str) -> str:
    """A shipped network's name, which is the same in every checkout."""
    return f"{MODELS.name}/{Path(shipped).name}"


def learned(content: dict[str, Any]) -> dict[str, float]:
    """Settings of :class:`LearningCfg` in a checkpoint or result; earlier versions: the defaults, no symmetry."""
    said = content.get("learning")
    return {**asdict(LearningCfg(symmetry=False)), **(said if isinstance(said, dict) else {})}


def check_same(path: Path, content: dict[str, Any], own: Mapping[str, Any]) -> None:
    """Compare what a run asks for, by the names of :func:`task`, of the learning and ``seed``, with a checkpoint.

    Raises:
        CheckpointError: one of them differs.
        KeyError: the checkpoint lacks what each holds.
    """
    for name, value in {**content["task"], **learned(content), "seed": content["seed"]}.items():
        if name in own and own[name] != value:
            raise CheckpointError(
                f"{path}: trained with {name} = {value!r}, this run has {own[name]!r}; resume the same task"
            )
