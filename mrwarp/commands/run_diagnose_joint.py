"""``mrwarp diagnose joint``: which effects a recorded joint has that its model lacks, and what they gain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

from mrwarp.commands.diagnose_options import EARLY, DiagnoseOptions, undisturbed
from mrwarp.commands.run_fit import Averaged
from mrwarp.enums import BENCH_PARTS
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.runtime import closest, core_count, quiet_libraries

if TYPE_CHECKING:
    from mrwarp.diagnose.result import Diagnosis
    from mrwarp.model_file import Model
    from mrwarp.recording.data import Recording
    from mrwarp.sysid.report.page import Table


@dataclass(frozen=True, kw_only=True)
class DiagnoseJoint(DiagnoseOptions):
    """Compare a recorded joint with its model, name what the model lacks, extend it, and measure the gain."""

    after_verdict = ("predict", "impact", "learn")

    data: opt.Data
    """recording: a CSV, Parquet, .mat, .npz or .xlsx file, or a folder of them"""
    map: opt.OptionalFile = None
    """JSON that names columns and units, in place of the units.json next to the data"""
    model: opt.OptionalFile = None
    """nominal model.json, or a device of 'mrwarp device list', against which shifts of calibration count"""
    predict: opt.OptionalFolder = None
    """recordings that take no part but are predicted"""
    bench: Annotated[tuple[str, ...], opt.some_of(tuple(BENCH_PARTS))] = ()
    """what belongs to the bench and to no robot's joint; the simulator leaves it out"""
    without: Annotated[tuple[str, ...], opt.some(str, "CAUSE")] = ()
    """effects that are not looked for, such as coil_lag: the verdict says what is found in their place"""
    keep: Annotated[tuple[str, ...], opt.some(str, "CAUSE")] = ()
    """effects that are in the model from the first, with fitted numbers; the rest is looked for next to them"""
    averaged: Averaged = 0.0
    """moving average [s] that q and torque of --predict passed before they were published; 0 is none"""
    impact: opt.Flag = False
    """also show what the extension changes when a walking robot is hit"""
    learn: opt.Flag = False
    """also train a residual on top of baseline and extension (minutes)"""

    def run(self, line: CommandLine) -> int:
        """0 when the report is written, 2 on bad input, 130 after Ctrl-C; the first answer is written at once.

        With ``--quick`` 0 when that is written.
        """
        self.check_choice()
        progress = ProgressBar()
        with self.stoppable() as written:
            recording, unseen, model = self._read(progress)
            quiet_libraries(gpu=False, networks=self.learn or self.impact)
            from mrwarp.diagnose.report.countdown import Countdown
            from mrwarp.diagnose.report.diagnosis_page import render
            from mrwarp.diagnose.report.overview_pictures import draw
            from mrwarp.diagnose.report.printed import lines
            from mrwarp.model_file import bench_note, of_bench

            def answered(early: Diagnosis) -> bool:
                with undisturbed():
                    self._write(early, line)
                    written[:] = [EARLY]
                return not self.quick

            with progress:
                log = Countdown(progress)
                d = self._diagnose(recording, model, log, answered)
                d = replace(d, model=d.model and of_bench(d.model, self.bench))
                if not d.final:
                    progress.done()
                    return self.print_early(lines(d, {}), progress.seconds)
                chosen = self._chosen(d)
                d = replace(d, notes=(*d.notes, *chosen))
                with undisturbed():
                    written[:] = self._write(d, line)
                extras, tables = self._extras(d, unseen, log)
                if extras:
                    self._write_result(d, line, extras)
                log("pictures")
                pictures, notes = draw(d)
                for note in notes:
                    log(note)
                d = replace(d, notes=(*d.notes, *notes))
                page = render(d, str(line), **tables, pictures=pictures)
        with undisturbed():
            self.write_page(page, pictures)
            if notes:
                self._write_result(d, line, extras)
        print("\n".join([*lines(d, tables), *(["", *chosen] if chosen else [])]))
        if d.model is not None and (note := bench_note(d.model)):
            print(note)
        names = ", ".join([*written, "report.html", f"pictures/ ({len(pictures)} PNG)"])
        print(f"\n{names} in {self.out} ({progress.seconds:.0f} s)")
        return 0

    def check_choice(self) -> None:
        """Refuse a log of a robot too, and before minutes of work what could not be written after them."""
        super().check_choice()
        model, own = self.model, self.out / "model.json"
        if model is not None and model.exists() and own.exists() and model.samefile(own):
            raise ValueError(
                f"--out {self.out}: its model.json is the nominal model and would be overwritten; name another folder"
            )
        if self.without or self.keep:
            from mrwarp.effects.catalogue import CATALOGUE

            for option in ("without", "keep"):
                for name in getattr(self, option):
                    if name not in CATALOGUE:
                        near, known = closest(name, CATALOGUE), ", ".join(CATALOGUE)
                        raise ValueError(f"--{option} {name}: no such effect; {near}choose from {known}")
            if both := [name for name in self.keep if name in self.without]:
                raise ValueError(f"--keep {both[0]}: --without {both[0]} takes it out; leave one of them away")
        from mrwarp.robot_logs.kinds import kind_of

        if kind_of(self.data) is not None:
            raise ValueError(f"{self.data}: is a robot's log, no recording of a joint; use 'mrwarp diagnose robot'")

    def _read(self, progress: Callable[[str], None]) -> tuple[Recording, Recording | None, Model | None]:
        """The recording, the one to predict and the nominal model, checked against each other."""
        from mrwarp.recording.load import check_same_units, load_recording

        progress(f"reading {self.data}")
        recording = load_recording(self.data, skip_bad=self.skip_bad, declared=self.map)

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
        model: Model | None,
        progress: Callable[[str], None],
        answered: Callable[[Diagnosis], bool],
    ) -> Diagnosis:
        from mrwarp.diagnose.pipeline import diagnose
        from mrwarp.effects.catalogue import CATALOGUE
        from mrwarp.identify.fit import read_holding
        from mrwarp.model_file import HOLDING_NOTE

        holding = read_holding(self.data, recording, None, progress)
        if holding is None and (model is None or not model.holding_measured):
            progress(HOLDING_NOTE)
        return diagnose(
            recording,
            model=model,
            holding=holding,
            effects=[name for name in CATALOGUE if name not in self.without] if self.without else None,
            keep=self.keep,
            seed=self.seed,
            progress=progress,
            answered=answered,
            threads=min(core_count(), 8),
        )

    def _chosen(self, d: Diagnosis) -> list[str]:
        """Notes on the effects that were not to be looked for, and on those that were kept, with their numbers."""
        from mrwarp.diagnose.verdict_text import measured

        notes = [f"not looked for (--without): {', '.join(self.without)}"] if self.without else []
        for effect in d.model.effects if d.model else ():
            if effect.name in self.keep:
                numbers = [f"{name} {measured(p.value, p.unit)}" for name, p in effect.parameters.items()]
                notes.append(f"in the model from the first (--keep): {effect.name}, {', '.join(numbers)}")
        return notes

    def _extras(
        self, d: Diagnosis, unseen: Recording | None, progress: Callable[[str], None]
    ) -> tuple[dict[str, Any], dict[str, Table]]:
        """Content of ``result.json`` and of the report in addition to the verdict."""
        from mrwarp.diagnose.held_out import predicted_errors, summary
        from mrwarp.diagnose.report import printed

        extras: dict[str, Any] = {}
        tables: dict[str, Table] = {}
        if unseen is not None and d.predictor is None:
            progress("note: --predict: no verdict, so nothing is predicted")
        elif unseen is not None and d.predictor is not None:
            errors = predicted_errors(d.predictor, unseen, averaged=self.averaged, log=progress)
            means = summary(errors)
            source = {"source": unseen.source, "averaged": self.averaged}
            extras["predicted"] = {**source, "nrmse": errors, "mean": means}
            tables["predicted"] = printed.predicted_table(means)
        if self.learn and (d.traces is None or not (d.causes or (d.account is not None and d.account.open))):
            progress("note: --learn: no named cause and no repeatable error, so there is nothing to learn")
        elif self.learn and d.traces is not None:
            from mrwarp.identify.learn import left_to_learn

            models = ([torque[part] for part in d.traces.parts] for torque in (d.traces.baseline, d.traces.extended))
            extras["learned"] = left_to_learn(d.recording, *models, progress=progress)
            tables["learned"] = printed.learned_table(extras["learned"], d.baseline.unit)
        if self.impact and (d.model is None or not d.causes):
            progress("note: --impact: no cause was named, so there is no second robot to compare")
        elif self.impact and d.model is not None:
            from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy
            from mrwarp.trials.impact_figures import EFFECT_FIGURES, impact_change

            policy = OnnxPolicy(DEFAULT_POLICY)
            change = impact_change(d.baseline_model, d.model, policy, seed=self.seed, progress=progress)
            extras["impact"], tables["impact"] = change, printed.impact_table(change, EFFECT_FIGURES)
        return extras, tables

    def _write(self, d: Diagnosis, line: CommandLine) -> list[str]:
        """Write what was found, each file atomically and ``result.json`` last; returns their names."""
        from mrwarp.diagnose.report.overview_pictures import NAMES
        from mrwarp.model_file import save_model

        self.clear(NAMES, () if d.model is not None else ("model.json",))
        if d.model is not None:
            save_model(d.model, self.out / "model.json")
        self._write_result(d, line, {})
        return ["result.json", "model.json"] if d.model is not None else ["result.json"]

    def _write_result(self, d: Diagnosis, line: CommandLine, extras: dict[str, Any]) -> None:
        d.write(self.out, str(line), extras, model_name="model.json" if d.model is not None else "")
