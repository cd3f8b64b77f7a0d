"""``mrwarp diagnose DATA``: looks at the data and hands over to the command that reads them."""

from __future__ import annotations

from dataclasses import dataclass, fields

from mrwarp.commands.diagnose_options import DiagnoseOptions
from mrwarp.commands.run_diagnose_joint import DiagnoseJoint
from mrwarp.commands.run_diagnose_robot import DiagnoseRobot
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine


@dataclass(frozen=True, kw_only=True)
class Diagnose(DiagnoseRobot, DiagnoseJoint):
    """Hand DATA over to 'mrwarp diagnose joint' or 'mrwarp diagnose robot', whose --help has their own options only.

    Only a recording of a joint takes --model, --predict, --averaged, --impact, --learn, --bench, --without and --keep.
    Only a robot's log takes --robot, --device, --policy, --live, --rrd and --units.
    """

    after_verdict = (*DiagnoseJoint.after_verdict, *DiagnoseRobot.after_verdict)

    data: opt.Data
    """recording of a joint, or log of a robot"""

    def run(self, line: CommandLine) -> int:
        """The exit code of the command that reads the data: a robot's log, or data that --robot comes with."""
        from mrwarp.robot_logs.kinds import kind_of

        DiagnoseOptions.check_choice(self)
        if self.robot is not None or kind_of(self.data) is not None:
            self._refuse_other(DiagnoseJoint, " is for the recording of a joint; {} is a robot's log: leave it out")
            return self._as(DiagnoseRobot).run(line)
        self._refuse_other(DiagnoseRobot, ": {} is the recording of a joint, no robot's log; leave it out")
        return self._as(DiagnoseJoint).run(line)

    def _as(self, command: type[DiagnoseOptions]) -> DiagnoseOptions:
        return command(**{field.name: getattr(self, field.name) for field in fields(command)})

    def _refuse_other(self, command: type[DiagnoseOptions], reason: str) -> None:
        """Raise ValueError where an option was given that only ``command`` has."""
        shared = {field.name for field in fields(DiagnoseRobot)} & {field.name for field in fields(DiagnoseJoint)}
        for field in fields(command):
            if field.name not in shared and getattr(self, field.name) != field.default:
                raise ValueError(f"--{field.name}{reason.format(self.data)}")
