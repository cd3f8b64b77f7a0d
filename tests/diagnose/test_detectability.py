"""Smallest sizes that would have shown: against the closed form, over noise and length, and by hiding them."""

import numpy as np
import pytest

from mrwarp.diagnose.next_experiment import smallest_sizes
from mrwarp.diagnose.problem import threshold
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.normal_equations import losses
from tests.diagnose import known

ALL = [name for name, law in CATALOGUE.items() if law.kind != "calibration"]


def gain(hidden: dict, motion) -> float:
    """Gain of an effect of some size on noisy data with it, on average over six draws of the noise."""
    gains = []
    for seed in range(6):
        problem = known.problem(hidden, seed=11 + seed, at=motion)
        base, full = known.fitted(problem), known.fitted(problem, hidden)
        gains.append(float(base.loo_loss.sum() - full.loo_loss.sum()))
    return float(np.mean(gains))


def test_size_of_a_linear_effect_is_the_closed_form() -> None:
    """J such that J^2 |qdd without what the joint's nine numbers take up|^2/sigma^2 is the gain that is needed."""
    problem = known.problem(seed=10)
    fit = known.fitted(problem)
    [size] = smallest_sizes(problem, fit, ["rotor_inertia"]).values()
    table = problem.equations([fit.slopes, problem.motion.qdd[None]], fit.torque)
    left = losses(table, list(range(9)), 9)[1].sum()
    assert size == pytest.approx((np.sqrt(threshold(problem, fit)) + 1.645) / np.sqrt(left), rel=0.02)


@pytest.mark.parametrize(
    "effect",
    ["rotor_inertia", "coil_lag", "command_delay", "coulomb_friction", "current_viscosity", "wear", "stribeck"],
)
def test_effect_of_that_size_just_shows(effect: str) -> None:
    """Hidden at the stated size, the effect gains about what is needed; at a third of it, far less."""
    motion = known.motion(10, runs=6, seconds=3.0)
    problem = known.problem(seed=10, at=motion)
    fit = known.fitted(problem)
    size = smallest_sizes(problem, fit, [effect])[effect]
    assert size is not None
    c = problem.parameters((effect,))
    first = c.slots[0].parameter.name
    others = {}
    for slot in c.slots[1:]:
        starts = slot.parameter.starts
        others[slot.parameter.name] = (
            starts(motion.ranges)[len(starts(motion.ranges)) // 2] if starts else slot.parameter.null
        )
    # so much that 19 of 20 pass the threshold; a gain of 51 scatters by 14, its mean over six by 6
    need = (np.sqrt(threshold(problem, fit)) + 1.645) ** 2
    assert 0.65 * need < gain({effect: {first: size, **others}}, motion) < 2.0 * need
    assert gain({effect: {first: size / 3.0, **others}}, motion) < 0.4 * need


def test_sizes_follow_noise_and_length() -> None:
    """Twice the noise needs twice the size; four times as many trajectories half of it, while chi-squared decides."""

    def size(sigma: float, runs: int) -> float:
        problem = known.problem(seed=12, at=known.motion(12, runs=runs, seconds=2.0), sigma=sigma)
        return smallest_sizes(problem, known.fitted(problem), ["rotor_inertia"])["rotor_inertia"] or np.nan

    base = size(0.02, 4)
    assert size(0.04, 4) == pytest.approx(2.0 * base, rel=0.05)
    assert size(0.02, 16) == pytest.approx(0.5 * base, rel=0.25)


def test_constant_current_hides_what_acts_on_it() -> None:
    """At one level of current a delay of any size is invisible, an inertia is not."""
    problem = known.problem(seed=13, at=known.motion(13, current=0.8))
    sizes = smallest_sizes(problem, known.fitted(problem), ["command_delay", "coil_lag", "rotor_inertia"])
    assert sizes["rotor_inertia"] is not None and sizes["command_delay"] is None and sizes["coil_lag"] is None


def test_every_candidate_is_seen_or_unseen() -> None:
    """Each effect that is not part of the model is looked at; a size that shows is inside its range."""
    hidden = {"coil_lag": {"time_constant": 0.01}}
    problem = known.problem(hidden, seed=14, at=known.motion(14, runs=6, seconds=2.0))
    fit = known.fitted(problem, hidden)
    sizes = smallest_sizes(problem, fit, ALL)
    assert set(sizes) == set(ALL) - {"coil_lag"}
    for name, size in ((name, size) for name, size in sizes.items() if size is not None):
        assert 0.0 < size < np.inf
        p = CATALOGUE[name].parameters[0]
        assert size <= max(abs(end(problem.motion.ranges) - p.null) for end in (p.low, p.high))
