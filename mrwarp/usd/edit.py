"""Put numbers into a USD asset; comments and layout of a text file stay, which USD's own writer drops.

:func:`edit_asset` finds the prim, checks each number, writes a copy next to the target, has the copy checked, and only
then lets it replace the target. :func:`set_values` edits text without understanding the format: places that may be
meant are tried in turn, and the text that USD reads as the wanted change, and as nothing else, is taken.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf, Usd

from mrwarp.model_file import Model
from mrwarp.params import MrParams, ParameterError
from mrwarp.runtime import closest
from mrwarp.usd.open_stage import AssetError, choices, open_stage
from mrwarp.usd.record import (
    LAW,
    PD,
    PREFIX,
    RECORD,
    decimal,
    is_mr,
    law_name,
    plain,
    read_parameters,
    record_text,
    summary,
)
from mrwarp.usd.scene_report import value_text

SUFFIXES = (".usda", ".usdc", ".usd")

Values = Mapping[str, tuple[float | str, str]]
"""By attribute name: number, or text of one line, and USD's name of the type, such as ``double``."""

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


@dataclass(frozen=True, kw_only=True)
class Change:
    """Change of one actuator by an edit: attribute, value before (``None``: there was none) and after."""

    prim: str
    attribute: str
    before: Any
    after: float | str

    @property
    def what(self) -> str:
        """The change without the actuator."""
        if self.attribute == RECORD:
            return f"{RECORD}: {summary(self.before)} -> {summary(self.after)}"
        before = f"{self.before:.10g}" if isinstance(self.before, float) else self.before or "none"
        return f"{self.attribute}: {before} -> {value_text(self.attribute, self.after)}"


@dataclass(frozen=True, kw_only=True)
class EditReport:
    """Where an edit was written, and what it changed."""

    path: Path
    changes: tuple[Change, ...]
    kept: tuple[str, ...]
    """Actuators that inherit from the edited class and keep a value of their own, one line each."""
    notice: str
    """Why comments were lost; empty when they were not."""


def edit_asset(
    file: Path,
    prim: str,
    values: dict[str, Any],
    out: Path | None = None,
    check: Callable[[Path], object] | None = None,
    model: Model | None = None,
    extrapolate: bool = False,
) -> EditReport:
    """Set attributes of one actuator, or of the class that several inherit.

    Args:
        file: USD file.
        prim: Prim path, or the short name of a joint (``FL_calf``) or class (``MRDevice``).
        values: Attribute name, with or without ``newton:mr:``, to number.
        model: A model whose numbers are set before ``values``, with its record, see :mod:`mrwarp.usd.record`.
        extrapolate: As in :meth:`mrwarp.model_file.Model.to_params`.
        out: File to write; ``None`` is ``file`` itself.
        check: Called with the edited copy; raises ``AssetError`` when it is not usable.

    Raises:
        AssetError: a prim, name or number is refused, or the result is not usable; then nothing was written.
    """
    stage = open_stage(file)
    target = (out or file).resolve()
    if target.suffix not in SUFFIXES or not target.parent.is_dir():
        raise AssetError(f"{out or file}: cannot be written; give a name ending in {', '.join(SUFFIXES)} in a folder")
    found = find_prim(stage, prim, file)
    path = str(found.GetPath())
    record = {}
    if model is not None:
        if not is_mr(found):
            raise AssetError(f"{file}: {path}: a plain motor takes no model; name a joint with an MR device")
        held = read_parameters(found, file)
        params = model.to_params(held, extrapolate=extrapolate)
        record = {RECORD: record_text(model, params)}
        if model.law is not None or found.GetAttribute(LAW).HasAuthoredValue():
            record[LAW] = law_name(model)
        own = {name: value for name, value in params if name in model.parameters or value != held.to_dict()[name]}
        values = own | values
    wanted: dict[str, float | str] = {**_checked(found, values, file), **record}
    sites: dict[str, dict[str, tuple[float | str, str]]] = {}
    for name, value in wanted.items():
        where, kind = _site(found, name)
        sites.setdefault(where, {})[name] = (value, kind)
    before = _held(stage, path, wanted)
    if found.IsAbstract() and {where for _, where, _ in before} == {path}:
        raise AssetError(f"{file}: no actuator inherits {path} (a flattened file?); name the joint, such as FL_calf")
    copy = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        notice = _write(stage, file, copy, sites)
        if check is not None:
            check(copy)
        after = _held(open_stage(copy), path, wanted)
        for name, value in wanted.items():
            if not any(key[1:] == (path, name) and _arrived(name, value, there) for key, there in after.items()):
                text = f"{path}: {name} = {value_text(name, value)}"
                raise AssetError(f"{text} does not take effect: a stronger opinion stands elsewhere")
        shutil.copymode(target if target.exists() else file, copy)
        os.replace(copy, target)
    except (AssetError, OSError, Tf.ErrorException) as error:
        message = str(error).replace(str(copy), str(out or file)).strip()
        raise AssetError(f"{message} (nothing was written)") from None
    finally:
        copy.unlink(missing_ok=True)
    kept = {
        f"{where} keeps its own {name} = {value_text(name, value)}"
        for (_, where, name), value in after.items()
        if value is not None and not _arrived(name, wanted[name], value)
    }
    changed = {key[1:]: (before.get(key), value) for key, value in reversed(after.items()) if before.get(key) != value}
    changes = tuple(
        Change(prim=where, attribute=name, before=old, after=new)
        for (where, name), (old, new) in sorted(changed.items(), key=lambda item: (item[0][0] != path, item[0]))
    )
    return EditReport(path=out or file, changes=changes, kept=tuple(sorted(kept)), notice=notice)


