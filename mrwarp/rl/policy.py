"""Policies outside training: ONNX export with what is needed to run them, and a runtime for play and evaluation."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from tensordict import TensorDict

from mrwarp.env.observations import ACTOR_TERMS
from mrwarp.model_file import shown
from mrwarp.resources import DEFAULT_POLICY, POLICIES  # noqa: F401  (where policies are looked for)
from mrwarp.run_dir import atomic_write, no_file
from mrwarp.usd.robot import JOINTS

META = "mrwarp"
"""Key of the ONNX metadata entry that holds the policy's description as JSON."""


class PolicyError(ValueError):
    """A policy file cannot be used; the message names the file and the remedy."""


def export_onnx(actor: Any, path: Path, description: dict[str, Any]) -> None:
    """Write the actor with its normaliser as ONNX: input ``obs`` (N, 47), output ``actions`` (N, 12).

    Args:
        actor: The rsl-rl actor model.
        path: File to write.
        description: What a user needs to run it, e.g. action scale, gains, command that made it; stored as metadata.
    """
    model = actor.as_onnx(verbose=False).to("cpu").eval()
    with atomic_write(path) as partial, warnings.catch_warnings():
        # deprecated, but its graph is the net's few layers by name, which is what OnnxPolicy reads
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            model, model.get_dummy_inputs(), str(partial), input_names=["obs"], output_names=["actions"],
            opset_version=18, dynamo=False, dynamic_axes={"obs": {0: "n"}, "actions": {0: "n"}},
        )  # fmt: skip
        proto = onnx.load(str(partial))
        onnx.helper.set_model_props(proto, {META: json.dumps({"observations": ACTOR_TERMS, **description})})
        onnx.save(proto, str(partial))


class OnnxPolicy:
    """An exported policy as a plain torch function: reads the ONNX file as data and runs its few layers.

    Args:
        path: A file that :func:`export_onnx` wrote.

    Raises:
        PolicyError: the file is missing, no ONNX, has another interface or layers that a policy does not have,
            or does not run.
    """

    def __init__(self, path: str | Path) -> None:
        path = Path(path)
        if not path.is_file():
            raise PolicyError(f"{path}: {no_file(path, 'policy')}; name an .onnx file that train/ppo.py wrote")
        try:
            proto = onnx.load(str(path), load_external_data=False)
            onnx.checker.check_model(proto)
        except Exception as error:  # onnx and protobuf raise many types for a file that is no model
            cause = " ".join(str(error).split())
            raise PolicyError(f"{path}: not a readable ONNX model ({cause}); export it again") from error
        props = {entry.key: entry.value for entry in proto.metadata_props}
        if META not in props:
            raise PolicyError(f"{path}: no mrwarp metadata; use a policy exported by train/ppo.py")
        self.path = path
        try:
            self.description: dict[str, Any] = dict(json.loads(props[META]))
            dict(self.description.get("task", {}))
        except (ValueError, TypeError, RecursionError) as error:
            cause = " ".join(str(error).split())
            raise PolicyError(f"{path}: unreadable mrwarp metadata ({cause}); export it again") from error
        if self.description.get("observations") != ACTOR_TERMS:
            raise PolicyError(
                f"{path}: made for observations {shown(self.description.get('observations'))}, this version gives "
                f"{ACTOR_TERMS}; train it again"
            )
        if any(w.data_location == onnx.TensorProto.EXTERNAL for w in proto.graph.initializer):
            raise PolicyError(f"{path}: weights in other files; export it again, as one file")
        try:
            self._weights = {
                w.name: torch.from_numpy(onnx.numpy_helper.to_array(w).copy()) for w in proto.graph.initializer
            }
        except Exception as error:  # the checker lets shapes and types pass that numpy or torch do not have
            cause = " ".join(str(error).split())
            raise PolicyError(f"{path}: unreadable weights ({cause}); export it again") from error
        self._on: dict[torch.device, dict[str, torch.Tensor]] = {}
        self._nodes = list(proto.graph.node)
        for node in self._nodes:
            if node.op_type not in _OPS:
                raise PolicyError(
                    f"{path}: layer {shown(node.op_type)} is not one of {', '.join(sorted(_OPS))}; "
                    "use a policy exported by train/ppo.py"
                )
        if not (proto.graph.input and proto.graph.output):
            raise PolicyError(f"{path}: no input or no output; export it again")
        self._input, self._output = proto.graph.input[0].name, proto.graph.output[0].name
        self._try()

    def _try(self) -> None:
        """Run once: a graph of other layers or sizes fails in as many ways as torch knows."""
        try:
            shape = tuple(self(torch.zeros(1, sum(ACTOR_TERMS.values()))).shape)
        except Exception as error:
            cause = " ".join(str(error).split())
            raise PolicyError(f"{self.path}: does not run ({cause}); use a policy exported by train/ppo.py") from error
        if shape != (1, len(JOINTS)):
            raise PolicyError(
                f"{self.path}: gives actions of shape {shape}, needed is {(1, len(JOINTS))}; train it again"
            )

    @torch.no_grad()
    def __call__(self, obs: TensorDict | torch.Tensor) -> torch.Tensor:
        """Actions (E, 12) for observations (the ``actor`` group, or a tensor (E, 47))."""
        x = obs["actor"] if isinstance(obs, TensorDict) else obs
        if x.device not in self._on:
            self._on[x.device] = {name: weight.to(x.device) for name, weight in self._weights.items()}
        values = {**self._on[x.device], self._input: x}
        for node in self._nodes:
            attributes = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
            found = _OPS[node.op_type](attributes, *(values[name] for name in node.input))
            values[node.output[0]] = found.to(x.device)
        return values[self._output]

    def actor(self) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Weights under the actor's own names, and what its normaliser divides by, shape (1, 47).

        Raises:
            KeyError: it has no normaliser.
        """
        divisors = [node.input[1] for node in self._nodes if node.op_type == "Div"]
        if len(divisors) != 1 or divisors[0] not in self._weights:
            raise KeyError("an observation normaliser")
        named = {name: value for name, value in self._weights.items() if name != divisors[0]}
        return named, self._weights[divisors[0]]


def _gemm(attributes: dict[str, Any], x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    weight = weight.t() if attributes.get("transB") else weight
    return attributes.get("alpha", 1.0) * (x @ weight) + attributes.get("beta", 1.0) * bias


def _constant(attributes: dict[str, Any]) -> torch.Tensor:
    return torch.from_numpy(np.array(onnx.numpy_helper.to_array(attributes["value"])))


_OPS: dict[str, Any] = {
    "Add": lambda _, a, b: a + b,
    "Sub": lambda _, a, b: a - b,
    "Mul": lambda _, a, b: a * b,
    "Div": lambda _, a, b: a / b,
    "Identity": lambda _, a: a,
    "Constant": _constant,
    "Gemm": _gemm,
    "Elu": lambda attributes, a: torch.nn.functional.elu(a, attributes.get("alpha", 1.0)),
    "Tanh": lambda _, a: torch.tanh(a),
    "Relu": lambda _, a: torch.relu(a),
}
"""The layers a policy consists of."""
