"""Battery: linear gauge, internal loss in closed form, the most it gives."""

import numpy as np
import pytest

from mrwarp.energy.power import BatteryCfg, cell_power, depletion

IDEAL = BatteryCfg(capacity=100.0, resistance=0.0)


def test_an_ideal_battery_counts_energy() -> None:
    """100 W for half an hour from 100 W·h: 50 points."""
    assert depletion(100.0, 1800.0, IDEAL) == pytest.approx(50.0)


def test_cells_give_terminal_power_and_their_own_loss() -> None:
    """V I = P + R I^2 for every power."""
    cfg = BatteryCfg(voltage=20.0, resistance=0.1)
    power = np.array([0.0, 50.0, 200.0, 900.0])
    given = cell_power(power, cfg)
    current = given / cfg.voltage
    np.testing.assert_allclose(given, power + cfg.resistance * current**2, rtol=1e-12)


def test_more_than_the_battery_can_give_is_refused() -> None:
    """The most is V^2/(4 R) = 1000 W."""
    cfg = BatteryCfg(voltage=20.0, resistance=0.1)
    assert cell_power(1000.0, cfg) == pytest.approx(2000.0)
    with pytest.raises(ValueError, match="1001 W asked .* at most 1000 W"):
        cell_power(1001.0, cfg)
