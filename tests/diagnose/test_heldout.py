"""Gain on trajectories that took no part: against brute-force refits, and its interval."""

import numpy as np
import pytest

from mrwarp.diagnose.choice import Choice
from mrwarp.diagnose.heldout import HeldOut, hold_out, reduction
from tests.diagnose import known

HIDDEN = {"rotor_inertia": {"inertia": 0.01}}


@pytest.fixture(scope="module")
def engine():
    """Six runs of a joint with an inertia."""
    return known.engine(HIDDEN, at=known.motion(8, runs=6, seconds=2.0))


def searched(engine, final: dict | None) -> Choice:
    """A search that ended with some model."""
    base = known.fitted(engine)
    best = base if final is None else known.fitted(engine, final)
    return Choice(base=base, final=best, first_look=[], fits={base.effects: base, best.effects: best})


def test_each_trajectory_is_foretold_by_the_others(engine) -> None:
    """What is foretold of a trajectory is what a linear refit to the others gives, baseline and extension.

    The refit leaves numbers at a bound where they are.
    """
    choice = searched(engine, HIDDEN)
    held = hold_out(engine, choice)
    assert held.agreed == 1.0
    for fit, foretold, errors in (
        (choice.base, held.foretold_baseline, held.baseline), (choice.final, held.foretold_extended, held.extended)
    ):  # fmt: skip
        for k, part in enumerate(engine.samples.parts):
            others = np.ones(len(fit.torque), dtype=bool)
            others[part] = False
            slopes, rest = fit.slopes[fit.free], engine.samples.torque - fit.torque
            left = np.linalg.lstsq(slopes[:, others].T, rest[others], rcond=None)[0]
            want = fit.torque[part] + left @ slopes[:, part]
            np.testing.assert_allclose(foretold[part], want, atol=2e-4)
            assert errors[k] == pytest.approx(((want - engine.samples.torque[part]) ** 2).sum(), rel=1e-3)


def test_gain_is_that_on_new_data(engine) -> None:
    """The stated gain is within 20 % of the gain of both models on another session of the same joint."""
    choice = searched(engine, HIDDEN)
    value, (low, high) = reduction(hold_out(engine, choice), seed=1)
    assert low <= value <= high and high - low < 0.5 and value > 0.3
    new = known.engine(HIDDEN, seed=99, at=known.motion(98, runs=6, seconds=2.0))
    errors = [
        np.sqrt(np.mean((new.samples.torque - new.replay.torque(f.coordinates.row(f.x)[None])[0]) ** 2))
        for f in (choice.base, choice.final)
    ]
    assert value == pytest.approx(1.0 - errors[1] / errors[0], rel=0.2)


def test_base_alone_gains_nothing(engine) -> None:
    """Where nothing was named both are the same."""
    held = hold_out(engine, searched(engine, None))
    assert np.array_equal(held.baseline, held.extended) and reduction(held, seed=1) == (0.0, (0.0, 0.0))


def test_model_that_the_others_would_not_choose_is_not_used() -> None:
    """A trajectory is foretold without an effect that only it shows."""
    at = known.motion(8, runs=6, seconds=2.0)
    plus = np.zeros(len(at.q))
    plus[at.parts[2]] = 0.05 * at.qdd[at.parts[2]]
    engine = known.engine(at=at, plus=plus)
    choice = searched(engine, HIDDEN)
    held = hold_out(engine, choice)
    assert held.agreed < 1.0
    part = engine.samples.parts[2]
    np.testing.assert_array_equal(held.foretold_extended[part], held.foretold_baseline[part])


def test_reduction_is_that_of_the_rmse() -> None:
    """1 - sqrt(sum/sum); its interval comes from whole trajectories and from the seed."""
    rng = np.random.default_rng(3)
    baseline = rng.uniform(1.0, 2.0, 20)
    none = np.zeros(0)
    half = HeldOut(
        baseline=baseline, extended=0.25 * baseline, foretold_baseline=none, foretold_extended=none, agreed=1.0
    )  # fmt: skip
    value, (low, high) = reduction(half, seed=5)
    assert value == pytest.approx(0.5) and (low, high) == pytest.approx((0.5, 0.5))
    mixed = HeldOut(
        baseline=baseline, extended=baseline * rng.uniform(0.2, 1.2, 20), foretold_baseline=none,
        foretold_extended=none, agreed=1.0,
    )  # fmt: skip
    value, (low, high) = reduction(mixed, seed=5)
    assert low < value < high and reduction(mixed, seed=5) == (value, (low, high))
    few = HeldOut(
        baseline=baseline[:5], extended=mixed.extended[:5], foretold_baseline=none, foretold_extended=none, agreed=1.0
    )  # fmt: skip
    assert np.diff(reduction(few, seed=5)[1]) > high - low
