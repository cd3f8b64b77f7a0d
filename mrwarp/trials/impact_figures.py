"""Results of impact trials: of each current, of the gates' thresholds, and of what a model's effects change."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp import paper
from mrwarp.enums import Coupling
from mrwarp.env.cfg import TaskCfg
from mrwarp.kernels import ledger
from mrwarp.model_file import Model
from mrwarp.runtime import panels
from mrwarp.trials.impact import ImpactCfg, ImpactSweep, ImpactTrace, Variant, body_extremes, fixed_current_env
from mrwarp.trials.statistics import half_width, spread
from mrwarp.trials.walking import Policy, task_devices
from mrwarp.usd.asset import most_current
from mrwarp.usd.robot import CURRENT_GROUPS

MOTOR_WINDOW = 0.1
"""Window of the motor-torque figures after the impact [s], paper section 6.3."""

THRESHOLDS: dict[str, tuple[float, ...]] = {
    "f_th": (3.0, 5.0, 7.0, 13.0),
    "eps_e": (0.01, 0.03, 0.05, 0.07, 0.09),
    "eps_v": (0.10, 0.15, 0.20, 0.25, 0.30),
}
"""Values of each threshold [N, rad, rad/s], paper section 3.2; one is varied at a time."""

EFFECT_FIGURES = {
    "min_height": ("minimum trunk height", "m"),
    "peak_speed": ("peak downward speed", "m/s"),
    "mr_torque": ("mean |MR torque|", "N·m"),
    "damping_share": ("time in which a joint damps", "1"),
}
"""Figures of a trial that a model's effects may change, with their name in words and unit."""


def figures(trace: ImpactTrace, currents: tuple[float, ...]) -> dict[str, Any]:
    """Body-level and motor figures per current, mean and sample SD over trials, and the paired change from the first.

    Returns:
        ``by_current`` with ``min_height`` [m], ``peak_down_velocity`` [m/s], ``drop`` [m], ``motor_mean`` and
        ``motor_peak`` per leg [N·m], ``acceleration`` mean |a_z - g| over 0.1 s [m/s^2], ``dynamic_share``,
        ``hold_share``, ``energy`` by ledger entry [J], ``fell``; ``change`` from the first to the last current in
        percent with a 95 % interval over the paired trials.
    """
    early, extremes = trace.t <= MOTOR_WINDOW, body_extremes(trace)
    body = {**extremes, "drop": trace.height[:, :, 0] - extremes["min_height"]}
    acceleration = np.abs(np.diff(trace.velocity[:, :, early], axis=2) / (trace.t[1] - trace.t[0])).mean(axis=2)
    motor = np.abs(trace.tau_motor[:, :, early])
    rows = [
        {
            "current": current,
            **{name: spread(values[i]) for name, values in body.items()},
            "acceleration": spread(acceleration[i]),
            "motor_mean": {leg: spread(motor[i, :, :, k].mean(axis=1)) for k, leg in enumerate(trace.legs)},
            "motor_peak": {leg: spread(motor[i, :, :, k].max(axis=1)) for k, leg in enumerate(trace.legs)},
            "dynamic_share": float(trace.m_dyn[i].mean()),
            "hold_share": float(trace.m_hold[i].mean()),
            "energy": {name: float(trace.ledger[i, :, k].mean()) for k, name in enumerate(ledger.ENTRIES)},
            "fell": float(trace.fell[i].mean()),
        }
        for i, current in enumerate(currents)
    ]
    return {
        "by_current": rows,
        "change": {name: paired_change(np.abs(values[0]), np.abs(values[-1])) for name, values in body.items()},
        "monotone": {name: bool(np.all(np.diff(values.mean(axis=1)) > 0.0)) for name, values in extremes.items()},
    }


def paired_change(first: np.ndarray, last: np.ndarray) -> dict[str, Any]:
    """Relative change of the mean in percent, with a 95 % interval from the paired differences (Student's t)."""
    change = float(100.0 * (last - first).mean() / first.mean())
    half = 100.0 * half_width(last - first) / abs(float(first.mean()))
    return {"percent": change, "ci95": [change - half, change + half], "pairs": len(first)}


def threshold_variants(current: float) -> tuple[Variant, ...]:
    """The reference without current, then every value of every threshold of the gates with it."""
    rows = [Variant(current=current, params={name: v}) for name, values in THRESHOLDS.items() for v in values]
    return (Variant(current=0.0), *rows)


