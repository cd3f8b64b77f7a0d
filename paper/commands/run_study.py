"""``mrwarp study``: train, collect and evaluate the policies of tables 2 and 3 and figure 5."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from mrwarp.enums import AWARE, CONVENTIONAL, MODELS, PLANTS, PUBLIC, RANDOMIZATIONS, TERRAINS, TRAINABLE, Coupling
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.resources import POLICIES
from mrwarp.rl.ppo_cfg import PpoCfg
from mrwarp.run_dir import check_writable, write_result
from mrwarp.runtime import drawing

if TYPE_CHECKING:
    from paper.study.plan import StudyCfg
    from paper.study.rollouts import EvaluationCfg

Table = tuple[list[str], dict[str, Any], bool]
"""Printed text, figures, and whether every target is met."""

Terrain = Annotated[str, opt.one_of(TERRAINS)]
Model = Annotated[str, opt.one_of(MODELS)]


@dataclass(frozen=True, kw_only=True)
class Trained(Options):
    """Options shared by all trainings of a study."""

    plants: Annotated[tuple[str, ...], opt.some_of(TRAINABLE)] = PLANTS
    """what to train on; go1, mr_go, mr_go_sal* pay for power and carry loads"""
    num_envs: opt.Count = 64
    """parallel environments"""
    iterations: opt.Count = 800
    """PPO updates of every policy"""
    terrain: Terrain = "flat"
    """ground of every training"""
    randomize: Annotated[str, opt.one_of(RANDOMIZATIONS)] = "ground"
    """what differs between environments: by default friction and kicks, as in legged_gym"""
    coupling: Coupling = Coupling.EXPLICIT
    """how devices act: the paper's explicit torque, or a brake that sticks (go1, mr_go, mr_go_sal*: by their names)"""
    power_price: opt.NotNegative = 0.002
    """price of a watt for go1, mr_go and mr_go_sal* [1/W]"""
    runs: opt.Folder = Path("runs/study")
    """folder of the runs"""
    seeds: opt.Seeds = (0, 1, 2, 3, 4)
    """training seeds"""
    ppo: PpoCfg = field(default_factory=PpoCfg)

    def study_cfg(self, start_from: Path | None = None) -> StudyCfg:
        """Settings shared by all trainings."""
        from paper.study.plan import StudyCfg

        same = self.chosen(
            "num_envs", "iterations", "terrain", "seeds", "plants", "randomize", "power_price", "coupling"
        )
        return StudyCfg(**same, start_from=start_from, learning=self.ppo)


@dataclass(frozen=True, kw_only=True)
class StudyTrain(Trained):
    """Train what is not finished; resumable, any number of processes at once."""

    start_from: opt.OptionalFolder = None
    """folder of policies or runs to begin with, e.g. policies/study; each training takes the one of its plant and
    seed, of a run also the critic"""
    threads: opt.Whole = 0
    """CPU threads; 0 = all, the figures are the same"""

    def run(self, line: CommandLine) -> int:
        """0 done, 1 when a training broke off, 130 when trainings are left: after Ctrl-C, or at other processes."""
        check_writable(self.runs)

        from paper.study import matched_training

        if matched_training.train(self.study_cfg(self.start_from), self.runs, threads=self.threads):
            print(f"all finished in {self.runs}; 'mrwarp study collect' with the same choices takes the policies")
            return 0
        print("not all finished: the same command goes on")
        return 130


@dataclass(frozen=True, kw_only=True)
class Collect(Trained):
    """Copy finished policies and their training records into a folder."""

    out: opt.Folder = Path("runs/policies")
    """where policies and records go"""

    def run(self, line: CommandLine) -> int:
        """0 done, 2 when a training is not finished."""
        check_writable(self.out)

        from paper.study import matched_training

        written = matched_training.collect(self.study_cfg(), self.runs, self.out)
        print(f"{len(written)} policies in {self.out}")
        for policy in written:
            if failed := matched_training.failed_conditions(policy.with_suffix(".json")):
                print(f"{policy.stem} did not pass the walking gate: {', '.join(failed)}")
        return 0


@dataclass(frozen=True, kw_only=True)
class Figure5(Options):
    """Learning curves: figure 5."""

    out: opt.Folder = Path("runs/fig5")
    """output folder"""
    policies: opt.Folder = POLICIES / "study"
    """policies and records, by default the shipped ones"""
    seeds: opt.Seeds = (0, 1, 2, 3, 4)
    """training seeds"""

    def run(self, line: CommandLine) -> int:
        """0 done, 2 when a record is missing."""
        check_writable(self.out)

        from paper.study.matched_training import TITLES, figure5, plot

        found = figure5(self.policies, seeds=self.seeds)
        for plant, curve in found.items():
            title = TITLES.get(plant, plant)
            print(f"{title:20s} reward at the end {curve.mean[-1]:.2f} ± {curve.sd[-1]:.2f} per second")
        content = {plant: {"update": c.update, "mean": c.mean, "sd": c.sd} for plant, c in found.items()}
        write_result(self.out, {"curves": content}, seed=self.seeds[0], command=str(line))
        with drawing("fig5.png"):
            plot(found, self.out / "fig5.png")
        print(f"\npicture and figures in {self.out}")
        return 0


