"""``mrwarp diagnose``: what the simulation gets wrong, why, and what it gains to put that right."""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from mrwarp.diagnose import verdict_text as text
from mrwarp.diagnose.result import Diagnosis
from mrwarp.model_file import JOINT_UNITS, Model, ModelFileError, load_model, save_model
from mrwarp.options.arguments import Parser, averaged, seed
from mrwarp.params import ParameterError
from mrwarp.recording.load import Recording, RecordingError, check_same_units, load_recording
from mrwarp.run_dir import check_writable, one_line
from mrwarp.runtime import quiet_libraries

Told = Callable[[str], None]


def main(argv: list[str] | None = None) -> int:
    """Diagnose; 0 when the report is written, 2 on bad input (then nothing is written), 130 after Ctrl-C (nothing)."""
    argv = sys.argv[1:] if argv is None else argv
    args = _parser().parse_args(argv)
    quiet_libraries()
    started = time.perf_counter()

    def told(line: str) -> None:
        print(f"[{time.perf_counter() - started:5.1f} s] {line}", flush=True)

    try:
        diagnosis, besides, tables = _diagnose(args, told)
        pictures = _draw(diagnosis, told)
        page = _page(diagnosis, argv, tables, pictures)
    except (RecordingError, ModelFileError, ParameterError, _Refused, OSError) as error:
        print(f"mrwarp diagnose: {one_line(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nmrwarp diagnose: stopped; nothing was written", file=sys.stderr)
        return 130
    try:
        with _undisturbed():
            written = _write(diagnosis, args.out, argv, besides, page, pictures)
    except OSError as error:
        print(f"mrwarp diagnose: {one_line(error)}; name another --out", file=sys.stderr)
        return 2
    print(verdict_table(diagnosis, tables))
    print(f"\n{', '.join(written)} in {args.out} ({time.perf_counter() - started:.0f} s)")
    return 0


def verdict_table(d: Diagnosis, tables: Mapping[str, Any] | None = None) -> str:
    """The verdict and a short table as text."""
    lines = ["", d.sentence]
    advice = f"; {d.next_experiment.what}" if d.next_experiment is not None else ""
    lines += [f"  cannot be known: {why.removesuffix(advice)}" for why in d.cannot_know]
    rows = []
    for cause in d.causes:
        for name, value in cause.parameters.items():
            shown = text.readable(value)
            rows.append((f"{cause.name}.{name}", shown.value, shown.interval))
    rows += [
        (f"{s.name} (calibration)", f"{s.value:.5g}", f"{s.ci95[0]:.5g} to {s.ci95[1]:.5g}") for s in d.parameter_shift
    ]
    if rows:
        lines.append(f"\n{'':36s} {'value':>16s}  95 % interval")
        lines += [f"{name:36s} {value:>16s}  {interval}" for name, value, interval in rows]
    for cause in d.causes:
        if cause.alternatives:
            lines.append(f"{cause.name}: these data do not tell it from {', '.join(cause.alternatives)}")
    if d.verdict is not None:
        lines.append(f"\nNRMSE of the baseline {text.percent(d.baseline.nrmse, 2)}" + (
            f", with the extension {text.percent(d.extended.nrmse, 2)}" if d.causes else ""))  # fmt: skip
        if d.gain is not None and d.causes:
            low, high = d.gain.ci95
            lines.append(
                f"RMS mismatch on {len(d.gain.held_out)} trajectories, each predicted without it: "
                f"{100.0 * -d.gain.rmse_reduction:+.1f} % ({100.0 * -high:+.1f} to {100.0 * -low:+.1f} %)"
            )
    if d.next_experiment is not None:
        lines.append(f"next experiment, {d.next_experiment.seconds:.0f} s: {d.next_experiment.what}")
    for name, table in (tables or {}).items():
        lines.append(f"\n{name}: " + " | ".join(table.head))
        lines += ["  " + " | ".join(row) for row in table.rows]
    return "\n".join(lines)


