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
NUMBERS = {"sysid": 4, "diagnose": 43, "identify": 102, "robot_logs": 57}
"""Numbers at module level, by package, that are neither exempt nor fields: steps of derivatives, samples of a search,
memory of a launch, lengths of time of sensors and benches. Each goes down only."""


def _counted(path: Path) -> list[float]:
    """Numbers in assignments at module level, but for pictures and wording, declared causes, and tables.

    A table is a dict, as of units or of powers of scales. 0 is no threshold.
    """
    if "report" in path.parts or path.name in ("verdict_text.py", "fit_pictures.py") or path.parent == DECLARED:
        return []
    found = []
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and not isinstance(node.value, ast.Dict | None):
            values = (x.value for x in ast.walk(node.value) if isinstance(x, ast.Constant))
            found += [x for x in values if isinstance(x, int | float) and not isinstance(x, bool) and x]
    return found


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
    for path in FILES:
        found[path.relative_to(ROOT / "mrwarp").parts[0]] += len(_counted(path))
    assert {package: found[package] for package in PACKAGES if found[package] > NUMBERS[package]} == {}
