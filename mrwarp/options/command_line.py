"""A dataclass of options as a command line: tyro reads it, and every refusal is one line.

An option is a field: ``num_envs`` is ``--num-envs``, its docstring is the help. Loads no engine.
"""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
import io
import os
import re
import shlex
import shutil
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar, get_args, get_type_hints

import tyro
from tyro import _errors as events  # not public, see pyproject.toml
from tyro import _strings as help_strings
from tyro.conf import (
    AvoidSubcommands,
    DisallowNone,
    EnumChoicesFromValues,
    Fixed,
    OmitArgPrefixes,
    Positional,
    SuppressFixed,
)

from mrwarp.options.file_kinds import refuse_other_kind
from mrwarp.resources import model_path, no_model
from mrwarp.run_dir import check_writable, claim
from mrwarp.runtime import check_device

HELP_WIDTH = 120
"""Columns of a help that is not shown in a terminal."""

MODELS = ("model", "bouc_wen")
"""Options that name a model.json, or a device of the library."""

_PATH = "no such file or folder; check the path"
_USD = "no such file; name a .usda file"

INPUTS = {
    "policy": "no such policy; name an .onnx file that 'mrwarp train' wrote",
    "resume": "no such checkpoint; name the file checkpoint.pt that training wrote",
    **dict.fromkeys(MODELS, "no such file"),
    "robot": "no such robot; name its file",
    **dict.fromkeys(("asset", "a", "b"), _USD),
    "numbers": "no such file; name the numbers.json that --calibrate wrote",
    "compare": "no such file; name the result.json of an earlier run",
    **dict.fromkeys(
        (
            "data",
            "predict",
            "holding",
            "file",
            "map",
            "start_from",
            "policies",
            "results",
            "actuator_file",
            "packages",
        ),
        _PATH,
    ),
}
"""Options that name an input, and what is said where it is not there; ``policy`` is every ``policy_NAME`` too."""

OUTPUTS = ("out", "rrd", "png", "film", "runs", "library", "pictures")
"""Options that name what is written."""

_POSITIONAL, _FIXED = get_args(Positional[int])[1], get_args(Fixed[int])[1]
_NO_DEFAULT = re.compile(r"\s*\(default:\s+(None|False|)\)")
_PLAIN_HELP = {
    "Exactly one argument must be passed in. (required)": "Give one of these (required).",
    "At most one argument can be overridden.": "Give one of these at most.",
    " cfg.": " ",
}
"""Lines that tyro writes above a group of options, and what is printed; the name of a field is no title."""


class OptionError(ValueError):
    """A command line that cannot be read; the message names the option, its value and what is allowed."""


@dataclasses.dataclass(frozen=True)
class CommandLine:
    """The typed words."""

    prog: str
    """A command such as ``mrwarp train``, or a script such as ``train/ppo.py``."""
    argv: tuple[str, ...]
    """Its arguments."""

    def __str__(self) -> str:
        """The line as it can be typed again; scripts are run by python."""
        return f"{'python ' * self.prog.endswith('.py')}{self.prog} {shlex.join(self.argv)}"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options:
    """A command: its fields are the options, ``run`` does the work; engines are imported there."""

    engines: ClassVar[bool] = True
    """Whether it loads Warp or torch, whose start-up notes are silenced."""

    networks: ClassVar[bool] = True
    """Whether it loads torch then; what recordings need does not."""

    renamed: ClassVar[dict[str, str]] = {}
    """New spelling of each option that had another one, without the hyphens; ``name value`` for one value of it.

    The old one is taken, and a line names the new one.
    """

    @property
    def on_gpu(self) -> bool:
        """Whether a GPU was asked for."""
        chosen = values(self)
        return chosen.get("device", "cpu") != "cpu" or chosen.get("gpus", 0) > 0

    def check(self) -> None:
        """Refuse what needs no engine to be refused: files and devices that are not there, an unusable output folder.

        Raises:
            ValueError: a file or a device is not there; the message names it.
            FolderError: the output folder cannot be written.
        """
        self.check_inputs()
        check_device(values(self).get("device", "cpu"))
        if out := self.output():
            check_writable(out)

    def output(self) -> Path | None:
        """The folder that the command fills, which no other run may fill at the same time; None: it has none."""
        marks = getattr(option_types(type(self)).get("out"), "__metadata__", ())
        return values(self)["out"] if any(getattr(mark, "metavar", "") == "DIR" for mark in marks) else None

    def claimed(self) -> contextlib.AbstractContextManager[None]:
        """Keep other runs out of :meth:`output` while this one works.

        Raises:
            FolderError: another run is at work there.
        """
        return claim(out) if (out := self.output()) else contextlib.nullcontext()

    def check_inputs(self) -> None:
        """Refuse inputs that are not there or of another kind; the name of a robot that is shipped is none.

        Raises:
            ValueError: a file or folder is not there, or of another kind than the option's; the message names it.
        """
        for name, chosen in values(self).items():
            reason = INPUTS.get("policy" if name.startswith("policy_") else name)
            for path in (chosen if isinstance(chosen, tuple) else (chosen,)) if reason else ():
                named = isinstance(path, str) and name == "robot" and not Path(path).suffix
                if not isinstance(path, str | Path) or named:
                    continue
                if name in MODELS:
                    reason, path = f"no such file; {no_model(path)}", model_path(path)
                if not os.path.lexists(path):
                    raise ValueError(f"{path}: {reason}")
                refuse_other_kind(Path(path), name)

    def run(self, line: CommandLine) -> int:
        """Do the work; returns the exit code: 0 done, 1 measured but missed, 2 bad input, 130 stopped by Ctrl-C."""
        raise NotImplementedError  # each command has its own; options that several share are no command

    def chosen(self, *names: str) -> dict[str, Any]:
        """Options by name, for a configuration in which they are called the same."""
        return {name: getattr(self, name) for name in names}


