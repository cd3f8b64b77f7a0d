"""Few long runs as blocks: cut where little is unknown, without a sample in two of them."""

from dataclasses import replace

import numpy as np
import pytest

from mrwarp.diagnose.data_checks import gaps, no_verdict_reasons
from mrwarp.identify.fit import fit
from mrwarp.recording.blocks import GUARD, in_blocks
from mrwarp.recording.data import Recording, Trajectory
from mrwarp.recording.description import notes
from tests.recording.recordings import columns

TURN = 2.0 * np.pi


def _long(seconds: float = 60.0, rate: float = 200.0, changes: int = 20, id: str = "long") -> Trajectory:
    """One run at changing current, of a joint with a hysteresis that slides after 0.1 rad."""
    rng = np.random.default_rng(4)
    t = np.arange(round(seconds * rate)) / rate
    q = 0.5 * np.sin(TURN * 0.6 * t) + 0.2 * np.sin(TURN * 0.97 * t)
    current = np.repeat(rng.uniform(0.0, 1.5, changes + 1), -(-len(t) // (changes + 1)))[: len(t)]
    z, steps = np.zeros(len(t)), np.diff(q)
    for k, step in enumerate(steps):
        z[k + 1] = z[k] + step - abs(step) * z[k] / 0.1
    torque = (1.0 + 8.0 * current) * z + 0.1 * np.gradient(q, t) + 0.01 * rng.normal(size=len(t))
    return Trajectory(id=id, t=t, q=q, qd=np.gradient(q, t), current=current, torque=torque)


@pytest.mark.parametrize(("seconds", "rate", "changes"), [(60.0, 200.0, 20), (24.0, 1000.0, 8), (1500.0, 100.0, 299)])
def test_one_long_run_is_cut_where_its_current_is_steady(seconds: float, rate: float, changes: int) -> None:
    """Blocks lie in order with a guard between them, begin at a steady current, and are enough for a verdict."""
    run = _long(seconds, rate, changes)
    recording = Recording(trajectories=(run,))
    blocks = in_blocks(recording)
    parts = blocks.trajectories
    assert 9 <= len(parts) <= 40 and in_blocks(blocks) is blocks
    for a, b in zip(parts[:-1], parts[1:], strict=True):
        assert b.t[0] - a.t[-1] >= GUARD
    at = np.searchsorted(run.t, [part.t[0] for part in parts[1:]])
    since = np.array([np.ptp(run.current[k - round(0.15 * rate) : k + 1]) for k in at])
    assert (since == 0.0).all()  # a coil has settled
    assert no_verdict_reasons(blocks) == []
    assert any("cannot be seen; record several runs" in gap for gap in gaps(blocks))
    assert sum(len(part.t) for part in parts) > 0.95 * len(run.t)
    untested = [any("nothing is left to test" in note for note in notes(recording, n)) for n in (1, len(parts))]
    assert untested == [True, False]


def test_a_block_s_unknown_stress_does_not_count() -> None:
    """A fit to blocks has the noise's error, though each begins with a stress that nobody knows."""
    blocks = in_blocks(Recording(trajectories=(_long(),)))
    assert all(part.lost is not None and 0.02 < part.lost.mean() < 0.3 for part in blocks.trajectories[1:])
    found = fit(blocks)
    assert found.rmse < 0.015
    assert found.estimates["K1"].value == pytest.approx(8.0, rel=0.05)


def test_many_runs_and_short_ones_stay() -> None:
    """Twelve runs are enough; a run that is too short for two blocks, or of one slow stroke, is not cut."""
    run = _long(20.0)
    many = Recording(trajectories=tuple(replace(run, id=f"{k}") for k in range(12)))
    assert in_blocks(many) is many
    short = Recording(trajectories=(Trajectory(id="a", **columns(300)),))
    assert in_blocks(short) is short
    slow = replace(run, q=np.sin(TURN * run.t / 18.0), qd=TURN / 18.0 * np.cos(TURN * run.t / 18.0))
    alone = Recording(trajectories=(slow,))
    assert in_blocks(alone) is alone
