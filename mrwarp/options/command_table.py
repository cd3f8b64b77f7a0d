"""Every command of ``mrwarp``: its options, the module that runs it, and one line of help. Loads neither."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command; modules are named, so that its help loads nothing else."""

    help: str
    run: str
    """Module whose ``run(options, line)`` does the work and returns the exit code."""
    options: str = ""
    """Dataclass of its options, as ``module:Class``."""
    engines: bool = True
    """Whether it loads Warp or torch, whose start-up notes are silenced."""

    def load_options(self) -> type:
        """The dataclass of its options."""
        module, _, name = self.options.partition(":")
        return getattr(importlib.import_module(module), name)


@dataclass(frozen=True, kw_only=True)
class Group:
    """Commands under a common name, such as ``mrwarp asset show``."""

    help: str
    commands: Mapping[str, Command | Group]


_RUN = "mrwarp.commands.run"
_TRAIN, _DATA = "mrwarp.options.train_options", "mrwarp.options.data_options"

COMMANDS: dict[str, Command | Group] = {
    "train": Command(
        help="train a walking policy until the walking gate is met",
        options=f"{_TRAIN}:Train",
        run="mrwarp.commands.run_train",
    ),
    "play": Command(
        help="run a policy and show it in rerun, or save an .rrd or a picture",
        options=f"{_TRAIN}:Play",
        run="mrwarp.commands.run_play",
    ),
    "sweep": Command(
        help="run a command over a grid of seeds, models, currents; resumable", run="mrwarp.commands.run_sweep"
    ),
    "replay-dump": Command(
        help="what went wrong first where a training met NaN or a blow-up", run="mrwarp.commands.run_replay_dump"
    ),
    "impact": Command(
        help="hit walking robots with each current; live view, recording, pictures", run="mrwarp.commands.run_impact"
    ),
    "walk": Command(
        help="walk 30 m with three robots: cost of transport, support activation, torques",
        run="mrwarp.commands.run_walk",
    ),
    "mission": Command(
        help="150 m out, stand, 150 m back: power, state of charge, temperatures", run="mrwarp.commands.run_mission"
    ),
    "bench": Command(
        help="virtual torque bench: recordings with known hidden effects", run="mrwarp.commands.run_bench"
    ),
    "check": Command(
        help="explain a recording, or what is wrong with it",
        options=f"{_DATA}:Check",
        run="mrwarp.commands.run_check",
        engines=False,
    ),
    "fit": Command(help="identify the joint from recordings", run="mrwarp.commands.run_fit"),
    "diagnose": Command(
        help="what the simulation gets wrong, why, and what it gains to put that right",
        run="mrwarp.commands.run_diagnose",
    ),
    "learn": Command(help="train and evaluate the learned torque models", run="mrwarp.commands.run_learn"),
    "reproduce": Command(
        help="the paper's figures and tables, ours beside theirs", run="mrwarp.commands.run_reproduce"
    ),
    "study": Group(
        help="actuator-aware against conventional training: train the policies, tables 2 and 3",
        commands={
            name: Command(help=text, options=f"mrwarp.options.study_options:{options}", run=f"{_RUN}_study")
            for name, options, text in (
                ("train", "StudyTrain", "train what is not finished; resumable, any number of processes at once"),
                ("collect", "Collect", "copy finished policies and their training records into a folder"),
                ("table2", "Table2Options", "conventional and actuator-aware policies, SAL off and on"),
                ("table3", "Table3Options", "torque models in training"),
                ("causes", "Causes", "which part of the plant makes a policy's velocity error"),
                ("fig5", "Figure5", "learning curves"),
            )
        },
    ),
    "perf": Command(help="what a step costs, part by part, and whether that got worse", run="benchmarks.perf.perf_cli"),
    "asset": Command(help="show, check, change and compare USD assets", run="mrwarp.commands.run_asset"),
    "verify": Command(
        help="measure what the simulator promises: passivity, holding, accuracy", run="mrwarp.commands.run_verify"
    ),
}
"""Commands by name."""
