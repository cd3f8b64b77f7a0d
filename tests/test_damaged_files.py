"""Damaged files of every kind that is read: a good read, or the reader's own refusal that names file and remedy."""

import io
import json
import random
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
import torch

from mrwarp.env import nan_dump
from mrwarp.model_file import JOINT_UNITS, FittedOn, Model, ModelFileError, Parameter, model_to_dict, parameter_unit
from mrwarp.nn import network_file
from mrwarp.params import ParameterError
from mrwarp.recording.load import RecordingError, load_recording
from mrwarp.rl import checkpoint
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy, PolicyError
from mrwarp.usd.asset import load_robot, with_model
from mrwarp.usd.open_stage import ASSETS, AssetError
from mrwarp.usd.scene_report import load_variants, show_asset

NUMBERS = (
    "nan", "-inf", "1e999", "-1", "0", "1e308", "1e-320", "9" * 400, "0x10", "1_000", "", "null", "true", "[]", "{}",
    '"a"', "1,2", "--", "2147483648", "18446744073709551616", "\ufeff1", "\x00",
)  # fmt: skip
"""Texts put in place of a number."""
WORDS = (b"", b"\xff\xfe", "ü\u202e😀".encode(), b"../../etc/passwd", b'"')
"""Texts put in place of a word."""
REMEDY = re.compile(
    r"; |allowed|needed|must |use |give |name |remove|repair|correct|check |choose|again|known|--help|expected"
)
"""Words by which a remedy is recognised."""


def damaged(data: bytes, rng: random.Random) -> bytes:
    """One to four changes: bytes, the end, chunks, numbers, words, brackets that never close."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        at = rng.randrange(min(len(data), 1024) if rng.random() < 0.4 else len(data)) if data else 0
        to, size = rng.randrange(len(data) + 1), rng.choice((1, 8, 64, 500))
        match = {
            what: rng.choice(found) if (found := list(re.finditer(pattern, data[: 2**17]))) else None
            for what, pattern in (("number", rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?"), ("word", rb"[A-Za-z_:]{2,}"))
        }
        what = rng.choice(("byte", "cut", "chunk", "number", "number", "word", "nest"))
        if what == "byte":
            data = data[:at] + bytes([rng.choice((0, 255, 10, 44, 46, 45))]) + data[at + 1 :]
        elif what == "cut":
            data = rng.choice((data[:at], data[at:]))
        elif what == "chunk":
            data = rng.choice((data[:at] + data[at + size :], data[:to] + data[at : at + size] + data[to:]))
        elif what == "nest":
            data = data[:at] + rng.choice((b"[", b'{"a":', b"(")) * rng.choice((10, 100_000)) + data[at:]
        elif place := match[what]:
            new = rng.choice(NUMBERS).encode() if what == "number" else rng.choice(WORDS)
            data = data[: place.start()] + new + data[place.end() :]
    return data[: 2**20]


def with_other_attributes(data: bytes, rng: random.Random) -> bytes:
    """Attributes of a USD text get another value or name; the file stays readable, so that our own checks get work."""
    for _ in range(rng.choice((1, 2, 3))):
        found = list(re.finditer(rb"^\s*(?:uniform |custom )?[\w\[\]]+ ([\w:]+) = (\S.*)$", data, flags=re.MULTILINE))
        place, other = rng.choice(found), rng.choice(found)
        values = (*b'-1 0 1e308 nan inf 1e-320 "a" [1,2] () (1,2,3) @a.usd@ </x> None true'.split(), other[2])
        group = 1 if rng.random() < 0.15 else 2
        new = other[1] if group == 1 else rng.choice(values)
        data = data[: place.start(group)] + new + data[place.end(group) :]
    return data


def good_csv(_: Path) -> bytes:
    """Two trajectories with a comment line."""
    t = np.tile(0.005 * np.arange(60), 2)
    table = [t, np.sin(6.0 * t), 6.0 * np.cos(6.0 * t), np.where(t < 0.1, 0.5, 1.0), 2.0 * np.cos(6.0 * t)]
    rows = [",".join(f"{x:.6f}" for x in row) for row in np.stack(table, axis=1)]
    rows = [f"{row},{'a' if k < 60 else 'b'}" for k, row in enumerate(rows)]
    return "\n".join(['# {"source": "bench", "seed": 1}', "t,q,qd,current,torque,trajectory", *rows, ""]).encode()


def good_parquet(folder: Path) -> bytes:
    """The recording, as Parquet."""
    out, text = io.BytesIO(), good_csv(folder).split(b"\n", 1)[1]
    pyarrow.parquet.write_table(pyarrow.csv.read_csv(io.BytesIO(text)), out)
    return out.getvalue()


def good_model(_: Path) -> bytes:
    """A fitted joint."""
    values = {"D": -0.033, "B": 0.1, "C": 0.2, "I1": -1e-4, "K0": 0.4, "K1": 10.4, "alpha": 0.77, "beta": 16.5}
    values |= {"gamma": -10.5, "q_offset": 1e-5, "T_max": 20.0, "K": 0.5, "n": 3.0}
    parameters = {
        name: Parameter(value=value, unit=parameter_unit(name, JOINT_UNITS), ci95=(value - 1.0, value + 1.0))
        for name, value in values.items()
    }
    fitted_on = FittedOn(source="bench", trajectories=2, samples=100, rate=200.0)
    return json.dumps(model_to_dict(Model(parameters=parameters, fitted_on=fitted_on)), indent=2).encode()


def good_checkpoint(folder: Path) -> bytes:
    """A small checkpoint."""
    path = folder / "good.pt"
    checkpoint.save(path, {"a": torch.zeros(20), "b": {"c": [1, 2.0, "d"]}, "rows": [{"x": 1.0}]})
    return path.read_bytes()


def good_dump(folder: Path) -> bytes:
    """States of a broken environment."""
    columns = (nan_dump.Column(quantity="time", part="", unit="s"), nan_dump.Column(quantity="x", part="", unit="m"))
    states, bounds = np.full((5, 2), 2.0, dtype=np.float32), np.array([[-np.inf, -1.0], [np.inf, 1.0]])
    found, path = nan_dump.Divergence(env=1, columns=columns, states=states, bounds=bounds), folder / "good.safetensors"
    nan_dump.save(found, path, {"update": 1})
    return path.read_bytes()


def good_network(_: Path) -> bytes:
    """A shipped learned torque model."""
    path = network_file.shipped_model("mlp")
    assert path is not None
    return Path(path).read_bytes()


def read_usd(path: Path) -> None:
    """Load and list every number, as ``mrwarp asset show`` does."""
    list(show_asset(next(load_variants(path)), full=True))


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One kind of input."""

    suffix: str
    good: Callable[[Path], bytes]
    read: Callable[[Path], Any]
    errors: tuple[type[Exception], ...]
    damage: Callable[[bytes, random.Random], bytes] = damaged
    cases: int = 15


