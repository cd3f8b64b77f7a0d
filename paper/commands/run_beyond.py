"""``mrwarp study current`` and the other studies beyond the paper."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

from mrwarp.enums import ARMS
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.resources import POLICIES
from mrwarp.run_dir import check_writable, write_result
from mrwarp.runtime import drawing


def _report(study: ModuleType, found: dict[str, Any], out: Path, picture: str, seed: int, line: CommandLine) -> int:
    """Write a study's result and picture into its folder, and print its table."""
    from paper.study.plan import spent

    took = spent(out)
    write_result(out, {**found, "took": took}, seed=seed, command=str(line))
    with drawing(picture):
        study.picture(found, out / picture)
    print("\n".join(study.lines(found)))
    trained = f" and {took['training'] / 60.0:.1f} min of training" if took["training"] else ""
    print(f"\nfigures and picture in {out}; {took['measuring'] / 60.0:.1f} processor minutes of measuring{trained}")
    return 0


@dataclass(frozen=True, kw_only=True)
class Current(Options):
    """Who should command the coils: the gates at a fixed current, a law, or the policy.

    Every arm goes on from the policy of its robot with the same updates and price; then all are walked, loaded
    and pushed. What is in the folder is not done again.
    """

    out: opt.Folder = Path("runs/current")
    """output folder: trainings, measurements, result.json, current.png"""
    arms: Annotated[tuple[str, ...], opt.some_of(ARMS)] = ("none", "fixed", "latched", "scheduled", "learned")
    """what is compared"""
    seeds: opt.Seeds = (0, 1, 2, 3, 4)
    """training seeds, of 0 to 4"""
    num_envs: opt.Count = 128
    """training environments"""
    iterations: opt.Whole = 250
    """PPO updates of every arm, the first 100 of the critic alone; 0 compares with the shipped policies as they are"""
    power_price: opt.NotNegative = 0.01
    """price of a watt of motors and coils [1/W]"""
    more_prices: Annotated[tuple[float, ...], opt.some(opt.not_negative, "X")] = ()
    """further prices [1/W], for a front of power against tracking and impact; each in a folder of its own"""
    more_seeds: opt.Seeds = (0, 1, 2)
    """training seeds at those prices"""
    coil_lag: Annotated[float, opt.one(opt.within(0.0, 10.0, "s"), "S")] = 0.01
    """time constant of the coils [s]; assumed"""
    trials: opt.Count = 3
    """walks of each condition"""
    distance: Annotated[float, opt.one(opt.within(0.01, 1e4, "m"), "M")] = 10.0
    """measured distance of each walk [m]"""
    pushes: opt.Count = 10
    """pushes on a walking robot"""
    threads: opt.Whole = 0
    """CPU threads; 0 = all, the figures are the same"""

    def run(self, line: CommandLine) -> int:
        """0 done, 130 after Ctrl-C, 2 on bad input."""
        check_writable(self.out)

        from mrwarp.energy.model_numbers import read_numbers
        from paper.study import currents

        if self.iterations == 0 and "learned" in self.arms:
            raise ValueError("--iterations 0: no policy that commands currents is shipped; leave out --arms learned")
        names = ("arms", "seeds", "num_envs", "iterations", "power_price", "coil_lag", "trials", "distance", "pushes")
        cfg = currents.CurrentsCfg(**self.chosen(*names, "more_prices", "more_seeds", "threads"))
        groups, progress = read_numbers(None, ()), ProgressBar()
        try:
            found = currents.run(cfg, self.out, groups["electrical"], groups["thermal"], progress)
        finally:
            progress.done()
        if found is None:
            print("stopped; the same command goes on")
            return 130
        found = {**found, "units": currents.UNITS}
        return _report(currents, found, self.out, "current.png", self.seeds[0], line)


@dataclass(frozen=True, kw_only=True)
class Ageing(Options):
    """How soon a worn device is noticed by one calibration a day, and how often a healthy one gives an alarm.

    A device that is in the folder is not followed again.
    """

    out: opt.Folder = Path("runs/ageing")
    """output folder: devices, result.json, ageing.png"""
    devices: opt.Count = 3
    """virtual devices"""
    days: opt.Count = 200
    """healthy days of each after the baseline"""
    follow: opt.Count = 60
    """days after a loss of 5, 10, 20 %"""
    seed: opt.Seed = 0
    """seed of noise, and of what differs from run to run"""

    def run(self, line: CommandLine) -> int:
        """0 done, 2 on bad input."""
        check_writable(self.out)

        from paper.study import ageing

        cfg, progress = ageing.AgeingCfg(**self.chosen("devices", "days", "follow", "seed")), ProgressBar()
        try:
            found = ageing.run(cfg, self.out, progress)
        finally:
            progress.done()
        return _report(ageing, found, self.out, "ageing.png", self.seed, line)