OptionsT = TypeVar("OptionsT")

_READ = (DisallowNone, EnumChoicesFromValues, OmitArgPrefixes, AvoidSubcommands, SuppressFixed)
"""How tyro reads options: those of configurations within a command have no prefix, and what is fixed is not shown."""


def parse(options: type[OptionsT], argv: Sequence[str], prog: str, default: OptionsT | None = None) -> OptionsT:
    """Read arguments.

    Args:
        options: The command, or a part of one; its dataclasses are read as one list of options.
        argv: The words.
        prog: What the command is called in its help.
        default: Values of what is not typed; None takes those of the fields.

    Raises:
        OptionError: they cannot be read.
        SystemExit: with 0, after ``--help`` was printed.
    """

    def refuse(event: events.ParseErrorEvent) -> None:
        raise OptionError(" ".join(_message(event, options).split()))

    printed = io.StringIO()
    try:
        with events.on_parse_error(refuse), contextlib.redirect_stdout(printed), _plain():
            read: Any = Annotated[options, *_READ]
            words = respelled(argv, options)
            if default is None:
                return tyro.cli(read, args=words, prog=prog)
            # tyro does not know a flag that is set already
            on = {f"--{name.replace('_', '-')}" for name, value in values(default).items() if value is True}
            words = [word for word in words if word not in on]
            return tyro.cli(read, args=words, prog=prog, default=default)
    except SystemExit:
        shown = _NO_DEFAULT.sub("", printed.getvalue())
        for tyros, plain in _PLAIN_HELP.items():
            shown = shown.replace(tyros, plain)
        for text in shown.splitlines():
            print(textwrap.fill(text, _width()) if len(text.rstrip()) > _width() else text.rstrip())
        raise


def respelled(argv: Sequence[str], options: type) -> list[str]:
    """The words, with options that have another name now under that."""
    renamed, words = getattr(options, "renamed", {}), list(argv)
    for k, word in enumerate(words):
        name, equals, value = word.removeprefix("--").partition("=")
        follows = value if equals else next(iter(words[k + 1 : k + 2]), "")
        new = renamed.get(name) or renamed.get(f"{name} {follows}")
        if new and word.startswith("--"):
            words[k] = f"--{new}{equals}{value}"
    return words


def renamed_notes(argv: Sequence[str], options: type) -> list[str]:
    """A line for each option that was typed under an earlier name."""
    pairs = zip(argv, respelled(argv, options), strict=True)
    return [f"note: {old.partition('=')[0]} is called {new.partition('=')[0]} now" for old, new in pairs if old != new]


def given(line: CommandLine, options: type) -> set[str]:
    """Options that were typed, by the names of their fields, with any value."""
    words = respelled(line.argv, options)
    return {word[2:].partition("=")[0].replace("-", "_") for word in words if word.startswith("--")}


def option_types(options: type) -> dict[str, Any]:
    """The type of every option by its name, those of configurations within included; what is fixed is none."""
    found: dict[str, Any] = {}
    for _, name, kind, inner in _fields(options):
        found |= option_types(inner) if inner else {name: kind}
    return found


