"""How a log is read: fewer samples of the same motion, runs that begin under way, clocks that differ."""

import dataclasses

import numpy as np
import pytest

from mrwarp.diagnose.baseline import (
    align_clocks,
    begin_under_way,
    decimate,
    quiet_current,
    shift_stands,
    smooth_motion,
    with_error_of_smoothing,
)
from mrwarp.diagnose.problem import Fit, Problem, covariance, fit_model, refit
from mrwarp.identify.dataset import Motion, Scales
from mrwarp.identify.replay import EffectReplay
from mrwarp.recording.load import Recording, Trajectory
from mrwarp.sysid.settings import Reading
from tests.diagnose import known

INERTIA = {"rotor_inertia": {"inertia": 0.02}}
FEW = Reading(samples=10)
STIFF = {"beta": 60.0, "gamma": -20.0}
"""A hysteresis that has mostly yielded by the time the runs are cut."""


def _swings(rates: tuple[float, ...], seconds: float = 2.0) -> Recording:
    """A 2 Hz swing at each rate, with a step of the current in the middle."""
    runs = []
    for k, rate in enumerate(rates):
        t = np.arange(round(seconds * rate)) / rate
        w = 4.0 * np.pi
        runs.append(
            Trajectory(
                id=f"run {k}",
                t=t,
                q=np.sin(w * t),
                qd=w * np.cos(w * t),
                current=np.where(t < 1.0, 0.5, 1.5),
                torque=np.cos(w * t),
                temperature=20.0 + t,
            )
        )
    return Recording(trajectories=tuple(runs))


def test_short_recordings_stay_as_they_are() -> None:
    """Up to the limit, at any rate."""
    recording = _swings((3000.0, 3000.0))
    assert decimate(recording, Reading()) == (recording, None)


@pytest.mark.parametrize(("limit", "rates"), [(9000, (1000.0, 1000.0, 200.0)), (4000, (600.0, 600.0, 200.0))])
def test_fast_trajectories_are_thinned_until_they_are_few(limit: int, rates: tuple[float, ...]) -> None:
    """By odd factors, equal for all; slow trajectories stay."""
    recording = _swings((3000.0, 3000.0, 200.0))
    out, note = decimate(recording, Reading(samples=limit))
    assert [round(1.0 / run.dt) for run in out.trajectories] == list(rates)
    assert out.samples <= limit and note is not None and str(out.samples) in note
    assert out.trajectories[2] is recording.trajectories[2]


def test_thinned_motion_is_the_same() -> None:
    """At the samples that are left: motion without a shift, the current one step, torque and temperature as logged."""
    run = decimate(_swings((1000.0,)), FEW)[0].trajectories[0]
    w = 4.0 * np.pi
    assert 1.0 / run.dt == pytest.approx(1000.0 / 3.0)
    np.testing.assert_allclose(run.q, np.sin(w * run.t), atol=1e-4)
    np.testing.assert_allclose(run.qd, w * np.cos(w * run.t), atol=1e-3)
    np.testing.assert_allclose(run.torque, np.cos(w * run.t))
    assert run.temperature is not None
    np.testing.assert_allclose(run.temperature, 20.0 + run.t)
    assert np.array_equal(run.current, np.where(run.t < 1.0, 0.5, 1.5))


def test_rates_under_the_least_are_left() -> None:
    """However long they are."""
    recording = _swings((500.0, 250.0))
    assert decimate(recording, FEW) == (recording, None)


def test_quick_torque_is_not_thinned() -> None:
    """Ten samples per period stay, or an acceleration would be too small: 60 Hz at 1 kHz is not thinned."""
    slow = _swings((1000.0,))
    run = slow.trajectories[0]
    quick = dataclasses.replace(run, torque=run.torque + 2.0 * np.sin(2.0 * np.pi * 60.0 * run.t))
    assert decimate(slow, FEW)[0].samples < slow.samples
    assert decimate(dataclasses.replace(slow, trajectories=(quick,)), FEW)[1] is None


def _cut(long: Motion, first: int) -> Motion:
    """Each run without its first samples."""
    taken = np.concatenate([np.arange(p.start + first, p.stop) for p in long.parts])
    arrays = {name: getattr(long, name)[..., taken] for name in ("q", "qd", "qdd", "current", "torque", "time", "heat")}
    start = np.concatenate([[0], np.cumsum(np.diff(long.start) - first)])
    return dataclasses.replace(long, **arrays, slid_time=long.slid_time[taken], start=start)


def _begun(cut_off: int) -> tuple[Problem, Fit]:
    """Data of a device that started without stress before the cut, and the joint fitted to them."""
    at = _cut(known.problem(sigma=1e-3, **STIFF).motion, cut_off)
    problem = dataclasses.replace(known.posed(at, sigma=1e-3), weight=at.settled(30.0))
    layout = problem.parameters(())
    return problem, fit_model(problem, layout, known.vector(layout, **STIFF))


