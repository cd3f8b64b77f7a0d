"""The catalogue keeps the contract: tokens, units, bounds, nulls, sources; one file and one line add an effect."""

import ast
import inspect
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

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
from mrwarp.effects.law import STAGES, Ranges

ROOT = Path(__file__).resolve().parents[2]

TOKENS = {
    "coil_lag", "command_delay", "remanence", "current_saturation", "current_gain", "torque_sensor_lag",
    "velocity_lag", "encoder_offset", "torque_bias", "torque_gain", "backlash", "rotor_inertia", "coulomb_friction",
    "friction_asymmetry", "stribeck", "cogging", "current_viscosity", "speed_weakening", "temperature_drift", "wear",
    "compliance_with_backlash", "series_compliance", "load_friction", "position_friction",
}  # fmt: skip
VARIABLES = {"q", "qd", "qdd", "current", "torque", "time", "memory", "frequency"}
RANGES = Ranges(q=0.8, qd=6.0, current=1.5, torque=0.7, dt=0.005, session=240.0)


def test_tokens_are_those_of_the_contract() -> None:
    """All names, each once."""
    assert set(CATALOGUE) == TOKENS and len(LAWS) == len(TOKENS)


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
        if p.form:
            assert p.starts is None and p.preset is None and not p.choices and p is not law.parameters[0]
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
        ("coil_lag", "remanence"), ("remanence", "current_saturation"), ("velocity_lag", "backlash"),
        ("torque_sensor_lag", "torque_gain"), ("torque_gain", "torque_bias"),
    ):  # fmt: skip
        assert names.index(before) < names.index(after)


def test_calibration_is_what_eq_14_takes_up() -> None:
    """Four shifts of constants, and three effects of the log; the rest are part of the device."""
    kinds = {kind: {n for n, law in CATALOGUE.items() if law.kind == kind} for kind in ("calibration", "sensor")}
    assert kinds["calibration"] == {"current_gain", "encoder_offset", "torque_bias", "torque_gain"}
    assert kinds["sensor"] == {"velocity_lag", "torque_sensor_lag"}


def test_every_file_of_a_law_is_listed_once() -> None:
    """One import and one entry per file that defines a law, and no law without."""
    folder = Path(catalogue.__file__).parent
    files = {path.stem for path in folder.glob("*.py") if "LAW = EffectLaw(" in path.read_text(encoding="utf-8")}
    tree = ast.parse(inspect.getsource(catalogue))
    entries = [node.value.id for node in ast.walk(tree) if isinstance(node, ast.Attribute) and node.attr == "LAW"
               and isinstance(node.value, ast.Name)]  # fmt: skip
    laws = {path.stem for path in (folder / "laws").glob("*.py")} - {"__init__", "hysteresis"}
    assert files == TOKENS and sorted(entries) == sorted(files | laws)
    assert laws == set(HYSTERESIS) == {law.name for law in HYSTERESIS.values()}


NEW_LAW = '''
"""Hum: ``H*sin(2*pi*f*t)``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def hum_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """A torque that hums with the mains."""
    s.torque = s.torque + values[row, at] * wp.sin(2.0 * wp.pi * values[row, at + 1] * s.time)
    return s


LAW = EffectLaw(
    name="hum", title="hum", sentence="A torque that hums with the mains.", equation="H*sin(2*pi*f*t)",
    kind="mechanism", stage="torque", source="made up", law=hum_law, depends_on=("time",),
    parameters=(
        EffectParameter(name="size", unit="N·m", scale=(0, 0, 1)),
        EffectParameter(name="frequency", unit="Hz", negative=False, low=lambda r: 40.0, high=lambda r: 60.0,
                        starts=lambda r: (45.0, 50.0, 55.0)),
    ),
)
'''

RUN = """
import importlib.util
import sys

import numpy as np

folder, sign = sys.argv[1:]
import mrwarp.effects as package

package.__path__.append(folder)
source = open(f"{package.__path__[0]}/catalogue.py", encoding="utf-8").read()
source = source.replace("import (", "import (hum,", 1).replace("    wear.LAW,", "    wear.LAW, hum.LAW,", 1)
spec = importlib.util.spec_from_loader("mrwarp.effects.catalogue", loader=None)
module = importlib.util.module_from_spec(spec)
sys.modules[spec.name] = package.catalogue = module
exec(compile(source, spec.name, "exec"), module.__dict__)

import warp as wp

wp.config.log_level = wp.LOG_WARNING
from tests.effects import along

shaft = along.Shaft.swinging(seconds=1.0)
plain, hum = along.torques(shaft, along.TRUTH, [{}, {"hum": {"size": 0.3, "frequency": 50.0}}]).astype(float)
want = float(f"{sign}0.3") * np.sin(2.0 * np.pi * 50.0 * shaft.time)
np.testing.assert_allclose(hum - plain, want, rtol=0, atol=1e-4)
assert np.abs(want).max() > 0.2

from mrwarp.identify.parameters import slots_of
from mrwarp.model_file import make_effect

assert [s.parameter.name for s in slots_of("hum")] == ["size", "frequency"]
assert make_effect("hum", {"size": 0.3, "frequency": 50.0}).values == {"size": 0.3, "frequency": 50.0}
print("hum acts")
"""


def test_effect_is_added_by_one_file_and_one_line(tmp_path: Path) -> None:
    """A made-up law in a file of its own, named in the catalogue, acts in the kernels, is searched and can be stored.

    Then its sign is edited: the kernels are compiled again. In processes of their own, for the path is composed when it
    is loaded.
    """
    for sign in ("+", "-"):
        text = NEW_LAW.replace("s.torque + values", f"s.torque {sign} values")
        (tmp_path / "hum.py").write_text(text, encoding="utf-8")
        command = [sys.executable, "-c", textwrap.dedent(RUN), str(tmp_path), sign]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode == 0, done.stderr
        assert done.stdout.split("\n")[-2] == "hum acts"
