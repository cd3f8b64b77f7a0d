"""``mrwarp check``, ``fit``, ``learn`` and ``monitor``: recordings explained, and models that are made from them."""

from __future__ import annotations

import fnmatch
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from mrwarp.enums import BENCH_PARTS, HYSTERESIS_LAWS, LEARNED
from mrwarp.identify.checks.limits import Limits
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.run_dir import check_writable, write_result
from mrwarp.runtime import drawing, quiet_libraries

if TYPE_CHECKING:
    from mrwarp.recording.load import Recording

Averaged = Annotated[float, opt.one(opt.within(0.0, 60.0, "s"), "S")]


@dataclass(frozen=True, kw_only=True)
class Check(opt.LogOptions):
    """Explain a recording; 0 when it is good to use, 2 when it is refused."""

    engines = False
    data: opt.Data
    """CSV, Parquet, .mat, .npz or .xlsx file, or a folder of them; or a robot's log: a folder with log.json, a bag, a
    data set of LeRobot, a .pt of PACE, a CSV of Isaac Sim's system identification"""
    skip_bad: opt.Flag = False
    """leave out files of a folder that cannot be used, by name"""

    def run(self, line: CommandLine) -> int:
        """0 when it is good to use; a RecordingError says what is wrong with it."""
        from mrwarp.diagnose.data_checks import no_verdict_reasons
        from mrwarp.identify.contradictions import contradictions, forewarning
        from mrwarp.recording.description import describe, notes
        from mrwarp.recording.load import RecordingError, find_holding, load_holding, load_recording
        from mrwarp.robot_logs import robot_log

        if robot_log.is_robot_log(self.data):
            from mrwarp.robot_logs.forms.open_log import open_log

            log = open_log(self.data, skip_bad=self.skip_bad, **self.said)
            print("\n".join([*robot_log.describe(log), *(f"note: {note}" for note in log.notes)]))
            return 0
        if self.units:
            raise ValueError(
                f"--units: {self.data} is the recording of a joint, no robot's log; declare them in units.json, or in "
                "the file of --map"
            )
        recording = load_recording(self.data, skip_bad=self.skip_bad, declared=self.map)
        tests_file = find_holding(self.data)
        described, (recording, found) = recording, _mended(recording)
        wrong = contradictions(recording)
        unproven = [f"no verdict by diagnose: {text}" for text in no_verdict_reasons(recording) if text not in wrong]
        if warned := "" if wrong else forewarning(recording):
            unproven.append(warned)
        lines = describe(
            described, "cannot be used" if wrong else "readable, but see the last note" if warned else "good"
        )
        if tests_file:
            holding = load_holding(tests_file, recording)
            count = f"{len(holding.current)} tests at {len({*holding.current})} currents"
            unit = recording.units["torque"]
            lines.append(f"break-away    {count}, up to {holding.torque.max():.4g} {unit} ({tests_file})")
        found += [f"{repair.trajectory}: {repair.text}" for repair in recording.repairs if repair.kind == "cut"]
        print(
            "\n".join(
                [
                    *lines,
                    *(f"note: {note}" for note in [*found, *notes(described, len(recording.trajectories)), *unproven]),
                ]
            )
        )
        if wrong:
            raise RecordingError(f"{self.data}: {wrong[0]}")
        return 0


def _mended(recording: Recording) -> tuple[Recording, list[str]]:
    """The recording that ``check``, ``fit`` and ``diagnose`` judge, what was done to it, and what its runs lack."""
    from mrwarp.diagnose.checks.recording_faults import turned_signs
    from mrwarp.identify.checks.run_levels import levels_without_clock
    from mrwarp.recording.blocks import in_blocks

    mended, fault = turned_signs(recording)
    levels = levels_without_clock(mended)
    found = [*([fault.sentence] if fault else []), *([levels] if levels else [])]
    return in_blocks(mended), found


