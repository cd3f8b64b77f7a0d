"""Thinning of long recordings: fewer samples of the same motion, and a word about it."""

import numpy as np
import pytest

from mrwarp.diagnose import decimate as thin
from mrwarp.diagnose.decimate import thinned
from mrwarp.recording.load import Recording, Trajectory


def _recording(rates: tuple[float, ...], seconds: float = 2.0) -> Recording:
    """A 2 Hz swing at each rate, with a step of the current in the middle."""
    runs = []
    for k, rate in enumerate(rates):
        t = np.arange(round(seconds * rate)) / rate
        w = 4.0 * np.pi
        runs.append(
            Trajectory(
                id=f"run {k}", t=t, q=np.sin(w * t), qd=w * np.cos(w * t), current=np.where(t < 1.0, 0.5, 1.5),
                torque=np.cos(w * t), temperature=20.0 + t,
            )
        )  # fmt: skip
    return Recording(trajectories=tuple(runs))


def test_short_recordings_stay_as_they_are() -> None:
    """Up to the limit, whatever the rate."""
    recording = _recording((3000.0, 3000.0))
    assert thinned(recording) == (recording, None)


@pytest.mark.parametrize(("limit", "rates"), [(9000, (1000.0, 1000.0, 200.0)), (4000, (600.0, 600.0, 200.0))])
def test_fast_trajectories_are_thinned_until_they_are_few(
    monkeypatch: pytest.MonkeyPatch, limit: int, rates: tuple[float, ...]
) -> None:
    """By odd factors, all alike; slow trajectories stay."""
    monkeypatch.setattr(thin, "LIMIT", limit)
    recording = _recording((3000.0, 3000.0, 200.0))
    out, note = thinned(recording)
    assert [round(1.0 / run.dt) for run in out.trajectories] == list(rates)
    assert out.samples <= limit and note is not None and str(out.samples) in note
    assert out.trajectories[2] is recording.trajectories[2]


def test_thinned_motion_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the samples that are left: motion without a shift, the current one step, torque and temperature as logged."""
    monkeypatch.setattr(thin, "LIMIT", 10)
    run = thinned(_recording((1000.0,)))[0].trajectories[0]
    w = 4.0 * np.pi
    assert 1.0 / run.dt == pytest.approx(1000.0 / 3.0)
    np.testing.assert_allclose(run.q, np.sin(w * run.t), atol=1e-4)
    np.testing.assert_allclose(run.qd, w * np.cos(w * run.t), atol=1e-3)
    np.testing.assert_allclose(run.torque, np.cos(w * run.t))
    assert run.temperature is not None
    np.testing.assert_allclose(run.temperature, 20.0 + run.t)
    assert np.array_equal(run.current, np.where(run.t < 1.0, 0.5, 1.5))


def test_rates_under_the_least_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """However long they are."""
    monkeypatch.setattr(thin, "LIMIT", 10)
    recording = _recording((500.0, 250.0))
    assert thinned(recording) == (recording, None)
