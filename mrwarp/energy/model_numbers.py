"""Numbers of the electrical, thermal and battery models: given by files and options, or fitted to Go1."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize, stats

from mrwarp.energy.power import BatteryCfg, ElectricalCfg, JointLoad, battery_power
from mrwarp.energy.thermal import ThermalCfg
from mrwarp.options.json_file import read_json_file
from mrwarp.params import ParameterError, ParamGroup
from mrwarp.run_dir import write_text

GROUPS: dict[str, type[ParamGroup]] = {"electrical": ElectricalCfg, "thermal": ThermalCfg, "battery": BatteryCfg}
"""Groups of numbers by the name under which a file holds them."""

CALIBRATED = {
    "electrical": ("electronics", "winding_resistance", "drive_friction"),
    "thermal": ("housing_capacity", "housing_resistance"),
    "battery": ("capacity",),
}
"""Numbers of each group that are fitted to Go1, with defaults that ``--calibrate`` gave with the shipped policies; the
others are assumed."""

DIGITS = {"electronics": 1, "winding_resistance": 3, "drive_friction": 2}
"""Decimals of the fitted electrical numbers where people read them."""

VARIED = {
    "calf_gear": (1.0, 1.5),
    "gear_efficiency": (0.85, 0.95),
    "regeneration": (0.0, 1.0),
    "coil_efficiency": (0.8, 0.95),
    "controller_idle": (0.1, 1.0),
}
"""Plausible range of every assumed number, as its source in :class:`ElectricalCfg` gives it; the torque constant only
scales the fitted resistance."""


def read_numbers(file: Path | None, given: Sequence[str]) -> dict[str, Any]:
    """The groups of numbers: defaults, then those of a file, then single ones.

    Args:
        file: JSON with an object per group, as ``--calibrate`` writes it.
        given: Single numbers as ``NAME=VALUE`` or ``GROUP.NAME=VALUE``.

    Raises:
        ParameterError: a name is unknown or a value out of range; the message says which.
        JsonFileError: the file is not JSON.
        OSError: the file cannot be read.
    """
    changes: dict[str, dict[str, Any]] = {name: {} for name in GROUPS}
    if file is not None:
        content = read_json_file(file, "give the numbers.json that --calibrate wrote")
        if not isinstance(content, dict) or not all(isinstance(group, dict) for group in content.values()):
            raise ParameterError(f"{file}: needs one object per group: {', '.join(GROUPS)}")
        for group, values in content.items():
            if group not in GROUPS:
                raise ParameterError(f"{file}: unknown group {group!r}; known: {', '.join(GROUPS)}")
            for name, value in values.items():
                changes[_group_of(name, str(file), group)][name] = value
    for text in given:
        name, equals, value = text.partition("=")
        if not equals:
            raise ParameterError(f"--set {text}: write NAME=VALUE")
        group, _, name = name.rpartition(".")
        changes[_group_of(name, "--set", group)][name] = value
    return {name: group(**changes[name]) for name, group in GROUPS.items()}


def _group_of(name: str, where: str, group: str) -> str:
    """The group that has a number of this name; ``winding_resistance`` stands in two and needs its ``group``."""
    found = [key for key, cls in GROUPS.items() if name in {spec.name for spec in cls.specs()}]
    if group and group not in found:
        raise ParameterError(f"{where}: there is no {group}.{name}; {name} is in: {', '.join(found) or 'no group'}")
    if not group and len(found) != 1:
        known = ", ".join(spec.name for cls in GROUPS.values() for spec in cls.specs())
        hint = f"write {' or '.join(f'{key}.{name}' for key in found)}" if found else f"known: {known}"
        raise ParameterError(f"{where}: {name!r} is not one number; {hint}")
    return group or found[0]


def fitted_names(*groups: str) -> tuple[str, ...]:
    """Numbers that --calibrate fits in these groups, as ``group.name``."""
    return tuple(f"{group}.{name}" for group in groups for name in CALIBRATED[group])


def calibrated(groups: dict[str, Any], fitted: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Groups whose fitted numbers come from Go1's figures, in this run or by default; given ones do not.

    The defaults of heat and battery were fitted with the electrical ones; without these they fit nothing. ``fitted``:
    what this run fitted, as ``group.name``.
    """
    sources = described(groups, fitted)

    def all_of(name: str, what: str) -> bool:
        return all(sources[name][number][what] for number in CALIBRATED[name])

    return tuple(
        name
        for name in groups
        if all_of(name, "fitted_in_this_run") or (all_of(name, "calibrated") and all_of("electrical", "calibrated"))
    )


