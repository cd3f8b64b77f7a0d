"""``result.json``: what every command that computes leaves beside its pictures."""

from __future__ import annotations

import json
import math
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from mrwarp.in_one_piece import write_text

SCHEMA = 1
"""Version of the result's layout."""

_LIBRARIES = (
    "mrwarp",
    "warp-lang",
    "newton",
    "mujoco",
    "mujoco-warp",
    "torch",
    "rsl-rl-lib",
    "numpy",
    "scipy",
    "usd-core",
    "safetensors",
)


def write_result(out: Path, figures: dict[str, Any], *, seed: int, command: str) -> Path:
    """Write ``out/result.json`` in one piece: the figures, the seed, the versions and the command line.

    Args:
        out: Folder, made if it is not there.
        figures: What was measured; plain values.
        seed: Seed of everything random.
        command: Command line that made it.
    """
    content = {"schema": SCHEMA, **figures, "seed": seed, "versions": versions(), "command": command}
    return write_text(out / "result.json", json.dumps(plain(content), indent=2, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """The same with null for NaN and infinity, which JSON does not have."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def versions() -> dict[str, str]:
    """Versions of Python and of the libraries that a result depends on."""
    found = {"python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found
