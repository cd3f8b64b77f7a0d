"""Fuzzing of everything that is read from outside: ``python -m benchmarks.fuzz --kind csv --cases 100000``.

Good files are mutated byte by byte, line by line and number by number. Every case must end in a good read, or in the
reader's own refusal: one line that names the file and a remedy. No other exception, no hang, no memory blow-up, no
file left behind. Cases run in batches in a process of their own with a memory limit; an input that was refused for a
new reason joins the batch's corpus. Batch k of a seed is always the same, and the state file lets a run go on where it
stopped. What fails is kept in ``OUT/failures``.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import gzip
import io
import json
import multiprocessing
import os
import random
import re
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

BATCH = 500
"""Cases of one process."""

MEMORY = 2**31
"""Address space that a batch may add to what it starts with [bytes]."""

HANG = 20.0
"""Longest time of a case [s]."""

REMEDY = re.compile(
    r"; |allowed|needed|must |use |give |name |remove|repair|correct|check |choose|again|anew|known|--help|expected"
)
"""What a remedy sounds like."""

NUMBERS = (
    "nan", "inf", "-inf", "1e999", "-1", "0", "1e308", "-1e308", "1e-320", "9" * 400, "0x10", "1_000", "١", "", "null",
    "true", "[]", "{}", '"a"', "1,2", "--", "NaN", "1e", "-0.0", "2147483648", "18446744073709551616", "\ufeff1",
    "\x00",
)  # fmt: skip
"""What stands in place of a number."""


@dataclass(frozen=True)
class Kind:
    """One kind of input."""

    suffix: str
    """Of the file."""
    seeds: Callable[[], list[bytes]]
    """Good files."""
    read: Callable[[Path], Any]
    """Reads a file."""
    refusals: Callable[[], tuple[type[Exception], ...]]
    """How it may refuse."""
    whole: bool = True
    """Whether any byte may change, or only the values of attributes (text)."""


def csv_seeds() -> list[bytes]:
    """Two trajectories with a comment line, one without qd, one compressed."""
    t = 0.005 * np.arange(60)
    q, current = np.sin(6.0 * t), np.where(t < 0.1, 0.5, 1.0)
    qd, torque = 6.0 * np.cos(6.0 * t), 2.0 * np.cos(6.0 * t)
    rows = [f"{a:.4f},{b:.6f},{c:.6f},{d},{e:.6f},{'a' if k < 60 else 'b'},21.5" for k in range(120)
            for a, b, c, d, e in [(t[k % 60], q[k % 60], qd[k % 60], current[k % 60], torque[k % 60])]]  # fmt: skip
    full = '# {"source": "bench", "seed": 1}\nt,q,qd,current,torque,trajectory,temperature\n' + "\n".join(rows) + "\n"
    plain = "t,q,current,torque\n" + "\n".join(f"{t[k]:.4f},{q[k]:.6f},{current[k]},{torque[k]:.6f}" for k in range(60))
    return [full.encode(), plain.encode(), plain.replace("\n", "\r\n").encode(), gzip.compress(plain.encode(), mtime=0)]


def parquet_seeds() -> list[bytes]:
    """The same, as Parquet."""
    import pyarrow.csv
    import pyarrow.parquet

    found = []
    for data in csv_seeds()[:2]:
        lines = b"\n".join(line for line in data.splitlines() if not line.startswith(b"#"))
        out = io.BytesIO()
        pyarrow.parquet.write_table(pyarrow.csv.read_csv(io.BytesIO(lines)), out)
        found.append(out.getvalue())
    return found


def model_seeds() -> list[bytes]:
    """A fitted joint, without and with effects."""
    from mrwarp.model_effects import make_effect
    from mrwarp.model_file import JOINT_UNITS, FittedOn, Model, Parameter, model_to_dict, parameter_unit

    values = {
        "D": -0.033, "B": 0.1, "C": 0.2, "I1": -1e-4, "K0": 0.4, "K1": 10.4, "alpha": 0.77, "beta": 16.5,
        "gamma": -10.5, "q_offset": 1e-5, "T_max": 20.0, "K": 0.5, "n": 3.0,
    }  # fmt: skip
    parameters = {
        name: Parameter(value=value, unit=parameter_unit(name, JOINT_UNITS), ci95=(value - 1.0, value + 1.0))
        for name, value in values.items()
    }
    plain = Model(parameters=parameters, fitted_on=FittedOn(source="bench", trajectories=2, samples=100, rate=200.0))
    effects = (make_effect("coulomb_friction", {"torque": 0.3, "speed": 0.1}),)
    return [json.dumps(model_to_dict(m), indent=2).encode() for m in (plain, replace(plain, effects=effects))]


def read_model(path: Path) -> None:
    """Load a model and put it on the robot's joints."""
    from mrwarp.effects.applied import with_model

    with_model(_robot(), str(path))


