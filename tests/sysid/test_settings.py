"""The settings of a diagnosis: documented, checked, and decisive."""

from dataclasses import FrozenInstanceError, dataclass, fields, replace
from typing import Any

import pytest

from mrwarp.sysid.settings import Gain, Settings
from mrwarp.sysid.settings.checked import Checked, described, setting

GROUPS = [field.default_factory for field in fields(Settings)]


@pytest.mark.parametrize("group", GROUPS)
def test_every_setting_is_documented(group: Any) -> None:
    """Its meaning, its range, what a higher value makes rarer and what more frequent, and what set it."""
    rows = list(described(group))
    assert [row.name for row in rows] == [field.name for field in fields(group)]
    for row in rows:
        assert row.meaning.endswith(".") and row.by and "to" in row.range, row
        fewer, more = row.trades.split("; more ")
        assert len(fewer) > len("fewer ") and more and fewer != more, row


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("share", 1.5, "Gain.share is 1.5: give a number from 0 to 1"),
        ("share", float("nan"), "Gain.share is nan"),
        ("few", 4.5, "Gain.few is 4.5: give a whole number from 2 to 100"),
        ("few", True, "Gain.few is True"),
        ("chi2", "30", "Gain.chi2 is '30'"),
    ],
)
def test_a_number_outside_its_range_is_refused(name: str, value: Any, words: str) -> None:
    """In one line with the setting, its value, and what to give."""
    with pytest.raises(ValueError, match=words) as refused:
        replace(Gain(), **{name: value})
    assert "\n" not in str(refused.value)


def test_a_range_of_two_numbers_stays_one() -> None:
    """A tuple of as many numbers, each within the limits."""

    @dataclass(frozen=True, kw_only=True)
    class Pair(Checked):
        ends: tuple[float, float] = setting((1.0, 2.0), 0.0, 5.0, fewer="a", more="b")

    assert Pair(ends=(0.0, 5.0)).ends == (0.0, 5.0)
    for wrong in ((1.0,), (1.0, 6.0), 1.0):
        with pytest.raises(ValueError, match=r"Pair\.ends is .*: give a tuple of 2 numbers from 0 to 5"):
            Pair(ends=wrong)


def test_settings_are_values() -> None:
    """Equal where their numbers are, never changed in place, and a group of another kind is refused."""
    assert Settings() == Settings() and Settings(gain=Gain(few=6)) != Settings()
    with pytest.raises(FrozenInstanceError):
        Settings().gain.few = 6  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ValueError, match=r"setting gain is 3: give a Gain"):
        Settings(gain=3)
