"""Learned torque models as files: safetensors to load again, ONNX for other programs; everything needed is inside."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from mrwarp.enums import LstmState, ZStep
from mrwarp.nn.models import FEATURES, SAMPLES, LstmTorque, TorqueNet, make_net
from mrwarp.resources import META, MODELS, shipped_model  # noqa: F401  (where networks are looked for)
from mrwarp.run_dir import atomic_write, no_file, one_line

SCHEMA = 1
"""Version of the description."""

DEVICE = ("K1", "K0", "B", "alpha", "beta", "gamma", "D", "C", "I1")
"""Parameters of eqs. 14 and 15 by which a device is known again, those named first that its torque hangs on most. The
zeros of bench and robot are no part of it."""

SAME = 1e-5
"""Largest relative difference of a parameter that is the same: a USD attribute of type ``float`` keeps seven digits."""


class NetworkFileError(ValueError):
    """A model file cannot be used; the message names the file and the remedy."""


class OtherDeviceError(ValueError):
    """A model learned another device; the message says how they differ, and the remedy."""


class SamplingRateError(ValueError):
    """A model was trained at another sampling rate; the message gives both."""


@dataclass(frozen=True, kw_only=True)
class LearnedModel:
    """A trained network and what it was trained on."""

    kind: str
    """``mlp``, ``lstm`` or ``pg_rlstm``."""
    net: TorqueNet
    """The network, in evaluation mode."""
    dt: float
    """Sampling interval of its windows [s]."""
    bouc_wen: dict[str, float]
    """Bouc-Wen parameters with which it was trained: the frozen baseline of ``pg_rlstm``, for all kinds the origin
    of the displacement q_c; names and units of ``mrwarp.params.BoucWenParams``."""
    trained_with: dict[str, dict[str, float]] = field(default_factory=dict)
    """Additions to eqs. 14 and 15 in the model that ``pg_rlstm`` was trained on top of: numbers of the hysteresis
    law and the effects, by name."""
    device: dict[str, float] = field(default_factory=dict)
    """Of which device it is: the :data:`DEVICE` parameters of the joint that was recorded. ``bouc_wen`` may be another
    fit of it. Files of earlier versions have none: theirs is ``bouc_wen``."""
    z_step: str = ZStep.EXACT.value
    """Step of eq. 15 in the torque that ``pg_rlstm`` was trained on top of, a :class:`mrwarp.enums.ZStep`."""
    source: str = ""
    """Recording it was trained on."""
    seed: int = 0
    """Seed of weights, division and batches."""
    training: dict[str, Any] = field(default_factory=dict)
    """Recipe and figures of the training, plain values."""

    @property
    def samples(self) -> int:
        """Samples in a window."""
        return SAMPLES[self.kind]

    @property
    def is_residual(self) -> bool:
        """Whether the output is added to the Bouc-Wen torque; else it is the whole torque."""
        return self.kind == "pg_rlstm"

    def description(self) -> dict[str, Any]:
        """The metadata: all but the weights."""
        keys = {name: name for name in self.__dataclass_fields__ if name != "net"} | {"trained_with": "beside"}
        values = {key: getattr(self, name) for name, key in keys.items()}
        scaler = {"mean": self.net.scaler.mean.tolist(), "std": self.net.scaler.std.tolist()}
        features = ["q_c [rad]", "qd [rad/s]", "current [A]"]
        return {"schema": SCHEMA, **values, "samples": self.samples, "features": features, "scaler": scaler}

    def check_device(self, joint: Mapping[str, float]) -> None:
        """Refuse a joint whose device is another than the one that was learned.

        Args:
            joint: Parameters of the joint by name, among them those of :data:`DEVICE`.

        Raises:
            OtherDeviceError: they differ.
        """
        learned = self.device or self.bouc_wen
        pairs = {name: (learned[name], joint[name]) for name in DEVICE if name in learned}
        other = [n for n, (ours, theirs) in pairs.items() if not math.isclose(ours, theirs, rel_tol=SAME, abs_tol=1e-9)]
        if other:
            parts = ", ".join(f"{name} {learned[name]:.4g} instead of {joint[name]:.4g}" for name in other[:2])
            more = f" and {len(other) - 2} more" if other[2:] else ""
            raise OtherDeviceError(
                f"this {self.kind} network learned another device than the joint's ({parts}{more}); learn this one: "
                "'mrwarp learn DATA --bouc-wen MODEL.json --out DIR' with the joint's model.json, then name "
                "DIR/model.safetensors"
            )

    def check_rate(self, dt: float) -> None:
        """Raise SamplingRateError if the interval ``dt`` [s] differs from the model's by more than 0.1 %."""
        if not math.isclose(dt, self.dt, rel_tol=1e-3):
            raise SamplingRateError(
                f"this {self.kind} model was trained at {1.0 / self.dt:g} Hz and cannot run at {1.0 / dt:g} Hz: its "
                f"window would mean another time; resample the recording to {1.0 / self.dt:g} Hz or train it again"
            )


