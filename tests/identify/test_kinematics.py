"""Motion behind a log: velocity and acceleration without phase, and the lag of a velocity channel."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from mrwarp.identify.kinematics import reconstruct, smooth
from mrwarp.recording.differentiate import differentiate
from mrwarp.recording.load import Recording, Trajectory

STEP, V_NOISE = 3e-4, 0.01


def test_a_quick_trajectory_is_smoothed_less_than_its_neighbours() -> None:
    """A chirp up to 15 Hz among slow swings keeps its amplitude, and the swings their quiet velocity."""
    recording, _, _ = logged(3, runs=5, dt=0.002)
    t = np.arange(4000) * 0.002
    phase = 2 * np.pi * (1.0 + 0.5 * 1.75 * t) * t  # 1 to 15 Hz
    q, qd = 0.05 * np.sin(phase), 0.05 * np.cos(phase) * 2 * np.pi * (1.0 + 1.75 * t)
    chirp = replace(recording.trajectories[0], t=100.0 + t, q=np.round(q / STEP) * STEP, qd=qd, id="chirp")
    chirp = replace(chirp, current=np.zeros(len(t)), torque=np.zeros(len(t)))
    runs = tuple(replace(run, qd=differentiate(run.q, run.dt), qd_derived=True) for run in recording.trajectories)
    swings = reconstruct(replace(recording, trajectories=runs))
    both = reconstruct(replace(recording, trajectories=(*runs, replace(chirp, qd_derived=True))))
    count = len(swings.qd)
    np.testing.assert_allclose(both.qd[:count], swings.qd, atol=1e-2 * np.abs(swings.qd).max())
    late = slice(count + 3000, count + 3900)
    assert np.dot(both.qd[late], qd[3000:3900]) / np.dot(qd[3000:3900], qd[3000:3900]) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("velocity", [True, False])
def test_a_joint_that_turns_round_at_once_keeps_its_corners(velocity: bool) -> None:
    """Triangles rounded over 5 ms, at 200 Hz: the way between two samples is known next to a reversal, too.

    There play and dry friction show. The least smoother leaves 0.6 mrad of each step there, 1.2 without a velocity:
    from a play of 1 mrad on all that is seen of it. The limit is what the encoder's step leaves in a difference of
    two samples; of an angle alone, whose smoother leaves half of the band out, it is a third of those 1.2 mrad.
    """
    fine, dt, recording = 50, 0.005, logged(3)[0]
    at = np.arange(800 * fine) * dt / fine
    runs, errors = [], []
    for k, run in enumerate(recording.trajectories):
        rng = np.random.default_rng([7, k])
        turn = 2.0 * np.pi * rng.uniform(0.8, 2.0) * at + rng.uniform(0.0, 6.0)
        angle = gaussian_filter1d(0.2 * np.arcsin(np.sin(turn)), 0.005 / dt * fine, mode="nearest")
        q, qd = np.round(angle[::fine] / STEP) * STEP, np.gradient(angle, dt / fine)[::fine]
        qd = qd + V_NOISE * rng.normal(size=800) if velocity else differentiate(q, dt)
        runs.append(replace(run, q=q, qd=qd, qd_derived=not velocity))
        errors.append(angle[::fine])
    found = reconstruct(Recording(trajectories=tuple(runs)))
    for k, q in enumerate(errors):
        v, a = (x[800 * k : 800 * (k + 1)] for x in (found.qd, found.qdd))
        way = dt * (0.5 * (v[1:] + v[:-1]) + dt / 12.0 * (a[:-1] - a[1:]))
        turns = np.flatnonzero(np.diff(np.sign(np.diff(q))))
        near = np.abs(np.arange(799)[:, None] - turns).min(axis=1) < 5
        assert rms((way - np.diff(q))[near]) < (STEP / np.sqrt(12.0) * np.sqrt(2.0) if velocity else 4e-4)


def swing(seed: int, t: np.ndarray, lag: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sum of three sines of 0.5 to 2 Hz with its exact derivatives, all behind a settled first-order filter."""
    rng = np.random.default_rng(seed)
    q, qd, qdd = (np.zeros(len(t)) for _ in range(3))
    for _ in range(3):
        w, amplitude, phase = 2 * np.pi * rng.uniform(0.5, 2.0), rng.uniform(0.1, 0.35), rng.uniform(0, 2 * np.pi)
        turn = amplitude / (1.0 + 1j * w * lag) * np.exp(1j * (w * t + phase))
        q, qd, qdd = q + np.imag(turn), qd + w * np.real(turn), qdd - w * w * np.imag(turn)
    return q, qd, qdd


