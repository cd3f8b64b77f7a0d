"""Laws compared with finer mechanical simulations: masses, springs, stops and rubbing contacts at steps of 10 µs."""

from collections.abc import Callable

import numpy as np
import pytest

from tests.effects.along import Shaft, replace, torque

STEP = 1e-5


def stop_and_go(dt: float = 0.001) -> Shaft:
    """A joint that swings, stops half-way with a smooth run-out, rests, and goes on the same way, then back."""
    t = np.arange(round(3.2 / dt)) * dt
    pace = np.interp(t, [1.0, 1.35, 1.85, 2.2], [1.0, 0.0, 0.0, 1.0])
    pace = 0.5 - 0.5 * np.cos(np.pi * pace)
    q = 0.3 * np.sin(2.0 * np.pi * np.cumsum(pace) * dt)
    qd = np.gradient(q, dt)
    return replace(Shaft.steady(np.ones(len(t)), dt), q=q, qd=qd, qdd=np.gradient(qd, dt))


def rubbing(shaft: Shaft, slips_at: Callable[[float], float], reach: float = 2e-4) -> np.ndarray:
    """Torque at a joint that turns, through a stiff coupling, a light disc on a contact of bristles.

    The bristles bend in proportion to the way, up to ``reach``, where they slip at the torque ``slips_at(angle)``.
    """
    mass, stiff = 1e-5, 4e3
    rub = 2.0 * np.sqrt(mass * stiff)
    fine = np.arange(round(shaft.time[-1] / STEP)) * STEP
    x, v = float(shaft.q[0]), 0.0
    bent, borne = 0.0, []
    for angle, speed in zip(
        np.interp(fine, shaft.time, shaft.q).tolist(), np.interp(fine, shaft.time, shaft.qd).tolist(), strict=True
    ):
        pull = stiff * (angle - x) + rub * (speed - v)
        v += STEP / mass * (pull - slips_at(x) * bent / reach)
        x += STEP * v
        bent = min(max(bent + STEP * v, -reach), reach)
        borne.append(pull)
    return np.interp(shaft.time, fine, borne)


def far_from_reversals(shaft: Shaft) -> np.ndarray:
    """Samples more than 20 ms from where the direction of motion changes, and from the start; bool, shape (N,)."""
    moving = np.flatnonzero(np.abs(shaft.qd) > 0.02)
    turns = moving[1:][np.diff(np.sign(shaft.qd[moving])) != 0.0]
    away = np.ones(len(shaft.q), dtype=bool)
    for k in (0, *turns):
        away[max(0, k - 25) : k + 25] = False
    return away


@pytest.mark.parametrize("law", ["coulomb_friction", "load_friction", "stribeck", "position_friction"])
def test_dry_friction_at_rest_stays_what_it_was(law: str) -> None:
    """A contact of bristles that slip: when the joint stops they stay bent, and the torque stays up."""
    shaft = stop_and_go()
    numbers = {
        "coulomb_friction": {"torque": 0.3},
        "load_friction": {"F1": 0.3},
        "stribeck": {"torque": 0.3, "stribeck_speed": 1e3},
        "position_friction": {"F1": 0.0, "F2": 2.0},
    }[law]
    slips_at = (lambda x: 2.0 * x * x) if law == "position_friction" else (lambda x: 0.3)
    want = rubbing(shaft, slips_at)
    found = torque(shaft, {}, {law: {**numbers, "speed": 0.02}})
    away = far_from_reversals(shaft)
    rest = (shaft.time > 1.4) & (shaft.time < 1.8)
    level = float(np.abs(want[rest]).mean())
    assert level > 0.05 and np.ptp(shaft.q[rest]) < 1e-9
    np.testing.assert_allclose(found[away], want[away], rtol=0, atol=0.03 * np.abs(want).max())
    np.testing.assert_allclose(found[rest], want[rest], rtol=0, atol=0.02 * level)


