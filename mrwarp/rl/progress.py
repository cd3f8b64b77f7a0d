"""How a training goes: figures of its updates and gate checks as rows, lines and a picture; numbers that go wrong."""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch

from mrwarp.env import nan_dump
from mrwarp.env.vec_env import WalkEnv
from mrwarp.options.progress_bar import roughly
from mrwarp.rl.ranks import Ranks
from mrwarp.runtime import panels
from mrwarp.trials.gait_rules import Rules
from mrwarp.trials.walking import WalkingGate

WINDOW = 50
"""Updates over which divergences and progress figures are averaged."""

TYPICAL = (64, 288.0)
"""Robots, and updates to the walking gate: the mean of seeds 0 to 4 (docs/performance.md). 4096 robots took 107: the
number falls with the fourth root of the robots."""

SETTLING = "--reward tilt=-100 --num-envs 256 --desired-kl 0.01 --entropy 0.0005 --no-gate --iterations 400"
"""Options of a training that settles a gait (docs/policies.md)."""

SETTLED = 10
"""Updates after which the time of an update is known."""

MAX_DIVERGED = 0.01
"""Largest share of environments in which a number may go wrong: in one update (one environment always may), and on
average over the last :data:`WINDOW` updates."""

MAX_DUMPS = 20
"""Most files that one run writes of environments that diverged."""