@functools.cache
def _robot() -> Any:
    from mrwarp.asset import load_robot

    return load_robot()


def usd_seeds() -> list[bytes]:
    """The shipped robot and bench."""
    from mrwarp.asset import ASSETS

    return [(ASSETS / "mr_go.usda").read_bytes()]


def read_usd(path: Path) -> None:
    """Load the robot of an asset."""
    from mrwarp.asset import load_robot

    load_robot(path)


def checkpoint_seeds() -> list[bytes]:
    """A small checkpoint."""
    import torch

    from mrwarp.rl import checkpoint

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "c.pt"
        checkpoint.save(path, {"a": torch.zeros(20), "b": {"c": [1, 2.0, "d"]}, "rows": [{"x": 1.0}]})
        return [path.read_bytes()]


def policy_seeds() -> list[bytes]:
    """The shipped walking policy, with fewer weights by its own graph's sizes left as they are."""
    from mrwarp.rl.policy import DEFAULT_POLICY

    return [DEFAULT_POLICY.read_bytes()]


def read_policy(path: Path) -> None:
    """Load and try a policy, as the player does."""
    from mrwarp.rl.play_cli import load_policy

    load_policy(str(path))


def network_seeds() -> list[bytes]:
    """A shipped learned torque model."""
    from mrwarp.nn.model_file import shipped_model

    path = shipped_model("mlp")
    assert path is not None
    return [Path(path).read_bytes()]


def read_network(path: Path) -> None:
    """Load a learned torque model."""
    from mrwarp.nn.model_file import load

    load(path)


