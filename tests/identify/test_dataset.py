"""Replay with effects: the session's clock, the stored heat, units inside, threads."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from mrwarp.effects.catalogue import column_of
from mrwarp.effects.replay_kernel import BASE, HEAT_TIMES, LAWS
from mrwarp.identify.dataset import Motion, Scales
from mrwarp.identify.replay import EffectReplay, null_row, simulate
from mrwarp.recording.data import session_clock
from mrwarp.recording.load import Recording, Trajectory
from tests.diagnose import known


def run(begin: float, torque: float = 2.0, seconds: float = 2.0, dt: float = 0.005) -> Trajectory:
    """A run with constant velocity 3 rad/s, torque and current 1 A."""
    t = np.arange(round(seconds / dt)) * dt
    one = np.ones(len(t))
    return Trajectory(id=f"at {begin}", t=begin + t, q=3.0 * t, qd=3.0 * one, current=one, torque=torque * one)


def test_session_clock_is_the_recorded_time() -> None:
    """Runs whose times follow each other keep their pauses, in any order; runs that overlap share no clock."""
    in_turn = Recording(trajectories=(run(50.0), run(10.0), run(20.0)))
    np.testing.assert_array_equal(session_clock(in_turn), [40.0, 0.0, 10.0])
    epoch = 1.79e9
    stamped = Recording(trajectories=(run(epoch + 2.0), run(epoch)))
    np.testing.assert_array_equal(session_clock(stamped), [2.0, 0.0])
    np.testing.assert_array_equal(session_clock(Recording(trajectories=(run(7.0),))), [0.0])
    for begins in ((0.0, 0.0, 0.0), (0.0, 1.0)):
        assert session_clock(Recording(trajectories=tuple(run(begin) for begin in begins))) is None


def test_runs_without_a_common_clock_each_begin_at_zero() -> None:
    """Time, the path slid and the heat are those of the run itself, regardless of the runs before it in the folder.

    Path and heat are sums: their N terms round by 2**-53 each, differently where a run has another length and place.
    """
    repeated = Motion.of(Recording(trajectories=(run(0.0), run(0.0), run(0.0))), Scales())
    alone = Motion.of(Recording(trajectories=(run(0.0),)), Scales())
    for part in repeated.parts:
        np.testing.assert_array_equal(repeated.time[part], alone.time)
        rounding = 3 * len(alone.time) * np.finfo(float).eps
        np.testing.assert_allclose(repeated.slid_time[part], alone.slid_time, rtol=rounding)
        np.testing.assert_allclose(repeated.heat[:, part], alone.heat, rtol=rounding)
    assert repeated.ranges.session == alone.ranges.session


@pytest.mark.parametrize("resistance", [0.0, 4.0])
def test_heat_is_the_solution_of_its_equation(resistance: float) -> None:
    """Constant power P = 6 W (and R*I^2): s = P*T*(1 - exp(-t/T)), decaying through the pause between two runs."""
    recording = Recording(trajectories=(run(0.0), run(12.0)))
    motion = Motion.of(recording, Scales(), resistance=resistance)
    power, dt = 2.0 * 3.0 + resistance, 0.005
    for T, heat in zip(HEAT_TIMES, motion.heat, strict=True):
        t = motion.dt[0] * np.arange(1, 401)
        first = power * T * -np.expm1(-t / T)
        np.testing.assert_allclose(heat[:400], first, rtol=0, atol=1.1 * power * dt)
        pause = first[-1] * np.exp(-(12.0 - 2.0) / T)
        np.testing.assert_allclose(heat[400:], pause * np.exp(-t / T) + first, rtol=0, atol=2.2 * power * dt)


def test_heat_has_the_units_inside() -> None:
    """Divided by the scales of torque and angle the heat is the same, resistive heat included."""
    recording = Recording(trajectories=(run(0.0), run(12.0)))
    outer, inner = (
        Motion.of(recording, scales, resistance=4.0) for scales in (Scales(), Scales(q=0.5, current=1.5, torque=3.0))
    )
    np.testing.assert_allclose(inner.heat * 3.0 * 0.5, outer.heat, rtol=1e-9)


def test_null_row_gives_no_torque() -> None:
    """A row of nothing is a joint without torque."""
    motion = known.motion(runs=2, seconds=1.0)
    assert not EffectReplay(motion).torque(null_row()).any()


def test_replay_without_effects_is_that_of_the_fit() -> None:
    """Eqs. 14 and 15 alone give what the identification's replay gives, to the difference of their steps."""
    motion = known.motion(runs=3, seconds=2.0)
    row = null_row()
    row[: len(BASE)] = [known.TRUTH.get(name, 0.0) for name in BASE]
    tau = EffectReplay(motion).torque(row)[0]
    want = np.concatenate(simulate(known.TRUTH, known.recording(motion, tau), substeps=4))
    assert np.sqrt(np.mean((tau - want) ** 2)) < 2e-3 and np.abs(want).max() > 1.0


