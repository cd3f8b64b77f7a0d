"""A device's health over time, from one short calibration recording after another.

The first records give a reference (:func:`mrwarp.identify.fit.fit`). Each record's torque is then set against what the
reference would have given on its motion: ``tau = zero of the run + stiffness*q + B*qd + c*h_0 + s*h_I``, with h_I the
part of eq. 14's hysteretic torque that grows with current; h_0, the rest, goes along with dry friction. ``s`` is the
yield that is left, ``B/B_reference`` the viscosity. Without current, h_0 stands for h_I.

When is a change noticed? Where the mean of the last record, or of the last 3, 10 or 30, lies outside of what as many
records of a healthy device would give, by the scatter among the first ones (Student's t, both estimated). A large
change shows at once, a small one in a long mean. All of these tests share one level: at most 5 % of healthy devices
give an alarm over the horizon.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from mrwarp.identify.fit import fit
from mrwarp.identify.replay import simulate
from mrwarp.recording.load import Recording, load_recording
from mrwarp.recording.records import check_count
from mrwarp.runtime import panels

QUANTITIES = {"yield": "yield torque", "viscosity": "viscosity"}
"""Followed figures, each as a share of the reference's."""

FALSE_ALARMS = 0.05
"""Share of healthy devices that may give an alarm over the horizon: the level of an ordinary test."""

REFERENCE = 3
"""Records that the reference is fitted to; the scatter comes from all of the baseline."""


@dataclass(frozen=True, kw_only=True)
class MonitorCfg:
    """When a change counts as noticed."""

    baseline: int = 40
    """Records of a device that counts as healthy, the first ones."""
    means: tuple[int, ...] = (1, 3, 10, 30)
    """Numbers of last records whose mean is judged."""
    horizon: int = 200
    """Records over which at most 5 % of healthy devices give an alarm."""

    def __post_init__(self) -> None:
        if self.baseline < 5:
            raise ValueError(f"baseline = {self.baseline} records must be at least 5: their scatter is the measure")
        if min(self.means, default=0) < 1 or self.horizon < 1:
            raise ValueError(f"means = {self.means} and horizon = {self.horizon} records must be at least 1")


@dataclass(frozen=True, kw_only=True)
class Health:
    """Findings of the records."""

    names: tuple[str, ...]
    values: dict[str, np.ndarray]
    """By quantity of :data:`QUANTITIES`, relative to the baseline's mean, shape (N,)."""
    error: np.ndarray
    """NRMSE of each record [1], shape (N,)."""
    bounds: dict[str, dict[int, float]]
    """By quantity and number of records: largest difference from 1 of their mean that a healthy device explains."""
    alarms: dict[str, dict[str, Any]] = field(default_factory=dict)
    """First record at which a quantity's change is noticed, with its size and interval; without one, nothing."""


def read(
    paths: Sequence[Path], report: Callable[[str, float], None] = lambda text, share: None
) -> dict[str, Recording]:
    """Records by name; RecordingError names a bad one."""
    found = {}
    for k, path in enumerate(paths):
        report(f"reading: {path.name}", k / len(paths))
        found[path.name] = load_recording(path)
    return found


def monitor(
    records: Mapping[str, Recording], cfg: MonitorCfg, report: Callable[[str, float], None] = lambda text, share: None
) -> Health:
    """Follow a device through its records, in their order.

    Raises:
        RecordingError: there are too few records (:func:`check_count`), or the first cannot be fitted.
    """
    names, runs = tuple(records), list(records.values())
    check_count(len(runs), cfg.baseline)
    report("reference", 0.0)
    together = tuple(replace(run, id=f"{k}/{run.id}") for k, r in enumerate(runs[:REFERENCE]) for run in r.trajectories)
    reference = fit(replace(runs[0], trajectories=together)).values
    rows = []
    for k, recording in enumerate(runs):
        report(f"comparing: {names[k]}", k / len(runs))
        rows.append(_strength(recording, reference))
    table = np.array(rows)
    return judge(names, {"yield": table[:, 0], "viscosity": table[:, 1]}, table[:, 2], cfg)


