"""The method of identification stays readable: functions that fit on a screen, and no more deciding numbers than now.

``make lint`` runs this file, and Ruff's PLR0912 and PLR0915 count branches and statements.
"""

import ast
from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Any, cast

from mrwarp.sysid.settings import Settings

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("sysid", "diagnose", "identify", "robot_logs")
FILES = [path for package in PACKAGES for path in sorted((ROOT / "mrwarp" / package).rglob("*.py"))]
LINES = 60
"""Most lines of a function, without its head and docstring."""
DECLARED = ROOT / "mrwarp" / "robot_logs" / "causes"
"""Declarations of causes: sizes of physics, as those of ``mrwarp/effects``."""
SETTINGS = 120
"""Most numbers by which the method and its two plants decide, each a documented field of the settings."""
NUMBERS = {"sysid": 3, "diagnose": 186, "identify": 158, "robot_logs": 235}
"""Numbers in assignments at module level, by package, physics and units among them: each goes down only."""


def _length(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    body = function.body[1:] if ast.get_docstring(function) and len(function.body) > 1 else function.body
    return (function.end_lineno or 0) - body[0].lineno + 1


def test_functions_of_the_method_fit_on_a_screen() -> None:
    """At most 60 lines."""
    found = {}
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and _length(node) > LINES:
                found[f"{path.relative_to(ROOT).as_posix()}:{node.name}"] = _length(node)
    assert found == {}


def test_the_settings_stay_few() -> None:
    """One more needs one less."""
    assert sum(len(fields(cast(Any, group.default_factory))) for group in fields(Settings)) <= SETTINGS


def test_numbers_of_the_method_go_down_only() -> None:
    """A threshold more needs one less; settings have a unit, a reason, and what set them."""
    found = Counter()
    for path in (path for path in FILES if path.parent != DECLARED):
        package = path.relative_to(ROOT / "mrwarp").parts[0]
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
                values = (x.value for x in ast.walk(node.value) if isinstance(x, ast.Constant))
                found[package] += sum(isinstance(x, int | float) and not isinstance(x, bool) for x in values)
    assert {package: found[package] for package in PACKAGES if found[package] > NUMBERS[package]} == {}
