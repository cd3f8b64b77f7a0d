"""The learned torque in the loop: which windows are open, and the MLP and LSTM over one window per thread.

A network is evaluated only for devices whose dynamic gate is open. Each window is computed on its own, in one fixed
order of operations, so its bits do not depend on which other windows are open. Inputs are the raw features: the
standardisation is folded into the first layer's weights.

The launch has a fixed size, the capacity, which may be smaller than the number of open windows: then a thread takes
another one when it is done. So a graph needs no number from the device, and no window is left out.

These kernels run on any device; on a CPU ``lstm_lanes`` does the LSTM thirty times as fast.
"""

import warp as wp

from mrwarp.kernels.window import FEATURES, window_row

HIDDEN = 64
"""Hidden units of the LSTM and of each layer of the MLP, paper section 4.1."""

GATES = 4
"""Gates of an LSTM cell in torch's order: input, forget, cell, output."""

MLP_SAMPLES = 3
"""Samples that the MLP sees, paper section 4.1."""


@wp.func
def sigmoid(x: float) -> float:
    """1/(1 + exp(-x)), without overflow."""
    return 0.5 + 0.5 * wp.tanh(0.5 * x)


@wp.kernel
def open_windows_kernel(
    # parameters: 1 = take closed ones too (to check that nothing depends on the choice)
    take_all: int,
    # in, shape (E, M)
    m_dyn_in: wp.array2d[float],
    # out, shape (1,), zeroed before; (E*M,): flat indices env*M + joint of the windows to evaluate
    count_out: wp.array[int],
    index_out: wp.array[int],
):
    """Gather the windows whose dynamic gate is open."""
    env, joint = wp.tid()
    if take_all == 1 or m_dyn_in[env, joint] > 0.0:
        place = wp.atomic_add(count_out, 0, 1)
        index_out[place] = env * m_dyn_in.shape[1] + joint


@wp.func
def write_torque(m_dyn: float, tau_bw: float, learned: float, replace: int) -> float:
    """Torque prediction [N·m]: tau_BW + residual (eq. 16) or the learned torque itself, where the gate is open."""
    if m_dyn > 0.0:
        if replace == 1:
            return learned
        return tau_bw + learned
    return tau_bw


@wp.kernel
def lstm_window_kernel(
    # parameters: rows (bias, features, hidden) of each unit's gates, shape (HIDDEN, 1 + FEATURES + HIDDEN, GATES);
    # output layer, shape (HIDDEN + 1,), bias last; 1 = the network gives the whole torque, 0 = a residual
    weights: wp.array3d[float],
    readout: wp.array[float],
    replace: int,
    # in, shape (1,), (E*M,), (1,), (E, M, WINDOW, FEATURES), (E, M), (E, M)
    count_in: wp.array[int],
    index_in: wp.array[int],
    head_in: wp.array[int],
    ring_in: wp.array4d[float],
    m_dyn_in: wp.array2d[float],
    tau_dyn_in: wp.array2d[float],
    # out, scratch of shape (3, HIDDEN, capacity), then shape (E, M) [N·m]
    scratch_out: wp.array3d[float],
    tau_dyn_out: wp.array2d[float],
):
    """LSTM over one window after the other (table 1); with room for all, one thread per open window."""
    place, capacity = wp.tid(), scratch_out.shape[2]
    for i in range(place, count_in[0], capacity):
        env, joint = index_in[i] // m_dyn_in.shape[1], index_in[i] % m_dyn_in.shape[1]
        length = ring_in.shape[2]
        for unit in range(HIDDEN):
            scratch_out[0, unit, place] = 0.0
            scratch_out[2, unit, place] = 0.0
        for sample in range(length):
            row = window_row(sample, head_in[0], length)
            before, after = sample % 2, 1 - sample % 2
            for unit in range(HIDDEN):
                gates = wp.vec4(weights[unit, 0, 0], weights[unit, 0, 1], weights[unit, 0, 2], weights[unit, 0, 3])
                for k in range(1, 1 + FEATURES + HIDDEN):
                    x = float(0.0)
                    if k <= FEATURES:
                        x = ring_in[env, joint, row, k - 1]
                    else:
                        x = scratch_out[before, k - 1 - FEATURES, place]
                    own = wp.vec4(weights[unit, k, 0], weights[unit, k, 1], weights[unit, k, 2], weights[unit, k, 3])
                    gates += x * own
                cell = sigmoid(gates[1]) * scratch_out[2, unit, place] + sigmoid(gates[0]) * wp.tanh(gates[2])
                scratch_out[2, unit, place] = cell
                scratch_out[after, unit, place] = sigmoid(gates[3]) * wp.tanh(cell)
        learned = float(readout[HIDDEN])
        for unit in range(HIDDEN):
            learned += readout[unit] * scratch_out[length % 2, unit, place]
        tau_dyn_out[env, joint] = write_torque(m_dyn_in[env, joint], tau_dyn_in[env, joint], learned, replace)


@wp.kernel
def mlp_window_kernel(
    # parameters: layers with the bias as the last column, shape (HIDDEN, MLP_SAMPLES*FEATURES + 1),
    # (HIDDEN, HIDDEN + 1) and (1, HIDDEN + 1); 1 = the network gives the whole torque, 0 = a residual
    layer1: wp.array2d[float],
    layer2: wp.array2d[float],
    layer3: wp.array2d[float],
    replace: int,
    # in, shape (1,), (E*M,), (1,), (E, M, WINDOW, FEATURES), (E, M), (E, M)
    count_in: wp.array[int],
    index_in: wp.array[int],
    head_in: wp.array[int],
    ring_in: wp.array4d[float],
    m_dyn_in: wp.array2d[float],
    tau_dyn_in: wp.array2d[float],
    # out, scratch of shape (2, HIDDEN, capacity), then shape (E, M) [N·m]
    scratch_out: wp.array3d[float],
    tau_dyn_out: wp.array2d[float],
):
    """MLP over the newest three samples of one window after the other; with room for all, one thread per window."""
    place, capacity = wp.tid(), scratch_out.shape[2]
    for i in range(place, count_in[0], capacity):
        env, joint = index_in[i] // m_dyn_in.shape[1], index_in[i] % m_dyn_in.shape[1]
        length = ring_in.shape[2]
        for unit in range(HIDDEN):
            total = float(layer1[unit, MLP_SAMPLES * FEATURES])
            for sample in range(MLP_SAMPLES):
                row = window_row(length - MLP_SAMPLES + sample, head_in[0], length)
                for k in range(FEATURES):
                    total += layer1[unit, sample * FEATURES + k] * ring_in[env, joint, row, k]
            scratch_out[0, unit, place] = wp.tanh(total)
        learned = float(layer3[0, HIDDEN])
        for unit in range(HIDDEN):
            total = float(layer2[unit, HIDDEN])
            for k in range(HIDDEN):
                total += layer2[unit, k] * scratch_out[0, k, place]
            learned += layer3[0, unit] * wp.tanh(total)
        tau_dyn_out[env, joint] = write_torque(m_dyn_in[env, joint], tau_dyn_in[env, joint], learned, replace)