class Progress:
    """Figures of a training.

    Attributes:
        rows: One row of figures per update, each averaged over the last :data:`WINDOW` updates.
        gate_rows: One row per gate check.
        window: Figures of those last updates alone.
    """

    def __init__(self) -> None:
        self.rows: list[dict[str, float]] = []
        self.gate_rows: list[dict[str, Any]] = []
        self.window: deque[dict[str, float]] = deque(maxlen=WINDOW)

    @property
    def gate_passed(self) -> bool:
        """Whether the last gate check passed."""
        return bool(self.gate_rows) and self.gate_rows[-1]["passed"]

    def update_seconds(self) -> float:
        """Median time of the last updates [s]: the first ones compile."""
        return statistics.median(1e-3 * (update["collect_ms"] + update["learn_ms"]) for update in self.window)

    def average(self, figures: dict[str, float]) -> dict[str, float]:
        """Means over the last updates, of which this is the newest."""
        self.window.append(figures)
        row = {name: sum(update[name] for update in self.window) / len(self.window) for name in figures}
        row["v_x_rmse"] = row.pop("v_x_square") ** 0.5
        return row

    def state(self) -> dict[str, Any]:
        """The part of a checkpoint that :meth:`load_state` takes."""
        return {"rows": self.rows, "window": list(self.window), "gate_rows": self.gate_rows}

    def load_state(self, content: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.rows, self.gate_rows = content["rows"], content["gate_rows"]
        self.window.extend(content["window"])


def figures_line(row: Mapping[str, float]) -> str:
    """Figures of an update for the progress bar."""
    falls = f"{row['falls_per_hour']:.0f}" if row["falls_per_hour"] < 9999.5 else "over 9999"
    return f"reward {row['reward']:.2f}, v_x RMSE {row['v_x_rmse']:.3f} m/s, falls {falls}/h"


def typical_updates(num_envs: int) -> float:
    """Updates after which a training on flat ground typically meets the walking gate."""
    return TYPICAL[1] * (TYPICAL[0] / max(num_envs, 1)) ** 0.25


def ending(iteration: int, each: float, iterations: int, typical: float | None) -> str:
    """Estimated end of a training: how long it takes to the gate typically, or all updates.

    Args:
        iteration: Updates so far.
        each: Time of an update [s].
        iterations: The most updates.
        typical: Updates to the walking gate; None trains all of them.
    """
    if typical is None or typical >= iterations:
        return f"about {roughly((iterations - iteration) * each)} left"
    left = (typical - iteration) * each
    return f"typically {roughly(left)} to the gate" if left > 0.0 else "longer than typical"


def gate_line(measured: dict[str, Any], gate: WalkingGate) -> str:
    """A gate check in one line."""
    failed = [name for name, holds in measured["conditions"].items() if not holds]
    return (
        f"  walking gate: reward {measured['reward']:.3f}, "
        f"v_x RMSE {rmse_at(measured, gate):.3f} m/s (<= {gate.rmse}), "
        f"never fell {measured['never_fell']:.0%}, height {measured['height']:.3f} m, "
        f"stride {measured['stride_frequency']:.2f} Hz, "
        f"clock {measured['clock_match']:.0%} -> " + (f"not yet: {', '.join(failed)}" if failed else "passed")
    )


def rules_line(measured: dict[str, Any], out: Path) -> str:
    """Which rules of a good gait a policy that walks does not keep yet, and how to go on; empty where it keeps all."""
    if not measured["passed"] or not measured.get("rules_not_kept"):
        return ""
    limits = {"sides": (100.0 * Rules().sides, "%"), "tilt_rms": (Rules().tilt_rms, "deg")}
    named = []
    for name in measured["rules_not_kept"]:
        limit, unit = limits.get(name, (Rules().lean, "deg"))
        named.append(f"{name} {measured['posture'][name]:.2g} {unit} (at most {limit:g})")
    return (
        f"it walks, but not yet by all rules of a good gait: {', '.join(named)}. To settle it: mrwarp train "
        f"--start-from {out / 'checkpoint.pt'} {SETTLING} --out {out.with_name(out.name + '-settled')}"
    )


def rmse_at(measured: dict[str, Any], gate: WalkingGate) -> float:
    """Error of the forward speed at the command of the gate's limit [m/s]."""
    return measured["v_x_rmse"][f"{gate.rmse_at:g}"]


def plot(progress: Progress, path: Path, gate: WalkingGate) -> None:
    """Draw tracking error, reward, falls and clock match over wall time, with the gate checks, as PNG."""
    figure, axes = panels((10, 6), 2, 2, sharex=True)
    minutes = [row["seconds"] / 60.0 for row in progress.rows]
    shown = {
        "v_x_rmse": "v_x RMSE while exploring [m/s]",
        "reward": "reward [1/s]",
        "falls_per_hour": "falls per robot and hour [1/h]",
        "clock_match": "contact matches the clock [1]",
    }
    for axis, (name, label) in zip(axes.flat, shown.items(), strict=True):
        axis.plot(minutes, [row[name] for row in progress.rows], color="#1f6fb4", linewidth=1.2)
        axis.set_ylabel(label)
        axis.margins(y=0.08)
    first, _, falls, match = axes.flat
    first.axhline(gate.rmse, color="#b4451f", linestyle="--", linewidth=1, label=f"gate {gate.rmse} m/s")
    first.axhline(gate.rmse_aim, color="#3a8f3a", linestyle=":", linewidth=1, label=f"aim {gate.rmse_aim} m/s")
    for passed, color, label in ((True, "#3a8f3a", "gate check passed"), (False, "#b4451f", "gate check not passed")):
        checks = [row for row in progress.gate_rows if row["passed"] == passed]
        if checks:
            times, errors = [row["seconds"] / 60.0 for row in checks], [rmse_at(row, gate) for row in checks]
            first.plot(times, errors, "o", color=color, label=label)
    first.set_ylim(bottom=0.0)
    # no falls is the best there is, and lies on the axis; decades as plain numbers
    falls.set_yscale("symlog", linthresh=1.0)
    falls.set_ylim(bottom=0.0)
    falls.yaxis.set_major_formatter("{x:g}")
    match.set_ylim(0.0, 1.02)
    for axis in axes[1]:
        axis.set_xlabel("wall time [min]")
    handles, labels = first.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


class DivergenceError(RuntimeError):
    """Numbers went wrong in too many environments; the message says in how many, when, and which was first."""


class Divergences:
    """Episodes of a training's environments that ended because a number went wrong.

    The last states of such environments are written to ``folder``, with what ``run`` says of the training; ``say``
    prints a line on each.

    Attributes:
        count: Divergences so far, of all processes.
    """

    def __init__(
        self, env: WalkEnv, ranks: Ranks, folder: Path, run: Mapping[str, Any], say: Callable[[str], None] = print
    ) -> None:
        self._say = say
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
        count, unusable_count = (round(total) for total in self._ranks.total(len(found), unusable))
        self._window.append(count)
        self.count += count
        rank = f"-rank{self._ranks.rank}" if self._ranks.world > 1 else ""
        for item in found[: MAX_DUMPS - self._dumps]:
            self._dumps += 1
            path = self._folder / f"update{update:06d}{rank}-env{item.env:05d}.safetensors"
            nan_dump.save(item, path, {"update": update, **self._run})
            self._say(f"  diverged: {item}; started over, last states in {path}")
        num_envs = self._env.num_envs * self._ranks.world
        at_once, window = count > max(1.0, MAX_DIVERGED * num_envs), sum(self._window) / (WINDOW * num_envs)
        if at_once or window > MAX_DIVERGED:
            first = next(item for items in self._ranks.share(found) for item in items)
            when = f"in update {update}" if at_once else f"per update over the last {WINDOW}"
            raise DivergenceError(
                f"numbers went wrong in {count / num_envs if at_once else window:.1%} of the environments {when}, more "
                f"than {MAX_DIVERGED:.0%}; first: {first}; see 'mrwarp replay-dump' on the files in {self._folder}"
            )
        return not unusable_count

    def state(self) -> dict[str, Any]:
        """Content of a checkpoint."""
        return {"divergences": self.count, "divergences_window": list(self._window), "dumps": self._dumps}

    def load_state(self, content: Mapping[str, Any]) -> None:
        """Go on from a checkpoint; files of an earlier version count no divergences."""
        self.count, self._dumps = content.get("divergences", 0), content.get("dumps", 0)
        self._window.extend(content.get("divergences_window", []))


def not_finite(values: Any, name: str = "") -> str:
    """Name of the first tensor in nested dictionaries and lists that holds NaN or infinity; empty without."""
    if isinstance(values, torch.Tensor):
        return "" if not values.is_floating_point() or bool(torch.isfinite(values).all()) else name
    items = values.items() if isinstance(values, dict) else enumerate(values) if isinstance(values, list) else ()
    return next((wrong for key, value in items if (wrong := not_finite(value, f"{name}.{key}".lstrip(".")))), "")
