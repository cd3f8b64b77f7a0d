"""The layout that a newcomer relies on: small rooms, names that are given once, and imports at the top of files.

Who may import whom is written in ``pyproject.toml`` and checked by ``make lint`` (import-linter).
"""

import ast
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FILES = sorted(path for package in ("mrwarp", "paper") for path in (ROOT / package).rglob("*.py"))
CATALOGUES = {"mrwarp/effects"}
"""Folders that may have more files: one law each."""
QUICK_HELP = ("mrwarp/cli.py", "mrwarp/commands/", "paper/commands/")
"""Files that import when they run, so that ``--help`` waits for no engine."""
ON_USE = (
    "mrwarp/actuator/newton_drive.py", "mrwarp/viewing/live_view.py", "mrwarp/env/natural_units.py",
    "mrwarp/diagnose/checks/recording_faults.py", "mrwarp/diagnose/data_checks.py", "mrwarp/identify/contradictions.py",
)  # fmt: skip
"""Files of which most callers do without one part: the drive without torch and onnx, pictures without rerun, and
``mrwarp check`` without Warp, boosting and the diagnosis."""


def test_no_room_is_crowded() -> None:
    """At most 20 files in a folder of the package, ten next to its folders."""
    counts = Counter(path.parent.relative_to(ROOT).as_posix() for path in FILES)
    assert {room: n for room, n in counts.items() if n > (10 if room == "mrwarp" else 20)}.keys() <= CATALOGUES


def test_a_module_name_is_given_once() -> None:
    """``walking`` is one module, not two."""
    names = Counter(path.stem for path in FILES if not path.stem.startswith("__"))
    assert [name for name, n in names.items() if n > 1] == []


def test_imports_between_rooms_stand_at_the_top_of_files() -> None:
    """A file's first lines name all of the package that it needs."""
    found = []
    for path in FILES:
        name = path.relative_to(ROOT).as_posix()
        if name.startswith(QUICK_HELP + ON_USE):
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
        inner = [node for function in functions for node in ast.walk(function)]
        for node in (node for node in inner if isinstance(node, ast.Import | ast.ImportFrom)):
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else modules
            found += [f"{name}:{node.lineno}" for module in modules if module.partition(".")[0] in ("mrwarp", "paper")]
    assert sorted(set(found)) == []


def test_only_tables_are_kept_from_the_formatter() -> None:
    """``# fmt: skip`` stands below a collection of at least four entries on several lines."""
    found = []
    for path in (
        p for folder in ("mrwarp", "paper", "tests", "benchmarks", "train") for p in (ROOT / folder).rglob("*.py")
    ):
        text = path.read_text(encoding="utf-8")
        skips = {i for i, line in enumerate(text.splitlines(), 1) if line.rstrip().endswith("# fmt: " + "skip")}
        for node in ast.walk(ast.parse(text)) if skips else ():
            if not isinstance(node, ast.Dict | ast.List | ast.Tuple | ast.Set):
                continue
            entries = node.values if isinstance(node, ast.Dict) else node.elts
            if len({entry.lineno for entry in entries}) > 1 and len(entries) > 3:
                skips -= set(range(node.lineno, (node.end_lineno or 0) + 2))
        found += [f"{path.relative_to(ROOT).as_posix()}:{line}" for line in sorted(skips)]
    assert found == []
