"""The report: every verdict, everything from data escaped, one offline file."""

import dataclasses
import math
import re
from pathlib import Path

import pytest

from mrwarp.diagnose import verdict_text as text
from mrwarp.diagnose.held_out import Account, Share
from mrwarp.diagnose.law_choice import LawChoice
from mrwarp.diagnose.report.diagnosis_page import render
from mrwarp.diagnose.report.overview_pictures import NAMES
from mrwarp.diagnose.report.printed import lines
from mrwarp.effects.catalogue import CATALOGUE, parameter_of
from mrwarp.sysid.report.page import Table
from mrwarp.sysid.report.words import chance, percent
from mrwarp.sysid.verdict import Cause, Value
from tests.diagnose import made_up

EVIL = "<script>alert('x')</script>\" onload=\"y"


@pytest.mark.parametrize("verdict", ["none", "named", "unexplained", "named_and_unexplained", None])
def test_the_page_stands_alone(verdict) -> None:
    """One page without any address in it, with the verdict at its top and the command at its end."""
    d = made_up.make(verdict)
    drawn = dict.fromkeys(NAMES if verdict else ("data",), b"PNG")
    page = render(d, "mrwarp diagnose data", pictures=drawn)
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    assert "<script" not in page and "://" not in page
    assert d.sentence in page and "mrwarp diagnose data" in page
    assert page.count("<img") == (1 if verdict is None else 9)


def test_a_named_cause_is_explained() -> None:
    """Sentence, equation, remedy and parameters of the law, the alternative and the experiment."""
    page = render(made_up.make("named"), "c", pictures={})
    law = CATALOGUE["coil_lag"]
    for part in (
        law.sentence,
        law.equation,
        "10.00 ms",
        "9.70 to 10.40 ms",
        "command delay",
        "20 s are enough",
        "40.0 %",
    ):
        assert part in page, part
    assert "raise the current controller&#39;s bandwidth" in page
    assert "temperature" in page and "The session lasts 30 s" in page


def test_without_a_verdict_nothing_looks_like_one() -> None:
    """Open questions and the recording to make; no gain, no cause, no table of sizes."""
    page = render(made_up.make(None), "c", pictures={})
    assert "No verdict" in page and "record 30 s of 1 Hz swings" in page and "Step the current" in page
    for word in ("Coil lag", "What was tried", "Where the mismatch goes", "gains", "nan", "NRMSE"):
        assert word not in page, word


def test_none_names_nothing() -> None:
    """No gain is claimed where nothing was added; the smallest sizes are listed."""
    page = render(made_up.make("none"), "c", pictures={})
    assert "What the extended model gains" not in page
    assert "What these data could have shown" in page and "2 mrad" in page


def test_everything_from_data_is_escaped(tmp_path: Path) -> None:
    """Names of trajectories and files, headers, notes, the command: nothing of them becomes markup."""
    d = made_up.make("named_and_unexplained")
    runs = tuple(dataclasses.replace(r, id=f"{EVIL}{k}") for k, r in enumerate(d.recording.trajectories))
    recording = dataclasses.replace(
        d.recording, trajectories=runs, source=tmp_path / EVIL.replace("/", "&"), header={EVIL: EVIL}
    )
    assert d.gain and d.unexplained and d.next_experiment
    changed = dataclasses.replace(
        d,
        recording=recording,
        sentence=EVIL,
        notes=(EVIL,),
        cannot_know=(EVIL,),
        invisible={EVIL: EVIL},
        gain=dataclasses.replace(d.gain, held_out=(EVIL,)),
        unexplained=dataclasses.replace(d.unexplained, form=EVIL, formula=EVIL, depends_on=(EVIL,)),
        next_experiment=dataclasses.replace(d.next_experiment, what=EVIL, kind=EVIL, separates=(EVIL,)),
        tried=(dataclasses.replace(d.tried[0], name=EVIL, outcome=EVIL),),
        causes=(dataclasses.replace(d.causes[0], name=EVIL, alternatives=(EVIL,)),),
    )
    tables = Table(head=(EVIL,), rows=[(EVIL,)])
    page = render(changed, EVIL, impact=tables, learned=tables, predicted=tables, pictures={})
    assert "<script" not in page
    assert 'onload="' not in page
    assert page.count("&lt;script&gt;") > 20


def test_a_name_that_utf8_cannot_write(tmp_path: Path) -> None:
    """Undecodable bytes of a file name do not stop the report."""
    d = made_up.make("none")
    page = render(dataclasses.replace(d, notes=("bad \udcff name",)), "c", pictures={})
    assert "bad ? name" in page


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (0.0123, "s", "12.30 ms"),
        (0.0021, "rad", "2.100 mrad"),
        (1e-5, "1/s", "0.06 % per minute"),
        (0.01, "m", "10.00 mm"),
        (3.2, "N·m", "3.20 N·m"),
        (0.004, "kg·m²", "40.0 kg·cm²"),
        (0.7, "unknown", "0.70 unknown"),
    ],
)
def test_units_are_sensible(value: float, unit: str, expected: str) -> None:
    """As many digits as the interval carries, in the unit that an engineer would use."""
    half = abs(value) * 0.04
    found = text.readable(Value(value=value, ci95=(value - half, value + half), unit=unit))
    number, _, name = found.value.partition(" ")
    wanted, _, wanted_name = expected.partition(" ")
    assert name == wanted_name
    assert float(number) == pytest.approx(float(wanted), rel=0.05)
    assert found.interval.endswith(name)


