"""Exported policies: the ONNX file equals the torch actor, carries what is needed to run it, and nothing else runs."""

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import onnx
import onnx.reference
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper
from rsl_rl.algorithms import PPO
from tensordict import TensorDict

from mrwarp.env.cfg import TaskCfg
from mrwarp.env.observations import actor_terms
from mrwarp.resources import META
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy, PolicyError, export_onnx
from mrwarp.rl.ppo_cfg import make_ppo_cfg
from mrwarp.rl.task_record import record

TASK = record(TaskCfg(seed=3))


def observations(count: int, seed: int, scale: float = 1.0) -> TensorDict:
    """Random observations of both groups."""
    generator = torch.Generator().manual_seed(seed)
    groups = {
        name: scale * torch.randn(count, size, generator=generator) for name, size in (("actor", 47), ("critic", 82))
    }
    return TensorDict(groups, batch_size=[count])


@pytest.fixture(scope="module")
def actor() -> Any:
    """An actor as training makes it, with observation statistics that are not trivial."""
    torch.manual_seed(0)
    env: Any = SimpleNamespace(num_envs=4, num_actions=12)
    algorithm = PPO.construct_algorithm(observations(4, 0), env, make_ppo_cfg(4), "cpu")
    model = algorithm.get_policy()
    shifted = observations(500, 1, 3.0)
    shifted["actor"] += torch.linspace(-2.0, 2.0, 47)
    model.update_normalization(shifted)
    return model


@pytest.fixture(scope="module")
def exported(actor: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The actor's ONNX file; tests only read it."""
    path = tmp_path_factory.mktemp("policy") / "policy.onnx"
    export_onnx(actor, path, {"task": TASK, "seed": 3, "iteration": 7, "command": "python train/ppo.py"})
    return path


def edited(source: Path, target: Path, change: Any) -> Path:
    """A copy of a policy file with its protobuf changed."""
    proto = onnx.load(str(source))
    change(proto)
    target.write_bytes(proto.SerializeToString())
    return target


@pytest.mark.parametrize(("count", "scale"), [(1, 1.0), (7, 1.0), (300, 4.0)])
def test_exported_policy_equals_the_actor(actor: Any, exported: Path, count: int, scale: float) -> None:
    """Same actions as the torch actor without exploration, normaliser included, for any batch size."""
    obs = observations(count, 5, scale)
    with torch.no_grad():
        expected = actor(obs)
    run = OnnxPolicy(exported)
    found = run(obs)
    assert found.shape == (count, 12) and found.dtype == torch.float32
    # three float32 layers of up to 128 products: 1e-6 relative to actions of order one
    torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-5)
    assert torch.equal(run(obs["actor"]), found)  # a plain tensor does as well


@pytest.mark.parametrize("activation", ["Elu", "Tanh"])
def test_exported_policy_agrees_with_onnxs_own_evaluator(exported: Path, tmp_path: Path, activation: str) -> None:
    """An independent runtime reads the same function from the file, also from one that training does not write."""

    def change(proto: onnx.ModelProto) -> None:
        for node in proto.graph.node:
            if node.op_type == "Elu" != activation:
                node.op_type = activation
                node.ClearField("attribute")

    path, obs = edited(exported, tmp_path / "p.onnx", change), observations(9, 6, 2.0)
    reference = onnx.reference.ReferenceEvaluator(str(path))
    expected = np.asarray(reference.run(None, {"obs": obs["actor"].numpy()})[0])
    np.testing.assert_allclose(OnnxPolicy(path)(obs).numpy(), expected, rtol=1e-5, atol=1e-5)


def test_a_shipped_policy_has_the_actors_bits() -> None:
    """The bits of the layers as torch computes them in training."""
    run, obs = OnnxPolicy(DEFAULT_POLICY), observations(64, 6)["actor"]
    weights, divisor = run.actor()
    expected = (obs - weights["obs_normalizer._mean"]) / divisor
    for k in (0, 2, 4):
        expected = torch.nn.functional.linear(expected, weights[f"mlp.{k}.weight"], weights[f"mlp.{k}.bias"])
        expected = torch.nn.functional.elu(expected) if k < 4 else expected
    assert torch.equal(run(obs), expected)


