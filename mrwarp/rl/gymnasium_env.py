"""The walking task as a ``gymnasium.vector.VectorEnv`` of NumPy arrays, for libraries that take these."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector.utils import batch_space

from mrwarp.env.vec_env import WalkEnv


class GymWalkEnv(gymnasium.vector.VectorEnv):
    """:class:`mrwarp.env.vec_env.WalkEnv` behind gymnasium's interface, with autoreset in the same step.

    Observations are the actor's, float32, shape (N, O); ``info["critic"]`` has the critic's. Actions are unbounded:
    joint targets about the stance in units of ``cfg.action_scale``.

    Args:
        env: The task, on any device; arrays pass the host.
    """

    metadata: dict[str, Any] = {"autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}

    def __init__(self, env: WalkEnv) -> None:
        self.env, self.num_envs = env, env.num_envs
        observed = env.get_observations()["actor"].shape[1]
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (observed,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-np.inf, np.inf, (env.num_actions,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin all episodes; another seed than the task's needs another task.

        Raises:
            ValueError: the seed is not that of the task's configuration.
        """
        if seed is not None and seed != self.env.cfg.seed:
            raise ValueError(f"seed = {seed}: the task was made with {self.env.cfg.seed}; make a WalkEnv with the seed")
        self.env.restart()
        return self._observed()

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """A policy step of 20 ms: observations, rewards, terminations (falls), truncations (time) and infos."""
        action = torch.as_tensor(np.asarray(actions, dtype=np.float32), device=self.env.device)
        _, reward, done, extras = self.env.step(action)
        late = extras["time_outs"].bool()
        observed, info = self._observed()
        ended = done.bool() & ~late
        return observed, reward.cpu().numpy(), ended.cpu().numpy(), late.cpu().numpy(), info

    def close_extras(self, **_: Any) -> None:
        """Nothing to close."""

    def _observed(self) -> tuple[np.ndarray, dict[str, Any]]:
        found = self.env.get_observations()
        return found["actor"].cpu().numpy(), {"critic": found["critic"].cpu().numpy()}