def test_position_friction_of_a_wedge() -> None:
    """A block that climbs a wedge is pressed on more and more: friction in a straight line over the way."""
    shaft = stop_and_go()
    mu, press, spring = 0.2, 2.0, 4.0
    want = rubbing(shaft, lambda x: mu * (press + spring * x))
    effects = {
        "coulomb_friction": {"torque": mu * press, "speed": 0.02},
        "position_friction": {"F1": mu * spring, "F2": 0.0, "speed": 0.02},
    }
    away = far_from_reversals(shaft)
    error = np.abs(torque(shaft, {}, effects) - want)[away].max()
    without = np.abs(torque(shaft, {}, {"coulomb_friction": effects["coulomb_friction"]}) - want)[away].max()
    assert error < 0.02 * np.abs(want).max() and without > 0.2 * np.abs(want).max()


def test_play_with_different_stops() -> None:
    """A drive between two stops of other stiffness, with friction of its own: compliance_with_backlash by side."""
    shaft, gap, stiff, soft, rubs = stop_and_go(), 0.05, 12.0, 4.0, 0.2
    q = shaft.q
    stops = np.where(q > gap, stiff * (q - gap), np.where(q < -gap, soft * (q + gap), 0.0))
    want = rubbing(shaft, lambda x: rubs) + stops
    mean, difference = 0.5 * (stiff + soft), (stiff - soft) / (stiff + soft)
    effects = {
        "coulomb_friction": {"torque": rubs, "speed": 0.02},
        "compliance_with_backlash": {"stiffness": mean, "half_gap": gap, "difference": difference},
    }
    away = far_from_reversals(shaft)
    found = torque(shaft, {}, effects)
    np.testing.assert_allclose(found[away], want[away], rtol=0, atol=0.02 * np.abs(want).max())
    effects["compliance_with_backlash"]["difference"] = 0.0
    assert np.abs(torque(shaft, {}, effects) - want)[away].max() > 0.1 * np.abs(want).max()


def behind_two_springs(shaft: Shaft, base: dict[str, float], push: float, pull: float) -> np.ndarray:
    """Torque of a light shaft with the stress of eq. 15, behind a spring that is softer one way than the other."""
    mass, stress = 2e-5, base["K0"]
    fine = np.arange(round(shaft.time[-1] / STEP)) * STEP
    y, v, z, borne = float(shaft.q[0]), 0.0, 0.0, []
    driven, speeds = (np.interp(fine, shaft.time, x).tolist() for x in (shaft.q, shaft.qd))
    for x, speed in zip(driven, speeds, strict=True):
        k = 1.0 / (push if x > y else pull)
        bears = k * (x - y) + 2.0 * np.sqrt(mass * k) * (speed - v)
        v += STEP / mass * (bears - stress * z)
        y += STEP * v
        z += STEP * (v - base["beta"] * abs(v) * z - base["gamma"] * v * abs(z))
        borne.append(k * (x - y))
    return np.interp(shaft.time, fine, borne)


def test_series_compliance_with_different_sides() -> None:
    """A coupling that is three times as soft in one direction as in the other."""
    shaft = Shaft.swinging(seconds=1.5, dt=0.001)
    shaft = replace(shaft, current=np.zeros(len(shaft.q)))
    base = {"K0": 10.0, "beta": 16.5, "gamma": -2.5}
    push, pull = 0.09, 0.03
    want = behind_two_springs(shaft, base, push, pull)
    numbers = {"compliance": 0.5 * (push + pull), "difference": (push - pull) / (push + pull)}
    found = torque(shaft, base, {"series_compliance": numbers})
    equal = torque(shaft, base, {"series_compliance": {**numbers, "difference": 0.0}})
    late = slice(100, None)  # the device begins without stress, the swing at full speed
    error, without = (np.sqrt(np.mean((x - want)[late] ** 2)) / np.std(want) for x in (found, equal))
    assert error < 0.02 < 0.06 < without


