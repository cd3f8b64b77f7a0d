"""Robots of others imported at the first try: ``python -m benchmarks.robots_at_first_try < FILES`` prints a table.

FILES has a robot a line: its file, then options of ``mrwarp robot import``. Right is a robot that was written and whose
mass matrix, weight, limits and motors agree with the second reading of its file; the others were refused.
"""

from __future__ import annotations

import contextlib
import io
import re
import sys
import tempfile
from pathlib import Path

from mrwarp.cli import main
from mrwarp.runtime import text_table


def tried(file: Path, options: list[str], out: Path) -> tuple[str, str]:
    """Outcome of an import, and its size and agreement, or why it was refused."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = main(["robot", "import", str(file), "--out", str(out), "--overwrite", *options])
    lines = said.getvalue().strip().splitlines()
    if code:
        return "refused", lines[-1].partition(f"{file}")[2].lstrip(": ")[:110] or lines[-1][:110]
    second = next((line for line in lines if "[second:" in line), "")
    size = re.search(r"([\d.]+ kg).*?(\d+ legs, \d+ joints)", next(line for line in lines if line.startswith(out.name)))
    exact = re.search(r"within (\S+) ", second)
    text = ", ".join(size.groups()) if size else ""
    return ("right", f"{text}; within {exact[1]}") if exact else ("wrong", second)


if __name__ == "__main__":
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for words in (line.split() for line in sys.stdin if line.strip()):
            rows.append([Path(words[0]).name, *tried(Path(words[0]), words[1:], Path(folder) / "robot.usda")])
    print(*text_table(["file", "outcome", "size and agreement, or why"], rows), sep="\n")
    counts = {outcome: sum(row[1] == outcome for row in rows) for outcome in ("right", "refused", "wrong")}
    print(", ".join(f"{count} {outcome}" for outcome, count in counts.items()))
