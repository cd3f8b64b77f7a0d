"""Makes experiments in the order of their needs, and only what changed; one failure loses nothing else.

Each experiment has a folder: its pictures, its simulated data as ``.npz``, and ``findings.json``, written last in an
atomic write, with the key of everything that it depends on. A run that was stopped goes on with what is missing.
"""

from __future__ import annotations

import ast
import hashlib
import json
import math
import time
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

import mrwarp
from mrwarp.run_dir import atomic_write, one_line, plain, versions, write_text
from mrwarp.usd.open_stage import ASSETS
from paper.reproduce.comparison import Findings
from paper.reproduce.settings import NotYet, Settings

KEPT = "findings.json"
"""Files of an experiment in its folder."""

PACKAGES = ("mrwarp", "paper")
"""Packages whose code an experiment depends on."""

LISTS = ("mrwarp", "paper.reproduce.contents", "paper.reproduce.verdicts")
"""Modules that name others or judge committed figures: no result depends on them."""

WRITERS = (
    *("mrwarp.options", "mrwarp.run_dir", "mrwarp.runtime", "mrwarp.viewing", "mrwarp.trials.walk_pictures"),
    *("paper.reproduce.cache", "paper.reproduce.comparison"),
)
"""Packages and modules that read options, write files and draw: a report depends on them, its figures do not."""

T = TypeVar("T")
Report = Callable[[str, float], None]


