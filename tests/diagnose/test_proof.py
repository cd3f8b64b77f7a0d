"""A named cause is proven: its interval excludes zero, its size is possible, unseen trajectories gain."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from mrwarp.diagnose import proof
from mrwarp.diagnose.held_out import Account, Share, held_out_squares
from mrwarp.diagnose.problem import Fit, Problem, covariance, interval, reported_fit
from mrwarp.diagnose.proof import (
    _gain_rejection,
    _halves_rejection,
    _possible_alternatives,
    _size_rejection,
    interval_rejection,
    select_proven,
    through_gate,
    without_parts,
    without_unknown,
    would_be_negative,
)
from mrwarp.diagnose.screening import Models
from mrwarp.diagnose.search import Selection, screen_candidates
from mrwarp.effects.catalogue import KNOWN
from mrwarp.effects.law import Ranges
from mrwarp.identify.parameters import LINEAR
from mrwarp.sysid.settings import Gain, Proof, Settings
from tests.diagnose import known


def proven(hidden: dict, candidates: list[str], seed: int = 50):
    """Outcome of the search on six runs of 3 s."""
    problem = known.problem(hidden, seed=seed, at=known.motion(seed, runs=6, seconds=3.0))
    base = known.fitted(problem)
    return select_proven(Models(problem, base), screen_candidates(problem, base, candidates))


def test_an_effect_of_possible_size_is_a_cause() -> None:
    """A sensor that lags 6 ms is named and nothing is suspected."""
    selection, rejections = proven({"torque_sensor_lag": {"time_constant": 0.006}}, ["torque_sensor_lag", "cogging"])
    assert selection.named == ["torque_sensor_lag"] and not rejections


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        (Settings(proof=Proof(known_within=1.01)), "not known within"),
        (Settings(gain=Gain(one_error=10.0)), "as good, but for chance"),
        (Settings(gain=Gain(chi2=1e6)), ""),
    ],
)
def test_stricter_settings_make_a_cause_a_suspect_or_nothing(settings: Settings, reason: str) -> None:
    """The sensor of 6 ms that is named by default is not known well enough, not certain enough, or no gain at all."""
    problem = known.problem(
        {"torque_sensor_lag": {"time_constant": 0.006}}, seed=50, at=known.motion(50, runs=6, seconds=3.0)
    )
    problem = replace(problem, settings=settings)
    base = known.fitted(problem)
    selection, rejections = select_proven(
        Models(problem, base), screen_candidates(problem, base, ["torque_sensor_lag", "cogging"])
    )
    assert not selection.named
    assert [x.effect for x in rejections] == (["torque_sensor_lag"] if reason else [])
    assert all(reason in x.reason for x in rejections)


def test_an_effect_of_impossible_size_is_a_suspect() -> None:
    """A sensor that lags 50 ms passes no motion: it is a suspect, with its reason, and the model stays without it."""
    selection, [rejection] = proven({"torque_sensor_lag": {"time_constant": 0.05}}, ["torque_sensor_lag", "cogging"])
    assert "torque_sensor_lag" not in selection.final.effects
    assert rejection.effect == "torque_sensor_lag" and "ms are not possible" in rejection.reason
    assert {c.effect for c in selection.screened} == {"torque_sensor_lag", "cogging"}  # it still counts as tried


@pytest.mark.parametrize(
    ("effect", "numbers"),
    [
        ("rotor_inertia", {"inertia": -0.004}),
        ("wear", {"rate": -0.02}),
        ("temperature_drift", {"yield_loss": -0.2, "viscosity_loss": -0.1, "time_constant": 60.0}),
    ],
)
def test_an_effect_of_the_wrong_sign_is_a_suspect(effect: str, numbers: dict[str, float]) -> None:
    """No rotor has a negative inertia, and what wears or warms up does not gain torque."""
    selection, [rejection] = proven({effect: numbers}, [effect])
    assert not selection.named and "negative" in rejection.reason


def test_an_alternative_is_possible_too() -> None:
    """Wear that gives torque back is none, also where it would do as well as what is named."""
    problem = known.problem({"wear": {"rate": -0.02}}, seed=50, at=known.motion(50, runs=6, seconds=3.0))
    base = known.fitted(problem)
    screened = screen_candidates(problem, base, ["wear"])
    models = Models(problem, base)
    final = models.grown(base, screened[0])
    selection = Selection(
        base=base, final=final, screened=screened, fits=models.fits, leftovers=[], alternatives={"wear": ("wear",)}
    )
    assert _possible_alternatives(selection, models) == {"wear": ()}


def test_a_lag_that_is_too_short_to_be_named_is_an_alternative(monkeypatch: pytest.MonkeyPatch) -> None:
    """The cause named in its place may stand for it; a cause named next to it does not."""
    hidden = {"torque_sensor_lag": {"time_constant": 0.0035}, "cogging": {"sine": 0.1, "cosine": 0.0, "periods": 25.0}}
    problem = replace(known.problem(hidden, at=known.motion(50, runs=6, seconds=3.0)), misfit=True)
    models = Models(problem, known.fitted(problem))
    screened = screen_candidates(problem, models.base, list(hidden))
    for others in ((), ("cogging",)):
        first = known.fitted(problem, {effect: hidden[effect] for effect in ("torque_sensor_lag", *others)})
        steps = [known.fitted(problem, {"cogging": hidden["cogging"]}), first]
        found = Selection(base=models.base, final=first, screened=screened, fits=models.fits, leftovers=[])
        monkeypatch.setattr(proof, "select", lambda *at, models, of=(found, steps): replace(of[0], final=of[1].pop()))
        selection, [rejection] = select_proven(models, screened)
        assert selection.named == ["cogging"] and "shorter than a sample" in rejection.reason
        assert selection.alternatives.get("cogging", ()) == (() if others else ("torque_sensor_lag",))


@pytest.mark.parametrize(
    ("effect", "number"), [("torque_sensor_lag", "time_constant"), ("series_compliance", "compliance")]
)
def test_next_to_another_law_nothing_is_resolved_within_a_sample(effect: str, number: str) -> None:
    """A lag shorter than a sample and a spring that bends by less than it: the law's own corners look like that."""
    problem = known.problem({effect: {number: 0.01}}, at=known.motion(50, runs=6, seconds=3.0))
    true = known.fitted(problem, {effect: {number: 0.01}})
    for misfit in (False, True):
        for shorter in (1.0, 30.0):
            x = true.x.copy()
            x[true.parameters.own(effect)] -= np.log(shorter)
            reason = proof._size_rejection(effect, replace(true, x=x), replace(problem, misfit=misfit))
            assert ("sampl" in reason) == (misfit and shorter > 1.0)