def dump_seeds() -> list[bytes]:
    """States of a broken environment."""
    from mrwarp.env import dump
    from mrwarp.env.watch import Break, Column

    columns = (Column(quantity="time", part="", unit="s"), Column(quantity="position", part="trunk z", unit="m"))
    bounds = np.array([[-np.inf, -1.0], [np.inf, 1.0]])
    found = Break(
        env=1, column=1, finite=False, columns=columns, states=np.ones((5, 2), dtype=np.float32), bounds=bounds
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "d.safetensors"
        dump.save(found, path, {"update": 1})
        return [path.read_bytes()]


def _read(module: str, name: str) -> Callable[[Path], Any]:
    def read(path: Path) -> Any:
        return getattr(__import__(module, fromlist=[name]), name)(path)

    return read


def _errors(*names: str) -> Callable[[], tuple[type[Exception], ...]]:
    def errors() -> tuple[type[Exception], ...]:
        split = [name.rpartition(".") for name in names]
        return tuple(getattr(__import__(module, fromlist=[name]), name) for module, _, name in split)

    return errors


KINDS = {
    "csv": Kind(".csv", csv_seeds, _read("mrwarp.sysid.recording", "load_recording"),
                _errors("mrwarp.sysid.recording.RecordingError")),
    "parquet": Kind(".parquet", parquet_seeds, _read("mrwarp.sysid.recording", "load_recording"),
                    _errors("mrwarp.sysid.recording.RecordingError")),
    "model": Kind(".json", model_seeds, read_model, _errors("mrwarp.model_file.ModelFileError")),
    "usd": Kind(".usda", usd_seeds, read_usd, _errors("mrwarp.asset.AssetError", "mrwarp.params.ParameterError")),
    "usd-attr": Kind(".usda", usd_seeds, read_usd, _errors("mrwarp.asset.AssetError", "mrwarp.params.ParameterError"),
                     whole=False),
    "checkpoint": Kind(".pt", checkpoint_seeds, _read("mrwarp.rl.checkpoint", "load"),
                       _errors("mrwarp.rl.checkpoint.CheckpointError")),
    "onnx": Kind(".onnx", policy_seeds, read_policy, _errors("mrwarp.rl.policy.PolicyError")),
    "safetensors": Kind(".safetensors", network_seeds, read_network, _errors("mrwarp.nn.model_file.ModelFileError")),
    "dump": Kind(".safetensors", dump_seeds, _read("mrwarp.env.dump", "load"), _errors("mrwarp.env.dump.DumpError")),
}  # fmt: skip
"""All kinds of files; ``cli`` is the command line."""


# --- mutation ---


def mutate(data: bytes, rng: random.Random) -> bytes:
    """One to four changes: bytes, chunks, lines, numbers."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        data = rng.choice(MUTATORS)(data, rng)[: 2**20]
    return data


def _at(data: bytes, rng: random.Random) -> int:
    """A place, more often in the first kilobyte, where headers are."""
    return rng.randrange(min(len(data), 1024) if rng.random() < 0.4 else len(data)) if data else 0


def _flip(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        if out:
            out[_at(data, rng)] = rng.choice((0, 255, 127, 128, 10, 44, 46, 45, rng.randrange(256)))
    return bytes(out)


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: _at(data, rng)] if rng.random() < 0.5 else data[_at(data, rng) :]


def _chunk(data: bytes, rng: random.Random) -> bytes:
    a, size, b = _at(data, rng), rng.choice((1, 2, 4, 8, 64, 500)), _at(data, rng)
    return rng.choice(
        (
            data[:a] + data[a + size :],
            data[:b] + data[a : a + size] + data[b:],
            data[:b] + rng.randbytes(size) + data[b:],
        )
    )


def _lines(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    what = rng.randrange(4)
    if what == 0:
        del lines[a]
    elif what == 1:
        lines.insert(a, lines[b])
    elif what == 2:
        lines[a], lines[b] = lines[b], lines[a]
    else:
        lines[a] = lines[a] * rng.choice((2, 3, 50))
    return b"\n".join(lines)


def _number(data: bytes, rng: random.Random) -> bytes:
    found = list(re.finditer(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?", data[: 2**17]))
    if not found:
        return data
    match = rng.choice(found)
    return data[: match.start()] + rng.choice(NUMBERS).encode() + data[match.end() :]


def _word(data: bytes, rng: random.Random) -> bytes:
    found = list(re.finditer(rb"[A-Za-z_:]{2,}", data[: 2**17]))
    if len(found) < 2:
        return data
    a, b = rng.choice(found), rng.choice(found)
    new = rng.choice(
        (b[0], b"", a[0] + a[0], "ü\u202e😀".encode(), b"\xff\xfe", a[0].upper(), b"../../etc/passwd", b'"')
    )
    return data[: a.start()] + new + data[a.end() :]


def _nest(data: bytes, rng: random.Random) -> bytes:
    a, depth = _at(data, rng), rng.choice((10, 2000, 100_000))
    return data[:a] + rng.choice((b"[", b"{", b'{"a":', b"(")) * depth + data[a:]


def attribute(data: bytes, rng: random.Random) -> bytes:
    """One to three attributes of a USD text get another value or another name; the file stays readable as USD."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        found = list(re.finditer(rb"^\s*(?:uniform |custom )?[\w\[\]]+ ([\w:]+) = (\S.*)$", data, flags=re.MULTILINE))
        match = rng.choice(found)
        other = rng.choice(found)
        value = rng.choice(
            (*(b'-1 0 1e308 nan inf -inf 1e-320 "a" [1,2] () (1,2,3) @a.usd@ </x> None true'.split()), other[2])
        )
        group = 1 if rng.random() < 0.15 else 2
        new = other[1] if group == 1 else value
        data = data[: match.start(group)] + new + data[match.end(group) :]
    return data


MUTATORS = (_flip, _flip, _cut, _chunk, _lines, _number, _number, _number, _word, _nest)


# --- the command line ---


def run_cli(folder: Path, rng: random.Random) -> tuple[str, list[str]]:
    """A random command line that cannot be right, as it names an input that is not there; what it said."""
    from mrwarp import cli

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
    argv += ["--device", "cuda:98", "--out", str(folder / "file" / "x"), "--policy", str(folder / "none.onnx"),
             str(folder / "no data")]  # fmt: skip
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
    from mrwarp import cli

    if command not in _HELPS:
        out = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
            cli.main([command, "--help"])
        _HELPS[command] = out.getvalue()
    return _HELPS[command]


# --- running ---


class HangError(Exception):
    """A case took too long."""


def reason(message: str, path: Path) -> str:
    """A refusal without what differs from case to case: its kind."""
    text = message.replace(str(path), "FILE").replace(str(path.parent), "DIR")
    text = re.sub(r"'[^']*'|\"[^\"]*\"|\([^)]*\)", "'...'", text)
    text = re.sub(r"-?[\d.]+(?:e[-+]?\d+)?|nan|inf|[^\x20-\x7e]+", "#", text)
    return " ".join(text.split())[:110]


def run_batch(kind: str, seed: int, batch: int, cases: int, folder: Path, at: Any = None) -> dict[str, Any]:
    """Run the cases of a batch in this process: counts of refusals by reason, and failures with their input."""
    rng = random.Random(f"{kind}/{seed}/{batch}")
    counts: Counter[str] = Counter()
    failures: list[dict[str, Any]] = []
    spec = KINDS.get(kind)
    corpus = spec.seeds() if spec else []
    errors = spec.refusals() if spec else ()
    path = folder / f"input{spec.suffix if spec else ''}"
    (folder / "file").write_text("a file where a folder is wanted")
    known = {"file", path.name}
    signal.signal(signal.SIGALRM, _hang)
    for case in range(cases):
        if at is not None:
            at.value = case
        data, argv, message, problem = b"", [], "good", ""
        signal.setitimer(signal.ITIMER_REAL, HANG)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                if spec is None:
                    message, argv = run_cli(folder, rng)
                else:
                    data = (mutate if spec.whole else attribute)(rng.choice(corpus), rng)
                    path.write_bytes(data)
                    spec.read(path)
        except errors as error:
            message = str(error)
            if str(folder) not in message or not REMEDY.search(message) or "\n" in message or len(message) > 2000:
                problem = f"refusal without file or remedy, or of several lines: {message[:500]}"
        except Exception:  # what a reader lets escape is the failure that is looked for
            problem = traceback.format_exc(limit=-6)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        left = {file.name for file in folder.iterdir()} - known
        if left:
            problem = problem or f"left behind: {sorted(left)}"
            known |= left
        key = reason(message, path)
        if spec and message != "good" and key not in counts and len(corpus) < 60:
            corpus.append(data)
        counts["FAILED" if problem else key] += 1
        if problem:
            failures.append(
                {"case": case, "problem": problem, "argv": argv, "data": data.hex() if len(data) < 2**20 else ""}
            )
    return {"counts": dict(counts), "failures": failures, "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss}


def _hang(*_: Any) -> None:
    raise HangError(f"longer than {HANG} s")


def _child(kind: str, seed: int, batch: int, cases: int, at: Any, out: Any, said: str) -> None:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)  # USD and MuJoCo write there from C
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        work = Path(folder) / "work"
        work.mkdir()
        out.put(run_batch(kind, seed, batch, cases, work, at))


def isolated(kind: str, seed: int, batch: int, cases: int) -> dict[str, Any]:
    """Run a batch in a process of its own; a crash, a hang in C or a memory blow-up is a failure like others."""
    context = multiprocessing.get_context("fork")
    at, out = context.Value("i", -1), context.SimpleQueue()
    said = tempfile.NamedTemporaryFile(suffix=".txt")
    process = context.Process(target=_child, args=(kind, seed, batch, cases, at, out, said.name))
    process.start()
    last, since = -1, time.monotonic()
    while process.is_alive() and out.empty():
        time.sleep(0.02)
        if at.value != last:
            last, since = at.value, time.monotonic()
        if time.monotonic() - since > 3.0 * HANG:
            process.kill()
            break
    result = out.get() if not out.empty() else None
    process.join()
    if result is None:
        tail = Path(said.name).read_text(errors="replace")[-2000:]
        problem = f"process ended with {process.exitcode} (killed, crashed or hung) in case {at.value}: {tail}"
        result = {"counts": {"FAILED": 1}, "failures": [{"case": at.value, "problem": problem, "argv": [], "data": ""}]}
    return result


def run(kind: str, cases: int, *, seed: int, out: Path, seconds: float) -> dict[str, Any]:
    """Run up to ``cases`` cases of a kind, from where the state file says, for at most ``seconds``; the new state."""
    out.mkdir(parents=True, exist_ok=True)
    file = out / f"{kind}-{seed}.json"
    state: dict[str, Any] = {"kind": kind, "seed": seed, "cases": 0, "batches": 0, "counts": {}, "failures": 0}
    if file.is_file():
        state = json.loads(file.read_text())
    if kind == "cli":  # once, not in every batch
        from mrwarp import cli

        for module, _ in cli.COMMANDS.values():
            __import__(module)
    else:
        with tempfile.TemporaryDirectory() as folder:  # a good file first: its imports are no case's time
            path = Path(folder) / f"input{KINDS[kind].suffix}"
            path.write_bytes(KINDS[kind].seeds()[0])
            with contextlib.suppress(Exception):
                KINDS[kind].read(path)
    end = time.monotonic() + seconds
    while state["cases"] < cases and time.monotonic() < end:
        size = min(BATCH, cases - state["cases"])
        found = isolated(kind, seed, state["batches"], size)
        state["counts"] = dict(Counter(state["counts"]) + Counter(found["counts"]))
        state["cases"], state["batches"] = state["cases"] + size, state["batches"] + 1
        state["peak_mib"] = max(state.get("peak_mib", 0), found.get("peak", 0) // 1024)
        for failure in found["failures"]:
            state["failures"] += 1
            if state["failures"] <= 50:
                (out / "failures").mkdir(exist_ok=True)
                stem = out / "failures" / f"{kind}-{seed}-{state['batches'] - 1}-{failure['case']}"
                stem.with_suffix(".txt").write_text(f"{failure['problem']}\n{failure['argv']}\n")
                stem.with_suffix(".bin").write_bytes(bytes.fromhex(failure["data"]))
        partial = file.with_suffix(".part")
        partial.write_text(json.dumps(state, indent=1))
        partial.replace(file)
        print(
            f"{kind}: {state['cases']} of {cases} cases, {state['failures']} failures, {len(state['counts'])} outcomes",
            flush=True,
        )
    return state


def main(argv: list[str] | None = None) -> int:
    """Fuzz; 0 without failures, 1 with."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kind", choices=[*KINDS, "cli", "all"], default="all", help="what is read (default: all)")
    parser.add_argument("--cases", type=int, default=100_000, help="cases per kind (default: 100000)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the mutations (default: 0)")
    parser.add_argument("--seconds", type=float, default=1e9, help="longest time per kind [s]; goes on when run again")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"), help="state and failures (default: out/fuzz)")
    args = parser.parse_args(argv)
    from mrwarp.quiet import quiet_libraries

    quiet_libraries()
    failed = 0
    for kind in [*KINDS, "cli"] if args.kind == "all" else [args.kind]:
        state = run(kind, args.cases, seed=args.seed, out=args.out.absolute(), seconds=args.seconds)
        failed += state["failures"]
        print(f"\n{kind}: {state['cases']} cases, peak {state.get('peak_mib', 0)} MiB")
        for text, count in sorted(state["counts"].items(), key=lambda item: -item[1])[:25]:
            print(f"  {count:7d}  {text}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
