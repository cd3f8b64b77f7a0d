"""Every law of the catalogue through the path: closed forms, signs, limits."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from mrwarp.effects.replay_kernel import HEAT_TIMES
from tests.effects import along

Shaft, TRUTH, EPS, torque, play, loop = along.Shaft, along.TRUTH, along.EPS, along.torque, along.play, along.loop
Effects = dict[str, dict[str, float]]
DT = 0.005
CURRENT = {"I1": 1.0}
"""Base whose torque is the current that flows."""
FIELD = {"K1": 20.0, "beta": 15.0, "gamma": 5.0}
"""Base whose torque is the current that magnetises, once z has saturated at 1/20."""
RUN_IN = 300
"""Samples at 1 rad/s after which z has saturated to 1e-13."""


def current_of(command: np.ndarray, effects: Effects, dt: float = DT) -> np.ndarray:
    """Current that flows for a command."""
    return torque(Shaft.steady(command, dt), CURRENT, effects)


def field_of(command: np.ndarray, effects: Effects, dt: float = DT) -> np.ndarray:
    """Current that magnetises for a command that stands at its first value before."""
    wait = np.full(round(RUN_IN * DT / dt), command[0])
    return torque(Shaft.steady(np.concatenate([wait, command]), dt), FIELD, effects)[len(wait) :]


def added(shaft: Any, effects: Effects, base: dict | None = None) -> np.ndarray:
    """Torque that effects add to that of the paper's joint."""
    base = TRUTH if base is None else base
    return torque(shaft, base, effects) - torque(shaft, base)


# --- from the command to the field ---


@pytest.mark.parametrize("lag", [0.0005, 0.003, 0.02, 0.3])
def test_coil_lag_of_a_step_is_an_exponential(lag: float) -> None:
    """A command that steps after a sample, and one that ramps between two samples, both exactly."""
    command = np.where(np.arange(60) < 10, 0.4, 1.4)
    since = DT * np.arange(60 - 9)
    held = 0.4 + 1.0 - np.exp(-since / lag)
    found = current_of(command, {"coil_lag": {"time_constant": lag, "hold": 1.0}})
    np.testing.assert_allclose(found[:10], 0.4, rtol=2 * EPS)
    np.testing.assert_allclose(found[10:], held[:-1], rtol=0, atol=20 * EPS)
    ramped = 1.4 - lag / DT * -np.expm1(-DT / lag) * np.exp(-since[:-1] / lag)
    found = current_of(command, {"coil_lag": {"time_constant": lag}})
    # the ramp's lag is lag/DT times as large as what is left of it
    np.testing.assert_allclose(found[10:], ramped, rtol=0, atol=20 * EPS * max(1.0, lag / DT))
    # at the sample before, and half there and half as a ramp
    early, mixed = (current_of(command, {"coil_lag": {"time_constant": lag, "hold": x}}) for x in (-1.0, -0.5))
    np.testing.assert_allclose(early[10:], held[1:], rtol=0, atol=20 * EPS)
    np.testing.assert_allclose(mixed[10:], 0.5 * (held[1:] + ramped), rtol=0, atol=20 * EPS * max(1.0, lag / DT))


def test_coil_lag_reaches_field_and_current_alike() -> None:
    """A swept command comes out smaller and late as 1/(1 + i*w*T) says, in both, to the ramp's second order."""
    lag, w, t = 0.02, 2.0 * np.pi * 3.0, DT * np.arange(400)
    command = 0.7 + 0.5 * np.sin(w * t)
    gain = 1.0 / (1.0 + 1j * w * lag)
    want = 0.7 + 0.5 * np.imag(gain * np.exp(1j * w * t))
    for found in (
        current_of(command, {"coil_lag": {"time_constant": lag}}),
        field_of(command, {"coil_lag": {"time_constant": lag}}),
    ):
        np.testing.assert_allclose(found[100:], want[100:], rtol=0, atol=0.5 * (w * DT) ** 2 / 12.0 * 1.5)


def test_command_delay_shifts_the_command() -> None:
    """Whole samples: the command itself, late; parts of one: linear in between; before it, the first command."""
    rng = np.random.default_rng(1)
    command = rng.uniform(0.0, 1.5, 80)
    early = np.concatenate([np.full(9, command[0]), command])
    for samples in (1, 3, 8):
        found = current_of(command, {"command_delay": {"delay": samples * DT}})
        np.testing.assert_allclose(found, early[9 - samples : 9 - samples + 80], rtol=0, atol=20 * EPS)
    want = 0.6 * early[7:87] + 0.4 * early[6:86]
    for found in (
        current_of(command, {"command_delay": {"delay": 2.4 * DT}}),
        field_of(command, {"command_delay": {"delay": 2.4 * DT}}),
    ):
        np.testing.assert_allclose(found, want, rtol=0, atol=50 * EPS)


