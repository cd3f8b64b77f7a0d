"""``mrwarp <command>``: one entry for everything that computes, and the one place that says what went wrong.

A command is a dataclass in :mod:`mrwarp.commands`; :mod:`mrwarp.options` names and reads them.
"""

from __future__ import annotations

import errno
import gc
import itertools
import os
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

from mrwarp.options.command_line import MODELS, CommandLine, OptionError, parse, renamed_notes, values
from mrwarp.options.command_table import COMMANDS, GONE, Command, Group
from mrwarp.options.extras import missing_extra
from mrwarp.run_dir import FolderError, one_line
from mrwarp.runtime import closest, exit_code, one_of_several, one_voice, quiet_libraries

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
"""Errors of a disk that takes no more: no fault of the command line."""


def main(argv: Sequence[str] | None = None, prog: str = "") -> int:
    """Run a command; returns its exit code: 0 done, 1 measured but missed, 2 bad input, 130 stopped by Ctrl-C.

    Args:
        argv: Command and its arguments; None takes those of the process.
        prog: What the command is called, where a script of another name runs it.
    """
    try:
        code = _main(list(sys.argv[1:] if argv is None else argv), prog)
        sys.stdout.flush()
        if argv is None:  # the process ends: a last collection of what Warp's kernels left would take seconds
            gc.freeze()
        return code
    except BrokenPipeError:  # whoever read the output has gone, as in `mrwarp ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _main(words: list[str], prog: str) -> int:
    """Find the command that is named, and run it."""
    if words[:1] == ["--version"]:
        print(f"mrwarp {version('mrwarp')}")
        return 0
    called, entry = "mrwarp", Group("", COMMANDS)
    while isinstance(entry, Group):
        if not words or words[0] in ("-h", "--help"):
            print(_usage(called, entry))
            return 0 if words else 2
        if gone := GONE.get(called.rpartition(" ")[2], {}).get(words[0]):
            return _refuse(called, f"{words[0]} is gone; see {gone}", 2)
        if words[0] not in entry.commands:
            hint = closest(words[0], entry.commands)
            return _refuse(called, f"there is no command {words[0]!r}; {hint}see {called} --help", 2)
        called, entry = f"{called} {words[0]}", entry.commands[words.pop(0)]
    named = itertools.takewhile(lambda word: not word.startswith("-"), words)
    options = itertools.takewhile(lambda word: word != "--", words)
    for word in (*named, *(word for word in options if word.startswith("--"))):
        if gone := GONE.get(called.rpartition(" ")[2], {}).get(word.partition("=")[0]):
            return _refuse(called, f"{word} is gone; see {gone}", 2)
    for asked, variant in entry.variants.items():
        if words[:1] == [asked[0]] and set(asked) <= set(words):
            called, entry = f"{called} {' '.join(asked)}", variant
            for word in asked:
                words.remove(word)
            break
    return _run(entry, CommandLine(prog or called, tuple(words)))


def _run(command: Command, line: CommandLine) -> int:
    """Read the options, run, and say in one line what is wrong with them."""
    try:
        with one_voice():
            options = parse(command.load(), line.argv, line.prog)
            for note in renamed_notes(line.argv, type(options)):
                print(note, file=sys.stderr, flush=True)
            if not one_of_several():  # then the processes agree on who complains
                options.check()
                check_models(values(options))
        if options.engines:
            quiet_libraries(gpu=options.on_gpu, networks=options.networks)
        with options.claimed():
            return options.run(line)
    except SystemExit as leaving:  # after --help
        return leaving.code if isinstance(leaving.code, int) else 2
    except OptionError as error:
        with one_voice():
            return _refuse(line.prog, f"{error}; see --help", 2)
    except KeyboardInterrupt as stopped:
        print(f"\nstopped{f'; {stopped}' if str(stopped) else ''}", file=sys.stderr)
        return 130
    except BrokenPipeError:  # an OSError; for main
        raise
    except FolderError as error:
        return _refuse(line.prog, str(error), 2)
    except OSError as error:
        if error.errno in FULL:
            remedy = "make room or name another folder, then run it again"
            return _refuse(line.prog, f"{one_line(error)}; {remedy}", 1)
        return _refuse(line.prog, f"{one_line(error)}; name another", 2)
    except ModuleNotFoundError as error:
        if not (remedy := missing_extra(error)):
            raise
        return _refuse(line.prog, remedy, 2)
    except Exception as error:
        code = exit_code(error)
        if code is None or sys.flags.dev_mode:  # `python -X dev -m mrwarp` shows where it was raised
            raise
        return _refuse(line.prog, one_line(error), code)


def check_models(chosen: Mapping[str, Any]) -> None:
    """Read the model files that options name, by their names, before an engine is loaded.

    Raises:
        ModelFileError: one cannot be used.
    """
    for name in MODELS:
        file = chosen.get(name)
        if file is not None:
            from mrwarp.model_file import load_model

            load_model(file)


def _refuse(prog: str, message: str, code: int) -> int:
    print(f"{prog}: {message}", file=sys.stderr, flush=True)
    return code


def _usage(called: str, group: Group) -> str:
    rows = [f"  {name:12s} {entry.help}" for name, entry in group.commands.items()]
    lines = [f"usage: {called} COMMAND [options]", *([group.help] if group.help else []), "", "commands:", *rows, ""]
    return "\n".join([*lines, f"'{called} COMMAND --help' lists its options"])


if __name__ == "__main__":
    sys.exit(main())
