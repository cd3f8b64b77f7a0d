"""Warm starts: a new training begins with the networks of an earlier one of another task, e.g. rough after flat."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from mrwarp.env.observations import actor_terms
from mrwarp.rl.checkpoint import CheckpointError, load
from mrwarp.rl.policy import OnnxPolicy, PolicyError
from mrwarp.rl.ppo_cfg import STEPS_PER_UPDATE
from mrwarp.run_dir import one_line

NETWORKS = ("actor", "critic")
"""Networks that are taken from a checkpoint, with normalisers and exploration noise; all else is new."""

NOISE = 0.15
"""Exploration to begin with when the file holds none: a policy's. Trained ones have 0.10 to 0.22, new ones 0.6, with
which a gait falls."""

CRITIC_FIRST = 100
"""Updates in which a new critic learns alone next to a policy's actor. Its values begin at 0 and move by at most
``clip_param`` an update, so that till then the advantages are wrong: an actor that followed them from the start lost a
quarter of its reward, or the gait, and took hundreds of updates to find it again (docs/policies.md)."""


@dataclass(frozen=True, kw_only=True)
class Networks:
    """Networks of an earlier training, read but not yet compared with those of the new one."""

    path: Path
    """File they stand in."""
    origin: dict[str, Any]
    """Training that the file is of: ``task``, ``seed`` and ``iteration``."""
    weights: dict[str, dict[str, torch.Tensor]]
    """Weights by network; the new training draws those that are not here."""
    divisor: torch.Tensor | None = None
    """Divisor of a policy's normaliser, shape (1, 47); its statistics follow from it. None from a checkpoint."""


def read_networks(path: Path) -> Networks:
    """Read what a new training shall begin with; needs no environment.

    Args:
        path: A checkpoint of any task whose observations and actions are as many, by any number of processes: actor and
            critic. Or an exported policy (.onnx): the actor alone, with :data:`NOISE`; the critic stays as drawn.

    Raises:
        CheckpointError: a checkpoint cannot be read.
        PolicyError: a policy cannot be read, or its metadata lack something.
    """
    if path.suffix == ".onnx":
        policy = OnnxPolicy(path)
        try:
            origin = {name: policy.description[name] for name in ("task", "seed", "iteration")}
            samples = int(origin["iteration"]) * STEPS_PER_UPDATE * int(origin["task"]["num_envs"])
            weights, divisor = policy.actor()
        except (KeyError, TypeError, ValueError) as error:
            raise PolicyError(f"{path}: lacks {one_line(error)}; use a policy of 'mrwarp train'") from error
        weights["obs_normalizer.count"] = torch.tensor(max(samples, 1))  # it weighs as much as what it was trained on
        return Networks(path=path, origin=origin, weights={"actor": weights}, divisor=divisor)
    content = load(path)
    try:
        origin = {name: content[name] for name in ("task", "seed", "iteration")}
        saved = {name: dict(content["algorithm"][f"{name}_state_dict"]) for name in NETWORKS}
        if not isinstance(origin["task"], dict):
            raise TypeError("task is no table")
        if wrong := [key for net in saved.values() for key, value in net.items() if not torch.is_tensor(value)]:
            raise TypeError(f"{wrong[0]} is no tensor")
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise CheckpointError(
            f"{path}: does not fit this version of mrwarp ({one_line(error)}); start from another checkpoint"
        ) from error
    return Networks(path=path, origin=origin, weights=saved)


def take_networks(algorithm: Any, networks: Networks) -> dict[str, Any]:
    """Give the networks of a new training, rsl-rl's PPO, the weights of an earlier one.

    Returns:
        Where the networks come from, for the record: ``file``, its ``task``, ``seed`` and ``iteration``.

    Raises:
        CheckpointError: networks do not fit the new task; nothing has been taken over.
    """
    saved = networks.weights
    if networks.divisor is not None:  # the file holds neither the normaliser's spread nor the noise
        std = (networks.divisor - algorithm.actor.obs_normalizer.eps).clamp(min=0.0)
        noise = torch.full_like(algorithm.actor.state_dict()["distribution.std_param"], NOISE)
        spread = {"obs_normalizer._std": std, "obs_normalizer._var": std.square(), "distribution.std_param": noise}
        saved = {"actor": {**saved["actor"], **spread}}
    saved = _with_currents(algorithm, saved)
    for name, weights in saved.items():
        own, what = getattr(algorithm, name).state_dict(), f"{networks.path}: its {name}"
        for key in sorted(own.keys() | weights.keys()):
            theirs, ours = (tuple(net[key].shape) if key in net else "none" for net in (weights, own))
            if theirs != ours:
                task = networks.origin["task"]
                raise CheckpointError(
                    f"{what} has {key} of shape {theirs}, this training needs {ours} (it was trained on "
                    f"{task.get('robot')} with {task.get('actuator')}); start from a robot with the same joints and "
                    "devices"
                )
            if not bool(torch.isfinite(weights[key]).all()):
                raise CheckpointError(f"{what} holds no numbers in {key}; use an earlier one")
    for name, weights in saved.items():
        getattr(algorithm, name).load_state_dict(weights, strict=True)
    return {"file": str(networks.path), **networks.origin}


def _with_currents(algorithm: Any, saved: dict[str, dict[str, torch.Tensor]]) -> dict[str, dict[str, torch.Tensor]]:
    """Networks that commanded no coils, for a training whose policy does: as they were, and 0 for the new actions.

    Where the new actor has no more actions than the saved one, nothing changes.
    """
    own, last = algorithm.actor.state_dict(), [key for key in saved["actor"] if key.startswith("mlp.")]
    if not last or last[-1] not in own or own[last[-1]].shape[0] <= saved["actor"][last[-1]].shape[0]:
        return saved
    joints, actions = saved["actor"][last[-1]].shape[0], own[last[-1]].shape[0]
    column, currents = sum(actor_terms(joints).values()) - 2, actions - joints  # before the clock

    def wider(weights: torch.Tensor, axis: int, at: int, value: float) -> torch.Tensor:
        shape = list(weights.shape)
        shape[axis] = currents
        before, after = weights.split([at, weights.shape[axis] - at], axis)
        return torch.cat([before, weights.new_full(shape, value), after], axis)

    found = {}
    for name, net in saved.items():
        layers = sorted(key for key in net if key.startswith("mlp."))
        found[name] = new = dict(net)
        for key in net:
            if key.startswith("obs_normalizer._"):
                new[key] = wider(net[key], 1, column, 0.0 if key.endswith("mean") else 1.0)
            elif key == "distribution.std_param" and len(net[key]) == joints:
                new[key] = wider(net[key], 0, joints, NOISE)
            elif key == layers[1]:  # weight of the first layer
                new[key] = wider(net[key], 1, column, 0.0)
            elif key in layers[-2:] and name == "actor":
                new[key] = wider(net[key], 0, joints, 0.0)
    return found


def critic_learns_alone(origin: dict[str, Any] | None, iteration: int) -> bool:
    """Whether after so many updates of a training the actor waits for a critic that is new (see :data:`CRITIC_FIRST`).

    ``origin`` is what :func:`take_networks` gave; None if all networks are new, which learn together.
    """
    return origin is not None and Path(origin["file"]).suffix == ".onnx" and iteration < CRITIC_FIRST
