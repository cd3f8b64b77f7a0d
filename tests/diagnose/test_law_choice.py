"""The law is asked before effects: a foreign device gets its law, the paper's device keeps eq. 14."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from mrwarp.diagnose.data_checks import gaps
from mrwarp.diagnose.law_choice import LawChoice, choose_law
from mrwarp.diagnose.pipeline import diagnose
from mrwarp.diagnose.result import Diagnosis
from mrwarp.diagnose.screening import screen
from mrwarp.diagnose.verdict_text import sentence_of
from mrwarp.recording.load import Recording, Trajectory
from mrwarp.sysid.settings import Effort, Law, Settings
from tests.diagnose import known
from tests.identify.test_law_fit import TRUTH, kwok_damper


@pytest.fixture(scope="module")
def foreign(few_trees: None) -> tuple[Recording, Diagnosis, Diagnosis]:
    """Kwok's law, nothing hidden, a sensor whose zero moved from run to run; the verdict and the first answer."""
    recording, first = kwok_damper(zeros=60.0, runs=8), []
    few = Settings(effort=Effort(starts_on=1000, samples=1000))
    return recording, diagnose(recording, settings=few, answered=lambda d: not first.append(d)), first[0]


def test_a_foreign_device_gets_its_law(foreign: tuple[Recording, Diagnosis, Diagnosis]) -> None:
    """Kwok's law is said first, with its errors; nothing hidden, nothing named; the model file carries it.

    The first answer names no lag or friction in its place.
    """
    recording, found, first = foreign
    assert first.sentence.startswith("Likely: a hysteresis of another shape") and not first.final
    assert found.law is not None and found.law.name == "kwok" and not found.causes and found.unexplained is None
    before, after = found.law.error
    assert after < (1.0 - Law().margin) * min(before, found.law.rival)
    assert "The hysteresis has another shape: Kwok's law, error" in found.sentence
    model = found.model
    assert model is not None and model.law is not None
    assert model.law.values["slope"] == pytest.approx(TRUTH["slope"], rel=0.05)
    assert model.values["beta"] == pytest.approx(1.0) and model.values["K1"] == pytest.approx(TRUTH["K1"], rel=0.05)
    spread = float(np.concatenate([run.torque for run in recording.trajectories]).std())
    assert found.extended.rmse < 0.03 * spread
    plain = json.loads(json.dumps(found.to_dict()["law"]))
    assert plain["name"] == "kwok" and set(plain["held_out"]) > {"bouc_wen", "kwok", "spencer"}


def test_zeros_that_moved_are_told_and_listed(foreign: tuple[Recording, Diagnosis, Diagnosis]) -> None:
    """Which runs, and by how much."""
    recording, found, _ = foreign
    [fault] = found.recording_faults
    assert fault.kind == "torque_zero" and set(fault.per_trajectory) == {run.id for run in recording.trajectories}
    assert abs(fault.value) == pytest.approx(120.0, rel=0.05)
    assert found.sentence.startswith("The zero of the force moved between runs: ")


def test_a_gap_parts_the_moved_zeros() -> None:
    """Those on the far side of a wide gap, else all."""
    held = {"bouc_wen": 0.2, "kwok": 0.1}
    moved = LawChoice(
        name="kwok", held_out=held, rival=0.2, offsets={"a": 0.0, "b": -100.0, "c": 3.0, "d": -97.0, "e": 1.0}
    )
    assert moved.moved(0.3) == ["b", "d"]
    even = LawChoice(name="kwok", held_out=held, rival=0.2, offsets={str(k): float(k) for k in range(8)})
    assert len(even.moved(0.3)) == 8


