"""Options of ``mrwarp study train | collect | table2 | table3 | causes | fig5``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from mrwarp.enums import AWARE, CONVENTIONAL, MODELS, PLANTS, RANDOMIZATIONS, TERRAINS, TRAINABLE
from mrwarp.options import option_types as opt
from mrwarp.options.train_options import Learning
from mrwarp.resources import POLICIES

Seeds = Annotated[tuple[int, ...], opt.some(opt.seed, "S")]
Terrain = Annotated[str, opt.one_of(TERRAINS)]
Model = Annotated[str, opt.one_of(MODELS)]


@dataclass(frozen=True, kw_only=True)
class Trained(Learning):
    """What all trainings of a study share."""

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
    power_price: opt.NotNegative = 0.002
    """price of a watt for go1, mr_go and mr_go_sal* [1/W]"""
    runs: opt.Folder = Path("runs/study")
    """folder of the runs"""
    seeds: Seeds = (0, 1, 2)
    """training seeds"""


@dataclass(frozen=True, kw_only=True)
class StudyTrain(Trained):
    """Train what is not finished; resumable, any number of processes at once."""

    start_from: opt.OptionalFolder = None
    """folder of policies or runs to begin with, e.g. policies/study; each training takes the one of its plant and
    seed, of a run also the critic"""
    threads: opt.Whole = 0
    """CPU threads; 0 = all, the figures are the same"""


@dataclass(frozen=True, kw_only=True)
class Collect(Trained):
    """Copy finished policies and their training records into a folder."""

    out: opt.Folder = Path("runs/policies")
    """where policies and records go"""


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """What the evaluations share."""

    policies: opt.Folder = POLICIES / "study"
    """policies and records, by default the shipped ones"""
    rollouts: opt.Count = 3
    """rollouts per policy"""
    seed: opt.Seed = 0
    """seed of poses and gait phases"""
    seeds: Seeds = (0, 1, 2)
    """training seeds"""
    threads: opt.Whole = 0
    """CPU threads; 0 = all, the figures are the same"""


@dataclass(frozen=True, kw_only=True)
class Table3Options(Evaluation):
    """Torque models in training: table 3."""

    out: opt.Folder = Path("runs/table3")
    """output folder"""
    plant: Model = AWARE
    """what all walk on"""
    terrain: Terrain = "flat"
    """ground that all walk on; rough has 36 tiles, so take as many --rollouts"""


@dataclass(frozen=True, kw_only=True)
class Table2Options(Table3Options):
    """Conventional and actuator-aware policies, SAL off and on: table 2."""

    out: opt.Folder = Path("runs/table2")
    """output folder"""
    aware: Model = AWARE
    """aware policies"""


@dataclass(frozen=True, kw_only=True)
class Causes(Evaluation):
    """Which part of the plant makes a policy's velocity error."""

    out: opt.Folder = Path("runs/causes")
    """output folder"""
    plants: Annotated[tuple[str, ...], opt.some_of(PLANTS)] = (CONVENTIONAL, AWARE)
    """trainings"""


@dataclass(frozen=True, kw_only=True)
class Figure5:
    """Learning curves: figure 5."""

    out: opt.Folder = Path("runs/fig5")
    """output folder"""
    policies: opt.Folder = POLICIES / "study"
    """policies and records, by default the shipped ones"""
    seeds: Seeds = (0, 1, 2)
    """training seeds"""
