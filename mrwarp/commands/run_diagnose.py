"""``mrwarp diagnose``: what the simulation gets wrong, why, and what it gains to put that right."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from mrwarp.diagnose import verdict_text as text
from mrwarp.diagnose.countdown import Countdown
from mrwarp.diagnose.held_out import predicted_errors, summary
from mrwarp.diagnose.pipeline import diagnose
from mrwarp.diagnose.report.diagnosis_page import Table, render
from mrwarp.diagnose.report.overview_pictures import NAMES, draw
from mrwarp.diagnose.result import Diagnosis
from mrwarp.identify.fit import read_holding
from mrwarp.identify.learn import left_to_learn
from mrwarp.model_file import HOLDING_NOTE, JOINT_UNITS, load_model, save_model
from mrwarp.options.command_line import CommandLine
from mrwarp.options.data_options import Diagnose
from mrwarp.recording.load import Recording, check_same_units, load_recording
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy
from mrwarp.run_dir import check_writable, write_text
from mrwarp.trials.impact_figures import EFFECT_FIGURES, impact_change

Progress = Callable[[str], None]


def run(options: Diagnose, line: CommandLine) -> int:
    """Diagnose; 0 when the report is written, 2 on bad input (then nothing is written), 130 after Ctrl-C (nothing)."""
    started = time.perf_counter()

    def progress(said: str) -> None:
        print(f"[{time.perf_counter() - started:5.1f} s] {said}", flush=True)

    try:
        with Countdown(progress) as log:
            diagnosis, besides, tables = _diagnose(options, log)
            log("pictures")
            pictures = draw(diagnosis)
            page = render(diagnosis, str(line), **tables, pictures=pictures)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("nothing was written") from None
    with _undisturbed():
        written = _write(diagnosis, options.out, line, besides, page, pictures)
    print(verdict_table(diagnosis, tables))
    print(f"\n{', '.join(written)} in {options.out} ({time.perf_counter() - started:.0f} s)")
    return 0


def verdict_table(d: Diagnosis, tables: Mapping[str, Any] | None = None) -> str:
    """The verdict and a short table as text."""
    lines = ["", d.sentence]
    advice = f"; {d.next_experiment.what}" if d.next_experiment is not None else ""
    unsaid = [why for why in d.cannot_know if why not in d.sentence]
    lines += [f"  cannot be known: {why.removesuffix(advice)}" for why in unsaid]
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
        lines.append(f"\nRMS error, each of {len(d.per_trajectory)} trajectories predicted by a fit to the others")
        unit = d.baseline.unit
        lines.append(f"{'baseline':36s} {text.measured(d.baseline.rmse, unit):>16s}  NRMSE {d.baseline.nrmse:.2%}")
        if d.gain is not None:
            after, (low, high) = text.measured(d.extended.rmse, unit), d.gain.ci95
            lines.append(f"{'with the extension':36s} {after:>16s}  NRMSE {d.extended.nrmse:.2%}")
            change, least, most = (f"{-100.0 * x:+.1f}" for x in (d.gain.rmse_reduction, low, high))
            lines.append(f"{'change':36s} {change + ' %':>16s}  {most} to {least} %")
    if d.next_experiment is not None:
        lines.append(f"next experiment, {d.next_experiment.seconds:.0f} s: {d.next_experiment.what}")
    for name, table in (tables or {}).items():
        lines.append(f"\n{name}: " + " | ".join(table.head))
        lines += ["  " + " | ".join(row) for row in table.rows]
    return "\n".join(lines)


def _diagnose(options: Diagnose, progress: Progress) -> tuple[Diagnosis, dict[str, Any], dict[str, Table]]:
    """The diagnosis, what ``result.json`` and what the report holds besides; writes nothing."""
    _check_out(options.out, options.model)
    model = load_model(options.model) if options.model else None
    progress(f"reading {options.data}")
    recording = load_recording(options.data)
    if options.impact and recording.units != JOINT_UNITS:
        raise ValueError(
            f"--impact: {options.data} is in {', '.join(recording.units.values())}, the robot's joint in "
            f"{', '.join(JOINT_UNITS.values())}; leave --impact out"
        )
    unseen = load_recording(options.predict) if options.predict else None
    if unseen is not None:
        check_same_units(unseen, recording)
    holding = read_holding(options.data, recording, None, progress)
    if holding is None and (model is None or not model.holding_measured):
        progress(HOLDING_NOTE)
    diagnosis = diagnose(
        recording, model=model, holding=holding, seed=options.seed, progress=progress, threads=_threads()
    )
    besides: dict[str, Any] = {}
    tables: dict[str, Table] = {}
    if unseen is not None:
        _predict(diagnosis, unseen, options.averaged, besides, tables, progress)
    if options.learn:
        _learn(diagnosis, besides, tables, progress)
    if options.impact:
        _impact(diagnosis, options.seed, besides, tables, progress)
    return diagnosis, besides, tables


def _threads() -> int:
    """CPU threads for the replay: what this process may use, up to 8."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(allowed, 8)


