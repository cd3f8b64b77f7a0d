"""The experiment that a diagnosis asks for, made on the benchmark's own device and appended to the recording."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.confusion.case import Case, Noise, make_case
from benchmarks.confusion.experiment import CURRENTS, Proposal, joined, with_experiment
from benchmarks.confusion.families import Plan
from benchmarks.confusion.suite import run_case
from benchmarks.confusion.tables import report
from mrwarp.diagnose.next_experiment import STANDARD
from mrwarp.recording.load import Recording

SILENT = Noise(white=0.0, coloured=0.0, offset=0.0, gain=0.0, velocity=0.0, encoder=0.0)
MOTION = {"amplitude": 0.4, "frequency_low": 0.5, "frequency_high": 1.5, "current_max": 1.2, "runs": 4.0}
REST = Proposal("rest and repeat", 912.0, {"rest_seconds": 900.0, "runs": 3.0})


def silent(kind: str, **other: Any) -> Case:
    """A small case without noise."""
    return dataclasses.replace(make_case(kind, level=0.4, seed=2, size="small", **other), noise=SILENT)


def test_every_proposed_motion_can_be_made() -> None:
    """The benchmark knows what to do with the current in each standard experiment."""
    assert {name: standard.current for name, standard in STANDARD.items()} == CURRENTS


@pytest.mark.parametrize("kind", sorted(CURRENTS))
def test_motion_and_current_are_as_proposed(kind: str) -> None:
    """Amplitude, speed, current and seconds are those of the proposal, in the units of the log; the rest is kept."""
    case = silent("coil_lag", voltage=True, linear=True)
    settings = {**MOTION, "amplitude": 0.4 * 0.04, "current_max": 1.2 * 6.0}
    both = with_experiment(case, Proposal(kind, 16.0, settings))
    before = case.recording.trajectories
    assert both.trajectories[: len(before)] == before and len(both.trajectories) == len(before) + 4
    new = both.trajectories[len(before) :]
    assert new[0].t[0] > before[-1].t[-1] and len({run.id for run in both.trajectories}) == len(both.trajectories)
    reach = max(np.ptp(run.q) for run in new)
    assert 1.8 * 0.016 < reach < 2.01 * 0.016
    assert max(np.abs(run.qd).max() for run in new) < 2.0 * np.pi * 1.5 * 0.016 * 1.3
    current = np.concatenate([run.current for run in new])
    assert current.min() >= 0.0 and current.max() <= 7.2 + 1e-6
    changes = [int((np.diff(run.current) != 0.0).sum()) for run in new]
    if CURRENTS[kind] == "none":
        assert not current.any()
    elif CURRENTS[kind] == "levels":
        assert changes == [0] * 4 and current.max() == pytest.approx(7.2)
    else:
        assert min(changes) >= 7


def test_wear_goes_on_and_warmth_recovers() -> None:
    """After a long rest the first runs are as at first where the fluid was warm, and weaker where it is worn."""
    for kind, recovers in (("temperature_drift", True), ("wear", False)):
        case = silent(kind)
        runs = with_experiment(case, REST).trajectories
        first, again = runs[:3], runs[12:]
        assert len(again) == 3 and again[0].t[0] - runs[11].t[-1] == pytest.approx(900.0)
        ratios = []
        for a, b in zip(first, again, strict=True):
            np.testing.assert_allclose(a.q, b.q, atol=1e-8)
            ratios.append(np.sum(a.torque * b.torque) / np.sum(a.torque**2))
        lost = 1.0 - np.mean(ratios)
        print(f"{kind}: {lost:.4f}")
        assert abs(lost) < 0.004 if recovers else lost > 0.015


def test_a_longer_session_does_not_change_its_beginning() -> None:
    """The wear of the first part is what it was."""
    case = silent("wear")
    both = joined(case.motion, case.motion)
    assert both.q.shape[0] == 24 and np.isinf(both.command.edge).any()
    alone = with_experiment(case, REST)
    for a, b in zip(alone.trajectories[:12], case.recording.trajectories, strict=True):
        np.testing.assert_array_equal(a.torque, b.torque)


def unsure_at_first(recording: Recording, *, seed: int) -> Any:
    """A diagnosis that needs more than twelve trajectories to distinguish a lag from a delay."""
    enough = len(recording.trajectories) > 12
    cause = SimpleNamespace(
        name="coil_lag", parameters={}, p_value=1e-4, alternatives=[] if enough else ["command_delay"]
    )
    proposal = SimpleNamespace(kind="current steps", seconds=16.0, settings=MOTION, what="step the current")
    return SimpleNamespace(
        verdict="named",
        causes=[cause],
        parameter_shift=[],
        unexplained=None,
        gain=None,
        seconds=0.0,
        law=None,
        suspects=[],
        recording_faults=(),
        account=None,
        next_experiment=None if enough else proposal,
    )


def test_resolved_cases_are_counted() -> None:
    """Ambiguous, then right: resolved; where the truth is the rival that was dropped: wrong; both are in the tables."""
    plan = Plan(family="single", size="small", kinds=("coil_lag", "command_delay"))
    cases = [run_case(plan, k, resolve=True, diagnose=unsure_at_first) for k in range(2)]
    assert [case["outcome"] for case in cases] == ["ambiguous", "ambiguous"]
    assert [case["resolved"]["result"] for case in cases] == ["resolved", "wrong"]
    assert cases[0]["resolved"]["kind"] == "current steps" and cases[0]["resolved"]["trajectories"] == 4
    text = report(plan, cases)
    print(text)
    assert "resolved by the proposed experiment" in text and "1/2" in text and "1 wrong" in text
    assert "resolved" not in run_case(plan, 0, diagnose=unsure_at_first)


def test_without_a_proposal_nothing_is_made() -> None:
    """A verdict that stays open without a proposal counts against the diagnosis."""

    def silent_on_what_next(recording: Recording, *, seed: int) -> Any:
        result = unsure_at_first(recording, seed=seed)
        result.next_experiment = None
        return result

    case = run_case(
        Plan(family="single", size="small", kinds=("coil_lag",)), 0, resolve=True, diagnose=silent_on_what_next
    )
    assert case["resolved"] == {"result": "not proposed"}