def behind_play_and_spring(shaft: Shaft, base: dict[str, float], gap: float, compliance: float) -> np.ndarray:
    """Torque of a light shaft with the stress of eq. 15, behind a spring that pushes only outside of its play."""
    mass, k = 2e-7, 1.0 / compliance
    fine = np.arange(round(shaft.time[-1] / STEP)) * STEP
    driven, speeds = (np.interp(fine, shaft.time, x).tolist() for x in (shaft.q, shaft.qd))
    y, v, z, borne = driven[0] - gap * np.sign(speeds[0]), 0.0, 0.0, []  # the play is closed by the motion
    for x, speed in zip(driven, speeds, strict=True):
        stretch = x - y
        pushes = k * (stretch - min(max(stretch, -gap), gap))
        rubs = 2.0 * np.sqrt(mass * k) * (speed - v) if pushes else 0.0
        weakened = base["K0"] / (1.0 + base["alpha"] * abs(speed))
        v = (v + STEP / mass * (pushes + rubs - weakened * z)) / (1.0 + STEP / mass * base["B"])
        y += STEP * v
        z += STEP * (v - base["beta"] * abs(v) * z - base["gamma"] * v * abs(z))
        borne.append(pushes)
    return np.interp(shaft.time, fine, borne)


@pytest.mark.parametrize("viscosity", [0.02, 0.3])
def test_play_and_a_spring_before_a_device(viscosity: float) -> None:
    """On a reversal the spring unwinds in contact, then the play opens, then the spring is wound the other way."""
    shaft = Shaft.swinging(seconds=1.5, dt=0.0005)
    base = {"K0": 20.0, "B": viscosity, "alpha": 0.3, "beta": 16.5, "gamma": -2.5}
    gap, compliance = 0.01, 0.03
    want = behind_play_and_spring(shaft, base, gap, compliance)
    found = torque(shaft, base, {"backlash": {"half_gap": gap}, "series_compliance": {"compliance": compliance}})
    late = slice(200, None)  # the device begins without stress, the swing at full speed
    assert np.mean(np.abs(want[late]) < 1e-3) > 0.02  # the play is open now and then
    assert np.sqrt(np.mean((found - want)[late] ** 2)) < 0.02 * want[late].std()


def before_dry_friction(shaft: Shaft, slips: float, gap: float, compliance: float) -> np.ndarray:
    """Torque of a brake that does not turn below ``slips``, behind play and a spring, by its balance alone."""
    y, borne = float(shaft.q[0]), []
    for x in shaft.q.tolist():
        reach = gap + compliance * slips
        y = min(max(y, x - reach), x + reach)
        borne.append((x - y - min(max(x - y, -gap), gap)) / compliance)
    return np.array(borne)


@pytest.mark.parametrize("stiffness", [1e4, 1e6])
def test_play_and_a_spring_before_a_stiff_brake(stiffness: float) -> None:
    """However stiff eq. 15 is, the way of a reversal is that of the spring and the play: 2*(T*c + b)."""
    shaft = Shaft.swinging(seconds=1.5, dt=0.001)
    gap, compliance = 0.0026, 1.0 / 600.0
    want = before_dry_friction(shaft, 4.0, gap, compliance)
    effects = {"backlash": {"half_gap": gap}, "series_compliance": {"compliance": compliance}}
    found = torque(shaft, {"K0": 4.0 * stiffness, "beta": stiffness, "gamma": 0.0}, effects)
    late = slice(100, None)
    assert np.sqrt(np.mean((found - want)[late] ** 2)) < 0.03 * want.std()
    without = torque(shaft, {"K0": 4.0 * stiffness, "beta": stiffness, "gamma": 0.0})
    assert np.sqrt(np.mean((without - want)[late] ** 2)) > 0.1 * want.std()


def test_friction_that_differs_by_direction_is_that_of_a_band() -> None:
    """A band round a drum pulls with e^(mu*phi) one way and e^(-mu*phi) the other, and with nothing in a gap."""
    shaft = Shaft.swinging(seconds=2.0, dt=0.001)
    grip = np.exp(0.15 * np.pi)
    mean, ratio = 0.5 * (grip + 1.0 / grip), (grip - 1.0 / grip) / (grip + 1.0 / grip)
    base = {"K0": 400.0 * mean, "beta": 400.0, "gamma": 0.0}
    effects = {"friction_asymmetry": {"coulomb": 0.0, "viscous": 0.0, "speed": 0.05, "yielding": ratio}}
    found = torque(shaft, base, effects)
    assert found.max() == pytest.approx(grip, rel=1e-3) and found.min() == pytest.approx(-1.0 / grip, rel=1e-3)
    open_gap = torque(shaft, base, {**effects, "backlash": {"half_gap": 0.05}})
    assert np.mean(np.abs(open_gap) < 1e-3) > 0.1
