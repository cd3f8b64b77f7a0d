"""MrParams: ranges, helpful refusals, round trip."""

import re

import pytest

from mrwarp.kernels.mr_joint import FIELDS
from mrwarp.params import (
    BoucWenParams,
    CoilParams,
    GateParams,
    HoldParams,
    MotorParams,
    MrParams,
    ParameterError,
    ParamSpec,
)

GROUPS = (BoucWenParams, HoldParams, GateParams, MotorParams, CoilParams)


def test_defaults_are_the_numbers_of_the_paper():
    """Each printed coefficient of the paper, sections 3.2, 3.3, 4.2, 4.4, 5.2 and 7, digit by digit."""
    paper = {
        "q_offset": 2.39638101e-4, "q_center": -1.51224291e-17, "D": -0.01917639, "B": 0.1013626, "C": 0.2160456,
        "I1": -7.681742e-4, "K0": 0.3992754, "K1": 10.413315, "alpha": 0.7777051, "beta": 16.50618,
        "gamma": -10.53036, "z_max": 5.0, "T_max": 26.59697, "K": 0.51272, "n": 2.87967, "safety_factor": 1.2,
        "f_th": 5.0, "eps_e": 0.05, "eps_v": 0.20, "eps_hold": 0.20, "kp_low": 5.0, "current_max": 1.5,
        "coil_time_constant": 0.0,
    }  # fmt: skip
    values = MrParams().to_dict()
    assert {name: values[name] for name in paper} == paper
    assert MrParams().bouc_wen.z_bound == pytest.approx(0.1673, abs=5e-5)


def test_names_are_unique_and_those_of_the_kernels():
    """The struct of the kernels holds the same names in the same order; every group is part of MrParams."""
    names = [spec.name for spec in MrParams.specs()]
    assert len(set(names)) == len(names)
    assert tuple(names) == FIELDS
    assert {spec.group for spec in MrParams.specs()} == {group.__name__ for group in GROUPS}
    assert [name for name, _ in MrParams()] == names


@pytest.mark.parametrize("spec", MrParams.specs(), ids=lambda spec: spec.name)
def test_every_parameter_is_documented_and_in_its_range(spec: ParamSpec):
    """Unit, source and doc are given; the ends of the range are allowed; beyond them or NaN is refused by name."""
    assert spec.unit and spec.source and spec.doc
    assert spec.low <= spec.default <= spec.high
    assert spec.check(spec.low, "here") == spec.low
    assert spec.check(spec.high, "here") == spec.high
    step = 1e-6 * (spec.high - spec.low)
    for value in (spec.low - step, spec.high + step, float("nan"), float("inf"), -(10**400)):
        unit = "" if spec.unit == "1" else f" {re.escape(spec.unit)}"
        high = re.escape(f"{spec.high:g}")
        with pytest.raises(ParameterError, match=f"here: {spec.name} = .* to {high}{unit}"):
            spec.check(value, "here")
    for value in ("fast", None, [1.0]):
        with pytest.raises(ParameterError, match=f"here: {spec.name} = .*number"):
            spec.check(value, "here")


@pytest.mark.parametrize("group", GROUPS)
def test_groups_check_their_fields(group: type):
    """Each field of each group is checked when the object is built, and kept as a float."""
    for spec in group.specs():
        with pytest.raises(ParameterError, match=f"{group.__name__}: {spec.name} = "):
            group(**{spec.name: spec.high + 1e6})
        kept = getattr(group(**{spec.name: str(spec.default)}), spec.name)
        assert (type(kept), kept) == (float, spec.default)


def test_dict_round_trip_is_the_identity():
    """from_dict(to_dict()) equals the original for the defaults and for a variant, in both directions."""
    for params in (MrParams(), MrParams().replace(K1=0.1 + 0.2, q_neutral=-1.0, coil_time_constant=1 / 3)):
        values = params.to_dict()
        assert MrParams.from_dict(values) == params
        assert MrParams.from_dict(values).to_dict() == values
        assert len(values) == len(FIELDS)


def test_replace_changes_one_parameter_and_leaves_the_original():
    """The copy differs in that name only; a value out of range is refused."""
    before = MrParams()
    after = before.replace(T_max=30.0)
    assert {name for name, value in after if value != dict(before)[name]} == {"T_max"}
    assert before.hold.T_max == 26.59697
    for wrong, said in (({"T_max": -1.0}, "T_max = -1"), ({"k1": 1.0}, "did you mean 'K1'")):
        with pytest.raises(ParameterError, match=said):
            before.replace(**wrong)


NEAREST = {
    "K_1": "K1", "k1": "K1", "tmax": "T_max", "alfa": "alpha", "coil_resistence": "coil_resistance",
    "kpbase": "kp_base", "GAMMA": "gamma", "Kd": "kd",
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "said"),
    [
        *(({wrong: 1.0}, rf"'{wrong}'; did you mean '{meant}'\? allowed: ") for wrong, meant in NEAREST.items()),
        ({"#?!": 1.0}, r"'#\?!'; known: q_neutral, .*, current_max"),
        ({"K1": None}, r"K1 .*0 to 1e\+15 N·m/\(rad·A\)"),
        *(
            ({"beta": beta, "gamma": gamma}, rf"beta \+ gamma > 0 1/rad, got {beta:g} \+ {gamma:g}; raise beta")
            for beta, gamma in ((5.0, -5.0), (5.0, -6.0), (0.0, 0.0))
        ),
    ],
)
def test_a_mapping_is_refused_with_its_place(change: dict[str, float | None], said: str):
    """A misspelt name with the nearest, another with all, one that is missing, and an unbounded hysteresis."""
    values = {name: value for name, value in {**MrParams().to_dict(), **change}.items() if value is not None}
    with pytest.raises(ParameterError, match=rf"model\.json: .*{said}"):
        MrParams.from_dict(values, "model.json")
