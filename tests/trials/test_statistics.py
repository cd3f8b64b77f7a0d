"""Spreads: of one value, of none, and of a ratio against drawn samples."""

import math

import numpy as np
import pytest

from mrwarp.trials.statistics import ratio_sd, spread


def test_one_value_has_no_spread_and_none_has_no_mean() -> None:
    """:func:`spread` at its ends."""
    assert spread(np.array([2.0])) == {"mean": 2.0, "sd": 0.0}
    assert all(math.isnan(value) for value in spread(np.array([])).values())


def test_ratio_of_independent_figures_scatters_as_drawn_ones_do() -> None:
    """A COT of 3.45 ± 0.06 over one of 4.32 ± 0.12, drawn 100,000 times."""
    rng = np.random.default_rng(0)
    drawn = rng.normal(3.45, 0.06, 100_000) / rng.normal(4.32, 0.12, 100_000)
    assert ratio_sd((3.45, 0.06), (4.32, 0.12)) == pytest.approx(drawn.std(), rel=0.02)
