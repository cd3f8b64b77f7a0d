"""The trials of a sweep: every combination of a small grid of a command's options, all checked before one runs."""

from __future__ import annotations

import itertools
import math
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mrwarp.options.command_line import OptionError, Options, option_flags, parse
from mrwarp.options.command_table import COMMANDS, Command

MOST_TRIALS = 10_000
"""Most combinations that are taken for what the user meant."""


class GridError(ValueError):
    """A sweep cannot be run as asked; the message names option, value and remedy."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One run of the command."""

    folder: Path
    """Its own folder, named after the values, e.g. ``seed=0_actuator=pg_rlstm``."""
    values: dict[str, str]
    """Value of each option in the grid."""
    args: list[str]
    """Command of mrwarp and its arguments without ``--out``."""


def make_trials(command: str, items: Sequence[str], fixed: Sequence[str], out: Path, *, threads: int) -> list[Trial]:
    """Every combination of the grid, the last option varying fastest.

    Args:
        command: Command of mrwarp.
        items: The grid, e.g. ``seed=0,1,2``; a value of several words is several values, a flag is ``on`` or ``off``.
        fixed: Arguments that all trials share.
        out: Folder of the sweep.
        threads: CPU threads of a trial, for commands that have ``--threads`` and got none.

    Raises:
        GridError: the command cannot be swept, the grid cannot be read, or the command refuses a trial.
    """
    known = COMMANDS.get(command) if command != "sweep" else None
    options = known.load() if isinstance(known, Command) else Options
    flags = option_flags(options)
    if "out" not in flags:
        can = "train, walk, impact, mission, reproduce, fit, diagnose, learn or bench"
        raise GridError(f"--command {command}: cannot be swept; choose one that writes figures into --out: {can}")
    grid = _read_grid(items)
    given = {word.partition("=")[0].removeprefix("--") for word in fixed if word.startswith("--")}
    for option in ("out", "resume"):
        if option in given or option in grid:
            raise GridError(f"--{option}: the sweep sets it for every trial; leave it out")
    if twice := [option for option in grid if option in given]:
        raise GridError(f"--{twice[0]} after '--': it is in the grid; leave it out there")
    shared = [command, *fixed]
    if "threads" in flags and "threads" not in given and "threads" not in grid:
        shared.append(f"--threads={threads}")
    trials: dict[Path, Trial] = {}
    for combination in itertools.product(*grid.values()):
        values = dict(zip(grid, combination, strict=True))
        name = "_".join(f"{option}={re.sub(r'[^A-Za-z0-9_.+-]+', '-', value)}" for option, value in values.items())
        folder = out.absolute() / name[:120]
        if folder in trials:
            raise GridError(f"--grid: two trials would share the folder {folder.name}; name each value once")
        args = [word for option, value in values.items() for word in _arguments(option, value, flags)]
        trials[folder] = Trial(folder=folder, values=values, args=[*shared, *args])
    for folder, trial in trials.items():
        try:
            parse(options, [*trial.args[1:], "--out", str(folder)], f"mrwarp {command}").check_inputs()
        except OptionError as error:
            raise GridError(f"{folder.name}: mrwarp {command}: {error}; see --help") from None
        except ValueError as error:
            raise GridError(f"{folder.name}: mrwarp {command}: {error}") from None
    return list(trials.values())


def _read_grid(items: Sequence[str]) -> dict[str, list[str]]:
    """Values by option, from texts like ``seed=0,1,2``."""
    grid: dict[str, list[str]] = {}
    for item in items:
        option, _, text = item.removeprefix("--").partition("=")
        values = [value.strip() for value in text.split(",")]
        if not option or not all(values) or option in grid:
            raise GridError(
                f"--grid {item}: not of the form name=value,value,... with every name once; e.g. seed=0,1,2"
            )
        grid[option] = values
    if (count := math.prod(map(len, grid.values()))) > MOST_TRIALS:
        raise GridError(f"--grid: {count} combinations are more than {MOST_TRIALS}; sweep fewer values at once")
    return grid


def _arguments(option: str, value: str, flags: dict[str, bool]) -> list[str]:
    if flags.get(option):
        if value not in ("on", "off"):
            raise GridError(f"--grid {option}={value}: --{option} is a flag; give {option}=on,off")
        return [f"--{option}"] if value == "on" else []
    words = shlex.split(value)
    # one word in one argument, so that a negative number is no option
    return [f"--{option}={words[0]}"] if len(words) == 1 else [f"--{option}", *words]
