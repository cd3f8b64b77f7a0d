"""``mrwarp diagnose``: what the simulation gets wrong, why, and what it gains to put that right."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from mrwarp.commands.run_fit import Averaged
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.run_dir import check_writable, write_bytes, write_text
from mrwarp.runtime import core_count, quiet_libraries, text_table

if TYPE_CHECKING:
    from mrwarp.diagnose.report.diagnosis_page import Table
    from mrwarp.diagnose.result import Diagnosis
    from mrwarp.model_file import Model
    from mrwarp.recording.data import Recording
    from mrwarp.robot_logs.robot_verdict import RobotDiagnosis


@dataclass(frozen=True, kw_only=True)
class Diagnose(opt.LogOptions):
    """Show what the simulation of a measured joint gets wrong, name the cause, extend the model, measure the gain."""

    engines = False  # before the data are read
    data: opt.Data
    """recording: a CSV or Parquet file, or a folder of them; or a robot's log: a folder with log.json, a bag, a data
    set of LeRobot, a .pt of PACE, a CSV of Isaac Sim's system identification"""
    out: opt.Folder = Path("runs/diagnose")
    """output folder"""
    robot: Annotated[str | None, opt.one(str, "ROBOT")] = None
    """of a robot's log: its description, MJCF, URDF or USD (default: the file that log.json names, next to it)"""
    device: str = "cpu"
    """of a robot's log: cpu, or a GPU such as cuda:0, on which its pieces are replayed"""
    policy: opt.OptionalFile = None
    """of a robot's log: also show what the verdict changes when this policy walks (falls, tracking, power)"""
    model: opt.OptionalFile = None
    """nominal model.json, or a device of 'mrwarp device list', against which shifts of calibration count"""
    skip_bad: opt.Flag = False
    """leave out files of a folder that cannot be used, by name"""
    seed: opt.Seed = 0
    """seed of everything random"""
    predict: opt.OptionalFolder = None
    """recordings that take no part but are predicted"""
    averaged: Averaged = 0.0
    """moving average [s] that q and torque of --predict passed before they were published; 0 is none"""
    impact: opt.Flag = False
    """also show what the extension changes when a walking robot is hit"""
    quick: opt.Flag = False
    """stop at the first answer, within seconds: result.json with "final": false and the likeliest causes under
    "suspects"; nothing is checked, no model, no report (exit code 0)"""
    learn: opt.Flag = False
    """also train a residual on top of baseline and extension (minutes)"""

    live: Annotated[opt.Flag, opt.VIEW] = False
    """of a robot's log: show the logged robot next to the extended simulation in rerun's window"""
    rrd: Annotated[opt.OptionalFile, opt.VIEW] = None
    """save that view as a recording"""

    def run(self, line: CommandLine) -> int:
        """0 when the report is written, 2 on bad input, 130 after Ctrl-C; the first answer is written at once.

        With ``--quick`` 0 when that is written.
        """
        self._check_quick()
        self._check_out()
        from mrwarp.robot_logs.robot_log import is_robot_log

        if self.robot is not None or is_robot_log(self.data):
            return self._diagnose_robot(line)
        own = {
            "--live": self.live,
            "--rrd": self.rrd,
            "--policy": self.policy,
            "--device": self.device != "cpu",
            "--map": self.map,
            "--units": self.units,
        }
        if option := next((name for name, given in own.items() if given), ""):
            raise ValueError(f"{option}: {self.data} is the recording of a joint, no robot's log; leave it out")

        progress = ProgressBar()
        try:
            given = self._read(progress)
            quiet_libraries(gpu=False, networks=self.learn or self.impact)
            from mrwarp.diagnose.report.countdown import Countdown
            from mrwarp.diagnose.report.diagnosis_page import render
            from mrwarp.diagnose.report.overview_pictures import draw
            from mrwarp.diagnose.report.printed import lines

            written: list[str] = []
            with progress:
                log = Countdown(progress)
                diagnosis = self._diagnose(*given, log, lambda early: self._answered(early, line, written))
                if not diagnosis.final:
                    progress.done()
                    return self._said_early(lines(diagnosis, {}), progress.seconds)
                with _undisturbed():
                    written = self._write(diagnosis, line, {})
                extras, tables = self._extras(diagnosis, given[1], log)
                model_name = "model.json" if diagnosis.model is not None else ""
                if extras:
                    diagnosis.write(self.out, str(line), extras, model_name=model_name)
                log("pictures")
                pictures, notes = draw(diagnosis)
                for note in notes:
                    log(note)
                diagnosis = replace(diagnosis, notes=(*diagnosis.notes, *notes))
                page = render(diagnosis, str(line), **tables, pictures=pictures)
        except KeyboardInterrupt:
            left = f"only {' and '.join(written)} in {self.out}" if written else "nothing"
            raise KeyboardInterrupt(f"{left} was written") from None
        with _undisturbed():
            for name, data in pictures.items():
                write_bytes(self.out / "pictures" / f"{name}.png", data)
            write_text(self.out / "report.html", page)
            if notes:
                diagnosis.write(self.out, str(line), extras, model_name=model_name)
        print("\n".join(lines(diagnosis, tables)))
        written += ["report.html", f"pictures/ ({len(pictures)} PNG)"]
        print(f"\n{', '.join(written)} in {self.out} ({progress.seconds:.0f} s)")
        return 0

    def _diagnose_robot(self, line: CommandLine) -> int:
        """Results for a robot's log."""
        quiet_libraries(gpu=self.device != "cpu")
        from mrwarp.robot_logs.extended_robot import write_extended
        from mrwarp.robot_logs.forms.open_log import open_log
        from mrwarp.robot_logs.report import log_page, log_pictures
        from mrwarp.robot_logs.report.compared_replays import compare
        from mrwarp.robot_logs.report.log_view import log_view
        from mrwarp.robot_logs.report.walk_change import HEAD, check_walker, walk_change
        from mrwarp.robot_logs.robot_diagnosis import diagnose_log, robot_of
        from mrwarp.robot_logs.robot_verdict import lines
        from mrwarp.run_dir import check_output
        from mrwarp.viewing.live_view import disconnect, open_sink
        from mrwarp.viewing.viewer import check_viewer

        for name, given in (
            ("--model", self.model),
            ("--predict", self.predict),
            ("--impact", self.impact or None),
            ("--learn", self.learn or None),
        ):
            if given is not None:
                raise ValueError(f"{name} is for the recording of a joint; {self.data} is a robot's log: leave it out")
        check_output(self.rrd, ".rrd")
        if self.live:
            check_viewer()
        progress, written = ProgressBar(), list[str]()
        try:
            progress(f"reading {self.data}")
            log = open_log(self.data, skip_bad=self.skip_bad, **self.said)
            robot = robot_of(log, self.robot)
            if self.policy is not None:
                check_walker(self.policy, robot, log.base)
            d = diagnose_log(
                robot,
                log,
                device=self.device,
                progress=progress,
                answered=lambda early: self._answered_robot(early, line, written),
            )
            if not d.final:
                progress.done()
                return self._said_early(lines(d), progress.seconds)
            walked = None
            if self.policy is not None and d.causes:
                walked = walk_change(d, self.policy, seed=self.seed, progress=progress)
            elif self.policy is not None:
                progress("note: no extension: the robot is what it was")
            extras = {"walk": vars(walked)} if walked else {}
            with _undisturbed():
                self._clear(log_pictures.NAMES)
                names, notes = write_extended(d, self.out)
                d = replace(d, notes=(*d.notes, *notes))
                d.write(self.out, str(line), extras, seed=self.seed, model_name="model.json")
                written = ["result.json", *names]
            progress("pictures")
            compared = compare(d)
            pictures, notes = log_pictures.draw(d, compared)
            for note in notes:
                progress(note)
            d = replace(d, notes=(*d.notes, *notes))
            page = log_page.render(d, pictures, str(line), walked)
            sink = open_sink(rrd=self.rrd) if self.live or self.rrd is not None else None
            if sink is not None:
                log_view(d, compared, sink.recording)
                disconnect(sink.recording)
        except KeyboardInterrupt:
            left = f"only {' and '.join(written)} in {self.out}" if written else "nothing"
            raise KeyboardInterrupt(f"{left} was written") from None
        with _undisturbed():
            for name, data in pictures.items():
                write_bytes(self.out / "pictures" / f"{name}.png", data)
            write_text(self.out / "report.html", page)
            if notes:
                d.write(self.out, str(line), extras, seed=self.seed, model_name="model.json")
        progress.done()
        print("\n".join(lines(d)))
        if walked:
            print("\n".join(("", "as described → extended", *text_table(HEAD, walked.rows()))))
        print(f"\nresult.json, report.html, pictures/, {', '.join(names)} in {self.out} ({progress.seconds:.0f} s)")
        if self.rrd is not None:
            print(f"recording: {self.rrd}; open it with: rerun {self.rrd}")
        return 0

    def _check_quick(self) -> None:
        """Refuse with ``--quick`` what needs a verdict."""
        later = {
            "--predict": self.predict,
            "--impact": self.impact,
            "--learn": self.learn,
            "--policy": self.policy,
            "--live": self.live,
            "--rrd": self.rrd,
        }
        if self.quick and (option := next((name for name, given in later.items() if given), "")):
            raise ValueError(f"{option}: needs a verdict, and --quick stops before it; leave one of them out")

    def _answered(self, early: Diagnosis, line: CommandLine, written: list[str]) -> bool:
        """Write the first answer, and name it in ``written``; whether the diagnosis is to go on."""
        with _undisturbed():
            self._write(early, line, {})
            written[:] = [_EARLY]
        return not self.quick

    def _answered_robot(self, early: RobotDiagnosis, line: CommandLine, written: list[str]) -> bool:
        """First answer of a robot's log."""
        from mrwarp.robot_logs.extended_robot import WRITTEN
        from mrwarp.robot_logs.report.log_pictures import NAMES

        with _undisturbed():
            self._clear(NAMES, [name for name in WRITTEN if not _same_file(self.out / name, early.model.path)])
            early.write(self.out, str(line), seed=self.seed)
            written[:] = [_EARLY]
        return not self.quick

    def _said_early(self, said: Iterable[str], seconds: float) -> int:
        """Print a first answer that ends a run, and where it is; the exit code."""
        print("\n".join(said))
        print(f"\n{_EARLY} in {self.out} ({seconds:.0f} s); without --quick it is checked")
        return 0

    def _check_out(self) -> None:
        """Refuse before minutes of work what could not be written after them."""
        check_writable(self.out)
        model, own = self.model, self.out / "model.json"
        if model is not None and model.exists() and own.exists() and model.samefile(own):
            raise ValueError(
                f"--out {self.out}: its model.json is the nominal model and would be overwritten; name another folder"
            )

    def _read(self, progress: Callable[[str], None]) -> tuple[Recording, Recording | None, Model | None]:
        """The recording, the one to predict and the nominal model, checked against each other."""
        from mrwarp.recording.load import check_same_units, load_recording

        progress(f"reading {self.data}")
        recording = load_recording(self.data, skip_bad=self.skip_bad)

        from mrwarp.model_file import JOINT_UNITS, load_model

        model = load_model(self.model) if self.model else None
        for text in recording.repaired():
            progress(f"note: {text}")
        if self.impact and recording.units != JOINT_UNITS:
            theirs, ours = (", ".join(units.values()) for units in (recording.units, JOINT_UNITS))
            raise ValueError(f"--impact: {self.data} is in {theirs}, the robot's joint in {ours}; leave --impact out")
        unseen = load_recording(self.predict, skip_bad=self.skip_bad) if self.predict else None
        if unseen is not None:
            check_same_units(unseen, recording)
        return recording, unseen, model

    def _diagnose(
        self,
        recording: Recording,
        _: Recording | None,
        model: Model | None,
        progress: Callable[[str], None],
        answered: Callable[[Diagnosis], bool],
    ) -> Diagnosis:
        from mrwarp.diagnose.pipeline import diagnose
        from mrwarp.identify.fit import read_holding
        from mrwarp.model_file import HOLDING_NOTE

        holding = read_holding(self.data, recording, None, progress)
        if holding is None and (model is None or not model.holding_measured):
            progress(HOLDING_NOTE)
        return diagnose(
            recording,
            model=model,
            holding=holding,
            seed=self.seed,
            progress=progress,
            answered=answered,
            threads=min(core_count(), 8),
        )

    def _extras(
        self, d: Diagnosis, unseen: Recording | None, progress: Callable[[str], None]
    ) -> tuple[dict[str, Any], dict[str, Table]]:
        """Content of ``result.json`` and of the report in addition to the verdict."""
        from mrwarp.diagnose.held_out import predicted_errors, summary
        from mrwarp.diagnose.report import printed

        extras: dict[str, Any] = {}
        tables: dict[str, Table] = {}
        if unseen is not None and d.predictor is None:
            progress("note: no verdict: nothing is predicted")
        elif unseen is not None and d.predictor is not None:
            errors = predicted_errors(d.predictor, unseen, averaged=self.averaged, log=progress)
            means = summary(errors)
            source = {"source": unseen.source, "averaged": self.averaged}
            extras["predicted"] = {**source, "nrmse": errors, "mean": means}
            tables["predicted"] = printed.predicted_table(means)
        if self.learn and (d.traces is None or not (d.causes or (d.account is not None and d.account.open))):
            progress("note: no named cause, and nothing that repeats without one: there is nothing to learn")
        elif self.learn and d.traces is not None:
            from mrwarp.identify.learn import left_to_learn

            models = ([torque[part] for part in d.traces.parts] for torque in (d.traces.baseline, d.traces.extended))
            extras["learned"] = left_to_learn(d.recording, *models, progress=progress)
            tables["learned"] = printed.learned_table(extras["learned"], d.baseline.unit)
        if self.impact and (d.model is None or not d.causes):
            progress("note: no extension: the robot is what it was")
        elif self.impact and d.model is not None:
            from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy
            from mrwarp.trials.impact_figures import EFFECT_FIGURES, impact_change

            policy = OnnxPolicy(DEFAULT_POLICY)
            change = impact_change(d.baseline_model, d.model, policy, seed=self.seed, progress=progress)
            extras["impact"], tables["impact"] = change, printed.impact_table(change, EFFECT_FIGURES)
        return extras, tables

    def _write(self, d: Diagnosis, line: CommandLine, extras: Mapping[str, Any]) -> list[str]:
        """Write what was found, each file atomically and ``result.json`` last; returns their names."""
        from mrwarp.diagnose.report.overview_pictures import NAMES
        from mrwarp.model_file import save_model

        self._clear(NAMES, () if d.model is not None else ("model.json",))
        names = ["result.json"]
        if d.model is not None:
            save_model(d.model, self.out / "model.json")
            names.append("model.json")
        d.write(self.out, str(line), extras, model_name="model.json" if d.model is not None else "")
        return names

    def _clear(self, pictures: Iterable[str], models: Iterable[str] = ()) -> None:
        """Remove page, pictures and ``models`` of an earlier diagnosis, which would be taken for this one's."""
        drawn = (f"pictures/{name}.png" for name in pictures)
        for path in (self.out / name for name in ("report.html", *drawn, *models)):
            path.unlink(missing_ok=True)


_EARLY = "result.json (not final)"
"""How a first answer is named where it is all that was written."""


def _same_file(a: Path, b: Path) -> bool:
    return a.exists() and b.exists() and a.samefile(b)


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
