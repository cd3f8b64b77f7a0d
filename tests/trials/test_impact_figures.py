"""The extended model in the robot: an effect that was found changes the impact sweep as the true one does."""

from typing import Any

import pytest

from mrwarp.model_file import Effect, Model, make_effect
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy
from mrwarp.trials.impact_figures import EFFECT_FIGURES, impact_change
from tests.models import paper_model

POLICY = OnnxPolicy(DEFAULT_POLICY)

TRUE_LAG = 0.03
"""Coil lag of the true device [s]."""

SWEEP: dict[str, Any] = {"trials": 10, "currents": (0.0, 1.5)}


def model(*effects: Effect, **more: float) -> Model:
    """The paper's joint, with effects or more parameters."""
    return paper_model(*effects, more=("q_offset", "q_center"), **more)


def lagging(time_constant: float) -> Model:
    """The model with an effect of the catalogue."""
    return model(make_effect("coil_lag", {"time_constant": time_constant}))


def changes(found: dict[str, Any]) -> dict[tuple[float, str], dict[str, Any]]:
    """Every change by current and figure."""
    return {(row["current"], name): row[name] for row in found["rows"] for name in EFFECT_FIGURES}


@pytest.fixture(scope="module")
def truth() -> dict[str, Any]:
    """Changes by the simulator's own coil lag, a joint parameter that knows nothing of effects."""
    return impact_change(model(), model(coil_time_constant=TRUE_LAG), POLICY, **SWEEP)


def test_true_lag_changes_the_sweep(truth: dict[str, Any]) -> None:
    """Nothing at 0 A, where no current lags; with current the body falls deeper and faster."""
    found = changes(truth)
    for name in EFFECT_FIGURES:
        assert found[0.0, name]["change"] == 0.0 == found[0.0, name]["ci95"][1]
    assert found[1.5, "min_height"]["change"] < -1e-4
    assert found[1.5, "peak_speed"]["change"] > 1e-3


def test_the_effect_changes_it_the_same_way(truth: dict[str, Any]) -> None:
    """The effect coil_lag of the true 30 ms gives the same numbers to the last bit, in another kernel."""
    assert changes(impact_change(model(), lagging(TRUE_LAG), POLICY, **SWEEP)) == changes(truth)


def test_dictionary(truth: dict[str, Any]) -> None:
    """Plain numbers with intervals around them."""
    row = truth["rows"][1]
    assert row["current"] == 1.5
    for name in EFFECT_FIGURES:
        low, high = row[name]["ci95"]
        assert low <= row[name]["change"] <= high and row[name]["change"] == row[name]["after"] - row[name]["before"]


def test_no_model_before_is_the_robots_own() -> None:
    """Without a model the first sweep is that of the asset, which holds the paper's numbers."""
    kwargs: dict[str, Any] = {"trials": 2, "currents": (1.0,)}
    asset, paper = (
        impact_change(None, lagging(0.1), POLICY, **kwargs),
        impact_change(model(), lagging(0.1), POLICY, **kwargs),
    )
    assert asset["rows"] == paper["rows"]