def test_delayed_command_lags_after_the_delay() -> None:
    """Delay and lag together: the step's exponential begins late."""
    command = np.where(np.arange(60) < 10, 0.0, 1.0)
    late = {"command_delay": {"delay": 3 * DT}, "coil_lag": {"time_constant": 0.02, "hold": 1.0}}
    found, alone = current_of(command, late), current_of(command, {"coil_lag": late["coil_lag"]})
    np.testing.assert_allclose(found[3:], alone[:-3], rtol=0, atol=20 * EPS)


def test_remanence_is_a_play_on_the_current() -> None:
    """Up and down the field stays behind by the half-width, in between it stands; what flows is untouched."""
    width = 0.2
    command = np.concatenate([np.linspace(0.5, 1.5, 51), np.linspace(1.5, 0.1, 71), np.linspace(0.1, 0.8, 36)])
    found = field_of(command, {"remanence": {"half_width": width}})
    np.testing.assert_allclose(found, play(command, width, 0.5), rtol=0, atol=20 * EPS)
    np.testing.assert_allclose(found[[50, 121, 125]], [1.3, 0.3, 0.3], rtol=0, atol=20 * EPS)
    np.testing.assert_allclose(current_of(command, {"remanence": {"half_width": width}}), command, rtol=2 * EPS)
    # wider than every change: the field never moves
    np.testing.assert_allclose(field_of(command, {"remanence": {"half_width": 1.1}}), 0.5, rtol=20 * EPS)


def test_current_saturation_bends_the_field_alone() -> None:
    """tanh(u*I)/u, odd, never above 1/u, equal to I for a small one; what flows is untouched."""
    command, u = np.linspace(-3.0, 3.0, 61), 0.8
    found = field_of(command, {"current_saturation": {"u": u}})
    np.testing.assert_allclose(found, np.tanh(u * command) / u, rtol=0, atol=50 * EPS)
    assert np.abs(found).max() < 1.0 / u
    np.testing.assert_allclose(found, -found[::-1], rtol=0, atol=50 * EPS)
    weak = field_of(command, {"current_saturation": {"u": 1e-3}})
    np.testing.assert_allclose(weak, command, rtol=0, atol=3.0 * (3e-3) ** 2)
    np.testing.assert_allclose(current_of(command, {"current_saturation": {"u": u}}), command, rtol=2 * EPS)


def test_current_gain_multiplies_both_currents() -> None:
    """A gain of 1.2 lets 1.2 times the command flow and magnetise."""
    command = np.linspace(0.0, 1.5, 40)
    effects = {"current_gain": {"gain": 1.2}}
    np.testing.assert_allclose(current_of(command, effects), 1.2 * command, rtol=0, atol=10 * EPS)
    np.testing.assert_allclose(field_of(command, effects), 1.2 * command, rtol=0, atol=50 * EPS)


def test_saturation_acts_on_the_remanent_field_of_the_true_current() -> None:
    """Order of the path: gain, then remanence, then saturation."""
    command = 0.8 + 0.6 * np.sin(0.1 * np.arange(200))
    effects = {"current_saturation": {"u": 0.7}, "remanence": {"half_width": 0.1}, "current_gain": {"gain": 1.5}}
    want = np.tanh(0.7 * play(1.5 * command, 0.1, 1.5 * command[0])) / 0.7
    np.testing.assert_allclose(field_of(command, effects), want, rtol=0, atol=50 * EPS)


# --- from the measured motion to the shaft's ---


def test_velocity_lag_recovers_the_true_motion() -> None:
    """From a velocity that passed a first-order filter come the true velocity and the true way of the hysteresis."""
    lag, shaft = 0.02, Shaft.swinging()
    logged, slope = np.zeros(len(shaft.q)), np.zeros(len(shaft.q))
    for amplitude, f, phase in ((0.3, 0.7, 0.2), (0.12, 1.7, 1.1), (0.05, 3.1, 2.0)):
        w = 2.0 * np.pi * f
        filtered = amplitude * w / (1.0 + 1j * w * lag) * np.exp(1j * (w * shaft.time + phase))
        logged, slope = logged + np.real(filtered), slope + np.real(1j * w * filtered)
    late = along.replace(shaft, qd=logged, qdd=slope)
    effects = {"velocity_lag": {"time_constant": lag}}
    np.testing.assert_allclose(torque(late, {"B": 1.0}, effects), shaft.qd, rtol=0, atol=30 * EPS)
    assert np.abs(late.qd - shaft.qd).max() > 0.2
    loop_alone = {"K0": 1.0, "beta": 16.0, "gamma": -10.0}
    found, want = torque(late, loop_alone, effects), torque(shaft, loop_alone)
    # the cubic between samples takes the filtered velocity's slope: lag*third derivative*dt^2/12 of the way per sample
    np.testing.assert_allclose(found, want, rtol=0, atol=2e-3 * np.abs(want).max())
    assert np.abs(torque(late, loop_alone) - want).max() > 0.2 * np.abs(want).max()


