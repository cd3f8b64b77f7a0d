"""Verdicts follow from figures by the stated rule, and what is counted is counted once."""

import re
import runpy
import sys
from collections import Counter
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

from mrwarp.paper import PaperValue
from paper.reproduce import contents, pages, report_page
from paper.reproduce.cache import Experiment
from paper.reproduce.comparison import Findings, compare
from paper.reproduce.contents import Mark
from paper.reproduce.registry import CATALOGUE, CLAIMS, judge_all
from paper.reproduce.verdicts import (
    BY_EFFECT,
    Claim,
    Figure,
    Judged,
    Results,
    Verdict,
    by_effect,
    change,
    judge,
    rows,
)


def results(
    *cells: tuple[str, float, float | None, float, float | None], part: str = "part", holds: bool = True, **more: object
) -> Results:
    """Rows by condition, the paper's figure and SD, ours and SD over three seeds; ``more`` of every row."""
    made = [
        {
            "condition": name,
            "quantity": "x",
            "paper": {"mean": theirs, "sd": sd},
            "ours": ours,
            "sd": spread,
            "n": 3,
            "digits": 3,
            "calibrated": False,
            **more,
        }
        for name, theirs, sd, ours, spread in cells
    ]
    entry = {"rows": made, "claims": {"it holds": holds}, "claim_ids": {"it": "it holds"}}
    return Results({part: {**entry, "reasons": {"drop/reasoned": "as the run says"}}})


def claim(name: str = "drop/a", **given) -> Claim:
    """A claim on the rows a and b."""
    given = {"measure": rows("part", "x", "a", "b"), **given}
    return Claim(id=name, place="", says="", **given)


EFFECT = {"effect": True, "measure": rows("part", "x", "a")}


@pytest.mark.parametrize(
    ("ours", "verdict"),
    [((1.0, 2.1), Verdict.REPRODUCED), ((1.0, 3.0), Verdict.DIRECTION), ((2.0, 1.0), Verdict.NOT)],
)
def test_levels_are_judged_by_agreement_then_by_order(ours: tuple[float, float], verdict: Verdict) -> None:
    """The paper's two figures differ by more than their spread: their order is the direction."""
    found = results(("a", 1.0, 0.1, ours[0], 0.1), ("b", 2.0, 0.1, ours[1], 0.1))
    assert judge(claim(), found).verdict is verdict
    assert judge(claim(), found).mark is Mark.PREDICTED


def test_a_lone_level_that_disagrees_is_not_reproduced() -> None:
    """It has no direction; within 5 % it agrees where the paper states no spread."""
    lone = claim(measure=rows("part", "x", "a"))
    assert judge(lone, results(("a", 1.0, None, 1.2, 0.5))).verdict is Verdict.NOT
    assert judge(lone, results(("a", 1.0, None, 1.04, None))).verdict is Verdict.REPRODUCED


def test_effects_are_judged_by_sign_and_named_claims() -> None:
    """A change of the other sign is not reproduced, nor is one whose entry says that the claim fails."""
    named = claim(effect=True, holds=(("part", "it"),), measure=change("part", "x", ("a", "b")))
    lower = results(("a", 2.0, None, 4.0, None), ("b", 1.0, None, 3.9, None))
    assert judge(named, lower).verdict is Verdict.DIRECTION
    assert judge(named, lower).figures[0].ours == pytest.approx(-2.5)
    higher = results(("a", 2.0, None, 4.0, None), ("b", 1.0, None, 4.1, None))
    assert judge(named, higher).verdict is Verdict.NOT
    missed = results(("a", 2.0, None, 4.0, None), ("b", 1.0, None, 2.0, None), holds=False)
    assert judge(named, missed).verdict is Verdict.NOT


@pytest.mark.parametrize(
    ("ours", "sd", "verdict"),
    [
        (-10.0, 1.0, Verdict.REPRODUCED),
        (-5.0, 1.0, Verdict.DIRECTION),
        (-5.0, 9.0, Verdict.UNRESOLVED),  # ± 22: zero and the paper's −10 lie in it
        (+8.0, 9.0, Verdict.UNRESOLVED),
        (-0.1, 1.0, Verdict.NOT),  # ± 2.5: too small, of either sign
        (+8.0, 1.0, Verdict.NOT),
    ],
)
def test_what_seeds_cannot_tell_is_unresolved(ours: float, sd: float, verdict: Verdict) -> None:
    """By the 95 % interval of three seeds, 2.48 SD: neither the other sign nor agreement may be claimed within it."""
    judged = judge(claim(**EFFECT), results(("a", -10.0, None, ours, sd)))
    assert judged.verdict is verdict
    assert (judged.needed is not None) == (verdict is Verdict.UNRESOLVED)


