"""The first screen answers four questions in sixty words for any verdict; one unit for each quantity."""

import dataclasses
import html
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from mrwarp.diagnose.checks.spikes import Spikes
from mrwarp.diagnose.report import overview_pictures as pictures
from mrwarp.diagnose.report.diagnosis_page import render
from mrwarp.diagnose.report.printed import lines
from mrwarp.diagnose.result import Tried
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.robot_logs.report import log_page, log_pictures
from mrwarp.robot_logs.robot_verdict import NamedCause
from mrwarp.sysid.report import pictures as shared
from mrwarp.sysid.report.page import MOST_WORDS, fitted
from mrwarp.sysid.verdict import Cause, Gain, Suspect, Value
from tests.diagnose import made_up

VERDICTS = ("none", "named", "unexplained", "named_and_unexplained", None)


def first(page: str) -> str:
    """Text of a page before its first section."""
    return html.unescape(re.sub(r"<[^>]+>", " ", page[page.index("<body>") : page.index("<h2>")]))


def answers(page: str) -> dict[str, str]:
    """Questions and answers of the first screen."""
    return {html.unescape(q): html.unescape(a) for q, a in re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", page)}


def cause(name: str) -> Cause:
    """A cause of 3 of its unit."""
    number = CATALOGUE[name].parameters[0]
    value = Value(value=3.0, ci95=(2.5, 3.5), unit=number.unit)
    return Cause(name=name, parameters={number.name: value}, p_value=1e-9, alternatives=tuple(CATALOGUE), gain=0.1)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_any_verdict_is_read_at_a_glance(verdict: Any, tmp_path: Path) -> None:
    """Also with every effect of the catalogue as cause, rival and suspect, and a name of many words."""
    plain = made_up.make(verdict)
    suspect = Suspect(name="stribeck", reason="why " * 40, parameters={}, gain=0.1)
    crowded = dataclasses.replace(
        plain,
        causes=tuple(map(cause, CATALOGUE)) if plain.causes else (),
        suspects=(suspect,) * 9,
        recording=dataclasses.replace(plain.recording, source=tmp_path / ("a name of many words " * 9)),
    )
    for d in (plain, crowded):
        page = render(d, "c", pictures={})
        assert len(first(page).split()) <= MOST_WORDS
        assert list(answers(page)) == ["What is missing", "How big", "How sure", "What to do"]
        assert all(answers(page).values())


def test_the_answers_are_those_of_the_verdict() -> None:
    """A cause with its size, interval, rival and remedy; nothing; no verdict."""
    named = answers(render(made_up.make("named"), "c", pictures={}))
    assert named["What is missing"].startswith("Coil lag") and named["How big"].startswith("10.00 ms; error ")
    assert "9.70 to 10.40 ms" in named["How sure"] and "command delay" in named["How sure"]
    assert named["What to do"].startswith("Raise the current controller's bandwidth")
    none = answers(render(made_up.make("none", parameter_shift=(), next_experiment=None), "c", pictures={}))
    assert none["What is missing"] == "Nothing that these data could show" and none["What to do"] == "Nothing"
    assert "cannot carry a verdict" in answers(render(made_up.make(None), "c", pictures={}))["What is missing"]


def test_what_no_device_has_is_not_suspected_at_first_sight() -> None:
    """Wear that gives torque back stands with its reason where what was tried is listed; what may be there, above."""
    rate = Value(value=-0.0067, ci95=(-0.008, -0.005), unit="1/s")
    reason = "it would be negative: what wears loses torque"
    wear = Suspect(name="wear", reason=reason, parameters={"rate": rate}, gain=0.2, possible=False)
    lag = Suspect(name="coil_lag", reason="its 95 % interval contains zero", parameters={}, gain=0.1)
    tried = Tried(name="wear", gain=0.2, error=0.01, values={}, outcome=f"rejected: {reason}")
    for suspects, said in (((wear,), "smaller effects"), ((wear, lag), "suspected, not proven: Coil lag")):
        d = made_up.make("none", suspects=suspects, tried=(tried,), detectable={}, next_experiment=None)
        page = html.unescape(render(d, "c", pictures={}))
        sure = answers(page)["How sure"]
        assert "wear" not in sure.lower() and said.lower() in sure.lower()
        assert page.count(reason) == 1 and "per minute" not in page and "Suspected, but not proven: Wear" not in page
        assert ("<h2>Suspects</h2>" in page) == (lag in suspects)
        printed = "\n".join(lines(d, {}))
        assert f"not possible: wear: {reason}" in printed and "not proven: wear" not in printed


def test_phrases_that_do_not_fit_are_left_out_whole() -> None:
    """The first stands always, cut if it must be; a later one only where it fits."""
    assert fitted(["a b", "c d e", "f"], 4) == "a b; f"
    assert fitted(["a b c d e"], 3) == "a b c…"
    assert fitted(["", "a"], 3) == "a"


def test_one_quantity_has_one_unit_on_a_page() -> None:
    """A lag is given in ms alone, a torque as on the axes of the pictures."""
    text = re.sub(r"<[^>]+>", " ", render(made_up.make("named"), "c", pictures={}))
    assert "10.00 ms" in text and not re.search(r"\b0\.0\d+ s\b", text) and "model.json" not in text
    assert "N·m" in text and "mN·m" not in text


@pytest.mark.parametrize("verdict", ["none", "named_and_unexplained"])
def test_every_picture_has_a_title(verdict: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """It says what is to be seen."""
    seen: list[str] = []

    def titles(figure: Any, dpi: float) -> bytes:
        heading = figure.legends[0].get_title() if figure.legends else figure._suptitle
        seen.append(heading.get_text())
        return b""

    monkeypatch.setattr(shared, "png", titles)
    pictures.draw(made_up.make(verdict))
    assert sorted(seen) == sorted(pictures.TITLES.values())
    assert all(len(title.split()) >= 4 for title in [*pictures.TITLES.values(), *log_pictures.TITLES.values()])


@pytest.mark.parametrize("count", [0, 1, 7])
def test_a_robot_is_answered_as_briefly(count: int) -> None:
    """Place and size of its causes; angles in mrad, times in ms."""
    value = Value(value=0.04, ci95=(0.03, 0.05), unit="rad")
    causes = tuple(
        NamedCause(
            name="encoder_offset",
            where=f"FR_{k}",
            parameters={"angle": value},
            p_value=0.0,
            alternatives=(),
            gain=0.5,
            change={},
        )
        for k in range(count)
    )
    d = SimpleNamespace(
        verdict="named" if count else "none",
        causes=causes,
        unexplained=None,
        suspects=(),
        next_experiment=None,
        gain=Gain(rmse_reduction=0.5, ci95=(0.4, 0.6), held_out=()),
    )
    found = log_page._answers(cast(Any, d))
    assert sum(len(f"{question} {answer}".split()) for question, answer in found) <= MOST_WORDS - 6
    assert [question for question, _ in found] == ["What is missing", "How big", "How sure", "What to do"]
    if count:
        assert found[0][1].startswith("FR_0: encoder offset +40 mrad") and found[1][1].startswith("40 mrad")
        assert found[2][1].startswith("95 %: 30 to 50 mrad")


def test_spikes_are_noted_in_the_terminal() -> None:
    """They are named next to the verdict, and nothing is where there are none."""
    at = np.zeros(6400, dtype=bool)
    spikes = Spikes(samples=88, share=0.014, of_squared_mismatch=0.9, per_trajectory={"run 2": 88}, at=at, known=~at)
    [note] = [line for line in lines(made_up.make(spikes=spikes), {}) if "spikes" in line]
    assert note.startswith("  note: 88 samples (1.4 %) are spikes, most of them in run 2 (88)")
    assert not any("spikes" in line for line in lines(made_up.make(), {}))