def test_encoder_offset_shifts_the_angle_alone() -> None:
    """The stiffness and the cogging see q - o; velocity and hysteresis do not."""
    shaft = Shaft.swinging(seconds=1.0)
    effects = {"encoder_offset": {"offset": 0.07}}
    np.testing.assert_allclose(torque(shaft, {"C": 2.0}, effects), 2.0 * (shaft.q - 0.07), rtol=0, atol=20 * EPS)
    np.testing.assert_allclose(added(shaft, effects), -0.07 * TRUTH["C"], rtol=0, atol=30 * EPS)
    cogging = {"cogging": {"sine": 0.5, "cosine": 0.0, "periods": 20.0}}
    found = torque(shaft, {}, {**cogging, **effects})
    np.testing.assert_allclose(found, 0.5 * np.sin(20.0 * (shaft.q - 0.07)), rtol=0, atol=20 * 20 * EPS)


def mechanism(shaft: Any, base: dict[str, float], gap: float) -> np.ndarray:
    """Torque of masses, springs and stops: a light shaft between two stiff stops, turned against its own stress."""
    mass, stop, step = 2e-5, 5e3, 1e-5
    rub = 2.0 * np.sqrt(mass * stop)  # critical
    stress, alpha, beta, gamma = (
        base["K0"] + base["K1"] * float(shaft.current[0]),
        base["alpha"],
        base["beta"],
        base["gamma"],
    )
    fine = np.arange(round(shaft.time[-1] / step)) * step
    driven, speeds = np.interp(fine, shaft.time, shaft.q).tolist(), np.interp(fine, shaft.time, shaft.qd).tolist()
    y, v, z, borne = driven[0] - float(np.sign(speeds[0])) * gap, speeds[0], 0.0, []
    for x, speed in zip(driven, speeds, strict=True):
        bent = x - y - min(max(x - y, -gap), gap)
        side = 1.0 if bent > 0.0 else -1.0
        bears = side * max(0.0, side * (stop * bent + rub * (speed - v))) if bent else 0.0
        v += step / mass * (bears - stress * z / (1.0 + alpha * abs(v)) - base["B"] * v)
        y += step * v
        z += step * (v - beta * abs(v) * z - gamma * v * abs(z))
        borne.append(bears)
    return np.interp(shaft.time, fine, borne)


@pytest.mark.parametrize("viscosity", [0.1, 0.5, 1.0])
def test_backlash_is_what_a_shaft_between_stops_does(viscosity: float) -> None:
    """A simulation of a mass, stops and stress says the same: unloading, the open gap without torque, loading."""
    shaft = Shaft.swinging(seconds=1.5, dt=0.001)
    shaft = replace(shaft, current=np.full(len(shaft.q), 0.3))
    base = {"K0": 0.4, "K1": 10.4, "B": viscosity, "alpha": 0.8, "beta": 16.5, "gamma": -10.5}
    want = mechanism(shaft, base, 0.02)
    found = torque(shaft, base, {"backlash": {"half_gap": 0.02}})
    found[:3] = want[:3]  # the stop's first touch
    error = np.sqrt(np.mean((found - want) ** 2)) / np.std(want)
    without = np.sqrt(np.mean((torque(shaft, base) - want) ** 2)) / np.std(want)
    assert np.mean(np.abs(want) < 1e-3 * np.abs(want).max()) > 0.05
    assert error < 0.015 < 0.1 < without


def test_backlash_wider_than_the_motion_bears_nothing() -> None:
    """Once the joint has turned from its farthest angle a wide gap bears nothing; what acts before it stays."""
    shaft, effects = Shaft.swinging(), {"backlash": {"half_gap": 2.0}}
    found = torque(shaft, {"D": 0.2, "K0": 1.0, "beta": 2e3}, effects)
    np.testing.assert_allclose(found[np.argmax(shaft.q) + 2 :], 0.2, rtol=0, atol=EPS)


# --- torques of their own ---


def test_rotor_inertia_is_mass_times_acceleration() -> None:
    """J*qdd, positive where the joint gains speed; none while a backlash is open."""
    shaft = Shaft.swinging(seconds=1.0)
    np.testing.assert_allclose(
        added(shaft, {"rotor_inertia": {"inertia": 0.01}}), 0.01 * shaft.qdd, rtol=0, atol=30 * EPS
    )
    lost = torque(shaft, {"beta": 2e3}, {"rotor_inertia": {"inertia": 0.01}, "backlash": {"half_gap": 2.0}})
    after = np.argmax(shaft.q) + 2
    np.testing.assert_allclose(lost[after:], 0.0, atol=1e-3 * 0.01 * np.abs(shaft.qdd).max())


