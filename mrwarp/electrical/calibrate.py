"""Calibration of the electrical model on measured rows of the conventional Go1, and what the assumed numbers move."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from mrwarp.electrical.power import ElectricalCfg, Use, battery_power


@dataclass(frozen=True, kw_only=True)
class Row:
    """One measured power and what the simulated robot did under the same condition."""

    name: str
    use: Use
    """Mean use, shapes (J,) and (0,): a robot without devices."""
    measured: float
    """Battery power [W]."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """Fitted numbers with intervals."""

    cfg: ElectricalCfg
    half_width: dict[str, float]
    """Half width of the 95 % interval of each fitted number, from the scatter about the fit."""
    fitted: dict[str, float]
    """Power by row [W]."""
    measured: dict[str, float]
    """Power by row [W]."""
    rmse: float
    """Root of the mean squared mismatch [W]."""


class CalibrationError(ValueError):
    """The rows cannot determine the numbers, or give one out of its range."""


def calibrate(rows: Sequence[Row], cfg: ElectricalCfg | None = None) -> Calibration:
    """Electronics and winding resistance by linear least squares over the rows; every other number stays.

    ``P_i = electronics + R a_i + m_i`` with a_i the copper loss per ohm and m_i the mechanical terms.

    Raises:
        CalibrationError: fewer than three rows, rows that all have the same loss, or a fitted number that is negative.
    """
    cfg = cfg or ElectricalCfg()
    if len(rows) < 3:
        raise CalibrationError(f"{len(rows)} rows cannot calibrate two numbers with an interval; need at least 3")
    unit = replace(cfg, electronics=0.0, winding_resistance=1.0)
    parts = [battery_power(row.use, unit) for row in rows]
    per_ohm = np.array([float(p.copper) for p in parts])
    fixed = np.array([float(p.total) for p in parts]) - per_ohm
    measured = np.array([row.measured for row in rows])
    matrix = np.column_stack([np.ones(len(rows)), per_ohm])
    if np.ptp(per_ohm) <= 1e-9 * max(per_ohm.max(), 1.0):
        raise CalibrationError("all rows have the same copper loss: electronics and resistance cannot be told apart")
    fit, *_ = np.linalg.lstsq(matrix, measured - fixed, rcond=None)
    if fit.min() < 0.0:
        raise CalibrationError(f"fitted electronics {fit[0]:g} W and resistance {fit[1]:g} Ohm: both must be positive")
    values = matrix @ fit + fixed
    free = len(rows) - 2
    variance = float(((measured - values) ** 2).sum()) / free
    error = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)) * variance) * stats.t.ppf(0.975, free)
    names = [row.name for row in rows]
    return Calibration(
        cfg=replace(cfg, electronics=float(fit[0]), winding_resistance=float(fit[1])),
        half_width={"electronics": float(error[0]), "winding_resistance": float(error[1])},
        fitted=dict(zip(names, values.tolist(), strict=True)),
        measured=dict(zip(names, measured.tolist(), strict=True)),
        rmse=float(np.sqrt(((measured - values) ** 2).mean())),
    )


VARIED = {
    "calf_gear": (1.0, 1.5),
    "gear_efficiency": (0.8, 0.97),
    "regeneration": (0.0, 1.0),
    "coil_efficiency": (0.7, 0.95),
    "controller_idle": (0.1, 1.0),
}
"""Plausible range of every assumed number; the torque constant only scales the fitted resistance."""


def sensitivity(
    rows: Sequence[Row], figure: Callable[[ElectricalCfg], dict[str, float]], cfg: ElectricalCfg
) -> dict[str, list[dict[str, float]]]:
    """Predicted figures with each assumed number at the ends of its range, calibrated anew each time.

    Args:
        rows: The rows to calibrate on.
        figure: Predictions by name for a set of numbers.
        cfg: The numbers to start from.
    """
    found: dict[str, list[dict[str, float]]] = {}
    for name, ends in VARIED.items():
        found[name] = []
        for value in ends:
            varied = calibrate(rows, replace(cfg, **{name: value})).cfg
            found[name].append({"value": value, **figure(varied)})
    for name, half in calibrate(rows, cfg).half_width.items():
        nominal = getattr(cfg, name)
        found[name] = [
            {"value": value, **figure(replace(cfg, **{name: value}))}
            for value in (max(nominal - half, 0.0), nominal + half)
        ]
    return found