@dataclass(frozen=True, kw_only=True)
class Evaluation(Options):
    """Options shared by the evaluations."""

    same: ClassVar[tuple[str, ...]] = ()
    """Further options that the evaluation's configuration calls the same."""
    fixed: ClassVar[dict[str, Any]] = {}
    """Choices of the evaluation's configuration that are no options."""
    out: opt.Folder
    """output folder"""
    policies: opt.Folder = POLICIES / "study"
    """policies and records, by default the shipped ones"""
    rollouts: opt.Count = 3
    """rollouts per policy"""
    coupling: Coupling = Coupling.EXPLICIT
    """how the plant's devices act: the paper's explicit torque, or a brake that sticks"""
    seed: opt.Seed = 0
    """seed of poses and gait phases"""
    seeds: opt.Seeds = (0, 1, 2, 3, 4)
    """training seeds"""
    threads: opt.Whole = 0
    """CPU threads; 0 = all, the figures are the same"""

    def run(self, line: CommandLine) -> int:
        """0 done, 1 when a target is missed, 2 when a policy is missing."""
        out = self.out
        check_writable(out)

        from paper.study.rollouts import EvaluationCfg

        chosen = self.chosen("seeds", "rollouts", "seed", "threads", "coupling", *self.same)
        cfg = EvaluationCfg(**chosen, **self.fixed, folder=self.policies)
        progress = ProgressBar()
        try:
            lines, figures, met = self._table(cfg, lambda share: progress(line.prog.rpartition(" ")[2], share))
        finally:
            progress.done()
        print("\n".join(lines))
        write_result(out, {**figures, "evaluation": asdict(cfg)}, seed=self.seed, command=str(line))
        print(f"\nfigures in {out}")
        return 0 if met else 1

    def _table(self, cfg: EvaluationCfg, report: Callable[[float], None]) -> Table:
        raise NotImplementedError  # each table has its own; this is what they share


@dataclass(frozen=True, kw_only=True)
class Table3Options(Evaluation):
    """Torque models in training: table 3."""

    same = ("plant", "terrain")
    out: opt.Folder = Path("runs/table3")
    """output folder"""
    plant: Model = AWARE
    """what all walk on"""
    terrain: Terrain = "flat"
    """ground that all walk on; rough has 36 tiles, so take as many --rollouts"""

    def _table(self, cfg: EvaluationCfg, report: Callable[[float], None]) -> Table:
        from paper.study import paper_tables

        table = paper_tables.table3(cfg, report=report)
        return paper_tables.table3_lines(table), paper_tables.figures(table), True


@dataclass(frozen=True, kw_only=True)
class Table2Options(Table3Options):
    """Conventional and actuator-aware policies, SAL off and on: table 2."""

    out: opt.Folder = Path("runs/table2")
    """output folder"""
    aware: Model = AWARE
    """aware policies"""

    def _table(self, cfg: EvaluationCfg, report: Callable[[float], None]) -> Table:
        from paper.study import paper_tables

        table = paper_tables.table2(cfg, aware=self.aware, report=report)
        lines, met = paper_tables.table2_lines(table)
        return lines, paper_tables.figures(table), met


@dataclass(frozen=True, kw_only=True)
class Quality(Evaluation):
    """Whether policies keep the rules of good ones, each on the robot that it was trained for, with all its current."""

    out: opt.Folder = Path("runs/quality")
    """output folder"""
    plants: Annotated[tuple[str, ...], opt.some_of(TRAINABLE)] = (*PLANTS, PUBLIC)
    """trainings"""

    def _table(self, cfg: EvaluationCfg, report: Callable[[float], None]) -> Table:
        from paper.study import gait_quality

        rows = gait_quality.evaluate(cfg, self.plants, report)
        lines, kept = gait_quality.lines(rows)
        return lines, {"policies": rows, "units": gait_quality.UNITS, "rules": asdict(gait_quality.Rules())}, kept


@dataclass(frozen=True, kw_only=True)
class Causes(Evaluation):
    """Which part of the plant makes a policy's velocity error."""

    fixed = {"plant": "bouc_wen"}
    out: opt.Folder = Path("runs/causes")
    """output folder"""
    plants: Annotated[tuple[str, ...], opt.some_of(PLANTS)] = (CONVENTIONAL, AWARE)
    """trainings"""

    def _table(self, cfg: EvaluationCfg, report: Callable[[float], None]) -> Table:
        from paper.study.paper_tables import STEPS, causes, plain_row, row_lines
        from paper.study.rollouts import METRICS

        found = causes(cfg, self.plants, report)
        rows = {plant: {step: plain_row(row) for step, row in own.items()} for plant, own in found.items()}
        lines = [text for own in found.values() for text in row_lines(own)]
        return lines, {"rows": rows, "steps": STEPS, "units": METRICS}, True
