"""Statements on a device: options win over the header; values without sense are refused."""

from dataclasses import replace
from typing import Any

import pytest

from mrwarp.identify.checks.stated import coil_resistance, stated_numbers
from mrwarp.model_file import Model, stated
from mrwarp.params import MrParams
from mrwarp.recording.load import Recording, RecordingError
from tests.identify import synthetic
from tests.models import model_of


def recording(current: str = "A", **header: Any) -> Recording:
    """A short one with a header."""
    found = synthetic.bench_like(3, runs=1, seconds=0.1)
    return replace(found, header=header, units={**found.units, "current": current})


def device(**values: float) -> Model:
    """A device, with what else its file holds."""
    return model_of({**synthetic.TRUTH, **values})


def test_options_win_over_the_header() -> None:
    """Each number says where it comes from; without either there is none."""
    assert stated_numbers(recording()) == {}
    found = stated_numbers(recording(coil_resistance=24, device_mass=0.9), {"coil_resistance": 30.0})
    assert (found["coil_resistance"].value, found["coil_resistance"].source) == (30.0, "given as --coil-resistance")
    assert (found["device_mass"].value, found["device_mass"].unit) == (0.9, "kg")
    assert found["device_mass"].source == "the recording's header"


@pytest.mark.parametrize("value", [0, -4.0, "30 Ohm", True, float("nan"), 1e9])
def test_a_header_that_makes_no_sense_is_refused(value: Any) -> None:
    """With what is allowed."""
    with pytest.raises(RecordingError, match=r"header: coil_resistance = .*allowed: above 0, at most 10000 Ohm"):
        stated_numbers(recording(coil_resistance=value))


def test_no_coil_without_a_current() -> None:
    """Where a voltage or nothing is recorded a resistance that is given is refused, and a header's means nothing."""
    with pytest.raises(ValueError, match="--coil-resistance 30: the recording's control input is in 'V'"):
        stated_numbers(recording("V"), {"coil_resistance": 30.0})
    assert stated_numbers(recording("none", coil_resistance=30.0)) == {}


def test_heat_is_of_the_devices_own_coil() -> None:
    """The diagnosis takes the nominal model's, then the header's, and never that of the paper's device."""
    assert coil_resistance(recording(), None) == coil_resistance(recording(), device()) == 0.0
    assert coil_resistance(recording(coil_resistance=24.0), device()) == 24.0
    assert coil_resistance(recording(coil_resistance=24.0), device(coil_resistance=30.0)) == 30.0
    assert coil_resistance(recording("V", coil_resistance=24.0), device(coil_resistance=30.0)) == 0.0


def test_a_device_has_no_number_of_another() -> None:
    """Neither coil nor bench of the joint that it takes the place of; what is stated of it stays."""
    other = MrParams().replace(coil_resistance=4.0, coil_time_constant=0.02, q_offset=0.1, q_center=0.2)
    mr = device().to_params(other)
    assert (mr.coil.coil_resistance, mr.coil.coil_time_constant) == (0.0, 0.0)
    assert (mr.bouc_wen.q_offset, mr.bouc_wen.q_center) == (0.0, 0.0)
    assert device().not_known == ("coil resistance", "mass", "largest current")
    known = stated(device(current_max=0.8), stated_numbers(recording(coil_resistance=30, device_mass=1.2)))
    assert known.not_known == () and known.to_params(other).coil.coil_resistance == 30.0