@dataclass(frozen=True, kw_only=True)
class Pushes(Options):
    """Push robots from all directions, standing, walking and on rough ground, with each current.

    Falls and displacement by direction, with intervals; which gate and which legs do it. What is in the folder is not
    done again.
    """

    out: opt.Folder = Path("runs/pushes")
    """output folder: cells, result.json, pushes.png"""
    policies: opt.Folder = POLICIES / "study_rough"
    """policies that walk on rough ground"""
    seeds: opt.Seeds = (0, 1, 2)
    """training seeds, and seeds of poses and gait phases"""
    strengths: Annotated[tuple[float, ...], opt.some(opt.within(1.0, 1e4, "N"), "N")] = (40.0, 60.0, 80.0)
    """pushes for 0.2 s [N]"""
    currents: Annotated[tuple[float, ...], opt.some(opt.within(0.0, 1.5, "A"), "A")] = (0.0, 0.5, 1.0, 1.5)
    """currents; the first is what the others are compared with [A]"""
    trials: opt.Count = 6
    """pushes into each of 12 sectors, per seed"""
    seconds: Annotated[float, opt.one(opt.within(0.5, 60.0, "s"), "S")] = 2.0
    """time after the push begins in which a fall counts [s]"""
    threads: opt.Whole = 0
    """CPU threads; 0 = all, the figures are the same"""

    def run(self, line: CommandLine) -> int:
        """0 done, 2 on bad input."""
        check_writable(self.out)

        from paper.study import pushes

        names = ("policies", "seeds", "strengths", "currents", "trials", "seconds", "threads")
        cfg, progress = pushes.PushesCfg(**self.chosen(*names)), ProgressBar()
        try:
            found = pushes.run(cfg, self.out, progress)
        finally:
            progress.done()
        return _report(pushes, found, self.out, "pushes.png", self.seeds[0], line)


@dataclass(frozen=True, kw_only=True)
class Limits(Options):
    """Where holding ends: gait frequency, payload, low gain against coil lag, age, a stance on four brakes.

    With the shipped policies as they are, and at each gait frequency also with policies that are trained on there if
    you ask for it. What is in the folder is not done again.
    """

    out: opt.Folder = Path("runs/limits")
    """output folder: trainings, parts, result.json, limits.png"""
    policies: opt.Folder = POLICIES / "energy"
    """policies of MR_Go-SAL"""
    seeds: opt.Seeds = (0, 1, 2)
    """training seeds"""
    train: opt.Whole = 0
    """PPO updates of further policies for each gait frequency and seed, with 128 robots and 0.2 to 1.4 m/s, the first
    100 of the critic alone; 0 = none"""
    trials: opt.Count = 2
    """walks of each setting and policy, and stances"""
    seconds: Annotated[float, opt.one(opt.within(1.0, 1e4, "s"), "S")] = 10.0
    """measured time of a walk [s]"""
    threads: opt.Whole = 0
    """CPU threads; 0 = all, the figures are the same"""

    def run(self, line: CommandLine) -> int:
        """0 done, 130 after Ctrl-C in a training, 2 on bad input."""
        check_writable(self.out)

        from mrwarp.energy.model_numbers import read_numbers
        from paper.study import limits

        names = ("policies", "seeds", "train", "trials", "seconds", "threads")
        cfg, progress = limits.LimitsCfg(**self.chosen(*names)), ProgressBar()
        try:
            found = limits.run(cfg, self.out, read_numbers(None, ())["electrical"], progress)
        finally:
            progress.done()
        if found is None:
            print("stopped; the same command goes on")
            return 130
        return _report(limits, found, self.out, "limits.png", self.seeds[0], line)


@dataclass(frozen=True, kw_only=True)
class Release(Options):
    """Release before toe-off: what a field that stays in the core costs in swing, and what a reverse pulse saves.

    With the shipped policies as they are. What is in the folder is not measured again.
    """

    out: opt.Folder = Path("runs/release")
    """output folder: walked.json, result.json, release.png"""
    policies: opt.Folder = POLICIES / "energy"
    """policies of MR_Go-SAL"""
    seeds: opt.Seeds = (0, 1, 2)
    """training seeds"""
    trials: opt.Count = 4
    """walks of each setting and policy"""
    seconds: Annotated[float, opt.one(opt.within(1.0, 1e4, "s"), "S")] = 10.0
    """measured time of a walk [s]"""
    threads: opt.Whole = 0
    """CPU threads; 0 = all, the figures are the same"""

    def run(self, line: CommandLine) -> int:
        """0 done, 2 on bad input."""
        check_writable(self.out)

        from mrwarp.energy.model_numbers import read_numbers
        from paper.study import limits, release

        names = ("policies", "seeds", "trials", "seconds", "threads")
        cfg, progress = limits.LimitsCfg(**self.chosen(*names)), ProgressBar()
        try:
            found = release.run(cfg, self.out, read_numbers(None, ())["electrical"], progress)
        finally:
            progress.done()
        return _report(release, found, self.out, "release.png", self.seeds[0], line)