def test_begin_is_the_direction_of_sliding() -> None:
    """Only where the first sample moves."""
    at = known.motion()
    first = at.start[:-1]
    qd = at.qd.copy()
    qd[first] = (0.0, 0.02, -0.02, 2.0, -2.0, 3.0, -3.0, 1.0)
    begin = dataclasses.replace(at, qd=qd).under_way().begin
    assert begin is not None
    assert begin.tolist() == [0.0, 0.0, 0.0, 1.0, -1.0, 1.0, -1.0, 1.0]


def test_steady_stress_holds_from_the_first_sample() -> None:
    """At a constant velocity the torque does not change with time when z begins under way, either way."""
    at = known.motion(current=1.0)
    s = at
    for direction in (1.0, -1.0):
        zero, qd = np.zeros(len(s.q)), np.full(len(s.q), direction)
        moved = dataclasses.replace(at, q=zero, qd=qd, qdd=zero)
        c = known.problem().parameters(())
        row = c.row(known.vector(c))
        steady = EffectReplay(moved.under_way()).torque(row)[0]
        settling = EffectReplay(moved).torque(row)[0]
        assert np.ptp(steady) < 1e-5 * abs(steady[-1])
        assert steady[-1] == pytest.approx(settling[s.start[1] - 1], rel=1e-4)
        assert abs(settling[0]) < 0.5 * abs(steady[0])


def test_heads_tell_a_cut_record() -> None:
    """Runs cut in mid-motion begin under way, and the heads then fit better; runs from rest do not."""
    cut, fit = _begun(150)
    heads = cut.weight == 0.0
    for k in (3, 6):  # these runs are cut at a reversal
        heads[cut.motion.parts[k]] = False
    before = float(np.abs(cut.motion.torque - fit.torque)[heads].mean())
    begun = begin_under_way(cut, fit)
    assert cut.motion.begin is None and begun.motion.begin is not None
    assert np.flatnonzero(begun.motion.begin == 0.0).tolist() == [3, 6]
    again = refit(begun, fit)
    assert float(np.abs(cut.motion.torque - again.torque)[heads].mean()) < 0.5 * before
    whole, fit = _begun(0)
    assert begin_under_way(whole, fit) is whole


@pytest.mark.parametrize(("noise", "quiet"), [(0.0, False), (0.03, True)])
def test_noise_of_a_measured_current_is_taken_off_it(noise: float, quiet: bool) -> None:
    """So that no play or lag is named for that; a current that is known exactly stays as it is, remanence or not."""
    made = known.problem({} if quiet else {"remanence": {"half_width": 0.05}}, sigma=2e-3)
    off = noise * np.random.default_rng(5).normal(size=len(made.measured))
    logged = dataclasses.replace(made.motion, current=made.motion.current + off, torque=made.measured)
    problem = known.posed(logged, sigma=2e-3)
    found = quiet_current(problem, known.fitted(problem))
    assert (found is not problem) is quiet
    if quiet:
        left = found.motion.current - made.motion.current
        assert found.motion.medians > 1 and np.median(np.abs(left)) < 0.5 * np.median(np.abs(off))


def _late(at: Motion, samples: float) -> Motion:
    """The motion as it is logged by clocks that are late."""
    return dataclasses.replace(at.later(-samples), ahead=0.0)


def test_shifted_motion_is_that_between_the_samples() -> None:
    """Linear in between, trajectory by trajectory; the last sample is held."""
    at = known.motion(runs=2, seconds=1.0)
    late = at.later(0.25)
    q, size = at.q, 200
    assert late.ahead == 0.25
    np.testing.assert_allclose(late.q[: size - 1], 0.75 * q[: size - 1] + 0.25 * q[1:size])
    assert late.q[size - 1] == q[size - 1] and late.q[-1] == q[-1]


@pytest.mark.parametrize("ahead", [0.4, 0.75])
def test_torque_ahead_of_the_motion_is_found(ahead: float) -> None:
    """To a tenth of a sample, and the motion is shifted by it."""
    made = known.problem(INERTIA, sigma=2e-3, at=known.motion(3, runs=6))
    logged = dataclasses.replace(_late(made.motion, ahead), torque=made.measured)
    problem = known.posed(logged, sigma=2e-3)
    aligned = align_clocks(problem, known.fitted(problem, INERTIA))
    assert aligned.motion.ahead == pytest.approx(ahead, abs=0.1) and problem.motion is logged
    np.testing.assert_allclose(aligned.motion.qd[10:700], made.motion.qd[10:700], atol=0.05)
    assert np.array_equal(aligned.motion.torque, made.motion.torque)


