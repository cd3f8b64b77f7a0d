"""Run a family of cases through the diagnosis: one JSON line per case, resumable, several processes."""

from __future__ import annotations

import json
import os
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.confusion.effects import CALIBRATION
from benchmarks.confusion.families import Plan
from benchmarks.confusion.verdicts import coverage, judge, record_of

Diagnose = Callable[..., Any]
"""``diagnose(recording, seed=...)`` -> result."""

CASES = "cases.jsonl"
"""File of the cases, in the output folder."""

SETTINGS = "settings.json"
"""File of the plan, in the output folder."""

_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


class SuiteError(ValueError):
    """A suite cannot be run as asked; the message says why."""


def run_case(
    plan: Plan,
    index: int,
    *,
    known: bool = False,
    method: str = "proof",
    diagnose: Diagnose | None = None,
) -> dict[str, Any]:
    """Make a case, diagnose it and judge the result; what the diagnosis raises is recorded, not passed on.

    Args:
        plan: The suite.
        index: Which case.
        known: Only the hidden effects may be named: asks for their sizes and intervals, in a quarter of the time.
        method: How causes are searched.
        diagnose: The diagnosis; None takes ``mrwarp.diagnose.pipeline``.
    """
    if diagnose is None:
        diagnose = import_module("mrwarp.diagnose").diagnose
    begin = time.perf_counter()
    case = plan.make(index)
    truth, recording = case.truth, case.recording
    out: dict[str, Any] = {
        "index": index,
        **{key: value for key, value in plan.arguments(index).items() if key not in ("kind", "background")},
        "kinds": list(truth.kinds),
        "background": list(truth.background),
        "level": case.level,
        "parameters": {k: {**v, "draws": dict(v["draws"])} for k, v in truth.parameters.items()},
        "noise_share": case.noise_share,
        "making": time.perf_counter() - begin,
    }
    begin, cpu = time.perf_counter(), time.process_time()
    try:
        assert diagnose is not None
        result = diagnose(recording, seed=case.seed, **_how(truth.kinds if known else None, method))
        found = record_of(result)
    except Exception as error:  # a failure is an outcome of the benchmark; the line says where
        where = traceback.format_exc(limit=-3)
        return {**out, "outcome": "failed", "remark": f"{type(error).__name__}: {error}", "traceback": where}
    out["wall"], out["cpu"] = time.perf_counter() - begin, time.process_time() - cpu
    calibration = any(kind in CALIBRATION for kind in truth.kinds)
    outcome, remark = judge(truth, calibration, found)
    out |= {**found, "outcome": outcome, "remark": remark, "coverage": coverage(truth, found)}
    return out


def _how(effects: Sequence[str] | None, method: str) -> dict[str, Any]:
    """Further arguments of the diagnosis, but for its defaults."""
    return {
        **({} if effects is None else {"effects": tuple(effects)}),
        **({"method": method} if method != "proof" else {}),
    }


def run_suite(
    plan: Plan,
    sets: int,
    out: str | Path,
    *,
    jobs: int = 1,
    known: bool = False,
    method: str = "proof",
    diagnose: Diagnose | None = None,
    report: Callable[[str], None] = print,
) -> list[dict[str, Any]]:
    """Run the cases 0 to ``sets`` - 1 that are not in ``out`` yet, and return all of them in order.

    Args:
        plan: The suite.
        sets: Number of cases.
        out: Folder of ``cases.jsonl``; made if needed.
        jobs: Processes, each with one thread; 0 runs in this process.
        known: As in :func:`run_case`.
        method: As in :func:`run_case`.
        diagnose: As in :func:`run_case`; must be importable by name where ``jobs`` > 0.
        report: Takes the lines of progress.

    Raises:
        SuiteError: the folder holds another suite.
    """
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    settings = json.loads(json.dumps(asdict(plan)))
    if known:
        settings["known"] = True
    if method != "proof":
        settings["method"] = method
    file = out / SETTINGS
    if file.exists() and json.loads(file.read_text(encoding="utf-8")) != settings:
        raise SuiteError(f"{out} holds another suite ({file.name} differs); choose another folder")
    file.write_text(json.dumps(settings, indent=1) + "\n", encoding="utf-8")
    done = {case["index"]: case for case in read_cases(out)}
    left = [index for index in range(sets) if index not in done]
    with (out / CASES).open("a", encoding="utf-8") as stream:
        how = {"known": known, "method": method, "diagnose": diagnose}
        for case in _cases(plan, left, jobs, how):
            stream.write(json.dumps(case, default=_plain, ensure_ascii=False) + "\n")
            stream.flush()
            done[case["index"]] = case
            report(f"[{len(done)}/{sets}] {_line(case)}")
    return [done[index] for index in sorted(done) if index < sets]


def read_cases(out: str | Path) -> list[dict[str, Any]]:
    """The cases of a folder; a last line that was cut off is left out and removed from the file."""
    file = Path(out) / CASES
    if not file.exists():
        return []
    text = file.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        file.write_text(whole, encoding="utf-8")
    return [json.loads(line) for line in whole.splitlines()]


def _cases(plan: Plan, left: list[int], jobs: int, how: dict[str, Any]) -> Iterator[dict[str, Any]]:
    if jobs <= 0:
        for index in left:
            yield run_case(plan, index, **how)
        return
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # what is spawned reads it before NumPy is imported
    try:
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_quiet) as pool:
            waiting = [pool.submit(run_case, plan, k, **how) for k in left]
            try:
                for future in as_completed(waiting):
                    yield future.result()
            finally:  # an interrupt does not wait for what has not begun
                pool.shutdown(cancel_futures=True)
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _quiet() -> None:
    from mrwarp.runtime import quiet_libraries

    quiet_libraries(gpu=False)


def _plain(value: Any) -> Any:
    """NumPy values for JSON."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def _line(case: dict[str, Any]) -> str:
    truth = "+".join([*case["kinds"], *case["background"]]) or "none"
    names = "+".join("|".join([c["name"], *c["alternatives"]]) for c in case.get("causes", []))
    found = f"{case.get('verdict')} {names}".strip()
    remark = f" ({case['remark']})" if case["remark"] else ""
    return f"#{case['index']} {truth} -> {found}: {case['outcome']}{remark}, {case.get('wall', 0.0):.1f} s"