def changes_by_prim(changes: Iterable[Change]) -> list[str]:
    """Lines that report changes: those of one actuator stand together, once for all actuators that share them."""
    lines_of: dict[str, list[str]] = {}
    for change in changes:
        lines_of.setdefault(change.prim, []).append(change.what)
    shared: dict[tuple[str, ...], list[str]] = {}
    for prim, lines in lines_of.items():
        shared.setdefault(tuple(lines), []).append(prim)
    found = []
    for lines, (first, *others) in shared.items():
        found += [f"{first} {line}" for line in lines]
        found += [f"the same on {', '.join(others)}"] * bool(others)
    return found


def find_prim(stage: Usd.Stage, name: str, file: Path) -> Usd.Prim:
    """The actuator, or class of actuators, of that path or short name; MR where a variant makes it MR.

    Raises:
        AssetError: there is none; the message proposes the nearest name.
    """
    known: dict[str, None] = {}
    for need_mr in (True, False):
        for _ in choices(stage):
            actuators = [p for p in stage.TraverseAll() if p.GetTypeName() == "NewtonActuator"]
            for prim in actuators:
                known[prim.GetName()] = None
                if name in (prim.GetName(), str(prim.GetPath())) and (is_mr(prim) or not need_mr):
                    return prim
    hint = closest(name.rsplit("/", 1)[-1], known, cutoff=0.5)
    raise AssetError(f"{file}: there is no actuator {name!r}; {hint}known: {', '.join(known)}")


def _checked(prim: Usd.Prim, values: dict[str, Any], file: Path) -> dict[str, float]:
    """Full attribute names and checked numbers, for an MR device or a plain motor."""
    where = f"{file}: {prim.GetPath()}"
    checked: dict[str, float] = {}
    for name, value in values.items():
        full = "newton:" + name.removeprefix("newton:")
        if not is_mr(prim) and full not in PD:
            raise AssetError(f"{where}: a plain motor has no {name!r}; allowed: {', '.join(PD)}")
        try:
            if is_mr(prim):
                spec = MrParams.spec(name.removeprefix(PREFIX), where)
                full = PREFIX + spec.name
            else:
                spec = replace(PD[full], name=full)
            checked[full] = spec.check(value, where)
        except ParameterError as error:
            raise AssetError(str(error)) from None
    return checked


def _held(stage: Usd.Stage, path: str, names: Iterable[str]) -> dict[tuple[tuple[str, ...], str, str], Any]:
    """Values of the attributes on the prim and on what inherits from it, by variant choice, prim path and name."""
    return {
        (choice, str(prim.GetPath()), name): plain(attribute) if (attribute := prim.GetAttribute(name)) else None
        for choice in choices(stage)
        for prim in stage.TraverseAll()
        if any(str(spec.path.StripAllVariantSelections()) == path for spec in prim.GetPrimStack())
        for name in names
    }


def _arrived(name: str, value: float | str, there: Any) -> bool:
    """Whether a written value is there; a motor's number is stored in 32 bits."""
    return there == value or (name in PD and there == decimal(value, "float"))