class _Refused(ValueError):
    """An option that cannot be done; the message says why and what to do."""


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="mrwarp diagnose",
        description="Show what the simulation of a measured joint gets wrong, name the cause, extend the model and "
        "measure the gain.",
    )
    add = parser.add_argument
    add("data", type=Path, metavar="DATA", help="recording: a CSV or Parquet file, or a folder of them")
    add("--out", type=Path, default=Path("runs/diagnose"), help="output folder (default: runs/diagnose)")
    add("--model", type=Path, metavar="JSON", help="nominal model.json, against which shifts of calibration count")
    add("--seed", type=seed, default=0, help="seed of everything random (default: 0)")
    add("--predict", type=Path, metavar="DIR", help="recordings that take no part but are predicted")
    average = "moving average [s] that q and torque of --predict passed before they were published (default: 0, none)"
    add("--averaged", type=averaged, default=0.0, metavar="S", help=average)
    add("--impact", action="store_true", help="also show what the extension changes when a walking robot is hit")
    add("--learn", action="store_true", help="also train a residual on top of baseline and extension (minutes)")
    return parser


def _diagnose(args: argparse.Namespace, told: Told) -> tuple[Diagnosis, dict[str, Any], dict[str, Any]]:
    """The diagnosis, what ``result.json`` and what the report holds besides; writes nothing."""
    from mrwarp.diagnose.pipeline import diagnose

    _check_out(args.out, args.model)
    model: Model | None = load_model(args.model) if args.model else None
    told(f"reading {args.data}")
    recording = load_recording(args.data)
    if args.impact and recording.units != JOINT_UNITS:
        raise _Refused(
            f"--impact: {args.data} is in {', '.join(recording.units.values())}, the robot's joint in "
            f"{', '.join(JOINT_UNITS.values())}; leave --impact out"
        )
    unseen = load_recording(args.predict) if args.predict else None
    if unseen is not None:
        check_same_units(unseen, recording)
    diagnosis = diagnose(recording, model=model, seed=args.seed, progress=told, threads=_threads())
    besides: dict[str, Any] = {}
    tables: dict[str, Any] = {}
    if unseen is not None:
        _predict(diagnosis, unseen, args.averaged, besides, tables, told)
    if args.learn:
        _learn(diagnosis, besides, tables, told)
    if args.impact:
        _impact(diagnosis, args.seed, besides, tables, told)
    return diagnosis, besides, tables


