"""Short confusion suite: effects hidden by the benchmark's own generator, on small data sets (12 trajectories of 4 s).

The generator shares no equation with the candidates. Level 0.8: what survives re-fitting eqs. 14 and 15 is four fifths
of the noise. The full suite, with its tables, is ``python -m benchmarks.confusion``.
"""

from typing import Any

import pytest

from benchmarks.confusion.effects import SINGLE, UNCATALOGUED
from benchmarks.confusion.families import Plan
from benchmarks.confusion.suite import run_case

Case = dict[str, Any]


def cases(plan: Plan, count: int) -> list[Case]:
    """The first cases of a plan, reported as they come."""
    found = []
    for index in range(count):
        case = run_case(plan, index)
        names = [[c["name"], *c["alternatives"]] for c in case.get("causes", [])]
        hidden = "+".join([*case["kinds"], *case["background"]]) or "nothing"
        print(f"{hidden} -> {case.get('verdict')} {names}: {case['outcome']} {case['remark']}")
        found.append(case)
    return found


def hits(found: list[Case], outcomes: tuple[str, ...] = ("right", "ambiguous")) -> int:
    """Number of cases with one of the outcomes."""
    return sum(case["outcome"] in outcomes for case in found)


def misled(found: list[Case]) -> list[Case]:
    """Cases in which something was named that is not there, or the diagnosis failed."""
    return [case for case in found if case["outcome"] in ("wrong", "failed")]


@pytest.mark.slow
def test_most_effects_are_named() -> None:
    """A third of the contract's effects: none is taken for another, at most one is missed."""
    found = cases(Plan(family="single", level=0.8, seed=4, size="small", kinds=SINGLE[::3]), len(SINGLE[::3]))
    assert not misled(found) and hits(found, ("right", "ambiguous", "other")) >= len(found) - 1


@pytest.mark.slow
def test_clean_data_of_all_noises_raise_no_alarm() -> None:
    """Realistic, harsh and clean noise: no effect is named."""
    assert not misled(cases(Plan(family="none", seed=5, size="small"), 3))


@pytest.mark.slow
def test_structure_outside_the_catalogue_is_left_over() -> None:
    """Half of what is outside the catalogue: never named, mostly found."""
    found = cases(Plan(family="uncatalogued", level=0.8, seed=6, size="small"), len(UNCATALOGUED) // 2)
    assert not misled(found) and hits(found) >= len(found) - 1


@pytest.mark.slow
@pytest.mark.parametrize("family", ["pairs", "background"])
def test_two_causes_are_not_taken_for_others(family: str) -> None:
    """Two effects, or one next to uncatalogued structure: every named effect was hidden."""
    found = cases(Plan(family=family, level=0.8, seed=7, size="small"), 2)
    assert not misled(found) and hits(found, ("right", "ambiguous", "other")) >= len(found) - 1


@pytest.mark.slow
@pytest.mark.parametrize(("index", "named"), [(2, "gravity"), (3, "torque_sensor_lag")])
def test_a_joint_without_a_device_has_its_weight_and_its_lag(index: int, named: str) -> None:
    """An arm in swings of half a radian, whose weight C takes up; a geared motor, whose lag looks like a softer law."""
    case = run_case(Plan(family="mechanics", level=0.1, seed=45), index)
    assert case["outcome"] == "right" and {"rotor_inertia", named} <= {cause["name"] for cause in case["causes"]}


@pytest.mark.slow
def test_a_second_cause_that_the_search_leaves_out_enters_by_its_evidence() -> None:
    """Wear, viscosity and saturation next to a larger cause: on twelve short runs their errors say little."""
    plan = Plan(family="pairs", level=0.8, seed=9971, size="small")
    for index in (4, 8, 11):
        case = run_case(plan, index)
        assert case["outcome"] == "right", (case["kinds"], case["verdict"], case["remark"])
