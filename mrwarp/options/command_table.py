"""Every command of ``mrwarp``: its options, the module that runs it, and one line of help. Loads neither."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command; modules are named, so that its help loads nothing else."""

    help: str
    run: str
    """Module whose ``run(options, line)`` does the work and returns the exit code."""
    options: str
    """Dataclass of its options, as ``module:Class``."""
    engines: bool = True
    """Whether it loads Warp or torch, whose start-up notes are silenced."""
    variants: Mapping[tuple[str, ...], Command] = field(default_factory=dict)
    """Commands of other options in its place, by the words that ask for them."""

    def load_options(self) -> type:
        """The dataclass of its options."""
        module, _, name = self.options.partition(":")
        return getattr(importlib.import_module(module), name)


@dataclass(frozen=True, kw_only=True)
class Group:
    """Commands under a common name, such as ``mrwarp asset show``."""

    help: str
    commands: Mapping[str, Command | Group]


def _command(options: str, run: str, help: str, *, engines: bool = True) -> Command:
    return Command(
        options=f"mrwarp.options.{options}",
        run=f"mrwarp.commands.{run}" if run.startswith("run_") else run,
        help=help,
        engines=engines,
    )


def _study(options: str, help: str) -> Command:
    return _command(f"study_options:{options}", "run_study", help)


def _trial(options: str, run: str, help: str, *, engines: bool = True) -> Command:
    return _command(f"trial_options:{options}", run, help, engines=engines)


def _asset(options: str, run: str, help: str) -> Command:
    return _command(f"asset_options:{options}", run, help, engines=run == "run_asset_edit")


COMMANDS: dict[str, Command | Group] = {
    "train": _command("train_options:Train", "run_train", "train a walking policy until the walking gate is met"),
    "play": _command(
        "train_options:Play", "run_play", "run a policy and show it in rerun, or save an .rrd or a picture"
    ),
    "sweep": _command(
        "paper_options:Sweep",
        "run_sweep",
        "run a command over a grid of seeds, models, currents; resumable",
        engines=False,
    ),
    "replay-dump": _trial(
        "ReplayDump", "run_replay_dump", "what went wrong first where a training met NaN or a blow-up", engines=False
    ),
    "impact": _trial("Impact", "run_impact", "hit walking robots with each current; live view, recording, pictures"),
    "walk": _trial("Walk", "run_walk", "walk 30 m with three robots: cost of transport, support activation, torques"),
    "mission": _trial("Mission", "run_mission", "150 m out, stand, 150 m back: power, state of charge, temperatures"),
    "bench": _command("data_options:Bench", "run_bench", "virtual torque bench: recordings with known hidden effects"),
    "check": _command(
        "data_options:Check", "run_check", "explain a recording, or what is wrong with it", engines=False
    ),
    "fit": _command("data_options:Fit", "run_fit", "identify the joint from recordings"),
    "diagnose": _command(
        "data_options:Diagnose",
        "run_diagnose",
        "what the simulation gets wrong, why, and what it gains to put that right",
    ),
    "learn": _command("data_options:Learn", "run_learn", "train and evaluate the learned torque models"),
    "reproduce": Command(
        options="mrwarp.options.paper_options:Reproduce",
        run="mrwarp.commands.run_reproduce",
        help="the paper's figures and tables, ours beside theirs",
        variants={
            ("fig4", "--train"): _command(
                "paper_options:TrainFigure4", "run_fig4_training", "the models of figure 4, trained anew"
            )
        },
    ),
    "study": Group(
        help="actuator-aware against conventional training: train the policies, tables 2 and 3",
        commands={
            "train": _study("StudyTrain", "train what is not finished; resumable, any number of processes at once"),
            "collect": _study("Collect", "copy finished policies and their training records into a folder"),
            "table2": _study("Table2Options", "conventional and actuator-aware policies, SAL off and on"),
            "table3": _study("Table3Options", "torque models in training"),
            "causes": _study("Causes", "which part of the plant makes a policy's velocity error"),
            "fig5": _study("Figure5", "learning curves"),
        },
    ),
    "perf": _command(
        "perf_options:Perf", "benchmarks.perf.perf_cli", "what a step costs, part by part, and whether that got worse"
    ),
    "asset": Group(
        help="show, check, change and compare USD assets",
        commands={
            "show": _asset("Show", "run_asset", "joints, gains, MR numbers with unit, default and source, and masses"),
            "set": _asset("Set", "run_asset_edit", "change one number; comments and layout of a text file stay"),
            "check": _asset("CheckAsset", "run_asset_edit", "load every variant, check every number, convert it"),
            "diff": _asset("Diff", "run_asset", "numbers that differ; exit code 0 none, 1 some, 2 trouble"),
            "apply": _asset("Apply", "run_asset_edit", "write the numbers of a model.json onto the MR devices"),
            "export": _asset("Export", "run_asset", "write the numbers of an MR device as model.json"),
        },
    ),
    "verify": _trial(
        "Verify", "benchmarks.verify.verify_cli", "measure what the simulator promises: passivity, holding, accuracy"
    ),
}
"""Commands by name."""


def all_commands(table: Mapping[str, Command | Group] = COMMANDS) -> Iterator[tuple[str, Command]]:
    """Every command with its whole name, such as ``asset show``."""
    for name, entry in table.items():
        if isinstance(entry, Group):
            yield from ((f"{name} {inner}", command) for inner, command in all_commands(entry.commands))
        else:
            yield name, entry