@pytest.mark.parametrize("one", [True, False])
def test_a_true_lag_is_as_long_in_slow_motion_as_in_quick(one: bool) -> None:
    """A sensor has one lag; what is four times as long in the slower half of the runs stands for something else."""
    at = known.motion(50, runs=8, seconds=3.0)
    rates = [at.qdd[part].std() / at.qd[part].std() for part in at.parts]
    lags = [{"torque_sensor_lag": {"time_constant": tau}} for tau in (0.003, 0.003 if one else 0.012)]
    quick, slow = (known.problem(lag, at=at, seed=50) for lag in lags)
    torque = quick.motion.torque.copy()
    for rate, part in zip(rates, at.parts, strict=True):
        if rate <= np.median(rates):
            torque[part] = slow.motion.torque[part]
    problem = known.posed(replace(at, torque=torque))
    fit = known.fitted(problem, {"torque_sensor_lag": {"time_constant": 0.006}})
    assert (not _halves_rejection("torque_sensor_lag", fit, problem)) == one


@pytest.mark.parametrize(
    ("before", "proof"),
    [([2.0, 2.2, 1.9], True), ([6.0, 0.1, 0.1], False), ([1.0, 1.0, 1.0], False), ([9.0, 9.0, 9.0, 0.05, 0.05], False)],
)
def test_a_gain_counts_by_trajectories(before: list[float], proof: bool) -> None:
    """One trajectory that gains is chance, all of them are not; those of large torque do not decide alone."""
    assert (not _gain_rejection(np.array(before), np.ones(len(before)), 1.0)) == proof


def test_cogging_at_one_angle_only_is_a_suspect() -> None:
    """A sine that fits a bend in the middle of the way is none: true cogging is the same all along it."""
    at = known.motion(50, runs=8, seconds=3.0)
    wave = 0.05 * np.sin(25.0 * at.q)
    for local in (False, True):
        plus = wave * (np.abs(at.q) < 0.5 * np.abs(at.q).max()) if local else wave
        problem = known.problem(at=at, seed=50, plus=plus)
        fit = known.fitted(problem, {"cogging": {"sine": 0.05, "cosine": 0.0, "periods": 25.0}})
        assert bool(_halves_rejection("cogging", fit, problem)) == local