@dataclass(frozen=True, kw_only=True)
class Fit(Options):
    """Identify eqs. 14 and 15, and 18 where there are break-away torques, from bench recordings by simulation error."""

    engines = False  # before the data are read
    data: opt.Data
    """recording: a CSV, Parquet, .mat, .npz or .xlsx file, or a folder of them"""
    map: opt.OptionalFile = None
    """JSON that names columns and units, in place of the units.json next to the data"""
    out: opt.Folder = Path("runs/fit")
    """output folder"""
    holding: opt.OptionalFile = None
    """break-away torques for eq. 18 (default: a holding.csv next to the data)"""
    law: Annotated[str, opt.one_of(HYSTERESIS_LAWS)] = "bouc_wen"
    """hysteresis law: the paper's, or a published one in its place"""
    limits: Limits = field(default_factory=Limits)
    extended: opt.Flag = False
    """also fit the extended physical model"""
    robust: opt.Flag = False
    """weigh down outliers"""
    exclude: Annotated[str | None, opt.one(str, "PATTERN")] = None
    """leave out trajectories by name, such as 'chirp*'"""
    skip_bad: opt.Flag = False
    """leave out files of a folder that cannot be used, by name"""
    coil_resistance: Annotated[float | None, opt.one(opt.within(1e-3, 1e4, "Ohm"), "R")] = None
    """resistance of the coil [Ohm] (default: the recording's header; else not known, and no power of coils is given)"""
    device_mass: Annotated[float | None, opt.one(opt.within(1e-3, 100.0, "kg"), "M")] = None
    """mass of the device [kg] (default: the recording's header; else not known)"""
    bench: Annotated[tuple[str, ...], opt.some_of(tuple(BENCH_PARTS))] = ()
    """what belongs to the bench and to no robot's joint; the simulator leaves it out"""
    predict: opt.OptionalFolder = None
    """recordings that are not fitted but predicted"""
    averaged: Averaged = 0.0
    """moving average [s] that q and torque of --predict passed before they were published; 0 is none"""
    seed: opt.Seed = 0
    """seed of the search's subset"""

    def run(self, line: CommandLine) -> int:
        """0 when the model is written, 2 on bad input (then nothing is written)."""
        check_writable(self.out)
        if self.law != "bouc_wen" and (self.robust or self.extended):
            raise ValueError(f"--law {self.law} takes neither --robust nor --extended; leave them out")
        if self.extended and self.limits.ends:
            raise ValueError("--extended takes neither --fix nor --bound; leave one of them out")

        from mrwarp.recording.load import check_same_units, load_recording

        progress = ProgressBar()
        progress(f"reading {self.data}")
        recording = self._kept(load_recording(self.data, skip_bad=self.skip_bad, declared=self.map))
        recording, found = _mended(recording)
        for note in [*recording.repaired(), *found]:
            progress(f"note: {note}")
        unseen = load_recording(self.predict, skip_bad=self.skip_bad) if self.predict else None
        if unseen is not None:
            check_same_units(unseen, recording)

        quiet_libraries(gpu=False, networks=False)
        from mrwarp.identify import fit_report
        from mrwarp.identify.checks.stated import STATED, stated_numbers
        from mrwarp.identify.damper import fit_extended
        from mrwarp.identify.fit import read_holding
        from mrwarp.identify.fit_pictures import loops_picture, residual_picture
        from mrwarp.identify.law_fit import fit_law
        from mrwarp.identify.mechanics_fit import fit_joint
        from mrwarp.model_file import HOLDING_NOTE, bench_note, not_known_note, of_bench, save_model, stated

        known = stated_numbers(recording, self.chosen(*STATED))
        holding = read_holding(self.data, recording, self.holding, progress)
        if self.law != "bouc_wen":
            result = fit_law(
                recording, self.law, holding=holding, seed=self.seed, progress=progress, limits=self.limits
            )
        else:
            result = fit_joint(
                recording,
                holding=holding,
                robust=self.robust,
                seed=self.seed,
                progress=lambda text: progress(f"eq. 14: {text}"),
                limits=self.limits,
            )
        extended = None
        if self.extended:
            extended = fit_extended(recording, seed=self.seed, progress=lambda text: progress(f"extended: {text}"))
        predicted = fit_report.predictions(unseen, result, extended, self.averaged) if unseen else {}
        model = of_bench(stated(fit_report.to_model(result, extended), known), self.bench)
        save_model(model, self.out / "model.json")
        content = fit_report.figures(result, extended) | {
            "predicted": predicted,
            "stated": {name: vars(number) for name, number in known.items()},
            "not_known": model.not_known,
            "repairs": [vars(repair) for repair in recording.repairs],
        }
        write_result(self.out, content, seed=self.seed, command=str(line))
        progress("pictures")
        for picture, name in ((loops_picture, "loops.png"), (residual_picture, "residual.png")):
            with drawing(name, progress):
                picture(recording, result, extended, self.out / name)
        progress.done()
        print("\n".join(fit_report.lines(result, extended)))
        if holding is None:
            print(f"\n{HOLDING_NOTE}")
        if note := not_known_note(model.not_known):
            print(f"{chr(10) if holding else ''}{note}")
        if note := bench_note(model):
            print(note)
        for name, errors in predicted.items():
            print(f"NRMSE of {name}: " + ", ".join(f"{key} {100 * value:.1f} %" for key, value in errors.items()))
        print(f"\nmodel.json, result.json, loops.png and residual.png in {self.out} ({progress.seconds:.0f} s)")
        return 0

    def _kept(self, recording: Recording) -> Recording:
        """The recording without the trajectories that are to be left out.

        Raises:
            RecordingError: nothing, or everything, is.
        """
        if self.exclude is None:
            return recording
        from mrwarp.recording.load import RecordingError

        kept = tuple(run for run in recording.trajectories if not fnmatch.fnmatch(run.id, self.exclude))
        if not 0 < len(kept) < len(recording.trajectories):
            names = ", ".join(run.id for run in recording.trajectories[:5])
            which = "no" if kept else "every"
            raise RecordingError(f"--exclude {self.exclude!r} matches {which} trajectory; they are named {names} ...")
        return replace(recording, trajectories=kept)


