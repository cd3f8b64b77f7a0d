"""Calibration: finds injected numbers, states an honest interval, refuses rows that cannot decide."""

from dataclasses import replace

import numpy as np
import pytest

from mrwarp.energy.model_numbers import CALIBRATED, VARIED, MeasuredPower, calibrate, sensitivity
from mrwarp.energy.power import ElectricalCfg, JointLoad, battery_power

TRUTH = ElectricalCfg(electronics=47.0, winding_resistance=0.17, drive_friction=1.4)


def rows(noise: float = 0.0, seed: int = 0, count: int = 7) -> list[MeasuredPower]:
    """Uses of a robot without devices, with powers that the true numbers give."""
    generator = np.random.default_rng(seed)
    made = []
    for k in range(count):
        joints = JointLoad(
            torque_square=generator.uniform(2.0, 25.0, 12) * generator.uniform(0.5, 1.5),
            speed=generator.uniform(0.0, 2.0, 12) * generator.uniform(0.0, 1.5),
            work_out=generator.uniform(0.0, 3.0, 12),
            work_in=generator.uniform(0.0, 2.0, 12),
            coil=np.zeros(0),
            friction=np.zeros(0),
        )
        made.append(
            MeasuredPower(
                name=f"row {k}",
                joints=joints,
                measured=float(battery_power(joints, TRUTH).total + noise * generator.normal()),
            )
        )
    return made


def test_recovers_the_truth_exactly_without_noise() -> None:
    """All three numbers, and every row."""
    found = calibrate(rows(), ElectricalCfg())
    assert found.cfg.electronics == pytest.approx(47.0, rel=1e-9)
    assert found.cfg.winding_resistance == pytest.approx(0.17, rel=1e-9)
    assert found.cfg.drive_friction == pytest.approx(1.4, rel=1e-9)
    assert found.rmse < 1e-9


def test_interval_holds_the_truth() -> None:
    """With 3 W of noise the 95 % interval holds the truth in nearly all of 40 draws."""
    hits = 0
    for seed in range(40):
        found = calibrate(rows(noise=3.0, seed=seed), ElectricalCfg())
        hits += all(
            abs(getattr(found.cfg, name) - getattr(TRUTH, name)) <= half for name, half in found.half_width.items()
        )
    assert hits >= 33  # 95 % each, jointly about 90 %


def test_a_number_out_of_its_range_stands_at_the_end_and_the_other_is_fitted() -> None:
    """Rows that ask for negative electronics: 0 W, named, and the resistance that then fits them best."""
    made = [replace(row, measured=row.measured - 60.0) for row in rows(noise=1.0)]
    found = calibrate(made, ElectricalCfg())
    assert found.at_bound == ("electronics",)
    assert found.cfg.electronics == pytest.approx(0.0, abs=1e-6)
    held = calibrate(made, replace(ElectricalCfg(), electronics=0.0), hold=("electronics",))
    assert found.cfg.winding_resistance == pytest.approx(held.cfg.winding_resistance, rel=1e-6)
    assert calibrate(rows(noise=1.0), ElectricalCfg()).at_bound == ()


def test_a_held_number_stays_and_the_other_makes_the_best_of_it() -> None:
    """No other resistance fits better with electronics held."""
    made, held = rows(noise=3.0), replace(ElectricalCfg(), electronics=30.0)
    found = calibrate(made, held, hold=("electronics",))
    assert found.cfg.electronics == 30.0
    assert set(found.half_width) == {"winding_resistance", "drive_friction"}

    def misfit(resistance: float) -> float:
        cfg = replace(found.cfg, winding_resistance=resistance)
        return sum((float(battery_power(row.joints, cfg).total) - row.measured) ** 2 for row in made)

    best = found.cfg.winding_resistance
    assert misfit(best) < min(misfit(0.99 * best), misfit(1.01 * best))


def test_friction_is_found_in_the_rows_that_hide_it() -> None:
    """Held at none, the rows' friction counts as copper and electronics; fitted, it is reported with its interval."""
    made = rows(noise=0.5)
    without = calibrate(made, ElectricalCfg(drive_friction=0.0), hold=("drive_friction",))
    found = calibrate(made)
    assert without.rmse > 3.0 * found.rmse and "drive_friction" not in without.half_width
    assert (
        abs(found.cfg.drive_friction - TRUTH.drive_friction)
        <= found.half_width["drive_friction"]
        < TRUTH.drive_friction
    )
    none = calibrate([replace(row, measured=row.measured - 3.0 * float(row.joints.speed.sum())) for row in made])
    assert none.cfg.drive_friction == pytest.approx(0.0, abs=1e-6) and none.at_bound == ("drive_friction",)


def test_rows_that_cannot_tell_are_refused() -> None:
    """Too few, or all with the same loss."""
    with pytest.raises(ValueError, match="at least 4"):
        calibrate(rows(count=3))
    same = rows()[0]
    with pytest.raises(ValueError, match="cannot separate electronics and winding_resistance and drive_friction"):
        calibrate([same, same, same, same])


def test_sensitivity_calibrates_again_and_covers_all_assumed_numbers() -> None:
    """Each assumed number at both ends; a calibrated row stays close for any assumption."""
    made = rows()
    nominal = calibrate(made, TRUTH).cfg

    def figure(cfg: ElectricalCfg) -> dict[str, float]:
        return {"power": float(battery_power(made[0].joints, cfg).total)}

    found = sensitivity(made, figure, nominal)
    assert set(found) == {*VARIED, *CALIBRATED["electrical"]}
    assert all(len(entries) == 2 for entries in found.values())
    assert replace(nominal) == nominal
    # a calibrated number at its end, the other fitted: the mean power of the rows stays what was measured
    noisy = rows(noise=2.0)

    def mean(cfg: ElectricalCfg) -> dict[str, float]:
        return {"power": float(np.mean([battery_power(row.joints, cfg).total for row in noisy]))}

    measured = np.mean([row.measured for row in noisy])
    for name in CALIBRATED["electrical"]:
        for entry in sensitivity(noisy, mean, calibrate(noisy).cfg)[name]:
            assert entry["power"] == pytest.approx(measured, rel=0.02)
            assert entry["rmse"] < 5.0
    for entry in found["controller_idle"]:  # Go1 has no controllers
        assert entry["power"] == pytest.approx(made[0].measured, rel=1e-9)