def _check_out(out: Path, model: Path | None) -> None:
    """Refuse before minutes of work what could not be written after them."""
    if out.exists() and not out.is_dir():
        raise ValueError(f"--out {out}: is a file; name a folder")
    check_writable(out)
    if model is not None and model.exists() and (out / "model.json").exists() and model.samefile(out / "model.json"):
        raise ValueError(
            f"--out {out}: its model.json is the nominal model and would be overwritten; name another folder"
        )


def _predict(
    d: Diagnosis,
    unseen: Recording,
    averaged: float,
    besides: dict[str, Any],
    tables: dict[str, Table],
    progress: Progress,
) -> None:
    if d.predictor is None:
        progress("no verdict: nothing is predicted")
        return
    found = predicted_errors(d.predictor, unseen, averaged=averaged, log=progress)
    means = summary(found)
    besides["predicted"] = {"source": unseen.source, "averaged": averaged, "nrmse": found, "mean": means}
    rows = [
        (name or "all", text.percent(m["baseline"], 2), text.percent(m["extended"], 2),
         f"{m['better']} of {m['trajectories']} trajectories")
        for name, m in means.items()
    ]  # fmt: skip
    tables["predicted"] = Table(head=("Mean NRMSE", "Baseline", "With the extension", "Better in"), rows=rows)


def _learn(d: Diagnosis, besides: dict[str, Any], tables: dict[str, Table], progress: Progress) -> None:
    if not d.causes or d.traces is None:
        progress("no named cause: the learned model has as much left to do as before")
        return
    models = ([torque[part] for part in d.traces.parts] for torque in (d.traces.baseline, d.traces.extended))
    found = besides["learned"] = left_to_learn(d.recording, *models, progress=progress)
    unit = d.baseline.unit
    rows = [
        (name, text.measured(a, unit), text.measured(b, unit), f"{100.0 * (b / a - 1.0):+.0f} %")
        for name, (a, b) in (
            ("RMS of what it has to add, all trajectories", found["target"]),
            (f"RMSE without it, on {len(found['held_out'])} trajectories it was not trained on", found["physical"]),
            ("RMSE with it, on the same", found["with_learned"]),
        )
    ]
    tables["learned"] = Table(head=("", "On the baseline", "On the extension", "Change"), rows=rows)


def _impact(d: Diagnosis, seed: int, besides: dict[str, Any], tables: dict[str, Table], progress: Progress) -> None:
    """Hit the robot with the joint as the baseline has it, and as the extension has it."""
    if d.model is None or not d.causes:
        progress("no extension: the robot is what it was")
        return
    found = impact_change(d.baseline_model, d.model, OnnxPolicy(DEFAULT_POLICY), seed=seed, progress=progress)
    besides["impact"] = found.to_dict()
    rows = []
    for current, figures in found.rows.items():
        for name, (words, unit) in EFFECT_FIGURES.items():
            figure, factor = figures[name], 100.0 if unit == "1" else 1.0
            unit = "%" if unit == "1" else unit
            low, high = (factor * x for x in figure.ci95)
            rows.append((
                f"{current:g} A, {words}", f"{factor * figure.before:.4g} {unit}",
                f"{factor * figure.after:.4g} {unit}", f"{low:+.2g} to {high:+.2g} {unit}",
            ))  # fmt: skip
    head = ("Impact on the walking robot", "Baseline", "With the extension", "Change, 95 %")
    tables["impact"] = Table(head=head, rows=rows)


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
    d: Diagnosis, out: Path, line: CommandLine, besides: Mapping[str, Any], page: str, pictures: Mapping[str, bytes]
) -> list[str]:
    """Write all files, each atomically and ``result.json`` last; returns their names."""
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
    write_text(out / "report.html", page)
    d.write(out, str(line), besides, model_name="model.json" if d.model is not None else "")
    return [*names, f"pictures/ ({len(pictures)} PNG)"]
