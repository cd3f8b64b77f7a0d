"""Checks of the simulator's physics: passivity, holding, accuracy."""

import numpy as np
import pytest

from benchmarks.verify.accuracy import REFERENCE_DT, STEPS, Profile, errors, hysteresis_kept, reference
from benchmarks.verify.held_joint import (
    BREAKAWAY_LIMITS,
    CREEP_LIMITS,
    CURRENT,
    LOADS,
    bench_rig,
    calf_rig,
    hold,
    stand_on_brakes,
)
from benchmarks.verify.passivity import ROUNDING, PassivityRun, dropped_robot, falling_link
from benchmarks.verify.rigs import convergence_order, root_mean_square, yield_torque
from mrwarp.actuator import brake_constraint
from mrwarp.enums import Coupling
from mrwarp.env.backend import BackendKind
from mrwarp.params import MrParams

FRICTION_GAP = {BackendKind.MJBATCH: 2e-6, BackendKind.MJWARP: 0.06}
"""sim.friction against the solver's row [N·m].

float64: the result is stored as float32, 25.4 N·m * 2^-24 = 1.5e-6. float32: the velocity after a step that stops a
joint from 10 rad/s is rounded by 10*2^-24 = 6e-7 rad/s, which over the creep of 1e-5 is 0.06 N·m.
"""

MOTION_GAP = {BackendKind.MJBATCH: 1e-15, BackendKind.MJWARP: 2.5e-7}
"""qd_next*dt against the change of q [rad]: rounding of angles below 4 rad, 2^-52*4 and 2^-23*2."""

LEDGER_GAP = 1e-4
"""The float32 ledger against float64 sums [J]: 200 additions to less than 4 J, 200*2^-24*4 = 5e-5."""


def assert_passive(run: PassivityRun) -> None:
    """No step of a constraint run does positive work, in the solver's own row forces and in the simulator's ledger."""
    assert run.figures["largest_step_work"] <= ROUNDING[run.backend]
    assert run.figures["net_work"] < 0.0
    assert run.figures["friction_gap"] <= FRICTION_GAP[run.backend]
    assert run.figures["motion_gap"] <= MOTION_GAP[run.backend]


def test_passivity_falling_link():
    """A 2.7 N·m brake stops a falling link where energy says, within a step's motion, and does no positive work.

    Net torque (2.7 - 0.3*9.81*0.2) N·m stops 0.5*J*v^2 = 0.2 J after 0.095 rad; the step is 5 ms, so the path is short
    by up to v*dt/2 = 0.0125 rad. Explicitly applied, the same brake injects more than the link ever had.
    """
    brake, explicit = falling_link(Coupling.CONSTRAINT), falling_link(Coupling.EXPLICIT)
    assert_passive(brake)
    assert brake.figures["ledger_gap"] < LEDGER_GAP
    stop = 0.5 * 0.016 * 5.0**2 / (2.7 - 0.3 * 9.81 * 0.2)
    assert stop - 0.0125 - 1e-3 < brake.q[-1] < stop + 1e-3
    assert np.ptp(brake.q[-100:]) < 0.5 * brake_constraint.CREEP * 2.7  # [rad] 0.5 s at rest: creep only
    assert explicit.figures["injected"] > 0.5  # [J] over 0.6 s, where eq. 7 allows none
    assert explicit.figures["net_work"] > 0.0


@pytest.mark.parametrize("kind", list(BackendKind))
def test_passivity_impact(kind):
    """The robot dropped from 0.3 m: no device does positive work in any step, at any current, on either engine."""
    run = dropped_robot(Coupling.CONSTRAINT, backend=kind)
    assert_passive(run)
    assert run.figures["ledger_gap"] < LEDGER_GAP
    assert run.figures["net_work"] < -1.0  # [J] the devices took part in the impact
    assert run.figures["unsolved_share"] < 0.01


