"""``mrwarp mission``: power, charge and temperatures of three robots over the paper's task."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from mrwarp import paper
from mrwarp.commands.run_walk import Distance, EnergyOptions, trained_on, trot_speed
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.paper import ROBOTS
from mrwarp.run_dir import write_result
from mrwarp.runtime import drawing, four_digits

TASK = ("speed", "distance", "standby", "outbound_load", "return_load")
"""Options that make a mission the paper's or another."""


def _of_paper(text: str) -> str:
    """One of the paper's robots; another one has no battery and windings that are known."""
    if text not in ROBOTS:
        other = (
            f"; the energy of another robot: mrwarp walk --robot {text} --policy P.onnx" if Path(text).suffix else ""
        )
        raise ValueError(f"{text!r} is none of {', '.join(ROBOTS)}, whose battery and windings are known{other}")
    return text


@dataclass(frozen=True, kw_only=True)
class Mission(EnergyOptions):
    """The pickup-and-return task with Go1, MR_Go and MR_Go-SAL.

    A window of every phase is simulated and carried over the whole phase by the electrical, battery and thermal models.
    """

    renamed = {"seeds": "trials"}
    out: opt.Folder = Path("runs/mission")
    """output folder"""
    robot: Annotated[tuple[str, ...], opt.some(_of_paper, f"{{{','.join(ROBOTS)}}}")] = ROBOTS
    """robots"""
    speed: Annotated[float, opt.one(trot_speed, "V")] = 0.3
    """command [m/s], not in the paper"""
    distance: Distance = paper.DISTANCE
    """one way [m]"""
    standby: opt.Positive = paper.STANDBY
    """standing [s]"""
    outbound_load: opt.Load = paper.arm_load()
    """load out and while standing [kg]: by default the arm, from Go1's own rows"""
    return_load: opt.Load = 3.0
    """load back [kg]"""
    window: Distance = 10.0
    """simulated distance of each walk [m]"""
    trials: opt.Count = 3
    """repetitions"""
    feedback: opt.Flag = False
    """warm windings and fluids act back; a second pass"""
    calibrate: opt.Flag = False
    """fit thermal numbers and capacity to Go1's, write numbers.json"""

    def check(self) -> None:
        """Refuse also the policy of a robot of one's own."""
        super().check()
        if self.policy and (file := trained_on(self.policy)):
            raise ValueError(
                f"--policy {self.policy}: was trained on {file}, whose battery and windings are not known; its energy: "
                f"mrwarp walk --policy {self.policy}"
            )

    def run(self, line: CommandLine) -> int:
        """0 done, 1 when a robot could not finish, 2 on bad input."""
        from mrwarp.energy.model_numbers import read_numbers, write_numbers
        from mrwarp.trials import energy_report, walk_pictures
        from mrwarp.trials.mission import MissionCfg, heat_of_devices
        from mrwarp.trials.walking import device_notes, task_devices
        from mrwarp.usd.asset import not_known

        started, progress = time.perf_counter(), ProgressBar()
        groups, policies = read_numbers(self.numbers, self.set), self.read_policies()
        same = self.chosen(*TASK, "window", "feedback", "seed")
        cfg = MissionCfg(
            **same, seeds=self.trials, robots=tuple(r for r in ROBOTS if r in self.robot), env=self.env_cfg()
        )
        devices = task_devices(cfg.env)
        cfg = replace(cfg, current=self.used(devices))
        of_paper = all(getattr(cfg, name) == getattr(MissionCfg(), name) for name in TASK)
        given = groups["thermal"]
        groups["thermal"], unknown = heat_of_devices(devices, given)
        if unknown and self.feedback:
            raise ValueError(
                f"--feedback: how the devices of --model warm up is not known: {'; '.join(unknown)}; state it"
            )
        if self.calibrate and "go1" not in cfg.robots:
            raise ValueError("--calibrate needs Go1 among the robots")
        if self.calibrate and not of_paper:
            others = ", ".join(f"--{name.replace('_', '-')}" for name in TASK)
            raise ValueError(f"--calibrate needs the paper's task, whose figures it fits; leave out {others}")
        for text in device_notes(cfg.env, self.current or 0.0):
            print(four_digits(text), flush=True)
        if unknown:
            print(f"note: the temperature of the devices is left out; not known: {'; '.join(unknown)}", flush=True)
        task = {**self.chosen(*TASK, "feedback"), "seeds": self.trials, "of_paper": of_paper, "current": cfg.current}
        try:
            traces, figures = energy_report.mission_figures_of(
                cfg, policies, groups, progress, of_paper=of_paper, calibrated=self.calibrate, fluid_known=not unknown
            )
        finally:
            progress.done()
        if self.calibrate:
            write_numbers(self.out / "numbers.json", groups)
        figures |= {"task": task, "wall_seconds": time.perf_counter() - started}
        if not self.calibrate and groups["thermal"] != given:
            figures["numbers"]["thermal"]["fluid_capacity"]["source"] = "the device's mass, taken as steel"
        figures["not_known"] = [*not_known(devices), *(name.partition(" (")[0] for name in unknown if "(" in name)]
        write_result(self.out, figures, seed=self.seed, command=str(line))
        with drawing("power.png"):
            walk_pictures.mission_power(traces, self.out / "power.png")
        with drawing("temperature.png"):
            walk_pictures.mission_temperature(traces, figures["robots"], self.out / "temperature.png")
        print("\n".join(energy_report.mission_lines(figures)))
        print(f"\nfigures and pictures in {self.out}")
        return 0
