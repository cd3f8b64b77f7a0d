"""The first answer: what looks likeliest, said and handed out before anything is checked."""

from dataclasses import replace
from functools import partial

import pytest

from benchmarks.confusion.case import make_case
from mrwarp.diagnose.pipeline import diagnose
from mrwarp.diagnose.result import Diagnosis
from mrwarp.recording.load import Recording
from mrwarp.sysid.verdict import NOT_CHECKED, being_checked


def stopped(recording: Recording) -> tuple[Diagnosis, list[str]]:
    """The first answer of a diagnosis that ends with it, and the lines on the way."""
    said: list[str] = []
    answers: list[Diagnosis] = []
    last = diagnose(recording, progress=said.append, answered=partial(_taken, answers))
    assert answers == [last] and said[-1] == being_checked(last.sentence)
    return last, said


def _taken(answers: list[Diagnosis], answer: Diagnosis) -> bool:
    answers.append(answer)
    return False


def few(recording: Recording) -> Recording:
    """Its first six runs."""
    return replace(recording, trajectories=recording.trajectories[:6])


def test_a_lag_with_its_size() -> None:
    """The likeliest effect with its number, which stands among the suspects; no verdict, no cause, no model."""
    case = make_case("coil_lag", level=1.5, seed=5, size="small")
    answer, said = stopped(few(case.recording))
    true = case.truth.parameters["coil_lag"]["value"]
    assert not answer.final and answer.verdict is None and not answer.causes and answer.model is None
    best = answer.suspects[0]
    assert best.name == "coil_lag" and best.reason == NOT_CHECKED
    assert best.parameters["time_constant"].value == pytest.approx(true, rel=0.5)
    assert said[-1].startswith("likely: coil lag about ") and said[-1].endswith("; checking")


def test_nothing_hidden() -> None:
    """No suspect."""
    answer, _ = stopped(few(make_case("none", level=0.0, seed=2, size="small").recording))
    assert (
        not answer.suspects and answer.sentence == "Likely: nothing is missing that these data could show; not checked."
    )
