"""The LSTM of ``learned.lstm_window_kernel`` for a CPU: windows side by side in the lanes of its vector registers.

Every lane does the same operations in the same order, so a window's bits depend neither on its lane nor on its
neighbours. It runs at the processor's multiply-add rate: 22 us per window on one core of an EPYC with AVX-512. The
module is of its own because only a CPU compiler (Warp's clang) knows these vector types.
"""

import warp as wp

UNITS = 4
"""Hidden units worked on together: 4 units x 4 gates are the accumulators that fit into registers."""

_SHARE = """
typedef float lanes8 __attribute__((ext_vector_type(8)));
typedef float lanes16 __attribute__((ext_vector_type(16)));
constexpr int UNITS = 4, HIDDEN = 64, GATES = 4 * UNITS;
const int length = ring.shape[2];

// tanh(x) = p/q to 4e-7 in float32: rational fit of tanh on [-8.3, 8.3] (8e-9 before rounding)
auto ratio = [](auto x, auto& p, auto& q) {
    typedef decltype(x) lanes;
    x = __builtin_elementwise_min(__builtin_elementwise_max(x, (lanes)-8.3f), (lanes)8.3f);
    const lanes s = x * x;
    p = x * (0.99999995677f + s * (0.134191296754f + s * (0.00354127223822f
        + s * (2.13822237440e-5f + s * 1.44787282562e-8f))));
    q = 1.0f + s * (0.467524453382f + s * (0.0260496341669f + s * (3.36120328409e-4f + s * 8.22465864445e-7f)));
};

auto run = [&](auto zero, int first) {
    typedef decltype(zero) lanes;
    constexpr int COUNT = sizeof(lanes) / sizeof(float);
    lanes hidden[2][HIDDEN], cell[HIDDEN];
    for (int k = 0; k < HIDDEN; ++k) hidden[0][k] = cell[k] = zero;
    const float* window[COUNT];  // lanes beyond the share's last window repeat it
    for (int l = 0; l < COUNT; ++l)
        window[l] = ring.data + size_t(index.data[first + l < end ? first + l : end - 1]) * length * 3;
    for (int sample = 0; sample < length; ++sample) {
        const int row = (head.data[0] + 1 + sample) % length;
        lanes x[3];
        for (int l = 0; l < COUNT; ++l)
            for (int k = 0; k < 3; ++k) x[k][l] = window[l][row * 3 + k];
        const lanes* before = hidden[sample & 1];
        lanes* after = hidden[1 - (sample & 1)];
        const float* w = weights.data;  // [units in fours][row: bias, features, hidden][gate][unit of the four]
        for (int unit = 0; unit < HIDDEN; unit += UNITS) {
            lanes sum[GATES];
            for (int g = 0; g < GATES; ++g) sum[g] = w[g] + zero;
            w += GATES;
            for (int k = 0; k < 3; ++k, w += GATES)
                for (int g = 0; g < GATES; ++g) sum[g] += w[g] * x[k];
            for (int k = 0; k < HIDDEN; ++k, w += GATES) {
                const lanes h = before[k];
                for (int g = 0; g < GATES; ++g) sum[g] += w[g] * h;
            }
            for (int u = 0; u < UNITS; ++u) {
                // sigmoid(x) = (q + p)/(2q) with tanh(x/2) = p/q; products of ratios share a division
                lanes ip, iq, fp, fq, gp, gq, op, oq, cp, cq;
                ratio(0.5f * sum[u], ip, iq);
                ratio(0.5f * sum[UNITS + u], fp, fq);
                ratio(sum[2 * UNITS + u], gp, gq);
                ratio(0.5f * sum[3 * UNITS + u], op, oq);
                cell[unit + u] = (fq + fp) / (fq + fq) * cell[unit + u] + (iq + ip) * gp / ((iq + iq) * gq);
                ratio(cell[unit + u], cp, cq);
                after[unit + u] = (oq + op) * cp / ((oq + oq) * cq);
            }
        }
    }
    lanes learned = readout.data[HIDDEN] + zero;
    for (int k = 0; k < HIDDEN; ++k) learned += readout.data[k] * hidden[length & 1][k];
    for (int l = 0; l < COUNT && first + l < end; ++l) {
        const int i = index.data[first + l];
        if (m_dyn.data[i] > 0.0f) tau_dyn.data[i] = replace ? learned[l] : tau_dyn.data[i] + learned[l];
    }
};

for (int first = begin; first < end; first += 16) {
    if (end - first > 8) run((lanes16)0.0f, first);
    else run((lanes8)0.0f, first);
}
"""


@wp.func_native(_SHARE)
def lstm_share(
    begin: int,
    end: int,
    weights: wp.array[float],
    readout: wp.array[float],
    replace: int,
    index: wp.array[int],
    head: wp.array[int],
    ring: wp.array4d[float],
    m_dyn: wp.array2d[float],
    tau_dyn: wp.array2d[float],
):
    """LSTM over the open windows ``begin`` to ``end - 1`` of ``index``; writes their torque."""
    ...


@wp.kernel(enable_backward=False)
def lstm_lanes_kernel(
    # parameters: weights by fours of units, flat (see above); output layer, shape (HIDDEN + 1,), bias last; 1 = the
    # network gives the whole torque, 0 = a residual; this launch's share of the windows: number ``part`` of ``parts``
    weights: wp.array[float],
    readout: wp.array[float],
    replace: int,
    part: int,
    parts: int,
    # in, shape (1,), (E*M,), (1,), (E, M, WINDOW, FEATURES), (E, M), contiguous
    count_in: wp.array[int],
    index_in: wp.array[int],
    head_in: wp.array[int],
    ring_in: wp.array4d[float],
    m_dyn_in: wp.array2d[float],
    # out, shape (E, M), contiguous [N·m]
    tau_dyn_out: wp.array2d[float],
):
    """LSTM over the open windows (table 1): one thread, one share of them, in whole eights."""
    size = (count_in[0] + 8 * parts - 1) // (8 * parts) * 8
    begin = wp.min((part + wp.tid()) * size, count_in[0])
    end = wp.min(begin + size, count_in[0])
    lstm_share(begin, end, weights, readout, replace, index_in, head_in, ring_in, m_dyn_in, tau_dyn_out)