def test_it_says_how_many_seeds_would_tell() -> None:
    """So many that an interval is narrower than the paper's effect: 15 of them have t = 2.14."""
    judged = judge(claim(**EFFECT), results(("a", -10.0, None, -5.0, 9.0)))
    assert judged.needed == 15
    assert 2.0 * judged.figures[0].half_width(15) < 10.0 <= 2.0 * judged.figures[0].half_width(14)
    assert pages.claim_row(judged)[-2] == "unresolved: 15 seeds would decide"
    never = judge(claim(**EFFECT), results(("a", -0.01, None, -5.0, 900.0)))
    assert pages.claim_row(never)[-2] == "unresolved: more than 10000 seeds would decide"


def test_levels_of_the_same_seeds_are_separated_seed_by_seed() -> None:
    """Each is 1 below the other, at any level: the order is resolved only where the seeds are known."""
    cells = ("a", 1.0, 0.1, 2.0, 2.0), ("b", 2.0, 0.1, 3.0, 2.0)
    assert judge(claim(), results(*cells)).verdict is Verdict.UNRESOLVED
    found = results(*cells)
    for row, begin in zip(found.parts["part"]["rows"], (0.0, 1.0), strict=True):
        row["seeds"] = [begin + 0.0, begin + 2.0, begin + 4.01]
    assert judge(claim(), found).verdict is Verdict.REPRODUCED


def test_calibrated_figures_are_neither_hit_nor_miss() -> None:
    """A claim of them alone is calibrated, however far it is off; next to others they take no part."""
    fitted = judge(claim(), results(("a", 1.0, None, 5.0, None), ("b", 2.0, None, 1.0, None), calibrated=True))
    assert fitted.verdict is Verdict.CALIBRATED and fitted.mark is Mark.CALIBRATED
    assert pages.claim_row(fitted)[-3:-1] == ["calibrated", ""]
    mixed = results(("a", 1.0, None, 5.0, None), ("b", 2.0, None, 2.0, None))
    mixed.parts["part"]["rows"][0]["calibrated"] = True
    assert judge(claim(), mixed).verdict is Verdict.REPRODUCED


def test_one_effect_counts_once_by_its_worst_claim() -> None:
    """Two claims on one effect, one on another, and two that are none: a calibrated one and a contradiction."""

    def judged(name: str, verdict: Verdict, mark: Mark = Mark.PREDICTED) -> Judged:
        return Judged(claim=claim(name), figures=(), verdict=verdict, mark=mark)

    counted = by_effect(
        [
            judged("drop/height", Verdict.REPRODUCED),
            judged("drop/speed", Verdict.UNRESOLVED),
            judged("torque", Verdict.DIRECTION),
            judged("power/fit", Verdict.CALIBRATED, Mark.CALIBRATED),
            judged("paper.odd", Verdict.EXCLUDED),
            judged("saving", Verdict.NOT, Mark.IN_VIEW),
        ]
    )
    assert counted[Mark.PREDICTED] == dict(zip(BY_EFFECT, (0, 1, 1, 0), strict=True))
    assert counted[Mark.IN_VIEW] == dict(zip(BY_EFFECT, (1, 0, 0, 0), strict=True))


def test_spread_of_a_change_is_that_of_a_ratio() -> None:
    """10 % of either figure is 14 % of their ratio."""
    found = results(("a", 2.0, 0.2, 2.0, 0.2), ("b", 1.0, 0.1, 1.0, 0.1))
    figure = change("part", "x", ("a", "b"))(found)[0]
    assert figure.sd == pytest.approx(50.0 * 0.02**0.5)


def test_a_paired_change_is_each_seeds_own() -> None:
    """Seeds that differ by a factor of four lose a tenth each: no spread, and a sign; without them nothing is known."""
    found = results(("a", 2.0, 0.2, 2.3, 1.5), ("b", 1.8, 0.1, 2.1, 1.4))
    first, second = found.parts["part"]["rows"]
    assert change("part", "x", ("a", "b"), paired=True)(found)[0].sd is None
    first["seeds"], second["seeds"] = (1.0, 2.0, 4.0), (0.9, 1.8, 3.6)
    figure = change("part", "x", ("a", "b"), paired=True)(found)[0]
    assert (figure.ours, figure.sd) == (pytest.approx(-10.0), pytest.approx(0.0, abs=1e-9))
    assert figure.sign() is Verdict.DIRECTION
    assert change("part", "x", ("a", "b"))(found)[0].sign() is not Verdict.DIRECTION


def test_a_difference_without_a_spread_has_none() -> None:
    """Its sign is taken as it stands."""
    one, two = (Figure(paper=value, ours=value) for value in (1.0, 2.0))
    assert two.minus(one).sd is None and two.minus(one).sign() is Verdict.DIRECTION


def test_contradictions_of_the_paper_need_no_figure() -> None:
    """They are excluded with any result."""
    assert judge(claim(measure=None, excluded=True), results()).verdict is Verdict.EXCLUDED


