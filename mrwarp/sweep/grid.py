"""The trials of a sweep: every combination of a small grid of a command's options, all checked before one runs."""

from __future__ import annotations

import contextlib
import io
import itertools
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mrwarp.options.command_line import OptionError, option_flags, parse
from mrwarp.options.command_table import COMMANDS, Command

LONGEST_NAME = 120
"""Longest name of a trial's folder."""

MOST_TRIALS = 10_000
"""Most combinations that are taken for what the user meant."""


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


class SweptCommand:
    """A command of mrwarp and the options it knows.

    Args:
        name: Command.

    Raises:
        GridError: there is none of this name, or it writes no figures into a folder.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        command = COMMANDS.get(name) if name != "sweep" else None
        self._options = command.load_options() if isinstance(command, Command) else object
        self._flags = option_flags(self._options)
        if "out" not in self._flags:
            can = "train, walk, impact, mission, reproduce, fit, diagnose, learn or bench"
            raise GridError(f"--command {name}: cannot be swept; choose one that writes figures into --out: {can}")

    def has(self, option: str) -> bool:
        """Whether the command knows ``--option``."""
        return option in self._flags

    def given(self, option: str, value: str) -> list[str]:
        """The arguments that set an option; a value of several words is several values, a flag is ``on`` or ``off``.

        Raises:
            GridError: the command has no such option, or the flag is neither.
        """
        if option in ("out", "resume") or not self.has(option):
            known = ", ".join(sorted(self._flags))
            raise GridError(f"--grid {option}={value}: mrwarp {self.name} has no such option to sweep; it has {known}")
        if self._flags[option]:
            if value not in ("on", "off"):
                raise GridError(f"--grid {option}={value}: --{option} is a flag; give {option}=on,off")
            return [f"--{option}"] if value == "on" else []
        words = shlex.split(value)
        # one word in one argument, so that a negative number is no option
        return [f"--{option}={words[0]}"] if len(words) == 1 else [f"--{option}", *words]

    def check(self, trial: Trial, out: Path) -> None:
        """Read a trial's arguments as the command will.

        Raises:
            GridError: it refuses.
        """
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                parse(self._options, [*trial.args, "--out", str(out / trial.name)], f"mrwarp {self.name}")
        except OptionError as error:
            raise GridError(f"{trial.name}: mrwarp {self.name}: {error}; see --help") from None
        except SystemExit:
            raise GridError("--help stands before '--' for the sweep; see 'mrwarp COMMAND --help'") from None


def make_trials(
    command: SweptCommand, grid: Sequence[str], fixed: Sequence[str], out: Path, *, threads: int | None = None
) -> list[Trial]:
    """Every combination of the grid, the last option varying fastest.

    Args:
        command: What is run.
        grid: ``name=value,value,...``, one for each option.
        fixed: Arguments that all trials share.
        out: Folder of the sweep.
        threads: CPU threads of a trial, given to commands that have ``--threads`` and were not told.

    Raises:
        GridError: the grid cannot be read, or the command refuses a trial.
    """
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
    words = [word.partition("=")[0] for word in fixed]
    for option in ("out", "resume", *axes):
        if f"--{option}" in words:
            remedy = "the sweep sets it" if option in ("out", "resume") else "it is in the grid"
            raise GridError(f"--{option} after '--': {remedy}; leave it out there")
    shared = list(fixed)
    if threads and command.has("threads") and "--threads" not in words and "threads" not in axes:
        shared.append(f"--threads={threads}")
    trials = []
    count = 1
    for values in axes.values():
        count *= len(values)
    if count > MOST_TRIALS:
        raise GridError(f"--grid: {count} combinations are more than {MOST_TRIALS}; sweep fewer values at once")
    for combination in itertools.product(*axes.values()):
        values = dict(zip(axes, combination, strict=True))
        args = [word for option, value in values.items() for word in command.given(option, value)]
        name = "_".join(f"{option}={re.sub(r'[^A-Za-z0-9_.+-]+', '-', value)}" for option, value in values.items())
        trials.append(Trial(name=name[:LONGEST_NAME], values=values, command=command.name, args=(*shared, *args)))
    names = [trial.name for trial in trials]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise GridError(f"--grid: two trials would share the folder {twice}; give files distinct, shorter names")
    for trial in trials:
        command.check(trial, out)
    return trials