def logged(
    seed: int, *, lag: float = 0.0, runs: int = 6, seconds: float = 4.0, dt: float = 0.005
) -> tuple[Recording, np.ndarray, np.ndarray]:
    """Runs with encoder steps, a noisy and perhaps late velocity channel; with true velocity and acceleration."""
    rng = np.random.default_rng([seed, 1])
    t = np.arange(round(seconds / dt)) * dt
    found, speeds, slopes = [], [], []
    for k in range(runs):
        q, qd, qdd = swing(100 * seed + k, t)
        _, late, _ = swing(100 * seed + k, t, lag)
        found.append(
            Trajectory(
                id=f"run{k}",
                t=t + 2.0 * k * seconds,
                q=np.round(q / STEP) * STEP,
                qd=late + V_NOISE * rng.normal(size=len(t)),
                current=np.zeros(len(t)),
                torque=np.zeros(len(t)),
            )
        )
        speeds.append(qd)
        slopes.append(qdd)
    return Recording(trajectories=tuple(found)), np.concatenate(speeds), np.concatenate(slopes)


def rms(x: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(x**2)))


def test_smooth_follows_a_clean_motion() -> None:
    """From an exact angle and from an exact velocity come the derivatives, to the smoother's bandwidth of 25 Hz."""
    t = np.arange(800) * 0.005
    q, qd, qdd = swing(3, t)
    inner = slice(30, -30)
    for sigma_q, sigma_v in ((1e-5, float("inf")), (float("inf"), 1e-3), (1e-5, 1e-3)):
        v, a = smooth(q, qd, 0.005, sigma_q, sigma_v)
        assert rms((v - qd)[inner]) < 2e-3 * rms(qd)
        assert rms((a - qdd)[inner]) < 2e-2 * rms(qdd)


def test_smooth_has_no_phase() -> None:
    """The reversed motion gives the reversed result: neither channel is shifted."""
    t = np.arange(400) * 0.005
    q, qd, _ = swing(4, t)
    noise = np.random.default_rng(5).normal(size=(2, 400))
    q, qd = q + 1e-4 * noise[0], qd + 0.01 * noise[1]
    v, a = smooth(q, qd, 0.005, 1e-4, 0.01)
    back, slope = smooth(q[::-1], -qd[::-1], 0.005, 1e-4, 0.01)
    inner = slice(40, -40)
    np.testing.assert_allclose(back[::-1][inner], -v[inner], atol=1e-6)
    np.testing.assert_allclose(slope[::-1][inner], a[inner], atol=1e-3)


def test_both_channels_together_beat_the_velocity_channel() -> None:
    """A quantised angle and a noisy velocity give a velocity better than the channel smoothed alone, at any rate.

    Of white noise the smoother's 25 Hz pass: at 100 Hz sqrt(25/50) of the channel's, at higher rates less.
    """
    for dt in (0.01, 0.005, 0.001):
        recording, qd, _ = logged(6, runs=2, dt=dt)
        found = reconstruct(recording)
        assert found.velocity_lag == 0.0
        assert rms(found.qd - qd) < 0.6 * V_NOISE


def test_velocity_is_derived_where_there_is_none() -> None:
    """Without a velocity channel the angle gives it; no lag can be found."""
    recording, qd, qdd = logged(7)
    runs = tuple(replace(run, qd=differentiate(run.q, run.dt), qd_derived=True) for run in recording.trajectories)
    found = reconstruct(replace(recording, trajectories=runs))
    assert found.velocity_lag == 0.0 and np.isinf(found.velocity_lag_error)
    assert rms(found.qd - qd) < 0.01 * rms(qd)
    assert rms(found.qdd - qdd) < 0.1 * rms(qdd)


@pytest.mark.parametrize("lag", [0.001, 0.004, 0.012])
def test_velocity_lag_is_found(lag: float) -> None:
    """The time constant of a filtered velocity channel within 3 % or 0.1 ms, as long as it is short for the motion."""
    for seed in (1, 2):
        recording, qd, _ = logged(seed, lag=lag)
        found = reconstruct(recording)
        assert 0.99 * lag - 1e-4 < found.velocity_lag < 1.01 * lag + 1e-4
        assert found.velocity_lag_error < 0.05 * lag
        # as logged it is late; with its derivative it is the true one
        true = found.qd + found.velocity_lag * found.qdd
        assert rms(true - qd) < 0.6 * V_NOISE
        assert rms(found.qd - qd) > 2.0 * rms(true - qd)


def test_no_velocity_lag_is_made_up() -> None:
    """In ten recordings whose velocity is not late none is found."""
    assert [reconstruct(logged(seed, runs=4, seconds=2.0)[0]).velocity_lag for seed in range(10, 20)] == [0.0] * 10


def test_noise_at_rest_makes_no_way() -> None:
    """While a joint rests, the noise of its velocity channel adds up to a fifth of its way at most."""
    recording, _, _ = logged(8, runs=1)
    run = recording.trajectories[0]
    still = replace(run, q=np.full(len(run.t), 0.3), qd=V_NOISE * np.random.default_rng(9).normal(size=len(run.t)))
    found = reconstruct(replace(recording, trajectories=(run, replace(still, id="still", t=run.t + 100.0))))
    rest = found.qd[len(run.t) :]
    assert np.abs(rest).sum() < 0.2 * np.abs(still.qd).sum()
