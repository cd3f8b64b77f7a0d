"""Calibration of the electrical model on measured rows of the conventional Go1, and what the assumed numbers move."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, stats

from mrwarp.electrical.power import ElectricalCfg, Use, battery_power

MOTION_LOSS = "motion_loss"
"""Name of the loss of motion among fitted numbers."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One measured power and what the simulated robot did under the same condition."""

    name: str
    use: Use
    """Mean use, shapes (J,) and (0,): a robot without devices."""
    measured: float
    """Battery power [W]."""
    walks: bool = True
    """Whether the robot walked; else it stood."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """Fitted numbers with intervals."""

    cfg: ElectricalCfg
    half_width: dict[str, float]
    """Half width of the 95 % interval of each fitted number, from the scatter about the fit, as if nothing bounded
    it."""
    at_bound: tuple[str, ...]
    """Fitted numbers that the rows would have out of their range, and that stand at its end."""
    fitted: dict[str, float]
    """Power by row [W]."""
    measured: dict[str, float]
    """Power by row [W]."""
    rmse: float
    """Root of the mean squared mismatch [W]."""
    motion_loss: float = 0.0
    """Power drawn whenever the robot walks, beside what the model has [W]; 0 unless it was fitted too."""

    @property
    def walking(self) -> ElectricalCfg:
        """The numbers of a robot that walks: the loss of motion counts as electronics."""
        return replace(self.cfg, electronics=self.cfg.electronics + self.motion_loss)


class CalibrationError(ValueError):
    """The rows cannot determine the numbers."""


def calibrate(
    rows: Sequence[Row], cfg: ElectricalCfg | None = None, *, hold: str | None = None, motion: bool = False
) -> Calibration:
    """Electronics and winding resistance by least squares over the rows, within their ranges; the others stay.

    ``P_i = electronics + R a_i + m_i`` with a_i the copper loss per ohm and m_i the mechanical terms; with ``motion``
    a loss is added to the rows that walked, which neither torque nor mechanical power explains.

    Args:
        rows: Measured powers and what the simulated robot did.
        cfg: The other numbers.
        hold: One of ``power.CALIBRATED`` that keeps its value of ``cfg``; the other alone is fitted.
        motion: Whether a loss of motion is fitted as a third number, not below 0.

    Raises:
        CalibrationError: fewer than one row more than numbers; rows that all have the same loss where both numbers are
            fitted; rows that all walked, or none, where a loss of motion is.
    """
    cfg = cfg or ElectricalCfg()
    if len(rows) < (least := 4 if motion else 3):
        numbers = "three" if motion else "two"
        raise CalibrationError(
            f"{len(rows)} rows cannot calibrate {numbers} numbers with an interval; need at least {least}"
        )
    if motion and len({row.walks for row in rows}) < 2:
        raise CalibrationError("a loss of motion needs rows that walked and rows that stood")
    unit = replace(cfg, electronics=0.0, winding_resistance=1.0)
    parts = [battery_power(row.use, unit) for row in rows]
    per_ohm = np.array([float(p.copper) for p in parts])
    if hold is None and np.ptp(per_ohm) <= 1e-9 * max(per_ohm.max(), 1.0):
        raise CalibrationError("all rows have the same copper loss: electronics and resistance cannot be told apart")
    measured = np.array([row.measured for row in rows])
    columns = {"electronics": np.ones(len(rows)), "winding_resistance": per_ohm}
    rest = np.array([float(p.total) for p in parts]) - per_ohm
    if hold is not None:
        rest = rest + getattr(cfg, hold) * columns.pop(hold)
    bounds = {spec.name: (spec.low, spec.high) for spec in cfg.specs()}
    if motion:
        columns[MOTION_LOSS] = np.array([float(row.walks) for row in rows])
        bounds[MOTION_LOSS] = (0.0, np.inf)
    matrix = np.column_stack(list(columns.values()))
    low, high = zip(*(bounds[name] for name in columns), strict=True)
    fit = optimize.lsq_linear(matrix, measured - rest, bounds=(low, high))
    values = matrix @ fit.x + rest
    free = len(rows) - len(columns)
    variance = float(((measured - values) ** 2).sum()) / free
    error = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)) * variance) * stats.t.ppf(0.975, free)
    names = [row.name for row in rows]
    found = dict(zip(columns, fit.x.tolist(), strict=True))
    return Calibration(
        motion_loss=found.pop(MOTION_LOSS, 0.0),
        cfg=replace(cfg, **found),
        half_width=dict(zip(columns, error.tolist(), strict=True)),
        at_bound=tuple(name for name, side in zip(columns, fit.active_mask, strict=True) if side),
        fitted=dict(zip(names, values.tolist(), strict=True)),
        measured=dict(zip(names, measured.tolist(), strict=True)),
        rmse=float(np.sqrt(((measured - values) ** 2).mean())),
    )


VARIED = {
    "calf_gear": (1.0, 1.5),
    "gear_efficiency": (0.85, 0.95),
    "regeneration": (0.0, 1.0),
    "coil_efficiency": (0.8, 0.95),
    "controller_idle": (0.1, 1.0),
}
"""Plausible range of every assumed number, as its source in :class:`ElectricalCfg` gives it; the torque constant only
scales the fitted resistance."""


def sensitivity(
    rows: Sequence[Row], figure: Callable[[ElectricalCfg], dict[str, float]], cfg: ElectricalCfg
) -> dict[str, list[dict[str, float]]]:
    """Predicted figures with each number at the ends of its range, calibrated anew each time.

    An assumed number stands at the ends of :data:`VARIED` and both calibrated ones are fitted; a calibrated number
    stands at the ends of its 95 % interval, cut to its range, and the other one is fitted: together they still have
    to give the measured rows, which one of them alone at an end would miss.

    Args:
        rows: The rows to calibrate on.
        figure: Predictions by name for a set of numbers.
        cfg: The numbers to start from.
    """
    found: dict[str, list[dict[str, float]]] = {}
    for name, ends in VARIED.items():
        fits = [calibrate(rows, replace(cfg, **{name: value})) for value in ends]
        found[name] = [_end(value, fit, figure) for value, fit in zip(ends, fits, strict=True)]
    fit = calibrate(rows, cfg)
    specs = {spec.name: spec for spec in cfg.specs()}
    for name, half in fit.half_width.items():
        nominal = getattr(fit.cfg, name)
        ends = max(nominal - half, specs[name].low), min(nominal + half, specs[name].high)
        fits = [calibrate(rows, replace(cfg, **{name: value}), hold=name) for value in ends]
        found[name] = [_end(value, held, figure) for value, held in zip(ends, fits, strict=True)]
    return found


def _end(value: float, fit: Calibration, figure: Callable[[ElectricalCfg], dict[str, float]]) -> dict[str, float]:
    return {"value": value, "rmse": fit.rmse, **figure(fit.cfg)}
