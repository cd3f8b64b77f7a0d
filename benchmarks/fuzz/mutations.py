"""Damage to good files: bytes, chunks, lines, numbers and words change; brackets open and never close."""

from __future__ import annotations

import random
import re

NUMBERS = (
    "nan", "inf", "-inf", "1e999", "-1", "0", "1e308", "-1e308", "1e-320", "9" * 400, "0x10", "1_000", "١", "", "null",
    "true", "[]", "{}", '"a"', "1,2", "--", "NaN", "1e", "-0.0", "2147483648", "18446744073709551616", "\ufeff1",
    "\x00",
)  # fmt: skip
"""Texts put in place of a number."""


def mutate(data: bytes, rng: random.Random) -> bytes:
    """One to four changes: bytes, chunks, lines, numbers."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        data = rng.choice(MUTATORS)(data, rng)[: 2**20]
    return data


def _at(data: bytes, rng: random.Random) -> int:
    """A place, more often in the first kilobyte, where headers are."""
    return rng.randrange(min(len(data), 1024) if rng.random() < 0.4 else len(data)) if data else 0


def _flip(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        if out:
            out[_at(data, rng)] = rng.choice((0, 255, 127, 128, 10, 44, 46, 45, rng.randrange(256)))
    return bytes(out)


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: _at(data, rng)] if rng.random() < 0.5 else data[_at(data, rng) :]


def _chunk(data: bytes, rng: random.Random) -> bytes:
    a, size, b = _at(data, rng), rng.choice((1, 2, 4, 8, 64, 500)), _at(data, rng)
    return rng.choice(
        (
            data[:a] + data[a + size :],
            data[:b] + data[a : a + size] + data[b:],
            data[:b] + rng.randbytes(size) + data[b:],
        )
    )


def _lines(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    what = rng.randrange(4)
    if what == 0:
        del lines[a]
    elif what == 1:
        lines.insert(a, lines[b])
    elif what == 2:
        lines[a], lines[b] = lines[b], lines[a]
    else:
        lines[a] = lines[a] * rng.choice((2, 3, 50))
    return b"\n".join(lines)


def _number(data: bytes, rng: random.Random) -> bytes:
    found = list(re.finditer(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?", data[: 2**17]))
    if not found:
        return data
    match = rng.choice(found)
    return data[: match.start()] + rng.choice(NUMBERS).encode() + data[match.end() :]


def _word(data: bytes, rng: random.Random) -> bytes:
    found = list(re.finditer(rb"[A-Za-z_:]{2,}", data[: 2**17]))
    if len(found) < 2:
        return data
    a, b = rng.choice(found), rng.choice(found)
    new = rng.choice(
        (b[0], b"", a[0] + a[0], "ü\u202e😀".encode(), b"\xff\xfe", a[0].upper(), b"../../etc/passwd", b'"')
    )
    return data[: a.start()] + new + data[a.end() :]


def _nest(data: bytes, rng: random.Random) -> bytes:
    a, depth = _at(data, rng), rng.choice((10, 2000, 100_000))
    return data[:a] + rng.choice((b"[", b"{", b'{"a":', b"(")) * depth + data[a:]


def mutate_attributes(data: bytes, rng: random.Random) -> bytes:
    """One to three attributes of a USD text get another value or another name; the file stays readable as USD."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        found = list(re.finditer(rb"^\s*(?:uniform |custom )?[\w\[\]]+ ([\w:]+) = (\S.*)$", data, flags=re.MULTILINE))
        match = rng.choice(found)
        other = rng.choice(found)
        value = rng.choice(
            (*(b'-1 0 1e308 nan inf -inf 1e-320 "a" [1,2] () (1,2,3) @a.usd@ </x> None true'.split()), other[2])
        )
        group = 1 if rng.random() < 0.15 else 2
        new = other[1] if group == 1 else value
        data = data[: match.start(group)] + new + data[match.end(group) :]
    return data


MUTATORS = (_flip, _flip, _cut, _chunk, _lines, _number, _number, _number, _word, _nest)
