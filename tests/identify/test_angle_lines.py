"""Lines over the angle are found next to each other, however the joint turns."""

import numpy as np
import pytest

from mrwarp.effects.cogging import LAW
from mrwarp.identify.angle_lines import angle_lines
from mrwarp.identify.dataset import Dataset, Motion, Scales
from mrwarp.recording.load import Recording, Trajectory


def turning(repeats: dict[float, float], noise: float = 0.3) -> Dataset:
    """A joint that turns forty times at an uneven speed, in two runs."""
    rng = np.random.default_rng(0)
    t = np.arange(20_000) * 1e-3
    q = 6.0 * t + 0.3 * np.sin(11.0 * t) + 0.02 * np.sin(70.0 * t)
    q = np.concatenate([q, q + 130.0])
    torque = 2.0 + sum(size * np.sin(n * q + 0.3 * n) for n, size in repeats.items()) + noise * rng.normal(size=len(q))
    runs = np.array([0, len(t), 2 * len(t)])
    zero = np.zeros(len(q))
    return Dataset(
        q=q, qd=np.gradient(q, 1e-3), current=zero, torque=torque, start=runs, dt=np.full(2, 1e-3), scales=Scales()
    )


def test_harmonics_come_strongest_first() -> None:
    """Three that are no multiples of each other, within a hundredth of a repetition per turn."""
    data = turning({72.0: 1.0, 18.0: 0.4, 12.0: 0.25})
    assert angle_lines(data, data.torque, 0.1, 100.0, count=3) == pytest.approx([72.0, 18.0, 12.0], abs=0.01)
    assert angle_lines(data, data.torque, 0.1, 100.0, given=(72.0,)) == pytest.approx([18.0], abs=0.01)
    assert angle_lines(data, data.torque, 0.1, 30.0) == pytest.approx([18.0], abs=0.01)


def test_a_line_whose_size_drifts_is_one() -> None:
    """72 per turn that fades along forty turns has side lines at a fraction of a turn; the second line is another."""
    data = turning({72.0: 1.0, 18.0: 0.2})
    fades = (data.torque - 2.0) * np.tile(np.linspace(2.0, 0.0, len(data.q) // 2), 2)
    assert angle_lines(data, fades, 0.1, 100.0, count=2) == pytest.approx([72.0, 18.0], abs=0.01)


def test_a_line_that_the_fast_runs_see_too_rarely_is_found_by_the_slow_ones() -> None:
    """42 per turn at 3 to 12 rad/s, logged at 100 Hz: five samples a period in the slow runs, 1.2 in the fast ones."""
    rng, runs = np.random.default_rng(4), []
    for k, speed in enumerate((3.0, 5.0, 8.0, 12.0, -3.0, -5.0, -8.0, -12.0)):
        t = np.arange(700) * 0.01
        q = speed * t + rng.uniform(0.0, 6.0)
        torque = 0.25 * np.sign(speed) + 0.05 * np.sin(42.0 * q) + 0.01 * rng.normal(size=700)
        qd = np.full(700, speed) + 0.01 * rng.normal(size=700)
        runs.append(Trajectory(id=f"run {k}", t=t, q=q, qd=qd, current=np.zeros(700), torque=torque))
    motion = Motion.of(Recording(trajectories=tuple(runs)))
    periods = next(p for p in LAW.parameters if p.name == "periods")
    low, high = periods.low(motion.ranges), periods.high(motion.ranges)
    assert angle_lines(motion, motion.torque, low, high)[0] / motion.scales.q == pytest.approx(42.0, abs=0.01)
