"""The catalogue keeps the contract: tokens, units, bounds, nulls, sources; one file and one line add an effect."""

import ast
from pathlib import Path

import numpy as np
import pytest

import mrwarp
from mrwarp.effects import catalogue
from mrwarp.effects.catalogue import (
    CATALOGUE,
    COLUMN,
    COLUMNS,
    HYSTERESIS,
    KNOWN,
    LAWS,
    NULLS,
    SLOT,
    SLOTS,
    column_of,
    parameter_of,
)
from mrwarp.effects.law import STAGES
from mrwarp.identify.parameters import LINEAR
from tests.effects.strengths import RANGES

TOKENS = {
    "coil_lag", "command_delay", "remanence", "current_saturation", "current_gain", "torque_sensor_lag",
    "velocity_lag", "encoder_offset", "torque_bias", "torque_gain", "backlash", "rotor_inertia", "coulomb_friction",
    "friction_asymmetry", "stribeck", "cogging", "current_viscosity", "speed_weakening", "temperature_drift", "wear",
    "compliance_with_backlash", "series_compliance", "load_friction", "position_friction",
    "gravity", "path_lag", "temperature_fade",
}  # fmt: skip
SPOKEN_OF = {
    ("lag_or_delay.py", "coil_lag"), ("lag_or_delay.py", "command_delay"),  # these two are all that the file is about
    ("law_choice.py", "dahl"),  # the law that eq. 15 becomes with alpha = gamma = 0
    ("mechanics_fit.py", "biviscous"),  # dry friction that turns its direction over a range of speeds
    ("recording_faults.py", "torque_gain"),  # a fault of some runs, by the same name in result.json
    ("result.py", "coulomb_friction"),  # a key of result.json: dry friction of the law that was taken
}  # fmt: skip
"""Names of effects that may stand in the method, by file."""
VARIABLES = {"q", "qd", "qdd", "current", "torque", "time", "memory", "frequency"}


def test_tokens_are_those_of_the_contract() -> None:
    """None of these is renamed or lost; each stands once."""
    assert set(CATALOGUE) >= TOKENS and len(LAWS) == len(CATALOGUE)


@pytest.mark.parametrize("name", list(CATALOGUE))
def test_law_is_complete(name: str) -> None:
    """Title, sentence, equation, source and remedy are there, on one line; the file is named after the token."""
    law = CATALOGUE[name]
    for text in (law.title, law.sentence, law.equation, law.source, law.remedy):
        assert text and "\n" not in text
    assert law.sentence.endswith(".") and law.sentence[0].isupper()
    assert law.stage in STAGES and law.kind in ("mechanism", "sensor", "calibration")
    assert set(law.depends_on) <= VARIABLES
    assert (Path(catalogue.__file__).parent / f"{name}.py").is_file()
    assert law.law.key == f"{name}_law"


@pytest.mark.parametrize("name", list(CATALOGUE))
def test_parameters_have_unit_bounds_and_null(name: str) -> None:
    """Bounds enclose starts and presets; the null lies inside, or just beyond the low end of a logarithmic search."""
    law = CATALOGUE[name]
    assert law.parameters and law.defaults() == {p.name: p.null for p in law.parameters}
    for p in law.parameters:
        low, high = p.low(RANGES), p.high(RANGES)
        assert p.unit and low < high
        assert p.allows(p.null) or p.divides, "null is no value"
        if p.starts is not None:
            starts = p.starts(RANGES)
            assert list(starts) == sorted(starts) and len(starts) >= 3
            assert np.isfinite([low, high]).all() and low <= starts[0] and starts[-1] <= high
            assert p.negative or low > 0.0, "its logarithm is searched"
        if p.preset is not None:
            assert p.allows(p.preset(RANGES)) and low <= p.preset(RANGES) <= high
        if p.choices:
            assert p.null in p.choices and p.starts is None and p.preset is None
            assert not p.form or low <= min(p.choices) < max(p.choices) <= high, "the reported fit has what is between"
        if p.form:
            assert p.starts is None and p.preset is None and p is not law.parameters[0]
        assert low <= p.null <= high or (p.null == 0.0 and p.starts is not None and not p.negative)


