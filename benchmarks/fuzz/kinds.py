"""The kinds of files that are read from outside: good ones, how to damage them, who reads them, how it may refuse."""

from __future__ import annotations

import functools
import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.fuzz import seeds
from benchmarks.fuzz.mutations import mutate, mutate_attributes
from benchmarks.fuzz.onnx_fields import mutate_onnx


@dataclass(frozen=True)
class Kind:
    """One kind of input."""

    suffix: str
    """Of the file."""
    seeds: Callable[[], list[bytes]]
    """Good files."""
    read: Callable[[Path], Any]
    """Reads a file."""
    refusals: Callable[[], tuple[type[Exception], ...]]
    """How it may refuse."""
    mutate: Callable[[bytes, random.Random], bytes] = mutate
    """Damages a file."""


def read_model(path: Path) -> None:
    """Load a model and put it on the robot's joints."""
    from mrwarp.usd.asset import with_model

    with_model(_robot(), str(path))


@functools.cache
def _robot() -> Any:
    from mrwarp.usd.asset import load_robot

    return load_robot()


def read_usd(path: Path) -> None:
    """Load robot or bench and list every number, as ``mrwarp asset show`` does."""
    from mrwarp.usd.scene_report import load_variants, show_asset

    for _ in show_asset(next(load_variants(path)), full=True):
        pass


def _read(module: str, name: str) -> Callable[[Path], Any]:
    def read(path: Path) -> Any:
        return getattr(__import__(module, fromlist=[name]), name)(path)

    return read


def _errors(*names: str) -> Callable[[], tuple[type[Exception], ...]]:
    def errors() -> tuple[type[Exception], ...]:
        split = [name.rpartition(".") for name in names]
        return tuple(getattr(__import__(module, fromlist=[name]), name) for module, _, name in split)

    return errors


_RECORDING = _errors("mrwarp.recording.load.RecordingError")
_ASSET = _errors("mrwarp.usd.open_stage.AssetError", "mrwarp.params.ParameterError")

KINDS = {
    "csv": Kind(".csv", seeds.csv_seeds, _read("mrwarp.recording.load", "load_recording"), _RECORDING),
    "parquet": Kind(".parquet", seeds.parquet_seeds, _read("mrwarp.recording.load", "load_recording"), _RECORDING),
    "model": Kind(".json", seeds.model_seeds, read_model, _errors("mrwarp.model_file.ModelFileError")),
    "usd": Kind(".usda", seeds.usd_seeds, read_usd, _ASSET),
    "usd-attr": Kind(".usda", seeds.usd_seeds, read_usd, _ASSET, mutate=mutate_attributes),
    "checkpoint": Kind(".pt", seeds.checkpoint_seeds, _read("mrwarp.rl.checkpoint", "load"),
                       _errors("mrwarp.rl.checkpoint.CheckpointError")),
    "onnx": Kind(".onnx", seeds.policy_seeds, _read("mrwarp.rl.policy", "OnnxPolicy"),
                 _errors("mrwarp.rl.policy.PolicyError"), mutate=mutate_onnx),
    "safetensors": Kind(".safetensors", seeds.network_seeds, _read("mrwarp.nn.network_file", "load"),
                        _errors("mrwarp.nn.network_file.NetworkFileError")),
    "dump": Kind(".safetensors", seeds.dump_seeds, _read("mrwarp.env.nan_dump", "load"),
                 _errors("mrwarp.env.nan_dump.DumpError")),
}  # fmt: skip
"""All kinds of files; ``cli`` is the command line."""
