"""``report.html`` of a diagnosis: one offline page. Its first screen answers four questions in at most sixty words."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from mrwarp.run_dir import versions
from mrwarp.sysid.report.words import short
from mrwarp.sysid.verdict import Answer

MOST_WORDS = 60
"""Words before the first section of a report: what is read at a glance."""

_SHARES = {"What is missing": 12, "How big": 9, "How sure": 13, "What to do": 10}
"""Words of each answer. With the questions (10) and the heading (:data:`_NAME`) they are :data:`MOST_WORDS` at most."""

_NAME = 3
"""Words of a recording's name; three more make the heading."""

MOST_SHOWN = 2
"""Causes whose sizes the first screen gives; the rest are in the sections below."""

NOTHING = "nothing that these data could show"


class Table(NamedTuple):
    """A further table of the report: rows of text."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]


def page(
    d: Answer,
    command: str,
    content: Mapping[str, Any],
    pictures: Mapping[str, bytes],
    *,
    room: str,
    source: str,
    filters: Mapping[str, Callable[..., str]] | None = None,
) -> str:
    """The page as text.

    Args:
        d: The answer.
        command: Its origin.
        content: Content of the plant's template as plain text; it comes before what the answer says itself.
        pictures: PNGs by name.
        room: Package with that template, ``sections.html.jinja``, which fills the frame ``page.html.jinja``.
        source: Name of what was diagnosed.
        filters: Further filters of the template.
    """
    loader = ChoiceLoader([PackageLoader(package, ".") for package in (room, "mrwarp.sysid.report")])
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters |= filters or {}
    text = environment.get_template("sections.html.jinja").render(
        {"sentence": d.sentence, "unexplained": d.unexplained, "notes": d.notes} | dict(content),
        source=source,
        heading=f"Diagnosis of {_cut(short(source, 40), _NAME)}",
        pictures={name: base64.b64encode(data).decode() for name, data in pictures.items()},
        command=command,
        seconds=f"Computed in {d.seconds:.1f} s",
        seed=d.seed,
        versions=", ".join(f"{name} {number}" for name, number in versions().items()),
    )
    # a lone surrogate, as undecodable bytes of a file name give, cannot be written as UTF-8
    return text.encode("utf-8", "replace").decode("utf-8")


def screen(answers: Mapping[str, Iterable[str]]) -> list[tuple[str, str]]:
    """Questions and answers within their shares of words.

    Args:
        answers: By question, phrases in the order of their weight: the first stands always, the rest where they fit.
    """
    return [(question, fitted(list(answers[question]), share)) for question, share in _SHARES.items()]


def fitted(phrases: Sequence[str], most: int) -> str:
    """Phrases, joined by semicolons, of at most ``most`` words; the first is cut if it alone has more."""
    chosen: list[str] = []
    for phrase in filter(None, phrases):
        if not chosen:
            chosen.append(_cut(phrase, most))
        elif len(" ".join([*chosen, phrase]).split()) <= most:
            chosen.append(phrase)
    return "; ".join(chosen)


def _cut(phrase: str, most: int) -> str:
    words = phrase.split()
    return phrase if len(words) <= most else " ".join(words[:most]) + "…"