@dataclass(frozen=True, kw_only=True)
class Learn(Options):
    """Train a torque model of an MR joint on bench recordings.

    A network alone (mlp, lstm), or an LSTM on what the Bouc-Wen model leaves (pg_rlstm). DATA/fit is used if it is
    there; DATA/evaluation judges only.
    """

    data: opt.Data
    """recording: a file or a folder"""
    out: opt.Folder
    """output folder"""
    kind: Annotated[str, opt.one_of(LEARNED), arg(aliases=["--model"])] = "pg_rlstm"
    """kind of network; --model is its earlier name"""
    bouc_wen: opt.OptionalFile = None
    """model.json of 'mrwarp fit' or 'mrwarp diagnose', or a device of 'mrwarp device list' (default: the paper)"""
    epochs: opt.Count = 80
    """most epochs"""
    windows_per_epoch: opt.Count = 65_536
    """training windows drawn per epoch"""
    patience: opt.Count = 15
    """epochs without gain before stopping"""
    seed: opt.Seed = 0
    """seed of division, weights and batches"""
    skip_bad: opt.Flag = False
    """leave out files of a folder that cannot be used, by name"""

    def run(self, line: CommandLine) -> int:
        """0 when done, 2 on bad input (nothing is written), 130 after Ctrl-C (the best is written)."""
        check_writable(self.out)

        from mrwarp.enums import LstmState
        from mrwarp.identify import learn
        from mrwarp.identify.contradictions import refuse_contradictions
        from mrwarp.model_file import load_model
        from mrwarp.nn import network_file
        from mrwarp.nn.training import FitCfg, epochs_shown, plot_history
        from mrwarp.recording.load import load_recording

        cfg = FitCfg(**self.chosen("epochs", "windows_per_epoch", "patience", "seed"))
        physical = load_model(self.bouc_wen) if self.bouc_wen else None
        bouc_wen = learn.bench_parameters(physical.values if physical else None)
        recording, evaluation = load_recording(self._parts()[0], skip_bad=self.skip_bad), None
        held_out = self._parts()[1]
        if held_out.is_dir():
            evaluation = load_recording(held_out, skip_bad=self.skip_bad)
            refuse_contradictions(evaluation)
            if learn.sampling_interval(evaluation) != learn.sampling_interval(recording):
                raise ValueError(f"{held_out}: sampled at another rate than {self.data}; resample one of them")
        with ProgressBar() as bar:
            report = epochs_shown(self.kind, bar)
            learned = learn.learn(
                recording, kind=self.kind, bouc_wen=bouc_wen, physical=physical, cfg=cfg, report=report
            )
        model = replace(learned.model, source=str(self.data))
        figures = {**learned.figures, "bouc_wen": model.bouc_wen, "evaluation": None}
        if evaluation:
            below = learn.physical_torque(evaluation, bouc_wen, physical)
            torques = {
                physical.law.name if physical and physical.law else "bouc_wen": below,
                self.kind: learn.predict(model, evaluation, below),
            }
            if "lstm" in self.kind:  # as the simulation runs it
                torques[f"{self.kind}, carried"] = learn.predict(model, evaluation, below, LstmState.CARRIED)
            errors = {name: learn.errors(torque, evaluation) for name, torque in torques.items()}
            figures["evaluation"] = {name: learn.summary(found) for name, found in errors.items()}
            print(learn.table(figures["evaluation"]))
        if physical is None:
            print("note: no --bouc-wen: the network is taken as one of the paper's device and runs on no other")
        network_file.save(model, self.out / "model.safetensors")
        network_file.export_onnx(model, self.out / "model.onnx")
        write_result(self.out, figures, seed=self.seed, command=str(line))
        with drawing("curves.png"):
            plot_history(learned.history, self.kind, self.out / "curves.png")
        print(
            f"{self.kind}: validation RMSE {figures['validation_rmse']:.3f} N·m at epoch {figures['best_epoch']} of "
            f"{figures['epochs']} ({figures['windows_seen']} windows drawn from {figures['training_windows']}, "
            f"{figures['seconds'] / 60:.1f} min); written to {self.out}"
        )
        return 130 if learned.history.stopped == "interrupted" else 0

    def _parts(self) -> tuple[Path, Path]:
        """Fitting and evaluation data: DATA/fit and DATA/evaluation as the bench writes, or DATA."""
        if (self.data / "fit").is_dir():
            return self.data / "fit", self.data / "evaluation"
        return self.data, (self.data.parent if self.data.name == "fit" else self.data) / "evaluation"


