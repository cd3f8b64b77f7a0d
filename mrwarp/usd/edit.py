"""Put numbers into a USD asset: the text is edited where it can be, and USD proves that nothing else changed.

The steps of :func:`edit_asset`: find the prim, check each number, write a copy beside the target, load every variant of
it, compare it with the original attribute by attribute, and only then let it replace the target.
"""

from __future__ import annotations

import difflib
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf, Usd

from mrwarp.params import MrParams, ParameterError
from mrwarp.usd.open_stage import AssetError, choices
from mrwarp.usd.record import PD, PREFIX, RECORD, is_mr
from mrwarp.usd.scene_report import decimal, plain, value_text
from mrwarp.usd.stage_trial import open_stage
from mrwarp.usd.usda_text import UsdaTextError, set_attribute, set_values

SUFFIXES = (".usda", ".usdc", ".usd")
Key = tuple[tuple[str, ...], str, str]
"""Variant choice, prim path, attribute name (empty: the prim itself)."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """What an edit did to one actuator: attribute, value before (``None``: there was none) and after."""

    prim: str
    attribute: str
    before: Any
    after: float | str


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
    record: Callable[[Usd.Prim], str] | None = None,
) -> EditReport:
    """Set attributes of one actuator, or of the class that several inherit.

    Args:
        file: USD file.
        prim: Prim path, or the short name of a joint (``FL_calf``) or class (``MRDevice``).
        values: Attribute name, with or without ``newton:mr:``, to number.
        out: File to write; ``None`` is ``file`` itself.
        check: Called with the edited copy; raises ``AssetError`` when it is not usable.
        record: Gives the record of the model that the values are of, see :mod:`mrwarp.usd.record`.

    Raises:
        AssetError: a prim, name or number is refused, or the result is not usable; then nothing was written.
    """
    stage = open_stage(file)
    target = (out or file).resolve()
    if target.suffix not in SUFFIXES or not target.parent.is_dir():
        raise AssetError(f"{out or file}: cannot be written; give a name ending in {', '.join(SUFFIXES)} in a folder")
    found = find_prim(stage, prim, file)
    path = str(found.GetPath())
    wanted: dict[str, float | str] = {**check_values(found, values, file)}
    if record is not None:
        wanted[RECORD] = record(found)
    sites: dict[str, dict[str, tuple[float | str, str]]] = {}
    for name, value in wanted.items():
        where, kind = _site(found, name)
        sites.setdefault(where, {})[name] = (value, kind)
    before, reach = snapshot(stage, path)
    if found.IsAbstract() and reach == {path}:
        raise AssetError(f"{file}: no actuator inherits {path} (a flattened file?); name the joint, such as FL_calf")
    copy = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        notice = _write(stage, file, copy, sites)
        if check is not None:
            check(copy)
        after, _ = snapshot(open_stage(copy), path)
        changes = _verified(before, after, reach, path, wanted)
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
        if where in reach and name in wanted and value not in _readings(name, wanted[name])
    }
    return EditReport(path=out or file, changes=changes, kept=tuple(sorted(kept)), notice=notice)


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
    near = difflib.get_close_matches(name.rsplit("/", 1)[-1], known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise AssetError(f"{file}: there is no actuator {name!r}; {hint}known: {', '.join(known)}")


def check_values(prim: Usd.Prim, values: dict[str, Any], file: Path) -> dict[str, float]:
    """Full attribute names and checked numbers, for an MR device or a plain motor.

    Raises:
        AssetError: a name is not an attribute of that kind of actuator, or a number is out of range.
    """
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


def snapshot(stage: Usd.Stage, path: str = "") -> tuple[dict[Key, Any], set[str]]:
    """Everything authored on the stage under every variant choice, and the prims that take opinions from ``path``."""
    seen: dict[Key, Any] = {}
    reach = {path}
    for choice in choices(stage):
        for prim in stage.TraverseAll():
            where = str(prim.GetPath())
            seen[choice, where, ""] = {
                key: str(value) for key, value in prim.GetAllAuthoredMetadata().items() if key != "variantSelection"
            }
            if any(str(spec.path.StripAllVariantSelections()) == path for spec in prim.GetPrimStack()):
                reach.add(where)
            for item in prim.GetAuthoredProperties():
                seen[choice, where, item.GetName()] = plain(item)
    return seen, reach


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
    kind = "double" if name.startswith(PREFIX) else "string" if name == RECORD else kind
    return str(spec.path if spec else prim.GetPath()), kind


def _write(stage: Usd.Stage, file: Path, copy: Path, sites: dict[str, dict[str, tuple[float | str, str]]]) -> str:
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
            set_attribute(layer, path, name, value, kind)
    if not layer.Export(str(copy), args={"format": "usda"} if is_text and copy.suffix == ".usd" else {}):
        raise AssetError(f"{copy}: cannot be written")
    return f"written through USD, which keeps no comments and lays the text out anew: {reason}"


def _readings(name: str, value: float | str) -> set[float | str]:
    """What a written value may read back as: a motor's number is stored in 32 bits."""
    return {value, decimal(value, "float")} if name in PD else {value}


def _verified(
    before: dict[Key, Any], after: dict[Key, Any], reach: set[str], path: str, wanted: dict[str, float | str]
) -> tuple[Change, ...]:
    """What changed, at most the wanted attributes of ``path`` and of what inherits from it.

    Raises:
        AssetError: something else changed, or a wanted value did not arrive.
    """
    changed = [key for key in before | after if before.get(key) != after.get(key)]
    for choice, where, name in changed:
        if name not in wanted or where not in reach:
            raise AssetError(f"{where}.{name} ({' '.join(choice)}) would change too; edit the file by hand")
    for name, value in wanted.items():
        if not any(key[1:] == (path, name) and found in _readings(name, value) for key, found in after.items()):
            text = f"{path}: {name} = {value_text(name, value)}"
            raise AssetError(f"{text} does not take effect: a stronger opinion stands elsewhere")
    found = {(key[1], key[2]): (before.get(key), after[key]) for key in reversed(changed)}
    return tuple(
        Change(prim=where, attribute=name, before=old, after=new)
        for (where, name), (old, new) in sorted(found.items(), key=lambda item: (item[0][0] != path, item[0]))
    )