@pytest.mark.parametrize("down", [0.0, 0.7, -2.0])
def test_gravity_is_a_weight_that_hangs_at_an_angle(down: float) -> None:
    """m*g*l times the sine of the angle from where it hangs, and its work is that of its height."""
    shaft, size = Shaft.swinging(seconds=1.0), 2.0
    weight = {"gravity": {"sine": size * np.cos(down), "cosine": -size * np.sin(down), "periods": 1.0}}
    found = added(shaft, weight)
    np.testing.assert_allclose(found, size * np.sin(shaft.q - down), rtol=0, atol=200 * EPS)
    height = size * (1.0 - np.cos(shaft.q - down))
    work = np.concatenate([[0.0], np.cumsum(0.5 * (found[1:] + found[:-1]) * np.diff(shaft.q))])
    np.testing.assert_allclose(work, height - height[0], rtol=0, atol=size * np.abs(np.diff(shaft.q)).max() ** 2)


@pytest.mark.parametrize("length", [0.01, 0.1])
def test_path_lag_follows_the_current_over_the_way(length: float) -> None:
    """After a step of the current the field nears it as exp(-way/length), however fast; at rest it stays as it is."""
    command, lag = np.where(np.arange(400) < 200, 0.4, 1.4), {"path_lag": {"length": length}}
    for speed in (0.5, 3.0):
        moving = Shaft.steady(command, qd=speed)
        found = torque(moving, FIELD, lag) / torque(replace(moving, current=np.ones(400)), FIELD)
        want = 1.4 - np.exp(-speed * DT * np.arange(1, 201) / length)
        np.testing.assert_allclose(found[200:], want, rtol=0, atol=100 * EPS)
    # the joint stops before the step: its stress stays, and so does the field
    stops = replace(Shaft.steady(command), qd=np.where(np.arange(400) < 150, 1.0, 0.0))
    np.testing.assert_allclose(torque(stops, FIELD, lag)[151:], torque(stops, FIELD, lag)[151], rtol=1e-5)


def test_coulomb_friction_opposes_motion() -> None:
    """With the motion, odd, all of it after a way of 5 ms at its speed, however slow; none before anything moves."""
    for qd, first in ((1.0, 1.0), (-1.0, -1.0), (0.05, np.tanh(1.0)), (0.0, 0.0)):
        found = added(Shaft.steady(np.full(20, 1.0), qd=qd), {"coulomb_friction": {"torque": 0.3, "speed": 0.05}})
        np.testing.assert_allclose(found, 0.3 * np.r_[first, np.full(19, np.sign(qd))], rtol=0, atol=1e-5)
    slow = added(Shaft.steady(np.full(60, 1.0), qd=1e-3), {"coulomb_friction": {"torque": 0.3, "speed": 0.05}})
    np.testing.assert_allclose(slow, 0.3 * np.minimum(np.tanh(0.02) + 0.02 * np.arange(60), 1.0), rtol=0, atol=1e-5)


def test_dry_friction_stays_at_rest_whatever_the_noise() -> None:
    """A joint that stops keeps the friction that it had; a velocity of rounding errors of either sign turns nothing."""
    rest = 1e-6 * np.where(np.arange(200) % 2, 1.0, -1.0)
    shaft = replace(Shaft.steady(np.full(220, 1.0), qd=1.0), qd=np.concatenate([np.full(20, 1.0), rest]))
    found = added(shaft, {"coulomb_friction": {"torque": 0.3, "speed": 0.01}})
    np.testing.assert_allclose(found, 0.3, rtol=0, atol=1e-3)


def test_friction_asymmetry_is_even_in_the_velocity() -> None:
    """Coulomb and viscous part add the same in both directions, and nothing at rest."""
    effects = {"friction_asymmetry": {"coulomb": 0.2, "viscous": 0.03, "speed": 0.05}}
    for qd in (0.02, 0.4, 3.0):
        want = 0.2 * np.tanh(qd / 0.05) + 0.03 * qd
        for sign in (1.0, -1.0):
            found = torque(Shaft.steady(np.full(20, 1.0), qd=sign * qd), {}, effects)
            np.testing.assert_allclose(found, want, rtol=0, atol=10 * EPS)
    assert not torque(Shaft.steady(np.full(20, 1.0), qd=0.0), {}, effects).any()
    one = {"friction_asymmetry": {"coulomb": 0.0, "viscous": 0.03, "speed": 0.05}}
    shaft = Shaft.swinging(seconds=1.0)
    np.testing.assert_allclose(added(shaft, one), 0.03 * np.abs(shaft.qd), rtol=0, atol=30 * EPS)


