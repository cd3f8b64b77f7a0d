"""Random command lines."""

from __future__ import annotations

import contextlib
import io
import random
import re
from pathlib import Path

from benchmarks.fuzz.mutations import NUMBERS
from mrwarp import cli


def run_cli(folder: Path, rng: random.Random) -> tuple[str, list[str]]:
    """A random command line that cannot be right, as it names an input that is not there; what it said."""
    command = rng.choice([name for name in cli.COMMANDS if name not in ("verify", "reproduce")])
    flags = re.findall(r"(?<![\w-])--[a-z][a-z-]+", _help(command))
    words = (*NUMBERS, "cuda:99", str(folder / "none"), "-1e9", "mr_go", "go1", "😀", "a" * 5000, "--", "-x", "lstm")
    argv = [command]
    if command == "asset":
        argv.append(rng.choice(("show", "check", "diff", "set", "nothing")))
    for _ in range(rng.randrange(1, 6)):
        argv.append(rng.choice(flags) if flags and rng.random() < 0.6 else rng.choice(words))
        if rng.random() < 0.7:
            argv.append(rng.choice(words))
    argv += [
        "--device",
        "cuda:98",
        "--out",
        str(folder / "file" / "x"),
        "--policy",
        str(folder / "none.onnx"),
        str(folder / "no data"),
    ]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = cli.main([word.replace("\x00", "") for word in argv])
        except SystemExit as leaving:
            code = leaving.code
    said = err.getvalue().strip().splitlines()
    helped = code in (0, None) and "usage" in out.getvalue()
    if not helped and (code != 2 or not said):
        raise AssertionError(f"exit code {code!r}, said {err.getvalue()[-300:]!r} to {argv}")
    return ("help" if helped else said[-1]), argv


_HELPS: dict[str, str] = {}


def _help(command: str) -> str:
    if command not in _HELPS:
        out = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
            cli.main([command, "--help"])
        _HELPS[command] = out.getvalue()
    return _HELPS[command]
