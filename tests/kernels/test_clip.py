"""Clipping: the limits hold for numbers, and what is no number stays none."""

import numpy as np
import warp as wp

from mrwarp.kernels.clip import clip


@wp.kernel
def clip_kernel(value: wp.array[float], limit: float, out: wp.array[float]):
    """The law alone."""
    i = wp.tid()
    out[i] = clip(value[i], limit)


def test_clip_is_numpy_clip_and_keeps_nan() -> None:
    """Inside, at and beyond the limits as numpy.clip; infinity is clipped, NaN is not."""
    values = np.array([0.0, -1.5, 1.5, 2.0, -2.0, 3.0, -3.0, np.inf, -np.inf, np.nan], dtype=np.float32)
    out = wp.full(len(values), 9.0, dtype=float, device="cpu")
    wp.launch(clip_kernel, dim=len(values), inputs=[wp.array(values, device="cpu"), 2.0], outputs=[out], device="cpu")
    np.testing.assert_array_equal(out.numpy(), np.clip(values, -2.0, 2.0))
