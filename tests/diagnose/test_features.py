"""Groups of smooth functions: what they depend on, in any units, and that they find structure along it."""

import dataclasses

import numpy as np
import pytest

from mrwarp.diagnose.choice import leftovers, threshold
from mrwarp.diagnose.features import Group, make_groups
from mrwarp.diagnose.prepare import groups_of
from mrwarp.identify.dataset import Motion
from tests.diagnose import known

WORDS = {"q", "qd", "qdd", "current", "time", "memory"}


def groups(motion: Motion) -> list[Group]:
    """Groups along some loop."""
    loop = np.tanh(3.0 * motion.qd)
    return make_groups(motion, loop, (0.4 + motion.current) * loop)


def test_groups_are_finite_named_and_not_constant() -> None:
    """Every row is a finite function that varies, every group says on what it depends, none stands twice."""
    motion = known.motion(2, runs=4, seconds=2.0)
    found = groups(motion)
    assert len({(g.variables, g.form) for g in found}) == len(found)
    for group in found:
        assert set(group.variables) <= WORDS and group.form
        assert group.rows.shape[1] == len(motion.q) and len(group.rows)
        assert np.isfinite(group.rows).all() and (group.rows.std(axis=1) > 0.0).all()
    assert {name for g in found for name in g.variables} == WORDS


def test_constant_current_has_no_functions_of_it() -> None:
    """Where the current never changes, no row depends on it alone."""
    found = groups(known.motion(2, runs=4, seconds=2.0, current=0.8))
    assert all(len(g.rows) == 0 for g in found if g.variables == ("current",))


def test_functions_do_not_depend_on_the_units() -> None:
    """In other units of angle and current the same rows come out."""
    motion = known.motion(2, runs=3, seconds=1.0)
    s, r = motion, motion.ranges
    other = dataclasses.replace(
        motion, qdd=0.04 * motion.qdd,
        ranges=dataclasses.replace(r, q=0.04 * r.q, qd=0.04 * r.qd, current=6.0 * r.current),
        samples=dataclasses.replace(s, q=0.04 * s.q, qd=0.04 * s.qd, current=6.0 * s.current),
    )  # fmt: skip
    loop = np.tanh(3.0 * s.qd)
    here = make_groups(motion, loop, 2.0 * loop)
    there = make_groups(other, 0.04 * loop, 10.0 * loop)
    for a, b in zip(here, there, strict=True):
        np.testing.assert_allclose(b.rows, a.rows, rtol=1e-9, atol=1e-12)


STRUCTURE = {
    "a bump over the angle": (lambda s, m: 0.1 * np.sin(4.0 * s.q), {"q"}),
    "ripple over the angle": (lambda s, m: 0.05 * np.sin(25.0 * s.q + 0.4), {"q"}),
    "angle and velocity": (lambda s, m: 0.15 * s.q**2 * s.qd, {"q", "qd"}),
    "angle and current": (lambda s, m: 0.15 * np.sin(4.0 * s.q) * s.current**2, {"q", "current"}),
    "velocity": (lambda s, m: 0.02 * s.qd * np.abs(s.qd), {"qd"}),
    "acceleration": (lambda s, m: 0.003 * m.qdd, {"qdd"}),
    "drift": (lambda s, m: 0.01 * m.time * s.qd, {"time"}),
}


@pytest.mark.parametrize("name", list(STRUCTURE))
def test_structure_shows_in_its_variables(name: str) -> None:
    """What is added to the torque of the joint stands first among the leftovers, under a variable it depends on."""
    make, variables = STRUCTURE[name]
    motion = known.motion(5)
    engine = known.engine(seed=5, at=motion, plus=make(motion, motion))
    fit = known.fitted(engine)
    found = leftovers(engine, fit, groups_of(engine, fit.coordinates, fit.x))
    assert found[0].gain > 3.0 * threshold(fit) and found[0].t > 2.0
    assert variables & set(found[0].group.variables[:2])
    assert [f.gain for f in found] == sorted((f.gain for f in found), reverse=True)


def test_clean_data_leave_nothing() -> None:
    """Without structure no group passes the threshold; most lose, held-out."""
    engine = known.engine(seed=6)
    fit = known.fitted(engine)
    found = leftovers(engine, fit, groups_of(engine, fit.coordinates, fit.x))
    assert max(f.gain for f in found) < threshold(fit)
    assert np.mean([f.gain < 0.0 for f in found]) > 0.5
