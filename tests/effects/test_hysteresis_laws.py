"""Published hysteresis laws through the replay's path: closed forms, independent integration, and passivity."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.confusion import foreign
from mrwarp.effects.catalogue import HYSTERESIS
from mrwarp.enums import HYSTERESIS_LAWS
from tests.effects import along

UNIT = {"K0": 1.0, "beta": 1.0}
"""Base whose torque is the law's h."""
NUMBERS = {
    "kwok": {"slope": 3.0, "width": 0.2},
    "arctangent": {"slope": 3.0, "speed": 0.2},
    "dahl": {"rate": 20.0},
    "lugre": {"rate": 20.0, "damping": 0.01, "stribeck": 0.4, "stribeck_speed": 0.5},
    "bouc_wen_power": {"rate": 20.0, "unloading": 0.2, "sharpness": 1.0},
    "spencer": {"rate": 30.0, "series": 2.0, "inner": 0.1, "spring": 0.5},
    "biviscous": {"speed": 0.4},
}
BENT = {"kwok": {"rounding": 0.3}, "arctangent": {"rounding": 8.0}, "spencer": {"fading": 0.7, "unloading": 0.3}}
"""Numbers that a model may do without."""
CASES = [(name, numbers) for name, numbers in NUMBERS.items()] + [(n, {**NUMBERS[n], **b}) for n, b in BENT.items()]
SHAFT = along.Shaft.swinging(dt=0.001)


def h_of(name: str, numbers: dict[str, float], shaft: along.Shaft = SHAFT) -> np.ndarray:
    """The law's unit hysteresis along a motion."""
    return along.torque(shaft, UNIT, {name: numbers})


def rounded(x: np.ndarray, over: float) -> np.ndarray:
    """The sign, or what turns over in its place."""
    return np.tanh(x / over) if over else np.sign(x)


def integrated(name: str, n: dict[str, float]) -> np.ndarray:
    """The published equations in float64, independent of the kernel."""
    t, over = SHAFT.time, n.get("rounding", 0.0)
    v = lambda time: np.interp(time, t, SHAFT.qd)  # noqa: E731

    def solved(rate, states: int) -> np.ndarray:
        return solve_ivp(rate, (t[0], t[-1]), np.zeros(states), t_eval=t, rtol=1e-6, atol=1e-8, max_step=1e-3).y

    if name == "kwok":
        return np.tanh(n["slope"] * SHAFT.qd + n["width"] * rounded(SHAFT.q, over))
    if name == "arctangent":
        return 2 / np.pi * np.arctan(n["slope"] * (SHAFT.qd - n["speed"] * rounded(SHAFT.qdd, over)))
    if name == "biviscous":
        return np.clip(SHAFT.qd / n["speed"], -1.0, 1.0)
    if name == "dahl":
        return solved(lambda s, z: n["rate"] * (v(s) - abs(v(s)) * z), 1)[0]
    if name == "bouc_wen_power":
        share = 0.5 + n["unloading"]
        return solved(
            lambda s, z: n["rate"] * (v(s) - (share * abs(v(s)) * z + (1 - share) * v(s) * abs(z)) * abs(z)), 1
        )[0]
    if name == "lugre":

        def bend(speed, z):
            g = 1.0 + n["stribeck"] * np.exp(-((speed / n["stribeck_speed"]) ** 2))
            return n["rate"] * (speed - abs(speed) * z / g)

        z = solved(lambda s, z: bend(v(s), z), 1)[0]
        return z + n["damping"] * bend(SHAFT.qd, z)

    share, loading = 1.0 / (1.0 + n.get("fading", 0.0) * SHAFT.current), 0.5 + n.get("unloading", 0.0)

    def flow(speed, f, z, w):
        return (z + f * (n["inner"] * speed + n["spring"] * w)) / (f * (n["series"] + n["inner"]))

    def spencer(s, x):
        r = v(s) - flow(v(s), np.interp(s, t, share), *x)
        return n["rate"] * (r - (loading * abs(r) * x[0] * abs(x[0]) + (1.0 - loading) * r * x[0] ** 2)), r

    return share * n["series"] * flow(SHAFT.qd, share, *solved(spencer, 2))


def test_the_command_line_offers_every_law() -> None:
    """``fit --law`` knows the paper's and those of the library, and nothing else."""
    assert set(HYSTERESIS_LAWS) == {"bouc_wen", *HYSTERESIS} == {"bouc_wen", *NUMBERS}
    assert all(law.source and law.equation for law in HYSTERESIS.values())


