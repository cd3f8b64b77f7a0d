"""Hooks of the site: pages of the reference from the code, and links that leave ``docs/``.

Commands are printed by ``mrwarp COMMAND --help``, Python names come from docstrings, settings from the dataclasses that
hold them. Nothing of it is kept in the repository.
"""

from __future__ import annotations

import ast
import contextlib
import io
import os
import re
import sys
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

OUTSIDE = re.compile(r"\[([^\]]+)\]\(((?:\.\./)+(?!images/|devices\.md)[^)#]+)(#[\w-]+)?\)")
"""A link to a file that is no page: it becomes the file's name."""

WIDTH = "100"
"""Columns of the printed help."""


def commands() -> Iterator[tuple[str, str]]:
    """Every command and its help."""
    from mrwarp.cli import main
    from mrwarp.options.command_table import all_commands

    os.environ["COLUMNS"] = WIDTH
    for name, command in all_commands():
        for words in ((), *command.variants):
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                main([*name.split(), *(word for word in words if word not in name.split()), "--help"])
            yield " ".join([name, *words]), printed.getvalue().strip()


def commands_page() -> str:
    """All commands with their options."""
    parts = ["# Commands", "", "As `mrwarp COMMAND --help` prints them."]
    for name, text in commands():
        parts += ["", f"## mrwarp {name}", "", "```text", text, "```"]
    return "\n".join(parts)


def python_page() -> str:
    """The public names of ``import mrwarp``."""
    from mrwarp import _PLACES

    parts = ["# Python", "", "The public names of `import mrwarp`; what needs more than the core says which extra."]
    for name, place in _PLACES.items():
        module, _, other = place.partition(":")
        if module == f"mrwarp.{name}":
            module, other = public_source(name)
        parts += [
            "",
            f"## mrwarp.{name}",
            "",
            f"::: {module}.{other or name}",
            "    options:",
            "      heading_level: 3",
        ]
    parts += [
        "",
        "## mrwarp.mujoco.Brake",
        "",
        "::: mrwarp.mujoco.plain_brake.Brake",
        "    options:",
        "      heading_level: 3",
    ]
    return "\n".join(parts)


def public_source(name: str) -> tuple[str, str]:
    """Module and function behind a public name that is a callable package."""
    tree = ast.parse((ROOT / "mrwarp/__init__.py").read_text(encoding="utf-8"))
    for node in (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)):
        for alias in node.names:
            if alias.asname == name:
                return node.module or "", alias.name
    raise LookupError(f"mrwarp/__init__.py imports nothing as {name}")


def settings() -> Iterator[tuple[str, ast.ClassDef]]:
    """Dataclasses that hold settings, ``*Cfg`` of the package, each with its module."""
    for path in sorted((ROOT / "mrwarp").rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and node.name.endswith("Cfg"):
                yield module, node


def settings_page() -> str:
    """Every number of the joint with unit, range, default and source; then every setting of the program."""
    from mrwarp.params import MrParams

    parts = ["# Settings", "", "## The joint", "", "| number | unit | range | default | meaning | source |"]
    parts.append("|---|---|---|---|---|---|")
    for spec in MrParams.specs():
        cells = (
            f"`{spec.name}`",
            spec.unit,
            f"{spec.low:g} to {spec.high:g}",
            f"{spec.default:g}",
            spec.doc,
            spec.source,
        )
        parts.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    for module, node in settings():
        parts += ["", f"## {node.name}", "", f"`{module}`. {(ast.get_docstring(node) or '').splitlines()[0]}", ""]
        parts += ["| setting | default | meaning |", "|---|---|---|", *setting_rows(node)]
    return "\n".join(parts)


def diagnosis_page() -> str:
    """Every number by which a diagnosis decides: what it is, what it trades, and what set it."""
    from mrwarp.sysid.settings import Settings
    from mrwarp.sysid.settings.checked import described

    parts = ["# Settings of a diagnosis", "", "Numbers by which a diagnosis decides. Another value is passed as", ""]
    parts += ["```python", "from mrwarp.sysid.settings import Gain, Settings", ""]
    parts += ["mrwarp.diagnose(data, settings=Settings(gain=Gain(chi2=50.0)))", "```", ""]
    parts += ["What is physically possible stands in the [effects](../extend.md), not here."]
    for group in fields(Settings):
        kind: Any = group.default_factory
        parts += ["", f"## {group.name}", "", f"`{kind.__name__}`: {kind.__doc__}", ""]
        parts += ["| setting | default | range | meaning | a higher value: | set by |", "|---|---|---|---|---|---|"]
        for row in described(kind):
            cells = (f"`{row.name}`", row.default, row.range, row.meaning, row.trades, row.by)
            parts.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(parts)


def setting_rows(node: ast.ClassDef) -> Iterator[str]:
    """A row for each field: its default as it is written, and its docstring."""
    for field, after in zip(node.body, [*node.body[1:], None], strict=True):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            text = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else ""
            default = ast.unparse(field.value) if field.value else "needed"
            meaning = " ".join(str(text).split())
            cells = (f"`{field.target.id}`", f"`{default}`", meaning)
            yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """The devices of the library take their place in the navigation."""
    devices = [f"devices/{path.name}" for path in sorted((ROOT / "docs/devices").glob("*.md"))]

    def filled(entry: object) -> object:
        if isinstance(entry, list):
            return [new for item in entry for new in (devices if item == "..." else [filled(item)])]
        return {name: filled(item) for name, item in entry.items()} if isinstance(entry, dict) else entry

    config.nav = filled(config.nav)
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the reference."""
    from mkdocs.structure.files import File

    pages = {"commands": commands_page, "python": python_page, "settings": settings_page, "diagnosis": diagnosis_page}
    for name, text in ((name, page()) for name, page in pages.items()):
        files.append(File.generated(config, f"reference/{name}.md", content=text))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Links to files of the repository that are no pages become their names."""
    depth = page.file.src_uri.count("/") + 1
    return OUTSIDE.sub(
        lambda link: link[0] if link[2].count("../") < depth else f"{link[1]} (`{link[2].lstrip('./')}`)", markdown
    )