def test_thinning_bends_viscous_torque_alone() -> None:
    """B*qd of eq. 14 is divided by 1 + c*|qd|; what differs by direction and the rest of eq. 14 stay."""
    bent = {"friction_asymmetry": {"coulomb": 0.0, "viscous": 0.03, "speed": 0.05, "thinning": 0.5}}
    for qd in (-3.0, 0.4):
        shaft = Shaft.steady(np.full(20, 1.0), qd=qd)
        found = torque(shaft, {"B": 0.1, "D": 0.2}, bent)
        want = 0.2 + 0.1 * qd / (1.0 + 0.5 * abs(qd)) + 0.03 * abs(qd)
        np.testing.assert_allclose(found, want, rtol=0, atol=10 * EPS)


def test_stribeck_falls_with_speed() -> None:
    """F*exp(-(qd/v)^2)*s: odd, 1/e at the Stribeck speed, gone at three times it."""
    effects = {"stribeck": {"torque": 0.5, "stribeck_speed": 0.4, "speed": 0.01}}

    def at(qd: float) -> float:
        return float(torque(Shaft.steady(np.full(5, 1.0), qd=qd), {}, effects)[-1])

    assert at(0.4) == pytest.approx(0.5 * np.exp(-1.0), rel=1e-5) == -at(-0.4)
    assert at(1.2) == pytest.approx(0.5 * np.exp(-9.0), rel=1e-4)
    assert at(0.005) == pytest.approx(0.5 * np.exp(-((0.005 / 0.4) ** 2)), rel=1e-5)
    assert at(0.0) == 0.0


def test_cogging_repeats_along_the_angle() -> None:
    """Period 2*pi/N; the cosine at angle 0, the sine a quarter period on; the amplitude is that of both."""
    count, sine, cosine = 24.0, 0.3, -0.4
    effects = {"cogging": {"sine": sine, "cosine": cosine, "periods": count}}
    period = 2.0 * np.pi / count
    shaft = Shaft.steady(np.zeros(4001), dt=period / 1000.0)
    found = torque(shaft, {}, effects)
    atol = count * float(shaft.q[-1]) * 4 * EPS
    assert found[0] == pytest.approx(cosine, abs=atol) and found[250] == pytest.approx(sine, abs=atol)
    np.testing.assert_allclose(found[1000:], found[:-1000], rtol=0, atol=atol)
    assert found.max() == pytest.approx(0.5, abs=1e-5) and found.min() == pytest.approx(-0.5, abs=1e-5)
    swing = Shaft.swinging(seconds=1.0)
    want = sine * np.sin(count * swing.q) + cosine * np.cos(count * swing.q)
    np.testing.assert_allclose(added(swing, effects), want, rtol=0, atol=30 * EPS + atol)


def test_cogging_has_further_harmonics() -> None:
    """Each with its own size and phase; without its number of repetitions it is absent."""
    swing = Shaft.swinging(seconds=1.0)
    more = {"sine": 0.1, "cosine": 0.0, "periods": 24.0, "sine_3": 0.3, "cosine_3": 0.2, "sine_2": 0.7}
    want = 0.1 * np.sin(24.0 * swing.q)
    np.testing.assert_allclose(added(swing, {"cogging": more}), want, rtol=0, atol=100 * EPS)
    want += 0.3 * np.sin(9.0 * swing.q) + 0.2 * np.cos(9.0 * swing.q)
    np.testing.assert_allclose(added(swing, {"cogging": {**more, "periods_3": 9.0}}), want, rtol=0, atol=200 * EPS)


@pytest.mark.parametrize("compliance", [0.002, 0.05, 1.0])
def test_series_compliance_balances_spring_and_device(compliance: float) -> None:
    """A float64 loop that finds each step's way by bisection; the device reaches the same torque later."""
    base = {**TRUTH, "B": 0.0, "alpha": 0.0, "D": 0.0, "C": 0.0, "I1": 0.0}
    shaft, effect = Shaft.swinging(dt=0.0005, seconds=0.7), {"series_compliance": {"compliance": compliance}}
    z, wound, want = 0.0, 0.0, np.zeros(len(shaft.q))
    for k in range(1, len(shaft.q)):
        ratio = compliance * (base["K0"] + base["K1"] * shaft.current[k])
        wound += shaft.q[k] - shaft.q[k - 1]

        def miss(way: float, wound: float = wound, ratio: float = ratio, z: float = z) -> float:
            return wound - way - ratio * float(loop(np.array([0.0, way]), base["beta"], base["gamma"], z)[-1])

        way = brentq(miss, wound - 0.2 * ratio, wound + 0.2 * ratio, xtol=1e-13)
        z = float(loop(np.array([0.0, way]), base["beta"], base["gamma"], z)[-1])
        wound -= way
        want[k] = ratio / compliance * z
    found = torque(shaft, base, effect)
    gain = float((base["K0"] + base["K1"] * shaft.current).max())
    atol = along.turning(shaft, gain, base["beta"], base["gamma"]) + 40 * EPS * np.abs(want).max()
    np.testing.assert_allclose(found, want, rtol=0, atol=atol)
    assert np.abs(found - torque(shaft, base)).max() > 0.005


