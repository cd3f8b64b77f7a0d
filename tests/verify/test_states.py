"""Both engines from 1,000 random states: one step later they differ by no more than float32 rounds."""

import numpy as np
import pytest

from mrwarp.verify.states import GROUPS, StateAgreement, state_agreement

MEDIAN = {"qpos": 5e-7, "qvel": 2e-5, "qacc": 4e-3, "foot force": 5e-4}
"""Largest median difference [m, m/s, m/s², N]; measured over 8 seeds: 1.5e-7, 5.5e-6, 1.1e-3, 5e-5."""

WORST = {"qpos": 1e-5, "qvel": 2e-3, "qacc": 0.4, "foot force": 0.08}
"""Largest difference at any state; measured over 8 seeds, 8,000 states: 2.6e-6, 5.2e-4, 0.10, 0.019."""


@pytest.fixture(scope="module")
def compared() -> dict[str, StateAgreement]:
    """400 states in the air, 400 on the feet, 200 lying; random torques and brake bounds."""
    return {group.name: group for group in state_agreement(seed=0)}


@pytest.mark.parametrize("name", GROUPS)
def test_engines_agree_at_random_states(compared: dict[str, StateAgreement], name: str) -> None:
    """The velocities stay within the a-priori rounding of each state (measured share: 0.03 to 0.75 over 8 seeds)."""
    group = compared[name]
    assert len(group.steep) == GROUPS[name]
    assert group.share <= 1.0
    for quantity, difference in group.difference.items():
        assert np.median(difference[~group.steep]) <= MEDIAN[quantity], quantity
        assert group.worst[quantity] <= WORST[quantity], quantity


def test_random_states_are_what_they_say(compared: dict[str, StateAgreement]) -> None:
    """No contact in the air, all touch elsewhere; loaded feet, fast joints, some at their limits; nothing is NaN."""
    assert not compared["in the air"].contacts.any()
    assert compared["on its feet"].contacts.all() and compared["lying"].contacts.all()
    assert np.median(compared["on its feet"].size["foot force"]) > 50.0
    assert (compared["in the air"].limits > 0).mean() > 0.1
    for group in compared.values():
        assert np.median(group.size["qacc"]) > 100.0
        assert all(np.isfinite(values).all() for values in group.difference.values())


def test_engines_differ_where_a_capsule_stands_steeply(compared: dict[str, StateAgreement]) -> None:
    """The known difference: rare (measured 6 to 16 of 200 lying states, none elsewhere), and nowhere near rounding."""
    lying = compared["lying"]
    assert not compared["in the air"].steep.any() and not compared["on its feet"].steep.any()
    assert 1 <= lying.steep.sum() <= 30
    assert lying.difference["qvel"][lying.steep].max() > 0.1
