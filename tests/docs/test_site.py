"""The site's hooks: every page has its place, and the reference is complete. `make lint` builds the site itself."""

import ast
import importlib.util
import re
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import yaml

import mrwarp
from mrwarp.sysid.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / "tools/site/mkdocs.yml"


def hooks() -> Any:
    """The module of hooks, as mkdocs loads it."""
    spec = importlib.util.spec_from_file_location("site_reference", ROOT / "tools/site/reference.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def pages_of(entry: object) -> list[str]:
    """Files of a part of the navigation."""
    if isinstance(entry, list):
        return [page for item in entry for page in pages_of(item)]
    return pages_of(list(entry.values())) if isinstance(entry, dict) else [str(entry)]


def test_every_page_has_its_place_in_the_navigation() -> None:
    """In five parts; devices of the library are put in by the hook."""
    nav = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))["nav"]
    assert [next(iter(part)) for part in nav[1:]] == ["Start", "Guides", "Explanation", "Reference", "Results"]
    filled = hooks().on_config(cast(Any, SimpleNamespace(nav=nav))).nav
    listed = [page for page in pages_of(filled) if not page.startswith("reference/")]
    assert sorted(listed) == sorted(str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md"))


def test_the_site_loads_nothing_from_elsewhere() -> None:
    """No fonts, scripts or styles of other hosts."""
    content = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
    assert content["theme"]["font"] is False
    assert not content.keys() & {"extra_javascript", "extra_css"}


def test_a_warning_of_the_site_is_an_error() -> None:
    """mkdocs counts warnings only where it prints them: with ``--quiet`` a broken link passes ``--strict``."""
    (command,) = re.findall(r"^docs:.*\n\t(.*)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert "--strict" in command and "--quiet" not in command and " -q" not in command
    checks = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))["validation"]
    assert {level for part in checks.values() for level in part.values()} == {"warn"}


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
