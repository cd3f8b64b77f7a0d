"""Model files: bit-equal round trip, everything inside, clear refusals, and an ONNX export that computes the same."""

import json
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from onnx.reference import ReferenceEvaluator
from safetensors.torch import save_file

from mrwarp.nn.models import SAMPLES, make_net
from mrwarp.nn.network_file import (
    META,
    LearnedModel,
    NetworkFileError,
    SamplingRateError,
    export_onnx,
    load,
    save,
    torque_of,
)


def make_model(kind: str) -> LearnedModel:
    """An untrained network with a scaler that is not the identity."""
    net = make_net(kind, seed=4)
    net.scaler.mean.copy_(torch.tensor([0.1, -0.4, 0.6]))
    net.scaler.std.copy_(torch.tensor([0.3, 2.5, 0.5]))
    return LearnedModel(kind=kind, net=net.eval(), dt=0.005, bouc_wen={"K1": 10.0}, source="bench", seed=4)


def windows(samples: int) -> torch.Tensor:
    """Some raw windows."""
    return torch.randn(5, samples, 3, generator=torch.Generator().manual_seed(1))


@pytest.mark.parametrize("kind", list(SAMPLES))
def test_model_file_round_trip(kind: str, tmp_path: Path) -> None:
    """Weights, scaler and description come back as they were, to the bit; no pickle is involved."""
    model = make_model(kind)
    save(model, tmp_path / "model.safetensors")
    again = load(tmp_path / "model.safetensors")
    assert again.description() == model.description()
    x = windows(model.samples)
    with torch.no_grad():
        assert torch.equal(again.net(x), model.net(x))
    assert [p.name for p in tmp_path.iterdir()] == ["model.safetensors"]


@pytest.mark.parametrize("kind", list(SAMPLES))
def test_onnx_export_computes_the_same(kind: str, tmp_path: Path) -> None:
    """Raw windows in, torque out, for another batch size than the exported one; scaler and interval in the metadata."""
    model = make_model(kind)
    export_onnx(model, tmp_path / "model.onnx")
    proto = onnx.load(str(tmp_path / "model.onnx"))
    meta = json.loads({entry.key: entry.value for entry in proto.metadata_props}[META])
    assert meta["dt"] == 0.005 and meta["kind"] == kind
    assert meta["scaler"]["std"] == pytest.approx([0.3, 2.5, 0.5])
    x = windows(model.samples)
    got = np.asarray(ReferenceEvaluator(proto).run(None, {"window": x.numpy()})[0])
    with torch.no_grad():
        np.testing.assert_allclose(got, model.net(x).numpy(), rtol=0.0, atol=1e-5)


def test_torque_of_slides_the_window_along_a_trajectory() -> None:
    """NaN until the window is full, then the module's output of each window."""
    model = make_model("lstm")
    x = np.random.default_rng(0).normal(size=(60, 3)).astype(np.float32)
    tau = torque_of(model, x)
    assert np.all(np.isnan(tau[:49])) and tau.shape == (60,)
    with torch.no_grad():
        last = model.net(torch.from_numpy(x[None, 10:60]))
    assert tau[59] == pytest.approx(float(last), abs=1e-6)
    assert np.all(np.isnan(torque_of(model, x[:30])))


def test_model_refuses_another_rate() -> None:
    """The message names both rates; a rounding difference passes."""
    model = make_model("lstm")
    model.check_rate(0.0050001)
    with pytest.raises(SamplingRateError, match="200 Hz and cannot run at 100 Hz"):
        model.check_rate(0.01)


def test_load_refuses_what_is_no_model(tmp_path: Path) -> None:
    """A missing file, foreign safetensors, weights of another kind and NaN are named with the remedy."""
    with pytest.raises(NetworkFileError, match="no such model"):
        load(tmp_path / "none.safetensors")
    foreign = tmp_path / "foreign.safetensors"
    save_file({"a": torch.zeros(2)}, str(foreign))
    with pytest.raises(NetworkFileError, match="no learned torque model"):
        load(foreign)
    model = make_model("mlp")
    meta = {META: json.dumps({**model.description(), "kind": "lstm"})}
    save_file(dict(model.net.state_dict()), str(foreign), metadata=meta)
    with pytest.raises(NetworkFileError, match="incomplete"):
        load(foreign)
    with torch.no_grad():
        next(model.net.parameters()).fill_(float("nan"))
    save(model, tmp_path / "nan.safetensors")
    with pytest.raises(NetworkFileError, match="no numbers"):
        load(tmp_path / "nan.safetensors")
