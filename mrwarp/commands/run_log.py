"""``mrwarp log``: bags become robot logs, and a virtual robot with a known truth records some."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.run_dir import write_result
from mrwarp.runtime import text_table

if TYPE_CHECKING:
    from mrwarp.robot_logs.virtual.record_log import LogCfg

MOTIONS = ("walk", "stand", "squat", "lean", "chirp", "slow", "steps")
"""Motions by name, see ``mrwarp.robot_logs.virtual.motions``."""


def named_motion(text: str) -> tuple[str, float]:
    """A motion and its length, such as ``walk=20``."""
    name, seconds = opt.assignment(text) if "=" in text else (text, 20.0)
    if name not in MOTIONS:
        raise ValueError(f"there is no motion {name!r}; there are {', '.join(MOTIONS)}")
    if not 1.0 <= seconds <= 3600.0:
        raise ValueError(f"{text}: {seconds:g} s; allowed: 1 to 3600 s")
    return name, seconds


def row_rate(text: str) -> int:
    """Rows per second."""
    value = opt.count(text)
    if value % 50 or not 100 <= value <= 1000:
        raise ValueError(f"{text} is not a multiple of 50 from 100 to 1000 Hz")
    return value


@dataclass(frozen=True, kw_only=True)
class ImportLog(opt.LogOptions):
    """Write a bag or another project's log as 'mrwarp diagnose robot' reads it: log.json and tables.

    Read are ROS 1 and 2 bags and MCAP, LeRobot's data sets (versions 2 and 3), PACE's .pt files, and the CSV of Isaac
    Sim's system identification. Of a bag, JointState, Imu, Odometry, PoseStamped and Unitree's LowState and LowCmd are
    found by themselves. A map (JSON) says what files do not: {"robot": "go2.xml", "command": "/topic", "joints":
    {"name in the log": "the robot's name"}, "kp": 20, "kd": {"FL_hip_joint": 0.5}, "tau_is": "estimate", "units":
    {"q": "deg"}}; all keys: docs/robot_logs.md.
    """

    engines = False
    data: opt.Data
    """folder of a ROS 2 bag, or an .mcap, .db3 or .bag file; folder of a data set; a .pt or .csv file, or a folder"""
    out: opt.Folder = Path("runs/log")
    """output folder"""
    skip_bad: opt.Flag = False
    """leave out recordings that cannot be used, by name"""
    format: Literal["csv", "parquet"] = "csv"
    """file type"""
    overwrite: opt.Flag = False
    """replace a log that is there"""

    def run(self, line: CommandLine) -> int:
        """0 when the log is written, 2 on bad input."""
        from mrwarp.robot_logs.forms.open_log import open_log
        from mrwarp.robot_logs.forms.save_log import save_log
        from mrwarp.robot_logs.robot_log import describe, is_robot_log, sources

        _check_free(self.out, self.overwrite)
        if not is_robot_log(self.data):
            raise ValueError(
                f"{self.data}: is no log that is known: a bag, LeRobot's data set (a folder with meta/info.json), "
                "PACE's .pt, or Isaac Sim's CSV (time, q1, q2, ...)"
            )
        log = open_log(self.data, skip_bad=self.skip_bad, **self.said)
        names = save_log(log, self.out, self.format)
        source = log.header.get("source", {})
        figures = {"files": names, "seconds": log.seconds, "topics": source, "notes": log.notes}
        write_result(self.out, figures, seed=0, command=str(line))
        print("\n".join([*sources(log), *describe(log), *(f"note: {note}" for note in log.notes)]))
        print(f"{', '.join(names)} in {self.out}; look at it with: mrwarp check {self.out}")
        return 0


def _check_free(out: Path, overwrite: bool) -> None:
    """Refuse a folder that holds a log; with ``overwrite``, take that log's recordings away."""
    from mrwarp.recording.tables import is_recording
    from mrwarp.robot_logs.robot_log import LOG_FILE

    there = out / LOG_FILE
    if there.exists() and not overwrite:
        raise ValueError(f"{there} is there already; choose another --out or add --overwrite")
    for old in list(filter(is_recording, out.iterdir())) if there.exists() else []:
        old.unlink()


