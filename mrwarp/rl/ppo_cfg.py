"""PPO settings for rsl-rl, as fresh dictionaries (rsl-rl consumes what it is given)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

STEPS_PER_UPDATE = 24
"""Policy steps per environment and update."""

MINI_BATCH = 768
"""Least samples of a mini-batch: with less, the noise of the gradient uses up the step that the divergence allows."""


@dataclass(frozen=True, kw_only=True)
class LearningCfg:
    """How fast networks learn: what trainings of one task may differ in. As it is, to walk in a minute."""

    desired_kl: float = 0.04
    """Divergence between the policies of two updates that the learning rate is adapted to. With rsl-rl's usual 0.01 and
    mini-batches of 384 samples, 64 robots need more than twice the updates (docs/performance.md). But so long a step
    on so few samples shakes a gait about its optimum: to settle one, take more robots and 0.01 (docs/policies.md)."""
    entropy: float = 0.003
    """Weight of the entropy in the loss, which keeps up the exploration; a tenth of it settles a gait."""

    symmetry: bool = True
    """Whether networks treat left and right in the same way, see :mod:`mrwarp.rl.symmetry`; a robot that is not its own
    mirror image is trained without, and the training says so."""

    def __post_init__(self) -> None:
        if not 0.0 < self.desired_kl < math.inf:
            raise ValueError(f"desired_kl = {self.desired_kl} must be positive and finite")
        if not 0.0 <= self.entropy < math.inf:
            raise ValueError(f"entropy = {self.entropy} must be finite and not negative")


def make_ppo_cfg(
    num_envs: int, *, learning: LearningCfg | None = None, hidden: tuple[int, ...] = (128, 64), epochs: int = 5
) -> dict[str, Any]:
    """Settings of actor, critic and algorithm: small nets with observation normalisation, adaptive rate.

    ``num_envs`` are those of all processes together, ``epochs`` the passes over a rollout.
    """
    learning = learning or LearningCfg()

    def net() -> dict[str, Any]:
        return {"class_name": "MLPModel", "hidden_dims": list(hidden), "activation": "elu", "obs_normalization": True}

    return {
        "num_steps_per_env": STEPS_PER_UPDATE,
        "obs_groups": {"actor": ["actor"], "critic": ["critic"]},
        "actor": {**net(), "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 0.6}},
        "critic": net(),
        "algorithm": {
            "class_name": "PPO",
            "num_learning_epochs": epochs,
            "num_mini_batches": min(4, max(1, num_envs * STEPS_PER_UPDATE // MINI_BATCH)),
            "clip_param": 0.2,
            "gamma": 0.99,
            "lam": 0.95,
            "value_loss_coef": 1.0,
            "entropy_coef": learning.entropy,
            "learning_rate": 1e-3,
            "max_grad_norm": 1.0,
            "use_clipped_value_loss": True,
            "schedule": "adaptive",
            "desired_kl": learning.desired_kl,
        },
        "multi_gpu": None,
    }