@dataclass(frozen=True, kw_only=True)
class Job:
    """Inputs of an experiment."""

    settings: Settings
    out: Path
    """Its own folder; those of the others stand next to it."""
    report: Report = lambda text, share: None
    """Called with what runs and the share that is done."""

    def save(self, data: Any) -> Findings:
        """Write a simulation's data, which other experiments :meth:`load`; it finds nothing itself."""
        save(self.out / f"{self.out.name}.npz", data)
        return Findings()

    def load(self, name: str, kind: type[T]) -> T:
        """Data of the simulation of this name."""
        return load(self.out.parent / name / f"{name}.npz", kind)


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """How an entry of the report, or a simulation that several entries read, is made."""

    name: str
    """As on the command line; one that has no title in the report is read by others alone."""
    compute: Callable[[Job], Findings]
    """Makes the rows; its module and all that it imports are what the entry depends on."""
    needs: tuple[str, ...] = ()
    """Experiments whose folders it reads."""
    settings: tuple[str, ...] = ()
    """Names of the :class:`Settings` it depends on."""
    files: Callable[[], Sequence[Path]] = tuple
    """Further input files."""
    loads: tuple[str, ...] = ()
    """Modules that it loads by their names, where no import shows it; a package stands for all that is in it."""
    seconds: Callable[[Settings], float] = lambda settings: 1.0
    """How long it takes on two idle cores with some settings [s]."""

    def key(self, settings: Settings, keys: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
        """Everything that the result depends on, by kind; ``keys`` are those of the experiments that it needs.

        Figures depend on ``rests_on`` alone, which is what a committed figure keeps, see :mod:`paper.reproduce.age`.
        """
        modules = (self.compute.__module__, *self.loads)
        rests_on = {
            "code": code_hash(modules, without=(*LISTS, *WRITERS)),
            "settings": {name: _content(getattr(settings, name)) for name in self.settings},
            "files": {
                f"{path.parent.name}/{path.name}": _content(path) for path in (ASSETS / "mr_go.usda", *self.files())
            },
            "needs": {name: keys[name]["rests_on"] for name in self.needs},
        }
        return {
            "rests_on": _hash(json.dumps(rests_on, sort_keys=True)),
            "report": code_hash(modules, without=LISTS),
            "versions": versions(),
            "needs": {name: _hash(json.dumps(keys[name], sort_keys=True)) for name in self.needs},
        }


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How one experiment ended."""

    name: str
    status: str
    """``made``, ``kept``, ``waiting`` (what it needs is not there yet), ``failed`` or ``not run``."""
    findings: Findings | None = None
    seconds: float = 0.0
    """Time that it took when it was made [s]."""
    processor: float = 0.0
    """And on all cores together [s], which other programs do not lengthen."""
    rests_on: str = ""
    """Hash of what its figures depend on, see :meth:`Experiment.key`."""
    made: str = ""
    """Day on which it was made."""
    message: str = ""
    """Why there are no findings."""


@dataclass(kw_only=True)
class Runner:
    """One run of some experiments."""

    catalogue: Mapping[str, Experiment]
    """All experiments by name."""
    settings: Settings
    out: Path
    report: Report = lambda text, share: None
    """Called with what runs and the share of it that is done."""
    outcomes: dict[str, Outcome] = field(default_factory=dict)
    """How each experiment ended, by name, in the order in which they were run."""
    keys: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Dependencies of the experiments, by name."""

    def estimate(self, wanted: Sequence[str]) -> dict[str, float]:
        """Time on two idle cores of all that :meth:`run` would make, by name [s]; without what waits for an input."""
        found: dict[str, float] = {}
        for experiment in self._in_order(wanted):
            try:
                key = self.keys[experiment.name] = experiment.key(self.settings, self.keys)
            except (NotYet, KeyError):  # an input is not there, or that of an experiment that it needs
                continue
            if _read(self.out / experiment.name / KEPT, key) is None:
                found[experiment.name] = experiment.seconds(self.settings)
        return found

    def run(self, wanted: Sequence[str]) -> None:
        """Make or keep the experiments, each after what it needs; ``outcomes`` grows as they end.

        Raises:
            KeyboardInterrupt: the run was stopped; what is done is kept.
            KeyError: there is no experiment of that name.
        """
        for experiment in self._in_order(wanted):
            if experiment.name not in self.outcomes:
                self.outcomes[experiment.name] = self._make(experiment)

    def _in_order(self, wanted: Sequence[str]) -> Iterator[Experiment]:
        """The experiments, each after what it needs."""
        for name in wanted:
            yield from self._in_order(self.catalogue[name].needs)
            yield self.catalogue[name]

    def _make(self, experiment: Experiment) -> Outcome:
        name, folder = experiment.name, self.out / experiment.name
        for need in experiment.needs:
            if (outcome := self.outcomes[need]).findings is None:
                status = "waiting" if outcome.status == "waiting" else "failed"
                return Outcome(name=name, status=status, message=f"needs {need}: {outcome.message}")
        try:
            self.keys[name] = key = experiment.key(self.settings, self.keys)
            if (kept := _read(folder / KEPT, key)) is not None:
                return kept
            folder.mkdir(parents=True, exist_ok=True)
            for stale in (KEPT, "error.txt"):  # what follows may be cut short, and its data are another key's
                (folder / stale).unlink(missing_ok=True)
            started, worked = time.perf_counter(), time.process_time()
            job = Job(
                settings=self.settings,
                out=folder,
                report=lambda text, share: self.report(f"{name}: {text}" if text else name, share),
            )
            job.report("", 0.0)
            findings = experiment.compute(job)
            seconds, processor = time.perf_counter() - started, time.process_time() - worked
            spent = {"seconds": seconds, "processor": processor, "made": datetime.now(UTC).date().isoformat()}
            content = plain({"key": key, **spent, "findings": asdict(findings)})
            write_text(folder / KEPT, json.dumps(content, indent=1, allow_nan=False))
        except NotYet as error:
            return Outcome(name=name, status="waiting", message=str(error))
        except Exception as error:  # any error of one experiment; the others go on
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "error.txt").write_text(traceback.format_exc(), encoding="utf-8")
            return Outcome(name=name, status="failed", message=one_line(error) or type(error).__name__)
        return Outcome(name=name, status="made", findings=findings, rests_on=key["rests_on"], **spent)


