"""The energy ledger closes: motor, device, contact, limits, gravity and step explain the change of kinetic energy."""

import numpy as np
import pytest

from benchmarks.verify import energy_ledger as physics_ledger
from benchmarks.verify.energy_ledger import LedgerRun
from benchmarks.verify.passivity import ROUNDING
from mrwarp.enums import Coupling
from mrwarp.env.backend import BackendKind
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy

LEDGER_GAP = 1e-5
"""Largest part of the turned-over energy that no source explains; the ledger is summed in float32."""

MASS, GRAVITY = 12.6, 9.81


def assert_closes(run: LedgerRun) -> None:
    """Every robot's gap stays below LEDGER_GAP of what was turned over.

    Measured: 3e-15 (rigid fall), 3e-9 (legs moving), 2e-6 (standing), 4e-7 (drop), 1e-7 (walking); the simulator sums
    its ledger in float32, 1600 additions to at most 10 J err by up to 1600*2^-24*10 = 1e-3 J and typically by 1e-5 J.
    """
    assert (run.turnover > 1.0).all()
    assert (np.abs(run.gap) < LEDGER_GAP * run.turnover).all()


def test_ledger_free_fall_is_the_closed_form() -> None:
    """At rest in its stance the robot falls by g*t*(t + dt)/2 in steps: every entry is known, to rounding.

    T = m*(g*t)^2/2 = 97 J; gravity gives m*g^2*t*(t + dt)/2; the step takes the difference, 1.2 J; nothing else acts.
    """
    run, t = physics_ledger.free_fall(moving=False), physics_ledger.FREE_FALL
    np.testing.assert_allclose(run.kinetic, 0.5 * MASS * (GRAVITY * t) ** 2, rtol=1e-6)  # the asset's mass is float32
    np.testing.assert_allclose(run.work["gravity"], run.kinetic * (1.0 + run.dt / t), rtol=1e-12)
    np.testing.assert_allclose(run.work["step"], -run.kinetic * run.dt / t, rtol=1e-11)
    for source in ("motor", "device", "contact", "limits"):
        np.testing.assert_allclose(run.work[source], 0.0, atol=1e-12)
    assert_closes(run)


def test_ledger_closes_in_the_air_and_the_step_falls_with_dt() -> None:
    """Legs on the move: the ledger closes at any step, and what the step itself takes is proportional to it.

    Measured: 3.89, 1.86, 0.91 J at 5, 2.5, 1.25 ms; 2.09 and 2.04 times less per halving.
    """
    runs = [physics_ledger.free_fall(moving=True, dt=dt) for dt in (0.005, 0.0025, 0.00125)]
    for run in runs:
        assert_closes(run)
        assert (run.work["motor"] > 0.5).all() and (run.work["device"] < -0.3).all()
        assert not run.work["contact"].any()
    step = np.array([run.work["step"].mean() for run in runs])
    np.testing.assert_allclose(step[:-1] / step[1:], 2.0, atol=0.15)


def test_ledger_closes_standing() -> None:
    """The robot sinks into its stance for 2 s: gravity pays motors, devices and sliding feet."""
    run = physics_ledger.standing()
    assert_closes(run)
    assert (run.kinetic < 0.01).all() and (run.work["gravity"] > 0.1).all()
    for source in ("motor", "device", "contact", "step"):
        assert (run.work[source] < 0.0).all()


@pytest.mark.parametrize("coupling", list(Coupling))
def test_ledger_closes_in_an_impact(coupling: Coupling) -> None:
    """Dropped from 0.3 m, with either coupling: the fall's 40 J end in motors, devices, contacts and the step."""
    run = physics_ledger.standing(lift=0.3, coupling=coupling)
    assert_closes(run)
    assert (run.work["gravity"] > MASS * GRAVITY * 0.3).all()
    assert (run.work["contact"] < -3.0).all() and (run.work["device"] < -2.0).all()


def test_ledger_closes_walking() -> None:
    """4 s of the shipped policy at 0.4 m/s: motors pay devices, feet and the step; no device pays in any step.

    Measured: 24 J of motors against -9.0 J of devices, -3.3 J of contacts, -11.4 J of the step (10 % of the turnover).
    """
    run, devices = physics_ledger.walking(OnnxPolicy(DEFAULT_POLICY), seed=0)
    assert_closes(run)
    assert (run.work["motor"] > 15.0).all() and (run.work["device"] < -5.0).all() and (run.work["contact"] < 0.0).all()
    assert (np.abs(run.work["step"]) < 0.15 * run.turnover).all()
    figures = devices.figures()
    assert figures["largest_step_work"] <= ROUNDING[BackendKind.MJBATCH] and figures["unsolved_share"] < 0.005
