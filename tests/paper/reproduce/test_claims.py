"""Verdicts follow from figures by the stated rule, and what is counted is counted once."""

import re
import runpy
import sys
from collections import Counter
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy import stats

from mrwarp.paper import PaperValue
from paper.reproduce import contents, pages, report_page, verdicts
from paper.reproduce.cache import Experiment
from paper.reproduce.comparison import Findings, compare
from paper.reproduce.registry import CATALOGUE, CLAIMS, judge_all
from paper.reproduce.verdicts import BY_EFFECT, Claim, Figure, Judged, Results, Verdict, by_effect, change, judge, rows

Cell = tuple[str, float, float | None, float, float | None]
"""Condition, the paper's figure and SD, ours and SD."""


def results(*cells: Cell, part: str = "part", holds: bool = True, n: int = 3, **more: object) -> Results:
    """Rows over ``n`` seeds, the paper's over ten; ``more`` of every row."""
    made = [
        {
            "condition": name,
            "quantity": "x",
            "paper": {"mean": theirs, "sd": sd, "n": 10},
            "ours": ours,
            "sd": spread,
            "n": n if spread is not None else 1,
            "digits": 3,
            "calibrated": False,
            **more,
        }
        for name, theirs, sd, ours, spread in cells
    ]
    entry = {"rows": made, "claims": {"it holds": holds}, "claim_ids": {"it": "it holds"}, "tables": []}
    return Results({part: {**entry, "reasons": {"drop/reasoned": "as the run says"}}})


def claim(name: str = "drop/a", *conditions: str, **given) -> Claim:
    """A claim on the rows a and b, or on these."""
    given = {"measure": rows("part", "x", *(conditions or ("a", "b"))), **given}
    return Claim(id=name, place="", says="", **given)


EFFECT = claim("drop/a", "a", effect=True)


def test_intervals_are_welchs_with_a_test_for_every_row() -> None:
    """Against SciPy's of two samples; four tests share the level; errors of fitted numbers join the seeds'."""
    a, b = np.array([1.0, 2.0, 4.0]), np.array([0.5, 0.6, 0.4, 0.9])
    figure = Figure(paper=a.mean(), paper_sd=a.std(ddof=1), paper_n=3, ours=b.mean(), sd=b.std(ddof=1), n=4)
    for tests in (1, 4):
        bounds = stats.ttest_ind(a, b, equal_var=False).confidence_interval(1.0 - 0.05 / tests)
        assert figure.reach(tests) == pytest.approx(0.5 * (bounds.high - bounds.low))
    fitted = Figure(paper=1.0, ours=2.0, sd=0.3, n=3, error=0.4, error_free=2)
    free = (0.03 + 0.16) ** 2 / (0.03**2 / 2 + 0.16**2 / 2)
    assert verdicts.half_width(fitted.own()) == pytest.approx(stats.t.ppf(0.975, free) * 0.19**0.5)
    assert verdicts.half_width([]) == 0.0


def test_the_papers_rows_share_their_spread_unless_it_differs() -> None:
    """Against SciPy's Bartlett test of samples; three each, of which one may be wide by chance but not tenfold."""
    rng = np.random.default_rng(0)
    for widths, equal in (((1.0, 1.0, 1.0, 1.0), True), ((1.0, 1.0, 1.0, 100.0), False)):
        samples = [width * rng.standard_normal(3) for width in widths]
        assert (stats.bartlett(*samples).pvalue > 0.05) == equal
        rows = [Figure(paper=1.0, paper_sd=float(x.std(ddof=1)), paper_n=3, ours=1.0) for x in samples]
        own, shared = ([row.theirs[0] for row in each] for each in (rows, verdicts.pool(rows)))
        pooled = (float(np.sqrt(np.mean([x.var(ddof=1) for x in samples]) / 3)), 8.0)
        np.testing.assert_allclose(shared, [pooled] * 4 if equal else own)


