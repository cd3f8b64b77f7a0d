"""The site's hooks: every page has its place, and the reference is complete. `make lint` builds the site itself."""

import ast
import importlib.util
import re
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mrwarp
from mrwarp.sysid.settings import Settings

ROOT = Path(__file__).resolve().parents[2]


def hooks() -> Any:
    """The module of hooks, as mkdocs loads it."""
    spec = importlib.util.spec_from_file_location("site_reference", ROOT / "tools/site/reference.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_python_reference_has_every_public_name() -> None:
    """Each with the place of its definition."""
    text = hooks().python_page()
    assert re.findall(r"^## mrwarp\.(\w+)$", text, re.MULTILINE) == sorted(
        mrwarp.__all__, key=list(mrwarp._PLACES).index
    )
    for place in re.findall(r"^::: (\S+)$", text, re.MULTILINE):
        module, _, name = place.rpartition(".")
        source = (ROOT / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")
        assert re.search(rf"^(class|def) {name}\b", source, re.MULTILINE), place


def test_settings_have_defaults_and_meanings() -> None:
    """A field with its default as it is written, and its docstring in one line."""
    code = 'class ACfg:\n    """Doc."""\n    speed: float = 0.5\n    """how fast\n    [m/s]"""\n    num: int\n'
    (node,) = ast.parse(code).body
    assert list(hooks().setting_rows(node)) == ["| `speed` | `0.5` | how fast [m/s] |", "| `num` | `needed` |  |"]
    text = hooks().settings_page()
    assert "| `K1` |" in text and "## ImpactCfg" in text


def test_every_setting_of_a_diagnosis_has_a_row() -> None:
    """With its default, its range, what it trades and what set it."""
    rows = [line for line in hooks().diagnosis_page().splitlines() if line.startswith("| `")]
    groups = [field.default_factory for field in fields(Settings)]
    assert len(rows) == sum(len(fields(group)) for group in groups)
    assert all(len(re.split(r"(?<!\\)\|", row)) == 8 and "; more " in row for row in rows)


def test_links_to_files_that_are_no_pages_become_names() -> None:
    """Links between pages and to pictures stay."""
    page = SimpleNamespace(file=SimpleNamespace(src_uri="performance.md"))
    text = "[loop](../benchmarks/mr_loop.c) [a](data.md#x) ![p](images/walk.png)"
    assert hooks().on_page_markdown(text, page) == "loop (`benchmarks/mr_loop.c`) [a](data.md#x) ![p](images/walk.png)"