def save(model: LearnedModel, path: Path) -> None:
    """Write weights and description as safetensors, whole or not at all."""
    weights = {name: tensor.contiguous() for name, tensor in model.net.state_dict().items()}
    with atomic_write(path) as partial:
        save_file(weights, str(partial), metadata={META: json.dumps(model.description(), allow_nan=False)})
        partial.chmod(0o644)  # safetensors keeps its files to their owner


def load(path: str | Path) -> LearnedModel:
    """Read a model that :func:`save` wrote.

    Raises:
        NetworkFileError: the file is missing, no safetensors, or not one of ours.
    """
    path = Path(path)
    if not path.is_file():
        raise NetworkFileError(f"{path}: {no_file(path, 'model')}; name a .safetensors file that 'mrwarp learn' wrote")
    try:
        with safe_open(str(path), framework="pt") as content:
            meta = json.loads((content.metadata() or {}).get(META, "null"))
            weights = {name: content.get_tensor(name) for name in content.keys()}  # noqa: SIM118 (no mapping)
    except (SafetensorError, OSError, ValueError, RecursionError) as error:
        raise NetworkFileError(f"{path}: not a readable safetensors file ({error}); train it again") from error
    if not isinstance(meta, dict) or meta.get("schema") != SCHEMA or str(meta.get("kind")) not in SAMPLES:
        raise NetworkFileError(f"{path}: no learned torque model of this version; make one with 'mrwarp learn'")
    try:
        net = make_net(meta["kind"])
        net.load_state_dict(weights)
        model = LearnedModel(
            kind=meta["kind"],
            net=net.eval(),
            dt=float(meta["dt"]),
            bouc_wen={str(k): float(v) for k, v in meta["bouc_wen"].items()},
            trained_with={str(k): {str(n): float(x) for n, x in v.items()} for k, v in meta.get("beside", {}).items()},
            device={str(k): float(v) for k, v in meta.get("device", {}).items()},
            z_step=ZStep(meta.get("z_step", "euler")).value,  # files of earlier versions name none
            source=str(meta["source"]),
            seed=int(meta["seed"]),
            training=dict(meta["training"]),
        )
    except (RuntimeError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise NetworkFileError(
            f"{path}: weights or description are incomplete ({one_line(error)}); train it again"
        ) from error
    if not all(bool(torch.isfinite(tensor).all()) for tensor in weights.values()):
        raise NetworkFileError(f"{path}: holds weights that are no numbers; train it again")
    return model


def export_onnx(model: LearnedModel, path: Path) -> None:
    """Write as ONNX: input ``window`` (N, samples, 3) of raw features, output ``torque`` (N,), scaler inside."""
    path.parent.mkdir(parents=True, exist_ok=True)
    example = torch.zeros(1, model.samples, FEATURES)
    write_onnx(model.net, (example,), path, input="window", output="torque", description=model.description())


def write_onnx(
    net: torch.nn.Module, example: tuple, path: Path, *, input: str, output: str, description: dict[str, Any]
) -> None:
    """Write a network as ONNX, whole or not at all.

    The first dimension of the ``example`` inputs may be any; the description, plain values, becomes metadata under
    :data:`mrwarp.resources.META`.
    """
    with atomic_write(path) as partial, warnings.catch_warnings():
        # this exporter is deprecated, but keeps the layers' names, by which rl.policy finds the weights
        warnings.simplefilter("ignore")
        names = {"input_names": [input], "output_names": [output], "dynamic_axes": {input: {0: "n"}, output: {0: "n"}}}
        torch.onnx.export(net, example, str(partial), **names, opset_version=18, dynamo=False)
        proto = onnx.load(str(partial))
        onnx.helper.set_model_props(proto, {META: json.dumps(description)})
        onnx.save(proto, str(partial))


@torch.no_grad()
def torque_of(model: LearnedModel, features: np.ndarray, lstm_state: LstmState = LstmState.WINDOW) -> np.ndarray:
    """Output of the network [N·m], shape (N,), along raw (q_c, qd, current) of one trajectory, shape (N, 3).

    NaN where the window is not yet full.
    """
    x = torch.from_numpy(np.ascontiguousarray(features, dtype=np.float32))
    result = np.full(len(x), np.nan)
    full = model.samples - 1
    if len(x) <= full:
        return result
    if lstm_state is LstmState.CARRIED and isinstance(model.net, LstmTorque):
        result[full:] = model.net.carried(x)[full:].numpy()
        return result
    windows = x.unfold(0, model.samples, 1).transpose(1, 2)
    result[full:] = torch.cat([model.net(part) for part in windows.split(512)]).numpy()
    return result
