"""``mrwarp verify``: measure what the simulator promises and print it as a table."""

from __future__ import annotations

from benchmarks.verify import physics
from mrwarp.commands.run_benchmarks import Verify
from mrwarp.options.command_line import CommandLine
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.run_dir import check_writable, write_result
from mrwarp.runtime import text_table


def run(options: Verify, line: CommandLine) -> int:
    """Run all physics checks; 0 when every limit holds, 1 when one is missed, 2 on bad input."""
    policy = OnnxPolicy(options.policy) if options.policy else None
    check_writable(options.out)
    with ProgressBar() as progress:
        figures = physics.run_all(options.out, seed=options.seed, policy=policy, progress=progress)
    write_result(options.out, figures, seed=options.seed, command=str(line))
    checks = figures["checks"]
    rows = [
        (row["name"], f"{row['value']:.4g} {row['unit']}", row["limit"], "ok" if row["holds"] else "MISSED")
        for row in checks
    ]
    print("\n" + "\n".join(text_table(("check", "measured", "limit", ""), rows)))
    print(f"\nfigures and pictures in {options.out}")
    return 0 if all(row["holds"] for row in checks) else 1
