"""Fitting: known parameters of data made by the kernel itself come back, first looks point at what was hidden."""

from dataclasses import replace

import numpy as np
import pytest

from mrwarp.diagnose.pipeline import diagnose
from mrwarp.diagnose.problem import Problem, covariance, fit_model, interval, plain_fit, reported_fit
from mrwarp.diagnose.screening import Models, screen
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.dataset import Motion
from mrwarp.identify.replay import EffectReplay
from tests.diagnose import known

CANDIDATES = [name for name, law in CATALOGUE.items() if law.kind != "calibration" and name != "velocity_lag"]
HIDDEN = {
    "command_delay": {"delay": 0.012},
    "coil_lag": {"time_constant": 0.01},
    "remanence": {"half_width": 0.04},
    "current_saturation": {"u": 0.3},
    "backlash": {"half_gap": 0.003},
    "rotor_inertia": {"inertia": 0.002},
    "coulomb_friction": {"torque": 0.06},
    "friction_asymmetry": {"coulomb": 0.05, "viscous": 0.01},
    "stribeck": {"torque": 0.08, "stribeck_speed": 0.5},
    "cogging": {"sine": 0.03, "cosine": -0.02, "periods": 31.0},
    "current_viscosity": {"B1": 0.02},
    "speed_weakening": {"power": 1.3},
    "temperature_drift": {"yield_loss": 0.02, "viscosity_loss": 0.01, "time_constant": 60.0},
    "wear": {"rate": 0.004},
    "torque_sensor_lag": {"time_constant": 0.003},
}


def assert_recovers(fit, truth: np.ndarray, sigmas: float = 4.0) -> None:
    """Every coordinate within some standard errors of the truth."""
    error = np.sqrt(np.diag(covariance(fit)))
    assert (np.abs(fit.x - truth) < sigmas * error).all(), (fit.x - truth) / error


def test_fit_recovers_the_joint_from_far_off() -> None:
    """From numbers 30 % off, loss and coordinates are those of the truth: chi-squared, within four errors."""
    problem = known.problem()
    fit = known.fitted(problem, off=0.3)
    assert_recovers(fit, known.vector(problem.parameters(())))
    count = fit.equations.count
    assert fit.loss.sum() == pytest.approx(count, abs=4.0 * np.sqrt(2.0 * count))
    assert 0.0 < fit.loo_loss.sum() - fit.loss.sum() < 60.0  # twice nine coordinates, and their scatter


def test_fit_without_noise_is_exact() -> None:
    """Noise-free data give the numbers back to the rounding of float32."""
    problem = known.problem(sigma=0.0)
    fit = known.fitted(problem, off=0.1)
    np.testing.assert_allclose(fit.x, known.vector(fit.parameters), rtol=2e-3, atol=2e-4)
    assert np.abs(problem.motion.torque - fit.torque).max() < 1e-4


@pytest.mark.parametrize("effect", list(HIDDEN))
def test_fit_recovers_an_effect_with_the_joint(effect: str) -> None:
    """Effect and joint searched together from numbers 20 % off; the loss is that of the noise."""
    problem = known.problem({effect: HIDDEN[effect]}, seed=2)
    c = problem.parameters((effect,))
    truth = known.vector(c, {effect: HIDDEN[effect]})
    start = truth.copy()
    start[:6] *= 1.2
    for i, slot in c.items():
        if slot.parameter.name != "periods":  # found by its starts
            start[i] = start[i] + 0.2 if slot.logarithmic else 0.8 * start[i]
    fit = fit_model(problem, c, start, iterations=25)
    assert_recovers(fit, truth, 5.0 if effect in ("backlash", "remanence") else 4.0)
    assert fit.loss.sum() == pytest.approx(fit.equations.count, abs=4.0 * np.sqrt(2.0 * fit.equations.count))


