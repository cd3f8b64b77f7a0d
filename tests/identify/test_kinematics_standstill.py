"""Rests of a joint: found in the noise of its channels, and taken as rests where the torque agrees."""

import dataclasses

import numpy as np
import pytest

from mrwarp.diagnose.baseline import driven, hold_rests
from mrwarp.diagnose.problem import fit_model
from mrwarp.identify.dataset import Motion
from mrwarp.identify.kinematics import angle_noise, known_velocity, reconstruct, resting
from mrwarp.identify.replay import EffectReplay
from mrwarp.recording.load import Recording, Trajectory
from mrwarp.sysid.settings import Settings
from tests.diagnose import known

STEP, Q_NOISE, V_NOISE = 3e-4, 3e-4 / np.sqrt(12.0), 0.01
RESTS = [(2.0, 3.5), (6.0, 8.0)]
STEEP = {"beta": 60.0, "gamma": -50.0}
"""A loop that is eleven times as steep on one way as on the other."""


def stops(seed: int, dt: float = 0.005, dither: float = 0.0) -> tuple[np.ndarray, Trajectory]:
    """True velocity, and what is read, of a joint that rests, or trembles at 20 Hz in its rests, in rad/s."""
    t = np.arange(round(8.0 / dt)) * dt
    moving = (t < 2.0) | ((t >= 3.5) & (t < 6.0))
    trembling = dither * np.sin(2.0 * np.pi * 20.0 * t)
    qd = np.where(moving, 2.0 * np.sin(2.0 * np.pi * (t - 3.5 * (t >= 3.5))), trembling)
    q = np.concatenate([[0.0], np.cumsum(0.5 * (qd[1:] + qd[:-1])) * dt])
    noise = np.random.default_rng(seed).normal(size=(2, len(t)))
    read = np.round((q + 2e-5 * noise[0]) / STEP) * STEP
    return qd, Trajectory(
        id=f"run {seed}",
        t=t + 10.0 * seed,
        q=read,
        qd=qd + V_NOISE * noise[1],
        current=np.ones(len(t)),
        torque=np.zeros(len(t)),
    )


@pytest.mark.parametrize("dt", [0.01, 0.005, 0.0005])
def test_rests_are_found(dt: float) -> None:
    """Both rests and nothing else, to 30 ms, at any rate."""
    _, run = stops(1, dt)
    found = [(part.start * dt, part.stop * dt) for part in resting(run.q, run.qd, dt, Q_NOISE, V_NOISE)]
    np.testing.assert_allclose(found, RESTS, atol=0.03)


def test_slow_motion_does_not_rest() -> None:
    """Not even at its turning points: 0.05 rad in 5 s."""
    t = np.arange(2000) * 0.005
    q, qd = 0.05 * np.sin(0.4 * np.pi * t), 0.02 * np.pi * np.cos(0.4 * np.pi * t)
    noise = np.random.default_rng(3).normal(size=2000)
    assert resting(np.round(q / STEP) * STEP, qd + V_NOISE * noise, 0.005, Q_NOISE, V_NOISE) == []


def test_the_edges_of_a_rest_are_doubtful() -> None:
    """30 ms at each end; none where the trajectory ends."""
    _, run = stops(1)
    velocity, uncertain = known_velocity(run, Q_NOISE, V_NOISE)
    edges = np.flatnonzero(np.diff(uncertain, prepend=False, append=False)).reshape(-1, 2) * 0.005
    np.testing.assert_allclose(edges, [(2.0, 2.03), (3.47, 3.5), (6.0, 6.03)], atol=0.03)
    assert not np.any(uncertain & np.isfinite(velocity))


def test_a_resting_joint_goes_no_way() -> None:
    """Noise of the channels makes no motion in a rest, and the motion around it is as good as before."""
    qd, run = stops(2)
    found = reconstruct(Recording(trajectories=(run,)))
    rest = np.any([(run.t - 20.0 > a + 0.05) & (run.t - 20.0 < b - 0.05) for a, b in RESTS], axis=0)
    assert found.rests and np.abs(found.qd[rest]).max() < 1e-6
    assert np.sqrt(np.mean((found.qd - qd) ** 2)) < 0.6 * V_NOISE


def test_a_joint_that_stops_at_once_does_not_turn_round() -> None:
    """The smoother would swing through at the edges of the rest, and dry friction keep the sign of that."""
    _, run = stops(4)
    qd = np.where(run.t - 40.0 < 2.0, 1.5, np.where(run.t - 40.0 < 3.5, 0.0, -1.5))
    q = np.concatenate([[0.0], np.cumsum(0.5 * (qd[1:] + qd[:-1])) * 0.005])
    noise = V_NOISE * np.random.default_rng(6).normal(size=len(qd))
    run = dataclasses.replace(run, q=np.round(q / STEP) * STEP, qd=qd + noise)
    found, t = reconstruct(Recording(trajectories=(run,))), run.t - 40.0
    assert found.rests and found.qd[(t > 1.9) & (t < 2.3)].min() > -1e-6
    assert found.qd[(t > 3.3) & (t < 3.6)].max() < 1e-6


