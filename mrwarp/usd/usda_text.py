"""Change one attribute in the text of a ``.usda`` file; comments and layout stay.

A small scanner finds the place. It knows prims, variants and properties and skips the rest as balanced brackets, so it
reads what USD reads but refuses less: callers must open the result with USD (see :mod:`mrwarp.usd.edit`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

_TOKEN = re.compile(
    r"(?P<skip>\s+|\#[^\n]*|//[^\n]*|/\*.*?\*/)"
    r'|(?P<string>"""(?:\\.|[^\\])*?"""|'
    + r"'''(?:\\.|[^\\])*?'''"
    + r'|"(?:\\.|[^"\\\n])*"|'
    + r"'(?:\\.|[^'\\\n])*')"
    r"|(?P<opaque>@@@.*?@@@|@[^@\n]*@|<[^>\n]*>)"
    r"""|(?P<word>[^\s"'@<>(){}\[\]=,;\#]+)"""
    r"|(?P<mark>.)",
    re.DOTALL,
)
_CLOSING = {"(": ")", "[": "]", "{": "}"}
_QUALIFIERS = {"custom", "uniform", "varying", "config", "add", "prepend", "append", "delete", "reorder"}


class UsdaTextError(ValueError):
    """The text cannot be edited in place: it is not understood, or the prim does not stand in it."""


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    start: int
    end: int
    first: bool
    """First on its line."""


@dataclass(frozen=True)
class Property:
    """Where one property stands in the text: spans of its type and its value (``None``: declared only)."""

    type_span: tuple[int, int]
    value_span: tuple[int, int] | None
    end: int


@dataclass(frozen=True)
class Block:
    """The ``{ }`` of one prim or variant: offsets just inside the braces, and its own properties."""

    start: int
    end: int
    properties: dict[str, Property] = field(default_factory=dict)


class _Scanner:
    """Reads prims, variants and properties; skips metadata, values, strings and comments."""

    def __init__(self, text: str) -> None:
        self.tokens: list[_Token] = []
        first = True
        for match in _TOKEN.finditer(text):
            kind, found = match.lastgroup or "", match.group()
            if kind != "skip":
                self.tokens.append(_Token(kind, found, match.start(), match.end(), first))
            first = "\n" in found if kind != "skip" else first or "\n" in found
        self.tokens.append(_Token("end", "end of file", len(text), len(text), True))
        self.at = 0
        self.blocks: dict[str, Block] = {}
        self.metadata()
        while self.tokens[self.at].kind != "end":
            self.prim("/")

    def take(self, *wanted: str) -> _Token:
        """The next token, which must be one of ``wanted`` (a kind or a text)."""
        token = self.tokens[self.at]
        if token.kind == "end" or wanted and token.kind not in wanted and token.text not in wanted:
            raise UsdaTextError(f"{token.text!r} at character {token.start} where {' or '.join(wanted)} is expected")
        self.at += 1
        return token

    def balanced(self) -> _Token:
        """Skip a bracketed group, or one plain token; returns the last token."""
        token = self.take()
        if token.kind == "mark" and token.text in _CLOSING:
            while self.tokens[self.at].text != _CLOSING[token.text]:
                self.balanced()
            token = self.take()
        return token

    def metadata(self) -> None:
        if self.tokens[self.at].text == "(":
            self.balanced()

    def prim(self, parent: str) -> None:
        self.take("def", "over", "class")
        while self.tokens[self.at].kind != "string":
            self.take("word")
        name = self.take().text.strip("\"'")
        self.metadata()
        self.body(parent + ("" if parent[-1] in "/}" else "/") + name)

    def body(self, path: str) -> None:
        block = self.blocks[path] = Block(self.take("{").end, 0)
        while (token := self.tokens[self.at]).text != "}":
            if token.text in ("def", "over", "class"):
                self.prim(path)
            elif token.text == "variantSet":
                self.variants(path)
            elif token.text == ";":
                self.at += 1
            else:
                self.property(block)
        self.blocks[path] = Block(block.start, self.take("}").start, block.properties)

    def variants(self, path: str) -> None:
        self.take("variantSet")
        name = self.take("string").text.strip("\"'")
        self.take("=")
        self.take("{")
        while self.tokens[self.at].text != "}":
            choice = self.take("string").text.strip("\"'")
            self.metadata()
            self.body(f"{path}{{{name}={choice}}}")
        self.take("}")

    def property(self, block: Block) -> None:
        head = [self.take("word")]
        while (token := self.tokens[self.at]).text not in ("=", "(", ";", "}") and not token.first:
            head.append(self.take("word", "[", "]"))
        words = [token for token in head if token.kind == "word" and token.text not in _QUALIFIERS] or head
        value = None
        if self.tokens[self.at].text == "=":
            self.take("=")
            start = self.tokens[self.at].start
            value = (start, self.balanced().end)
        if not self.tokens[self.at].first:
            self.metadata()
        kind, end = words[0], self.tokens[self.at - 1].end
        kind_end = head[-2].end if kind is not head[-1] else kind.end  # with the brackets of an array
        if head[0].text != "reorder":
            block.properties[words[-1].text] = Property((kind.start, kind_end), value, end)


def scan(text: str) -> dict[str, Block]:
    """The blocks of a ``.usda`` text by Sdf path, e.g. ``/mr_go{robot=mr_go}actuators/FL_calf``.

    Raises:
        UsdaTextError: the text is not understood.
    """
    return _Scanner(text).blocks


def quoted(value: str) -> str:
    """A text of one line as USD writes it; single quotes outside leave the double ones of JSON readable."""
    return "'" + value.replace("\\", "\\\\").replace("'", "\\'") + "'"


def set_value(text: str, path: str, name: str, value: str, type_name: str) -> str:
    """``text`` with attribute ``name`` of the prim at Sdf path ``path`` set: replaced where it stands, else added.

    ``value`` is a number, or a :func:`quoted` text.

    Raises:
        UsdaTextError: the prim does not stand in the text, or the text is not understood.
    """
    block = scan(text).get(path)
    if block is None:
        raise UsdaTextError(f"{path} does not stand in the text")
    known = block.properties.get(name)
    if known is None:
        return _added(text, block, f"{type_name} {name} = {value}")
    first, last = known.type_span
    start, end = known.value_span or (known.end, known.end)
    head = text[:first] + type_name + text[last:start] + ("" if known.value_span else " = ") + value
    gap = re.match(r"   +(?=#|//)", text[end:])
    if gap is None:
        return head + text[end:]
    room = end + len(gap[0]) - len(head)  # the comment keeps its column
    return head + " " * max(room, 2) + text[end + len(gap[0]) :]


def _added(text: str, block: Block, line: str) -> str:
    """``text`` with one more line in ``block``: below its own properties, else at its top."""
    newline = "\r\n" if "\r\n" in text else "\n"
    at = max((known.end for known in block.properties.values()), default=block.start)
    opening = text.rfind("\n", 0, block.start) + 1
    indent = re.match(r"[ \t]*", text[opening:])[0]  # type: ignore[index]
    rest = re.match(r"[ \t;]*(#[^\r\n]*|//[^\r\n]*)?(?=\r?\n)", text[at:])
    if rest:
        return text[: at + rest.end()] + f"{newline}{indent}    {line}" + text[at + rest.end() :]
    return text[:at].rstrip(" ") + f"{newline}{indent}    {line}{newline}{indent}" + text[at:].lstrip(" ;")