def _motor(inertia: float, friction: float, spikes: float, drift: float = 0.0) -> Recording:
    """A motor with inertia, dry and viscous friction on sines of 0.2 and of 2 to 3 Hz, a few samples off by newtons.

    The zero of its torque moves by ``drift`` within each run.
    """
    rng, dt, found = np.random.default_rng(12), 0.002, []
    for k, (rate, seconds) in enumerate(((0.2, 6.0), (0.2, 6.0), (3.0, 2.0), (2.5, 2.0), (3.0, 1.0), (2.0, 1.5))):
        t, w = np.arange(round(seconds / dt)) * dt, 2.0 * np.pi * rate
        q, qd, qdd = 0.35 * np.sin(w * t), 0.35 * w * np.cos(w * t), -0.35 * w**2 * np.sin(w * t)
        torque = inertia * qdd + friction * np.tanh(qd / 0.02) + 0.16 * friction * qd
        torque += 0.1 * friction * rng.normal(size=len(t)) + drift * t / seconds
        where = rng.random(len(t)) < spikes
        torque[where] += rng.uniform(3.0, 25.0, where.sum()) * friction * rng.choice([-1.0, 1.0], where.sum())
        found.append(Trajectory(id=f"run{k}", t=t, q=q, qd=qd, current=0.0 * t, torque=torque))
    return Recording(trajectories=tuple(found), units={"q": "rad", "current": "none", "torque": "N·m"})


@pytest.mark.slow
def test_a_zero_that_drifts_within_runs_is_noted() -> None:
    """It is no cause of the joint; the note gives its size, to a seventh on a few periods."""
    found = diagnose(_motor(0.021, 0.7, 0.0, 0.6), effects=("rotor_inertia", "coulomb_friction"))
    [note] = [text for text in found.notes if "drifts" in text]
    size = re.search(r"line in time, (\S+) N·m from its begin to its end \(up in 6 of 6\)", note)
    assert size is not None and float(size[1]) == pytest.approx(0.6, rel=0.15)


def test_play_and_a_spring_make_no_other_law() -> None:
    """Alone a law with a sharper corner does what they do; next to them it does not, and eq. 15 is kept."""
    hidden = {"series_compliance": {"compliance": 0.2}, "backlash": {"half_gap": 0.06}}
    problem = known.problem(hidden, seed=3, sigma=0.01, at=known.motion(3, runs=6, seconds=3.0))
    base = known.fitted(problem)
    choice, _, kept = choose_law(
        problem, base, screen(problem, base, ["current_saturation"]), list("012345"), log=lambda text: None
    )
    assert choice is not None and choice.held_out["bouc_wen_power"] < choice.held_out["bouc_wen"]
    assert not choice.other and kept is base


@pytest.mark.slow
def test_an_inertia_makes_no_other_law() -> None:
    """A motor on several frequencies: of all laws alone, LuGre's with four numbers can stand for the inertia best."""
    found = diagnose(_motor(0.021, 0.7, 0.01), effects=("rotor_inertia", "coulomb_friction", "position_friction"))
    assert found.spikes is not None and [cause.name for cause in found.causes] == ["rotor_inertia"]
    assert not any("drifts" in text for text in found.notes)
    inertia = found.causes[0].parameters["inertia"]
    low, high = inertia.ci95
    assert low < 0.021 < high and high - low < 0.4 * 0.021
    assert found.law is not None and found.law.name in ("dahl", "biviscous")
    assert found.law.simpler and found.law.error[0] < 0.15
    dry = found.dry_friction
    assert dry is not None and dry.value == pytest.approx(0.7, rel=0.05) and dry.unit == "N·m"
    assert found.to_dict()["law"]["coulomb_friction"]["value"] == dry.value and "Coulomb friction" in found.sentence
    # as of a joint of one speed, where viscous friction does as well: no number is given
    assert found.model is not None
    unknown = replace(found.model.parameters["K0"], ci95=(-40.0 * dry.value, 40.0 * dry.value))
    without = replace(found, model=replace(found.model, parameters={**found.model.parameters, "K0": unknown}))
    assert without.dry_friction is None and "slides at" not in sentence_of(without)
    assert "coulomb_friction" not in without.to_dict()["law"]
    # nor of a shaft that turns one way only: an offset of the torque's zero does as well
    runs = tuple(replace(run, qd=np.abs(run.qd)) for run in found.recording.trajectories)
    shaft = replace(found, recording=replace(found.recording, trajectories=runs))
    assert shaft.dry_friction is None and any("one way only" in text for text in gaps(shaft.recording))
    assert not any("one way only" in text for text in found.cannot_know)
    assert found.extended.nrmse < 0.2 and found.unexplained is None
