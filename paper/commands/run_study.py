"""``mrwarp study``: train, collect and evaluate the policies of tables 2 and 3 and figure 5."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from mrwarp.enums import MODELS, PLANTS, RANDOMIZATIONS, TERRAINS, TRAINABLE, Coupling
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.rl.ppo_cfg import PpoCfg
from mrwarp.run_dir import check_writable

if TYPE_CHECKING:
    from paper.study.plan import StudyCfg

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
