"""Change attributes of a prim in the text of a ``.usda`` file; comments and layout stay, which USD's own writer drops.

Nothing here understands the format: texts that may be meant are tried in turn, and the one that USD reads as the wanted
change, and as nothing else, is taken.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from pxr import Sdf, Tf

_VALUE = (
    r'"""(?:\\.|[^\\])*?"""|'
    + r"'''(?:\\.|[^\\])*?'''|"
    + r'"(?:\\.|[^"\\\n])*"|'
    + r"'(?:\\.|[^'\\\n])*'|"
    + r"\[[^\]]*\]|\([^)]*\)|[^\s;,(){}\[\]#]+"
)
_COMMENT = re.compile(r" {3,}(?=#|//)")


class UsdaTextError(ValueError):
    """The text cannot be edited in place: it is not readable, or the prim does not stand in it."""


def set_attribute(layer: Sdf.Layer, path: str, name: str, value: float | str, type_name: str) -> None:
    """Author attribute ``name`` of the prim at Sdf path ``path``, which is made if it is not there."""
    prim = Sdf.CreatePrimInLayer(layer, path)
    spec = prim.attributes.get(name) or Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.Find(type_name))
    spec.SetInfo("typeName", type_name)
    spec.default = value


def set_values(text: str, path: str, values: Mapping[str, tuple[float | str, str]]) -> str:
    """``text`` with attributes of one prim set: replaced where they stand, others added below its own properties.

    Args:
        text: Content of a ``.usda`` file.
        path: Sdf path of the prim, such as ``/mr_go{robot=mr_go}actuators/FL_calf``.
        values: By name: number, or text of one line, and USD's name of the type, such as ``double``.

    Raises:
        UsdaTextError: the prim does not stand in the text, or the text is not readable.
    """
    try:
        layer = _layer(text)
    except Tf.ErrorException:
        raise UsdaTextError("the text is not readable as USD") from None
    prim = layer.GetPrimAtPath(path)
    if not prim:
        raise UsdaTextError(f"{path} does not stand in the text")
    new = {name: given for name, given in values.items() if name not in prim.attributes}
    for name, (value, type_name) in values.items():
        if name not in new:
            before = layer.ExportToString()
            set_attribute(layer, path, name, value, type_name)
            if (wanted := layer.ExportToString()) != before:
                text = _first(_replaced(text, name, _literal(value), type_name), wanted) or text
    for name, (value, type_name) in new.items():
        set_attribute(layer, path, name, value, type_name)
    wanted = layer.ExportToString()
    lines = [f"{type_name} {name} = {_literal(value)}" for name, (value, type_name) in new.items()]
    if lines:
        names = re.finditer(rf"""["']{re.escape(prim.name)}["']""", text)
        found = next(filter(None, (_added(text, match.start(), lines, wanted) for match in names)), None)
        braces = (match.end() for match in re.finditer("{", text))  # a block on one line has no line to add below
        text = found or _first((_insert(text, at, lines, block=True) for at in braces), wanted) or text
    if _read(text) != wanted:
        raise UsdaTextError(f"no place for {', '.join(values)} of {path} was found in the text")
    return text


def _first(candidates: Iterator[str], wanted: str) -> str | None:
    """The first text that USD reads as wanted."""
    return next((edited for edited in candidates if _read(edited) == wanted), None)


def _layer(text: str) -> Sdf.Layer:
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(text)
    return layer


def _read(text: str) -> str | None:
    """What USD reads, in USD's own layout; None if it cannot."""
    try:
        return _layer(text).ExportToString()
    except Tf.ErrorException:
        return None


def _literal(value: float | str) -> str:
    """A value as USD writes it; single quotes around a text leave the double ones of JSON readable."""
    if isinstance(value, str):
        return "'" + value.replace("\\", "\\\\").replace("'", "\\'") + "'"
    return repr(value).removesuffix(".0")


def _replaced(text: str, name: str, literal: str, type_name: str) -> Iterator[str]:
    """The text with one or another property of that name replaced; a comment behind it keeps its column."""
    pattern = rf"(?<=[ \t]){re.escape(name)}(?![\w:.])(?:(?P<equals>\s*=\s*)(?:{_VALUE}))?"
    for match in re.finditer(pattern, text, re.DOTALL):
        before = text[: match.start()].rstrip(" \t")
        word = re.split(r"[\s;{(]", before[before.rfind("\n") + 1 :])[-1]
        if not word:
            continue
        blanks = text[len(before) : match.start()]
        head = f"{before.removesuffix(word)}{type_name}{blanks}{name}{match['equals'] or ' = '}{literal}"
        rest = text[match.end() :]
        if gap := _COMMENT.match(rest):
            room = match.end() + gap.end() - len(head)
            rest = " " * max(room, 2) + rest[gap.end() :]
        yield head + rest


def _added(text: str, at: int, lines: Sequence[str], wanted: str) -> str | None:
    """The text with lines in the block behind the prim's name at ``at``: below its properties, else at its top."""
    found = None
    for end in (match.start() for match in re.compile(r"\r?\n").finditer(text, at)):
        last = text[text.rfind("\n", 0, end) + 1 : end].strip()
        if found and (not last or last.startswith("#")):
            continue
        edited = _insert(text, end, lines, like=at)
        read = _read(edited)
        if read == wanted:
            found = edited
        elif found or read is not None:  # behind the block, or in another one
            break
    return found


def _insert(text: str, at: int, lines: Sequence[str], *, like: int = -1, block: bool = False) -> str:
    """The text with lines at ``at``, indented below the line of ``like``; ``block``: what follows begins a line too."""
    like = at if like < 0 else like
    opening = text[text.rfind("\n", 0, like) + 1 : like]
    indent = opening[: len(opening) - len(opening.lstrip())]
    newline = "\r\n" if "\r\n" in text else "\n"
    added = "".join(f"{newline}{indent}    {line}" for line in lines)
    return text[:at] + added + (newline + indent + text[at:].lstrip(" ;") if block else text[at:])
