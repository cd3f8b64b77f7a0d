"""A model as a vector: there and back, bounds, growth; its derivatives against float64 differences."""

from dataclasses import replace

import numpy as np
import pytest

from mrwarp.effects.catalogue import CATALOGUE, KNOWN, column_of
from mrwarp.effects.replay_kernel import BASE, LAWS
from mrwarp.identify.dataset import Motion
from mrwarp.identify.parameters import (
    BASE_PART,
    EFFECT_PART,
    LINEAR,
    Parameters,
    jacobian,
    simulate,
    slots_of,
    without_hysteresis,
)
from mrwarp.identify.replay import EffectReplay
from tests.diagnose import known
from tests.effects.strengths import STRENGTHS

STRONG = {name: STRENGTHS[name] for name, law in CATALOGUE.items() if law.kind != "calibration"}
"""A visible strength of every effect that is searched."""


@pytest.fixture(scope="module")
def motion() -> Motion:
    """Three runs of the joint, which warms up by 6 K."""
    at = known.motion(3, runs=3, seconds=2.0)
    return replace(at, temperature=20.0 + at.time, ranges=replace(at.ranges, temperature=23.0))


CHOSEN = (
    ("coil_lag", "hold"),
    ("torque_sensor_lag", "hold"),
    ("wear", "clock"),
    ("compliance_with_backlash", "own_middle"),
)
"""Parameters of the logging."""


@pytest.mark.parametrize("effect", list(CATALOGUE))
def test_row_holds_the_numbers_of_the_vector(effect: str, motion: Motion) -> None:
    """Base, effect, presets and choices stand in their columns; all other effects are at null."""
    c = Parameters((effect,), motion.ranges, 0.2, {key: 1.0 for key in CHOSEN})
    values = STRONG.get(effect, {p.name: 1.1 for p in CATALOGUE[effect].parameters})
    row = c.row(known.vector(c, {effect: values}))
    assert row[: len(LAWS) + 1] == pytest.approx([*(known.TRUTH[name] for name in LAWS), 0.2])
    plain = Parameters((), motion.ranges, 0.2)
    others = plain.row(known.vector(plain))
    mine = set()
    for p in CATALOGUE[effect].parameters:
        at = len(BASE) + column_of(effect, p.name)
        mine.add(at)
        want = p.preset(motion.ranges) if p.preset else 1.0 if p.choices else p.null if p.form else values[p.name]
        assert row[at] == pytest.approx(want)
        if p.form:
            assert p.name not in c.values(known.vector(c, {effect: values}))[effect]
        elif not p.choices:
            assert c.values(known.vector(c, {effect: values}))[effect][p.name] == pytest.approx(want)
    rest = [at for at in range(len(BASE), len(row)) if at not in mine]
    assert np.array_equal(row[rest], others[rest])


@pytest.mark.parametrize("effect", list(CATALOGUE))
def test_null_and_starts_lie_within_the_bounds(effect: str, motion: Motion) -> None:
    """Each searched number has finite steps and starts inside its bounds."""
    c = Parameters((effect,), motion.ranges, 0.0)
    assert c.size == BASE_PART.stop + len(slots_of(effect)) and (c.low < c.high).all() and (c.steps > 0.0).all()
    for slot, low, high in zip(c.slots, c.low[EFFECT_PART], c.high[EFFECT_PART], strict=True):
        assert low <= slot.neutral(motion.ranges) <= high
        starts = slot.parameter.starts
        for start in starts(motion.ranges) if starts else ():
            assert low <= (np.log(start) if slot.logarithmic else start) <= high


def test_bent_model_has_its_effects_bends(motion: Motion) -> None:
    """At first the same row; its new numbers are searched within their bounds and stand among the values."""
    c = Parameters(("friction_asymmetry", "wear"), motion.ranges, 0.0)
    x, bent = known.vector(c, STRONG), c.bent()
    y = c.moved(x, bent)
    assert bent.size == c.size + 2 and np.array_equal(c.row(x), bent.row(y))
    at, other = (i for i, slot in bent.items() if slot.parameter.form)
    assert y[other] == 0.0 and bent.low[other] < 0.0 < bent.high[other]
    assert y[at] == bent.low[at] == 0.0 < bent.high[at] and bent.reported().low[at] == 0.0
    y[at] = 0.2
    assert bent.values(y)["friction_asymmetry"]["thinning"] == pytest.approx(0.2)


