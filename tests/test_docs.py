"""The pages keep up with the code: each path and Python name that they give exists."""

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
