"""A control input in bar is called pressure wherever a reader meets it."""

import re
from dataclasses import replace

import pytest

from mrwarp.diagnose.report.diagnosis_page import render
from mrwarp.diagnose.report.printed import lines
from mrwarp.diagnose.verdict_text import sentence_of
from mrwarp.recording.data import true_names
from tests.diagnose.made_up import make


@pytest.mark.parametrize(
    ("unit", "text"),
    [
        ("A", "viscosity that grows with current"),
        ("bar", "viscosity that grows with pressure"),
        ("%", "viscosity that grows with control input"),
        ("N·m", "viscosity that grows with load torque"),
    ],
)
def test_the_control_input_is_called_what_it_is(unit: str, text: str) -> None:
    """Words change, tokens of the JSON do not."""
    units = {"q": "m", "current": unit, "torque": "N"}
    assert true_names("viscosity that grows with current", units) == text
    assert true_names("current_viscosity.B1", units) == "current_viscosity.B1"


def test_report_and_terminal_speak_of_pressure() -> None:
    """No "current" and no A in the page, the printed lines and the sentence of a device driven by air."""
    d = make("named_and_unexplained")
    d = replace(d, recording=replace(d.recording, units={"q": "m", "current": "bar", "torque": "N"}))
    seen = re.sub(
        r"data:image[^\"]*|<style.*?</style>|<[^>]+>", " ", render(d, "diagnose", pictures={}), flags=re.DOTALL
    )
    for text in (seen.partition("Data")[0], sentence_of(d), *lines(d, {})):
        assert not re.search(r"\bcurrents?\b", text), text
    assert "pressure" in seen