@pytest.mark.parametrize(("name", "numbers"), CASES)
def test_a_law_is_its_published_equation(name: str, numbers: dict[str, float]) -> None:
    """But for samples at which a sign changes, the kernel gives what an independent integration gives."""
    error = np.abs(h_of(name, numbers) - integrated(name, numbers))
    assert np.quantile(error, 0.98) < 0.01
    assert np.median(error) < 0.003


@pytest.mark.parametrize(("name", "numbers"), CASES)
def test_a_law_dissipates_over_a_cycle_and_stays_bounded(name: str, numbers: dict[str, float]) -> None:
    """The work of a closed cycle is positive and h stays finite, however coarse the step."""
    t = 0.01 * np.arange(400)
    w = 2.0 * np.pi
    motion = {"q": 0.4 * np.sin(w * t), "qd": 0.4 * w * np.cos(w * t), "qdd": -0.4 * w * w * np.sin(w * t)}
    shaft = replace(along.Shaft.steady(np.zeros(400), dt=0.01), **motion)
    h = h_of(name, numbers, shaft)
    assert np.isfinite(h).all() and np.abs(h).max() < 5.5
    assert float((h[200:] * shaft.qd[200:]).sum()) > 0.0


def test_an_absent_law_leaves_eq_15_bit_for_bit() -> None:
    """A second law's numbers in the row, its first at 0, change nothing."""
    plain = along.torque(SHAFT, along.TRUTH)
    with_numbers = along.torque(SHAFT, along.TRUTH, {"kwok": {"slope": 0.0, "width": 0.3}})
    np.testing.assert_array_equal(plain, with_numbers)


BEHIND = [{"half_gap": 0.01}, {"half_gap": 0.03}, {"compliance": 0.02}, {"half_gap": 0.01, "compliance": 0.02}]
"""Elements before the shaft."""


def elements(before: dict[str, float]) -> dict[str, dict[str, float]]:
    """The effects of what stands before the shaft."""
    effects = {"half_gap": "backlash", "compliance": "series_compliance"}
    return {effects[name]: {name: size} for name, size in before.items()}


def guo_behind(shaft: along.Shaft, **before: float) -> np.ndarray:
    """Guo's device of the benchmark without stiffness, as the kernel has it; nothing before the shaft by default."""
    p = foreign.TYPICAL["guo"]
    base = {"K0": p["yield0"], "K1": p["yield1"], "beta": 1.0, "B": p["c"]}
    law = {"arctangent": {"slope": p["steepness"], "speed": p["speed0"], "rounding": p["rise"]}}
    return along.torque(shaft, base, law | elements(before))


@pytest.mark.parametrize("before", BEHIND, ids=str)
def test_a_law_behind_play_or_a_spring_bears_what_they_bear(before: dict[str, float]) -> None:
    """At 200 Hz within 3 % of the benchmark's integration, which steps ten times as finely and shares no code.

    Without what stands before the shaft the torque is 30 to 60 % off.
    """
    fine = along.Shaft.swinging(dt=0.0005)
    coarse = along.Shaft.swinging(dt=0.005)
    p = foreign.TYPICAL["guo"] | {"k": 0.0}
    q, qd, qdd, current = (x[None] for x in (fine.q, fine.qd, fine.qdd, fine.current))
    want = foreign.behind("guo", p, q, qd, qdd, current, fine.dt, **before)[0, ::10][100:]

    def off(shaft: along.Shaft, **before: float) -> float:
        return float(np.sqrt(np.mean((guo_behind(shaft, **before)[100:] - want) ** 2)) / want.std())

    assert off(coarse, **before) < 0.03
    assert off(coarse) > 0.25


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("before", BEHIND, ids=str)
def test_every_law_dissipates_behind_play_and_springs(name: str, before: dict[str, float]) -> None:
    """Over the motion the joint does work, and nothing grows: the largest torque is not above that of the law alone."""
    shaft = replace(SHAFT, current=np.full(len(SHAFT.q), 0.7))
    law = {name: NUMBERS[name]}
    plain, behind = along.torque(shaft, UNIT, law), along.torque(shaft, UNIT, law | elements(before))
    assert np.isfinite(behind).all()
    assert float((behind * shaft.qd).sum()) > 0.0
    assert np.abs(behind).max() < 1.1 * np.abs(plain).max()
    assert np.abs(behind - plain).max() > 0.05
