"""Boundaries: training and simulation work without a viewer."""

import ast
from pathlib import Path

import mrwarp

PACKAGE = Path(mrwarp.__file__).parent


def imported(path: Path) -> set[str]:
    """Full names of all modules that a file imports, wherever in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {node.module or ""} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def test_simulation_does_not_know_the_viewer() -> None:
    """The environment, the kernels, the networks and the actuator import neither rerun nor ``mrwarp.viewing``."""
    files = [path for folder in ("actuator", "env", "kernels", "nn", "usd") for path in (PACKAGE / folder).glob("*.py")]
    files += [PACKAGE / "params.py"]
    assert len(files) > 20
    for path in files:
        names = imported(path)
        assert not {name for name in names if name.split(".")[0] == "rerun" or name.startswith("mrwarp.viewing")}, path