@pytest.mark.parametrize(("inertia", "carried"), [(True, True), (False, True), (True, False)])
def test_inertia_behind_a_gear_needs_an_inertia_and_a_load(motion: Motion, inertia: bool, carried: bool) -> None:
    """It is searched with both only, and a known one acts without."""
    effects = ("rotor_inertia", "load_friction") if inertia else ("load_friction",)
    key = ("load_friction", "inertia")
    bent = Parameters(effects, replace(motion.ranges, carried=carried), 0.0).bent()
    searched = [slot.key for slot in bent.slots if slot.parameter.form]
    assert searched == ([key] if inertia and carried else [])
    known_bend = replace(bent, choices={key: 0.3})
    x = known.vector(known_bend, {"rotor_inertia": {}, "load_friction": {"inertia": 0.3}})
    assert known_bend.row(x)[len(BASE) + column_of(*key)] == known_bend.values(x)[key[0]][key[1]] == 0.3


def test_known_bend_acts_without_being_searched(motion: Motion) -> None:
    """It stands in the row and among the values; where bends are searched, it is where the search begins."""
    key = ("friction_asymmetry", "thinning")
    c = Parameters(("friction_asymmetry",), motion.ranges, 0.0, {key: 0.3})
    x, at = known.vector(c, STRONG), len(BASE) + column_of(*key)
    assert c.size == 11 and c.row(x)[at] == 0.3 == c.values(x)["friction_asymmetry"]["thinning"]
    y = c.moved(x, c.bent())
    assert np.array_equal(c.row(x), c.bent().row(y))
    y[next(i for i, slot in c.bent().items() if slot.parameter.name == key[1])] = 0.1
    assert c.bent().row(y)[at] == 0.1
    more = Parameters(("friction_asymmetry", "wear"), motion.ranges, 0.0, c.choices)
    assert more.row(c.grown(x, more.effects))[at] == 0.3


def test_grown_model_is_the_same_model(motion: Motion) -> None:
    """A vector keeps its numbers when effects are added, wherever they go in the order; linear ones come in at null."""
    c = Parameters(("coil_lag", "cogging"), motion.ranges, 0.0)
    x = known.vector(c, STRONG)
    more = Parameters(("coil_lag", "rotor_inertia", "coulomb_friction", "cogging", "wear"), motion.ranges, 0.0)
    y = c.grown(x, more.effects)
    assert y[:9].tolist() == x[:9].tolist()
    assert more.values(y)["cogging"] == c.values(x)["cogging"]
    replay = EffectReplay(motion)
    one, other = simulate(replay, [(c, x), (more, y)])
    assert np.array_equal(one, other)


def torque64(p: dict[str, float], m: Motion) -> np.ndarray:
    """Eqs. 14 and 15 in float64, along the way of the cubic between samples, over the exact step."""
    s, out = m, np.empty(len(m.q))
    for part, dt in zip(s.parts, s.dt, strict=True):
        z = 0.0
        for k in range(part.start, part.stop):
            if k > part.start:
                before, after = s.qd[k - 1], s.qd[k]
                ways = [dt * (0.5 * (before + after) + dt / 12.0 * (m.qdd[k - 1] - m.qdd[k]))]
                if before * after < 0.0:
                    turn = dt * before / (before - after)
                    ways = [0.5 * before * turn, 0.5 * after * (dt - turn)]
                for way in ways:
                    z = _along(z, way, p["beta"], p["gamma"])
            gain = (p["K0"] + p["K1"] * s.current[k]) / (1.0 + p["alpha"] * abs(s.qd[k]))
            out[k] = p["D"] + p["B"] * s.qd[k] + p["C"] * s.q[k] + p["I1"] * s.current[k] + gain * z
    return out


def _along(z: float, way: float, beta: float, gamma: float) -> float:
    u, left = np.sign(way) * z, abs(way)
    if u < 0.0:
        rate = beta - gamma
        to_zero = np.log1p(-rate * u) / rate
        u = (1.0 - (1.0 - rate * u) * np.exp(-rate * min(left, to_zero))) / rate
        left = max(0.0, left - to_zero)
    rate = beta + gamma
    return (
        float(np.sign(way) * (1.0 - (1.0 - rate * u) * np.exp(-rate * left)) / rate) if left > 0.0 else np.sign(way) * u
    )


def test_jacobian_of_the_base_is_that_of_the_equations(motion: Motion) -> None:
    """All nine columns against central differences of a float64 replay, to 0.5 % of each column's size."""
    c = Parameters((), motion.ranges, 0.0)
    x = known.vector(c)
    tau, slopes = jacobian(EffectReplay(motion), c, x)

    def model(y: np.ndarray) -> np.ndarray:
        row = c.row(y)
        return torque64(dict(zip(BASE, row, strict=False)), motion)

    np.testing.assert_allclose(tau, model(x), rtol=0, atol=2e-5)
    for i in range(9):
        h = 1e-4
        up, down = x.copy(), x.copy()
        up[i], down[i] = up[i] + h, down[i] - h
        want = (model(up) - model(down)) / (2.0 * h)
        size = np.sqrt(np.mean(want**2))
        assert size > 0.0 and np.sqrt(np.mean((slopes[i] - want) ** 2)) < 5e-3 * size, BASE[i]