def test_the_entrys_reason_goes_before_the_written_one() -> None:
    """It has the figures of the run; a claim of which it says nothing keeps its own."""
    found = results(("a", 1.0, 0.1, 1.0, 0.1), ("b", 2.0, 0.1, 2.0, 0.1))
    assert judge(claim("drop/reasoned", why="as written"), found).why == "as the run says"
    assert judge(claim("drop/other", why="as written"), found).why == "as written"


def test_unknown_rows_claims_and_tables_are_named() -> None:
    """A claim whose row was renamed is no silent gap; a sentence is no identifier."""
    with pytest.raises(KeyError, match="no row 'b'"):
        results(("a", 1.0, None, 1.0, None)).row("part", "b", "x")
    with pytest.raises(KeyError, match="no claim 'it holds'"):
        results().holds("part", "it holds")
    with pytest.raises(KeyError, match="no table 'grid'"):
        Results({"part": {"tables": [{"title": "grid", "id": ""}]}}).table("part", "grid")


def test_a_table_is_its_file_and_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """A file with an experiment and a claim, and its line among the contents: it is made, judged, and marked."""
    toy = ModuleType("paper.reproduce.toy")
    made, about = Experiment(name="table9", compute=lambda job: Findings()), rows("table9", "x", "a")
    vars(toy).update(EXPERIMENTS=(made,), CLAIMS=(Claim(id="toy.x", place="Table 9", says="x", measure=about),))
    monkeypatch.setitem(sys.modules, toy.__name__, toy)
    monkeypatch.setitem(contents.CONTENTS, "table9", contents.Entry("toy", "Table 9: x", Mark.PREDICTED))
    registry = runpy.run_path(str(Path(contents.__file__).with_name("registry.py")))
    assert registry["CATALOGUE"]["table9"] is made
    found = registry["judge_all"](results(("a", 1.0, None, 1.01, None), part="table9"))
    [judged] = [each for each in found if each.claim.entry == "table9"]
    assert (judged.verdict, judged.mark) == (Verdict.REPRODUCED, Mark.PREDICTED)


def test_every_claim_stands_in_the_file_that_makes_its_entry() -> None:
    """So does every entry's experiment."""
    for name, entry in contents.CONTENTS.items():
        file = import_module(f"paper.reproduce.{entry.module}")
        assert name in {experiment.name for experiment in file.EXPERIMENTS}
        assert {claim.id for claim in CLAIMS if claim.entry == name} <= {c.id for c in getattr(file, "CLAIMS", ())}
    assert CATALOGUE.keys() == contents.CONTENTS.keys() | contents.SIMULATIONS.keys()


@pytest.mark.parametrize(("paper", "sd"), [(1.0, 0.1), (-2.0, 0.1), (-2.0, None), (3.0, None)])
@pytest.mark.parametrize("share", [0.8, 0.96, 1.0, 1.04, 1.3, -0.5])
def test_rows_and_claims_are_compared_by_one_rule(paper: float, sd: float | None, share: float) -> None:
    """A row of the report and a claim's figure agree or not together; a difference is positive if ours is larger."""
    row = compare("a", ("x", "", 3), PaperValue(mean=paper, sd=sd), {"ours": share * paper, "sd": sd})
    found = results(("a", paper, sd, share * paper, sd)).row("part", "a", "x")
    assert row.differs is not found.agrees
    assert found.relative == pytest.approx(share - 1.0)
    shown = report_page.cells(row)
    assert shown[4] == f"{100.0 * (share - 1.0):+.1f} %"
    half = 0.05 + 1e-9  # of one decimal
    assert sd is None or float(shown[5]) == pytest.approx((share - 1.0) * abs(paper) / (sd * 2.0**0.5), abs=half)


def test_every_claim_finds_its_rows() -> None:
    """In the committed results; each has an identifier of its own, a verdict and a sentence."""
    parts = pages.read()["parts"]
    found = judge_all(Results(parts))
    assert len(found) == sum(claim.entry in {"", *parts} for claim in CLAIMS)
    assert all(judged.why.endswith((".", "?")) for judged in found)
    assert max(Counter(claim.id for claim in CLAIMS).values()) == 1
    marks = {(j.claim.about, j.mark) for j in found if j.verdict in BY_EFFECT}
    assert max(Counter(about for about, _ in marks).values()) == 1, "an effect that is both predicted and in view"


def test_readme_compares_in_three_sentences() -> None:
    """All effects are counted, by verdict; it says how many were predicted, and where each claim stands."""
    found = Results(pages.read()["parts"])
    text = pages.BLOCKS["readme"](found)
    assert len(re.findall(r"\.(?= |$)", re.sub(r"\]\([^)]*\)", "]", text))) == 3
    total, *parts = (int(n) for n in re.findall(r"(\d+) (?:physical|reproduced|with|not)", text))
    assert sum(parts) == total == sum(sum(n.values()) for n in by_effect(judge_all(found)).values())
    assert "(docs/reproduce.md)" in text and "predicted" in text
