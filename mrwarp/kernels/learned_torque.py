"""The learned torque in the loop: the LSTM carried on by one sample per joint, or networks over the open windows.

The carried LSTM takes a thread per four units of four joints, so that a few thousand joints fill a GPU.

A network over windows is evaluated only for devices whose dynamic gate is open. Each joint is computed on its own, in
one fixed order of operations, so its bits do not depend on the others. Inputs are the raw features: the
standardisation is folded into the first layer's weights.

A launch over windows has a fixed size, the capacity, which may be smaller than the number of open windows: then a
thread takes another one when it is done. So a graph needs no number from the device, and no window is left out.

These kernels run on any device; on a CPU ``lstm_lanes`` does the LSTM thirty times as fast.
"""

import warp as wp

WINDOW = 50
"""Samples of history, paper eq. 12: 0.25 s at 200 Hz."""

FEATURES = 3
"""Features per sample: displacement q_c [rad], velocity qd [rad/s], coil current I [A]."""

HIDDEN = 64
"""Hidden units of the LSTM and of each layer of the MLP, paper section 4.1."""

GATES = 4
"""Gates of an LSTM cell in torch's order: input, forget, cell, output."""

UNITS = 4
"""Units, and joints, of one thread of ``lstm_unit_kernel``, which is written for four."""

UNROLLED = 2
"""Hidden units that it reads at once."""

REST_RANGE = 3.1415927
"""Displacements for which states at rest are kept: within half a turn [rad]."""

REST_POINTS = 4097
"""Points of that table; between them the shipped networks' torque is off by less than 1e-3 N·m."""

MLP_SAMPLES = 3
"""Samples that the MLP sees, paper section 4.1."""


@wp.func
def window_row(sample: int, head: int, length: int) -> int:
    """Ring row of the ``sample``-th oldest entry when the newest was written at ``head``."""
    return (head + 1 + sample) % length


@wp.func
def sigmoid(x: float) -> float:
    """1/(1 + exp(-x)), without overflow."""
    return 0.5 + 0.5 * wp.tanh(0.5 * x)


@wp.kernel(enable_backward=False)
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