@dataclass(frozen=True, kw_only=True)
class RecordLog(Options):
    """Record logs of a virtual robot: plain MuJoCo at 0.5 ms, joints that give, noisy sensors, hidden effects.

    Writes DIR/log.json, a file per motion, and DIR/truth.json with what was hidden, which no command reads.
    Motions on the ground (walk, stand, squat, lean) and in the air (chirp, slow, steps) make two logs.
    """

    out: opt.Folder = Path("runs/log")
    """output folder"""
    robot: opt.Text = "mr_go"
    """mr_go, go1, a USD file of 'mrwarp robot import', or the MJCF or URDF of an arm"""
    policy: opt.OptionalFile = None
    """walking policy (default: the shipped one for mr_go and go1)"""
    motion: Annotated[tuple[tuple[str, float], ...], opt.some(named_motion, "NAME=SECONDS")] = ()
    """what the robot does (default: stand=10 squat=15 walk=35; an arm: chirp=30 slow=20 steps=10)"""
    hide: Annotated[tuple[str, ...], opt.some(str, "CAUSE=PLACE:SIZE")] = ()
    """hidden effects, such as coil_dead=RL trunk_mass=0.8 coulomb_friction=FR_calf:0.6; see --list"""
    list: opt.Flag = False
    """print all effects that can be hidden, and end"""
    rate: Annotated[int, opt.one(row_rate, "HZ")] = 200
    """rows per second"""
    current: Annotated[float, opt.one(opt.coil_current, "A")] = 1.5
    """current that the devices may use"""
    speed: Annotated[tuple[float, ...], opt.some(opt.forward_speed, "V")] = ()
    """least and largest commanded forward speed [m/s] (default: 0.2 0.6, of another robot in proportion to its size)"""
    tau: Literal["estimate", "measured", "command", "none"] = "estimate"
    """what the torque columns are"""
    noise: Annotated[float, opt.one(opt.within(0.0, 10.0, ""), "X")] = 1.0
    """factor on noise, jitter, stale and lost rows"""
    session_offset: Annotated[float, opt.one(opt.within(0.0, 0.1, "rad"), "RAD")] = 0.004
    """largest offset of a joint in this session"""
    leave_out: Annotated[tuple[str, ...], opt.some(str, "CHANNEL")] = ()
    """channels that the log shall not have, such as current foot acc"""
    motion_capture: opt.Flag = False
    """log the trunk's position and velocity too"""
    seed: opt.Seed = 0
    """seed of noise, offsets and motions"""
    format: Literal["csv", "parquet"] = "csv"
    """file type"""
    overwrite: opt.Flag = False
    """replace a log that is there"""

    def run(self, line: CommandLine) -> int:
        """0 when the log is written, 2 on bad input, 130 when stopped by Ctrl-C."""
        from mrwarp.robot_logs.virtual.hidden_effects import listing
        from mrwarp.robot_logs.virtual.record_log import TRUTH_FILE, FallError, record

        if self.list:
            print("\n".join(text_table(("effect", "unit", "what it is"), listing(), left=3)))
            return 0
        _check_free(self.out, self.overwrite)
        shown = ProgressBar(sys.stderr)
        try:
            figures = record(self._cfg(), self.out, shown)
            write_result(self.out, figures, seed=self.seed, command=str(line))
        except FallError as error:
            print(f"{line.prog}: {error}", file=sys.stderr)
            return 1
        except KeyboardInterrupt:
            raise KeyboardInterrupt("nothing was written") from None
        finally:
            shown.done()
        print(f"{figures['seconds']:.0f} s, {figures['rows']} rows: {', '.join(figures['recordings'])} in {self.out}")
        print(f"what was hidden stands in {self.out / TRUTH_FILE}; look for it with:")
        print(f"  mrwarp diagnose robot {self.out} --robot {self.robot} --out {self.out}-diagnosis")
        return 0

    def _cfg(self) -> LogCfg:
        """Settings by the options, with the defaults that depend on the robot."""
        from mrwarp.resources import DEFAULT_POLICY
        from mrwarp.robot_logs.virtual.record_log import LogCfg
        from mrwarp.usd.asset import ROBOT_SUFFIXES, load_robot

        usd = self.robot in ("mr_go", "go1") or Path(self.robot).suffix in ROBOT_SUFFIXES
        legged = usd and bool(load_robot(robot=self.robot).layout.legs)
        policy = self.policy or (DEFAULT_POLICY if self.robot in ("mr_go", "go1") else None)
        walk = (("walk", 35.0),) if policy else (("lean", 35.0),)
        motions = self.motion or ((("stand", 10.0), ("squat", 15.0), *walk) if legged else ARM)
        if len(self.speed) > 2:
            raise ValueError(
                f"--speed {' '.join(f'{v:g}' for v in self.speed)}: give one speed, or the least and the largest"
            )
        return LogCfg(
            **self.chosen("robot", "hide", "rate", "current", "tau", "noise", "leave_out", "motion_capture", "seed"),
            policy=policy,
            motions=motions,
            session=self.session_offset,
            kind=self.format,
            speeds=(min(self.speed), max(self.speed)) if self.speed else None,
        )


ARM = (("chirp", 30.0), ("slow", 20.0), ("steps", 10.0))
"""Motions of an arm."""
