"""The LSTM of ``learned`` for a CPU: joints side by side in the lanes of its vector registers.

Every lane does the same operations in the same order, so a joint's bits depend neither on its lane nor on its
neighbours. It runs near the processor's multiply-add rate: 19 us per window of 50 samples in sixteens and 21 us in
eights, on one core of an EPYC with AVX-512 (14.7 us were the matrix products alone at the full rate). The module is of
its own because only a CPU compiler (Warp's clang) knows these vector types.

Several threads may run a kernel at once, one as the owner and the others as helpers. They take parts of the work from
one counter: a helper that wakes up late takes fewer, or none.
"""

import warp as wp

UNITS = 4
"""Hidden units worked on together: 4 units x 4 gates are the accumulators that fit into registers."""

LANES = 16
"""Joints of a part of the work of :func:`lstm_carried_lanes_kernel`."""

_CELL = """
typedef float lanes8 __attribute__((ext_vector_type(8)));
typedef float lanes16 __attribute__((ext_vector_type(16)));
constexpr int UNITS = 4, HIDDEN = 64, GATES = 4 * UNITS;
const int length = ring.shape[2];

// a * b + c in one rounding, said outright: this compiler fuses nothing by itself
auto fma = [](auto a, auto b, decltype(b) c) {
#if defined(__FMA__) || defined(__aarch64__)
    return __builtin_elementwise_fma((decltype(b))a, b, c);
#else
    return a * b + c;
#endif
};

// tanh(x) = p/q to 4e-7 in float32: rational fit of tanh on [-8.3, 8.3] (8e-9 before rounding)
auto ratio = [&](auto x, auto& p, auto& q) {
    typedef decltype(x) lanes;
    x = __builtin_elementwise_min(__builtin_elementwise_max(x, (lanes)-8.3f), (lanes)8.3f);
    const lanes s = x * x;
    p = fma(1.44787282562e-8f, s, (lanes)2.13822237440e-5f);
    p = x * fma(fma(fma(p, s, (lanes)0.00354127223822f), s, (lanes)0.134191296754f), s, (lanes)0.99999995677f);
    q = fma(8.22465864445e-7f, s, (lanes)3.36120328409e-4f);
    q = fma(fma(fma(q, s, (lanes)0.0260496341669f), s, (lanes)0.467524453382f), s, (lanes)1.0f);
};

// one sample: hidden state before -> after, cell state in place; the gates see the first `inputs` of the hidden state
auto advance = [&](const auto* x, const auto* before, auto* after, auto* cell, int inputs) {
    typedef __typeof__(x[0] + x[0]) lanes;
    const float* w = weights.data;  // [units in fours][row: bias, features, hidden][gate][unit of the four]
    for (int unit = 0; unit < HIDDEN; unit += UNITS) {
        lanes sum[GATES];
        for (int g = 0; g < GATES; ++g) sum[g] = w[g] + (lanes)0.0f;
        w += GATES;
        for (int k = 0; k < 3; ++k, w += GATES)
            for (int g = 0; g < GATES; ++g) sum[g] = fma(w[g], x[k], sum[g]);
        for (int k = 0; k < inputs; ++k, w += GATES) {
            const lanes h = before[k];
            for (int g = 0; g < GATES; ++g) sum[g] = fma(w[g], h, sum[g]);
        }
        w += (HIDDEN - inputs) * GATES;
// unrolled, or the sums would be an array in memory, stored again at every multiply-add
#pragma clang loop unroll(full)
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
};

// raw features of the joints at `window`, `sample` samples after the oldest of their history
auto read = [&](auto* x, const float* const* window, int sample) {
    const int row = (head.data[0] + 1 + sample) % length;
    const int count = sizeof(x[0]) / sizeof(float);
    for (int l = 0; l < count; ++l)
        for (int k = 0; k < 3; ++k) x[k][l] = window[l][row * 3 + k];
};

auto readout_of = [&](const auto* hidden) {
    typedef __typeof__(hidden[0] + hidden[0]) lanes;
    lanes learned = readout.data[HIDDEN] + (lanes)0.0f;
    for (int k = 0; k < HIDDEN; ++k) learned += readout.data[k] * hidden[k];
    return learned;
};

auto write = [&](int i, float learned) {
    if (m_dyn.data[i] > 0.0f) tau_dyn.data[i] = replace ? learned : tau_dyn.data[i] + learned;
};

// take parts of the work from one counter, up to `most` at a time and a fair share in all; the owner waits for the rest
// work[0] = parts in all, parts taken (high and low half); work[1] = parts done
typedef unsigned long long word;
auto share_out = [&](word parts, unsigned most, auto run) {
    word* const taken = (word*)work.data;
    word* const done = taken + 1;
    if (owner) {
        __atomic_store_n(done, 0, __ATOMIC_RELAXED);
        __atomic_store_n(taken, parts << 32, __ATOMIC_RELEASE);
    }
    word seen = __atomic_load_n(taken, __ATOMIC_ACQUIRE);
    unsigned mine = 0;
    while (unsigned(seen) < seen >> 32) {
        const unsigned first = unsigned(seen), all = unsigned(seen >> 32);
        const unsigned fair = (all + threads - 1) / threads;
        const unsigned take = mine + most <= fair && first + most <= all ? most : 1;
        if (!__atomic_compare_exchange_n(taken, &seen, seen + take, false, __ATOMIC_ACQ_REL, __ATOMIC_ACQUIRE))
            continue;
        mine += take;
        run((int)first, (int)take);
        __atomic_fetch_add(done, take, __ATOMIC_RELEASE);
        seen = __atomic_load_n(taken, __ATOMIC_ACQUIRE);
    }
    while (owner && __atomic_load_n(done, __ATOMIC_ACQUIRE) != parts) {
#if defined(__x86_64__)
        __builtin_ia32_pause();
#endif
    }
};
"""