@wp.kernel(enable_backward=False)
def begin_kernel(
    # in, shape (E,)
    mask_in: wp.array[wp.bool],
    # out, shape (E*M,)
    fresh_out: wp.array[int],
):
    """Reset the joints of masked environments: their next state is made from their history."""
    i = wp.tid()
    if mask_in[i * mask_in.shape[0] // fresh_out.shape[0]]:
        fresh_out[i] = 1


@wp.func
def write_torque(m_dyn: float, tau_bw: float, learned: float, replace: int) -> float:
    """Torque prediction [N·m]: tau_BW + residual (eq. 16) or the learned torque itself, where the gate is open."""
    if m_dyn > 0.0:
        if replace == 1:
            return learned
        return tau_bw + learned
    return tau_bw


@wp.func
def gate_weights(weights: wp.array3d[float], unit: int, k: int) -> wp.vec4:
    """Weights of a unit's four gates for one input."""
    return wp.vec4(weights[unit, k, 0], weights[unit, k, 1], weights[unit, k, 2], weights[unit, k, 3])


@wp.func
def lstm_cell(gates: wp.vec4, unit: int, place: int, after: int, state: wp.array3d[float]) -> float:
    """Write a unit's new cell and hidden state from its gates; returns the hidden one."""
    cell = sigmoid(gates[1]) * state[2, unit, place] + sigmoid(gates[0]) * wp.tanh(gates[2])
    hidden = sigmoid(gates[3]) * wp.tanh(cell)
    state[2, unit, place] = cell
    state[after, unit, place] = hidden
    return hidden


@wp.func
def lstm_sample(
    weights: wp.array3d[float],
    ring: wp.array4d[float],
    env: int,
    joint: int,
    row: int,
    before: int,
    state: wp.array3d[float],
    place: int,
) -> int:
    """One sample of a joint's history through the LSTM; returns the row of ``state`` with the hidden state after it.

    Its rows are the hidden state before the sample (row ``before``, 0 or 1), after it (the other), and the cell state.
    """
    for unit in range(HIDDEN):
        gates = gate_weights(weights, unit, 0)
        for k in range(1, 1 + FEATURES + HIDDEN):
            x = float(0.0)
            if k <= FEATURES:
                x = ring[env, joint, row, k - 1]
            else:
                x = state[before, k - 1 - FEATURES, place]
            gates += x * gate_weights(weights, unit, k)
        lstm_cell(gates, unit, place, 1 - before, state)
    return 1 - before


@wp.func
def lstm_readout(readout: wp.array[float], hidden: int, state: wp.array3d[float], place: int) -> float:
    """Output of the network [N·m] from the hidden state in a row of ``state``."""
    learned = float(readout[HIDDEN])
    for unit in range(HIDDEN):
        learned += readout[unit] * state[hidden, unit, place]
    return learned


@wp.kernel(enable_backward=False)
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
        hidden = int(0)
        for sample in range(length):
            row = window_row(sample, head_in[0], length)
            hidden = lstm_sample(weights, ring_in, env, joint, row, hidden, scratch_out, place)
        learned = lstm_readout(readout, hidden, scratch_out, place)
        tau_dyn_out[env, joint] = write_torque(m_dyn_in[env, joint], tau_dyn_in[env, joint], learned, replace)


@wp.func
def at_rest(rest: wp.array3d[float], row: int, unit: int, q_c: float) -> float:
    """Hidden (row 0) or cell state (row 1) of a joint that has rested at q_c [rad], between the points of a table."""
    last = rest.shape[2] - 1
    x = wp.clamp((q_c + REST_RANGE) * (0.5 * float(last) / REST_RANGE), 0.0, float(last))
    i = wp.min(int(x), last - 1)
    return wp.lerp(rest[row, unit, i], rest[row, unit, i + 1], x - float(i))


@wp.kernel(enable_backward=False)
def lstm_rest_kernel(
    # parameters: hidden and cell states at rest, shape (2, HIDDEN, points) for q_c from -REST_RANGE to REST_RANGE
    rest: wp.array3d[float],
    # in, shape (1,), (E, M, WINDOW, FEATURES), (E*M,): 1 where a joint has rested until now
    head_in: wp.array[int],
    ring_in: wp.array4d[float],
    fresh_in: wp.array[int],
    # out, see lstm_unit_kernel
    state_out: wp.array3d[float],
):
    """The state that a joint has after a reset, before the newest sample; one thread per joint."""
    place = wp.tid()
    if fresh_in[place] > 0:
        row = head_in[0]
        oldest = (row + 1) % ring_in.shape[2]
        q_c = ring_in[place // ring_in.shape[1], place % ring_in.shape[1], oldest, 0]
        for unit in range(HIDDEN):
            state_out[1 - row % 2, unit, place] = at_rest(rest, 0, unit, q_c)
            state_out[2, unit, place] = at_rest(rest, 1, unit, q_c)


@wp.kernel(enable_backward=False)
def lstm_unit_kernel(
    # parameters: rows (bias, features, hidden) of each unit's gates, shape (HIDDEN, 1 + FEATURES + HIDDEN, GATES)
    weights: wp.array3d[float],
    # in, shape (1,), (E, M, WINDOW, FEATURES)
    head_in: wp.array[int],
    ring_in: wp.array4d[float],
    # out, hidden states of two steps by turns and cell state, shape (3, HIDDEN, at least E*M)
    state_out: wp.array3d[float],
):
    """One sample more (table 1) for UNITS units of UNITS joints' LSTM; the joint is the fastest index.

    Its time is that of reading: what a thread reads of weights serves four joints, what it reads of states four units.
    """
    four, quad = wp.tid()
    row, columns = head_in[0], ring_in.shape[1]
    after = row % 2  # the ring's length is even: rows of the ring and of the state alternate together
    joints = ring_in.shape[0] * columns
    stride, last, u = (joints + UNITS - 1) // UNITS, joints - 1, UNITS * four
    p0, p1, p2 = wp.min(quad, last), wp.min(quad + stride, last), wp.min(quad + 2 * stride, last)
    p3 = wp.min(quad + 3 * stride, last)
    ones = wp.vec4(1.0, 1.0, 1.0, 1.0)
    # gates of a unit, one row per joint
    g0, g1 = wp.outer(ones, gate_weights(weights, u, 0)), wp.outer(ones, gate_weights(weights, u + 1, 0))
    g2, g3 = wp.outer(ones, gate_weights(weights, u + 2, 0)), wp.outer(ones, gate_weights(weights, u + 3, 0))
    for k in range(FEATURES):
        x = wp.vec4(
            ring_in[p0 // columns, p0 % columns, row, k],
            ring_in[p1 // columns, p1 % columns, row, k],
            ring_in[p2 // columns, p2 % columns, row, k],
            ring_in[p3 // columns, p3 % columns, row, k],
        )
        g0 += wp.outer(x, gate_weights(weights, u, 1 + k))
        g1 += wp.outer(x, gate_weights(weights, u + 1, 1 + k))
        g2 += wp.outer(x, gate_weights(weights, u + 2, 1 + k))
        g3 += wp.outer(x, gate_weights(weights, u + 3, 1 + k))
    before = 1 - after
    for block in range(HIDDEN // UNROLLED):
        for i in range(UNROLLED):  # written out, so that a step waits for several reads at once
            h = UNROLLED * block + i
            x = wp.vec4(
                state_out[before, h, p0], state_out[before, h, p1], state_out[before, h, p2], state_out[before, h, p3]
            )
            g0 += wp.outer(x, gate_weights(weights, u, 1 + FEATURES + h))
            g1 += wp.outer(x, gate_weights(weights, u + 1, 1 + FEATURES + h))
            g2 += wp.outer(x, gate_weights(weights, u + 2, 1 + FEATURES + h))
            g3 += wp.outer(x, gate_weights(weights, u + 3, 1 + FEATURES + h))
    for j in range(UNITS):
        place = quad + j * stride
        if place < joints:
            lstm_cell(g0[j], u, place, after, state_out)
            lstm_cell(g1[j], u + 1, place, after, state_out)
            lstm_cell(g2[j], u + 2, place, after, state_out)
            lstm_cell(g3[j], u + 3, place, after, state_out)


@wp.kernel(enable_backward=False)
def lstm_torque_kernel(
    # parameters: output layer, shape (HIDDEN + 1,), bias last; 1 = the network gives the whole torque, 0 = a residual
    readout: wp.array[float],
    replace: int,
    # in, shape (1,), (3, HIDDEN, at least E*M), (E, M), (E, M)
    head_in: wp.array[int],
    state_in: wp.array3d[float],
    m_dyn_in: wp.array2d[float],
    tau_dyn_in: wp.array2d[float],
    # out, shape (E*M,), (E, M) [N·m]
    fresh_out: wp.array[int],
    tau_dyn_out: wp.array2d[float],
):
    """Torque of the joints whose gate is open from the hidden state that ``lstm_unit_kernel`` left."""
    env, joint = wp.tid()
    place = env * m_dyn_in.shape[1] + joint
    fresh_out[place] = 0
    if m_dyn_in[env, joint] > 0.0:
        learned = lstm_readout(readout, head_in[0] % 2, state_in, place)
        tau_dyn_out[env, joint] = write_torque(m_dyn_in[env, joint], tau_dyn_in[env, joint], learned, replace)


@wp.kernel(enable_backward=False)
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
