"""Thermal model: steady state, energy balance, composition of steps, one-node limits, calibration that finds truth."""

from dataclasses import replace

import numpy as np
import pytest

from mrwarp.energy.thermal import Temperatures, ThermalCfg, calf_rises, calibrate, derated, step

CFG = ThermalCfg(
    winding_capacity=30.0,
    winding_resistance=1.0,
    housing_capacity=400.0,
    housing_resistance=5.0,
    fluid_capacity=50.0,
    fluid_resistance=8.0,
)


def heated(seconds: float, loss: float, device: float = 0.0, start: Temperatures | None = None) -> Temperatures:
    """One motor and one device after constant losses."""
    start = start or Temperatures.ambient((), 1, 1)
    return step(start, np.array([loss]), np.array([device]), seconds, CFG)


def test_steady_state_is_loss_times_resistances() -> None:
    """After many time constants: housing P*R_ha, winding P*(R_ha + R_wh), fluid P*R_fa."""
    end = heated(1e6, 4.0, 2.0)
    assert end.housing[0] == pytest.approx(20.0)
    assert end.winding[0] == pytest.approx(24.0)
    assert end.fluid[0] == pytest.approx(16.0)


def test_steps_compose() -> None:
    """Two half steps are one whole step: the step is exact, not an approximation."""
    half = heated(150.0, 7.0, 3.0)
    whole, twice = heated(300.0, 7.0, 3.0), heated(150.0, 7.0, 3.0, half)
    for name in ("winding", "housing", "fluid"):
        np.testing.assert_allclose(getattr(twice, name), getattr(whole, name), rtol=1e-12)


def test_fluid_warms_exponentially() -> None:
    """T_f = P R (1 - exp(-t/(R C))) with R C = 400 s."""
    assert heated(400.0, 0.0, 2.0).fluid[0] == pytest.approx(16.0 * (1.0 - np.exp(-1.0)), rel=1e-12)


def test_heat_is_stored_or_leaves() -> None:
    """Energy balance over small steps: P t = stored heat + what the housing gave to the air."""
    now, given, left, dt = Temperatures.ambient((), 1, 1), 0.0, 0.0, 0.5
    for _ in range(400):
        after = step(now, np.array([6.0]), np.zeros(1), dt, CFG)
        # the trapezoid's error is dt^2/12 of the curvature: 1e-5 of the heat here
        left += dt * 0.5 * float(now.housing[0] + after.housing[0]) / CFG.housing_resistance
        given += dt * 6.0
        now = after
    stored = CFG.winding_capacity * now.winding[0] + CFG.housing_capacity * now.housing[0]
    assert stored + left == pytest.approx(given, rel=1e-4)


def test_a_motor_that_rests_cools_to_ambient_without_undershoot() -> None:
    """From a warm winding: the housing first warms, then everything decays, never below the air."""
    start = Temperatures(winding=np.array([30.0]), housing=np.array([10.0]), fluid=np.zeros(1))
    trace = [heated(t, 0.0, start=start) for t in (1.0, 20.0, 500.0, 2e4)]
    assert trace[1].housing[0] > 10.0
    assert all(state.winding[0] >= 0.0 and state.housing[0] >= 0.0 for state in trace)
    assert trace[-1].winding[0] < 0.1


def test_softening_is_off_when_cold_and_never_negative() -> None:
    """Factors 1 at ambient; yield falls linearly and stops at 0, viscosity exponentially."""
    strength, viscosity = derated(np.array([0.0, 50.0, 1e4]), ThermalCfg())
    np.testing.assert_allclose(strength, [1.0, 0.9, 0.0])
    np.testing.assert_allclose(viscosity[:2], [1.0, np.exp(-1.0)])


def test_calibration_finds_the_truth() -> None:
    """Rises made by known numbers give the numbers back."""
    truth = replace(ThermalCfg(), housing_capacity=450.0, housing_resistance=12.0)
    loss = {"outbound": np.full(12, 9.0), "standby": np.full(12, 5.0), "return": np.full(12, 11.0)}
    seconds = {"outbound": 500.0, "standby": 600.0, "return": 500.0}
    calves = (2, 5, 8, 11)
    rises = calf_rises(loss, seconds, calves, truth)
    fitted, got = calibrate(loss, seconds, rises, calves, ThermalCfg())
    assert fitted.housing_capacity == pytest.approx(450.0, rel=1e-4)
    assert fitted.housing_resistance == pytest.approx(12.0, rel=1e-4)
    assert got["calf_walking"] == pytest.approx(rises["calf_walking"], abs=1e-6)
