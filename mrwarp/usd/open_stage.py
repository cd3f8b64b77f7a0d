"""Opening a USD file in this process: its schemas, its limits, nothing outside its folder, every error on one line.

What a file can do to USD's reader is tried out in another process first, see :mod:`mrwarp.usd.stage_trial`.
"""

from __future__ import annotations

import itertools
import math
import re
import warnings
from collections.abc import Iterator
from pathlib import Path

import newton_usd_schemas  # noqa: F401  (registers Newton's schemas; must happen before the registry is first used)
from pxr import Plug, Sdf, Tf, Usd, UsdUtils

from mrwarp.run_dir import no_file

SCHEMA = "MrwarpMRDriveAPI"
"""Applied API schema that makes a ``NewtonActuator`` an MR joint."""

_HERE = Path(__file__).resolve().parents[1]
ASSETS = next((p for p in (_HERE / "assets/usd", _HERE.parent / "assets/usd") if p.is_dir()), _HERE / "assets/usd")
"""Folder of the USD assets: inside the package when installed as a wheel, beside it in a checkout."""

MAX_BYTES = 2**28
"""Largest file [bytes]."""

MAX_NESTING = 100
"""Deepest nesting of brackets in a text file; at some ten thousands USD's reader overflows the stack."""

MAX_CHOICES = 64
"""Most combinations of the default prim's variants."""

MAX_QUOTED = 400
"""Most characters of USD's own messages, which quote from the file."""

MAX_MESSAGE = 1500
"""Length of a refusal [characters]."""

_OPAQUE = re.compile(
    rb'"""(?:\\.|[^\\])*?(?:"""|\\?\Z)|'
    rb"'''(?:\\.|[^\\])*?(?:'''|\\?\Z)|"
    rb'"(?:\\.|[^"\\\n])*(?:"|(?=\n)|\\?\Z)|'
    rb"'(?:\\.|[^'\\\n])*(?:'|(?=\n)|\\?\Z)|"
    rb"#[^\n]*|//[^\n]*|/\*.*?(?:\*/|\Z)|@@@.*?(?:@@@|\Z)|@[^@\n]*",
    re.DOTALL,
)
"""Texts, comments and file names of a ``.usda`` file; unfinished ones match too, so that time is linear."""

_MARKS = re.compile(rb"(?P<bracket>[()\[\]{}])|" + _OPAQUE.pattern, re.DOTALL)
_NO_BRACKETS = bytes(set(range(256)) - set(b"()[]{}"))


class AssetError(ValueError):
    """A USD asset was refused; the message names file, prim path, attribute, value and the allowed range or remedy.

    Names and values come from the file and may be of any length: the middle of a long message is left out.
    """

    def __init__(self, message: str) -> None:
        if len(message) > MAX_MESSAGE:
            message = f"{message[: MAX_MESSAGE - 400]} ... {message[-395:]}"
        super().__init__(message)


def register_schema() -> None:
    """Make USD know :data:`SCHEMA`; called on import. Too late once USD's registry is built: then loading warns."""
    Plug.Registry().RegisterPlugins(str(ASSETS / "schema"))


register_schema()


def open_here(file: Path, allow_external: bool = False) -> Usd.Stage:
    """Open ``file`` with a session layer of its own as edit target; nothing but its composition is checked."""
    check_layer(file)
    try:
        layer = Sdf.Layer.FindOrOpen(str(file.resolve()))
        if layer is not None:
            layer.Reload()  # the file may have been edited since an earlier load in this process
            if not allow_external:
                _refuse_external(layer, file.resolve().parent, set())
        stage = Usd.Stage.Open(layer, Sdf.Layer.CreateAnonymous("session.usda")) if layer else None
    except Tf.ErrorException as error:
        raise AssetError(f"{file}: not readable as USD: {said(error)}; repair the file there") from None
    if stage is None or not stage.GetDefaultPrim():
        raise AssetError(f"{file}: not readable as USD, or without a defaultPrim; name the robot's root prim there")
    for error in stage.GetCompositionErrors():
        raise AssetError(f"{file}: composition error: {said(error)}; repair the reference or path named there")
    if Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(SCHEMA) is None:
        warnings.warn(
            f"USD built its schema registry before {SCHEMA} was registered; "
            "import mrwarp.usd.asset before other USD code. "
            "Parameters load as authored; USD tools show no units and defaults.",
            stacklevel=3,
        )
    stage.SetEditTarget(stage.GetSessionLayer())
    return stage