@pytest.mark.usefixtures("few_trees")
def test_a_logged_temperature_is_what_the_device_fades_with() -> None:
    """The fade per kelvin comes back, at the mean of the log; without a log that changes there is no such effect."""
    at, effect = known.motion(3, seconds=2.0), "temperature_fade"
    runs = np.searchsorted(at.start, np.arange(len(at.q)), side="right")
    temperature = 22.0 + 4.0 * np.random.default_rng(3).permutation(len(at.dt) + 1)[runs]  # of a room, in no order
    logged = known.recording(at, at.torque)
    warm = [replace(r, temperature=temperature[p]) for r, p in zip(logged.trajectories, at.parts, strict=True)]
    read = Motion.of(replace(logged, trajectories=tuple(warm)))
    assert read.temperature is not None and np.array_equal(read.temperature, temperature)
    assert read.ranges.temperature == pytest.approx(temperature.mean()) and Motion.of(logged).temperature is None
    ranges = replace(at.ranges, temperature=float(temperature.mean()))
    hidden = {effect: {"yield_loss": 0.006, "viscosity_loss": 0.012}}
    problem = known.problem(hidden, at=replace(at, temperature=temperature, ranges=ranges))
    assert effect not in problem.impossible and effect in known.problem().impossible
    fit = known.fitted(problem, {effect: {"yield_loss": 0.001, "viscosity_loss": 0.001}})
    assert_recovers(fit, known.vector(fit.parameters, hidden))
    assert fit.parameters.values(fit.x)[effect]["reference"] == pytest.approx(temperature.mean())
    torque = problem.motion.torque
    runs = [replace(r, torque=torque[p]) for r, p in zip(warm, at.parts, strict=True)]
    found = diagnose(replace(logged, trajectories=tuple(runs)), settings=known.QUICK)
    assert [cause.name for cause in found.causes] == [effect] and not found.causes[0].alternatives


def test_a_brake_stiffer_than_data_show_is_found_behind_play_and_a_spring() -> None:
    """Dry friction behind play and a spring, by its balance alone; a fit that begins with a soft loop finds both.

    K and beta then have to grow a hundredfold together, with the torque at which the brake slides unchanged.
    """
    at = known.motion(50, runs=6, seconds=2.0, dt=0.002)
    gap, compliance, slips = 0.003, 1.0 / 600.0, 0.15 + 2.5 * at.current
    torque = np.zeros(len(at.q))
    for part in at.parts:
        shaft = at.q[part.start] - gap * np.sign(at.qd[part.start])  # the motion closes the play
        for k in range(part.start, part.stop):
            reach = gap + compliance * slips[k]
            shaft = min(max(shaft, at.q[k] - reach), at.q[k] + reach)
            stretch = at.q[k] - shaft
            torque[k] = (stretch - min(max(stretch, -gap), gap)) / compliance
    torque += 0.02 * np.random.default_rng(50).normal(size=len(torque))
    problem = known.posed(replace(at, torque=torque), sigma=0.02)
    layout = problem.parameters(("backlash", "series_compliance"))
    numbers = {"backlash": {"half_gap": 0.7 * gap}, "series_compliance": {"compliance": 0.7 * compliance}}
    soft = {"D": 0.0, "B": 0.1, "C": 0.0, "I1": 0.0, "K0": 15.0, "K1": 250.0, "alpha": 0.1, "beta": 100.0, "gamma": 0.0}
    fit = fit_model(problem, layout, known.vector(layout, numbers, **soft))
    found = fit.parameters.values(fit.x)
    assert found["backlash"]["half_gap"] == pytest.approx(gap, rel=0.07)
    assert found["series_compliance"]["compliance"] == pytest.approx(compliance, rel=0.07)
    assert np.std(torque - fit.torque) < 0.05 * np.std(torque)
    # the reported fit goes on to as stiff a brake as the data bear: the spring has all of the give then
    stated = plain_fit(problem, fit)
    found = stated.parameters.values(stated.x)
    assert found["backlash"]["half_gap"] == pytest.approx(gap, rel=0.015)
    assert found["series_compliance"]["compliance"] == pytest.approx(compliance, rel=0.025)