def test_series_compliance_is_finite_whatever_the_loop() -> None:
    """Loops that harden, soften or hardly bend, behind springs from stiff to slack: a torque within what K*z can be."""
    shaft = Shaft.swinging(seconds=0.5)
    for loading, unloading in ((1e-3, 1e3), (1e3, 1e-3), (1e-3, 1e-3), (1e3, 1e3)):
        base = {"K0": 1.0, "beta": 0.5 * (loading + unloading), "gamma": 0.5 * (loading - unloading)}
        for compliance in (1e-3, 1.0, 1e3):
            found = torque(shaft, base, {"series_compliance": {"compliance": compliance}})
            assert np.isfinite(found).all()
            assert np.abs(found).max() <= 1.01 * min(1.0 / loading, np.ptp(shaft.q), np.ptp(shaft.q) / compliance)


def test_compliance_with_backlash_is_a_dead_zone() -> None:
    """Nothing in the gap, a spring beyond it, about C's rest or about the middle of the run."""
    k, b = 2.0, 0.05
    shaft = Shaft.swinging(seconds=1.0)
    effect = {"compliance_with_backlash": {"stiffness": k, "half_gap": b}}
    e = shaft.q - TRUTH["q_zero"]
    np.testing.assert_allclose(added(shaft, effect), k * (e - np.clip(e, -b, b)), rtol=0, atol=100 * EPS)
    moved = replace(shaft, q=shaft.q + 3.0)
    e = shaft.q - 0.5 * (shaft.q.min() + shaft.q.max())
    effect["compliance_with_backlash"]["own_middle"] = 1.0
    np.testing.assert_allclose(added(moved, effect), k * (e - np.clip(e, -b, b)), rtol=0, atol=300 * EPS)


def test_load_friction_brakes_whatever_the_sign_of_the_load() -> None:
    """F1*|u| against the motion."""
    shaft = Shaft.swinging(seconds=1.0)
    effect = {"load_friction": {"F1": 0.3, "speed": 0.05}}
    want = 0.3 * np.abs(shaft.current) * along.dry(shaft.qd, 0.05)
    for sign in (1.0, -1.0):
        loaded = replace(shaft, current=sign * shaft.current)
        np.testing.assert_allclose(added(loaded, effect), want, rtol=0, atol=100 * EPS)
    effect["load_friction"]["inertia"] = 0.02
    want = 0.3 * np.abs(shaft.current + 0.02 * shaft.qdd) * along.dry(shaft.qd, 0.05)
    np.testing.assert_allclose(added(shaft, effect), want, rtol=0, atol=100 * EPS)


def test_current_viscosity_takes_the_current_that_flows() -> None:
    """B1*I*qd with the current behind its lag and gain, not the field behind saturation."""
    shaft = Shaft.swinging(seconds=1.0)
    effect = {"current_viscosity": {"B1": 0.05}}
    np.testing.assert_allclose(added(shaft, effect), 0.05 * shaft.current * shaft.qd, rtol=0, atol=30 * EPS)
    before = {"coil_lag": {"time_constant": 0.05}, "current_gain": {"gain": 1.2}, "current_saturation": {"u": 1.0}}
    flowing = torque(shaft, CURRENT, before)
    found = torque(shaft, {}, {**before, **effect})
    np.testing.assert_allclose(found, 0.05 * flowing * shaft.qd, rtol=0, atol=30 * EPS)


# --- factors of eq. 14 ---


@pytest.mark.parametrize("power", [0.3, 1.4, 2.0])
def test_speed_weakening_changes_the_power(power: float) -> None:
    """The loop divides by (1 + alpha*|qd|)^p; what is not the loop stays."""
    shaft = Shaft.swinging()
    loop_alone = {key: TRUTH[key] for key in ("K0", "K1", "alpha", "beta", "gamma")}
    weak = 1.0 + TRUTH["alpha"] * np.abs(shaft.qd)
    want = torque(shaft, loop_alone) * weak ** (1.0 - power)
    effects = {"speed_weakening": {"power": power}}
    np.testing.assert_allclose(torque(shaft, loop_alone, effects), want, rtol=0, atol=100 * EPS)
    np.testing.assert_allclose(added(shaft, effects), want - torque(shaft, loop_alone), rtol=0, atol=100 * EPS)