def _read(path: Path, key: dict[str, Any]) -> Outcome | None:
    """Result under the same key; None if there is none, or it is damaged or of another layout."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["key"] == json.loads(json.dumps(key)):
            findings = typed(content["findings"], Findings)
            seconds, processor = float(content["seconds"]), float(content["processor"])
            spent = {"seconds": seconds, "processor": processor, "made": str(content["made"])}
            return Outcome(name=path.parent.name, status="kept", findings=findings, rests_on=key["rests_on"], **spent)
    except (OSError, LookupError, TypeError, ValueError, RecursionError):
        pass
    return None


def code_hash(
    modules: Sequence[str],
    root: Path = Path(mrwarp.__file__).parents[1],
    packages: Collection[str] = PACKAGES,
    *,
    without: Collection[str] = (),
) -> str:
    """Hash of modules and of all that they import of these packages in ``root``.

    Comments, layout, docstrings, the claims of an entry and imports for types alone do not count. Modules ``without``
    which, and what stands in packages of that name, are neither counted nor followed; of "mrwarp" its public names.
    """
    found: dict[str, str] = {}
    waiting, seen = [name for module in modules for name in _inside(module, root)], set()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        path = root.joinpath(*name.split("."))
        path = next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)
        left_out = any(name == other or ("." in other and name.startswith(f"{other}.")) for other in without)
        if path is not None and not left_out:
            found[name], imports = _parse(path)
            waiting += [imported for imported in imports if imported.split(".")[0] in packages]
    return _hash(json.dumps(found, sort_keys=True))


def file_hash(path: Path) -> str:
    """Hash of a file; of Python code as :func:`code_hash` counts it, without what it imports."""
    return _parse(path)[0] if path.suffix == ".py" else _hash(path.read_bytes())


def _inside(module: str, root: Path) -> list[str]:
    """A module, or all modules of a package."""
    folder = root.joinpath(*module.split("."))
    inside = sorted(folder.rglob("*.py")) if folder.is_dir() else []
    return [".".join(path.relative_to(root).with_suffix("").parts) for path in inside] or [module]


@lru_cache(maxsize=1024)
def _parse(path: Path) -> tuple[str, list[str]]:
    """A module without what :func:`code_hash` does not count, and the modules that it may import."""
    tree, imports = _counted(ast.parse(path.read_text(encoding="utf-8"))), []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            imports += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return _hash(ast.dump(tree)), imports


def _counted(tree: ast.Module) -> ast.Module:
    """A module without docstrings, ``CLAIMS``, and what is imported for types alone."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [part for part in node.body if not _says_only(part)]
    return tree


def _says_only(node: ast.stmt) -> bool:
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    if isinstance(node, ast.If):
        return isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    return isinstance(node, ast.Assign) and [ast.unparse(target) for target in node.targets] == ["CLAIMS"]


def _content(value: Any) -> Any:
    """A setting as plain values; a file is its content, wherever it lies."""
    if isinstance(value, Mapping):
        return {name: _content(item) for name, item in value.items()}
    if isinstance(value, tuple):
        return [_content(item) for item in value]
    return _hash(value.read_bytes()) if isinstance(value, Path) else value


def _hash(data: str | bytes) -> str:
    return hashlib.sha256(data.encode() if isinstance(data, str) else data).hexdigest()


def save(path: Path, data: Any) -> None:
    """Write nested dataclasses, dicts, lists, arrays and plain values in an atomic write; never pickled."""
    arrays: dict[str, np.ndarray] = {}

    def strip(value: Any) -> Any:
        if is_dataclass(value):
            return {f.name: strip(getattr(value, f.name)) for f in fields(value)}
        if isinstance(value, np.ndarray):
            arrays[f"a{len(arrays)}"] = value
            return {"__array__": f"a{len(arrays) - 1}"}
        if isinstance(value, dict):
            return {name: strip(item) for name, item in value.items()}
        return [strip(item) for item in value] if isinstance(value, list | tuple) else value

    tree = np.array(json.dumps(strip(data)))
    with atomic_write(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, tree=tree, **arrays)  # type: ignore[arg-type]


def load(path: Path, kind: type[T]) -> T:
    """Read what :func:`save` wrote of a dataclass."""
    with np.load(path, allow_pickle=False) as file:
        return typed(json.loads(str(file["tree"])), kind, file)


def typed(value: Any, kind: Any, arrays: Mapping[str, np.ndarray] | None = None) -> Any:
    """Plain values of JSON as the dataclasses that their type names; null as NaN for a number.

    Raises:
        KeyError, TypeError: the values are not of that type.
    """
    if isinstance(value, dict) and "__array__" in value and arrays is not None:
        return arrays[value["__array__"]]
    kinds = [item for item in get_args(kind) if item is not NoneType]
    if get_origin(kind) in (Union, UnionType):
        return None if value is None else typed(value, kinds[0], arrays)
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{name: typed(item, hints[name], arrays) for name, item in value.items()})  # type: ignore[operator]
    items = kinds[-1] if kinds else Any
    if isinstance(value, dict):
        return {name: typed(item, items, arrays) for name, item in value.items()}
    if isinstance(value, list):
        return [typed(item, items, arrays) for item in value]
    return math.nan if value is None and kind is float else value
