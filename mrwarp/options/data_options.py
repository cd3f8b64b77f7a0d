"""Options of the commands that make, read and fit recordings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, UseAppendAction

from mrwarp.enums import LEARNED
from mrwarp.options import option_types as opt

Data = Positional[Annotated[Path, opt.one(Path, "DATA")]]


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Virtual torque bench: drives one MR joint along prescribed motion and logs it at 200 Hz.

    Writes DIR/fit, DIR/evaluation, DIR/holding.csv, DIR/bench.png and DIR/result.json.
    """

    out: opt.Folder = Path("runs/bench")
    """output folder"""
    overwrite: opt.Flag = False
    """replace recordings that are already there"""
    effect: UseAppendAction[tuple[Annotated[str, opt.one(str, "NAME=VALUE")], ...]] = ()
    """set one effect, in SI units; --list-effects shows them"""
    list_effects: opt.Flag = False
    """print all effects with defaults and reasons"""
    scale_effects: Annotated[float, opt.one(opt.within(0.0, 10.0, ""), "X")] = 1.0
    """factor on the strength of all effects and noise; 0 leaves only those given by --effect"""
    seed: opt.Seed = 0
    """seed of motions, currents and noise"""
    trajectories: opt.Count = 120
    """trajectories to fit"""
    samples: opt.Count = 665_442
    """their samples in total"""
    evaluation_samples: opt.Whole = 4000
    """samples of each of the 30 evaluation trajectories; 0 for none"""
    policy: opt.OptionalFile = None
    """take the calf motion from this walking policy (.onnx)"""
    asset: opt.OptionalFile = None
    """bench asset (default: mr_bench.usda)"""
    format: Literal["csv", "parquet"] = "csv"
    """file type"""
    progress: bool = True
    """show progress"""


@dataclass(frozen=True, kw_only=True)
class Check:
    """Explain a recording; 0 when it is good to use, 2 when it is refused."""

    data: Data
    """CSV or Parquet file, or a folder of them"""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Identify eqs. 14 and 15, and 18 where there are break-away torques, from bench recordings by simulation error."""

    data: Data
    """recording: a CSV or Parquet file, or a folder of them"""
    out: opt.Folder = Path("runs/fit")
    """output folder"""
    holding: opt.OptionalFile = None
    """break-away torques for eq. 18 (default: a holding.csv beside the data)"""
    extended: opt.Flag = False
    """also fit the extended physical model"""
    robust: opt.Flag = False
    """weigh down outliers"""
    exclude: Annotated[str | None, opt.one(str, "PATTERN")] = None
    """leave out trajectories by name, such as 'chirp*'"""
    predict: opt.OptionalFolder = None
    """recordings that are not fitted but predicted"""
    averaged: opt.Averaged = 0.0
    """moving average [s] that q and torque of --predict passed before they were published; 0 is none"""
    seed: opt.Seed = 0
    """seed of the search's subset"""


@dataclass(frozen=True, kw_only=True)
class Diagnose:
    """Show what the simulation of a measured joint gets wrong, name the cause, extend the model, measure the gain."""

    data: Data
    """recording: a CSV or Parquet file, or a folder of them"""
    out: opt.Folder = Path("runs/diagnose")
    """output folder"""
    model: opt.OptionalFile = None
    """nominal model.json, against which shifts of calibration count"""
    seed: opt.Seed = 0
    """seed of everything random"""
    predict: opt.OptionalFolder = None
    """recordings that take no part but are predicted"""
    averaged: opt.Averaged = 0.0
    """moving average [s] that q and torque of --predict passed before they were published; 0 is none"""
    impact: opt.Flag = False
    """also show what the extension changes when a walking robot is hit"""
    learn: opt.Flag = False
    """also train a residual on top of baseline and extension (minutes)"""


@dataclass(frozen=True, kw_only=True)
class Learn:
    """Train a torque model of an MR joint on bench recordings.

    A network alone (mlp, lstm), or an LSTM on what the Bouc-Wen model leaves (pg_rlstm). DATA/fit is used if it is
    there; DATA/evaluation judges only.
    """

    data: Data
    """recording: a file or a folder"""
    out: opt.Folder
    """output folder"""
    model: Annotated[str, opt.one_of(LEARNED)] = "pg_rlstm"
    """kind"""
    bouc_wen: opt.OptionalFile = None
    """model.json of 'mrwarp fit' (default: the paper)"""
    epochs: opt.Count = 80
    """most epochs"""
    windows_per_epoch: opt.Count = 65_536
    """training windows drawn per epoch"""
    patience: opt.Count = 15
    """epochs without gain before stopping"""
    seed: opt.Seed = 0
    """seed of division, weights and batches"""
