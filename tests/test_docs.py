"""The pages keep up with the code: each path and Python name that they give exists, and no page outgrows its reader."""

import ast
import importlib
import re
from pathlib import Path

import pytest

from mrwarp.rl import WALK

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted(
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md"), *ROOT.glob("[mp]o*/README.md")]
)
ROOMS = "mrwarp|tests|benchmarks|docs|assets|policies|models|train|viz"
PATH = re.compile(rf"(?<![\w./-])((?:{ROOMS})/[\w./-]*[\w/])(?![\w/]*[*{{])")
NAME = re.compile(r"(?<![\w./-])(?:mrwarp|benchmarks|paper)(?:\.[A-Za-z_]\w*)+")
MADE = {
    "mrwarp/effects/end_stop.py",
    "mrwarp/effects/laws/soft_sign.py",
    "mrwarp/robot_logs/causes/joint_spring.py",
    "assets/usd/mr_go_extended.usda",
}
"""Files that a page asks its reader to make."""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_paths_of_a_page_exist(page: Path) -> None:
    """Files and folders of the repository, as ``mrwarp/env/sim.py``, and links between pages."""
    text = page.read_text(encoding="utf-8")
    paths = {found.rstrip("/") for found in PATH.findall(text)} - MADE - {WALK}
    assert [path for path in sorted(paths) if not (ROOT / path).exists()] == []
    links = {link for link in re.findall(r"\]\(([^)#:]+)(?:#[\w-]+)?\)", text)}
    assert [link for link in sorted(links) if not (page.parent / link).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_names_of_a_page_exist(page: Path) -> None:
    """Modules and what they hold, as ``mrwarp.model_file.load_model``, also those that its Python examples import."""
    names = set(NAME.findall(page.read_text(encoding="utf-8")))
    for code in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("mrwarp"):
                names |= {f"{node.module}.{alias.name}" for alias in node.names}
    assert [name for name in sorted(names) if not exists(name)] == []


def exists(name: str) -> bool:
    """Whether a dotted name can be reached: a module and attributes of it."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError as error:
            if error.name == "mjlab":  # a module of ours that needs mjlab's own environment
                return True
            continue
        for part in parts[count:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def cells(text: str) -> list[str]:
    """Cells of a page's tables, code counted as one word."""
    rows = [line for line in text.splitlines() if line.startswith("|")]
    plain = [re.sub(r"`[^`]*`", "c", re.sub(r"\]\([^)]*\)", "]", row)) for row in rows]
    return [cell.strip() for row in plain for cell in row.strip("|").split("|")]


def test_the_readme_is_short() -> None:
    """A newcomer reads at most 110 lines before the pages, and at most 15 words of a table's cell."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 110
    assert [cell for cell in cells(text) if len(cell.split()) > 15] == []
    assert len(cells("| a `b c d` | " + "word " * 16 + "|")[1].split()) == 16


@pytest.mark.parametrize("page", sorted((ROOT / "docs").rglob("*.md")), ids=lambda page: page.name)
def test_a_page_is_read_in_one_sitting(page: Path) -> None:
    """At most 200 lines; more is two subjects."""
    assert len(page.read_text(encoding="utf-8").splitlines()) <= 200


QUESTIONS = {
    "how to add an effect": ("docs/extend.md", "One file and one line"),
    "what a suspect is": ("docs/diagnosis.md", "A **suspect** is an effect that"),
    "why a cause was not named": ("docs/diagnosis.md", "Look at them in this order"),
    "which numbers of a robot were guessed": ("docs/robot.md", "Which numbers of a robot were guessed?"),
}
"""Questions of a newcomer, each with the page of its answer and words of it."""


def linked(page: Path) -> set[Path]:
    """Pages that a page links to."""
    links = re.findall(r"\]\(([^)#:]+\.md)(?:#[\w-]+)?\)", page.read_text(encoding="utf-8"))
    return {(page.parent / link).resolve() for link in links}


@pytest.mark.parametrize("question", QUESTIONS)
@pytest.mark.parametrize("start", ["README.md", "docs/index.md"])
def test_an_answer_is_two_clicks_away(start: str, question: str) -> None:
    """From README and from the site's first page."""
    name, words = QUESTIONS[question]
    once = linked(ROOT / start)
    assert ROOT / name in once.union(*map(linked, once))
    assert words in (ROOT / name).read_text(encoding="utf-8")


def test_wrong_paths_and_names_are_found() -> None:
    """Faults that the tests above look for."""
    assert PATH.findall("see `mrwarp/nowhere.py`, [x](docs/data.md) and mrwarp/kernels/") == [
        "mrwarp/nowhere.py",
        "docs/data.md",
        "mrwarp/kernels/",
    ]
    assert exists("mrwarp.params.MrParams.to_dict")
    assert not exists("mrwarp.params.NoSuchThing") and not exists("mrwarp.nowhere")
    assert NAME.findall("`python -m benchmarks.nowhere`, docs/results/paper.json") == ["benchmarks.nowhere"]


def test_the_changelog_begins_with_this_version_in_sixty_lines() -> None:
    """It holds what users notice per release, no more; the version stands in CITATION.cff alone."""
    (version,) = re.findall(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    _, *releases = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert releases[0].split()[0] == version
    for release in releases:
        assert release.count("\n") <= 60, release.split()[0]
