"""``docs/devices.md``: every device of the library on one page, written from its files."""

from __future__ import annotations

import re
from pathlib import Path

import mrwarp
from mrwarp.devices.entry import Device, facts, library, numbers, overview

ROOT = Path(mrwarp.__file__).parents[1]
"""The checkout."""

PAGE = Path("docs/devices.md")
"""The page, in the checkout."""

PICTURES = Path("docs/images/devices")
"""Pictures of the devices, in the checkout."""

_HEAD = """# Identified devices

Written by `mrwarp device page` from `models/devices`: change nothing here. Real devices, identified from public
recordings; the library holds numbers, no recording. `mrwarp device list` is the table below, `mrwarp device show NAME`
one entry. A command with `--model` also takes a name, and so does `mrwarp.load_model("NAME")`. A robot's
joint takes devices in rad, A and N·m.

A number holds in the range that was recorded. Its 95 % interval comes from the fit: `-` where the data do not give one,
or where the number was not fitted. The error on unseen runs is the RMS of measured minus predicted torque over the
standard deviation of the measured one. Each run is predicted by a fit to the others. Law and effects were
chosen with all runs in view. `also predicted` are recordings that had no part in that. CONTRIBUTING.md says how to add
a device.
"""


def page(devices: list[Device]) -> str:
    """The whole page."""
    head, rows = overview(devices)
    parts = [_HEAD, *_table(head, [(f"[{row[0]}](#{row[0]})", *row[1:]) for row in rows]), ""]
    for device in devices:
        parts += [f"## {device.name}", "", f"{device.stated['title']} ({device.stated['kind']}).", ""]
        parts += [f"![Loops of {device.name}](images/devices/{device.name}.png)", ""]
        parts += [f"* **{name}**: {_safe(text, name)}" for name, text in facts(device)]
        parts += ["", *_table(("number", "value", "95 % interval"), numbers(device.model)), ""]
    return "\n".join(parts)


def page_of(folder: Path) -> str:
    """The page of a library."""
    return page(library(folder))


def _safe(text: str, name: str) -> str:
    """A fact as Markdown: commands as code, addresses as links."""
    if name == "made by":
        return ", ".join(f"`{command}`" for command in text.split("; "))
    return re.sub(r"(https?://[^\s;]+)", r"<\1>", text)


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    return [f"| {' | '.join(cells)} |" for cells in (head, ("---",) * len(head), *rows)]
