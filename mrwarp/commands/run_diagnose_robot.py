"""``mrwarp diagnose robot``: which numbers of a robot's description its log contradicts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from mrwarp.commands.diagnose_options import EARLY, DiagnoseOptions, undisturbed
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.runtime import quiet_libraries, text_table

if TYPE_CHECKING:
    from mrwarp.robot_logs.robot_verdict import RobotDiagnosis


@dataclass(frozen=True, kw_only=True)
class DiagnoseRobot(opt.LogOptions, DiagnoseOptions):
    """Replay a robot's log in simulation, name what its description gets wrong, and write the corrected robot."""

    after_verdict = ("policy", "live", "rrd")

    data: opt.Data
    """the log: a folder with log.json, a ROS bag or MCAP, a data set of LeRobot, a .pt of PACE, a CSV of Isaac Sim's
    system identification"""
    robot: Annotated[str | None, opt.one(str, "ROBOT")] = None
    """the robot's description, MJCF, URDF or USD (default: the file that log.json names, next to it)"""
    device: str = "cpu"
    """cpu, or a GPU such as cuda:0, on which pieces of the log are replayed"""
    policy: opt.OptionalFile = None
    """also show what the verdict changes when this policy walks (falls, tracking, power)"""

    live: Annotated[opt.Flag, opt.VIEW] = False
    """show the logged robot next to the extended simulation in rerun's window"""
    rrd: Annotated[opt.OptionalFile, opt.VIEW] = None
    """save that view as a recording"""

    def run(self, line: CommandLine) -> int:
        """0 when the report is written, 2 on bad input, 130 after Ctrl-C; the first answer is written at once.

        With ``--quick`` 0 when that is written.
        """
        self.check_choice()
        quiet_libraries(gpu=self.device != "cpu")
        from mrwarp.robot_logs.extended_robot import write_extended
        from mrwarp.robot_logs.forms.open_log import open_log
        from mrwarp.robot_logs.report import log_page, log_pictures
        from mrwarp.robot_logs.report.compared_replays import compare
        from mrwarp.robot_logs.report.log_view import log_view
        from mrwarp.robot_logs.report.stages import Countdown
        from mrwarp.robot_logs.report.walk_change import HEAD, check_walker, walk_change
        from mrwarp.robot_logs.robot_diagnosis import diagnose_log, robot_of
        from mrwarp.robot_logs.robot_verdict import lines
        from mrwarp.viewing.live_view import disconnect, open_sink

        progress = ProgressBar()
        with self.stoppable() as written:
            progress(f"reading {self.data}")
            log = open_log(self.data, skip_bad=self.skip_bad, **self.said)
            robot = robot_of(log, self.robot)
            if self.policy is not None:
                check_walker(self.policy, robot, log.base)

            def answered(early: RobotDiagnosis) -> bool:
                self._write_early(early, line)
                written[:] = [EARLY]
                return not self.quick

            d = diagnose_log(robot, log, device=self.device, progress=Countdown(progress), answered=answered)
            if not d.final:
                progress.done()
                return self.print_early(lines(d), progress.seconds)
            walked = None
            if self.policy is not None and d.causes:
                walked = walk_change(d, self.policy, seed=self.seed, progress=progress)
            elif self.policy is not None:
                progress("note: --policy: no cause was named, so there is no second robot to compare")
            extras = {"walk": vars(walked)} if walked else {}
            with undisturbed():
                self.clear(log_pictures.NAMES)
                names, notes = write_extended(d, self.out)
                d = replace(d, seed=self.seed, notes=(*d.notes, *notes))
                d.write(self.out, str(line), extras, model_name="model.json")
                written[:] = ["result.json", *names]
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
        with undisturbed():
            self.write_page(page, pictures)
            if notes:
                d.write(self.out, str(line), extras, model_name="model.json")
        progress.done()
        print("\n".join(lines(d)))
        if walked:
            print("\n".join(("", "as described → extended", *text_table(HEAD, walked.rows()))))
        print(f"\nresult.json, report.html, pictures/, {', '.join(names)} in {self.out} ({progress.seconds:.0f} s)")
        if self.rrd is not None:
            print(f"recording: {self.rrd}; open it with: rerun {self.rrd}")
        return 0

    def check_choice(self) -> None:
        """Refuse a recording of a joint too, and a view that cannot be opened or written."""
        super().check_choice()
        from mrwarp.robot_logs.kinds import LOG_FILE, kind_of
        from mrwarp.run_dir import check_output

        if kind_of(self.data) is None:
            where = self.data / LOG_FILE if self.data.is_dir() else self.data
            raise ValueError(
                f"{where}: no such description of a log; write one, see docs/robot_logs.md, or use "
                "'mrwarp diagnose joint' for the recording of a joint"
            )
        check_output(self.rrd, ".rrd")
        if self.live:
            from mrwarp.viewing.viewer import check_viewer

            check_viewer()

    def _write_early(self, early: RobotDiagnosis, line: CommandLine) -> None:
        """Write the first answer, and nothing of an earlier diagnosis stays but a file that is the robot."""
        from mrwarp.robot_logs.extended_robot import WRITTEN
        from mrwarp.robot_logs.report.log_pictures import NAMES

        with undisturbed():
            self.clear(NAMES, [name for name in WRITTEN if not _same_file(self.out / name, early.model.path)])
            replace(early, seed=self.seed).write(self.out, str(line))


def _same_file(a: Path, b: Path) -> bool:
    return a.exists() and b.exists() and a.samefile(b)