def as_fitted(problem: Problem, effect: str, **numbers: float) -> Fit:
    """The paper's device with an effect of these numbers, as if they had been fitted."""
    fit, layout = known.fitted(problem), problem.parameters([effect])
    x = fit.parameters.moved(fit.x, layout)
    for i, slot in layout.items():
        value = numbers[slot.parameter.name]
        x[i] = np.log(value) if slot.logarithmic else value
    return replace(fit, parameters=layout, x=x, torque=problem.replay.torque(layout.row(x)[None])[0].astype(float))


def test_what_another_term_takes_back_is_a_suspect() -> None:
    """A spring that would bear many times the torque, about a hair's gap, only bends C."""
    problem = known.problem(seed=50, at=known.motion(50, runs=4, seconds=2.0))
    stiffness = 300.0 * problem.motion.torque.std() / np.ptp(problem.motion.q)
    made = as_fitted(problem, "compliance_with_backlash", stiffness=float(stiffness), half_gap=1e-3)
    assert "times the torque" in _size_rejection("compliance_with_backlash", made, problem)


def test_a_mass_against_its_spring_is_possible() -> None:
    """Near resonance an inertia bears more than the whole torque, which the spring takes back: both are there."""
    problem = known.problem(seed=50, at=known.motion(50, runs=4, seconds=2.0))
    motion = problem.motion
    inertia = 1.2 * motion.torque.std() / motion.qdd.std()
    spring = -inertia * float(motion.qdd @ motion.q) / float(motion.q @ motion.q)
    fit = known.fitted(problem, {"rotor_inertia": {"inertia": 0.0}})
    x = fit.x.copy()
    x[fit.parameters.own("rotor_inertia")] = inertia
    x[LINEAR.index("C")] += spring
    both = replace(fit, x=x, torque=problem.replay.torque(fit.parameters.row(x)[None])[0].astype(float))
    assert not _size_rejection("rotor_inertia", both, problem)


@pytest.mark.parametrize(("C", "possible"), [(-1.0, False), (0.0, True), (1.0, True)])
def test_a_weight_next_to_a_spring_that_pushes_away_is_impossible(C: float, possible: bool) -> None:
    """The two would cancel but for the bend of the sine, which may be any structure over the angle."""
    weight = {"gravity": {"sine": 2.0, "cosine": 0.1}}
    problem = known.problem(weight, seed=50, C=C, at=known.motion(50, runs=4, seconds=2.0))
    assert ("push" in _size_rejection("gravity", known.fitted(problem, weight), problem)) != possible


@pytest.mark.parametrize(("share", "possible"), [(0.2, True), (0.3, False)])
def test_a_law_says_how_large_each_of_its_numbers_may_be(share: float, possible: bool) -> None:
    """Stribeck friction over a quarter of the speeds and more is none."""
    problem = known.problem(seed=50, at=known.motion(50, runs=4, seconds=2.0))
    numbers = {"torque": 0.05, "stribeck_speed": share * problem.motion.ranges.qd, "speed": 0.05}
    made = as_fitted(problem, "stribeck", **numbers)
    assert ("nearly all speeds" not in _size_rejection("stribeck", made, problem)) == possible


@pytest.mark.parametrize(("runs", "rejection"), [(2, "less than half of the runs"), (6, "")])
def test_play_that_few_runs_would_cross_is_a_suspect(runs: int, rejection: str) -> None:
    """A spring that the widest two of eight runs would reach; one that six reach is possible."""
    problem = known.problem(seed=50, at=known.motion(50, runs=8, seconds=2.0))
    reach = sorted(np.abs(problem.motion.q[part] - problem.q_zero).max() for part in problem.motion.parts)
    made = as_fitted(problem, "compliance_with_backlash", stiffness=0.3, half_gap=float(reach[-runs] - 1e-6))
    assert rejection in (found := _size_rejection("compliance_with_backlash", made, problem)) and bool(
        rejection
    ) == bool(found)


def test_a_suspect_comes_back_through_no_earlier_fit() -> None:
    """The rest is searched without it."""
    hidden = {"torque_sensor_lag": {"time_constant": 0.05}, "cogging": {"sine": 0.1, "cosine": 0.0, "periods": 25.0}}
    selection, rejections = proven(hidden, ["torque_sensor_lag", "cogging"])
    assert rejections[0].effect == "torque_sensor_lag"
    assert not any("torque_sensor_lag" in effects for effects in selection.fits)


