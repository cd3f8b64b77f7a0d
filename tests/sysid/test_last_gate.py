"""The last gate of a cause: a gain beyond chance, no channel that pays for it, a size that a body can have."""

from collections.abc import Sequence

import numpy as np
import pytest

from mrwarp.sysid.last_gate import Change, impossible, passed, refused

PIECES = np.random.default_rng(0).uniform(0.8, 1.2, 8)


def test_an_interval_of_the_gain_that_includes_none_is_refused() -> None:
    """However large its middle is."""
    assert refused((0.01, 0.03), {}, 0.02) == ""
    assert "18.5 % (-27.0 to 64.0 %)" in refused((-0.27, 0.64), {}, 0.02)


@pytest.mark.parametrize(("factor", "grows"), [(0.5, False), (1.01, False), (1.3, True)])
def test_a_channel_that_pays_is_named(factor: float, grows: bool) -> None:
    """By the channel's own error; growth of 2 % is none here."""
    noise = np.random.default_rng(1).uniform(0.95, 1.05, 8)
    change = Change.of(PIECES, factor**2 * PIECES * noise)
    assert change.share == pytest.approx(factor - 1.0, abs=0.05)
    assert (
        refused((0.1, 0.2), {"q": Change.of(PIECES, 0.9 * PIECES), "qd": change}, 0.02).startswith(
            "the replay's error of qd grows" if grows else ""
        )
        and bool(refused((0.1, 0.2), {"qd": change}, 0.02)) == grows
    )


def test_sizes_that_no_body_has() -> None:
    """A rotor of 204 kg·m² on a joint that moves 0.3."""
    assert "204 kg·m²" in impossible(204.0, 3.0, "kg·m²")
    assert impossible(-2.0, 3.0, "kg·m²") == "" == impossible(204.0, np.inf, "kg·m²")


def test_the_weakest_goes_until_what_is_left_passes() -> None:
    """First what nothing can have, however much it gains; then one by one, by its gain among those that are left."""
    gains = {"impossible": 9.0, "small": 0.1, "large": 0.4, "none": -0.2}
    seen: list[list[str]] = []

    def errors(causes: Sequence[str]) -> tuple[tuple[float, float], dict[str, Change], float]:
        seen.append(list(causes))
        total = sum(gains[cause] for cause in causes)
        channels = {"qd": Change.of(PIECES, PIECES * (1.5 if "small" in causes else 0.5))}
        return (total - 0.1, total + 0.1), channels, total

    left, out, total = passed(
        list(gains),
        faults=lambda causes: {cause: "no" if cause == "impossible" else "" for cause in causes},
        errors=errors,
        gains=lambda cause, causes: gains[cause] if cause in causes else np.nan,
        most=0.02,
    )
    assert left == ["large"] and list(out) == ["impossible", "none", "small"] and total == 0.4
    assert out["impossible"] == "no" and "qd grows" in out["small"]
    assert seen == [["small", "large", "none"], ["small", "large"], ["large"]]


def test_nothing_passes_as_nothing() -> None:
    """Without causes there is nothing to gain."""
    nothing = passed([], errors=lambda causes: ((0.0, 0.0), {}, len(causes)), gains=lambda *_: 0.0, most=0.0)
    assert nothing == ([], {}, 0)
