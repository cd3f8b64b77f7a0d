"""Rest of a model: groups of smooth functions find structure along their variables, and lines are found."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from mrwarp.diagnose.problem import threshold
from mrwarp.diagnose.residual_structure import (
    Group,
    Line,
    drift_of_zero,
    find_line,
    leftovers,
    make_groups,
    without_line,
)
from mrwarp.identify.dataset import Motion
from mrwarp.sysid.settings import Settings
from tests.diagnose import known
from tests.identify.synthetic import DT, samples

WORDS = {"q", "qd", "qdd", "current", "time", "memory"}


def groups(motion: Motion) -> list[Group]:
    """Groups along some loop."""
    loop = np.tanh(3.0 * motion.qd)
    return make_groups(motion, loop, (0.4 + motion.current) * loop, 0.02)


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


def test_what_depends_on_the_angle_of_a_turning_joint_comes_again_each_turn() -> None:
    """A gap that is wider at one side of a brake, seen over five turns, is in the span of a group of angle and loop."""
    motion = known.motion(2, runs=4, seconds=2.0)
    far = 5.0 * 2.0 * np.pi / np.ptp(motion.q)
    turning = dataclasses.replace(
        motion, q=far * motion.q, ranges=dataclasses.replace(motion.ranges, q=10.0 * np.pi, turns=5.0, radian=1.0)
    )
    wobble = np.cos(turning.q + 1.0) * np.tanh(3.0 * motion.qd) * (0.4 + motion.current)
    missed = {}
    for group in groups(turning):
        fitted = np.linalg.lstsq(group.rows.T, wobble, rcond=None)[0] @ group.rows
        missed[group.variables] = min(missed.get(group.variables, 1.0), np.std(wobble - fitted) / np.std(wobble))
    assert min(missed, key=lambda key: missed[key]) == ("q", "memory") and missed["q", "memory"] < 1e-6


def test_a_zero_that_drifts_is_a_line_in_time() -> None:
    """Its size and its share are those of the line; samples that do not count, and the runs' own zeros, do not act."""
    motion = known.motion(2, runs=3, seconds=4.0)
    noise = np.random.default_rng(0).normal(scale=0.01, size=len(motion.q))
    ramp = np.tile(np.linspace(-0.5, 0.5, len(motion.q) // 3), 3)
    weight = np.ones(len(motion.q))
    weight[::7], weight[: motion.start[1]] = 0.0, 0.0
    error = (
        noise + np.repeat([0.0, 0.3, -0.2], np.diff(motion.start)) * ramp + np.repeat([1.0, -2.0, 0.5], len(ramp) // 3)
    )
    error[::7] = 9.0
    moved, shares = drift_of_zero(motion, error, weight)
    five = 5.0 * 0.01 * np.sqrt(12.0 / (len(ramp) / 3.0 * 6.0 / 7.0))  # standard errors of a line's two ends
    assert moved == pytest.approx([0.0, 0.3, -0.2], abs=five)
    line = np.array([0.3, 0.2]) ** 2 / 12.0
    assert shares[1:] == pytest.approx(line / (line + 0.01**2), abs=0.02) and shares[0] == 0.0
    assert (drift_of_zero(motion, noise, np.ones(len(noise)))[1] < 0.05).all()


def test_an_input_that_never_changes_is_no_variable() -> None:
    """Neither at zero, as of a device without one, nor at another level."""
    for level in (0.0, 1.2):
        assert not [g.key for g in groups(known.motion(runs=3, seconds=2.0, current=level)) if "current" in g.variables]


def test_functions_do_not_depend_on_the_units() -> None:
    """In other units of angle and current the same rows come out."""
    motion = known.motion(2, runs=3, seconds=1.0)
    s, r = motion, motion.ranges
    other = dataclasses.replace(
        motion,
        qdd=0.04 * motion.qdd,
        ranges=dataclasses.replace(r, q=0.04 * r.q, qd=0.04 * r.qd, current=6.0 * r.current),
        q=0.04 * s.q,
        qd=0.04 * s.qd,
        current=6.0 * s.current,
    )
    loop = np.tanh(3.0 * s.qd)
    here = make_groups(motion, loop, 2.0 * loop, 0.02)
    there = make_groups(other, 0.04 * loop, 10.0 * loop, 0.02)
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
    """A term added to the joint's torque stands first among the leftovers, under a variable it depends on."""
    make, variables = STRUCTURE[name]
    motion = known.motion(5)
    problem = known.problem(seed=5, at=motion, plus=make(motion, motion))
    fit = known.fitted(problem)
    found = leftovers(problem, fit)
    assert found[0].gain > 3.0 * threshold(problem, fit) and found[0].t > 2.0
    assert variables & set(found[0].group.variables[:2])
    assert [f.gain for f in found] == sorted((f.gain for f in found), reverse=True)


def test_clean_data_leave_nothing() -> None:
    """Without structure no group passes the threshold; most lose, held-out."""
    problem = known.problem(seed=6)
    fit = known.fitted(problem)
    found = leftovers(problem, fit)
    assert max(f.gain for f in found) < threshold(problem, fit)
    assert np.mean([f.gain < 0.0 for f in found]) > 0.5


def line_in(mismatch: np.ndarray, torque: np.ndarray, lengths: list[int]) -> Line | None:
    """The line in a mismatch next to a simulated torque, in white noise of size 1."""
    data = dataclasses.replace(samples(lengths), torque=mismatch + torque)
    problem: Any = SimpleNamespace(motion=data, noise=known.white(1.0), settings=Settings())
    fit: Any = SimpleNamespace(torque=torque)
    return find_line(problem, fit)


def with_line(seed: int, lengths: list[int], frequency: float, size: float, share: float = 1.0) -> np.ndarray:
    """White noise with a line of its own phase in the first ``share`` of the trajectories."""
    rng = np.random.default_rng(seed)
    out = []
    for k, n in enumerate(lengths):
        line = size * np.sin(2 * np.pi * frequency * DT * np.arange(n) + rng.uniform(0, 2 * np.pi))
        out.append(rng.normal(size=n) + (line if k < share * len(lengths) else 0.0))
    return np.concatenate(out)


def still(lengths: list[int]) -> np.ndarray:
    """Simulated torque of a joint at rest."""
    return np.zeros(sum(lengths))


@pytest.mark.parametrize("frequency", [3.0, 7.3, 50.0, 91.7])
@pytest.mark.parametrize("lengths", [[1600] * 32, [800] * 12], ids=["large", "small"])
def test_line_is_found(frequency: float, lengths: list[int]) -> None:
    """A line of 0.4 of the noise's RMS, with a phase of its own in each trajectory, to half a bin."""
    size = 0.4 * np.sqrt(2.0)
    found = line_in(with_line(1, lengths, frequency, size), still(lengths), lengths)
    assert found is not None
    assert found.frequency == pytest.approx(frequency, abs=0.6 / (lengths[0] * DT))
    # taking it out gains size^2/2 per sample where the bin holds all of it, 40 % of it where two bins share it
    possible = sum(lengths) * size**2 / 2.0
    assert 0.3 * possible < found.gain < 1.1 * possible


def test_no_line_in_noise() -> None:
    """In 40 data sets of white and coloured noise there is none."""
    lengths = [800] * 12
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(size=sum(lengths))
        keep = np.exp(-DT / 0.05)
        if seed % 2:
            noise = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], noise)
        assert line_in(noise, still(lengths), lengths) is None, seed


def test_swinging_mismatch_is_no_line() -> None:
    """Each trajectory's own motion frequency is none: it is another one in the next trajectory."""
    lengths, rng = [800] * 12, np.random.default_rng(3)
    t = DT * np.arange(800)
    parts = [np.sin(2 * np.pi * (0.5 + 0.13 * k) * t) + rng.normal(size=800) for k in range(12)]
    assert line_in(np.concatenate(parts), still(lengths), lengths) is None


def test_line_in_few_trajectories_is_none() -> None:
    """In a third of the trajectories it is an event, not a line; with three trajectories nothing is said."""
    lengths = [800] * 12
    assert line_in(with_line(4, lengths, 20.0, 1.0, share=1 / 3), still(lengths), lengths) is None
    assert line_in(with_line(4, lengths, 20.0, 1.0), still(lengths), lengths) is not None
    assert line_in(with_line(5, [800] * 3, 20.0, 1.0), still([800] * 3), [800] * 3) is None


def test_shorter_trajectories_are_left_out() -> None:
    """Trajectories of less than nine tenths of the usual length do not distort the bins."""
    lengths = [800] * 8 + [300] * 3
    found = line_in(with_line(6, lengths, 33.0, 0.8), still(lengths), lengths)
    assert found is not None and found.frequency == pytest.approx(33.0, abs=0.15)


def test_what_follows_the_motion_is_no_line() -> None:
    """A wrong gain in each trajectory of a swing at the same frequency everywhere."""
    lengths, rng = [800] * 12, np.random.default_rng(7)
    swing = np.tile(np.sin(2 * np.pi * 3.0 * DT * np.arange(800)), 12)
    gains = np.repeat(rng.normal(size=12), 800)
    mismatch = gains * swing + rng.normal(size=len(swing))
    assert line_in(mismatch, still(lengths), lengths) is not None
    assert line_in(mismatch, swing, lengths) is None


def test_line_is_set_aside_with_its_phase_in_each_trajectory() -> None:
    """A line of known frequency leaves the torque; what remains is the noise, and the measured torque is kept."""
    motion = known.motion()
    rng = np.random.default_rng(6)
    t = motion.time - np.repeat(motion.time[motion.start[:-1]], np.diff(motion.start))
    phase = np.repeat(rng.uniform(0, 2 * np.pi, 8), np.diff(motion.start))
    line = 0.05 * np.sin(2 * np.pi * 17.3 * t + phase)
    problem = known.problem(plus=line)
    plain = known.problem()
    cleaned = without_line(problem, known.fitted(plain), Line(frequency=17.28, gain=0.0))
    left = cleaned.motion.torque - plain.motion.torque
    assert np.sqrt(np.mean(left**2)) < 0.1 * np.sqrt(np.mean(line**2))
    np.testing.assert_allclose(cleaned.measured - plain.motion.torque, line, atol=1e-9)
