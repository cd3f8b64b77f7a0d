"""Replay of recordings: units, scales, initial state and the accuracy of finite-difference derivatives."""

import dataclasses

import numpy as np
import pytest

from mrwarp.identify.dataset import Dataset, Motion, Scales
from mrwarp.identify.fit import BoucWenStructure
from mrwarp.identify.normal_equations import bounded_solve
from mrwarp.identify.projection import Projection
from mrwarp.identify.replay import EffectReplay, Replay, null_row, simulate
from mrwarp.recording.load import Recording, Trajectory
from tests.identify import synthetic


def test_simulation_equals_the_independent_truth() -> None:
    """Replay at 200 Hz follows Runge-Kutta at 2 kHz: the discretisation stays below 1 % of the sensor noise of 0.02."""
    recording = synthetic.bench_like(0, runs=4, noise=0.0)
    for sim, run in zip(simulate(synthetic.TRUTH, recording), recording.trajectories, strict=True):
        assert np.sqrt(np.mean((sim - run.torque) ** 2)) < 2e-4


def test_trajectories_of_other_lengths_and_rates_do_not_mix() -> None:
    """A trajectory simulated among others of other length and step is bit-equal to itself alone."""
    a = synthetic.bench_like(1, runs=2, seconds=1.0, noise=0.0).trajectories[0]
    t = np.arange(333) * 0.001
    b = Trajectory(id="b", t=t, q=np.sin(9 * t), qd=9 * np.cos(9 * t), current=np.ones(333), torque=np.zeros(333))
    scales = Scales(q=0.3, current=1.5, torque=2.0)
    parameters = {"K0": 1.0, "K1": 2.0, "beta": 4.0, "gamma": -1.0}

    def replay(*runs: Trajectory) -> np.ndarray:
        return Replay(Dataset.of(Recording(trajectories=runs), scales)).torque([parameters])[0]

    np.testing.assert_array_equal(replay(a, b, a), np.concatenate([replay(a), replay(b), replay(a)]))


def test_what_was_replayed_shortly_before_is_not_replayed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal rows in another order and company: equal torque, bit for bit, and only the new row is simulated."""
    replay = EffectReplay(Motion.of(synthetic.bench_like(4, runs=2, seconds=1.0)))
    rows = np.repeat(null_row()[None], 4, axis=0)
    rows[:, 1], rows[:, 4], rows[:, 7] = (0.1, 0.2, 0.3, 0.4), 1.0, 5.0
    first, simulated = replay.torque(rows[:3]), []
    launch = Replay.torque
    monkeypatch.setattr(Replay, "torque", lambda self, rows: simulated.append(len(rows)) or launch(self, rows))
    again = replay.torque(rows[[3, 2, 0, 2]])
    assert simulated == [1]
    np.testing.assert_array_equal(again[1:], first[[2, 0, 2]])
    np.testing.assert_array_equal(again[0], launch(replay, rows[3:])[0])


def test_torque_is_the_same_in_other_units() -> None:
    """A device 1000 times shorter and 200 times stronger, with its parameters converted, gives the scaled torque."""
    recording = synthetic.bench_like(2, runs=3, seconds=1.0, noise=0.0)
    other = synthetic.scaled(recording, 1e-3, 0.5, 200.0, {"q": "m", "current": "A", "torque": "N"})
    factor = Scales(q=1e-3, current=0.5, torque=200.0).factor
    values = {name: value * factor(name) for name, value in synthetic.TRUTH.items()}
    for x, y in zip(simulate(synthetic.TRUTH, recording), simulate(values, other), strict=True):
        np.testing.assert_allclose(200.0 * x, y, rtol=0, atol=1e-5 * 200.0)  # float32 rounding of a torque of 2


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_finite_difference_columns_are_accurate(axis: int) -> None:
    """Derivatives by float32 differences equal Richardson's float64 ones of the independent simulation to 0.5 %.

    Its truncation is step^2/6 = 2e-5 and its rounding 1e-6/step = 1e-4 relative; the rest is the 200 Hz sampling.
    """
    recording = synthetic.bench_like(3, runs=3, seconds=2.0, noise=0.0)
    samples = Dataset.of(recording, Scales())
    structure = BoucWenStructure(samples)
    p = synthetic.TRUTH
    rates = [p["beta"] + p["gamma"], p["beta"] - p["gamma"]]
    theta = np.array([np.log1p(p["alpha"] * structure.speed), *np.log(rates)])

    def truth(x: np.ndarray) -> np.ndarray:
        runs = synthetic.bench_like(3, runs=3, seconds=2.0, noise=0.0, p={**p, **structure.loop(x)}).trajectories
        return np.concatenate([run.torque for run in runs])

    point = Projection(structure, Replay(samples)).evaluate(theta)
    step = 1e-3 * np.eye(3)[axis]
    slope = (truth(theta + step) - truth(theta - step)) / 2e-3
    # the Gram matrix holds the column: its norm and its product with the measured torque
    index = len(structure.linear) + axis
    gram = point.gram.sum(axis=0)
    assert gram[index, index] == pytest.approx(slope @ slope, rel=1e-2)
    assert gram[index, -1] == pytest.approx(
        slope @ samples.torque, abs=5e-3 * np.linalg.norm(slope) * np.linalg.norm(samples.torque)
    )


def test_bounded_solve_keeps_to_its_bound() -> None:
    """y = -x1 + 2 x2 with x1 >= 0 gives x1 = 0 and the best x2; without bound the exact pair."""
    a = np.random.default_rng(0).normal(size=(200, 2)) + [[0.0, 0.3]]
    y = a @ [-1.0, 2.0]
    free, _ = bounded_solve(a.T @ a, a.T @ y, np.array([False, False]))
    held, used = bounded_solve(a.T @ a, a.T @ y, np.array([True, False]))
    np.testing.assert_allclose(free, [-1.0, 2.0], atol=1e-10)
    np.testing.assert_allclose(held, np.array([0.0, a[:, 1] @ y / (a[:, 1] @ a[:, 1])]), atol=1e-10)
    assert used.tolist() == [False, True]


def test_bounded_solve_shares_between_equal_columns() -> None:
    """Two equal columns, as K0 and K1 at one current, share the coefficient instead of failing."""
    x = np.linspace(1, 2, 50)
    a = np.column_stack([x, x])
    solution, _ = bounded_solve(a.T @ a, a.T @ (3.0 * x), np.array([False, False]))
    np.testing.assert_allclose(solution, [1.5, 1.5], atol=1e-6)


def test_scales_are_robust() -> None:
    """One wild sample in 10,000 moves no scale by more than 1 %."""
    recording = synthetic.bench_like(4, runs=3, seconds=4.0)
    run = recording.trajectories[0]
    torque, q = run.torque.copy(), run.q.copy()
    torque[100], q[50] = 1e6, -1e6
    corrupted = dataclasses.replace(run, torque=torque, q=q)
    other = Recording(trajectories=(corrupted, *recording.trajectories[1:]))
    a, b = Scales.of(recording), Scales.of(other)
    assert b.q == pytest.approx(a.q, rel=0.01)
    assert b.torque == pytest.approx(a.torque, rel=0.01)
