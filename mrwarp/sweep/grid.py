"""The trials of a sweep: every combination of a small grid of a command's options, all checked before one runs."""

from __future__ import annotations

import contextlib
import io
import itertools
import math
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mrwarp.options.command_line import OptionError, Options, option_flags, parse
from mrwarp.options.command_table import COMMANDS, Command

LONGEST_NAME = 120
"""Longest name of a trial's folder."""

MOST_TRIALS = 10_000
"""Most combinations that are taken for what the user meant."""

SET_BY_SWEEP = ("out", "resume")


class GridError(ValueError):
    """A sweep cannot be run as asked; the message names option, value and remedy."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One run of the command."""

    name: str
    """Name of its folder, e.g. ``seed=0_actuator=pg_rlstm``."""
    values: dict[str, str]
    """Value of each option in the grid."""
    command: str
    """Command of mrwarp."""
    args: tuple[str, ...]
    """The command's arguments without ``--out``."""


def make_trials(
    command: str, grid: Sequence[str], fixed: Sequence[str], out: Path, *, threads: int | None = None
) -> list[Trial]:
    """Every combination of the grid, the last option varying fastest.

    Args:
        command: Command of mrwarp that is run.
        grid: ``name=value,value,...``, one for each option; a value of several words is several values, a flag is
            ``on`` or ``off``.
        fixed: Arguments that all trials share.
        out: Folder of the sweep.
        threads: CPU threads of a trial, given to commands that have ``--threads`` and were not told.

    Raises:
        GridError: the command cannot be swept, the grid cannot be read, or the command refuses a trial.
    """
    known = COMMANDS.get(command) if command != "sweep" else None
    options = known.load() if isinstance(known, Command) else Options
    flags = option_flags(options)
    if "out" not in flags:
        can = "train, walk, impact, mission, reproduce, fit, diagnose, learn or bench"
        raise GridError(f"--command {command}: cannot be swept; choose one that writes figures into --out: {can}")
    axes = _axes(grid)
    words = [word.partition("=")[0] for word in fixed]
    for option in (*SET_BY_SWEEP, *axes):
        if f"--{option}" in words:
            remedy = "the sweep sets it" if option in SET_BY_SWEEP else "it is in the grid"
            raise GridError(f"--{option} after '--': {remedy}; leave it out there")
    shared = list(fixed)
    if threads and "threads" in flags and "--threads" not in words and "threads" not in axes:
        shared.append(f"--threads={threads}")
    trials: dict[str, Trial] = {}
    for combination in itertools.product(*axes.values()):
        values = dict(zip(axes, combination, strict=True))
        args = [word for option, value in values.items() for word in _arguments(command, flags, option, value)]
        name = "_".join(f"{option}={re.sub(r'[^A-Za-z0-9_.+-]+', '-', value)}" for option, value in values.items())
        name = name[:LONGEST_NAME]
        if name in trials:
            raise GridError(f"--grid: two trials would share the folder {name}; give files distinct, shorter names")
        trials[name] = Trial(name=name, values=values, command=command, args=(*shared, *args))
    for name, trial in trials.items():
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                parse(options, [*trial.args, "--out", str(out / name)], f"mrwarp {command}")
        except OptionError as error:
            raise GridError(f"{name}: mrwarp {command}: {error}; see --help") from None
        except SystemExit:
            raise GridError("--help stands before '--' for the sweep; see 'mrwarp COMMAND --help'") from None
    return list(trials.values())


def _axes(grid: Sequence[str]) -> dict[str, list[str]]:
    """Values by option."""
    axes: dict[str, list[str]] = {}
    for item in grid:
        option, equals, text = item.partition("=")
        option, values = option.removeprefix("--"), [value.strip() for value in text.split(",")]
        if not equals or not option or not all(values):
            raise GridError(f"--grid {item}: not of the form name=value,value,...; e.g. seed=0,1,2")
        if option in axes:
            raise GridError(f"--grid {item}: {option} is there twice; put all its values into one list")
        if len(set(values)) < len(values):
            raise GridError(f"--grid {item}: a value is there twice; name each once")
        axes[option] = values
    if (count := math.prod(map(len, axes.values()))) > MOST_TRIALS:
        raise GridError(f"--grid: {count} combinations are more than {MOST_TRIALS}; sweep fewer values at once")
    return axes


def _arguments(command: str, flags: dict[str, bool], option: str, value: str) -> list[str]:
    """The arguments that set an option."""
    if option in SET_BY_SWEEP or option not in flags:
        known = ", ".join(sorted(flags))
        raise GridError(f"--grid {option}={value}: mrwarp {command} has no such option to sweep; it has {known}")
    if flags[option]:
        if value not in ("on", "off"):
            raise GridError(f"--grid {option}={value}: --{option} is a flag; give {option}=on,off")
        return [f"--{option}"] if value == "on" else []
    words = shlex.split(value)
    # one word in one argument, so that a negative number is no option
    return [f"--{option}={words[0]}"] if len(words) == 1 else [f"--{option}", *words]
