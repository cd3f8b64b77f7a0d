"""Calibration: finds injected numbers, states an honest interval, refuses rows that cannot tell."""

from dataclasses import replace

import numpy as np
import pytest

from mrwarp.electrical.calibrate import VARIED, CalibrationError, Row, calibrate, sensitivity
from mrwarp.electrical.power import ElectricalCfg, Use, battery_power

TRUTH = ElectricalCfg(electronics=47.0, winding_resistance=0.17)


def rows(noise: float = 0.0, seed: int = 0, count: int = 5) -> list[Row]:
    """Uses of a robot without devices, with powers that the true numbers give."""
    generator = np.random.default_rng(seed)
    made = []
    for k in range(count):
        use = Use(
            torque_square=generator.uniform(2.0, 25.0, 12), work_out=generator.uniform(0.0, 3.0, 12),
            work_in=generator.uniform(0.0, 2.0, 12), coil=np.zeros(0), friction=np.zeros(0),
        )  # fmt: skip
        made.append(
            Row(name=f"row {k}", use=use, measured=float(battery_power(use, TRUTH).total + noise * generator.normal()))
        )
    return made


def test_recovers_the_truth_exactly_without_noise() -> None:
    """Both numbers, and every row."""
    found = calibrate(rows(), ElectricalCfg())
    assert found.cfg.electronics == pytest.approx(47.0, rel=1e-9)
    assert found.cfg.winding_resistance == pytest.approx(0.17, rel=1e-9)
    assert found.rmse < 1e-9


def test_interval_holds_the_truth() -> None:
    """With 3 W of noise the 95 % interval holds the truth in nearly all of 40 draws."""
    hits = 0
    for seed in range(40):
        found = calibrate(rows(noise=3.0, seed=seed), ElectricalCfg())
        hits += all(
            abs(getattr(found.cfg, name) - getattr(TRUTH, name)) <= half for name, half in found.half_width.items()
        )
    assert hits >= 34  # 95 % each, jointly about 92 %


def test_rows_that_cannot_tell_are_refused() -> None:
    """Too few, or all with the same loss."""
    with pytest.raises(CalibrationError, match="at least 3"):
        calibrate(rows(count=2))
    same = rows()[0]
    with pytest.raises(CalibrationError, match="same copper loss"):
        calibrate([same, same, same])


def test_sensitivity_calibrates_anew_and_covers_all_assumed_numbers() -> None:
    """Each assumed number at both ends; a calibrated row stays close whatever was assumed."""
    made = rows()
    nominal = calibrate(made, TRUTH).cfg

    def figure(cfg: ElectricalCfg) -> dict[str, float]:
        return {"power": float(battery_power(made[0].use, cfg).total)}

    found = sensitivity(made, figure, nominal)
    assert set(found) == {*VARIED, "electronics", "winding_resistance"}
    assert all(len(entries) == 2 for entries in found.values())
    assert replace(nominal) == nominal
    for entry in found["controller_idle"]:  # Go1 has no controllers
        assert entry["power"] == pytest.approx(made[0].measured, rel=1e-9)
