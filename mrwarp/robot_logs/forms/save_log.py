"""Robot logs are written in the form in which they are read: ``log.json`` and a table per recording."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from mrwarp.robot_logs.robot_log import BASE_CHANNELS, LOG_FILE, LogRun, RobotLog
from mrwarp.run_dir import atomic_write, write_text

DIGITS = 7
"""Decimals of every number: 0.1 µrad, 0.1 µs."""

Kind = Literal["csv", "parquet"]


def save_log(log: RobotLog, out: Path, kind: Kind = "csv") -> list[str]:
    """Write a log; returns the names of its files, each written atomically, ``log.json`` last."""
    names = []
    for run in log.runs:
        name = f"{run.id}{'.parquet' if kind == 'parquet' else '.csv.gz'}"
        _save(out / name, columns_of(run, log.joints), kind)
        names.append(name)
    write_text(out / LOG_FILE, json.dumps(header_of(log), indent=1, ensure_ascii=False) + "\n")
    return [*names, LOG_FILE]


def header_of(log: RobotLog) -> dict[str, Any]:
    """Content of ``log.json``; keys that nobody knows stay."""
    gains = {
        name: {j: float(f"{v:.6g}") for j, v in zip(log.joints, values, strict=True)}
        for name, values in (("kp", log.kp), ("kd", log.kd))
    }
    own = {"robot": log.robot, "base": log.base, "joints": list(log.joints), **gains, "tau_is": log.tau_is}
    return {**own, **{k: v for k, v in log.header.items() if k not in own}, "units": {}}


def columns_of(run: LogRun, joints: tuple[str, ...]) -> Mapping[str, np.ndarray]:
    """Columns by name; those of a joint without readings are left out."""
    columns = {"t": run.t}
    for channel, values in run.joint.items():
        columns |= {f"{channel}.{j}": x for j, x in zip(joints, values.T, strict=True) if np.isfinite(x).any()}
    for channel, values in run.base.items():
        columns |= {f"{channel}.{axis}": x for axis, x in zip(BASE_CHANNELS[channel], values.T, strict=True)}
    columns |= {f"foot.{name}": values for name, values in run.feet.items()}
    return columns if run.battery is None else columns | {"battery": run.battery}


def _save(path: Path, columns: Mapping[str, np.ndarray], kind: Kind) -> None:
    table = pa.table({name: np.round(values, DIGITS) for name, values in columns.items()})
    with atomic_write(path) as partial:
        if kind == "parquet":
            pyarrow.parquet.write_table(table, partial)
        else:
            with pa.CompressedOutputStream(str(partial), "gzip") as stream:
                pyarrow.csv.write_csv(table, stream)
