"""What a result depends on, as a hash: code, settings, input files, versions and the results it was made from.

Code means the modules of this package that the experiment's module imports, directly or not, inside functions too.
Comments, docstrings and layout do not count: a module's syntax tree is hashed.
"""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import mrwarp
from mrwarp.reproduce.experiment import Experiment
from mrwarp.reproduce.settings import Settings
from mrwarp.run_dir import versions
from mrwarp.usd.open_stage import ASSETS

ROOT = Path(mrwarp.__file__).resolve().parent
"""Folder of the package."""


def key(experiment: Experiment, settings: Settings, needed: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Everything a result depends on, by kind; two equal keys mean equal results.

    Args:
        experiment: The experiment.
        settings: The settings of this run.
        needed: Keys of the experiments it needs.

    Raises:
        OSError: an input file cannot be read.
    """
    return {
        "code": code_hash(experiment.compute.__module__),
        "settings": {name: _value(getattr(settings, name)) for name in experiment.settings},
        "files": {path.name: file_hash(path) for path in (ASSETS / "mr_go.usda", *experiment.files(settings))},
        "versions": versions(),
        "needs": {name: digest(needed[name]) for name in experiment.needs},
    }


def digest(value: Any) -> str:
    """Hash of plain values."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def file_hash(path: Path) -> str:
    """Hash of a file's bytes."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def code_hash(module: str, root: Path = ROOT) -> str:
    """Hash of a module and of every module of the package it reaches."""
    return digest({name: module_hash(path) for name, path in sorted(reached(module, root).items())})


def reached(module: str, root: Path = ROOT) -> dict[str, Path]:
    """The module and those of the package that it imports, directly or not: name to file."""
    found: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = _file(name, root)
        if path is not None and name not in found:
            found[name] = path
            waiting += imports(path, root.name)
    return found


@lru_cache(maxsize=1024)
def imports(path: Path, package: str) -> tuple[str, ...]:
    """Names of the package's modules that a file may import; ``from a import b`` gives ``a`` and ``a.b``."""
    return tuple(_imports(ast.parse(path.read_text(encoding="utf-8")), package))


@lru_cache(maxsize=1024)
def module_hash(path: Path) -> str:
    """Hash of a module's syntax tree without docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            # a string that stands alone does nothing, wherever it stands
            node.body = [s for s in node.body if not _is_text(s)] or [ast.Pass()]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


def _imports(tree: ast.AST, package: str) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] == package)
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == package:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _file(name: str, root: Path) -> Path | None:
    """File of a module of the package, or None if there is none of that name."""
    parts = name.split(".")[1:]
    package, module = root.joinpath(*parts, "__init__.py"), root.joinpath(*parts).with_suffix(".py")
    if parts and module.is_file():
        return module
    return package if package.is_file() else None


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _value(value: Any) -> Any:
    """A setting as plain values; a policy is its content, wherever it lies."""
    if isinstance(value, Path):
        return file_hash(value)
    if isinstance(value, Mapping):
        return {str(name): _value(item) for name, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_value(item) for item in value]
    return value