USD = {"suffix": ".usda", "read": read_usd, "errors": (AssetError, ParameterError)}
KINDS = {
    "csv": Kind(suffix=".csv", good=good_csv, read=load_recording, errors=(RecordingError,)),
    "parquet": Kind(suffix=".parquet", good=good_parquet, read=load_recording, errors=(RecordingError,)),
    "model": Kind(suffix=".json", good=good_model, errors=(ModelFileError,),
                  read=lambda path: with_model(load_robot(), str(path))),
    "robot": Kind(**USD, good=lambda _: (ASSETS / "mr_go.usda").read_bytes()),
    "attributes": Kind(**USD, good=lambda _: (ASSETS / "mr_bench.usda").read_bytes(), damage=with_other_attributes),
    "checkpoint": Kind(suffix=".pt", good=good_checkpoint, read=checkpoint.load, errors=(checkpoint.CheckpointError,),
                       cases=200),
    "policy": Kind(suffix=".onnx", good=lambda _: DEFAULT_POLICY.read_bytes(), read=OnnxPolicy, errors=(PolicyError,)),
    "network": Kind(suffix=".safetensors", good=good_network, read=network_file.load,
                    errors=(network_file.NetworkFileError,)),
    "dump": Kind(suffix=".safetensors", good=good_dump, read=nan_dump.load, errors=(nan_dump.DumpError,),
                 cases=100),
}  # fmt: skip


NONE = (b"", b"this is another file\n", bytes(range(256)) * 2, bytes(2000), b"\x80\x04}.", b"PK\x03\x04" + bytes(60))
"""Nothing, a text, bytes, zeros, a pickle and the head of an archive."""


def refusal(kind: Kind, path: Path) -> str:
    """The message with which a file is refused, in one line with file and remedy; "" where it is read."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            kind.read(path)
    except kind.errors as error:
        message = str(error)
        assert str(path.parent) in message and REMEDY.search(message) and "\n" not in message, message
        return message
    finally:
        assert list(path.parent.iterdir()) == [path]
    return ""


@pytest.mark.parametrize("name", KINDS)
def test_a_damaged_file_is_read_or_refused(name: str, tmp_path: Path) -> None:
    """No exception but the reader's own, and nothing is left in the folder; what is no such file is never read."""
    kind, rng = KINDS[name], random.Random(f"{name}/1")
    good, folder = kind.good(tmp_path), tmp_path / "input"
    folder.mkdir()
    path, refusals = folder / f"input{kind.suffix}", set()
    path.write_bytes(good)
    kind.read(path)
    for data in NONE:
        path.write_bytes(data)
        assert refusal(kind, path), data
    for _ in range(kind.cases):
        path.write_bytes(kind.damage(good, rng))
        refusals.add(refusal(kind, path))
    assert refusals - {""}
