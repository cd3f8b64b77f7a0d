"""The rule of the push: what it takes, what it reads from policies, and how results are read."""

from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from mrwarp import paper
from mrwarp.enums import Coupling, ZStep
from mrwarp.params import BoucWenParams
from mrwarp.trials.impact import Variant
from mrwarp.usd.robot import LEGS, TROT_PHASE
from paper.reproduce import settings as settings_module
from paper.reproduce.disturbance import push_rule
from paper.reproduce.disturbance.push_rule import JOINT, LITERAL, Reading, ZeroRow, chosen
from paper.reproduce.settings import Settings, trained_gains


def row(duration: float, **changes: float) -> ZeroRow:
    """The paper's row of 0 A but for some changes."""
    return ZeroRow(duration=duration, onset=0.33, **{**push_rule.papers_zero(), **changes})


def test_papers_zero_is_what_its_tables_and_its_figure_say() -> None:
    """Drop from table 2's height, table 4's speed, and figure 6's peak before the 14.5 % are taken from it."""
    wanted = push_rule.papers_zero()
    assert wanted["drop"] == pytest.approx(0.3337 - 0.1851)
    assert wanted["peak"] * (1.0 - 0.145) == pytest.approx(23.015)
    assert row(0.3).score == 0.0


def test_the_nearest_row_is_taken_and_of_equals_the_shortest() -> None:
    """A push that outlasts the fall changes nothing to speak of, so that it is not preferred."""
    rows = [row(0.2, drop=0.05), row(0.3, drop=0.1), row(0.4, drop=0.1001), row(0.8, drop=0.09)]
    assert chosen(rows).duration == 0.3
    assert chosen([row(0.2, drop=0.1), row(0.3, drop=0.12)]).duration == 0.3


def test_the_pair_stands_for_the_whole_fall() -> None:
    """FL and RR have just touched down at the onset: their half of the clock goes on for the longest fall."""
    assert push_rule.PHASES[1] - push_rule.PHASES[0] <= 0.1
    for leg, at in zip(LEGS, TROT_PHASE, strict=True):
        stands = (push_rule.PHASES[1] + at) % 1.0 < 0.5
        assert stands == (leg in push_rule.PAIR)


def test_readings_differ_in_what_they_say() -> None:
    """Names are given once; columns are the paper's torque and the constraint; the square crosses angle and drag."""
    assert max(Counter(reading.name for reading in push_rule.READINGS).values()) == 1
    assert len(set(push_rule.READINGS)) == len(push_rule.READINGS) and push_rule.READINGS[:2] == (LITERAL, JOINT)
    assert {(r.raw, r.free) for r in push_rule.SQUARE} == {(a, b) for a in (False, True) for b in (False, True)}
    env = {
        reading: push_rule.config(reading, Settings(), (reading.variant(0.0),), 0.3).env for reading in (LITERAL, JOINT)
    }
    assert [env[each].coupling for each in (LITERAL, JOINT)] == [Coupling.EXPLICIT, Coupling.CONSTRAINT]
    assert all(each.z_step is ZStep.EULER and not each.holding for each in env.values())


def test_drag_is_free_without_current_alone() -> None:
    """With current eq. 14 is whole; the raw angle moves its origin to 0."""
    free = Reading(raw=True, free=True)
    assert free.variant(1.5).params == {"q_neutral": 0.0}
    left = {**free.variant(0.0).params}
    assert left.pop("q_neutral") == 0.0
    law = BoucWenParams(**left)
    assert (law.D, law.B, law.C, law.K0, law.I1) == (0.0,) * 5 and LITERAL.variant(0.0).params == {}


def test_gains_are_those_of_the_training(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the policies' own description; none stands for the asset's, and one set has one."""
    said = {"a": {"task": {"gains": [12.0, 0.4]}}, "b": {"task": {"gains": [12.0, 0.4]}}, "c": {"task": {}}, "d": {}}
    monkeypatch.setattr(settings_module, "read_policy", lambda path: (None, said[path.name]))
    assert trained_gains([Path("a"), Path("b")]) == (12.0, 0.4)
    assert trained_gains([Path("c"), Path("d")]) is None
    with pytest.raises(ValueError, match="different gains"):
        trained_gains([Path("a"), Path("c")])


def test_every_duration_has_its_own_reference() -> None:
    """A push twice as long halves all heights; 1.5 A raise each by a tenth, at any duration."""

    class Pusher:
        settings = Settings()

        def push(self, reading: Reading, variants: tuple[Variant, ...], duration: float) -> SimpleNamespace:
            size = np.array([(1.1 if v.current else 1.0) / (v.duration or duration) for v in variants])
            trials = np.tile(np.linspace(1.0, 2.0, len(self.settings.impacted)), 2)
            series = size[:, None, None] * trials[:, None] * np.ones(3)
            return SimpleNamespace(height=series, velocity=-series)

    found = push_rule.duration_effects(cast("push_rule.Pusher", Pusher()))
    assert len(found) == len(push_rule.DURATIONS)
    for effects in found:
        for cell in push_rule.CELLS:
            assert effects[cell] == pytest.approx([10.0] * len(Pusher.settings.impacted))


@pytest.mark.parametrize("policies", [1, 3, 5])
def test_effects_are_each_policys_own(policies: int) -> None:
    """A policy that starts elsewhere has the same relative effect; three or five are as good."""
    base = np.tile(np.linspace(0.2, 0.3, policies), 4)
    cells = {cell: np.stack([base, 1.1 * base, 1.2 * base, 1.3 * base]) for cell in push_rule.CELLS}
    result = push_rule.PushResult(reading=LITERAL, onset=base, cells=cells, policies=policies)
    effect = result.effect("min_height", 1.5)
    assert effect == pytest.approx(30.0) and len(effect) == (4 if policies == 1 else policies)
    assert result.monotone == bool(base.min() > 0.0)


def test_papers_changes_are_those_of_its_cells() -> None:
    """The abstract's percentages follow from table 4 to their last digit, and those of COT from table 6."""
    for cell, change in paper.IMPACT_CHANGE.items():
        for kind, source in (("push", "simulation"), ("drop", "hardware")):
            rows = paper.TABLE_4[source]
            assert 100.0 * (rows[1.5][cell].mean / rows[0.0][cell].mean - 1.0) == pytest.approx(change[kind], abs=0.06)
    keys = [key[1:] for key in paper.TABLE_6 if key[0] == "mr_go"]
    lower = [1.0 - paper.TABLE_6["mr_go_sal", *key].cot / paper.TABLE_6["mr_go", *key].cot for key in keys]
    assert (min(lower), max(lower)) == pytest.approx(paper.COT_REDUCTION, abs=5e-4)