_WINDOWS = """
auto run = [&](auto zero, int first, int end) {
    typedef decltype(zero) lanes;
    constexpr int COUNT = sizeof(lanes) / sizeof(float);
    lanes hidden[2][HIDDEN], cell[HIDDEN];
    for (int k = 0; k < HIDDEN; ++k) hidden[0][k] = cell[k] = zero;
    const float* window[COUNT];  // lanes beyond the last window repeat it
    for (int l = 0; l < COUNT; ++l)
        window[l] = ring.data + size_t(index.data[first + l < end ? first + l : end - 1]) * length * 3;
    for (int sample = 0; sample < length; ++sample) {
        lanes x[3];
        read(x, window, sample);
        // the first sample's hidden state is zero
        advance(x, hidden[sample & 1], hidden[1 - (sample & 1)], cell, sample ? HIDDEN : 0);
    }
    const lanes learned = readout_of(hidden[length & 1]);
    for (int l = 0; l < COUNT && first + l < end; ++l) write(index.data[first + l], learned[l]);
};
// in eights, two of them at a time
share_out((count.data[0] + 7) / 8, 2, [&](int first, int take) {
    if (take == 2) run((lanes16)0.0f, 8 * first, count.data[0]);
    else run((lanes8)0.0f, 8 * first, count.data[0]);
});
"""

_CARRIED = """
const int joints = ring.shape[0] * ring.shape[1], places = state.shape[2];
share_out((joints + 15) / 16, 1, [&](int first, int) {
    typedef lanes16 lanes;
    lanes hidden[2][HIDDEN], cell[HIDDEN], x[3];
    const float* window[16];  // lanes beyond the last joint repeat it
    float* const carried = state.data + 16 * first;
    bool any = false;
    int begins[16];
    for (int l = 0; l < 16; ++l) {
        const int i = 16 * first + l < joints ? 16 * first + l : joints - 1;
        window[l] = ring.data + size_t(i) * length * 3;
        begins[l] = fresh.data[i];
        any |= begins[l] != 0;
    }
    lanes* const before = hidden[0];
    if (any) {
        for (int k = 0; k < HIDDEN; ++k) hidden[0][k] = cell[k] = (lanes)0.0f;
        for (int sample = 0; sample < length - 1; ++sample) {
            read(x, window, sample);
            advance(x, hidden[sample & 1], hidden[1 - (sample & 1)], cell, sample ? HIDDEN : 0);
        }
        for (int k = 0; k < HIDDEN; ++k) before[k] = hidden[(length - 1) & 1][k];
        for (int k = 0; k < HIDDEN; ++k)
            for (int l = 0; l < 16; ++l)
                if (!begins[l]) {
                    before[k][l] = carried[size_t(k) * places + l];
                    cell[k][l] = carried[size_t(2 * HIDDEN + k) * places + l];
                }
    } else {
        for (int k = 0; k < HIDDEN; ++k) {
            __builtin_memcpy(&before[k], carried + size_t(k) * places, sizeof(lanes));
            __builtin_memcpy(&cell[k], carried + size_t(2 * HIDDEN + k) * places, sizeof(lanes));
        }
    }
    read(x, window, length - 1);
    advance(x, before, hidden[1], cell, HIDDEN);
    for (int k = 0; k < HIDDEN; ++k) {
        __builtin_memcpy(carried + size_t(k) * places, &hidden[1][k], sizeof(lanes));
        __builtin_memcpy(carried + size_t(2 * HIDDEN + k) * places, &cell[k], sizeof(lanes));
    }
    const lanes learned = readout_of(hidden[1]);
    for (int l = 0; l < 16 && 16 * first + l < joints; ++l) {
        fresh.data[16 * first + l] = 0;
        write(16 * first + l, learned[l]);
    }
});
"""


