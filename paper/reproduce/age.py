"""Which committed figures are older than what they rest on: code, settings, policies, networks and the robot's file.

Each entry of ``docs/results/paper.json`` keeps the hash ``rests_on`` of :meth:`paper.reproduce.cache.Experiment.key`.
Where that of today differs, a page says so below the figures. A comment, a docstring or a sentence of a claim changes
none, nor does what reads options, writes files or draws.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from paper.reproduce.cache import Experiment
from paper.reproduce.contents import TITLES
from paper.reproduce.registry import CATALOGUE
from paper.reproduce.settings import NotYet, Settings


def hashes(catalogue: Mapping[str, Experiment] = CATALOGUE, settings: Settings | None = None) -> dict[str, str]:
    """Hash of what each experiment's figures rest on today; none where a policy or network is missing."""
    keys: dict[str, dict[str, Any]] = {}
    for name, experiment in catalogue.items():
        try:
            keys[name] = experiment.key(settings or Settings(), keys)
        except (NotYet, KeyError, OSError):  # an input is not there, or that of an experiment that it needs
            continue
    return {name: key["rests_on"] for name, key in keys.items()}


def stale(parts: Mapping[str, Any], today: Mapping[str, str] | None = None) -> list[str]:
    """Entries of the report whose committed figures are older than what they rest on, or are not there."""
    today = hashes() if today is None else today
    return [name for name in TITLES if parts.get(name, {}).get("rests_on", "") != today.get(name)]


def note(parts: Mapping[str, Any], names: Iterable[str], old: Iterable[str]) -> str:
    """Day, code and command of the figures of some entries, and which of them are stale; a line below a block."""
    there, old = [name for name in names if name in parts], set(old)
    days = sorted({parts[name]["made"] for name in there})
    if len(there) == 1:
        (name,) = there
        said = f"`mrwarp reproduce {name}`, {days[0]}, code {parts[name].get('rests_on', '')[:8] or 'unknown'}"
    else:
        said = f"{len(there)} entries, {' to '.join(dict.fromkeys((days[0], days[-1])))}" if there else "no entry"
    behind = [name for name in there if name in old]
    which = "**stale**" if len(there) == 1 else f"{len(behind)} of them **stale**"
    text = f"; {which}: what they rest on has changed since (`mrwarp reproduce docs --stale`)"
    return f"*{said}{text if behind else ''}.*"
