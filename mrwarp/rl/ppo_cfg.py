"""PPO settings for rsl-rl, as fresh dictionaries (rsl-rl consumes what it is given)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from mrwarp.options import option_types as opt

STEPS_PER_UPDATE = 24
"""Policy steps per environment and update."""

MINI_BATCH = 768
"""Least samples of a mini-batch: with less, the noise of the gradient uses up the step that the divergence allows."""


@dataclass(frozen=True, kw_only=True)
class PpoCfg:
    """How fast networks learn: what trainings of one task may differ in. As it is, to walk in a minute.

    With rsl-rl's usual divergence of 0.01 and mini-batches of 384 samples, 64 robots need more than twice the updates
    (docs/performance.md). But so long a step on so few samples shakes a gait about its optimum: to settle one, take
    more robots, 0.01 and a tenth of the entropy (docs/policies.md).
    """

    desired_kl: opt.Positive = 0.04
    """divergence between the policies of two updates that the learning rate is adapted to; 0.01 settles a gait"""
    entropy: opt.NotNegative = 0.003
    """weight of the entropy, which keeps up exploration, in the loss"""
    symmetry: opt.OnOff = True
    """whether networks treat left and right in the same way, where the robot is its own mirror image"""

    def __post_init__(self) -> None:
        if not 0.0 < self.desired_kl < math.inf:
            raise ValueError(f"desired_kl = {self.desired_kl} must be positive and finite")
        if not 0.0 <= self.entropy < math.inf:
            raise ValueError(f"entropy = {self.entropy} must be finite and not negative")


def make_ppo_cfg(
    num_envs: int, *, ppo: PpoCfg | None = None, hidden: tuple[int, ...] = (128, 64), epochs: int = 5
) -> dict[str, Any]:
    """Settings of actor, critic and algorithm: small nets with observation normalisation, adaptive rate.

    ``num_envs`` are those of all processes together, ``epochs`` the passes over a rollout.
    """
    ppo = ppo or PpoCfg()

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
            "entropy_coef": ppo.entropy,
            "learning_rate": 1e-3,
            "max_grad_norm": 1.0,
            "use_clipped_value_loss": True,
            "schedule": "adaptive",
            "desired_kl": ppo.desired_kl,
        },
        "multi_gpu": None,
    }
