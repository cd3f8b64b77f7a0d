"""``--fix`` and ``--bound``: numbers that a fit is given, or keeps within bounds."""

import pytest

from mrwarp.commands.run_fit import Fit
from mrwarp.identify.checks.limits import Limits, bound_of
from mrwarp.identify.fit import FitResult, fit
from mrwarp.identify.fit_report import figures, lines, to_model
from mrwarp.identify.law_fit import fit_law
from mrwarp.identify.mechanics_fit import fit_joint
from mrwarp.options.command_line import OptionError, parse
from mrwarp.recording.load import Recording
from tests.identify.synthetic import TRUTH, bench_like
from tests.identify.test_law_fit import kwok_damper
from tests.identify.test_mechanics_fit import arm


@pytest.fixture(scope="module")
def bench() -> Recording:
    """A recording of the paper's joint."""
    return bench_like(3, runs=8, seconds=2.0)


@pytest.fixture(scope="module")
def free(bench: Recording) -> FitResult:
    """Its fit without limits."""
    return fit(bench)


@pytest.mark.parametrize("names", [("C",), ("alpha", "B"), ("beta",), ("gamma",), ("beta", "gamma")])
def test_what_is_given_at_the_optimum_leaves_the_rest_there(
    bench: Recording, free: FitResult, names: tuple[str, ...]
) -> None:
    """The others keep their values to a tenth of their interval, whose size is as before; no warning, no estimate."""
    held = fit(bench, limits=Limits(fix=tuple((name, free.values[name]) for name in names)))
    assert held.rmse == pytest.approx(free.rmse, rel=1e-4)
    assert {*free.estimates} - {*held.estimates} == {*names} == {*held.given} and not held.warnings
    for name, e in held.estimates.items():
        assert abs(e.value - free.estimates[name].value) < 0.1 * e.half < 0.15 * free.estimates[name].half, name
    model = to_model(held)
    assert all(model.values[name] == free.values[name] and model.parameters[name].ci95 is None for name in names)
    assert figures(held)["given"] == held.given and f"{names[0]} = " in "\n".join(lines(held))


@pytest.mark.parametrize("name", ["K0", "alpha", "gamma"])
def test_a_bound_that_is_met_acts_as_a_number_that_is_given(bench: Recording, free: FitResult, name: str) -> None:
    """A number that would lie beyond its bound ends there, and all others where it is given; one with room is free."""
    low, high = sorted((0.7 * free.values[name], 0.9 * free.values[name]))
    end = min((low, high), key=lambda x: abs(x - free.values[name]))
    bounded, given = (fit(bench, limits=x) for x in (Limits(bound=((name, (low, high)),)), Limits(fix=((name, end),))))
    assert bounded.values[name] == pytest.approx(end, rel=1e-6) and bounded.rmse > free.rmse
    for other, value in given.values.items():
        assert bounded.values[other] == pytest.approx(value, rel=0.01, abs=1e-3), other
    assert any(name in warning and "bound" in warning for warning in bounded.warnings)
    roomy = fit(bench, limits=Limits(bound=((name, (min(0.0, 2.0 * end), max(0.0, 2.0 * end))),)))
    assert roomy.values[name] == pytest.approx(free.values[name], rel=0.02) and not roomy.warnings


def test_numbers_of_laws_and_of_mechanics_are_given_too() -> None:
    """By the names that fit prints; what is given is in the model and has no interval."""
    found = fit_law(kwok_damper(), "kwok", limits=Limits(fix=(("kwok.slope", 55.0), ("C", 900.0))))
    assert found.effects[0].values["slope"] == pytest.approx(55.0) and found.values["C"] == 900.0
    assert found.effects[0].parameters["slope"].ci95 is None and "C" not in found.estimates
    limits = Limits(fix=(("rotor_inertia.inertia", 0.06),), bound=(("gravity.sine", (0.0, 1.0)),))
    effects = {e.name: e.values for e in fit_joint(arm(0.05, 2.0, 0.4, 0.0, 0.04, 0.15), limits=limits).effects}
    assert effects["rotor_inertia"]["inertia"] == pytest.approx(0.06)
    assert effects["gravity"]["sine"] == pytest.approx(1.0)


def test_no_noise_free_truth_is_refused_by_its_own_bounds() -> None:
    """Bounds about every true number leave each of them where it is."""
    bounds = tuple((name, tuple(sorted((0.5 * value, 1.5 * value)))) for name, value in TRUTH.items())
    found = fit(bench_like(0, runs=8, noise=0.0), limits=Limits(bound=bounds))
    for name in set(TRUTH) - {"I1", "K0"}:
        assert found.values[name] == pytest.approx(TRUTH[name], rel=1e-3), name


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--fix", "C"], ("'C'", "NAME=VALUE")),
        (["--fix", "C=a"], ("C", "'a'")),
        (["--bound", "C=3"], ("'C=3'", "NAME=LOW:HIGH")),
        (["--bound", "C=:"], ("'C=:'", "NAME=LOW:HIGH")),
        (["--bound", "C=3:1"], ("C=3:1", "larger")),
        (["--fix", "C=1", "--bound", "C=0:2"], ("C", "2 times")),
        (["--fix", "K0=-1"], ("K0", ">= 0")),
        (["--fix", "beta=2", "gamma=-3"], ("gamma", "3", "beta", "2")),
    ],
)
def test_limits_that_make_no_sense_are_refused(words: list[str], parts: tuple[str, ...]) -> None:
    """One line with the name and what is allowed."""
    with pytest.raises(OptionError) as refused:
        parse(Fit, ["data.csv", *words], "mrwarp fit")
    assert all(part in str(refused.value) for part in parts)


def test_a_name_that_a_fit_does_not_have_is_refused_with_its_own(bench: Recording) -> None:
    """The nearest is named, and all there are; an end of a bound may be left out."""
    with pytest.raises(ValueError, match=r"--fix alfa: .*'alpha'.*choose from D, B, C"):
        fit(bench, limits=Limits(fix=(("alfa", 1.0),)))
    with pytest.raises(ValueError, match=r"--bound kwok\.slop: .*'kwok\.slope'"):
        fit_law(kwok_damper(), "kwok", limits=Limits(bound=(("kwok.slop", (0.0, 1.0)),)))
    assert bound_of("B=0.1:") == ("B", (0.1, float("inf")))