def test_motion_is_the_recordings() -> None:
    """Ranges, rates and shapes come from the recording, in normalised units."""
    exact = known.motion(runs=3, seconds=2.0)
    recording = known.recording(exact, np.sin(exact.q))
    motion = Motion.of(recording)
    scales = motion.scales
    assert motion.ranges.q * scales.q == pytest.approx(np.ptp(exact.q))
    assert motion.ranges.qd * scales.q == pytest.approx(exact.ranges.qd, rel=0.02)
    assert motion.ranges.current * scales.current == pytest.approx(exact.current.max())
    assert motion.ranges.dt == pytest.approx(0.005) and motion.ranges.session == pytest.approx(6.0, abs=0.01)
    assert motion.time.shape == motion.qdd.shape == exact.q.shape
    inner = np.concatenate([np.arange(p.start + 30, p.stop - 30) for p in exact.parts])
    np.testing.assert_allclose((motion.qd * scales.q)[inner], exact.qd[inner], atol=0.02)


@pytest.mark.parametrize("threads", [2, 3, 5])
def test_threads_change_no_bit(threads: int) -> None:
    """Any number of threads, more than rows included, gives the same torque."""
    motion = known.motion(runs=3, seconds=1.0)
    rows = np.tile(null_row(), (4, 1))
    rows[:, : len(LAWS)] = [known.TRUTH[name] for name in LAWS]
    rows[:, len(BASE) + column_of("rotor_inertia", "inertia")] = np.linspace(0.0, 0.01, 4)
    rows[:, len(BASE) + column_of("coil_lag", "time_constant")] = np.linspace(0.0, 0.03, 4)
    one = EffectReplay(motion).torque(rows)
    assert np.array_equal(one, EffectReplay(motion, threads=threads).torque(rows))
    assert np.abs(np.diff(one, axis=0)).max(axis=1).min() > 0.01


def test_torque_of_a_recording_does_not_depend_on_its_units() -> None:
    """A recording in other units with converted parameters has the same inner torque."""
    exact = known.motion(runs=2, seconds=1.0)
    torque = np.sin(3.0 * exact.q)
    here: Any = Motion.of(known.recording(exact, torque))
    there: Any = Motion.of(known.recording(exact, torque, q=0.04, current=6.0, size=250.0))
    for name in ("qdd", "heat", "time"):
        np.testing.assert_allclose(getattr(there, name), getattr(here, name), rtol=1e-6, atol=1e-9)
    for name in ("q", "qd", "current", "torque"):
        np.testing.assert_allclose(getattr(there, name), getattr(here, name), rtol=1e-6, atol=1e-9)
    assert here.ranges.radian > 0.0 == there.ranges.radian  # gravity turns with an angle, not with a way
    compared = [name for name in vars(here.ranges) if name != "radian"]
    assert [getattr(there.ranges, n) for n in compared] == pytest.approx([getattr(here.ranges, n) for n in compared])


def test_stretches_keep_what_depends_on_the_past() -> None:
    """One stretch of each run, that begins while the joint moves, with the heat, path and time of the whole session."""
    whole = known.motion(3, runs=6, seconds=20.0)
    part = whole.stretches(len(whole.q) // 4)
    assert whole.stretches(len(whole.q)) is whole
    assert len(part.parts) == 6 and len(part.q) <= len(whole.q) // 4 + 6
    at = np.searchsorted(whole.time, part.time)
    for name in ("q", "qd", "qdd", "current", "torque", "slid_time"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[at])
    np.testing.assert_array_equal(part.heat, whole.heat[:, at])
    np.testing.assert_array_equal(part.kinematics.qd, whole.kinematics.qd[at])
    assert all(np.all(np.diff(at[p]) == 1) for p in part.parts)
    assert np.all(np.abs(part.qd[part.start[:-1]]) > 0.0)
    for p, run in zip(part.parts, whole.parts, strict=True):  # much of the way lies ahead of its begin
        tenth = (p.stop - p.start) // 10
        ways = np.convolve(np.abs(whole.qd[run]), np.ones(tenth), "valid")
        assert np.abs(part.qd[p.start : p.start + tenth]).sum() > 0.49 * ways[: len(ways) - 9 * tenth].max()
    offsets = at[part.start[:-1]] - whole.start[:-1]
    assert len(set(offsets.tolist())) == 6


def test_of_many_short_trajectories_some_are_taken() -> None:
    """Where the shortest stretches are too many samples: evenly over any order of the runs, with their own numbers."""
    whole = known.motion(3, runs=60, seconds=4.0)
    whole = dataclasses.replace(whole, begin=np.arange(60.0), dt=whole.dt * (1.0 + 1e-6 * np.arange(60)))
    all_runs = whole.stretches(len(whole.q) // 10)
    assert len(all_runs.parts) == 60 and len(all_runs.q) > len(whole.q) // 2
    some = whole.stretches(len(whole.q) // 10, 5)
    assert some.begin is not None and some.middle is not None
    taken = np.round(some.begin).astype(int)
    assert len(taken) == 8 and len(some.q) <= len(whole.q) // 10 + 60
    np.testing.assert_array_equal(some.dt, whole.dt[taken])
    np.testing.assert_array_equal(some.middle, whole.middles[taken])
    np.testing.assert_array_equal(some.q[: some.start[1]], all_runs.q[all_runs.parts[taken[0]]])
    for period in (2, 3, 4, 5):
        assert len(set(taken % period)) == period
    assert len(whole.stretches(len(whole.q) // 10, 20).parts) == 20
