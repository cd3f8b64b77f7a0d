"""``mrwarp reproduce``: the paper's figures and tables, ours beside theirs."""

from __future__ import annotations

import importlib
import sys

PARTS = {"fig4": ("mrwarp.sysid.figure4", "torque prediction of four models on ten unseen trajectories per current")}
"""Figure or table to the module whose ``main(argv)`` makes it, and what it shows."""


def main(argv: list[str] | None = None) -> int:
    """Make one figure or table; 0 when every claim holds, 1 when one does not, 2 on bad input."""
    argv = sys.argv[1:] if argv is None else argv
    if argv and argv[0] in PARTS:
        return importlib.import_module(PARTS[argv[0]][0]).main(argv[1:])
    known = "\n".join(f"  {name:8s} {text}" for name, (_, text) in PARTS.items())
    usage = f"usage: mrwarp reproduce PART --out DIR [options]\n\nparts:\n{known}"
    if argv and argv[0] in ("-h", "--help"):
        print(usage)
        return 0
    wanted = f"there is no part {argv[0]!r}" if argv else "name a part"
    print(f"mrwarp reproduce: {wanted}\n\n{usage}", file=sys.stderr)
    return 2
