"""``mrwarp verify``: measure what the simulator promises and print it as a table."""

from __future__ import annotations

import time

from benchmarks.verify import physics
from mrwarp.options.command_line import CommandLine
from mrwarp.options.trial_options import Verify
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.run_dir import check_writable, write_result


def run(options: Verify, line: CommandLine) -> int:
    """Run all physics checks; 0 when every limit holds, 1 when one is missed, 2 on bad input."""
    policy = OnnxPolicy(options.policy) if options.policy else None
    check_writable(options.out)
    started = time.perf_counter()

    def progress(text: str) -> None:
        print(f"[{time.perf_counter() - started:5.0f} s] {text}", flush=True)

    figures = physics.run_all(options.out, seed=options.seed, policy=policy, progress=progress)
    write_result(options.out, figures, seed=options.seed, command=str(line))
    rows = figures["checks"]
    width = max(len(row["name"]) for row in rows)
    print(f"\n{'check':{width}s}  {'measured':>12s}  limit")
    for row in rows:
        mark = "ok" if row["holds"] else "MISSED"
        print(f"{row['name']:{width}s}  {row['value']:12.4g}  {row['limit']:24s} {row['unit']:10s} {mark}")
    print(f"\nfigures and pictures in {options.out}")
    return 0 if all(row["holds"] for row in rows) else 1