def _strength(recording: Recording, reference: Mapping[str, float]) -> tuple[float, float, float]:
    """Yield and viscosity of a record relative to the reference, and what is not explained (NRMSE)."""
    loop = {name: reference[name] for name in ("alpha", "beta", "gamma", "z_max")}
    by_current, without = (
        np.concatenate(simulate({**loop, name: reference[name]}, recording)) for name in ("K1", "K0")
    )
    h = [by_current, without] if by_current.any() else [without]
    q, qd, torque, known = (
        np.concatenate([getattr(r, n) for r in recording.trajectories]) for n in ("q", "qd", "torque", "known")
    )
    run = np.repeat(np.arange(len(recording.trajectories)), [len(r.q) for r in recording.trajectories])
    zeros = (run[:, None] == np.arange(len(recording.trajectories))).astype(float)  # a sensor's zero moves between runs
    table = np.column_stack([h[0], qd, q, *h[1:], zeros])[known]
    x, *_ = np.linalg.lstsq(table, torque[known], rcond=None)
    left = torque[known] - table @ x
    return float(x[0]), float(x[1] / (reference["B"] or 1.0)), float(left.std() / (torque[known].std() or 1.0))


def judge(names: Sequence[str], values: Mapping[str, np.ndarray], error: np.ndarray, cfg: MonitorCfg) -> Health:
    """Where the values leave what the baseline's scatter explains."""
    first, tests = cfg.baseline, cfg.horizon * len(values) * len(cfg.means)
    share, bounds, alarms = {}, {}, {}
    for quantity, series in values.items():
        share[quantity] = s = series / series[:first].mean()
        spread = {m: float(s[:first].std(ddof=1) * np.sqrt(1.0 / m + 1.0 / first)) for m in cfg.means}
        reach = float(stats.t.ppf(1.0 - FALSE_ALARMS / tests / 2.0, first - 1))
        bounds[quantity] = {m: reach * spread[m] for m in cfg.means}
        for k in range(first, len(s)):
            for m in cfg.means:
                mean = float(s[k - m + 1 : k + 1].mean()) - 1.0
                if k - m + 1 >= first and abs(mean) > bounds[quantity][m] and quantity not in alarms:
                    half = float(stats.t.ppf(0.975, first - 1)) * spread[m]
                    alarms[quantity] = {
                        "record": names[k],
                        "number": k + 1,
                        "mean_of": m,
                        "change": mean,
                        "ci95": [mean - half, mean + half],
                    }
    return Health(names=tuple(names), values=share, error=error, bounds=bounds, alarms=alarms)


def lines(health: Health, cfg: MonitorCfg) -> list[str]:
    """Text for the user."""
    found = []
    for quantity, title in QUANTITIES.items():
        judged = health.values[quantity][cfg.baseline :][-max(cfg.means) :]
        text = f"{title}: {judged.mean():.1%} of the baseline over the last {len(judged)} records"
        if alarm := health.alarms.get(quantity):
            low, high = alarm["ci95"]
            text += f"; changed by {alarm['change']:+.1%} [{low:+.1%}, {high:+.1%}], noticed at {alarm['record']}"
        else:
            most = max((m for m in cfg.means if m <= len(judged)), default=1)
            text += f"; no change beyond the ±{health.bounds[quantity][most]:.1%} that a healthy device explains"
        found.append(text)
    return found


def picture(health: Health, cfg: MonitorCfg, path: Path) -> None:
    """Both quantities over the records, with the bound of the mean and where it was left."""
    figure, axes = panels((9, 6), rows=2, sharex=True)
    number = np.arange(1, len(health.names) + 1)
    for (quantity, title), (axis,) in zip(QUANTITIES.items(), axes, strict=True):
        series = health.values[quantity]
        axis.plot(number, series, ".", color="0.6")
        judged = series[cfg.baseline :]
        for m, colour in zip(cfg.means, ("#9ecae1", "#4292c6", "#2171b5", "#08306b"), strict=False):
            if m <= len(judged):
                axis.plot(
                    number[cfg.baseline + m - 1 :],
                    np.convolve(judged, np.ones(m) / m, "valid"),
                    color=colour,
                    label=f"mean of {m}, healthy within ±{health.bounds[quantity][m]:.1%}",
                )
        axis.legend(fontsize=7)
        axis.axvspan(0.5, cfg.baseline + 0.5, color="0.5", alpha=0.1)
        if alarm := health.alarms.get(quantity):
            axis.axvline(alarm["number"], color="#b4451f")
        axis.set_ylabel(f"{title} of the baseline")
    axes[-1, 0].set_xlabel("record")
    figure.savefig(path, dpi=120)
