"""Verdicts follow from figures by the stated rule."""

import pytest

from mrwarp.reproduce import claims
from mrwarp.reproduce.claims import Claim, Mark, Results, Verdict, change, judge, rows


def results(
    *cells: tuple[str, float, float | None, float, float | None], part: str = "part", holds: bool = True
) -> Results:
    """Rows by condition, the paper's figure and SD, ours and SD."""
    made = [
        {"condition": name, "quantity": "x", "paper": {"mean": theirs, "sd": sd}, "ours": ours, "sd": spread,
         "n": 3, "digits": 3, "calibrated": False}
        for name, theirs, sd, ours, spread in cells
    ]  # fmt: skip
    return Results({part: {"rows": made, "claims": {"it holds": holds}}})


@pytest.mark.parametrize(
    ("ours", "verdict"),
    [((1.0, 2.1), Verdict.REPRODUCED), ((1.0, 3.0), Verdict.DIRECTION), ((2.0, 1.0), Verdict.NOT)],
)
def test_levels_are_judged_by_agreement_then_by_order(ours: tuple[float, float], verdict: Verdict) -> None:
    """The paper tells its two figures apart: their order is the direction."""
    found = results(("a", 1.0, 0.1, ours[0], 0.1), ("b", 2.0, 0.1, ours[1], 0.1))
    claim = Claim(place="", says="", why="", part="part", measure=rows("part", "x", "a", "b"))
    assert judge(claim, found).verdict is verdict
    assert judge(claim, found).mark is Mark.PREDICTED


def test_a_lone_level_that_disagrees_is_not_reproduced() -> None:
    """It has no direction; within 5 % it agrees where the paper states no spread."""
    claim = Claim(place="", says="", why="", part="part", measure=rows("part", "x", "a"))
    assert judge(claim, results(("a", 1.0, None, 1.2, 0.5))).verdict is Verdict.NOT
    assert judge(claim, results(("a", 1.0, None, 1.04, None))).verdict is Verdict.REPRODUCED


def test_effects_are_judged_by_sign_and_named_claims() -> None:
    """A change of the other sign is not reproduced, nor is one whose entry says that the claim fails."""
    claim = Claim(
        place="", says="", why="", effect=True, holds=(("part", "it"),), measure=change("part", "x", ("a", "b"))
    )
    lower = results(("a", 2.0, None, 4.0, None), ("b", 1.0, None, 3.9, None))
    assert judge(claim, lower).verdict is Verdict.DIRECTION
    assert judge(claim, lower).figures[0].ours == pytest.approx(-2.5)
    higher = results(("a", 2.0, None, 4.0, None), ("b", 1.0, None, 4.1, None))
    assert judge(claim, higher).verdict is Verdict.NOT
    assert (
        judge(claim, results(("a", 2.0, None, 4.0, None), ("b", 1.0, None, 2.0, None), holds=False)).verdict
        is Verdict.NOT
    )


def test_spread_of_a_change_is_that_of_a_ratio() -> None:
    """10 % of either figure is 14 % of their ratio."""
    found = results(("a", 2.0, 0.2, 2.0, 0.2), ("b", 1.0, 0.1, 1.0, 0.1))
    figure = change("part", "x", ("a", "b"))(found)[0]
    assert figure.sd == pytest.approx(50.0 * 0.02**0.5)


def test_contradictions_of_the_paper_need_no_figure() -> None:
    """They are excluded whatever came out."""
    assert judge(Claim(place="", says="", why="", excluded=True), results()).verdict is Verdict.EXCLUDED


def test_unknown_rows_and_claims_are_told() -> None:
    """A claim whose row was renamed is no silent gap."""
    with pytest.raises(KeyError, match="no row 'b'"):
        results(("a", 1.0, None, 1.0, None)).row("part", "b", "x")
    with pytest.raises(KeyError, match="no claim 'that'"):
        results().holds("part", "that")


def test_every_claim_finds_its_rows() -> None:
    """In the committed results; each has a verdict and a sentence."""
    from mrwarp.reproduce import pages

    parts = pages.read()["parts"]
    found = claims.judge_all(Results(parts))
    assert len(found) == sum(claim.entry in {"", *parts} for claim in claims.CLAIMS)
    assert all(judged.claim.why.endswith((".", "?")) for judged in found)