def check_layer(file: Path) -> None:
    """Refuse what USD must not even begin to read: no file, too large, brackets nested too deep."""
    if not file.is_file():
        raise AssetError(f"{file}: {no_file(file, 'file')}; name a .usda file, such as those in {ASSETS}")
    try:
        if file.stat().st_size > MAX_BYTES:
            raise AssetError(f"{file}: {file.stat().st_size} bytes; allowed: {MAX_BYTES}; put meshes into other files")
        data = file.read_bytes()
    except OSError as error:
        raise AssetError(f"{file}: cannot be read: {error.strerror}; check the file and its permissions") from None
    if data.startswith(b"#usda") and (line := too_deep(data)):
        raise AssetError(
            f"{file}: line {line}: brackets nested more than {MAX_NESTING} deep; remove the surplus ones there"
        )


def too_deep(text: bytes, most: int = MAX_NESTING) -> int:
    """First line in which brackets outside texts and comments are nested deeper than ``most``; 0 if none are."""
    marks = _OPAQUE.sub(b"", text).translate(None, delete=_NO_BRACKETS)
    depths = itertools.accumulate(1 if mark in b"([{" else -1 for mark in marks)
    first = next((index for index, depth in enumerate(depths) if depth > most), None)
    if first is None:
        return 0
    brackets = (found.start() for found in _MARKS.finditer(text) if found["bracket"])
    return text.count(b"\n", 0, next(itertools.islice(brackets, first, None))) + 1


def choices(stage: Usd.Stage) -> Iterator[tuple[str, ...]]:
    """Select every combination of the default prim's variants in turn; yields its labels, ``robot=mr_go`` first.

    Raises:
        AssetError: there are more than :data:`MAX_CHOICES`.
    """
    root = stage.GetDefaultPrim()
    sets = root.GetVariantSets()
    names = sorted(sets.GetNames(), reverse=True)
    offered = [sorted(sets.GetVariantSet(name).GetVariantNames(), key=lambda n: (n != "mr_go", n)) for name in names]
    if (count := math.prod(map(len, offered))) > MAX_CHOICES:
        raise AssetError(
            f"{stage.GetRootLayer().realPath}: {root.GetPath()}: {count} combinations of variants; "
            f"allowed: {MAX_CHOICES}; remove some"
        )
    for choice in itertools.product(*offered):
        for name, variant in zip(names, choice, strict=True):
            sets.SetSelection(name, variant)
        yield tuple(f"{name}={variant}" for name, variant in zip(names, choice, strict=True))


def said(error: object) -> str:
    """What USD's errors say, on one line, without where in USD's own source they were raised."""
    try:
        text = str(error)
    except UnicodeDecodeError:  # the message quotes the file
        return "the text is not UTF-8"
    found = re.findall(r" at line \d+ in file \S+ : '(.*?)'(?=\n|$)", text.strip(), flags=re.DOTALL)
    return " ".join(" ".join(found or [text]).split())[:MAX_QUOTED]


def _refuse_external(layer: Sdf.Layer, folder: Path, seen: set[str]) -> None:
    """Refuse any path in ``layer`` (layers, clips, asset attributes), and in what it names, that leaves ``folder``."""
    seen.add(layer.identifier)
    for name in itertools.chain(*UsdUtils.ExtractExternalReferences(layer.identifier)):
        try:
            target = Path(layer.ComputeAbsolutePath(name)).resolve()
            there = target.is_file()
        except (OSError, ValueError, RuntimeError):  # too long, with a NUL, links in a circle
            raise AssetError(f"{layer.identifier}: @{name[:80]!r}@ is no file name; correct it") from None
        if "://" in name or not target.is_relative_to(folder):
            raise AssetError(
                f"{layer.identifier}: @{name}@ lies outside the asset's folder {folder}; "
                "copy it there, or pass allow_external=True if you trust it"
            )
        if not there or not Usd.Stage.IsSupportedFile(str(target)):
            continue  # what is missing is a composition error, or nobody's business
        check_layer(target)
        inner = Sdf.Layer.FindOrOpen(str(target))
        if inner is not None and inner.identifier not in seen:
            _refuse_external(inner, folder, seen)
