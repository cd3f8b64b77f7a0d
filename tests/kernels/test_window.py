"""The history ring reads out oldest sample first, also after it has wrapped around."""

from collections import deque

import numpy as np
import pytest
import warp as wp

from mrwarp.kernels.learned_torque import FEATURES, WINDOW
from mrwarp.kernels.mr_stages import advance_head_kernel
from tests.kernels.law_kernels import f32, window_read_kernel


def read(ring: np.ndarray, head: int) -> np.ndarray:
    """The ring in the order of time, into an output poisoned with NaN."""
    ring_in = wp.array(f32(ring), dtype=float, device="cpu")
    out = wp.full(ring.shape, float("nan"), dtype=float, device="cpu")
    inputs = [ring_in, wp.array([head], dtype=int, device="cpu")]
    wp.launch(window_read_kernel, dim=ring.shape[:3], inputs=inputs, outputs=[out], device="cpu")
    return out.numpy()


def test_window_has_the_size_of_the_paper():
    """Eq. 12: 50 samples of displacement, velocity and current."""
    assert (WINDOW, FEATURES) == (50, 3)


@pytest.mark.parametrize("pushes", [1, 49, 50, 51, 137])
def test_window_is_a_queue(pushes: int):
    """After any number of pushes the window equals a NumPy deque of the last 50 samples."""
    rng = np.random.default_rng(pushes)
    ring = np.zeros((3, 2, WINDOW, FEATURES), dtype=np.float32)
    queue = deque([np.zeros((3, 2, FEATURES), dtype=np.float32)] * WINDOW, maxlen=WINDOW)
    head = wp.zeros(1, dtype=int, device="cpu")
    for _ in range(pushes):
        sample = f32(rng.normal(size=(3, 2, FEATURES)))
        wp.launch(advance_head_kernel, dim=1, inputs=[WINDOW, head], outputs=[head], device="cpu")
        ring[:, :, head.numpy()[0]] = sample
        queue.append(sample)
    np.testing.assert_array_equal(read(ring, int(head.numpy()[0])), np.stack(list(queue), axis=2))


def test_window_of_another_length():
    """The ring's own length counts: 4 rows, newest at row 1."""
    ring = np.arange(4.0).reshape(1, 1, 4, 1) * np.ones(3)
    np.testing.assert_array_equal(read(ring, 1)[0, 0, :, 0], [2, 3, 0, 1])
