"""Long recordings at a high rate, thinned: beyond some hundred thousand samples more of them say nothing new."""

from __future__ import annotations

import dataclasses

import numpy as np

from mrwarp.recording.load import Recording, Trajectory

LIMIT = 160_000
"""Samples up to which a recording is diagnosed as it is."""
LEAST_RATE = 300.0
"""Rate below which nothing is thinned [Hz]: lags of a few milliseconds must still show."""


def thinned(recording: Recording) -> tuple[Recording, str | None]:
    """The recording with at most about ``LIMIT`` samples, and what was done in words, or None.

    Angle and velocity become means over the samples around each that is kept, which takes no motion away and adds no
    phase; current and torque are those of the sample itself, so that a step of the current stays a step.
    """
    runs, every = recording.trajectories, 1
    factors = [1] * len(runs)
    while sum(len(run.t) // k for run, k in zip(runs, factors, strict=True)) > LIMIT:
        every += 2
        wider = [min(every, _odd(1.0 / run.dt / LEAST_RATE)) for run in runs]
        if wider == factors:
            break
        factors = wider
    if max(factors) == 1:
        return recording, None
    out = dataclasses.replace(
        recording, trajectories=tuple(_thin(run, k) for run, k in zip(runs, factors, strict=True))
    )
    rates = sorted({round(1.0 / run.dt) for run in out.trajectories})
    return out, (
        f"{recording.samples} samples are more than a diagnosis needs: it used {out.samples}, at "
        f"{' or '.join(str(rate) for rate in rates)} Hz"
    )


def _odd(most: float) -> int:
    """Largest odd number up to ``most``, at least 1."""
    return max(1, 2 * int((most + 1e-6 + 1.0) / 2.0) - 1)


def _thin(run: Trajectory, every: int) -> Trajectory:
    """One trajectory with every ``every``-th sample, an odd number."""
    if every == 1:
        return run
    count = len(run.t) // every
    middle = np.arange(count) * every + every // 2

    def mean(x: np.ndarray) -> np.ndarray:
        return x[: count * every].reshape(count, every).mean(axis=1)

    return dataclasses.replace(
        run, t=run.t[middle], q=mean(run.q), qd=mean(run.qd), current=run.current[middle], torque=run.torque[middle],
        temperature=None if run.temperature is None else run.temperature[middle],
    )  # fmt: skip
