"""The task in checkpoints, policies and results: :class:`TaskCfg` as plain values, and files of earlier versions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.mdp_cfg import RewardCfg, make_terrain_cfg
from mrwarp.env.rewards import TERMS, check, flat
from mrwarp.model_file import Model, ModelFileError, load_model, model_from_dict, model_to_dict, read_device
from mrwarp.options.plain_values import plain, read
from mrwarp.resources import MODELS
from mrwarp.usd.robot import CURRENT_GROUPS

FREE = ("capture", "keep_data", "deterministic", "seed")
"""Fields that say how a task is computed, or that a training has for itself: it may go on with others."""

OLD = {"engine": "backend", "current": "current_by"}
"""Names of entries that had, or have, another one than their field; the engine is the one that was taken."""


def record(cfg: TaskCfg) -> dict[str, Any]:
    """The task as JSON gives it back. The ground stands there by name, rewards with the weights of all terms.

    ``mr_model`` is the device of ``model`` itself, so that the policy has it wherever its file goes.
    """
    device = None if cfg.model is None else read_device(cfg.model)
    return _entries(cfg) | {"mr_model": model_to_dict(device) if isinstance(device, Model) else None}


def trained_device(task: Mapping[str, Any], policy: str | Path) -> Model | None:
    """The device that a policy was trained with in place of its robot's own; None: the robot's own.

    Args:
        task: What :func:`record` wrote, in this or an earlier version.
        policy: Its file, for the refusal.

    Raises:
        ModelFileError: the device cannot be used, or stands in a file that is no longer there.
    """
    if task.get("mr_model") is not None:
        return model_from_dict(task["mr_model"], f"{policy}: mr_model")
    named = task.get("model")
    if named is None:
        return None
    try:
        return load_model(str(named))
    except ModelFileError as error:
        text = f"{policy}: was trained with --model {named}; name that device with --model ({error})"
        raise ModelFileError(text) from None


def _entries(cfg: TaskCfg) -> dict[str, Any]:
    content = plain(cfg)
    source = cfg.model if cfg.model is None or isinstance(cfg.model, str) else cfg.model.fitted_on.source
    content |= {"model": source, "engine": cfg.engine.value, "step_dt": cfg.step_dt, "rewards": flat(cfg.rewards)}
    if cfg.terrain == make_terrain_cfg("rough") or cfg.terrain is None:
        content["terrain"] = "rough" if cfg.terrain else "flat"
    del content["backend"], content["threads"]  # threads are the machine's, and change no bit
    return content


def task_of(content: Mapping[str, Any]) -> TaskCfg:
    """The task that :func:`record` wrote, in this or an earlier version.

    Raises:
        ValueError: an entry is of another kind than the task's, or not in its range.
    """
    found: dict[str, Any] = {"z_step": "euler"}  # files that name no step are older than the exact one
    found |= {OLD.get(name, name): value for name, value in content.items()}
    if isinstance(found.get("terrain"), str):
        rough = make_terrain_cfg(found["terrain"])
        found["terrain"] = plain(rough)
    if Path(str(found.get("actuator_file"))).parent.name == MODELS.name:  # a shipped one, by its name
        found["actuator_file"] = None
    for name in ("lstm_state", "residual_engine", "currents"):  # earlier versions wrote none where it does not matter
        if found.get(name, 0) is None or found.get(name) == list(CURRENT_GROUPS):
            del found[name]
    if "rewards" in found:
        found["rewards"] = _weights(found["rewards"])
    cfg = read(TaskCfg, found)
    check(cfg.rewards)
    return cfg


def identity(cfg: TaskCfg) -> dict[str, Any]:
    """The entries of :func:`record` by which a task differs from another."""
    return {name: value for name, value in _entries(cfg).items() if name not in FREE}


def differences(content: Mapping[str, Any], cfg: TaskCfg) -> Iterator[tuple[str, Any, Any]]:
    """Name, recorded and own value of what differs between a recorded task and one's own.

    Raises:
        ValueError: the record cannot be read.
    """
    theirs, own = identity(task_of(content)), identity(cfg)
    yield from ((name, theirs[name], own[name]) for name in own if theirs[name] != own[name])


def _weights(flat: Any) -> dict[str, Any]:
    """Entries of :class:`RewardCfg` from all weights and shapes side by side; terms that a file lacks had none."""
    if not isinstance(flat, Mapping):
        raise ValueError(f"rewards = {flat!r} is no table")
    shapes = plain(RewardCfg())
    weights = {name: value for name, value in flat.items() if name not in shapes}
    weights = {**dict.fromkeys(TERMS, 0.0), **weights}
    own = {name: term.weight for name, term in TERMS.items()}
    return {
        **{name: value for name, value in flat.items() if name in shapes},
        "weights": {name: value for name, value in weights.items() if own.get(name) != value},
    }
