"""The path without effects is eqs. 14 and 15; at null each effect is absent; units, batch and trajectories."""

import numpy as np
import pytest

from mrwarp.effects.catalogue import CATALOGUE, parameter_of
from mrwarp.effects.law import Ranges
from mrwarp.identify.dataset import DIMENSIONS
from tests.effects import along
from tests.effects.strengths import STRENGTHS

Shaft, TRUTH, EPS, torque, torques = along.Shaft, along.TRUTH, along.EPS, along.torque, along.torques


def test_without_effects_the_torque_is_eqs_14_and_15() -> None:
    """Along a fine motion the kernel equals a float64 loop over the way; only the way between samples differs."""
    shaft = Shaft.swinging(dt=0.0005)
    z = along.loop(shaft.q, TRUTH["beta"], TRUTH["gamma"])
    gain = (TRUTH["K0"] + TRUTH["K1"] * shaft.current) / (1.0 + TRUTH["alpha"] * np.abs(shaft.qd))
    want = TRUTH["D"] + TRUTH["B"] * shaft.qd + TRUTH["C"] * (shaft.q - TRUTH["q_zero"])
    want += TRUTH["I1"] * shaft.current + gain * z
    assert np.abs(want).max() > 1.0
    atol = along.turning(shaft, gain.max(), TRUTH["beta"], TRUTH["gamma"]) + 40 * EPS * np.abs(want).max()
    np.testing.assert_allclose(torque(shaft, TRUTH), want, rtol=0, atol=atol)


def test_way_between_samples_is_of_second_order() -> None:
    """z of a logged sine errs by a power of the sampling step of at least 2, reversals included."""
    errors, steps = [], (0.008, 0.004, 0.002)
    for dt in steps:
        shaft, fine = Shaft.swinging(dt=dt), Shaft.swinging(dt=dt / 16)
        want = along.loop(fine.q, TRUTH["beta"], TRUTH["gamma"])[::16]
        found = torque(shaft, {"K0": 1.0, "beta": TRUTH["beta"], "gamma": TRUTH["gamma"]})
        errors.append(np.sqrt(np.mean((found - want[: len(found)]) ** 2)))
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] > 2.0
    assert errors[0] < 1e-4


@pytest.mark.parametrize("name", list(CATALOGUE))
def test_effect_at_null_leaves_every_bit(name: str) -> None:
    """With what makes an effect at null, for any other numbers, the torque is that without it, bit for bit."""
    shaft = Shaft.swinging()
    shaping = (
        {"speed", "stribeck_speed", "periods", "time_constant"}
        if name in ("coulomb_friction", "friction_asymmetry", "stribeck", "cogging", "gravity", "temperature_drift")
        else {"hold"}
    )
    null = {
        p.name: STRENGTHS[name].get(p.name, 1.0) if p.name in shaping else p.null for p in CATALOGUE[name].parameters
    }
    plain, absent, acting = torques(shaft, TRUTH, [{}, {name: null}, {name: STRENGTHS[name]}])
    assert np.array_equal(plain, absent)
    assert np.abs(acting - plain).max() > 0.01


@pytest.mark.parametrize("names", [[name] for name in CATALOGUE] + [list(CATALOGUE)], ids="+".join)
def test_units_of_the_parameters_are_those_of_the_law(names: list[str]) -> None:
    """In other units of angle, current and torque, with numbers converted by ``scale``, the same torque comes out."""
    shaft, effects = Shaft.swinging(), {name: STRENGTHS[name] for name in names}
    q, current, size = 4.0, 0.5, 8.0  # what an old unit is in new ones: powers of two, so that rounding is the same
    moved = {name: q * getattr(shaft, name) for name in ("q", "qd", "qdd")}
    other = along.replace(shaft, **moved, current=current * shaft.current, heat=size * q * shaft.heat)

    def factor(powers: tuple[int, int, int]) -> float:
        return q ** powers[0] * current ** powers[1] * size ** powers[2]

    base = {name: value * factor(DIMENSIONS.get(name, (1, 0, 0))) for name, value in TRUTH.items()}
    converted = {
        name: {key: value * factor(parameter_of(name, key).scale) for key, value in parameters.items()}
        for name, parameters in effects.items()
    }
    want = size * torque(shaft, TRUTH, effects)
    found = torque(other, base, converted)
    np.testing.assert_allclose(found, want, rtol=0, atol=20 * EPS * np.abs(want).max())


@pytest.mark.parametrize("name", list(CATALOGUE))
def test_ranges_have_the_units_of_the_parameters(name: str) -> None:
    """Bounds, starts and presets are converted as the parameter is."""
    here = Ranges(q=1.3, qd=6.0, current=1.4, torque=0.8)
    there = Ranges(q=4.0 * 1.3, qd=4.0 * 6.0, current=0.5 * 1.4, torque=8.0 * 0.8, radian=4.0)
    for p in CATALOGUE[name].parameters:
        factor = 4.0 ** p.scale[0] * 0.5 ** p.scale[1] * 8.0 ** p.scale[2]
        assert p.low(there) == pytest.approx(factor * p.low(here))
        assert p.high(there) == pytest.approx(factor * p.high(here))
        if p.starts is not None:
            assert p.starts(there) == pytest.approx([factor * x for x in p.starts(here)])
        if p.preset is not None:
            assert p.preset(there) == pytest.approx(factor * p.preset(here))


def test_row_of_a_batch_is_the_row_alone() -> None:
    """Twenty effects, all together and none side by side equal each alone, bit for bit."""
    shaft = Shaft.swinging(seconds=2.0)
    candidates = [{}, *({name: STRENGTHS[name]} for name in CATALOGUE), STRENGTHS]
    together = torques(shaft, TRUTH, candidates)
    assert np.isfinite(together).all()
    for k, effects in enumerate(candidates):
        assert np.array_equal(together[k], torques(shaft, TRUTH, [effects])[0])


def test_trajectory_remembers_nothing_of_the_one_before() -> None:
    """With all effects the second of two trajectories is that trajectory alone, bit for bit."""
    first, second = Shaft.swinging(seconds=1.5), Shaft.swinging(seconds=1.0, begin=1.7)
    both = torques(second.after(first), TRUTH, [STRENGTHS])[0]
    assert np.array_equal(both[: len(first.q)], torques(first, TRUTH, [STRENGTHS])[0])
    assert np.array_equal(both[len(first.q) :], torques(second, TRUTH, [STRENGTHS])[0])