def _site(prim: Usd.Prim, name: str) -> tuple[str, str]:
    """Where to write an attribute: Sdf path of the prim's strongest opinion, else of the block that makes it MR; type.

    Numbers of MR devices are written as ``double``, records as ``string``; a motor's numbers keep their type, ``float``
    in Newton's schema.
    """
    root = prim.GetStage().GetRootLayer()
    own = [s for s in prim.GetPrimStack() if s.layer == root and s.path.StripAllVariantSelections() == prim.GetPath()]
    held = [s for s in own if name in s.attributes and s.attributes[name].HasDefaultValue()]
    spec = held[0] if held else own[-1] if own else None
    kind = str(held[0].attributes[name].typeName) if held else "float"
    kind = "string" if name in (RECORD, LAW) else "double" if name.startswith(PREFIX) else kind
    return str(spec.path if spec else prim.GetPath()), kind


def _write(stage: Usd.Stage, file: Path, copy: Path, sites: Mapping[str, Values]) -> str:
    """Write the edited copy; returns a notice when the text could not be edited and comments are lost."""
    is_text = file.read_bytes()[:5] == b"#usda"
    reason = f"{file} is not a text file" if not is_text else f"{copy.suffix} is not a text format"
    if is_text and copy.suffix != ".usdc":
        try:
            text = file.read_bytes().decode("utf-8")
            for path, values in sites.items():
                text = set_values(text, path, values)
            copy.write_bytes(text.encode("utf-8"))
            return ""
        except (UsdaTextError, UnicodeDecodeError) as error:
            reason = str(error)
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.TransferContent(stage.GetRootLayer())
    for path, values in sites.items():
        for name, (value, kind) in values.items():
            _set(layer, path, name, value, kind)
    if not layer.Export(str(copy), args={"format": "usda"} if is_text and copy.suffix == ".usd" else {}):
        raise AssetError(f"{copy}: cannot be written")
    return f"written through USD, which keeps no comments and lays the text out again: {reason}"


def set_values(text: str, path: str, values: Values) -> str:
    """``text`` with attributes of one prim set: replaced where they stand, others added at the top of its block.

    ``path`` is the prim's Sdf path, such as ``/mr_go{robot=mr_go}actuators/FL_calf``, in the ``text`` of a ``.usda``
    file.

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
    new = [name for name in values if name not in prim.attributes]
    for name in values:
        if name not in new:
            value, kind = values[name]
            _set(layer, path, name, value, kind)
            text = _meant([text, *_replaced(text, name, _literal(value), kind)], layer, f"{name} of {path}")
    for name in new:
        _set(layer, path, name, *values[name])
    lines = [f"{values[name][1]} {name} = {_literal(values[name][0])}" for name in new]
    return _meant(_added(text, prim.name, lines), layer, f"{', '.join(new)} of {path}") if new else text


def _set(layer: Sdf.Layer, path: str, name: str, value: float | str, type_name: str) -> None:
    """Author attribute ``name`` of the prim at Sdf path ``path``, which is made if it is not there."""
    prim = Sdf.CreatePrimInLayer(layer, path)
    spec = prim.attributes.get(name) or Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.Find(type_name))
    spec.SetInfo("typeName", type_name)
    spec.default = value


def _meant(candidates: Iterable[str], layer: Sdf.Layer, what: str) -> str:
    """The first text that USD reads as ``layer``."""
    wanted = layer.ExportToString()
    for text in candidates:
        try:
            if _layer(text).ExportToString() == wanted:
                return text
        except Tf.ErrorException:
            continue
    raise UsdaTextError(f"no place for {what} was found in the text")


def _layer(text: str) -> Sdf.Layer:
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(text)
    return layer


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


def _added(text: str, prim: str, lines: list[str]) -> Iterator[str]:
    """The text with lines at the top of one or another block behind the prim's name."""
    newline = "\r\n" if "\r\n" in text else "\n"
    for brace in re.compile(r"\{([ \t]*(?:#[^\n\r]*)?(?=\r?\n))?").finditer(text, max(text.find(prim), 0)):
        opening = text[text.rfind("\n", 0, brace.start()) + 1 : brace.start()]
        indent = newline + opening[: len(opening) - len(opening.lstrip())]
        rest = text[brace.end() :]
        if brace[1] is None:  # a block on one line
            rest = indent + rest.lstrip(" ;")
        yield text[: brace.end()] + "".join(f"{indent}    {line}" for line in lines) + rest
