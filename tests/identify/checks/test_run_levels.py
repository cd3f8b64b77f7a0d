"""Runs without a common clock whose torque's level differs in the same motion."""

from dataclasses import replace

import numpy as np
import pytest

from mrwarp.diagnose.data_checks import gaps
from mrwarp.identify.checks.run_levels import levels_without_clock
from mrwarp.recording.load import Recording
from tests.identify import synthetic

GOOD = synthetic.bench_like(4, runs=6, seconds=2.0)


def with_factors(factors: np.ndarray, clock: bool = False) -> Recording:
    """Every run with its torque times a factor; with a ``clock`` one after the other."""
    runs = zip(GOOD.trajectories, factors, strict=True)
    changed = [replace(run, torque=x * run.torque, t=run.t + 5.0 * k * clock) for k, (run, x) in enumerate(runs)]
    return Recording(trajectories=tuple(changed))


def test_a_level_that_differs_between_runs_is_named_where_nobody_knows_their_order() -> None:
    """A tenth less from run to run: said by every command; by one clock a diagnosis may find why."""
    falls = with_factors(1.0 - 0.1 * np.arange(6))
    said = levels_without_clock(falls)
    assert "differs between runs" in said and "'run5'" in said and "record t by a clock" in said
    assert said in gaps(falls)
    assert not levels_without_clock(with_factors(1.0 - 0.1 * np.arange(6), clock=True))


@pytest.mark.parametrize("recording", [GOOD, with_factors(1.0 - 0.02 * np.arange(6))], ids=["none", "a tenth"])
def test_runs_of_about_one_level_have_no_note(recording: Recording) -> None:
    """Differences of less than a quarter are left to the noise of the runs."""
    assert not levels_without_clock(recording)


def test_friction_that_falls_with_the_speed_is_no_level() -> None:
    """Each run at its own speed, with the torque of that speed: a law, no matter in which order."""
    runs = []
    for k, run in enumerate(GOOD.trajectories):
        speed = 0.2 + 0.2 * k
        q = 0.4 * np.sin(speed * run.t / 0.4)
        qd = speed * np.cos(speed * run.t / 0.4)
        noise = 0.01 * np.random.default_rng(k).normal(size=len(q))
        torque = (0.3 - 0.1 * speed) * np.tanh(qd / 0.02) + noise
        runs.append(replace(run, q=q, qd=qd, current=0.0 * q, torque=torque))
    assert not levels_without_clock(Recording(trajectories=tuple(runs)))


def test_the_only_run_without_current_is_no_level() -> None:
    """The description of all runs knows its small torque least, and no other at its current says what it should be."""
    runs, t = [], np.arange(5000) / 250.0
    q = 0.35 * np.sin(np.pi * t) + 0.15 * np.sin(3.4 * np.pi * t + 0.4)
    qd = np.gradient(q, t)
    z = synthetic.hysteresis(np.repeat(qd[None], 1, axis=0), t[1], 22.0, -9.0)[0]
    for k, current in enumerate((0.0, 0.3, 0.6, 1.0, None)):
        held = (np.sin(0.4 * np.pi * t) > 0.0) * 1.0 if current is None else current + 0.0 * t
        torque = 0.05 + 0.02 * held + 0.03 * qd + (0.6 + 40.0 * held) / (1.0 + 0.25 * np.abs(qd)) * z
        torque += 0.02 * np.random.default_rng(k).normal(size=len(t))
        runs.append(replace(GOOD.trajectories[0], id=f"run{k}", t=t, q=q, qd=qd, current=held, torque=torque))
    assert not levels_without_clock(Recording(trajectories=tuple(runs)))