def test_passivity_explicit_coupling_is_measured_too():
    """With the explicit coupling the same impact injects energy, and meter and ledger agree on how much."""
    run = dropped_robot(Coupling.EXPLICIT)
    assert run.figures["injected"] > 0.05  # [J]
    assert run.figures["ledger_gap"] < LEDGER_GAP


@pytest.mark.parametrize("kind", list(BackendKind))
@pytest.mark.parametrize("rig", [calf_rig, bench_rig])
def test_holding_creep_and_breakaway(rig, kind):
    """A held joint creeps by R*dt per torque, for any inertia, and lets go at tau_y.

    The ramp rises by 0.05 % of tau_y per step, so break-away is seen within a few steps of it.
    """
    run = hold(rig(), kind)
    tau_y = yield_torque(MrParams(), CURRENT)
    expected = brake_constraint.CREEP * np.array(LOADS) * tau_y
    assert (np.abs(run.creep) <= CREEP_LIMITS).all()
    np.testing.assert_allclose(run.creep, expected, rtol=2e-3)
    assert BREAKAWAY_LIMITS[0] <= run.breakaway <= BREAKAWAY_LIMITS[1]
    assert run.unsolved == 0


def test_holding_default_friction_would_creep():
    """With MuJoCo's default friction the same joints creep a thousand times faster: the brake settings are needed."""
    run = hold(calf_rig(brake=False), BackendKind.MJBATCH, brake=False)
    assert (np.abs(run.creep) > 1e3 * np.array(CREEP_LIMITS)).all()


@pytest.mark.parametrize("kind", list(BackendKind))
def test_holding_robot_stands_on_its_brakes(kind):
    """10 s without calf motors: each calf drifts by what the creep predicts for its torque, half a milliradian.

    Tolerance: see StandRun.drift_tolerance. The trunk sinks with the sliding feet, not with the brakes.
    """
    run = stand_on_brakes(kind)
    drift = np.abs(run.calf[-1] - run.calf[0])
    np.testing.assert_array_less(np.abs(drift - run.expected_drift), run.drift_tolerance)
    assert drift.max() < 1e-3
    assert 0.0 <= run.height[0] - run.height[-1] < 5e-3
    assert run.unsolved == 0


@pytest.fixture(scope="module")
def compared() -> tuple[Profile, np.ndarray, np.ndarray]:
    """Eight random profiles, their paths at 50 µs, and the constraint's errors by step, shape (steps, 2)."""
    profile = Profile.draw(8, 5)
    truth = reference(profile, REFERENCE_DT)
    return profile, truth, np.array([errors(profile, truth, Coupling.CONSTRAINT, dt) for dt in STEPS])


def test_accuracy_constraint_follows_the_reference(compared):
    """At 5 ms the constraint is ten times closer to the reference than explicit torques, in angle and velocity."""
    profile, truth, constraint = compared
    assert (10.0 * constraint[STEPS.index(0.005)] < errors(profile, truth, Coupling.EXPLICIT, 0.005)).all()


def test_accuracy_constraint_is_first_order(compared):
    """Halving the step halves the constraint's error, from 10 ms to 1 ms: semi-implicit Euler with exact stick.

    0.2 on the order: stick and slip begin at steps, which scatters single errors.
    """
    assert convergence_order(STEPS, compared[2]) == pytest.approx([1.0, 1.0], abs=0.2)


def test_accuracy_reference_is_a_reference(compared):
    """Its own error is a fifth of the smallest error it judges, and it sticks for a part of the time."""
    profile, truth, constraint = compared
    own = root_mean_square(truth[::2] - reference(profile, 2.0 * REFERENCE_DT), (0, 1))
    assert (5.0 * own < constraint[-1]).all()
    assert (truth[..., 1] == 0.0).mean() > 0.1


def test_accuracy_chatter_wears_the_hysteresis():
    """Why explicit torques fail: they make a resting joint chatter, and eq. 15 wears z, the brake's strength, down."""
    assert hysteresis_kept(Coupling.CONSTRAINT) == pytest.approx(1.0, abs=1e-3)
    assert hysteresis_kept(Coupling.EXPLICIT) < 0.8