@pytest.mark.parametrize(
    "effect",
    [
        pytest.param(name, marks=[] if name in ("coil_lag", "backlash", "cogging", "wear") else [pytest.mark.slow])
        for name in HIDDEN
    ],
)
def test_first_look_finds_what_was_hidden(effect: str) -> None:
    """On top of the fitted joint the hidden effect promises the most, or nearly, and its gain is most of what is."""
    problem = known.problem({effect: HIDDEN[effect]}, seed=3, at=known.motion(3, runs=6, seconds=3.0))
    base = known.fitted(problem)
    look = screen(problem, base, CANDIDATES)
    assert {c.effect for c in look} == set(CANDIDATES)
    gains = {c.effect: float(base.loo_loss.sum() - c.loo_loss.sum()) for c in look}
    possible = float(base.loo_loss.sum()) - base.equations.count
    assert possible > 100.0, "the hidden effect is too weak to test anything"
    assert gains[effect] > 0.8 * possible
    assert gains[effect] > max(gains.values()) - 0.1 * possible


@pytest.mark.parametrize("half_gap", [None, 0.06])
def test_first_look_at_a_spring_takes_the_device_for_stiffer(half_gap: float | None) -> None:
    """A baseline has a softer loop in the spring's place; the look promises what the fit then gives."""
    hidden = {"series_compliance": {"compliance": 0.2}} | ({"backlash": {"half_gap": half_gap}} if half_gap else {})
    problem = known.problem(hidden, seed=3, sigma=0.01, at=known.motion(3, runs=6, seconds=3.0))
    base = known.fitted(problem)
    (look,) = screen(problem, base, ["series_compliance"])
    fit = Models(problem, base).grown(base, look)
    assert base.total - look.total > 0.8 * (base.total - fit.total) > 0.3 * base.total
    assert look.stiffer > 1.0


def test_first_look_at_clean_data_promises_little() -> None:
    """Without a hidden effect no candidate gains more than noise does: 30 in units of its variance."""
    problem = known.problem(seed=4, at=known.motion(4, runs=6, seconds=3.0))
    base = known.fitted(problem)
    look = screen(problem, base, CANDIDATES)
    assert max(float(base.loo_loss.sum() - c.loo_loss.sum()) for c in look) < 30.0


def test_fit_keeps_its_bounds() -> None:
    """A joint with a negative viscosity is fitted by none, and nothing leaves its range."""
    problem = known.problem(B=-0.05)
    fit = known.fitted(problem)
    assert fit.x[1] == 0.0
    assert (fit.x >= fit.parameters.low).all() and (fit.x <= fit.parameters.high).all()


def test_stated_numbers_may_be_nearly_dry_friction() -> None:
    """A hysteresis that is over after 0.05 mrad is steeper than the search allows; plain numbers come near it."""
    steep = {"beta": 2e4, "gamma": 0.0, "K0": 2e4}
    problem = known.problem(sigma=0.002, at=known.motion(dt=5e-4), **steep)
    c = problem.parameters(())
    searched = fit_model(problem, c, known.vector(c, **steep))
    assert searched.x[7] == searched.parameters.high[7] < np.log(2e4)
    stated = plain_fit(problem, searched)
    assert stated.x[7] > searched.x[7] + 0.5
    measured = problem.motion.torque
    assert np.square(measured - stated.torque).sum() < 0.9 * np.square(measured - searched.torque).sum()


def _stepped(seed: int, lag: float, dt: float, age: float | None) -> Problem:
    """A lag in a log of steps: each came ``age`` of an interval before the sample that shows it; None: at any time."""
    at, rng = known.motion(seed, runs=6, seconds=2.0, dt=dt), np.random.default_rng([seed, 3])
    field = at.current.copy()
    for part in at.parts:
        for k in range(part.start + 1, part.stop):
            before, after = at.current[k - 1 : k + 1]
            since = dt * (rng.uniform() if age is None else age)
            flows = before + (field[k - 1] - before) * np.exp(-(dt - since) / lag)
            field[k] = after + (flows - after) * np.exp(-since / lag)
    plain = known.posed(at).parameters(())
    true = EffectReplay(replace(at, current=field))
    torque = true.torque(plain.row(known.vector(plain))[None])[0] + known.SIGMA * rng.normal(size=len(at.q))
    return known.posed(replace(at, torque=torque))