@pytest.mark.parametrize(("times", "stays"), [(2.0, True), (9.0, False)])
def test_a_piece_of_something_much_larger_is_a_suspect(times: float, stays: bool) -> None:
    """An effect stays where it takes away at least a fifth of what repeats without a name."""
    problem = known.problem({"torque_sensor_lag": {"time_constant": 0.003}}, at=known.motion(50, runs=6, seconds=3.0))
    base = known.fitted(problem)
    models = Models(problem, base)
    selection, _ = select_proven(models, screen_candidates(problem, base, ["torque_sensor_lag"]))
    assert selection.named == ["torque_sensor_lag"]
    plain = [held_out_squares(problem, reported_fit(problem, fit)).sum() for fit in (selection.base, selection.final)]
    part = Share(share=0.5, ci95=(0.4, 0.6))
    much = replace(part, share=float(1.0 - plain[1] / plain[0]) * times)
    account = Account(named=part, repeatable=much, not_repeatable=part, left=0.1, cycle_spread=None, learnable=part)
    found, rejections = without_parts(models, selection, account)
    assert found.named == (["torque_sensor_lag"] if stays else []) and len(rejections) == (not stays)


@pytest.mark.parametrize(
    ("effect", "times", "known_"),
    [
        ("position_friction", 1.05, False),
        ("position_friction", 1.3, True),
        ("rotor_inertia", 1.05, True),
    ],
)
def test_of_two_numbers_one_has_to_be_clear_of_zero(effect: str, times: float, known_: bool) -> None:
    """Of two numbers that may be zero either is beyond its own 95 % interval by chance in nearly a tenth of cases."""
    problem = known.problem(at=known.motion(50, runs=6, seconds=2.0))
    numbers = {"F1": 0.0, "F2": 0.0, "speed": 0.05} if effect == "position_friction" else {"inertia": 0.0}
    fit = known.fitted(problem, {effect: numbers})
    first, *others = fit.parameters.own(effect)
    low, high = interval(fit, first, covariance(fit))
    x = fit.x.copy()
    x[[first, *others[:1]]] = 0.0
    x[first] = times * 0.5 * (high - low)
    assert (not interval_rejection(effect, replace(fit, x=x), Proof())) == known_


@pytest.mark.parametrize(("low", "rejected"), [(0.0006, False), (0.0001, True), (0.0, True)])
def test_the_interval_that_is_reported_decides(low: float, rejected: bool) -> None:
    """Few runs have a step that a short delay shows in: the fit's interval is wide, that by single steps is stated."""
    problem = known.problem({"command_delay": {"delay": 0.0018}}, at=known.motion(50, runs=4, seconds=2.0))
    fit = known.fitted(problem, {"command_delay": {"delay": 0.0018}})
    variance = np.zeros(len(fit.x))
    variance[fit.parameters.own("command_delay")[0]] = 1.0
    wide = replace(fit, least_variance=variance)  # of the logarithm: a factor of 7 to either side
    assert "not known" in interval_rejection("command_delay", wide, Proof())
    refined = {("command_delay", "delay"): (0.002, low, 0.004)}
    assert bool(interval_rejection("command_delay", wide, Proof(), refined)) == rejected


@pytest.mark.parametrize(
    ("effect", "hidden", "stays"),
    [
        ("coulomb_friction", {"torque": 0.05}, False),
        ("rotor_inertia", {"inertia": 1e-3}, True),
    ],
)
def test_what_may_vanish_with_the_error_of_smoothing_is_a_suspect(
    effect: str, hidden: dict[str, float], stays: bool
) -> None:
    """An interval that contains zero by that error leaves only an inertia named: whose size is not known, then."""
    problem = known.problem({effect: hidden}, seed=50, at=known.motion(50, runs=6, seconds=3.0))
    models = Models(problem, known.fitted(problem))
    selection, _ = select_proven(models, screen_candidates(problem, models.base, [effect]))
    own = selection.final.parameters.own(effect)[0]
    least = np.zeros(selection.final.parameters.size)
    same, nothing = without_unknown(models, selection, selection.final)
    least[own] = selection.final.x[own] ** 2
    found, rejections = without_unknown(models, selection, replace(selection.final, least_variance=least))
    assert same.named == selection.named == [effect] and not nothing
    assert (found.named == [effect]) == stays
    assert [x.reason for x in rejections] == ([] if stays else ["its 95 % interval contains zero"])