def threshold_reductions(trace: ImpactTrace) -> dict[str, list[dict[str, Any]]]:
    """Reduction of CoM drop and of mean motor torque against no current, in percent over the paired trials.

    The trace is that of a sweep over :func:`threshold_variants`.

    Returns:
        Per threshold a list of rows with ``value``, ``drop`` and ``motor`` (mean and SD over trials).
    """
    motor = np.abs(trace.tau_motor[:, :, trace.t <= MOTOR_WINDOW]).mean(axis=(2, 3))
    reduced = {"drop": trace.height[:, :, 0] - trace.height.min(axis=2), "motor": motor}
    settings = [(name, value) for name, values in THRESHOLDS.items() for value in values]
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in THRESHOLDS}
    for i, (name, value) in enumerate(settings, start=1):
        spreads = {k: spread(100.0 * (x[0] - x[i]) / x[0].mean()) for k, x in reduced.items()}
        rows[name].append({"value": value, **spreads})
    return rows


def plot_thresholds(rows: dict[str, list[dict[str, Any]]], path: Path, *, paper_device: bool = True) -> None:
    """Draw both reductions over each threshold, of the paper's device with the paper's ranges."""
    labels = {
        "f_th": "foot force threshold f_th [N]",
        "eps_e": "tracking error threshold eps_e [rad]",
        "eps_v": "speed threshold eps_v [rad/s]",
    }
    titles = {"drop": "reduction of CoM drop [%]", "motor": "reduction of mean\ncalf motor torque [%]"}
    figure, axes = panels((11, 6), 2, 3, sharex="col")
    for column, (name, entries) in enumerate(rows.items()):
        x = [entry["value"] for entry in entries]
        for axis, quantity in zip(axes[:, column], titles, strict=True):
            axis.errorbar(
                x,
                [e[quantity]["mean"] for e in entries],
                [e[quantity]["sd"] for e in entries],
                marker="o",
                color="#1f6fb4",
                capsize=3,
                label="ours: mean, SD over trials",
            )
            if paper_device and quantity in paper.THRESHOLDS[name]:
                ends = paper.THRESHOLDS[name][quantity]
                axis.plot([x[0], x[-1]], ends, "s--", color="#b4451f", label="paper: ends of the range")
            axis.axhline(0.0, color="0.6", linewidth=0.8)
            if column == 0:
                axis.set_ylabel(titles[quantity])
        axes[1, column].set_xlabel(labels[name])
    handles, texts = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, texts, loc="outside upper center", ncols=2, fontsize=8)
    figure.savefig(path, dpi=110)


def impact_change(
    before: Model | None,
    after: Model,
    policy: Policy,
    *,
    currents: Sequence[float] | None = None,
    trials: int = 100,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Hit walking robots whose MR joints have one model, then the same robots with the other.

    The push is the paper's (100 N for 0.2 s), with damping alone and all the current, as ``mrwarp impact`` has it.

    Args:
        before: Model of the first sweep; None: the joints of the robot's asset.
        after: Model of the second.
        policy: Walking policy.
        currents: Currents I_e [A]; None: those of eq. 20 that both devices take, and the most that they take.
        trials: Trials at each current, at random gait phases.
        seed: Seed of poses and gait phases.
        progress: Called with the current stage.

    Returns:
        Plain values: ``rows``, each with a ``current`` [A] and, by the names of :data:`EFFECT_FIGURES`, means over the
        trials ``before`` and ``after``, their ``change`` and its interval ``ci95`` over the paired trials (Student's
        t), and the ``unit``; ``trials`` at each current, ``seconds`` that it took.

    Raises:
        ModelFileError: a model cannot be used in the robot.
    """
    started = time.perf_counter()
    if currents is None:
        most = min(most_current(task_devices(TaskCfg(model=model))) for model in (before, after))
        currents = tuple(dict.fromkeys(min(current, most) for current in CURRENT_GROUPS))
    found: list[dict[str, np.ndarray]] = []
    for model, words in ((before, "before"), (after, "after")):
        progress(f"impact sweep {words}")
        cfg = ImpactCfg(
            variants=tuple(Variant(current=current) for current in currents),
            trials=trials,
            env=fixed_current_env(coupling=Coupling.CONSTRAINT, model=model),
            seed=seed,
        )
        trace = ImpactSweep(cfg, policy).run()
        extremes = body_extremes(trace)
        found.append(
            {
                "min_height": extremes["min_height"],
                "peak_speed": -extremes["peak_down_velocity"],
                "mr_torque": np.abs(trace.tau_mr).mean(axis=(2, 3)),
                "damping_share": trace.m_dyn.mean(axis=(2, 3)),
            }
        )
    rows = [
        {"current": current, **{name: _change(name, *(f[name][i] for f in found)) for name in EFFECT_FIGURES}}
        for i, current in enumerate(currents)
    ]
    return {"rows": rows, "trials": trials, "seconds": time.perf_counter() - started}


def _change(name: str, before: np.ndarray, after: np.ndarray) -> dict[str, Any]:
    half = half_width((after - before).astype(float))
    first, last = float(before.mean(dtype=float)), float(after.mean(dtype=float))
    interval = (last - first - half, last - first + half)
    unit = EFFECT_FIGURES[name][1]
    return {"before": first, "after": last, "ci95": interval, "change": last - first, "unit": unit}
