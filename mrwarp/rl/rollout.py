"""A rollout as the learning phase takes it: gathered, normalised and cut into mini-batches once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from rsl_rl.models import MLPModel
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict


def inputs(model: MLPModel, observations: Mapping[str, torch.Tensor] | TensorDict) -> torch.Tensor:
    """What the model's first layer takes: its observation groups side by side, normalised, shape (..., inputs)."""
    groups = [observations[group] for group in model.obs_groups]
    return model.obs_normalizer(groups[0] if len(groups) == 1 else torch.cat(groups, -1))


@dataclass(frozen=True, kw_only=True)
class Rollout:
    """N samples of a rollout with J actions, in a shuffled order that all passes share."""

    actor_inputs: torch.Tensor
    """Normalised observations of the actor, shape (N, inputs)."""
    critic_inputs: torch.Tensor
    """Normalised observations of the critic, shape (N, inputs)."""
    actions: torch.Tensor
    """Actions, shape (N, J)."""
    means: torch.Tensor
    """Means of the collecting policy, shape (N, J)."""
    log_probs: torch.Tensor
    """Log-probabilities of the actions under the collecting policy, shape (N,)."""
    costs: torch.Tensor
    """Advantages with the sign of a cost, shape (N,)."""
    values: torch.Tensor
    """Values that the critic gave when collecting, shape (N,)."""
    returns: torch.Tensor
    """Returns, shape (N,)."""

    @classmethod
    def of(cls, storage: RolloutStorage, actor: MLPModel, critic: MLPModel, order: torch.Tensor) -> Rollout:
        """What ``storage`` holds.

        Args:
            storage: A full rollout of a policy whose first distribution parameter is the mean.
            actor: Normalises its observations.
            critic: Normalises its observations.
            order: Numbers step * num_envs + environment of the samples, shape (N,).
        """

        def taken(values: torch.Tensor) -> torch.Tensor:
            return values.flatten(0, 1).index_select(0, order)

        def taken_by(model: MLPModel) -> torch.Tensor:
            return inputs(model, {group: taken(storage.observations[group]) for group in model.obs_groups})

        assert storage.distribution_params is not None
        return cls(
            actor_inputs=taken_by(actor),
            critic_inputs=taken_by(critic),
            actions=taken(storage.actions),
            means=taken(storage.distribution_params[0]),
            log_probs=taken(storage.actions_log_prob)[:, 0],
            costs=taken(storage.advantages)[:, 0].neg(),
            values=taken(storage.values)[:, 0],
            returns=taken(storage.returns)[:, 0],
        )

    def split(self, size: int) -> list[Rollout]:
        """Mini-batches of ``size`` samples."""
        parts = {name: values.split(size) for name, values in vars(self).items()}
        count = len(self.actions) // size
        return [Rollout(**{name: values[k] for name, values in parts.items()}) for k in range(count)]