@pytest.mark.parametrize(
    ("theirs", "ours", "verdict"),
    [
        ((-10.0, 1.0), (-10.0, 1.0), Verdict.REPRODUCED),
        ((-10.0, 1.0), (-5.0, 1.0), Verdict.DIRECTION),
        ((-10.0, 10.0), (-8.0, 1.0), Verdict.SIGN),  # ± 7.4: agrees with half of it and with all of it
        ((-10.0, 1.0), (-5.0, 9.0), Verdict.UNRESOLVED),  # ± 22: zero and the paper's −10 lie in it
        ((-10.0, 1.0), (+8.0, 9.0), Verdict.UNRESOLVED),
        ((-10.0, 1.0), (-0.1, 1.0), Verdict.NOT),  # ± 2.5: too small, of either sign
        ((-10.0, 1.0), (+8.0, 1.0), Verdict.NOT),
        ((-49.3, 95.9), (-49.3, 1.0), Verdict.UNRESOLVED),  # ± 69: the paper's own interval holds zero
        ((-10.0, 1.0), (-10.0, None), Verdict.UNRESOLVED),  # one value is no sign
    ],
)
def test_effects(theirs: tuple[float, float], ours: tuple[float, float | None], verdict: Verdict) -> None:
    """By the standard errors of both, ten trials of the paper's and three seeds of ours."""
    judged = judge(EFFECT, results(("a", *theirs, *ours)))
    assert judged.verdict is verdict
    assert verdict is Verdict.UNRESOLVED or judged.needed is None


def test_more_rows_are_more_tests() -> None:
    """An effect that one row resolves is not resolved among six: by chance one of them would be."""
    cells = [(name, -10.0, 1.0, -3.0, 1.0) for name in "abcdef"]
    assert judge(claim("x", "a", effect=True), results(*cells)).verdict is Verdict.DIRECTION
    assert judge(claim("x", *"abcdef", effect=True), results(*cells)).verdict is Verdict.NOT
    wider = [(name, -10.0, 1.0, -10.0, 3.5) for name in "abcdef"]
    assert judge(claim("x", "a", effect=True), results(*wider)).verdict is Verdict.SIGN
    assert judge(claim("x", *"abcdef", effect=True), results(*wider)).verdict is Verdict.UNRESOLVED


@pytest.mark.parametrize(
    ("ours", "verdict"),
    [((1.0, 2.1), Verdict.REPRODUCED), ((1.0, 4.0), Verdict.DIRECTION), ((2.0, 1.0), Verdict.NOT)],
)
def test_levels_are_judged_by_agreement_then_by_order(ours: tuple[float, float], verdict: Verdict) -> None:
    """The paper's two figures differ by more than chance: their order is the direction."""
    found = results(("a", 1.0, 0.1, ours[0], 0.1), ("b", 2.0, 0.1, ours[1], 0.1), n=5)
    assert judge(claim(), found).verdict is verdict


def test_a_lone_level_has_no_direction() -> None:
    """Far away it is not reproduced, near it is; with a wide interval nothing is resolved."""
    lone = claim("drop/a", "a")
    assert judge(lone, results(("a", 1.0, None, 1.3, 0.05))).verdict is Verdict.NOT
    assert judge(lone, results(("a", 1.0, None, 1.04, None))).verdict is Verdict.REPRODUCED
    assert judge(lone, results(("a", 1.0, 0.1, 1.3, 0.5))).verdict is Verdict.UNRESOLVED


def test_named_claims_have_to_hold_and_are_no_reproduction_without_a_figure() -> None:
    """One that fails is not reproduced; one that holds is as the paper says, in words."""
    cell = ("a", -10.0, 1.0, -10.0, 1.0)
    named, words = (claim("x", "a", effect=True, holds=(("part", "it"),), **more) for more in ({}, {"measure": None}))
    assert judge(named, results(cell)).verdict is Verdict.REPRODUCED
    assert judge(words, results(cell)).verdict is Verdict.WORDS
    assert {judge(each, results(cell, holds=False)).verdict for each in (named, words)} == {Verdict.NOT}


