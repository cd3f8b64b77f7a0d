"""Calibration of the electrical model on measured rows of the conventional Go1, and what the assumed numbers move."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, stats

from mrwarp.energy.power import CALIBRATED, ElectricalCfg, JointLoad, battery_power

DIGITS = {"electronics": 1, "winding_resistance": 3, "drive_friction": 2}
"""Decimals of the calibrated numbers where people read them."""


@dataclass(frozen=True, kw_only=True)
class MeasuredPower:
    """One measured power and what the simulated robot did under the same condition."""

    name: str
    joints: JointLoad
    """Mean joint load, shapes (J,) and (0,): a robot without devices."""
    measured: float
    """Battery power [W]."""


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

    def interval(self, name: str) -> str:
        """A calibrated number with its 95 % interval, without unit, or with the remark that it was held."""
        digits = DIGITS[name]
        value = f"{getattr(self.cfg, name):.{digits}f}"
        return f"{value} ± {self.half_width[name]:.{digits}f}" if name in self.half_width else f"{value} (held)"

    def __str__(self) -> str:
        """The fitted numbers with their intervals, in words."""
        units = {spec.name: spec.unit for spec in self.cfg.specs()}
        return ", ".join(f"{name.replace('_', ' ')} {self.interval(name)} {units[name]}" for name in self.half_width)


class CalibrationError(ValueError):
    """The rows cannot determine the numbers."""


def calibrate(
    rows: Sequence[MeasuredPower], cfg: ElectricalCfg | None = None, *, hold: Sequence[str] = ()
) -> Calibration:
    """Electronics, winding resistance and drive friction by least squares over the rows, within their ranges.

    ``P_i = electronics + R a_i + tau_f b_i + m_i`` with a_i the copper loss per ohm, b_i the speed of all joints and
    m_i the mechanical terms.

    Args:
        rows: PaperValue powers and what the simulated robot did.
        cfg: The other numbers.
        hold: Those of ``power.CALIBRATED`` that keep their values of ``cfg``; the others are fitted.

    Raises:
        CalibrationError: fewer than one row more than numbers, or rows that cannot tell them apart.
    """
    cfg = cfg or ElectricalCfg()
    fitted = [name for name in CALIBRATED if name not in hold]
    if len(rows) <= len(fitted):
        numbers = " and ".join(fitted)
        raise CalibrationError(
            f"{len(rows)} rows cannot calibrate {numbers} with an interval; need at least {len(fitted) + 1}"
        )
    bare = replace(cfg, **dict.fromkeys(fitted, 0.0))
    rest = _powers(rows, bare)
    matrix = np.column_stack([_powers(rows, replace(bare, **{name: 1.0})) - rest for name in fitted])
    scaled = matrix / np.maximum(np.abs(matrix).max(axis=0), 1e-12)
    if np.linalg.matrix_rank(scaled, tol=1e-9) < len(fitted):
        raise CalibrationError(
            f"the rows cannot tell {' and '.join(fitted)} apart; give rows of other loads and motions"
        )
    measured = np.array([row.measured for row in rows])
    specs = {spec.name: spec for spec in cfg.specs()}
    low, high = ([getattr(specs[name], end) for name in fitted] for end in ("low", "high"))
    fit = optimize.lsq_linear(matrix, measured - rest, bounds=(low, high))
    values = matrix @ fit.x + rest
    free = len(rows) - len(fitted)
    variance = float(((measured - values) ** 2).sum()) / free
    error = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)) * variance) * stats.t.ppf(0.975, free)
    names = [row.name for row in rows]
    return Calibration(
        cfg=replace(cfg, **dict(zip(fitted, fit.x.tolist(), strict=True))),
        half_width=dict(zip(fitted, error.tolist(), strict=True)),
        at_bound=tuple(name for name, side in zip(fitted, fit.active_mask, strict=True) if side),
        fitted=dict(zip(names, values.tolist(), strict=True)),
        measured=dict(zip(names, measured.tolist(), strict=True)),
        rmse=float(np.sqrt(((measured - values) ** 2).mean())),
    )


def _powers(rows: Sequence[MeasuredPower], cfg: ElectricalCfg) -> np.ndarray:
    return np.array([float(battery_power(row.joints, cfg).total) for row in rows])


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
    rows: Sequence[MeasuredPower], figure: Callable[[ElectricalCfg], dict[str, float]], cfg: ElectricalCfg
) -> dict[str, list[dict[str, float]]]:
    """Predicted figures with each number at the ends of its range, calibrated anew each time.

    An assumed number stands at the ends of :data:`VARIED` and the calibrated ones are fitted; a calibrated number
    stands at the ends of its 95 % interval, cut to its range, and the others are fitted: together they still have to
    give the measured rows, which one of them alone at an end would miss.

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
        fits = [calibrate(rows, replace(cfg, **{name: value}), hold=(name,)) for value in ends]
        found[name] = [_end(value, held, figure) for value, held in zip(ends, fits, strict=True)]
    return found


def _end(value: float, fit: Calibration, figure: Callable[[ElectricalCfg], dict[str, float]]) -> dict[str, float]:
    return {"value": value, "rmse": fit.rmse, **figure(fit.cfg)}