def values(options: Any) -> dict[str, Any]:
    """The value of every option by its name, those of configurations within included."""
    found: dict[str, Any] = {}
    for field, name, _, inner in _fields(type(options)):
        own = getattr(options, field.name)
        found |= values(own) if inner else {name: own}
    return found


def option_fields(options: type) -> Iterator[tuple[type, dataclasses.Field[Any], str]]:
    """The dataclass, the field and the name of every option, those of configurations within included."""
    for field, name, _, inner in _fields(options):
        yield from option_fields(inner) if inner else ((options, field, name),)


def option_flags(options: type) -> dict[str, bool]:
    """Every ``--option`` of a command by its name without the hyphens, and whether it is a flag, without a value."""
    named = {name: (get_args(kind) or (kind,)) for name, kind in option_types(options).items()}
    return {
        name.replace("_", "-"): kind[0] is bool and not any(hasattr(mark, "instance_from_str") for mark in kind)
        for name, kind in named.items()
        if _POSITIONAL not in kind
    }


def _fields(options: type) -> Iterator[tuple[dataclasses.Field[Any], str, Any, type | None]]:
    """Each field that is an option: its name on the command line, its type, and the configuration that it holds."""
    hints = get_type_hints(options, include_extras=True)
    for field in dataclasses.fields(options):
        kind = hints[field.name]
        marks = getattr(kind, "__metadata__", ())
        if _FIXED in marks:
            continue
        names = [mark.name for mark in marks if hasattr(mark, "aliases") and mark.name]
        inner = kind if not marks and dataclasses.is_dataclass(kind) else None
        yield field, (names or [field.name])[0], kind, inner  # type: ignore[misc]


def _width() -> int:
    return shutil.get_terminal_size((HELP_WIDTH, 24)).columns


@contextlib.contextmanager
def _plain() -> Iterator[None]:
    """Help without boxes and colours, as wide as the terminal; tyro keeps the line breaks of indented docstrings."""
    style, joined = tyro._experimental_options, help_strings.remove_single_line_breaks
    before, columns = style.copy(), os.environ.get("COLUMNS")
    style.update(utf8_boxes=False, ansi_codes=False)
    help_strings.remove_single_line_breaks = _paragraphs
    os.environ["COLUMNS"] = columns or str(_width())
    try:
        yield
    finally:
        style.update(before)
        help_strings.remove_single_line_breaks = joined
        if columns is None:
            del os.environ["COLUMNS"]


def _paragraphs(text: str) -> str:
    """The text with one line per paragraph."""
    return "\n\n".join(" ".join(part.split()) for part in re.split(r"\n\s*\n", text.strip()))


def _message(event: events.ParseErrorEvent, options: type) -> str:
    """The fault, in a sentence."""
    match event:
        case events.InstantiationFailure(argument=argument, message=message):
            return f"argument {_name(argument)}: {message}" if argument else message
        case events.InvalidChoice(argument=argument, value=value, choices=choices):
            known = ", ".join(choice for choice in choices if choice != "None")  # that is leaving it out
            return f"argument {_name(argument)}: invalid choice: {value!r} (choose from {known})"
        case events.BadValue(argument=argument):
            wanted = argument.lowered.nargs
            return f"argument {_name(argument)}: expected {wanted} value{'s' * (wanted != 1)}"
        case events.MutexConflict(first_token=first, second_token=second):
            return f"argument {second}: not allowed with argument {first}"
        case events.MissingArgs(missing_arguments=missing):
            return f"the following arguments are required: {', '.join(_name(found.arg) for found in missing)}"
        case events.MissingMutexGroup(groups=groups):
            names = [" ".join(found.arg.display_name() for found in group) for group in groups]
            return f"one of the arguments {'; '.join(names)} is required"
        case events.UnrecognizedArgs(tokens=tokens):
            known = [f"--{name}" for name in option_flags(options)]
            near = [near for token in tokens for near in difflib.get_close_matches(token.partition("=")[0], known, n=1)]
            return f"unrecognized arguments: {' '.join(tokens)}" + (f"; did you mean {near[0]}?" if near else "")
    return type(event).__name__


def _name(argument: Any) -> str:
    """An option, or what a positional argument is called in the help."""
    return str(argument.lowered.metavar).split()[0].strip("[]") if argument.is_positional() else argument.display_name()
