"""A joint that turns once, slowly, both ways: all lines of its cogging, through what reports its torque so late."""

import numpy as np
import pytest
from scipy.signal import lfilter

from mrwarp.diagnose.problem import Problem, fit_model, reported_fit
from mrwarp.diagnose.proof import _size_rejection, select_proven
from mrwarp.diagnose.screening import Models
from mrwarp.diagnose.search import screen_candidates
from mrwarp.effects.catalogue import parameter_of
from mrwarp.identify.dataset import Motion, rms
from mrwarp.recording.load import Recording, Trajectory
from tests.diagnose import known

LINES = {7: 0.30, 28: 0.22, 14: 0.16, 36: 0.12, 12: 0.09}
"""Repetitions per turn and their size [A]."""
UNITS = {"q": "rad", "current": "none", "torque": "A"}


def turned_once(unit: str = "A", lines: dict[int, float] = LINES, lag: float = 0.12, short: float = 0.05) -> Recording:
    """Four turns, two each way, at 0.3 to 0.6 rad/s and 100 Hz; dry friction, a first-order filter, noise.

    ``short`` is by how much a turn ends before 2*pi [rad].
    """
    rng = np.random.default_rng(12)
    phases, runs = {n: rng.uniform(0.0, 2.0 * np.pi) for n in lines}, []
    for k, speed in enumerate((0.4, -0.5, 0.6, -0.45)):
        t = np.arange(round(((2.0 * np.pi - short) / abs(speed) + 0.3) / 1e-3)) * 1e-3
        qd = speed * (0.5 - 0.5 * np.cos(np.pi * np.minimum(t / 0.6, 1.0)))
        q = np.cumsum(qd) * 1e-3 + (0.0 if speed > 0.0 else 2.0 * np.pi - short)
        torque = 0.25 * np.tanh(qd / 0.005) + 0.1 * qd + sum(a * np.sin(n * q + phases[n]) for n, a in lines.items())
        keep = np.exp(-1e-3 / lag)
        torque = lfilter([1.0 - keep], [1.0, -keep], torque, zi=[keep * torque[0]])[0][::10]
        torque = torque + 0.02 * rng.normal(size=len(torque))
        runs.append(
            Trajectory(id=f"{k}", t=t[::10], q=q[::10], qd=qd[::10], current=np.zeros(len(torque)), torque=torque)
        )
    return Recording(trajectories=tuple(runs), units={**known.JOINT_UNITS, **UNITS, "torque": unit})


def posed(recording: Recording) -> Problem:
    """The recording as a problem with noise of its size."""
    motion = Motion.of(recording)
    return known.posed(motion, sigma=0.02 / motion.scales.torque, units=recording.units)


@pytest.mark.parametrize(
    ("lines", "lag"),
    [
        (LINES, 0.12),
        pytest.param({5: 0.22, 10: 0.20, 20: 0.14, 40: 0.10}, 0.08, marks=pytest.mark.slow),
        ({7: 0.20, 14: 0.17, 21: 0.16, 9: 0.14}, 1e-4),
    ],
)
def test_each_line_that_predicts_is_found_through_the_lag_of_a_drive(lines: dict[int, float], lag: float) -> None:
    """Lines of which one or two stand out, and the lag of the reported current, if any; what is left is the noise.

    With the strongest line alone, functions along the angle do as well, and a lag adds little to what is left.
    """
    problem = posed(turned_once(lines=lines, lag=lag))
    layout = problem.parameters(())
    stiff = {"D": 0.0, "B": 0.1, "C": 0.0, "I1": 0.0, "K0": 30.0, "K1": 0.0, "alpha": 0.0, "beta": 100.0, "gamma": 0.0}
    base = fit_model(problem, layout, known.vector(layout, **stiff))
    models = Models(problem, base)
    selection, rejections = select_proven(models, screen_candidates(problem, base, ["cogging", "torque_sensor_lag"]))
    lags = lag > 0.01
    assert set(selection.named) == {"cogging", *(["torque_sensor_lag"] if lags else [])} and not rejections
    fit = models.reported(selection.final)
    numbers, turn = fit.parameters.values(fit.x), problem.motion.scales.q
    repeats = [value / turn for name, value in numbers["cogging"].items() if name.startswith("periods")]
    assert sorted(repeats) == pytest.approx(sorted(lines), abs=0.1)
    assert not lags or numbers["torque_sensor_lag"]["time_constant"] == pytest.approx(lag, rel=0.05)
    left = problem.motion.torque - fit.torque
    assert rms(left) < 0.09 * problem.motion.torque.std() < 0.2 * rms(problem.motion.torque - base.torque)


def test_noise_has_no_lines() -> None:
    """One line and noise: no second one is found."""
    problem = posed(turned_once(lines={7: 0.3}, lag=1e-4))
    layout = problem.parameters(("cogging",), {("cogging", "periods"): 7.0 * problem.motion.scales.q})
    stiff = {"D": 0.0, "B": 0.1, "C": 0.0, "I1": 0.0, "K0": 30.0, "K1": 0.0, "alpha": 0.0, "beta": 100.0, "gamma": 0.0}
    fit = fit_model(problem, layout, known.vector(layout, {"cogging": {"sine": 0.1, "cosine": 0.1}}, **stiff))
    found = reported_fit(problem, fit).parameters
    assert not [name for effect, name in found.choices if name.startswith("periods_")]


@pytest.mark.parametrize(("unit", "possible"), [("A", True), ("V", True), ("N·m", False)])
def test_what_lags_may_be_a_drive(unit: str, possible: bool) -> None:
    """A drive's report may lag by 0.1 s and more; a sensor of torque does not, with any data."""
    problem = posed(turned_once(unit))
    ranges, bound = problem.motion.ranges, parameter_of("torque_sensor_lag", "time_constant")
    assert ranges.drive == possible and (bound.most(ranges) > 0.15) == possible
    layout = problem.parameters(("torque_sensor_lag",))
    x = known.vector(layout, {"torque_sensor_lag": {"time_constant": 0.09}})
    fit = fit_model(problem, layout, x, iterations=0)
    assert ("are not possible" in _size_rejection("torque_sensor_lag", fit, problem)) != possible


def test_a_turn_that_ends_a_little_short_is_one() -> None:
    """6.2 rad show the lines of a whole turn; half a turn does not."""
    assert [Motion.of(turned_once(short=short)).ranges.turns for short in (0.0, 0.08, 3.2)] == [1.0, 1.0, 0.0]
