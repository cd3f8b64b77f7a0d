"""Traces of impact trials that nobody simulated."""

import numpy as np

from mrwarp.trials.impact import ImpactTrace


def trace(shape: tuple[int, int, int] = (1, 3, 40), **changes: np.ndarray) -> ImpactTrace:
    """Variants, trials and steps of 5 ms in which nothing happens, but for some series."""
    steps, height = np.zeros((*shape, 4)), np.full(shape, 0.3)
    series = {
        "t": 0.005 * np.arange(1.0, shape[2] + 1.0), "height": height, "velocity": np.zeros_like(height),
        **{name: steps for name in ("tau_motor", "tau_mr", "current", "m_dyn", "m_hold", "f_foot", "q", "qd")},
        "qpos": np.zeros((shape[0], shape[2], 19)), "ledger": np.zeros((*shape[:2], 7)),
        "fell": np.zeros(shape[:2], dtype=bool), "contact": np.full(shape[:2], 0.02),
    }  # fmt: skip
    return ImpactTrace(**{**series, **changes})