def test_columns_and_slots_do_not_overlap() -> None:
    """Each parameter has its own column and each state its own slot, without gaps; nulls stand in their columns."""
    columns = [column_of(name, p.name) for name, law in KNOWN.items() for p in law.parameters]
    assert sorted(columns) == list(range(COLUMNS)) == list(range(len(NULLS)))
    slots = [SLOT[name] + k for name, law in KNOWN.items() for k in range(law.states)]
    assert sorted(slots) == list(range(SLOTS))
    for name, law in KNOWN.items():
        assert COLUMN[name] == column_of(name, law.parameters[0].name)
        for p in law.parameters:
            assert NULLS[column_of(name, p.name)] == p.null and parameter_of(name, p.name) is p


def test_order_is_that_of_the_path() -> None:
    """Stages follow each other; the command is late before it lags, and the reading is filtered before its gain."""
    stages = [STAGES.index(law.stage) for law in CATALOGUE.values()]
    assert stages == sorted(stages)
    names = list(CATALOGUE)
    for before, after in (
        ("coil_lag", "remanence"),
        ("remanence", "current_saturation"),
        ("velocity_lag", "backlash"),
        ("torque_sensor_lag", "torque_gain"),
        ("torque_gain", "torque_bias"),
    ):
        assert names.index(before) < names.index(after)


def test_calibration_is_what_eq_14_takes_up() -> None:
    """Four shifts of constants, and three effects of the log; the rest are part of the device."""
    kinds = {kind: {n for n, law in CATALOGUE.items() if law.kind == kind} for kind in ("calibration", "sensor")}
    assert kinds["calibration"] == {"current_gain", "encoder_offset", "torque_bias", "torque_gain"}
    assert kinds["sensor"] == {"velocity_lag", "torque_sensor_lag"}


def test_every_file_of_a_law_is_listed_once() -> None:
    """One line per file that defines a law, and no law without; each is called as its file is."""
    folder = Path(catalogue.__file__).parent
    files = {path.stem for path in folder.glob("*.py") if "LAW = EffectLaw(" in path.read_text(encoding="utf-8")}
    laws = {path.stem for path in (folder / "laws").glob("*.py")} - {"__init__", "hysteresis"}
    assert files == set(CATALOGUE) and sorted(catalogue.EFFECTS) == sorted(files)
    assert [law.name for law in catalogue.LAWS] == list(catalogue.EFFECTS)
    assert laws == set(HYSTERESIS) == {law.name for law in HYSTERESIS.values()}


def test_the_method_knows_no_effect_by_its_name() -> None:
    """Effects themselves declare which others they stand in for, and which hide them."""
    method = [
        path
        for room in ("diagnose", "identify", "sysid")
        for path in (Path(mrwarp.__file__).parent / room).rglob("*.py")
    ]
    found = set()
    for path in method:
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        found |= {(path.name, node.value) for node in nodes if isinstance(node, ast.Constant) and node.value in KNOWN}
    assert found == SPOKEN_OF


@pytest.mark.parametrize("name", list(KNOWN))
def test_effects_that_a_declaration_speaks_of_are_there(name: str) -> None:
    """Those that it contains, that hide it, or that look like it; and parameters of eq. 14 that it goes with."""
    law = KNOWN[name]
    assert {law.contains, law.hidden_by, *law.looks_like} <= {"", *CATALOGUE} - {name}
    assert {law.in_place_of, *law.taken_up_by} <= {"", *LINEAR}
    assert not law.taken_up_by or law.kind == "calibration"
    for p in law.parameters:
        assert not p.tried_again or (p.starts is not None and not p.negative), "factors of a logarithm"
