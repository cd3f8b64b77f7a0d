"""The package stays readable: small rooms, and no more deciding numbers than now in the method of identification.

``make lint`` runs this file; Ruff's PLR0912 and PLR0915 count branches and statements, its PLC0415 wants imports at the
top of files, and import-linter knows who may import whom.
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


def test_rooms_are_small_and_a_name_is_given_once() -> None:
    """At most 20 files in a folder, ten next to the package's own folders; ``walking`` is one module, not two."""
    files = [path for package in ("mrwarp", "paper") for path in (ROOT / package).rglob("*.py")]
    rooms = Counter(path.parent.relative_to(ROOT).as_posix() for path in files)
    names = Counter(path.stem for path in files if not path.stem.startswith("__"))
    crowded = {room for room, n in rooms.items() if n > (10 if room == "mrwarp" else 20)}
    assert crowded <= {"mrwarp/effects"} and [name for name, n in names.items() if n > 1] == []


def test_the_settings_stay_few() -> None:
    """One more needs one less."""
    assert sum(len(fields(cast(Any, group.default_factory))) for group in fields(Settings)) <= SETTINGS


def test_numbers_of_the_method_go_down_only() -> None:
    """A threshold more needs one less; settings have a unit, a reason, and what set them."""
    found = Counter()
    for path in FILES:
        found[path.relative_to(ROOT / "mrwarp").parts[0]] += len(_counted(path))
    assert {package: found[package] for package in PACKAGES if found[package] > NUMBERS[package]} == {}