@dataclass(frozen=True, kw_only=True)
class Monitor(Options):
    """Follow a device's health through a folder of calibration records, one file or folder each, in order of names."""

    networks = False
    data: opt.Data
    """folder of records"""
    out: opt.Folder = Path("runs/monitor")
    """output folder: health.png, result.json"""
    baseline: opt.Count = 40
    """first records, of a device that counts as healthy"""
    horizon: opt.Count = 200
    """records over which at most 5 % of healthy devices give an alarm"""

    def check(self) -> None:
        """Refuse also too few records, before they are read."""
        super().check()
        from mrwarp.recording.records import check_count, records_of

        check_count(len(records_of(self.data)), self.baseline, str(self.data))

    def run(self, line: CommandLine) -> int:
        """0 healthy, 1 a change was noticed, 2 on bad input."""
        check_writable(self.out)

        from mrwarp.identify import monitor
        from mrwarp.recording.records import records_of

        cfg = monitor.MonitorCfg(**self.chosen("baseline", "horizon"))
        progress = ProgressBar()
        try:
            records = monitor.read(records_of(self.data), progress)
            health = monitor.monitor(records, cfg, progress)
        finally:
            progress.done()
        figures = {
            "records": health.names,
            **health.values,
            "error": health.error,
            "bounds": health.bounds,
            "alarms": health.alarms,
        }
        write_result(self.out, figures, seed=0, command=str(line))
        with drawing("health.png"):
            monitor.picture(health, cfg, self.out / "health.png")
        print("\n".join(monitor.lines(health, cfg)))
        print(f"\nfigures and picture in {self.out}")
        return 1 if health.alarms else 0
