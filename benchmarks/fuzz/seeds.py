"""Good files of every kind, which the mutations start from."""

from __future__ import annotations

import gzip
import io
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np


def csv_seeds() -> list[bytes]:
    """Two trajectories with a comment line, one without qd, one compressed."""
    t = 0.005 * np.arange(60)
    q, current = np.sin(6.0 * t), np.where(t < 0.1, 0.5, 1.0)
    qd, torque = 6.0 * np.cos(6.0 * t), 2.0 * np.cos(6.0 * t)
    rows = [
        f"{a:.4f},{b:.6f},{c:.6f},{d},{e:.6f},{'a' if k < 60 else 'b'},21.5"
        for k in range(120)
        for a, b, c, d, e in [(t[k % 60], q[k % 60], qd[k % 60], current[k % 60], torque[k % 60])]
    ]
    full = '# {"source": "bench", "seed": 1}\nt,q,qd,current,torque,trajectory,temperature\n' + "\n".join(rows) + "\n"
    plain = "t,q,current,torque\n" + "\n".join(f"{t[k]:.4f},{q[k]:.6f},{current[k]},{torque[k]:.6f}" for k in range(60))
    return [full.encode(), plain.encode(), plain.replace("\n", "\r\n").encode(), gzip.compress(plain.encode(), mtime=0)]


def parquet_seeds() -> list[bytes]:
    """The recording, as Parquet."""
    import pyarrow.csv
    import pyarrow.parquet

    found = []
    for data in csv_seeds()[:2]:
        lines = b"\n".join(line for line in data.splitlines() if not line.startswith(b"#"))
        out = io.BytesIO()
        pyarrow.parquet.write_table(pyarrow.csv.read_csv(io.BytesIO(lines)), out)
        found.append(out.getvalue())
    return found


def model_seeds() -> list[bytes]:
    """A fitted joint, without and with effects."""
    from mrwarp.model_file import JOINT_UNITS, FittedOn, Model, Parameter, make_effect, model_to_dict, parameter_unit

    values = {
        "D": -0.033, "B": 0.1, "C": 0.2, "I1": -1e-4, "K0": 0.4, "K1": 10.4, "alpha": 0.77, "beta": 16.5,
        "gamma": -10.5, "q_offset": 1e-5, "T_max": 20.0, "K": 0.5, "n": 3.0,
    }  # fmt: skip
    parameters = {
        name: Parameter(value=value, unit=parameter_unit(name, JOINT_UNITS), ci95=(value - 1.0, value + 1.0))
        for name, value in values.items()
    }
    plain = Model(parameters=parameters, fitted_on=FittedOn(source="bench", trajectories=2, samples=100, rate=200.0))
    effects = (make_effect("coulomb_friction", {"torque": 0.3, "speed": 0.1}),)
    return [json.dumps(model_to_dict(m), indent=2).encode() for m in (plain, replace(plain, effects=effects))]


def usd_seeds() -> list[bytes]:
    """The shipped robot and bench."""
    from mrwarp.usd.open_stage import ASSETS

    return [(ASSETS / name).read_bytes() for name in ("mr_go.usda", "mr_bench.usda")]


def checkpoint_seeds() -> list[bytes]:
    """A small checkpoint."""
    import torch

    from mrwarp.rl import checkpoint

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "c.pt"
        checkpoint.save(path, {"a": torch.zeros(20), "b": {"c": [1, 2.0, "d"]}, "rows": [{"x": 1.0}]})
        return [path.read_bytes()]


def policy_seeds() -> list[bytes]:
    """The shipped walking policy."""
    from mrwarp.rl.policy import DEFAULT_POLICY

    return [DEFAULT_POLICY.read_bytes()]


def network_seeds() -> list[bytes]:
    """A shipped learned torque model."""
    from mrwarp.nn.network_file import shipped_model

    path = shipped_model("mlp")
    assert path is not None
    return [Path(path).read_bytes()]


def dump_seeds() -> list[bytes]:
    """States of a broken environment."""
    from mrwarp.env.nan_dump import Column, Divergence, save

    columns = (Column(quantity="time", part="", unit="s"), Column(quantity="position", part="trunk z", unit="m"))
    bounds = np.array([[-np.inf, -1.0], [np.inf, 1.0]])
    found = Divergence(env=1, columns=columns, states=np.full((5, 2), 2.0, dtype=np.float32), bounds=bounds)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "d.safetensors"
        save(found, path, {"update": 1})
        return [path.read_bytes()]
