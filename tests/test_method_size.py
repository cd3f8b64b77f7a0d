"""The method stays readable: functions that fit on a screen, and no more numbers that decide than there are."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
METHOD = ("sysid", "diagnose", "identify", "robot_logs")
FILES = [path for package in METHOD for path in sorted((ROOT / "mrwarp" / package).rglob("*.py"))]
MOST_LINES, MOST_BRANCHES = 60, 12
"""Of a function, without its docstring."""
LONG: dict[str, tuple[int, int]] = {}
"""Functions that are longer, with the lines and branches that they may have: to be split, never to be added to."""