def test_linear_columns_are_their_signals(motion: Motion) -> None:
    """dtau/dD = 1, dtau/dB = qd, dtau/dC = q - zero, dtau/dI1 = I, and K0, K1 share the loop."""
    c = Parameters((), motion.ranges, 0.3)
    _, slopes = jacobian(EffectReplay(motion), c, known.vector(c))
    s, atol = motion, 2e-5
    for column, want in zip(slopes, (np.ones(len(s.q)), s.qd, s.q - 0.3, s.current), strict=False):
        np.testing.assert_allclose(column, want, rtol=0, atol=atol * np.abs(want).max())
    np.testing.assert_allclose(slopes[5], s.current * slopes[4], rtol=0, atol=3e-5)
    assert LINEAR == ("D", "B", "C", "I1", "K0", "K1")


@pytest.mark.parametrize("effect", list(STRONG))
def test_jacobian_of_an_effect_converges(effect: str, motion: Motion) -> None:
    """The effect's columns agree with one-sided differences over a fifth of the step, and they are not zero."""
    c = Parameters((effect,), motion.ranges, 0.0)
    x, replay = known.vector(c, STRONG), EffectReplay(motion)
    tau, slopes = jacobian(replay, c, x)
    for i in range(9, c.size):
        h = c.steps[i] * (0.5 if effect in ("backlash", "remanence") else 0.2)
        up, down = x.copy(), x.copy()
        up[i], down[i] = up[i] + h, down[i] - h
        high, low = simulate(replay, [(c, up), (c, down)]).astype(float)
        want = (high - low) / (2.0 * h)
        size = np.sqrt(np.mean(want**2))
        assert size * c.steps[i] > 1e-6 * np.abs(tau).max()
        # rounding of float32 over the step; a play turns on and off at samples
        loose = {"backlash": 0.6, "remanence": 0.2, "command_delay": 0.2}.get(effect, 0.02)
        rounding = 2e-7 * np.abs(tau).max() / h
        assert np.sqrt(np.mean((slopes[i] - want) ** 2)) < loose * size + rounding, dict(c.items())[i]


def test_columns_beside_a_backlash_make_up_the_torque(motion: Motion) -> None:
    """Euler's theorem: the released shaft moves by B/K, so the torque is the sum of its columns times their numbers."""
    c = Parameters(("backlash",), motion.ranges, 0.0)
    x = known.vector(c, STRONG)
    tau, slopes = jacobian(EffectReplay(motion), c, x)
    np.testing.assert_allclose(x[:6] @ slopes[:6], tau, rtol=0, atol=2e-3 * np.abs(tau).max())


@pytest.mark.parametrize("name", [name for name, law in KNOWN.items() if law.adds])
def test_what_only_adds_does_so_without_the_hysteresis(motion: Motion, name: str) -> None:
    """With a law it adds, by itself and in its derivatives, what it adds without it."""
    effects = ("spencer", "temperature_drift", "torque_sensor_lag", name)
    c = Parameters(tuple(known_name for known_name in KNOWN if known_name in effects), motion.ranges, 0.0)
    x = known.vector(c, {**STRONG, "spencer": {"rate": 20.0, "series": 5.0, "inner": 0.1, "spring": 0.5}})
    less, y = without_hysteresis(c, x)
    own = c.own(name)
    bare = x.copy()
    bare[own] = [slot.neutral(c.ranges) for i, slot in c.items() if i in own]
    replay = EffectReplay(motion)
    full, plain, added, nothing = simulate(replay, [(c, x), (c, bare), (less, y), without_hysteresis(c, bare)])
    assert less.effects == tuple(effect for effect in c.effects if effect != "spencer")
    assert np.abs(added - nothing).max() > 0.01
    absent = x.copy()
    absent[[i for i, slot in c.items() if i in own and slot.linear]] = 0.0
    assert np.array_equal(simulate(replay, [(c, absent)])[0], plain)
    np.testing.assert_allclose(full - plain, added - nothing, rtol=0, atol=2e-5 * np.abs(full).max())
    slopes = jacobian(replay, c, x)[1]
    for i in (LINEAR.index("B"), LINEAR.index("C"), *own):
        step = np.where(np.arange(c.size) == i, c.steps, 0.0)
        up, down = simulate(replay, [(c, x + step), (c, x - step)])
        want = (up - down) / (2.0 * c.steps[i])
        np.testing.assert_allclose(slopes[i], want, rtol=0, atol=2e-5 * np.abs(full).max() / c.steps[i])