@pytest.mark.parametrize("ahead", [0.0, 0.5])
def test_a_shift_has_to_predict_better_than_causes_without_it(ahead: float) -> None:
    """It stands where the torque is logged ahead, and not where a cause explains the same with the clocks as logged."""
    made = known.problem(INERTIA, sigma=2e-3, at=known.motion(3, runs=6))
    logged = known.posed(dataclasses.replace(_late(made.motion, ahead), torque=made.measured), sigma=2e-3)
    shifted = logged.with_motion(logged.motion.later(0.5))
    models = known.fitted(shifted, INERTIA), known.fitted(logged, INERTIA)
    assert shift_stands(shifted, models[0], logged, models[1]) is (ahead > 0.0)


@pytest.mark.parametrize("effects", [{}, INERTIA, {"torque_sensor_lag": {"time_constant": 0.003}}])
def test_a_log_with_one_clock_stays_as_it_is(effects: dict) -> None:
    """Whether the model fits it, or lacks a lag."""
    problem = known.problem(effects)
    assert align_clocks(problem, known.fitted(problem)) is problem


@pytest.mark.parametrize(("step", "smoothed"), [(2e-3, True), (1e-6, False)])
def test_a_coarse_angle_is_smoothed_where_the_torque_of_an_inertia_asks_for_it(step: float, smoothed: bool) -> None:
    """An acceleration that is derived from a coarse angle is mostly noise, one from a fine angle is not."""
    made = known.problem(INERTIA, sigma=1e-2, at=known.motion(5, runs=8))
    at = made.motion
    q = np.round(at.q / step) * step
    runs = [
        Trajectory(
            id=f"run {k}",
            t=10.0 * k + np.arange(p.stop - p.start) * known.DT,
            q=q[p],
            qd=np.gradient(q[p], known.DT),
            current=at.current[p],
            torque=made.measured[p],
            qd_derived=True,
        )
        for k, p in enumerate(at.parts)
    ]
    recording = Recording(trajectories=tuple(runs))
    problem = known.posed(Motion.of(recording, Scales()), sigma=1e-2)
    fit = known.fitted(problem, INERTIA)
    found = smooth_motion(problem, recording, fit)
    assert (found.motion is not problem.motion) == smoothed
    if smoothed:
        error = [np.std((x - at.qdd)[100:-100]) for x in (problem.motion.qdd, found.motion.qdd)]
        assert found.motion.kinematics.smoothing > 1.0 and error[1] < 0.7 * error[0]
        return
    # one that was smoothed for want of a cause is read again as it is
    rough = problem.with_motion(Motion.of(recording, Scales(), smoothing=4.0))
    assert smooth_motion(rough, recording, fit).motion.kinematics.smoothing == 1.0
    # an interval holds next to the smoother's error, by Richardson's extrapolation of second order from half as much
    very_rough = problem.with_motion(Motion.of(recording, Scales(), smoothing=8.0))
    fits = [known.fitted(reading, INERTIA) for reading in (very_rough, rough)]
    stated = with_error_of_smoothing(very_rough, recording, fits[0])
    before, after = (covariance(x)[-1, -1] for x in (fits[0], stated))
    assert after == pytest.approx(before + ((fits[0].x[-1] - fits[1].x[-1]) / 0.75) ** 2, rel=1e-2) and after > before
    plain = known.fitted(problem)
    assert with_error_of_smoothing(problem, recording, plain) is plain
    # of a joint that its drive could not move at first, reversals do not count
    still = np.arange(len(at.q)) < 20
    kinematics = dataclasses.replace(problem.motion.kinematics, still=still)
    sticking = problem.with_motion(dataclasses.replace(problem.motion, kinematics=kinematics))
    read = smooth_motion(dataclasses.replace(sticking, weight=1.0 * ~still), recording, fit)
    reversing, one_sided = read.motion.kinematics.reversing, read.motion.kinematics.one_sided
    assert reversing is not None and 0.02 < reversing.mean() < 0.4
    assert one_sided is not None and 0.0 < one_sided.mean() < 0.1
    assert not read.weight[reversing | one_sided].any() and read.weight[~reversing & ~one_sided & ~still].all()
    # nor do those of a joint that a drive moves against a known load, which need not rest anywhere
    ranges = dataclasses.replace(problem.motion.ranges, load=True, carried=True)
    loaded = problem.with_motion(dataclasses.replace(problem.motion, ranges=ranges))
    assert not smooth_motion(loaded, recording, fit).weight[reversing].any()
    assert (smooth_motion(problem, recording, fit).weight == ~one_sided).all()
