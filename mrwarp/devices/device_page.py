"""``docs/devices.md``, the table of the library, and ``docs/devices/NAME.md`` for each device, from their files."""

from __future__ import annotations

import re
from pathlib import Path

import mrwarp
from mrwarp.devices.entry import Device, facts, library, overview
from mrwarp.params import MrParams

ROOT = Path(mrwarp.__file__).parents[1]
"""The checkout."""

PAGE = Path("docs/devices.md")
"""The table, in the checkout."""

FOLDER = Path("docs/devices")
"""The pages of the devices, in the checkout."""

PICTURES = Path("docs/images/devices")
"""Pictures of the devices, in the checkout."""

EQUATIONS = Path("docs/joint.md")
"""The page of the equations, whose table of numbers follows from :mod:`mrwarp.params`, in the checkout."""

IN_EQUATIONS = ("BoucWenParams", "HoldParams", "GateParams", "MotorParams", "CoilParams")
"""Groups of numbers in the order of the table."""

_HEAD = """# Identified devices

Real devices, identified from public recordings, of which the library holds the numbers alone. Every `--model` takes a
name, and so does `mrwarp.load_model("NAME")`. `mrwarp device show NAME` prints the numbers with their intervals. Only
devices in rad, A and N·m can be put into a robot. [How to add one](extend.md#a-device).

A number holds in the range that was recorded. The error on unseen runs is the RMS of measured minus predicted torque
over the standard deviation of the measured one. Each run is predicted by a fit to the others, but law and effects were
chosen with all runs in view. `also predicted` on a device's page are recordings that had no part in that.
"""


_NOT_ON_A_PAGE = {"in a robot"}
"""Facts that the table of all devices has."""

_ON_ITS_PAGE = {"law", "licence"}
"""Columns of 'mrwarp device list' that a device's own page has."""

_AS_ALL = "; each run predicted by the model fitted to the others"
"""How nearly every error was found, which stands above that table."""


def pages(devices: list[Device]) -> dict[Path, str]:
    """Every page's text by its path in the checkout: the table, then a page for each device."""
    head, rows = overview(devices)
    shown = [k for k, name in enumerate(head) if name not in _ON_ITS_PAGE]
    linked = [(f"[{row[0]}](devices/{row[0]}.md)", *row[1:]) for row in rows]
    table = _table(tuple(head[k] for k in shown), [tuple(row[k] for k in shown) for row in linked])
    found = {PAGE: "\n".join([_HEAD, *table, ""])}
    return found | {FOLDER / f"{device.name}.md": _page_of(device) for device in devices}


def pages_of(folder: Path) -> dict[Path, str]:
    """The pages of a library."""
    return pages(library(folder))


def with_numbers(page: str) -> str:
    """A page with the table of all numbers of a joint between its marks ``numbers``; the site has their ranges."""
    specs = sorted(MrParams.specs(), key=lambda spec: IN_EQUATIONS.index(spec.group))
    rows = [(f"`{s.name}`", s.doc.replace("|", "\\|"), s.unit, f"{s.default:.6g}", _place(s.source)) for s in specs]
    table = "\n".join(_table(("name", "meaning", "unit", "default", "source"), rows))
    before, begin, rest = page.partition("<!-- numbers -->\n")
    _, end, after = rest.partition("<!-- /numbers -->")
    return f"{before}{begin}{table}\n{end}{after}"


def _place(source: str) -> str:
    """The source of a number: of the paper its section alone."""
    return source.split(",")[0].removeprefix("paper ") if source.startswith("paper section") else source


def _page_of(device: Device) -> str:
    """One device: what it is, its loops, where it holds, and where its numbers stand."""
    name = device.name
    parts = [f"# {name}", "", f"{device.stated['title']} ({device.stated['kind']}).", ""]
    parts += [f"![Loops of {name}](../images/devices/{name}.png)", ""]
    parts += [
        f"* **{fact}**: {_safe(text.removesuffix(_AS_ALL), fact)}"
        for fact, text in facts(device)
        if fact not in _NOT_ON_A_PAGE
    ]
    parts += [f"* **numbers**: [model.json](../../models/devices/{name}/model.json)", ""]
    return "\n".join(parts)


def _safe(text: str, name: str) -> str:
    """A fact as Markdown: addresses as links, commands as code without the last one, which every entry needs."""
    if name == "made by":
        commands = text.split("; ")
        return ", ".join(f"`{command}`" for command in commands[:-1] or commands)
    return re.sub(r"(https?://[^\s;]+)", r"<\1>", text)


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    return [f"| {' | '.join(cells)} |" for cells in (head, ("---",) * len(head), *rows)]
