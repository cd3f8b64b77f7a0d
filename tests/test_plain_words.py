"""The check of the language finds what it looks for, and leaves code and short sentences alone."""

import pytest

from tools import plain_words

LONG = "The joint " + "turns and " * 16 + "stops."


@pytest.mark.parametrize(
    ("name", "text", "wanted"),
    [
        ("docs/a.md", "one\nIt stands beside the other.", ["docs/a.md:2: 'beside': say next to"]),
        ("mrwarp/a.py", '"""What it holds."""', ["mrwarp/a.py:1: docstring begins 'What'"]),
        ("mrwarp/a.py", '"""The same again."""', ["mrwarp/a.py:1: docstring begins 'The same'"]),
        ("mrwarp/a.py", f'x = f"{LONG} {{y}}"', ["mrwarp/a.py:1: message with a sentence of 35 words"]),
        ("docs/a.md", f"one\n\n{LONG}", ["docs/a.md:3: sentence of 35 words"]),
        ("docs/a.md", f"```\n{LONG}\n```", []),
        ("docs/a.md", f"{LONG[:60]}.\n\n* {LONG[60:]}\n", []),
        ("mrwarp/a.py", f'"""{LONG}"""\nx = "Whatsoever the story tellers say."', []),
    ],
)
def test_findings(name: str, text: str, wanted: list[str]) -> None:
    """File, line, fault and remedy; none for code blocks, docstrings' length and words that only hold one."""
    found = list(plain_words.findings(name, text))
    assert [line[: len(start)] for line, start in zip(found, wanted, strict=True)] == wanted


def test_every_exception_is_needed() -> None:
    """An exception of the list stands in its file, next to a word that it allows."""
    for name, piece in plain_words.ALLOWED:
        text = (plain_words.ROOT / name).read_text(encoding="utf-8")
        assert any(piece in line and plain_words.PRIVATE.search(line) for line in text.splitlines()), (name, piece)