def test_what_stays_is_known_without_the_pieces_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """An effect that no device has in that size once a piece of something larger is out is a suspect as well."""
    hidden = {"torque_sensor_lag": {"time_constant": 0.0015}, "cogging": {"sine": 0.1, "cosine": 0.0, "periods": 25.0}}
    problem = known.problem(hidden, at=known.motion(50, runs=6, seconds=3.0))
    base = known.fitted(problem)
    models = Models(problem, base)
    selection, _ = select_proven(models, screen_candidates(problem, base, list(hidden)))
    assert set(selection.named) == set(hidden)
    part = Share(share=0.5, ci95=(0.4, 0.6))
    account = Account(
        named=part,
        repeatable=replace(part, share=0.9),
        not_repeatable=part,
        left=0.1,
        cycle_spread=None,
        learnable=part,
    )
    found, [rejection] = without_parts(models, selection, account)
    assert found.named == ["cogging"] and rejection.effect == "torque_sensor_lag"
    assert through_gate(models, found, 0)[:2] == (found, ())
    monkeypatch.setattr(proof, "impossible_size", lambda effect, fit, ranges: "too large")
    found, [rejection], held = through_gate(models, found, 0)
    assert not found.named and rejection.reason == "too large"
    assert (held.baseline == held.extended).all()


def test_the_last_gate_lets_through_what_unseen_runs_gain_by(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lag that is there, next to an inertia that is not: first by its size; where that seems known, by the gain."""
    problem = known.problem({"torque_sensor_lag": {"time_constant": 0.006}}, at=known.motion(50, runs=6, seconds=3.0))
    base = known.fitted(problem)
    models = Models(problem, base)
    true, screened = (screen_candidates(problem, base, names) for names in (["torque_sensor_lag"], ["rotor_inertia"]))
    lag = select_proven(models, true)[0]
    both = replace(lag, final=models.grown(lag.final, screened[0]))
    found, [rejection], held = through_gate(models, both, 0)
    assert found.named == ["torque_sensor_lag"] and rejection.effect == "rotor_inertia"
    assert "an inertia is above 0" in rejection.reason
    assert held.extended.sum() < 0.5 * held.baseline.sum()
    healthy = known.problem(at=known.motion(50, runs=6, seconds=3.0))
    monkeypatch.setattr(proof, "impossible_size", lambda *_: "")
    models = Models(healthy, known.fitted(healthy))
    alone = replace(lag, base=models.base, final=models.grown(models.base, screened[0]), own_gain={})
    found, [rejection], _ = through_gate(models, alone, 0)
    assert not found.named and "does not clearly fall" in rejection.reason


def test_what_an_effect_can_be_stands_in_its_law(monkeypatch: pytest.MonkeyPatch) -> None:
    """A law that says why it is above 0 is never a cause below; one that says nothing may have either sign."""
    law = KNOWN["torque_bias"]
    assert not would_be_negative("torque_bias", -1.0)
    monkeypatch.setitem(KNOWN, "torque_bias", replace(law, positive="a weight pulls down"))
    assert would_be_negative("torque_bias", -1.0) and not would_be_negative("torque_bias", 1.0)


@pytest.mark.parametrize(
    ("level", "units", "load", "impossible", "possible"),
    [
        (0.0, {"current": "A"}, False, {"load_friction", "coil_lag", "remanence"}, {"rotor_inertia"}),
        (1.0, {"current": "A"}, False, set(), {"load_friction", "coil_lag", "remanence"}),
        (1.0, {"current": "bar"}, True, {"remanence", "current_saturation"}, {"coil_lag", "command_delay"}),
        (1.0, {"current": "N·m"}, True, {"remanence", "coil_lag", "command_delay"}, {"load_friction"}),
    ],
)
def test_an_effect_needs_the_control_input_that_makes_it(
    level: float, units: dict[str, str], load: bool, impossible: set[str], possible: set[str]
) -> None:
    """A field for remanence, a command for lags, any change for friction under a load."""
    motion = SimpleNamespace(current=np.array([1.0, 1.0 + level]), ranges=Ranges(load=load), temperature=None)
    zero = np.zeros(2)
    replay, noise = cast(Any, SimpleNamespace(motion=motion)), cast(Any, None)
    problem = Problem(replay=replay, measured=zero, weight=zero, q_zero=0.0, units=units, noise=noise)
    assert impossible <= set(problem.impossible) and not possible & set(problem.impossible)
