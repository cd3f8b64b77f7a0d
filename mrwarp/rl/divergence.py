"""Numbers that go wrong in a training: divergences are counted and dumped, too many of them stop it."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from mrwarp.env import nan_dump
from mrwarp.env.vec_env import WalkEnv
from mrwarp.rl.ranks import Ranks

WINDOW = 50
"""Updates over which divergences and progress figures are averaged."""

MAX_DIVERGED = 0.01
"""Largest share of environments in which a number may go wrong: in one update (one environment always may), and on
average over the last :data:`WINDOW` updates."""

MAX_DUMPS = 20
"""Most files that one run writes of environments that diverged."""


class DivergenceError(RuntimeError):
    """Numbers went wrong in too many environments; the message says in how many, when, and which was first."""


class Divergences:
    """Episodes of a training's environments that ended because a number went wrong.

    Args:
        env: The environments of this process.
        ranks: The processes that train together.
        folder: Where the last states of such environments are written.
        run: What a dump says of the training, besides the update.

    Attributes:
        count: Divergences so far, of all processes.
    """

    def __init__(self, env: WalkEnv, ranks: Ranks, folder: Path, run: Mapping[str, Any]) -> None:
        self.count = 0
        self._env, self._ranks, self._folder, self._run = env, ranks, folder, dict(run)
        self._window: deque[int] = deque(maxlen=WINDOW)
        self._dumps = 0

    def take(self, update: int) -> bool:
        """Count, dump and print what diverged in an update; False if its rollout must not be learned from.

        Raises:
            DivergenceError: they are more than :data:`MAX_DIVERGED`.
        """
        found = self._env.nan_guard.take()
        # a wrong state or torque ends in the environment; a wrong action stands in the rollout itself
        unusable = any(not item.finite and item.columns[item.column].quantity == "action" for item in found)
        count, spoilt = (round(total) for total in self._ranks.total(len(found), unusable))
        self._window.append(count)
        self.count += count
        rank = f"-rank{self._ranks.rank}" if self._ranks.world > 1 else ""
        for item in found[: MAX_DUMPS - self._dumps]:
            self._dumps += 1
            path = self._folder / f"update{update:06d}{rank}-env{item.env:05d}.safetensors"
            nan_dump.save(item, path, {"update": update, **self._run})
            print(f"  broken: {item}; started over, last states in {path}", flush=True)
        num_envs = self._env.num_envs * self._ranks.world
        at_once, window = count > max(1.0, MAX_DIVERGED * num_envs), sum(self._window) / (WINDOW * num_envs)
        if at_once or window > MAX_DIVERGED:
            first = next(item for items in self._ranks.share(found) for item in items)
            when = f"in update {update}" if at_once else f"per update over the last {WINDOW}"
            raise DivergenceError(
                f"numbers went wrong in {count / num_envs if at_once else window:.1%} of the environments {when}, more "
                f"than {MAX_DIVERGED:.0%}; first: {first}; see 'mrwarp replay-dump' on the files in {self._folder}"
            )
        return not spoilt

    def state(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return {"breaks": self.count, "broken_window": list(self._window), "dumps": self._dumps}

    def load_state(self, content: Mapping[str, Any]) -> None:
        """Go on from a checkpoint; files of an earlier version count no divergences."""
        self.count, self._dumps = content.get("breaks", 0), content.get("dumps", 0)
        self._window.extend(content.get("broken_window", []))


def not_finite(values: Any, name: str = "") -> str:
    """Name of the first tensor in nested dictionaries and lists that holds NaN or infinity; empty without."""
    if isinstance(values, torch.Tensor):
        return "" if not values.is_floating_point() or bool(torch.isfinite(values).all()) else name
    items = values.items() if isinstance(values, dict) else enumerate(values) if isinstance(values, list) else ()
    return next((wrong for key, value in items if (wrong := not_finite(value, f"{name}.{key}".lstrip(".")))), "")
