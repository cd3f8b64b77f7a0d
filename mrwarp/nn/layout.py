"""Weights of the learned torque models as their kernels want them, the standardisation folded in."""

from __future__ import annotations

import numpy as np
import torch

from mrwarp.kernels import learned_torque as learned
from mrwarp.kernels import lstm_lanes
from mrwarp.kernels.learned_torque import FEATURES, WINDOW
from mrwarp.nn.models import LstmTorque


def lstm_weights(state: dict[str, np.ndarray]) -> np.ndarray:
    """LSTM weights as ``lstm_window_kernel`` wants them, float64, shape (HIDDEN, 1 + FEATURES + HIDDEN, 4).

    The standardisation is folded in: W (x - mean)/std + b = (W/std) x + (b - W mean/std).
    """
    scale, mean = 1.0 / state["scaler.std"], state["scaler.mean"]
    w_in = state["lstm.weight_ih_l0"] * scale
    bias = state["lstm.bias_ih_l0"] + state["lstm.bias_hh_l0"] - w_in @ mean
    rows = np.concatenate([bias[:, None], w_in, state["lstm.weight_hh_l0"]], axis=1)
    return rows.reshape(learned.GATES, learned.HIDDEN, -1).transpose(1, 2, 0)


def lane_weights(weights: np.ndarray) -> np.ndarray:
    """Weights of :func:`lstm_weights` for ``lstm_lanes_kernel``, flat: [fours of units][row][gate][unit of four]."""
    hidden, rows, gates = weights.shape
    return weights.reshape(hidden // lstm_lanes.UNITS, lstm_lanes.UNITS, rows, gates).transpose(0, 2, 3, 1).reshape(-1)


def output_layer(state: dict[str, np.ndarray]) -> np.ndarray:
    """Output weights with the bias last, shape (HIDDEN + 1,)."""
    return np.concatenate([state["out.weight"][0], state["out.bias"]])


def mlp_layers(state: dict[str, np.ndarray]) -> list[np.ndarray]:
    """The MLP's three layers with the bias as the last column, the standardisation folded into the first."""
    layers = [np.concatenate([state[f"net.{i}.weight"], state[f"net.{i}.bias"][:, None]], axis=1) for i in (0, 2, 4)]
    scale = np.tile(1.0 / state["scaler.std"], learned.MLP_SAMPLES)
    mean = np.tile(state["scaler.mean"], learned.MLP_SAMPLES)
    layers[0][:, :-1] *= scale
    layers[0][:, -1] -= layers[0][:, :-1] @ mean
    return layers


@torch.no_grad()
def states_at_rest(net: LstmTorque) -> np.ndarray:
    """Hidden and cell states after resting for all but one sample of a window, without current.

    Returns:
        Shape (2, HIDDEN, REST_POINTS), for displacements evenly from -REST_RANGE to REST_RANGE.
    """
    x = torch.zeros(WINDOW - 1, learned.REST_POINTS, FEATURES)
    x[:, :, 0] = torch.linspace(-learned.REST_RANGE, learned.REST_RANGE, learned.REST_POINTS)
    _, (hidden, cell) = net.lstm(net.scaler(x))
    return torch.stack([hidden[0].T, cell[0].T]).numpy()
