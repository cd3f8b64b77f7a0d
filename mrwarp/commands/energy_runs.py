"""What ``mrwarp walk`` and ``mrwarp mission`` share: options for robots, policies and the numbers of the models."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrwarp.energy import battery, power, thermal
from mrwarp.energy.battery import BatteryCfg
from mrwarp.energy.power import ElectricalCfg
from mrwarp.energy.thermal import ThermalCfg
from mrwarp.enums import Coupling
from mrwarp.model_file import read_json_file
from mrwarp.options.arguments import seed, whole, within
from mrwarp.paper import ROBOTS
from mrwarp.params import ParameterError, ParamGroup
from mrwarp.run_dir import write_text

if TYPE_CHECKING:  # what help need not wait for
    from mrwarp.env.cfg import EnvCfg
    from mrwarp.trials.walking import Policy

GROUPS: dict[str, type[ParamGroup]] = {"electrical": ElectricalCfg, "thermal": ThermalCfg, "battery": BatteryCfg}
"""Groups of numbers by the name under which a file holds them."""


speed = within(0.05, 1.0, "m/s")
"""Command; the 1.5 Hz trot reaches about 0.6 m/s (section 7)."""
load = within(0.0, 20.0, "kg")
"""Mass on the back; the robot has 12 kg."""
distance = within(0.01, 1e4, "m")
"""Way walked."""
current = within(0.01, 100.0, "A")
"""Coil current; each device clips it to its own ``current_max``."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the shared options."""
    add = parser.add_argument
    own = "policy of all robots (default: each robot's own of policies/energy, training seed 0)"
    add("--policy", type=Path, metavar="P", help=own)
    for robot in ROBOTS:
        add(f"--policy-{robot.replace('_', '-')}", type=Path, metavar="P", help=f"another policy for {robot}")
    add("--numbers", type=Path, metavar="FILE", help="JSON with numbers of the models, as --calibrate writes it")
    add("--set", nargs="*", default=[], metavar="NAME=VALUE", help="single numbers, e.g. regeneration=0")
    coupling = "how the device acts (default: constraint)"
    add("--coupling", choices=[c.value for c in Coupling], default="constraint", help=coupling)
    add(
        "--branches", choices=("both", "holding"), default="both", help="SAL with damping and holding, or holding alone"
    )
    add("--current", type=current, default=1.5, metavar="A", help="current the devices may use (default: 1.5)")
    add("--model", metavar="MODEL.json", help="identified joint with its effects, on all MR joints")
    add("--asset", help="another USD file than assets/usd/mr_go.usda")
    add("--threads", type=whole, default=0, help="CPU threads; 0 = all, the figures are the same for any number")
    add("--seed", type=seed, default=0, help="seed of poses and gait phases (default: 0)")


def env_cfg(args: argparse.Namespace) -> EnvCfg:
    """The task that the options ask for."""
    from mrwarp.env.cfg import make_walk_cfg

    env = make_walk_cfg(coupling=Coupling(args.coupling), asset=args.asset, model=args.model, threads=args.threads)
    return replace(env, currents=(args.current,), actuator=replace(env.actuator, damping=args.branches == "both"))


def policies(args: argparse.Namespace) -> dict[str, Policy]:
    """Policy of each robot, by default trained with its coupling; files that are the same are loaded once.

    Raises:
        PolicyError: a file cannot be used.
    """
    from mrwarp.rl.policy import OnnxPolicy
    from mrwarp.study.plan import ENERGY, SEEDS, plant_of, policy_file

    coupling = Coupling(args.coupling)
    paths = {
        robot: getattr(args, f"policy_{robot}") or args.policy
        or policy_file(ENERGY, plant_of(robot, coupling), SEEDS[0])
        for robot in ROBOTS
    }  # fmt: skip
    loaded = {path: OnnxPolicy(path) for path in set(paths.values())}
    return {robot: loaded[path] for robot, path in paths.items()}


def numbers(args: argparse.Namespace) -> dict[str, Any]:
    """The groups of numbers: defaults, then ``--numbers``, then ``--set``.

    Raises:
        ParameterError: a name is unknown or a value out of range; the message says which.
        ModelFileError: the file is not JSON.
        OSError: the file cannot be read.
    """
    changes: dict[str, dict[str, Any]] = {name: {} for name in GROUPS}
    if args.numbers is not None:
        content = read_json_file(args.numbers, "give the numbers.json that --calibrate wrote")
        if not isinstance(content, dict) or not all(isinstance(group, dict) for group in content.values()):
            raise ParameterError(f"{args.numbers}: needs one object per group: {', '.join(GROUPS)}")
        for group, values in content.items():
            if group not in GROUPS:
                raise ParameterError(f"{args.numbers}: unknown group {group!r}; known: {', '.join(GROUPS)}")
            for name, value in values.items():
                changes[_group_of(name, str(args.numbers), group)][name] = value
    for text in args.set:
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
    told = described(groups, fitted)

    def all_of(name: str, what: str) -> bool:
        return all(told[name][number][what] for number in CALIBRATED[name])

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


class Progress:
    """One line that says how far the work is; a fifth at a time where the output is no terminal."""

    def __init__(self, stream: Any) -> None:
        self._stream, self._live, self._last = stream, stream.isatty(), (None, -1)

    def __call__(self, text: str, share: float) -> None:
        """Show that ``share`` of the work is done, at ``text``."""
        if self._live:
            print(f"\r\033[K{share:4.0%}  {text}", end="", file=self._stream, flush=True)
        elif (now := (text, int(share * 5.0))) != self._last:
            print(f"{share:4.0%}  {text}", file=self._stream, flush=True)
            self._last = now

    def done(self) -> None:
        """Clear the line."""
        if self._live:
            print("\r\033[K", end="", file=self._stream, flush=True)
