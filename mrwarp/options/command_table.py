"""Every command of ``mrwarp`` and its line of help. Loads none of them."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from mrwarp.options.command_line import Options
from mrwarp.options.extras import LABORATORY

LABORATORY_COMMANDS = ("run_reproduce", "run_study")
"""Modules of commands that a checkout has and a wheel has not."""


@dataclass(frozen=True)
class Command:
    """A command, by the name of its dataclass, so that the help of ``mrwarp`` loads nothing else."""

    name: str
    """Dataclass in :mod:`mrwarp.commands`, or in the laboratory's, as ``module:Class``."""
    help: str
    variants: Mapping[tuple[str, ...], Command] = field(default_factory=dict)
    """Commands of other options in its place, by the words that ask for them."""

    def load(self) -> type[Options]:
        """The dataclass: options, and the work."""
        module, _, name = self.name.partition(":")
        package = LABORATORY if module in LABORATORY_COMMANDS else "mrwarp"
        return getattr(importlib.import_module(f"{package}.commands.{module}"), name)


@dataclass(frozen=True)
class Group:
    """Commands under a common name, such as ``mrwarp asset show``."""

    help: str
    commands: Mapping[str, Command | Group]


FIGURE_4 = Command("run_reproduce:TrainFigure4", "the models of figure 4, trained again")
PAGES = Command("run_reproduce:FillPages", "the figures of README and docs, from committed results")

STUDY = {
    "train": Command("run_study:StudyTrain", "train what is not finished; resumable, any number of processes at once"),
    "collect": Command("run_study:Collect", "copy finished policies and their training records into a folder"),
}

GONE = {
    "mrwarp": {"verify": "docs/determinism.md: its checks are tests"},
    "study": {
        **{name: f"mrwarp reproduce {name}" for name in ("table2", "table3", "fig5")},
        "causes": "a table of 'mrwarp reproduce table2'",
        **dict.fromkeys(("quality", "current", "ageing", "pushes", "limits", "release"), "docs/beyond.md"),
    },
    "impact": {"--sensitivity": "mrwarp reproduce sensitivity"},
    "sweep": dict.fromkeys(("--runner", "--address"), "docs/policies.md: a sweep runs on one machine"),
    "mission": dict.fromkeys(("--thermal", "--ambient"), "docs/beyond.md"),
    "reproduce": {"predictions": "docs/beyond.md", "electrical": "a table of 'mrwarp reproduce table6'"},
}
"""Where to find what commands of the last version gave, by group or command and the word that asked for it."""

ASSET = {
    "show": Command("run_asset:Show", "joints, gains, MR numbers with unit, default and source, and masses"),
    "set": Command("run_asset:Set", "change one number; comments and layout of a text file stay"),
    "check": Command("run_asset:CheckAsset", "load every variant, check every number, convert it"),
    "diff": Command("run_asset:Diff", "numbers that differ; exit code 0 none, 1 some, 2 trouble"),
    "apply": Command("run_asset:Apply", "write the numbers of a model.json onto the MR devices"),
    "export": Command("run_asset:Export", "write the numbers of an MR device as model.json"),
}

ROBOT = {
    "import": Command("run_robot:Import", "read a robot from MJCF, URDF or USD; writes what --robot takes"),
    "show": Command("run_robot:ShowRobot", "trunk, legs, joints, feet, gait and devices; a picture"),
    "fit-device": Command("run_robot:FitDevice", "put MR devices onto joints, or take them off"),
}

DEVICE = {
    "list": Command("run_device:ListDevices", "the library: name, law, error on unseen runs, units, licence"),
    "show": Command("run_device:ShowDevice", "numbers with intervals, range, what is unexplained, source, commands"),
    "make": Command("run_device:MakeDevice", "an entry out of what fit or diagnose made of a recording"),
    "page": Command("run_device:DevicePage", "docs/devices.md and its pages, from the library"),
}

DIAGNOSE = {
    ("joint",): Command("run_diagnose_joint:DiagnoseJoint", "what the model of a recorded joint lacks, and the gain"),
    ("robot",): Command("run_diagnose_robot:DiagnoseRobot", "what a robot's description gets wrong, from its log"),
}

LOG = {
    "import": Command("run_log:ImportLog", "a ROS 2 bag or MCAP file as a robot's log"),
    "record": Command("run_log:RecordLog", "record logs of a virtual robot with known hidden effects"),
}

COMMANDS: dict[str, Command | Group] = {
    "demo": Command("run_demo:Demo", "two pictures in two minutes: robots that walk on brakes, a joint's loops"),
    "train": Command("run_train:Train", "train a walking policy until its trials (the walking gate) are passed"),
    "play": Command("run_play:Play", "run a policy and show it in rerun, or save an .rrd or a picture"),
    "sweep": Command("run_sweep:Sweep", "run a command over a grid of seeds, models, currents; resumable"),
    "replay-dump": Command("run_train:ReplayDump", "what went wrong first where a training met NaN or a blow-up"),
    "impact": Command("run_impact:Impact", "hit walking robots with each current; live view, recording, pictures"),
    "walk": Command("run_walk:Walk", "walk 30 m with three robots: cost of transport, support activation, torques"),
    "mission": Command("run_mission:Mission", "150 m out, stand, 150 m back: power, state of charge, temperatures"),
    "bench": Command("run_bench:Bench", "virtual torque bench: recordings with known hidden effects"),
    "check": Command("run_fit:Check", "explain a recording, or what is wrong with it"),
    "fit": Command("run_fit:Fit", "identify the joint from recordings"),
    "diagnose": Command(
        "run_diagnose:Diagnose",
        "what a model gets wrong, and why: 'diagnose joint' of recordings, 'diagnose robot' of a log",
        DIAGNOSE,
    ),
    "export": Command(
        "run_device:ExportDevice", "a device as a C header, as Python with NumPy alone, for plain MuJoCo"
    ),
    "device": Group("the library of identified devices, for every --model", DEVICE),
    "monitor": Command("run_fit:Monitor", "follow a device's health through a folder of calibration records"),
    "log": Group("logs of whole robots, for 'mrwarp diagnose robot'", LOG),
    "learn": Command("run_fit:Learn", "train and evaluate the learned torque models"),
    "reproduce": Command(
        "run_reproduce:Reproduce",
        "the paper's figures and tables, compared with ours",
        {("fig4", "--train"): FIGURE_4, ("docs",): PAGES},
    ),
    "study": Group("train the policies of the paper's tables", STUDY),
    "perf": Command("run_benchmarks:Perf", "what a step costs, part by part, and whether that got worse"),
    "asset": Group("show, check, change and compare USD assets", ASSET),
    "robot": Group("bring a robot of your own, and put devices onto its joints", ROBOT),
}
"""Commands by name."""


def all_commands(table: Mapping[str, Command | Group] = COMMANDS) -> Iterator[tuple[str, Command]]:
    """Every command with its whole name, such as ``asset show``."""
    for name, entry in table.items():
        if isinstance(entry, Group):
            yield from ((f"{name} {inner}", command) for inner, command in all_commands(entry.commands))
        else:
            yield name, entry
