"""The law is asked before effects: a foreign device gets its law, the paper's device keeps eq. 14."""

import json

import numpy as np
import pytest

from mrwarp.diagnose.law_choice import MARGIN, LawChoice
from mrwarp.diagnose.pipeline import diagnose
from mrwarp.diagnose.result import Diagnosis
from mrwarp.recording.load import Recording
from tests.identify.test_law_fit import TRUTH, kwok_damper


@pytest.fixture(scope="module")
def foreign() -> tuple[Recording, Diagnosis]:
    """Kwok's law, nothing hidden, a sensor whose zero moved from run to run."""
    recording = kwok_damper(zeros=60.0)
    return recording, diagnose(recording)


def test_a_foreign_device_gets_its_law(foreign: tuple[Recording, Diagnosis]) -> None:
    """Kwok's law is said first, with its errors; nothing hidden, nothing named; the model file carries it."""
    recording, found = foreign
    assert found.law is not None and found.law.name == "kwok" and not found.causes
    before, after = found.law.error
    assert after < (1.0 - MARGIN) * min(before, found.law.rival)
    assert "The hysteresis has another shape: Kwok's law, error" in found.sentence
    model = found.model
    assert model is not None and model.law is not None
    assert model.law.values["slope"] == pytest.approx(TRUTH["slope"], rel=0.05)
    assert model.values["beta"] == pytest.approx(1.0) and model.values["K1"] == pytest.approx(TRUTH["K1"], rel=0.05)
    spread = float(np.concatenate([run.torque for run in recording.trajectories]).std())
    assert found.extended.rmse < 0.03 * spread
    plain = json.loads(json.dumps(found.to_dict()["law"]))
    assert plain["name"] == "kwok" and set(plain["held_out"]) > {"bouc_wen", "kwok", "spencer"}


def test_zeros_that_moved_are_told_and_listed(foreign: tuple[Recording, Diagnosis]) -> None:
    """Which runs, and by how much."""
    recording, found = foreign
    [fault] = found.recording_faults
    assert fault.kind == "torque_zero" and set(fault.per_trajectory) == {run.id for run in recording.trajectories}
    assert abs(fault.value) == pytest.approx(120.0, rel=0.05)
    assert found.sentence.startswith("The zero of the force moved between runs: ")


def test_a_gap_parts_the_moved_zeros() -> None:
    """Those on the far side of a wide gap, else all."""
    held = {"bouc_wen": 0.2, "kwok": 0.1}
    apart = LawChoice(
        name="kwok", held_out=held, rival=0.2, offsets={"a": 0.0, "b": -100.0, "c": 3.0, "d": -97.0, "e": 1.0}
    )
    assert apart.moved == ["b", "d"]
    even = LawChoice(name="kwok", held_out=held, rival=0.2, offsets={str(k): float(k) for k in range(8)})
    assert len(even.moved) == 8