def test_export_leaves_the_actor_training(actor: Any, exported: Path) -> None:
    """Exporting in the middle of a training changes no parameter and no mode."""
    assert exported.is_file()
    before = {name: value.clone() for name, value in actor.state_dict().items()}
    mode = actor.training
    export_onnx(actor, exported.with_name("again.onnx"), {})
    assert actor.training == mode
    for name, value in actor.state_dict().items():
        assert torch.equal(value, before[name]), name


def test_metadata_say_what_the_policy_is_for(exported: Path) -> None:
    """Task, seed, command and the observation layout travel in the file, as JSON."""
    description = OnnxPolicy(exported).description
    assert description["task"] == TASK
    assert description["observations"] == actor_terms(12)
    assert (description["seed"], description["iteration"]) == (3, 7)
    assert description["command"] == "python train/ppo.py"
    assert {"robot", "actuator", "coupling", "action_scale", "step_dt", "gait_frequency"} <= set(description["task"])
    proto = onnx.load(str(exported))
    assert [value.name for value in (*proto.graph.input, *proto.graph.output)] == ["obs", "actions"]


def refusal(path: Path) -> str:
    """The message with which a file is refused; it names the file."""
    with pytest.raises(PolicyError) as info:
        OnnxPolicy(path)
    assert str(info.value).startswith(f"{path}: ") and "\n" not in str(info.value)
    return str(info.value)


def test_weights_in_another_file_are_refused(exported: Path, tmp_path: Path) -> None:
    """A policy is one file: it cannot make the reader open another path."""
    secret = tmp_path / "weights.bin"
    secret.write_bytes(bytes(4 * 12))

    def change(proto: onnx.ModelProto) -> None:
        weight = next(w for w in proto.graph.initializer if list(w.dims) == [12])
        name = weight.name
        weight.CopyFrom(numpy_helper.from_array(np.zeros(12, dtype=np.float32), name))
        weight.ClearField("raw_data")
        weight.data_location = TensorProto.EXTERNAL
        weight.external_data.add(key="location", value=secret.name)

    refusal(edited(exported, tmp_path / "p.onnx", change))


def meta(text: str) -> Any:
    """A change of a policy's metadata."""
    return lambda proto: helper.set_model_props(proto, {META: text})


def sigmoid(proto: onnx.ModelProto) -> None:
    """Make a layer another one than a policy has."""
    node = next(node for node in proto.graph.node if node.op_type == "Elu")
    node.op_type = "Sigmoid"
    node.ClearField("attribute")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda proto: proto.ClearField("metadata_props"), "no mrwarp metadata"),
        *((meta(text), "metadata") for text in ("{", "[1, 2]", "3", '"text"')),
        (meta(json.dumps({"observations": {**actor_terms(12), "gyro": 4}})), "made for observations.*train it again"),
        (meta(json.dumps({"observations": {"gy" + 100_000 * "(": 3}})), "train it again"),
        (sigmoid, "'Sigmoid'.*Gemm.*mrwarp train|Gemm.*'Sigmoid'.*mrwarp train"),
        (lambda proto: proto.graph.initializer[0].ClearField("dims"), "does not run|not a readable"),
        (lambda proto: proto.graph.ClearField("output"), "does not run|not a readable"),
        (lambda proto: proto.graph.node[-1].ClearField("attribute"), "does not run|gives actions of shape"),
        (lambda proto: setattr(proto.graph.output[0], "name", "obs"), "gives actions of shape|not a readable"),
    ],
)
def test_another_policy_is_refused_when_loaded(exported: Path, tmp_path: Path, change: Any, words: str) -> None:
    """Unlabelled, of another observation, of other layers, or a graph that ONNX's own checker lets pass: one line."""
    message = refusal(edited(exported, tmp_path / "p.onnx", change))
    assert re.search(words, message) and len(message) < 1000
