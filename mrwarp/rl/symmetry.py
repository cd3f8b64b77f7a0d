"""Networks that treat left and right in the same way, by their weights: equivariant actor, invariant critic.

A network f is equivariant if f(M x) = M f(x) for the mirror M. With hidden units in pairs that M exchanges, this is a
linear condition on each layer: W = P W Q, with signed permutations P of its outputs and Q of its inputs. Weights that
meet it at first keep meeting it if each gradient is replaced by its average with its mirror image: Adam treats a
number and its image identically. So networks, files and speed stay those of plain ones, and a step learns from a
sample and from its mirror image at once. rsl-rl's data augmentation doubles the batch instead, and only approaches
the symmetry.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from rsl_rl.models import MLPModel
from torch import nn

from mrwarp.rl.mirror import Mirror, SignedPermutation

ROUNDING = 1e-5
"""Largest difference of a symmetric network's weights from their mirror image, as a share of the largest weight: a
hundred float32 roundings. Weights of a plain network differ by their own size."""


class SymmetricNetwork:
    """Keeps a plain network equivariant.

    Args:
        model: Its layers are linear, with an even number of units in each hidden one.
        seen: Mirror image of its inputs, of all observation groups together.
        given: Mirror image of its outputs.

    Raises:
        ValueError: a hidden layer has an odd number of units.
    """

    def __init__(self, model: MLPModel, seen: SignedPermutation, given: SignedPermutation) -> None:
        layers = [layer for layer in model.mlp if isinstance(layer, nn.Linear)]
        device = layers[0].weight.device
        images: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        before = seen
        for layer in layers:
            units = layer.weight.shape[0]
            if layer is not layers[-1] and units % 2:
                raise ValueError(
                    f"a hidden layer of {units} units: a mirror exchanges them in pairs, take an even number"
                )
            pairs = SignedPermutation(index=np.roll(np.arange(units), units // 2), sign=np.ones(units))
            after = given if layer is layers[-1] else pairs
            place = np.arange(layer.weight.numel()).reshape(layer.weight.shape)
            images[id(layer.weight)] = (place[np.ix_(after.index, before.index)], np.outer(after.sign, before.sign))
            images[id(layer.bias)] = (after.index, after.sign)
            before = after
        index, sign, start = [], [], 0
        for parameter in model.parameters():
            if id(parameter) not in images:  # the deviation of the actions, which has no sign
                images[id(parameter)] = (given.index, np.ones(len(given.index)))
            own, signs = images[id(parameter)]
            index.append(own.ravel() + start)
            sign.append(signs.ravel())
            start += parameter.numel()
        self._model = model
        self._index = torch.from_numpy(np.concatenate(index)).to(device)
        self._sign = torch.from_numpy(np.concatenate(sign)).to(device, torch.float32)
        self._seen_index = torch.from_numpy(seen.index).to(device)
        self._seen_sign = torch.from_numpy(seen.sign).to(device, torch.float32)

    @torch.no_grad()
    def average(self, row: torch.Tensor) -> None:
        """Replace numbers of all parameters, in their order in one row, by their average with their mirror image."""
        row.add_(row[self._index] * self._sign).mul_(0.5)

    @torch.no_grad()
    def holds(self) -> bool:
        """Whether the weights are equivariant as they are, to rounding."""
        row = nn.utils.parameters_to_vector(self._model.parameters())
        return bool((row - row[self._index] * self._sign).abs().max() <= ROUNDING * row.abs().max())

    @torch.no_grad()
    def begin(self, *, drawn: bool) -> None:
        """Make the weights equivariant; ``drawn``: keep the spread of weights that were drawn at random."""
        row = nn.utils.parameters_to_vector(self._model.parameters())
        self.average(row)
        parameters = list(self._model.parameters())
        for parameter, part in zip(parameters, row.split([p.numel() for p in parameters]), strict=True):
            factor = math.sqrt(2.0) if drawn and parameter.ndim == 2 else 1.0
            parameter.copy_(part.view_as(parameter) * factor)
        self.average_normaliser()

    @torch.no_grad()
    def average_normaliser(self) -> None:
        """Give the observations' mean and variance those of the observations and their mirror images together."""
        normaliser: Any = self._model.obs_normalizer
        mean, var = normaliser._mean, normaliser._var
        image = mean[:, self._seen_index] * self._seen_sign
        both = 0.5 * (mean + image)
        var = 0.5 * (var + var[:, self._seen_index]) + (0.5 * (mean - image)).square()
        normaliser._mean.copy_(both)
        normaliser._var.copy_(var)
        normaliser._std.copy_(var.sqrt())


def symmetric_networks(actor: MLPModel, critic: MLPModel, mirror: Mirror) -> tuple[SymmetricNetwork, SymmetricNetwork]:
    """Those of PPO: the mirrored robot's action is the mirrored action, its value the same."""
    return (
        SymmetricNetwork(actor, mirror.actor, mirror.action),
        SymmetricNetwork(critic, mirror.critic, SignedPermutation.keep(1.0)),
    )