def test_it_says_how_many_seeds_would_tell() -> None:
    """So many that an interval is narrower than the paper's effect; none where the paper's own is too wide."""
    judged = judge(EFFECT, results(("a", -10.0, 1.0, -5.0, 9.0)))
    assert judged.needed == 15  # of which t is 2.14
    assert pages.claim_row(judged)[-2] == "not resolved: 15 seeds would decide"
    never = judge(EFFECT, results(("a", -0.01, 0.001, -5.0, 900.0)))
    assert pages.claim_row(never)[-2] == "not resolved: more than 10000 seeds would decide"
    theirs = judge(EFFECT, results(("a", -10.0, 90.0, -5.0, 9.0)))
    fitted = judge(EFFECT, results(("a", -10.0, 1.0, -5.0, 9.0), error=9.0, error_free=2))
    assert theirs.needed is None is fitted.needed and pages.claim_row(theirs)[-2] == "not resolved"


def test_levels_of_the_same_seeds_are_separated_seed_by_seed() -> None:
    """Each is 1 below the other, at any level: the order is resolved only where the seeds are known."""
    cells = ("a", 1.0, 0.1, 2.0, 2.0), ("b", 2.0, 0.1, 3.0, 2.0)
    assert judge(claim(), results(*cells)).verdict is Verdict.UNRESOLVED
    found = results(*cells)
    for row, begin in zip(found.parts["part"]["rows"], (0.0, 1.0), strict=True):
        row["seeds"] = [begin + 0.0, begin + 2.0, begin + 4.01]
    assert judge(claim(), found).verdict is Verdict.SIGN


def test_a_difference_keeps_the_spread_that_there_is() -> None:
    """A standing robot has one value for all seeds, a walking one five: their difference has the latter's."""
    standing, walking = Figure(paper=52.0, ours=53.0), Figure(paper=198.0, ours=191.0, sd=5.0, n=5)
    assert walking.minus(standing).own() == walking.own()
    assert (
        not any(error for error, _ in standing.minus(standing).own())
        and standing.minus(standing).sign() is Verdict.UNRESOLVED
    )


def test_calibrated_figures_are_neither_hit_nor_miss() -> None:
    """A claim of them alone is calibrated, however far it is off; next to others they take no part."""
    fitted = judge(claim(), results(("a", 1.0, None, 5.0, None), ("b", 2.0, None, 1.0, None), calibrated=True))
    assert fitted.verdict is Verdict.CALIBRATED and pages.claim_row(fitted)[-2] == "calibrated"
    mixed = results(("a", 1.0, None, 5.0, None), ("b", 2.0, None, 2.0, 0.01))
    mixed.parts["part"]["rows"][0]["calibrated"] = True
    assert judge(claim(), mixed).verdict is Verdict.REPRODUCED


def test_one_effect_counts_once_by_its_worst_claim() -> None:
    """Two claims on one effect, one on another, and two that are none: a calibrated one and a contradiction."""
    found = {
        "drop/height": Verdict.REPRODUCED,
        "drop/speed": Verdict.UNRESOLVED,
        "torque": Verdict.DIRECTION,
        "power/fit": Verdict.CALIBRATED,
        "paper.odd": Verdict.EXCLUDED,
        "saving": Verdict.NOT,
    }
    counted = by_effect([Judged(claim=claim(name), figures=(), verdict=v) for name, v in found.items()])
    assert {v: n for v, n in counted.items() if n} == dict.fromkeys(
        (Verdict.DIRECTION, Verdict.UNRESOLVED, Verdict.NOT), 1
    )
    assert set(counted) == set(BY_EFFECT)


def test_a_change_has_the_spread_of_a_ratio_or_is_each_seeds_own() -> None:
    """10 % of either figure is 14 % of their ratio; paired seeds that lose a tenth each have no spread, and a sign."""
    found = results(("a", 2.0, 0.2, 2.0, 0.2), ("b", 1.0, 0.1, 1.0, 0.1))
    assert change("part", "x", ("a", "b"))(found)[0].sd == pytest.approx(50.0 * 0.02**0.5)
    found = results(("a", 2.0, 0.2, 2.3, 1.5), ("b", 1.8, 0.1, 2.1, 1.4))
    first, second = found.parts["part"]["rows"]
    assert change("part", "x", ("a", "b"), paired=True)(found)[0].sd is None
    first["seeds"], second["seeds"] = (1.0, 2.0, 4.0), (0.9, 1.8, 3.6001)
    figure = change("part", "x", ("a", "b"), paired=True)(found)[0]
    assert (figure.ours, figure.sd) == (pytest.approx(-10.0, abs=1e-2), pytest.approx(0.0, abs=1e-2))
    assert figure.sign() is Verdict.SIGN and change("part", "x", ("a", "b"))(found)[0].sign() is not Verdict.SIGN


