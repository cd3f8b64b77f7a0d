"""A torque sensor at the end of its range costs its samples, not the recording."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mrwarp import cli
from mrwarp.diagnose.data_checks import no_verdict_reasons
from mrwarp.identify.fit import fit
from mrwarp.recording.load import Recording, load_recording, save_recording
from mrwarp.recording.saturation import mark_saturated, stuck
from tests.identify import synthetic


def _clipped(recording: Recording, limit: float) -> Recording:
    runs = (replace(run, torque=np.clip(run.torque, -limit, limit)) for run in recording.trajectories)
    return replace(recording, trajectories=tuple(runs))


def test_a_fit_recovers_the_device_from_what_was_not_clipped() -> None:
    """Peaks cut off at two thirds of the torque: counted they bend the fit, set aside they do not."""
    whole = synthetic.bench_like(0, runs=6, seconds=4.0)
    torque = np.concatenate([run.torque for run in whole.trajectories])
    limit = float(np.percentile(np.abs(torque), 93))
    clipped = _clipped(whole, limit)
    marked = mark_saturated(clipped)
    lost = np.concatenate([~run.known for run in marked.trajectories])
    assert 0.07 < lost.mean() < 0.2 and lost[np.abs(torque) > limit].all()
    at = np.abs(clipped.trajectories[0].torque) >= limit
    first = int(np.argmax(at))
    assert (~marked.trajectories[0].known)[first - 1 : first + 5].all() and marked.trajectories[0].known[first - 2]
    truth, bent, right = (fit(recording) for recording in (whole, clipped, marked))
    assert right.nrmse < 0.7 * bent.nrmse

    def slips(result) -> float:
        return result.values["K1"] / (result.values["beta"] + result.values["gamma"])

    assert slips(right) == pytest.approx(slips(truth), rel=0.02)
    assert abs(slips(bent) / slips(truth) - 1.0) > 0.02


def test_check_says_which_samples_do_not_count(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One note per trajectory; a diagnosis is no longer refused, unless most of the torque is unknown."""
    whole = synthetic.bench_like(0, runs=4, seconds=4.0)
    limit = float(np.percentile(np.abs(np.concatenate([run.torque for run in whole.trajectories])), 95))
    save_recording(_clipped(whole, limit), tmp_path / "data")
    recording = load_recording(tmp_path / "data")
    assert {repair.kind for repair in recording.repairs} <= {"saturated", "left_out"} and recording.repairs
    assert not [text for text in no_verdict_reasons(recording) if "saturated" in text]
    assert cli.main(["check", str(tmp_path / "data")]) == 0
    assert "the torque stands at the end of its range in" in capsys.readouterr().out
    hard = mark_saturated(_clipped(whole, 0.2 * limit))
    assert all(run.lost is None for run in hard.trajectories) and hard.repairs == ()
    assert [text for text in no_verdict_reasons(hard) if "saturated" in text]


def test_a_peak_is_no_end_of_a_range() -> None:
    """A recording that was never clipped is the same object."""
    whole = synthetic.bench_like(0, runs=2, seconds=2.0)
    assert mark_saturated(whole) is whole


def _stuck(recording: Recording, samples: int) -> Recording:
    """The torque of the second run stands still for a while."""
    first, run, *others = recording.trajectories
    torque = run.torque.copy()
    torque[300 : 300 + samples] = torque[300]
    return replace(recording, trajectories=(first, replace(run, torque=torque), *others))


def test_a_reading_that_is_stuck_is_set_aside(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Half a second of equal torques of a joint that moves: they do not count, all others do; where much is, no fit."""
    whole = synthetic.bench_like(0, runs=4, seconds=4.0)
    save_recording(_stuck(whole, 100), tmp_path / "data")
    recording = load_recording(tmp_path / "data")
    (repair,) = recording.repairs
    assert repair.kind == "saturated" and repair.count == 99 and "still while the joint moves" in repair.text
    lost = ~recording.trajectories[1].known
    assert lost[301:400].all() and not lost[:299].any() and not lost[405:].any()
    assert cli.main(["check", str(tmp_path / "data")]) == 0
    assert "the torque stands still while the joint moves in 99 of 800" in capsys.readouterr().out
    hard = Recording(
        trajectories=tuple(
            _stuck(replace(whole, trajectories=(run, run)), 300).trajectories[1] for run in whole.trajectories
        )
    )
    assert mark_saturated(hard) is hard
    assert [text for text in no_verdict_reasons(hard) if "its reading was stuck" in text]


def test_what_a_torque_repeats_by_itself_is_no_stuck_reading() -> None:
    """A rest, a coarse sensor, a plateau in every swing of a torque without noise, and a few equal neighbours."""
    t, rng = np.arange(2000) * 0.005, np.random.default_rng(0)
    q = 0.5 * np.sin(2.0 * np.pi * 0.5 * t)
    noisy = np.sign(np.cos(np.pi * t)) + 0.01 * rng.normal(size=2000)
    assert stuck(np.where((t > 3.0) & (t < 4.0), 0.7, noisy), q, 0.005).sum() == 198
    rest = np.where((t > 3.0) & (t < 4.0), q[600], q)
    assert not stuck(np.where((t > 3.0) & (t < 4.0), 0.7, noisy), rest, 0.005).any()
    swing = 2.0 * np.cos(np.pi * t) + 0.001 * rng.normal(size=2000)
    ends = np.where(t < 3.0, np.minimum(swing, 1.9), swing)  # at an end of its range, from where it goes on
    assert not stuck(ends, q, 0.005).any()
    coarse, plateaus = np.round(noisy, 1), np.tanh(40.0 * np.cos(np.pi * t))
    for torque in (coarse, plateaus, np.round(noisy, 3), np.zeros(2000)):
        assert not stuck(torque, q, 0.005).any()


def test_a_fit_says_of_how_much_torque_it_knows_nothing() -> None:
    """Beyond a quarter that is clipped, a diagnosis gives no verdict and a fit warns, by the same words."""
    hard = _clipped(synthetic.bench_like(0, runs=4, seconds=2.0), 0.1)
    (reason,) = [text for text in no_verdict_reasons(hard) if "saturated" in text]
    assert reason in fit(hard).warnings
