"""Forward and backward pass of a plain network without autograd, in the same memory for every batch.

For a hundred units and a thousand samples autograd's bookkeeping around the matrix products costs as much as these.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from rsl_rl.models import MLPModel
from tensordict import TensorDict
from torch import nn


def linear_layers(model: MLPModel) -> list[nn.Linear]:
    """The layers of a plain network with ELU (of scale 1) after all but the last.

    Raises:
        ValueError: the model is another one.
    """
    layers = list(model.mlp) if type(model) is MLPModel else []
    linear = [layer for layer in layers[::2] if isinstance(layer, nn.Linear)]
    between = [layer for layer in layers[1::2] if isinstance(layer, nn.ELU) and layer.alpha == 1.0]
    if not linear or len(linear) != len(between) + 1 or len(linear) + len(between) != len(layers):
        raise ValueError(f"need an MLPModel of linear layers with ELU between them, got {type(model).__name__} {model}")
    return linear


def output(layers: list[nn.Linear], inputs: torch.Tensor) -> torch.Tensor:
    """The network's output, shape (batch, outputs), from :func:`linear_layers` and normalised inputs; no autograd."""
    for layer in layers[:-1]:
        inputs = nn.functional.elu_(nn.functional.linear(inputs, layer.weight, layer.bias))
    return nn.functional.linear(inputs, layers[-1].weight, layers[-1].bias)


class NetGradient:
    """Forward and backward pass for batches of one size, under ``torch.no_grad()``.

    With x_0 the input, a_k = x_(k-1) W_k^T + b_k and x_k = ELU(a_k), a gradient g_k for a_k gives g_k^T x_(k-1) for
    W_k, the sum of g_k for b_k, and g_(k-1) = g_k W_k * ELU'(a_(k-1)), where ELU'(a) = 1 + min(ELU(a), 0).

    Args:
        model: See :func:`linear_layers`. Its parameters keep their memory as long as this is used.
        batch: Samples of a batch.

    Attributes:
        row: Gradients of all parameters of the model, also of those outside its layers, shape (number of weights,).
        gradients: The part of each parameter in it, which is also its ``grad``.
    """

    def __init__(self, model: MLPModel, batch: int) -> None:
        parameters = list(model.parameters())
        counts = [parameter.numel() for parameter in parameters]
        self.row = parameters[0].new_zeros(sum(counts))
        self.gradients: dict[torch.Tensor, torch.Tensor] = {
            p: part.view_as(p) for p, part in zip(parameters, self.row.split(counts), strict=True)
        }
        for parameter, gradient in self.gradients.items():
            parameter.grad = gradient
        layers = linear_layers(model)
        self._weights = [layer.weight.detach() for layer in layers]
        self._biases = [layer.bias.detach() for layer in layers]
        self._slopes = [(self.gradients[layer.weight], self.gradients[layer.bias]) for layer in layers]
        # on a CPU x^T g is up to twice as fast as g^T x
        self._products = [weight.new_empty(weight.shape[::-1]) for weight in self._weights]
        self._outputs = [weight.new_empty(batch, len(weight)) for weight in self._weights]
        self._backward = [weight.new_empty(batch, weight.shape[1]) for weight in self._weights[1:]]
        self._inputs = self._outputs[:1] + self._outputs[:-1]

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """The network's output, shape (batch, outputs), in memory that the next call writes into.

        Args:
            inputs: Normalised observations, shape (batch, inputs); kept for :meth:`backward`.
        """
        self._inputs[0] = inputs
        last = len(self._outputs) - 1
        for k, out in enumerate(self._outputs):
            torch.addmm(self._biases[k], self._inputs[k], self._weights[k].t(), out=out)
            if k < last:
                nn.functional.elu_(out)
        return self._outputs[-1]

    def backward(self, slope: torch.Tensor) -> None:
        """Fill the gradients of the layers; once after each :meth:`forward`, whose results it uses up.

        Args:
            slope: Gradient for the output, shape (batch, outputs).
        """
        for k in range(len(self._weights) - 1, -1, -1):
            inputs, (of_weight, of_bias) = self._inputs[k], self._slopes[k]
            of_weight.copy_(torch.mm(inputs.t(), slope, out=self._products[k]).t())
            torch.sum(slope, 0, out=of_bias)
            if k > 0:
                slope = torch.mm(slope, self._weights[k], out=self._backward[k - 1])
                slope.addcmul_(slope, inputs.clamp_(max=0.0))


def inputs(model: MLPModel, observations: Mapping[str, torch.Tensor] | TensorDict) -> torch.Tensor:
    """Inputs of the model's first layer: its observation groups side by side, normalised, shape (..., inputs)."""
    groups = [observations[group] for group in model.obs_groups]
    return model.obs_normalizer(groups[0] if len(groups) == 1 else torch.cat(groups, -1))