@wp.func_native(_CELL + _WINDOWS)
def lstm_windows(
    weights: wp.array[float],
    readout: wp.array[float],
    replace: int,
    owner: int,
    threads: int,
    count: wp.array[int],
    index: wp.array[int],
    head: wp.array[int],
    ring: wp.array4d[float],
    m_dyn: wp.array2d[float],
    work: wp.array[wp.int64],
    tau_dyn: wp.array2d[float],
):
    """LSTM over the open windows that no other thread takes; writes their torque."""
    ...


@wp.kernel(enable_backward=False)
def lstm_lanes_kernel(
    # parameters: weights by fours of units, flat (see above); output layer, shape (HIDDEN + 1,), bias last; 1 = the
    # network gives the whole torque, 0 = a residual; 1 = the owner, which starts the work and leaves when all of it is
    # done, 0 = a helper, which leaves when nothing is left to take; number of threads, owner and helpers
    weights: wp.array[float],
    readout: wp.array[float],
    replace: int,
    owner: int,
    threads: int,
    # in, shape (1,), (E*M,), (1,), (E, M, WINDOW, FEATURES), (E, M), contiguous
    count_in: wp.array[int],
    index_in: wp.array[int],
    head_in: wp.array[int],
    ring_in: wp.array4d[float],
    m_dyn_in: wp.array2d[float],
    # out, the threads' common state, shape (2,), zero at first; torque, shape (E, M), contiguous [N·m]
    work_out: wp.array[wp.int64],
    tau_dyn_out: wp.array2d[float],
):
    """LSTM over the open windows (table 1), together with the other threads that run it."""
    lstm_windows(
        weights, readout, replace, owner, threads, count_in, index_in, head_in, ring_in, m_dyn_in, work_out, tau_dyn_out
    )


@wp.func_native(_CELL + _CARRIED)
def lstm_carried(
    weights: wp.array[float],
    readout: wp.array[float],
    replace: int,
    owner: int,
    threads: int,
    head: wp.array[int],
    ring: wp.array4d[float],
    m_dyn: wp.array2d[float],
    work: wp.array[wp.int64],
    fresh: wp.array[int],
    state: wp.array3d[float],
    tau_dyn: wp.array2d[float],
):
    """One sample more for the joints that no other thread takes; writes the torque of those whose gate is open."""
    ...


@wp.kernel(enable_backward=False)
def lstm_carried_lanes_kernel(
    # parameters: as of lstm_lanes_kernel
    weights: wp.array[float],
    readout: wp.array[float],
    replace: int,
    owner: int,
    threads: int,
    # in, shape (1,), (E, M, WINDOW, FEATURES), (E, M), contiguous
    head_in: wp.array[int],
    ring_in: wp.array4d[float],
    m_dyn_in: wp.array2d[float],
    # out, the threads' common state, shape (2,), zero at first; 1 where a state is still to be made from the history,
    # shape (E*M,); hidden state, unused, cell state, shape (3, HIDDEN, E*M rounded up to LANES); torque, shape (E, M),
    # contiguous [N·m]
    work_out: wp.array[wp.int64],
    fresh_out: wp.array[int],
    state_out: wp.array3d[float],
    tau_dyn_out: wp.array2d[float],
):
    """One sample more for every joint's LSTM, together with the other threads that run it."""
    lstm_carried(
        weights,
        readout,
        replace,
        owner,
        threads,
        head_in,
        ring_in,
        m_dyn_in,
        work_out,
        fresh_out,
        state_out,
        tau_dyn_out,
    )