def test_temperature_drift_weakens_with_the_stored_heat() -> None:
    """exp(-a*s) on the loop and exp(-b*s) on the viscous torque, s interpolated over the logarithm of the time."""
    shaft = Shaft.swinging()
    loop_alone = {key: TRUTH[key] for key in ("K0", "K1", "alpha", "beta", "gamma")}
    a, b = 0.05, 0.02
    for time_constant in (HEAT_TIMES[2], HEAT_TIMES[0], float(np.sqrt(HEAT_TIMES[3] * HEAT_TIMES[4])), 100.0):
        heat = np.array([np.interp(np.log(time_constant), np.log(HEAT_TIMES), column) for column in shaft.heat.T])
        effects = {"temperature_drift": {"yield_loss": a, "viscosity_loss": b, "time_constant": time_constant}}
        found = torque(shaft, loop_alone, effects)
        np.testing.assert_allclose(found, torque(shaft, loop_alone) * np.exp(-a * heat), rtol=0, atol=100 * EPS)
        found = torque(shaft, {"B": 0.5, "D": 0.1, "C": 0.3}, effects)
        want = 0.1 + 0.3 * shaft.q + 0.5 * shaft.qd * np.exp(-b * heat)
        np.testing.assert_allclose(found, want, rtol=0, atol=30 * EPS)


def test_temperature_fade_weakens_with_the_logged_temperature() -> None:
    """exp(-a*(T - T0)) on the loop and exp(-b*(T - T0)) on the viscous torque; at T0 nothing changes."""
    shaft, a, b = Shaft.swinging(), 0.02, 0.05
    loop_alone = {key: TRUTH[key] for key in ("K0", "K1", "alpha", "beta", "gamma")}
    effects = {"temperature_fade": {"yield_loss": a, "viscosity_loss": b, "reference": 23.0}}
    rise = shaft.temperature - 23.0
    want = torque(shaft, loop_alone) * np.exp(-a * rise)
    np.testing.assert_allclose(torque(shaft, loop_alone, effects), want, rtol=0, atol=100 * EPS)
    want = 0.1 + 0.5 * shaft.qd * np.exp(-b * rise)
    np.testing.assert_allclose(torque(shaft, {"B": 0.5, "D": 0.1}, effects), want, rtol=0, atol=30 * EPS)


def test_heat_outside_the_prepared_times_is_that_of_the_nearest() -> None:
    """A time constant below or above all that were prepared takes the first or the last."""
    shaft = Shaft.swinging(seconds=1.0)
    for time_constant, row in ((1.0, 0), (1e5, -1)):
        effects = {"temperature_drift": {"yield_loss": 0.0, "viscosity_loss": 0.1, "time_constant": time_constant}}
        want = shaft.qd * np.exp(-0.1 * shaft.heat[row])
        np.testing.assert_allclose(torque(shaft, {"B": 1.0}, effects), want, rtol=0, atol=50 * EPS)


def test_wear_takes_yield_torque_over_the_session() -> None:
    """The loop alone falls in proportion to the time since the session began, or to the way slid."""
    first = Shaft.swinging(seconds=1.0)
    both = Shaft.swinging(seconds=1.0, begin=50.0).after(first)
    loop_alone = {key: TRUTH[key] for key in ("K0", "K1", "alpha", "beta", "gamma")}
    effects = {"wear": {"rate": 0.004}}
    slid = {"wear": {"rate": 0.004, "clock": 1.0}}
    want = torque(both, loop_alone) * (1.0 - 0.004 * both.slid_time)
    np.testing.assert_allclose(torque(both, loop_alone, slid), want, rtol=0, atol=30 * EPS)
    want = torque(both, loop_alone) * (1.0 - 0.004 * both.time)
    np.testing.assert_allclose(torque(both, loop_alone, effects), want, rtol=0, atol=30 * EPS)
    assert both.time[-1] > 50.0
    others = {key: TRUTH[key] for key in ("D", "B", "C", "I1")}
    assert not added(both, effects, others).any()


def test_yield_losses_multiply() -> None:
    """Heat and wear each take their share of what is left."""
    shaft = Shaft.swinging(seconds=1.0, begin=20.0)
    loop_alone = {key: TRUTH[key] for key in ("K0", "K1", "alpha", "beta", "gamma")}
    heat = {"temperature_drift": {"yield_loss": 0.1, "viscosity_loss": 0.0, "time_constant": HEAT_TIMES[1]}}
    worn = {"wear": {"rate": 0.01}}
    whole = torque(shaft, loop_alone)
    product = torque(shaft, loop_alone, heat) * torque(shaft, loop_alone, worn)
    np.testing.assert_allclose(torque(shaft, loop_alone, heat | worn) * whole, product, rtol=0, atol=100 * EPS)


