"""Policies outside training: ONNX export with what is needed to run them, and a runtime for play and evaluation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import onnx
import onnxruntime
import torch
from tensordict import TensorDict
from torch import nn

from mrwarp.env.observations import actor_terms
from mrwarp.nn.network_file import write_onnx
from mrwarp.options.json_file import shown
from mrwarp.resources import DEFAULT_POLICY, POLICIES  # noqa: F401  (where policies are looked for)
from mrwarp.rl.policy_file import REMEDY, PolicyError, read_policy, robot_of
from mrwarp.run_dir import one_line

LAYERS = ("Add", "Constant", "Div", "Elu", "Gemm", "Identity", "Mul", "Relu", "Sub", "Tanh")
"""Operators that a policy may consist of: none of them makes more numbers than it takes."""

MAX_JOINTS = 64
"""Most joints of a robot that a policy may be made for."""


def export_onnx(actor: Any, path: Path, description: dict[str, Any]) -> None:
    """Write the actor with its normaliser as ONNX: input ``obs`` (N, 11 + 3*J + C), output ``actions`` (N, J + C).

    The ``description`` is stored as metadata: what a user needs to run it, e.g. action scale, gains, command.
    """
    model = actor.as_onnx(verbose=False).to("cpu").eval()
    inputs = model.get_dummy_inputs()
    observed, given = inputs[0].shape[1], model(*inputs).shape[1]
    joints = (observed - given - sum(actor_terms(0).values())) // 2  # actor_terms is linear in joints and currents
    description = {"observations": actor_terms(joints, given - joints), **description}
    write_onnx(model, inputs, path, input="obs", output="actions", description=description)


class OnnxPolicy:
    """An exported policy as a function of torch tensors.

    ``onnxruntime`` runs the file, on one thread of the CPU. An actor as :func:`export_onnx` writes it is run by torch
    instead, once both agree: on the observations' device, and with the bits that the actor has in training, which
    ``onnxruntime`` misses by a rounding that contacts amplify.

    Example:
        >>> import mrwarp
        >>> from mrwarp.resources import DEFAULT_POLICY
        >>> policy = mrwarp.OnnxPolicy(DEFAULT_POLICY)
        >>> env = mrwarp.WalkEnv(mrwarp.TaskCfg(num_envs=2))
        >>> policy(env.get_observations()).shape
        torch.Size([2, 12])

    Args:
        path: A file that :func:`export_onnx` wrote.

    Attributes:
        description: The metadata.
        joints: Joints J of the robot it was trained on.
        currents: Coils C whose current it commands.
        file: USD file of a robot of one's own that it was trained on; None: a shipped robot.

    Raises:
        PolicyError: the file is missing, no ONNX, has another interface or layers that a policy does not have,
            or does not run.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = path = Path(path)
        proto, self.description = read_policy(path)
        self._check_observations()
        self.joints = self.description["observations"]["q"]
        self.currents = self.description["observations"]["action"] - self.joints
        self.file = robot_of(self.description)
        nodes, weights = proto.graph.node, proto.graph.initializer
        if any(w.data_location == onnx.TensorProto.EXTERNAL for w in weights):
            raise PolicyError(f"{path}: weights in other files; export it again, as one file")
        if foreign := next((node.op_type for node in nodes if node.op_type not in LAYERS), None):
            raise PolicyError(f"{path}: layer {shown(foreign)} is not one of {', '.join(LAYERS)}; {REMEDY}")
        self._net, self._device = None, torch.device("cpu")
        probe = torch.linspace(-3.0, 3.0, sum(self.description["observations"].values())).reshape(1, -1)
        try:  # the checker lets shapes and types pass that numpy, torch or onnxruntime do not have
            self._input = proto.graph.input[0].name
            self._weights = {w.name: torch.from_numpy(onnx.numpy_helper.to_array(w).copy()) for w in weights}
            self._session = _session(proto.SerializeToString())
            actions = self(probe)
        except Exception as error:  # onnxruntime has a type of error for each of its status codes
            raise PolicyError(f"{path}: does not run ({one_line(error)}); {REMEDY}") from error
        if actions.shape != (1, self.joints + self.currents):
            needed = (1, self.joints + self.currents)
            raise PolicyError(
                f"{path}: gives actions of shape {tuple(actions.shape)}, needed is {needed}; train it again"
            )
        self._divisors = [node.input[1] for node in nodes if node.op_type == "Div"]
        self._net = self._as_torch([node.op_type for node in nodes], probe, actions)

    def _check_observations(self) -> None:
        """Refuse a policy whose observations are not those of this version."""
        found = self.description.get("observations")
        joints, actions = (found.get("q"), found.get("action")) if isinstance(found, dict) else (None, None)
        if (
            not (isinstance(joints, int) and isinstance(actions, int))
            or not 1 <= joints <= MAX_JOINTS
            or not 0 <= actions - joints <= joints
            or found != actor_terms(joints, actions - joints)
        ):
            raise PolicyError(
                f"{self.path}: made for observations {shown(found)}, this version gives {actor_terms(12)} "
                "to a robot of 12 joints; train it again"
            )

    @torch.no_grad()
    def __call__(self, obs: TensorDict | torch.Tensor) -> torch.Tensor:
        """Actions (E, J + C) for observations (the ``actor`` group, or a tensor (E, 11 + 3*J + C))."""
        x = obs["actor"] if isinstance(obs, TensorDict) else obs
        if x.shape[1] != sum(self.description["observations"].values()):
            what = f" whose {self.currents} coil currents it commands (--current-by learned)" if self.currents else ""
            raise PolicyError(
                f"{self.path}: made for a robot of {self.joints} joints{what}, not for this one; train it again"
            )
        if self._net is not None:
            if x.device != self._device:
                self._net, self._device = self._net.to(x.device), x.device
            return self._net(x)
        (actions,) = self._session.run(None, {self._input: x.cpu().numpy()})
        return torch.from_numpy(actions).to(x.device)

    def actor(self) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """Weights under the actor's own names, and what its normaliser divides by, shape (1, 11 + 3*J + C).

        Raises:
            KeyError: it has no normaliser.
        """
        if len(self._divisors) != 1 or self._divisors[0] not in self._weights:
            raise KeyError("an observation normaliser")
        named = {name: value for name, value in self._weights.items() if name != self._divisors[0]}
        return named, self._weights[self._divisors[0]]

    @torch.no_grad()
    def _as_torch(self, layers: list[str], probe: torch.Tensor, actions: torch.Tensor) -> nn.Module | None:
        """The actor in torch; None for another graph, by its layers or by the actions it gave."""
        if layers[:2] != ["Sub", "Div"] or any(layer not in ("Gemm", "Elu") for layer in layers[2:]):
            return None
        try:
            weights, divisor = self.actor()
            net = nn.Sequential(_Normaliser(weights["obs_normalizer._mean"], divisor))
            for k, operator in enumerate(layers[2:]):
                layer: nn.Module = nn.ELU()
                if operator == "Gemm":
                    weight, bias = weights[f"mlp.{k}.weight"], weights[f"mlp.{k}.bias"]
                    layer = nn.Linear(weight.shape[1], weight.shape[0])
                    layer.load_state_dict({"weight": weight, "bias": bias})
                net.append(layer)
            agrees = torch.allclose(net(probe), actions, rtol=1e-4, atol=1e-4)
        except (KeyError, RuntimeError, TypeError, ValueError):
            return None
        return net if agrees else None


class _Normaliser(nn.Module):
    """Observations less their mean, divided."""

    def __init__(self, mean: torch.Tensor, divisor: torch.Tensor) -> None:
        super().__init__()
        self.mean, self.divisor = nn.Buffer(mean), nn.Buffer(divisor)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return (x - self.mean) / self.divisor


def _session(model: bytes) -> onnxruntime.InferenceSession:
    """A session on one thread, whose sums do not depend on the machine's cores, and which says nothing itself."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
