"""What a result depends on, as a hash: code, settings, input files, versions and the results it was made from.

Code means the modules of this package that the experiment's module imports, directly or not. Comments, docstrings and
layout do not count: a module's syntax tree is hashed.
"""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Mapping, Sequence
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
        "settings": {name: _plain(getattr(settings, name)) for name in experiment.settings},
        "files": {path.name: _hash(path.read_bytes()) for path in (ASSETS / "mr_go.usda", *experiment.files())},
        "versions": versions(),
        "needs": {name: _hash(json.dumps(needed[name], sort_keys=True).encode()) for name in experiment.needs},
    }


def code_hash(module: str, root: Path = ROOT) -> str:
    """Hash of a module and of every module of the package that it imports, directly or not."""
    found: dict[str, str] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = root.joinpath(*name.split(".")[1:])
        path = next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)
        if path is not None and name not in found:
            found[name], imports = _parse(path, root.name)
            waiting += imports
    return _hash(json.dumps(found, sort_keys=True).encode())


@lru_cache(maxsize=1024)
def _parse(path: Path, package: str) -> tuple[str, list[str]]:
    """Hash of a module's syntax tree without docstrings, and the modules of the package that it may import."""
    tree, imports = ast.parse(path.read_text(encoding="utf-8")), []
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            # a string that stands alone does nothing, wherever it stands
            node.body = [s for s in node.body if not _is_text(s)] or [ast.Pass()]
        elif isinstance(node, ast.Import):
            imports += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            imports += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return _hash(ast.dump(tree).encode()), [name for name in imports if name.split(".")[0] == package]


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _plain(value: Any) -> Any:
    """A setting as plain values; a policy is its content, wherever it lies."""
    if isinstance(value, Path):
        return _hash(value.read_bytes())
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, Sequence) and not isinstance(value, str) else value


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