def test_contradictions_and_reasons() -> None:
    """The former are excluded with any result; an entry's reason goes before the written one."""
    assert judge(claim(measure=None, excluded=True), results()).verdict is Verdict.EXCLUDED
    found = results(("a", 1.0, 0.1, 1.0, 0.1), ("b", 2.0, 0.1, 2.0, 0.1))
    assert judge(claim("drop/reasoned", why="as written"), found).why == "as the run says"
    assert judge(claim("drop/other", why="as written"), found).why == "as written"


def test_unknown_rows_claims_and_tables_are_named() -> None:
    """A claim whose row was renamed is no silent gap; a sentence is no identifier."""
    found = results(("a", 1.0, None, 1.0, None))
    with pytest.raises(KeyError, match="no row 'b'"):
        found.row("part", "b", "x")
    with pytest.raises(KeyError, match="no claim 'it holds'"):
        found.holds("part", "it holds")
    with pytest.raises(KeyError, match="no table 'grid'"):
        found.table("part", "grid")


def test_a_table_is_its_file_and_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """A file with an experiment and a claim, and its line among the contents: it is made and judged."""
    toy = ModuleType("paper.reproduce.toy")
    made, about = Experiment(name="table9", compute=lambda job: Findings()), rows("table9", "x", "a")
    vars(toy).update(EXPERIMENTS=(made,), CLAIMS=(Claim(id="toy.x", place="Table 9", says="x", measure=about),))
    monkeypatch.setitem(sys.modules, toy.__name__, toy)
    monkeypatch.setitem(contents.CONTENTS, "table9", contents.Entry("toy", "Table 9: x"))
    registry = runpy.run_path(str(Path(contents.__file__).with_name("registry.py")))
    assert registry["CATALOGUE"]["table9"] is made
    found = registry["judge_all"](results(("a", 1.0, None, 1.01, None), part="table9"))
    assert [each.verdict for each in found if each.claim.entry == "table9"] == [Verdict.REPRODUCED]


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
    row = compare("a", ("x", "", 3), PaperValue(mean=paper, sd=sd, n=10), {"ours": share * paper, "sd": sd, "n": 3})
    found = results(("a", paper, sd, share * paper, sd)).row("part", "a", "x")
    assert row.differs is not found.agrees()
    shown = report_page.cells(row)
    assert shown[4] == f"{100.0 * (share - 1.0):+.1f} %"
    error = 0.05 * abs(paper) if sd is None else sd * (1 / 10 + 1 / 3) ** 0.5
    assert float(shown[5]) == pytest.approx((share - 1.0) * abs(paper) / error, abs=0.05 + 1e-9)  # of one decimal


def test_every_claim_finds_its_rows() -> None:
    """In the committed results; each has an identifier of its own, a verdict and a sentence."""
    found = judge_all(Results(pages.read()["parts"]))
    assert len(found) == len(CLAIMS)
    assert all(judged.why.endswith((".", "?")) for judged in found)
    assert max(Counter(claim.id for claim in CLAIMS).values()) == 1


def test_readme_compares_in_one_sentence() -> None:
    """All effects are counted; it says that settings were tuned in view, and where each claim stands."""
    found = Results(pages.read()["parts"])
    text = pages.BLOCKS["readme"](found)
    assert len(re.findall(r"\.(?= |$)", re.sub(r"\]\([^)]*\)", "]", text))) == 1
    total = re.search(r"about (\d+) effects", text)
    assert total is not None and int(total[1]) == sum(by_effect(judge_all(found)).values())
    assert "(docs/reproduce.md)" in text and "tuned in view" in text
