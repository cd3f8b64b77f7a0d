"""A new training that begins with the networks of an earlier one of another task, e.g. rough ground after flat."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from mrwarp.rl import checkpoint

NETWORKS = ("actor", "critic")
"""What is taken over, with observation normalisers and exploration noise; optimiser, environment and draws are new."""


def take_networks(algorithm: Any, path: Path) -> dict[str, Any]:
    """Give actor and critic the weights of a checkpoint.

    Args:
        algorithm: rsl-rl's PPO of the new training.
        path: Checkpoint of any task whose observations and actions are as many, by any number of processes.

    Returns:
        Where the networks come from, for the record: ``checkpoint``, its ``task``, ``seed`` and ``iteration``.

    Raises:
        CheckpointError: it cannot be read, or its networks do not fit the new task; nothing has been taken over.
    """
    content = checkpoint.load(path)
    try:
        source = {"checkpoint": str(path), **{name: content[name] for name in ("task", "seed", "iteration")}}
        saved = {name: dict(content["algorithm"][f"{name}_state_dict"]) for name in NETWORKS}
        for name in NETWORKS:
            _check_shapes(getattr(algorithm, name).state_dict(), saved[name], name, path, content["task"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, checkpoint.CheckpointError):
            raise
        cause = " ".join(str(error).split())
        raise checkpoint.CheckpointError(
            f"{path}: does not fit this version of mrwarp ({cause}); start from another checkpoint"
        ) from error
    for name in NETWORKS:
        getattr(algorithm, name).load_state_dict(saved[name], strict=True)
    return source


def _check_shapes(own: dict[str, torch.Tensor], saved: dict[str, Any], name: str, path: Path, task: Any) -> None:
    """Raise CheckpointError unless the saved tensors are those of the new network, all of them numbers."""
    trained = f"it was trained on {task['robot']} with {task['actuator']}"
    remedy = "start from a checkpoint of a robot with the same joints and devices"
    for key in sorted(own.keys() | saved.keys()):
        shapes = [tuple(net[key].shape) if key in net else "none" for net in (saved, own)]
        if shapes[0] != shapes[1]:
            differ = f"its {name} has {key} of shape {shapes[0]}, this training needs {shapes[1]}"
            raise checkpoint.CheckpointError(f"{path}: {differ} ({trained}); {remedy}")
        if not bool(torch.isfinite(saved[key]).all()):
            raise checkpoint.CheckpointError(f"{path}: its {name} holds no numbers in {key}; use an earlier checkpoint")
