"""Numbers of the electrical, thermal and battery models: as files and options give them, and where each comes from."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mrwarp.energy import battery, power, thermal
from mrwarp.energy.battery import BatteryCfg
from mrwarp.energy.power import ElectricalCfg
from mrwarp.energy.thermal import ThermalCfg
from mrwarp.model_file import read_json_file
from mrwarp.params import ParameterError, ParamGroup
from mrwarp.run_dir import write_text

GROUPS: dict[str, type[ParamGroup]] = {"electrical": ElectricalCfg, "thermal": ThermalCfg, "battery": BatteryCfg}
"""Groups of numbers by the name under which a file holds them."""


def read_numbers(file: Path | None, given: Sequence[str]) -> dict[str, Any]:
    """The groups of numbers: defaults, then those of a file, then single ones.

    Args:
        file: JSON with an object per group, as ``--calibrate`` writes it.
        given: Single numbers as ``NAME=VALUE`` or ``GROUP.NAME=VALUE``.

    Raises:
        ParameterError: a name is unknown or a value out of range; the message says which.
        ModelFileError: the file is not JSON.
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
        where, _, bare = name.rpartition(".")
        changes[_group_of(bare, "--set", where or None)][bare] = value
    return {name: group(**changes[name]) for name, group in GROUPS.items()}


def _group_of(name: str, where: str, group: str | None) -> str:
    """The group that has a number of this name; ``winding_resistance`` stands in two and needs its group."""
    found = [key for key, cls in GROUPS.items() if name in {spec.name for spec in cls.specs()}]
    if group is not None:
        if group not in found:
            raise ParameterError(f"{where}: there is no {group}.{name}; {name} is in: {', '.join(found) or 'no group'}")
        return group
    if len(found) != 1:
        known = ", ".join(spec.name for cls in GROUPS.values() for spec in cls.specs())
        hint = f"write {' or '.join(f'{key}.{name}' for key in found)}" if found else f"known: {known}"
        raise ParameterError(f"{where}: {name!r} is not one number; {hint}")
    return found[0]


CALIBRATED = {"electrical": power.CALIBRATED, "thermal": thermal.CALIBRATED, "battery": battery.CALIBRATED}
"""Numbers of each group that are fitted to Go1; their defaults are what ``--calibrate`` gave with the shipped
policies."""


def fitted_names(*groups: str) -> tuple[str, ...]:
    """What --calibrate fits in these groups, as ``group.name``."""
    return tuple(f"{group}.{name}" for group in groups for name in CALIBRATED[group])


def calibrated(groups: dict[str, Any], fitted: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Groups whose fitted numbers come from Go1's figures, in this run or by default; given ones do not.

    The defaults of heat and battery were fitted with the electrical ones; without these they fit nothing.

    Args:
        groups: The groups in use.
        fitted: What this run fitted, as ``group.name``.
    """
    sources = described(groups, fitted)

    def all_of(name: str, what: str) -> bool:
        return all(sources[name][number][what] for number in CALIBRATED[name])

    return tuple(
        name for name in groups
        if all_of(name, "fitted_in_this_run") or (all_of(name, "calibrated") and all_of("electrical", "calibrated"))
    )  # fmt: skip


def described(groups: dict[str, Any], fitted: tuple[str, ...] = ()) -> dict[str, Any]:
    """Every number with unit, range, source and whether it was calibrated, for ``result.json``.

    Args:
        groups: The groups in use.
        fitted: What this run fitted, as ``group.name``.
    """
    found: dict[str, Any] = {}
    for name, cfg in groups.items():
        found[name] = {}
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