def described(groups: dict[str, Any], fitted: tuple[str, ...] = ()) -> dict[str, Any]:
    """Every number with unit, range, source and whether it was calibrated, for ``result.json``.

    ``fitted``: what this run fitted, as ``group.name``.
    """
    found: dict[str, Any] = {name: {} for name in groups}
    for name, cfg in groups.items():
        for spec in type(cfg).specs():
            value, here = getattr(cfg, spec.name), f"{name}.{spec.name}" in fitted
            given = not here and value != spec.default
            found[name][spec.name] = {
                "value": value, "unit": spec.unit, "range": [spec.low, spec.high],
                "source": "given by --numbers or --set" if given else spec.source,
                "calibrated": here or (spec.name in CALIBRATED[name] and not given), "fitted_in_this_run": here,
            }  # fmt: skip
    return found


def write_numbers(path: Path, groups: dict[str, Any]) -> None:
    """Write the numbers as ``--numbers`` reads them."""
    content = {name: {spec.name: getattr(cfg, spec.name) for spec in type(cfg).specs()} for name, cfg in groups.items()}
    write_text(path, json.dumps(content, indent=2) + "\n")


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
    covariance: np.ndarray
    """Of the fitted numbers, in the order of ``half_width``, from the same scatter; their errors hang together."""
    free: int
    """Rows beyond the fitted numbers: degrees of freedom of the scatter."""
    at_bound: tuple[str, ...]
    """Fitted numbers that the rows would have out of their range, and that stand at its end."""
    fitted: dict[str, float]
    """Power by row [W]."""
    measured: dict[str, float]
    """Power by row [W]."""
    rmse: float
    """Root of the mean squared mismatch [W]."""

    def error(self, figure: Callable[[ElectricalCfg], np.ndarray | float]) -> np.ndarray:
        """Standard error of figures by the fitted numbers, to first order; of the shape of ``figure``.

        Each number moves by a tenth of its own standard error, the covariance joins them.
        """
        steps = 0.1 * np.sqrt(np.diag(self.covariance))
        moved = [
            (np.asarray(figure(replace(self.cfg, **{name: getattr(self.cfg, name) + step}))) - figure(self.cfg)) / step
            for name, step in zip(self.half_width, steps, strict=True)
        ]
        slopes = np.stack([np.asarray(x, dtype=float) for x in moved])
        return np.sqrt(np.maximum(np.einsum("i...,ij,j...->...", slopes, self.covariance, slopes), 0.0))

    def interval(self, name: str) -> str:
        """A calibrated number with its 95 % interval, without unit, or with the remark that it was held."""
        digits = DIGITS[name]
        value = f"{getattr(self.cfg, name):.{digits}f}"
        return f"{value} ± {self.half_width[name]:.{digits}f}" if name in self.half_width else f"{value} (held)"

    def __str__(self) -> str:
        """The fitted numbers with their intervals, in words."""
        units = {spec.name: spec.unit for spec in self.cfg.specs()}
        return ", ".join(f"{name.replace('_', ' ')} {self.interval(name)} {units[name]}" for name in self.half_width)