def test_one_quantity_has_one_unit_in_a_table() -> None:
    """A small torque has the unit of the large one, on the page and in the terminal; times of other sizes do not."""
    sizes = {
        "coulomb_friction": (0.02, "N·m"),
        "stribeck": (3.0, "N·m"),
        "coil_lag": (0.012, "s"),
        "wear": (1e-5, "1/s"),
    }
    values = {name: Value(value=x, ci95=(0.9 * x, 1.1 * x), unit=unit) for name, (x, unit) in sizes.items()}
    page = render(dataclasses.replace(made_up.make(), detectable=values), "c", pictures={})
    assert "0.02 N·m" in page and "20 mN·m" not in page and "12 ms" in page
    causes = tuple(
        Cause(name=name, parameters={"torque": values[name]}, p_value=1e-9, alternatives=(), gain=0.3)
        for name in ("coulomb_friction", "stribeck")
    )
    printed = "\n".join(lines(dataclasses.replace(made_up.make(), causes=causes), {}))
    assert "0.0200 N·m" in printed.replace("0.020 N·m", "0.0200 N·m") and "mN·m" not in printed
    errors = made_up.make()
    assert f"{errors.baseline.rmse:.3g} N·m" in printed and f"{errors.extended.rmse:.3g} N·m" in printed
    largest = text.largest_of([values["coil_lag"], Value(value=1200.0, ci95=(1e3, 2e3), unit="s")])
    assert text.readable(values["coil_lag"], largest=largest).value.endswith(" ms")


def test_no_number_of_the_page_has_a_power_of_ten_for_its_size() -> None:
    """150 kg·cm² and 40000 N·m/rad are not 1.5e+02 and 4e+04, neither as a smallest size nor as a cause's number."""
    large = Value(value=0.01504, ci95=(0.01504, 0.01504), unit="kg·m²")
    stiff = Value(value=40120.0, ci95=(-math.inf, math.inf), unit="N·m/rad")
    cause = Cause(name="series_compliance", parameters={"x": stiff}, p_value=1e-9, alternatives=(), gain=0.3)
    soft = Value(value=0.00029, ci95=(0.00029, 0.00029), unit="rad/(N·m)")
    sizes = {"rotor_inertia": large, "series_compliance": soft}
    changed = dataclasses.replace(made_up.make(), detectable=sizes, causes=(cause,))
    page = render(changed, "c", pictures={})
    assert "0.00029 rad/(N·m) (3450 N·m/rad)" in page
    assert "150 kg·cm²" in page and "40120 N·m/rad" in page and "e+0" not in page


def test_a_factor_is_a_change_in_per_cent() -> None:
    """A gain of 1.03 reads +3 %."""
    value = Value(value=1.03, ci95=(1.02, 1.04), unit="1")
    assert text.readable(value, parameter_of("torque_gain", "gain")).value == "+3.00 %"


def test_numbers_without_an_interval_survive() -> None:
    """Infinities and NaN are words, never 'inf' or 'nan'."""
    for bad in (float("inf"), float("nan")):
        found = text.readable(Value(value=0.01, ci95=(-bad, bad), unit="s"))
        assert "inf" not in found.value + found.interval and "nan" not in found.value + found.interval
    assert chance(float("nan")) == "unknown" and percent(float("inf")) == "unknown"


def test_no_bound_is_above_what_a_model_reached() -> None:
    """Boosting that leaves more than the extended model does sets no limit to models."""
    d = made_up.make("named")
    share = Share(share=0.0, ci95=(0.0, 0.0))
    rest = dataclasses.replace(share, share=1.0)
    account = Account(named=share, repeatable=share, not_repeatable=rest, left=0.1, cycle_spread=None, learnable=share)
    page = render(dataclasses.replace(d, account=account), "c", pictures={})
    shown = re.findall(r"([\d.]+) %[^%]*no model gets below", page)
    assert shown == [percent(d.extended.nrmse).split()[0]] and d.extended.nrmse < d.baseline.nrmse


def test_a_law_that_gains_nothing_states_no_error_and_cogging_is_per_turn() -> None:
    """Two errors that print as one are no gain; what repeats along an angle is counted per turn."""
    for after, shown in ((0.9976, False), (0.9, True)):
        law = LawChoice(name="dahl", held_out={"bouc_wen": 0.998, "dahl": after}, rival=0.998, simpler=True)
        sentence = text.sentence_of(dataclasses.replace(made_up.make("none"), law=law))
        assert "simpler" in sentence and ("→" in sentence) is shown
    periods = Value(value=14.007, ci95=(14.005, 14.009), unit="1/rad")
    assert text.readable(periods, parameter_of("cogging", "periods")).value == "14.01 per turn"