# --- the sensor ---


@pytest.mark.parametrize("lag", [0.0006, 0.004, 0.05])
def test_torque_sensor_lag_is_of_first_order(lag: float) -> None:
    """A torque that ramps between samples comes out as the filter's exact answer, settled at the first sample."""
    command = np.where(np.arange(60) < 10, 0.4, 1.4)
    want = 1.4 - lag / DT * -np.expm1(-DT / lag) * np.exp(-DT * np.arange(50) / lag)
    found = current_of(command, {"torque_sensor_lag": {"time_constant": lag}})
    np.testing.assert_allclose(found[:10], 0.4, rtol=5 * EPS)
    np.testing.assert_allclose(found[10:], want, rtol=0, atol=20 * EPS * max(1.0, lag / DT))


@pytest.mark.parametrize("lag", [0.0006, 0.004, 0.05])
def test_torque_sensor_lag_of_a_torque_that_jumps(lag: float) -> None:
    """A command that holds up to a sample makes the torque jump there; behind a coil's lag it does not jump."""
    command = np.where(np.arange(60) < 10, 0.4, 1.4)
    since = DT * np.arange(50)
    found = current_of(command, {"torque_sensor_lag": {"time_constant": lag, "hold": 1.0}})
    np.testing.assert_allclose(found[10:], 1.4 - np.exp(-since / lag), rtol=0, atol=20 * EPS * max(1.0, lag / DT))
    early = current_of(command, {"torque_sensor_lag": {"time_constant": lag, "hold": -1.0}})
    want = 1.4 - np.exp(-(since + DT) / lag)
    np.testing.assert_allclose(early[10:], want, rtol=0, atol=20 * EPS * max(1.0, lag / DT))
    smooth = {"coil_lag": {"time_constant": 0.02, "hold": 1.0}}
    ramps = current_of(command, smooth | {"torque_sensor_lag": {"time_constant": lag}})
    held = current_of(command, smooth | {"torque_sensor_lag": {"time_constant": lag, "hold": 1.0}})
    np.testing.assert_array_equal(held, ramps)


def test_torque_sensor_lag_takes_the_whole_torque() -> None:
    """Every part of the torque passes the filter: it equals a float64 filter behind the torque without it."""
    lag, shaft = 0.01, Shaft.swinging()
    tau = torque(shaft, TRUTH, {"rotor_inertia": {"inertia": 0.01}})
    keep, want = np.exp(-DT / lag), np.empty(len(tau))
    want[0] = tau[0]
    for k in range(1, len(tau)):
        slope = (tau[k] - tau[k - 1]) / DT
        want[k] = tau[k] - slope * lag + (want[k - 1] - tau[k - 1] + slope * lag) * keep
    found = torque(shaft, TRUTH, {"rotor_inertia": {"inertia": 0.01}, "torque_sensor_lag": {"time_constant": lag}})
    np.testing.assert_allclose(found, want, rtol=0, atol=200 * EPS)


def test_torque_gain_and_bias_make_the_reading() -> None:
    """The reading is g*tau + b, in this order: the bias is not multiplied."""
    shaft = Shaft.swinging(seconds=1.0)
    tau = torque(shaft, TRUTH)
    effects = {"torque_bias": {"bias": 0.2}, "torque_gain": {"gain": 1.1}}
    np.testing.assert_allclose(torque(shaft, TRUTH, effects), 1.1 * tau + 0.2, rtol=0, atol=30 * EPS)


# --- limits ---


@pytest.mark.parametrize(
    ("name", "parameters", "atol"),
    [
        ("coil_lag", {"time_constant": 1e-6}, 1e-3),  # the command moves by up to 1 A within a sample of 5 ms
        ("command_delay", {"delay": 1e-6}, 2e-3),
        ("remanence", {"half_width": 1e-6}, 1e-5),
        ("current_saturation", {"u": 1e-3}, 1e-5),
        ("velocity_lag", {"time_constant": 1e-6}, 1e-3),
        ("backlash", {"half_gap": 1e-6}, 5e-2),  # a contact that changes its side just before a sample
        ("torque_sensor_lag", {"time_constant": 1e-6}, 1e-3),
        ("speed_weakening", {"power": 1.0 + 1e-5}, 1e-4),
    ],
)
def test_weak_effect_is_nearly_none(name: str, parameters: dict[str, float], atol: float) -> None:
    """Towards its null a law that is searched by its logarithm joins the torque without it: there is no jump."""
    shaft = Shaft.swinging()
    np.testing.assert_allclose(added(shaft, {name: parameters}), 0.0, rtol=0, atol=atol)