def test_a_creeping_joint_creeps_on() -> None:
    """A part that looks like a rest for a moment but moves on keeps its mean velocity."""
    _, run = stops(3)
    noise = np.random.default_rng(5).normal(size=(2, len(run.t)))
    creep = dataclasses.replace(run, q=2e-4 * run.t + 1e-4 * noise[0], qd=2e-4 + V_NOISE * noise[1])
    assert reconstruct(Recording(trajectories=(creep,))).qd.mean() == pytest.approx(2e-4, rel=0.1)


@pytest.mark.parametrize(("dither", "held"), [(0.0, True), (0.03, False)])
def test_rests_are_held_where_the_torque_agrees(dither: float, held: bool) -> None:
    """Stress that stays speaks for a rest; stress that a motion below the encoder's step wears away against it."""
    truth, runs = zip(*(stops(seed, dither=dither) for seed in range(4)), strict=True)
    raw = Motion.of(Recording(trajectories=runs))
    exact = dataclasses.replace(raw, qd=np.concatenate(truth) / raw.scales.q)
    layout = known.posed(raw).parameters(())
    x = known.vector(layout, **STEEP)
    torque = EffectReplay(exact).torque(layout.row(x))[0].astype(float)
    torque += 0.01 * np.random.default_rng(8).normal(size=len(torque))
    problem = known.posed(dataclasses.replace(raw, torque=torque), sigma=0.01)
    parts = [raw.scales.torque * torque[part] for part in raw.parts]
    measured = tuple(dataclasses.replace(run, torque=part) for run, part in zip(runs, parts, strict=True))
    found, _ = hold_rests(problem, Recording(trajectories=measured), fit_model(problem, layout, x), 10.0)
    assert (found is not problem) is held


@pytest.mark.parametrize(("rises", "sticks"), [(True, True), (False, False)])
def test_torque_that_grows_in_rests_is_of_a_drive(rises: bool, sticks: bool) -> None:
    """A joint held still by a bench can only relax; torque that grows is balanced by static friction."""
    runs = []
    for seed in range(3):
        qd, run = stops(seed)
        torque = np.sign(qd) + 0.02 * np.random.default_rng(seed).normal(size=len(qd))
        for begin, end in RESTS:
            rest = (run.t - run.t[0] >= begin) & (run.t - run.t[0] < end)
            way = np.linspace(0.0, 1.0, rest.sum())
            torque[rest] += 0.2 + 0.6 * way if rises else 0.2 + 0.6 * np.exp(-3.0 * way)
        runs.append(dataclasses.replace(run, torque=torque))
    motion = Motion.of(Recording(trajectories=tuple(runs)), rests=True)
    assert len(motion.rests) == 6
    assert driven(motion, Settings()) == sticks


@pytest.mark.parametrize("smoothing", [1.0, 4.0])
def test_an_acceleration_that_jumps_is_known_but_near_reversals(smoothing: float) -> None:
    """A mass pulled to and fro against dry friction: away from its reversals the smoother has its acceleration."""
    t, pull = np.arange(1600) * 0.005, 30.0 * np.sin(2.0 * np.pi * 0.6 * np.arange(1600) * 0.005)
    q, qd, qdd, fine = np.zeros(1600), np.zeros(1600), np.zeros(1600), 2.5e-4
    for k in range(1, 1600):
        x, v = q[k - 1], qd[k - 1]
        for _ in range(20):
            v += fine * (pull[k] - 12.0 * np.sign(v))
            x += fine * v
        q[k], qd[k], qdd[k] = x, v, pull[k] - 12.0 * np.sign(v)
    run = Trajectory(
        id="run", t=t, q=np.round(q / STEP) * STEP, qd=qd, current=np.ones(1600), torque=np.zeros(1600), qd_derived=True
    )
    found = reconstruct(Recording(trajectories=(run,)), smoothing=smoothing)
    assert found.reversing is not None
    error = (found.qdd - qdd) ** 2
    assert 0.0 < found.reversing.mean() < 0.2
    assert error[found.reversing].mean() > 4.0 * error[~found.reversing].mean()


def test_noise_of_an_encoder_survives_resampling() -> None:
    """A log that was interpolated to twice the rate has values between the steps, but stands at readings."""
    t = np.arange(800) * 0.01
    read = np.round((0.3 * np.sin(0.8 * t) ** 3) / STEP) * STEP
    twice = np.arange(1599) * 0.005
    run = Trajectory(
        id="run",
        t=twice,
        q=np.interp(twice, t, read),
        qd=np.zeros(1599),
        current=np.zeros(1599),
        torque=np.zeros(1599),
    )
    assert angle_noise([run]) == pytest.approx(Q_NOISE, rel=0.3)