def calibrate(
    rows: Sequence[MeasuredPower], cfg: ElectricalCfg | None = None, *, hold: Sequence[str] = ()
) -> Calibration:
    """Electronics, winding resistance and drive friction by least squares over the rows, within their ranges.

    ``P_i = electronics + R a_i + tau_f b_i + m_i`` with a_i the copper loss per ohm, b_i the speed of all joints and
    m_i the mechanical terms. Numbers named in ``hold`` keep their values of ``cfg``; the others of :data:`CALIBRATED`
    are fitted.

    Raises:
        ValueError: fewer than one row more than numbers, or rows that cannot separate them.
    """
    cfg = cfg or ElectricalCfg()
    fitted = [name for name in CALIBRATED["electrical"] if name not in hold]
    if len(rows) <= len(fitted):
        numbers = " and ".join(fitted)
        raise ValueError(
            f"{len(rows)} rows cannot calibrate {numbers} with an interval; need at least {len(fitted) + 1}"
        )

    def powers(cfg: ElectricalCfg) -> np.ndarray:
        return np.array([float(battery_power(row.joints, cfg).total) for row in rows])

    bare = replace(cfg, **dict.fromkeys(fitted, 0.0))
    rest = powers(bare)
    matrix = np.column_stack([powers(replace(bare, **{name: 1.0})) - rest for name in fitted])
    scaled = matrix / np.maximum(np.abs(matrix).max(axis=0), 1e-12)
    if np.linalg.matrix_rank(scaled, tol=1e-9) < len(fitted):
        raise ValueError(f"the rows cannot separate {' and '.join(fitted)}; give rows of other loads and motions")
    measured = np.array([row.measured for row in rows])
    specs = {spec.name: spec for spec in cfg.specs()}
    low, high = ([getattr(specs[name], end) for name in fitted] for end in ("low", "high"))
    fit = optimize.lsq_linear(matrix, measured - rest, bounds=(low, high))
    values = matrix @ fit.x + rest
    free = len(rows) - len(fitted)
    variance = float(((measured - values) ** 2).sum()) / free
    covariance = np.linalg.inv(matrix.T @ matrix) * variance
    error = np.sqrt(np.diag(covariance)) * stats.t.ppf(0.975, free)
    names = [row.name for row in rows]
    return Calibration(
        cfg=replace(cfg, **dict(zip(fitted, fit.x.tolist(), strict=True))),
        half_width=dict(zip(fitted, error.tolist(), strict=True)),
        covariance=covariance,
        free=free,
        at_bound=tuple(name for name, side in zip(fitted, fit.active_mask, strict=True) if side),
        fitted=dict(zip(names, values.tolist(), strict=True)),
        measured=dict(zip(names, measured.tolist(), strict=True)),
        rmse=float(np.sqrt(((measured - values) ** 2).mean())),
    )


def sensitivity(
    rows: Sequence[MeasuredPower], figure: Callable[[ElectricalCfg], dict[str, float]], cfg: ElectricalCfg
) -> dict[str, list[dict[str, float]]]:
    """Predicted figures with each number at the ends of its range, calibrated again each time.

    An assumed number stands at the ends of :data:`VARIED` and the calibrated ones are fitted; a calibrated number
    stands at the ends of its 95 % interval, cut to its range, and the others are fitted: together they still have to
    give the measured rows, which one of them alone at an end would miss. ``figure`` gives the predictions by name for a
    set of numbers; ``cfg`` are those to start from.
    """

    def end(name: str, value: float, **more: Any) -> dict[str, float]:
        fit = calibrate(rows, replace(cfg, **{name: value}), **more)
        return {"value": value, "rmse": fit.rmse, **figure(fit.cfg)}

    found = {name: [end(name, value) for value in ends] for name, ends in VARIED.items()}
    fit, specs = calibrate(rows, cfg), {spec.name: spec for spec in cfg.specs()}
    for name, half in fit.half_width.items():
        nominal = getattr(fit.cfg, name)
        ends = max(nominal - half, specs[name].low), min(nominal + half, specs[name].high)
        found[name] = [end(name, value, hold=(name,)) for value in ends]
    return found