def _threads() -> int:
    """CPU threads for the replay: what this process may use, up to 8."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(allowed, 8)


def _check_out(out: Path, model: Path | None) -> None:
    """Refuse before minutes of work what could not be written after them."""
    if out.exists() and not out.is_dir():
        raise _Refused(f"--out {out}: is a file; name a folder")
    check_writable(out)
    if model is not None and model.exists() and (out / "model.json").exists() and model.samefile(out / "model.json"):
        raise _Refused(
            f"--out {out}: its model.json is the nominal model and would be overwritten; name another folder"
        )


def _predict(
    d: Diagnosis, unseen: Recording, averaged: float, besides: dict[str, Any], tables: dict[str, Any], told: Told
) -> None:
    from mrwarp.diagnose.predicted import predicted_errors, summary
    from mrwarp.diagnose.report.diagnosis_page import Table

    if d.verdict is None:
        told("no verdict: nothing is predicted")
        return
    found = predicted_errors(d, unseen, averaged=averaged, progress=told)
    means = summary(found)
    besides["predicted"] = {"source": unseen.source, "averaged": averaged, "nrmse": found, "mean": means}
    rows = [
        (name or "all", text.percent(m["baseline"], 2), text.percent(m["extended"], 2),
         f"{m['better']} of {m['trajectories']} trajectories")
        for name, m in means.items()
    ]  # fmt: skip
    tables["predicted"] = Table(head=("Mean NRMSE", "Baseline", "With the extension", "Better in"), rows=rows)


def _learn(d: Diagnosis, besides: dict[str, Any], tables: dict[str, Any], told: Told) -> None:
    from mrwarp.diagnose.learned_remainder import left_to_learn
    from mrwarp.diagnose.report.diagnosis_page import Table

    if not d.causes:
        told("no named cause: the learned model has as much left to do as before")
        return
    found = left_to_learn(d, progress=told)
    besides["learned"] = found.to_dict()
    unit = d.baseline.unit
    rows = [
        (name, text.measured(a, unit), text.measured(b, unit), f"{100.0 * (b / a - 1.0):+.0f} %")
        for name, (a, b) in (
            ("RMS of what it has to add, all trajectories", found.target),
            (f"RMSE without it, on {len(found.held_out)} trajectories it was not trained on", found.physical),
            ("RMSE with it, on the same", found.with_learned),
        )
    ]
    tables["learned"] = Table(head=("", "On the baseline", "On the extension", "Change"), rows=rows)


def _impact(d: Diagnosis, seed: int, besides: dict[str, Any], tables: dict[str, Any], told: Told) -> None:
    """Hit the robot with the joint as the baseline has it, and as the extension has it."""
    from mrwarp.diagnose.report.diagnosis_page import Table
    from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy
    from mrwarp.trials.extended_impact import FIGURES, impact_change

    if d.model is None or not d.causes:
        told("no extension: the robot is what it was")
        return
    found = impact_change(d.baseline_model, d.model, OnnxPolicy(DEFAULT_POLICY), seed=seed, progress=told)
    besides["impact"] = found.to_dict()
    rows = []
    for row in found.rows:
        for name, (words, unit) in FIGURES.items():
            figure, factor = row.figures[name], 100.0 if unit == "1" else 1.0
            unit = "%" if unit == "1" else unit
            low, high = (factor * x for x in figure.ci95)
            rows.append((
                f"{row.current:g} A, {words}", f"{factor * figure.before:.4g} {unit}",
                f"{factor * figure.after:.4g} {unit}", f"{low:+.2g} to {high:+.2g} {unit}",
            ))  # fmt: skip
    head = ("Impact on the walking robot", "Baseline", "With the extension", "Change, 95 %")
    tables["impact"] = Table(head=head, rows=rows)


def _draw(d: Diagnosis, told: Told) -> dict[str, bytes]:
    from mrwarp.diagnose.report.overview_pictures import draw

    told("pictures")
    return draw(d)


def _command(argv: list[str]) -> str:
    return "mrwarp diagnose " + shlex.join(argv)


def _page(d: Diagnosis, argv: list[str], tables: Mapping[str, Any], pictures: Mapping[str, bytes]) -> str:
    from mrwarp.diagnose.report.diagnosis_page import render

    return render(d, _command(argv), **tables, pictures=pictures)


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Leave Ctrl-C unheard for the fraction of a second in which files are written: all of them or none."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _write(
    d: Diagnosis, out: Path, argv: list[str], besides: Mapping[str, Any], page: str, pictures: Mapping[str, bytes]
) -> list[str]:
    """Write all files, each in one piece and ``result.json`` last; returns their names."""
    from mrwarp.diagnose.report.diagnosis_page import write_page
    from mrwarp.diagnose.report.overview_pictures import NAMES

    folder = out / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    for name in NAMES:  # those of an earlier diagnosis would be taken for this one's
        (folder / f"{name}.png").unlink(missing_ok=True)
    for name, data in pictures.items():
        (folder / f"{name}.png").write_bytes(data)
    names = ["result.json", "report.html"]
    if d.model is not None:
        save_model(d.model, out / "model.json")
        names.append("model.json")
    write_page(page, out)
    d.write(out, _command(argv), besides, model_name="model.json" if d.model is not None else "")
    return [*names, f"pictures/ ({len(pictures)} PNG)"]