@pytest.mark.parametrize("age", [0.0, 0.25, 0.5, 0.9, None], ids=["at a sample", "a quarter", "half", "0.9", "any"])
def test_a_coil_lag_bears_a_command_that_steps_between_two_samples(age: float | None) -> None:
    """Of 8 logs at 500 Hz the interval of most has 12 ms, where a fixed time of the step is half a sample off."""
    lag, dt, inside, found = 0.012, 0.002, 0, []
    for seed in range(8):
        problem = _stepped(seed, lag, dt, age)
        layout = problem.parameters(("coil_lag",), {("coil_lag", "hold"): float(seed % 2)})
        searched = fit_model(problem, layout, known.vector(layout, {"coil_lag": {"time_constant": lag}}))
        stated = reported_fit(problem, searched)
        low, high = interval(stated, stated.parameters.own("coil_lag")[0], covariance(stated))
        inside += np.exp(low) < lag < np.exp(high)
        found.append(stated.parameters.values(stated.x)["coil_lag"]["time_constant"])
    assert inside >= 7 and np.mean(found) == pytest.approx(lag, abs=0.15 * dt)


@pytest.mark.parametrize("unit", ["N·m", "bar"])
def test_a_gear_carries_the_inertia_behind_it(unit: str) -> None:
    """Stated with an inertia where the control input is a load on the same teeth, not where it is a pressure."""
    hidden = {"rotor_inertia": {"inertia": 0.02}, "load_friction": {"F1": 0.3, "inertia": 0.02}}
    at = known.motion(61, runs=6, seconds=3.0)
    at = replace(at, ranges=replace(at.ranges, load=True, carried=True))
    made = known.problem(hidden, at=at, K1=0.0)
    carried = unit == "N·m"
    problem = known.posed(replace(made.motion, ranges=replace(at.ranges, carried=carried)))
    stated = reported_fit(problem, known.fitted(problem, hidden))
    numbers = stated.parameters.values(stated.x)["load_friction"]
    assert ("inertia" in numbers) is carried
    if carried:
        assert numbers["inertia"] == pytest.approx(0.02, rel=0.15) and numbers["F1"] == pytest.approx(0.3, rel=0.05)


def test_samples_without_weight_do_not_count() -> None:
    """Corrupted samples of weight 0 leave the fit as it is without them."""
    problem = known.problem()
    clean = known.fitted(problem)
    corrupted = known.problem()
    at = np.arange(len(corrupted.weight)) % 50 < 5
    corrupted.weight[at] = 0.0
    corrupted.motion.torque[at] += 30.0
    fit = known.fitted(corrupted)
    error = np.sqrt(np.diag(covariance(clean)))
    assert (np.abs(fit.x - clean.x) < 3.0 * error).all()
    assert fit.equations.count < 0.92 * clean.equations.count


def test_an_effect_that_cannot_act_gains_nothing_where_a_number_is_at_its_bound() -> None:
    """Linear looks do not cross the bound either: at a constant current a lag of it changes nothing."""
    problem = known.problem(B=-0.02, at=known.motion(current=1.0))
    base = known.fitted(problem)
    assert base.x[1] == 0.0 and 1 not in base.free
    (look,) = screen(problem, base, ["coil_lag"])
    assert look.total == pytest.approx(base.total, rel=1e-6)


def test_nothing_depends_on_a_control_input_that_never_changes() -> None:
    """Where it is 0 or the same throughout, no effect of it is a candidate: it would only be another start of a fit."""
    at = known.problem().motion
    assert known.posed(at).impossible == ("temperature_fade",)  # no temperature was logged
    for level in (0.0, 1.0):
        still = known.posed(replace(at, current=np.full_like(at.current, level))).impossible
        assert {"current_saturation", "current_viscosity", "coil_lag", "load_friction"} <= set(still)
        assert "coulomb_friction" not in still and "speed_weakening" not in still


def test_coordinates_follow_the_path() -> None:
    """Effects stand in the catalogue's order, however they were named."""
    problem = known.problem()
    assert problem.parameters(("wear", "coil_lag", "backlash")).effects == ("coil_lag", "backlash", "wear")
