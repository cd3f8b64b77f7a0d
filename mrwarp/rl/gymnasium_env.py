"""The walking task in gymnasium: one robot as an ``Env``, and any number of them as a ``VectorEnv`` of NumPy arrays."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.rl import register_walk

register_walk()


class GymWalkEnv(gymnasium.vector.VectorEnv):
    """:class:`mrwarp.env.vec_env.WalkEnv` behind gymnasium's vector interface.

    Observations are the actor's, float32, shape (N, O); ``info["critic"]`` has the critic's. Actions are unbounded:
    joint targets about the stance in units of ``cfg.action_scale``.

    Args:
        env: The task, on any device; arrays pass the host.
        autoreset_mode: ``NEXT_STEP``, which all of gymnasium's wrappers take: the step after an end begins the next
            episode, without a reward, and takes no notice of that robot's action. Or ``SAME_STEP``: the step in which
            an episode ends returns the next one's first observation, and ``info["final_obs"]`` the last.

    Raises:
        ValueError: it is another mode.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(self, env: WalkEnv, *, autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP) -> None:
        self.env, self.num_envs, self.mode = env, env.num_envs, AutoresetMode(autoreset_mode)
        if self.mode is AutoresetMode.DISABLED:
            raise ValueError("autoreset_mode = DISABLED: who has fallen begins again; choose NEXT_STEP or SAME_STEP")
        self.metadata = {"autoreset_mode": self.mode}
        self.single_observation_space, self.single_action_space = _spaces(env)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._final = env.keep_final_observations()
        self._ended = np.zeros(self.num_envs, dtype=bool)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin all episodes, or those of ``options["reset_mask"]``.

        Args:
            seed: Seed of all draws from now on; robots and ground stay as they were made. None: the draws go on.
            options: ``reset_mask``: robots to reset, bool, shape (N,).

        Raises:
            ValueError: the seed is no whole number from 0, or the mask has another shape or type.
        """
        if seed is not None:
            self.env.restart(_seed(seed))
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise ValueError(f"reset_mask is {mask.dtype} of shape {mask.shape}, need bool of shape ({self.num_envs},)")
        if seed is None or not mask.all():
            self.env.begin_episodes(torch.as_tensor(mask, device=self.env.device))
        self._ended = self._ended & ~mask
        return _observed(self.env.last_observations)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """A policy step of 20 ms: observations, rewards, terminations (falls), truncations (time) and infos.

        Raises:
            ValueError: the actions have another shape.
        """
        action = _action(actions, (self.num_envs, self.env.num_actions))
        before = self._ended
        reward, fell, late = _stepped(self.env, action)
        if self.mode is AutoresetMode.SAME_STEP:
            observed, info = _observed(self.env.last_observations)
            return observed, reward, fell, late, info | self._ends(fell | late)
        if before.any():
            self.env.begin_episodes(torch.as_tensor(before, device=self.env.device))
            reward[before], fell[before], late[before] = 0.0, False, False
        observed, info = _observed(self.env.last_observations)
        self._ended = fell | late
        if self._ended.any():
            final, seen = _observed(self._final)
            observed[self._ended], info["critic"][self._ended] = final[self._ended], seen["critic"][self._ended]
        return observed, reward, fell, late, info

    def _ends(self, ended: np.ndarray) -> dict[str, Any]:
        """Last observations of the episodes that ended, as gymnasium's own vector environments give them."""
        if not ended.any():
            return {}
        final, info = _observed(self._final)
        found, seen = np.full((2, self.num_envs), None, dtype=object)
        for k in np.flatnonzero(ended):
            found[k], seen[k] = final[k], info["critic"][k]
        infos = {"critic": seen, "_critic": ended.copy()}
        return {"final_obs": found, "_final_obs": ended.copy(), "final_info": infos, "_final_info": ended.copy()}

    def close_extras(self, **_: Any) -> None:
        """Nothing to close."""


class MrGoWalk(gymnasium.Env):
    """One robot; ``gymnasium.make("mrwarp/MrGoWalk-v0")`` after ``import mrwarp.rl.gymnasium_env``.

    Args:
        render_mode: None; ``mrwarp play`` shows robots.
        task: Fields of :class:`mrwarp.TaskCfg`.

    Raises:
        ValueError: more than one robot is asked for, or a picture.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, *, render_mode: str | None = None, **task: Any) -> None:
        if task.get("num_envs", 1) != 1:
            raise ValueError(f"num_envs = {task['num_envs']}: this is one robot; gymnasium.make_vec makes several")
        if render_mode is not None:
            raise ValueError(f"render_mode = {render_mode!r}: there is none; 'mrwarp play' shows robots")
        self.render_mode = None
        self.env = WalkEnv(TaskCfg(**{**task, "num_envs": 1}))
        self._final = self.env.keep_final_observations()
        self.observation_space, self.action_space = _spaces(self.env)
        self._fresh = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; with a seed all draws follow from it, without one they go on."""
        super().reset(seed=seed)
        if seed is not None:
            self.env.restart(_seed(seed))
        elif not self._fresh:
            self.env.begin_episodes(torch.ones(1, dtype=torch.bool, device=self.env.device))
        self._fresh = True
        return self._one(self.env.last_observations)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """A policy step of 20 ms; after an end, reset.

        Raises:
            ValueError: the action has another shape.
        """
        reward, fell, late = _stepped(self.env, _action(action, (self.env.num_actions,))[None])
        ended = bool(fell[0] or late[0])
        self._fresh = ended  # the task has begun the next episode itself
        observed, info = self._one(self._final if ended else self.env.last_observations)
        return observed, float(reward[0]), bool(fell[0]), bool(late[0]), info

    @staticmethod
    def _one(found: Any) -> tuple[np.ndarray, dict[str, Any]]:
        observed, info = _observed(found)
        return observed[0], {"critic": info["critic"][0]}


def make_walks(
    num_envs: int = 1, *, autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, **task: Any
) -> GymWalkEnv:
    """Robots for ``gymnasium.make_vec("mrwarp/MrGoWalk-v0", num_envs=64)``; ``task``: fields of ``mrwarp.TaskCfg``."""
    return GymWalkEnv(WalkEnv(TaskCfg(num_envs=num_envs, **task)), autoreset_mode=autoreset_mode)


def _spaces(env: WalkEnv) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Observations and actions of one robot."""
    observed = env.get_observations()["actor"].shape[1]
    observation, action = (
        gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32) for size in (observed, env.num_actions)
    )
    return observation, action


def _seed(seed: object) -> int:
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"seed = {seed!r}: give one whole number from 0; all robots' draws follow from it")
    return int(seed)


def _action(given: Any, shape: tuple[int, ...]) -> np.ndarray:
    found = np.asarray(given, dtype=np.float32)
    if found.shape != shape:
        raise ValueError(f"actions have shape {found.shape}, need {shape}")
    return found


def _stepped(env: WalkEnv, action: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rewards, falls and ends by time of a step, shape (N,) each."""
    _, reward, done, extras = env.step(torch.as_tensor(action, device=env.device))
    late = extras["time_outs"].bool()
    return reward.cpu().numpy().copy(), (done.bool() & ~late).cpu().numpy(), late.cpu().numpy()


def _observed(found: Any) -> tuple[np.ndarray, dict[str, Any]]:
    """Arrays of their own: observations of the actor, and an info with the critic's."""
    return found["actor"].cpu().numpy().copy(), {"critic": found["critic"].cpu().numpy().copy()}
