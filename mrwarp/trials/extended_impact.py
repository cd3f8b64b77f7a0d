"""What a model's effects change in the robot: the impact sweep before and after, the same trials in both."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mrwarp.actuator.mr_actuator import Coupling
from mrwarp.model_file import Model
from mrwarp.trials.impact import ImpactCfg, ImpactSweep, ImpactTrace, Variant, body_extremes, fixed_current_env
from mrwarp.trials.statistics import half_width
from mrwarp.trials.walking import Policy
from mrwarp.usd.robot import CURRENT_GROUPS

FIGURES = {
    "min_height": ("minimum trunk height", "m"),
    "peak_speed": ("peak downward speed", "m/s"),
    "mr_torque": ("mean |MR torque|", "N·m"),
    "damping_share": ("time in which a joint damps", "1"),
}
"""Figures of a trial, with their name in words and unit."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """A figure's mean over the trials, before and after."""

    before: float
    after: float
    ci95: tuple[float, float]
    """Interval of the change over the paired trials, Student's t."""

    @property
    def change(self) -> float:
        """After minus before."""
        return self.after - self.before


@dataclass(frozen=True, kw_only=True)
class ImpactRow:
    """One current."""

    current: float
    """I_e [A]."""
    figures: dict[str, Change]
    """By the names of :data:`FIGURES`."""


@dataclass(frozen=True, kw_only=True)
class ImpactChange:
    """The impact sweep with two models."""

    rows: tuple[ImpactRow, ...]
    trials: int
    """Trials at each current: the same starts and gait phases with both models."""
    seconds: float
    """Time it took [s]."""

    def to_dict(self) -> dict[str, Any]:
        """The table for ``result.json``."""

        def cell(name: str, found: Change) -> dict[str, Any]:
            """One figure with its interval and unit."""
            return {**asdict(found), "ci95": list(found.ci95), "change": found.change, "unit": FIGURES[name][1]}

        rows = [
            {"current": row.current, **{name: cell(name, found) for name, found in row.figures.items()}}
            for row in self.rows
        ]
        return {"rows": rows, "trials": self.trials, "seconds": self.seconds}


def impact_change(
    before: Model | None,
    after: Model,
    policy: Policy,
    *,
    currents: Sequence[float] = CURRENT_GROUPS,
    trials: int = 100,
    coupling: Coupling = Coupling.CONSTRAINT,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> ImpactChange:
    """Hit walking robots whose MR joints have one model, then the same robots with the other.

    The push is the paper's (100 N for 0.2 s), with damping alone and all the current, as ``mrwarp impact`` has it.

    Args:
        before: Model of the first sweep; None: the joints of the robot's asset.
        after: Model of the second.
        policy: Walking policy.
        currents: Currents I_e [A].
        trials: Trials at each current, at random gait phases.
        coupling: How the devices act.
        seed: Seed of poses and gait phases.
        progress: Told what is being done.

    Raises:
        ModelFileError: a model cannot be used in the robot.
    """
    told, started = progress or (lambda text: None), time.perf_counter()
    found: list[dict[str, np.ndarray]] = []
    for model, words in ((before, "before"), (after, "after")):
        told(f"impact sweep {words}")
        cfg = ImpactCfg(
            variants=tuple(Variant(current=current) for current in currents),
            trials=trials,
            env=fixed_current_env(coupling=coupling, model=model),
            seed=seed,
        )
        found.append(trial_figures(ImpactSweep(cfg, policy).run()))
    rows = tuple(
        ImpactRow(current=current, figures={name: _change(*(f[name][i] for f in found)) for name in FIGURES})
        for i, current in enumerate(currents)
    )
    return ImpactChange(rows=rows, trials=trials, seconds=time.perf_counter() - started)


def trial_figures(trace: ImpactTrace) -> dict[str, np.ndarray]:
    """The figures of every trial, shape (C, N), over the window after the impact's onset."""
    extremes = body_extremes(trace)
    return {
        "min_height": extremes["min_height"],
        "peak_speed": -extremes["peak_down_velocity"],
        "mr_torque": np.abs(trace.tau_mr).mean(axis=(2, 3)),
        "damping_share": trace.m_dyn.mean(axis=(2, 3)),
    }


def _change(before: np.ndarray, after: np.ndarray) -> Change:
    half = half_width((after - before).astype(float))
    first, last = float(before.mean(dtype=float)), float(after.mean(dtype=float))
    return Change(before=first, after=last, ci95=(last - first - half, last - first + half))
