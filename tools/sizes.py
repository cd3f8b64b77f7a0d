"""Sizes that stay small: folders, pages, stages, settings, numbers by which the method of identification decides.

``make lint`` runs it; each finding names place and limit. Ruff's PLR0912 and PLR0915 count branches and statements, its
PLC0415 wants imports at the top of files, and import-linter knows who may import whom.
"""

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, cast

ROOT = Path(__file__).resolve().parents[1]
ROOM, OWN_ROOM = 20, 10
"""Most files of a folder, and of ``mrwarp`` itself, next to its folders."""
CROWDED = {"mrwarp/effects"}
"""Folders with more: a law each."""
PAGE, FIRST_PAGE, RELEASE = 200, 110, 60
"""Most lines of a page, of README.md, and of a release in CHANGELOG.md: what is read in one sitting."""
SETTINGS = 120
"""Most numbers by which the method and its two plants decide, each a documented field of the settings."""
NUMBERS = {"sysid": 4, "diagnose": 43, "identify": 102, "robot_logs": 57}
"""Numbers at module level, by package, that are neither exempt nor fields: steps of derivatives, samples of a search,
memory of a launch, lengths of time of sensors and benches. Each goes down only."""
DECLARED = ROOT / "mrwarp" / "robot_logs" / "causes"
"""Declarations of causes: sizes of physics, as those of ``mrwarp/effects``."""


def counted(path: Path) -> list[float]:
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


def of_code() -> Iterator[str]:
    """Crowded folders, names of two modules, and numbers."""
    from mrwarp.sysid.settings import Settings

    files = [path for package in ("mrwarp", "paper") for path in (ROOT / package).rglob("*.py")]
    rooms = Counter(path.parent.relative_to(ROOT).as_posix() for path in files)
    for room, n in rooms.items():
        if n > (OWN_ROOM if room == "mrwarp" else ROOM) and room not in CROWDED:
            yield f"{room}: {n} files; make two folders"
    for name, n in Counter(path.stem for path in files if not path.stem.startswith("__")).items():
        if n > 1:
            yield f"{name}.py: {n} modules of this name; rename one"
    settings = sum(len(fields(cast(Any, group.default_factory))) for group in fields(Settings))
    if settings > SETTINGS:
        yield f"mrwarp/sysid/settings: {settings} fields, {SETTINGS} at most; one more needs one less"
    for package, most in NUMBERS.items():
        n = sum(len(counted(path)) for path in (ROOT / "mrwarp" / package).rglob("*.py"))
        if n > most:
            yield f"mrwarp/{package}: {n} numbers at module level, {most} at most; make one a setting or take one out"


def of_stages() -> Iterator[str]:
    """Texts of progress whose first clause, a number put in as a word, is cut where it means nothing."""
    from mrwarp.options.progress_bar import IN_FULL, STAGE_WORDS

    for path in sorted((ROOT / "mrwarp").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not (isinstance(node, ast.Call) and node.args and isinstance(node.func, ast.Name | ast.Attribute)):
                continue
            called = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
            given = node.args[0]
            parts = given.values if isinstance(given, ast.JoinedStr) else [given]
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "0" for part in parts)
            if called in ("log", "progress") and not text.startswith(IN_FULL):
                stage = re.split(r"[:;]\s|\s\(|,\s", text)[0]
                if len(stage.split()) > STAGE_WORDS:
                    where = f"{path.relative_to(ROOT)}:{node.lineno}"
                    yield f"{where}: {stage!r} has more than {STAGE_WORDS} words; end its first clause earlier"


def of_pages() -> Iterator[str]:
    """Long pages, long releases, and a changelog that lacks this version, which CITATION.cff alone holds."""
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        most = FIRST_PAGE if page.name == "README.md" else PAGE
        if (n := len(page.read_text(encoding="utf-8").splitlines())) > most:
            yield f"{page.relative_to(ROOT)}: {n} lines, {most} at most; more is two subjects"
    (version,) = re.findall(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    _, *releases = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    if releases[0].split()[0] != version:
        yield f"CHANGELOG.md: begins with {releases[0].split()[0]}, this is {version} (CITATION.cff)"
    for release in releases:
        if release.count("\n") > RELEASE:
            yield f"CHANGELOG.md: more than {RELEASE} lines for {release.split()[0]}; keep what users notice"


if __name__ == "__main__":
    findings = [*of_code(), *of_stages(), *of_pages()]
    print("\n".join(findings) or "sizes: within their limits")
    sys.exit(bool(findings))
