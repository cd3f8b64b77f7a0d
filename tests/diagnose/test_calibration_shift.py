"""Shifts of calibration against nominal numbers: which, how large, and not where none is."""

import numpy as np
import pytest

from mrwarp.diagnose.calibration_shift import find_shift
from tests.diagnose import known


def shifts(seed: int = 20, **changes: float) -> list:
    """Shifts of the fitted joint against the paper's."""
    problem = known.problem(seed=seed, at=known.motion(seed, runs=6, seconds=3.0), **changes)
    found = find_shift(known.fitted(problem), known.TRUTH, float(np.ptp(problem.motion.torque)), problem.settings)
    return [] if found is None else [found]


def scaled(factor: float, names: tuple[str, ...]) -> dict[str, float]:
    """Some of the paper's numbers by a factor."""
    return {name: factor * known.TRUTH[name] for name in names}


LINEAR = ("D", "B", "C", "I1", "K0", "K1")


@pytest.mark.parametrize(
    ("name", "changes", "value"),
    [
        ("torque_gain", scaled(1.15, LINEAR), 1.15),
        ("torque_gain", scaled(0.88, LINEAR), 0.88),
        ("current_gain", scaled(1.15, ("I1", "K1")), 1.15),
        ("torque_bias", {"D": known.TRUTH["D"] + 0.03}, 0.03),
        ("torque_bias", {"D": known.TRUTH["D"] - 0.05}, -0.05),
    ],
)
def test_shift_is_named_with_its_size(name: str, changes: dict[str, float], value: float) -> None:
    """A gain, a gain of the current, a bias: named or among the alternatives, its value within four errors."""
    (found,) = shifts(**changes)
    assert name == found.name
    error = (found.ci95[1] - found.ci95[0]) / (2.0 * 1.96)
    assert abs(found.value - value) < 4.0 * error and error < 0.05


def test_bias_may_be_an_offset_of_the_encoder() -> None:
    """Re-fitting cannot distinguish the zeros of torque and angle: the alternative is said."""
    (found,) = shifts(D=known.TRUTH["D"] + 0.03)
    assert "encoder_offset" in found.alternatives


def test_nominal_joint_has_no_shift() -> None:
    """The paper's numbers, and numbers a few per cent off in all directions, are no shift."""
    assert shifts() == []
    for seed in range(30, 36):
        rng = np.random.default_rng(seed)
        changes = {key: value * (1.0 + 0.02 * rng.uniform(-1, 1)) for key, value in known.TRUTH.items()}
        assert shifts(seed, **changes) == [], seed


def test_another_device_is_no_shift() -> None:
    """Numbers 20 % off in all directions are another device, not a shift of calibration."""
    named = 0
    for seed in range(40, 46):
        rng = np.random.default_rng(seed)
        changes = {key: value * (1.0 + 0.2 * rng.uniform(-1, 1)) for key, value in known.TRUTH.items()}
        named += len(shifts(seed, **changes))
    assert named <= 1
