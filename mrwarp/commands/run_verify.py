"""``mrwarp verify``: measure what the simulator promises and print it as a table."""

from __future__ import annotations

import shlex
import sys
import time
from pathlib import Path

from mrwarp.options.arguments import Parser, seed
from mrwarp.run_dir import check_writable, one_line, write_result
from mrwarp.runtime import quiet_libraries


def main(argv: list[str] | None = None) -> int:
    """Run all physics checks; 0 when every limit holds, 1 when one is missed, 2 on bad input."""
    argv = sys.argv[1:] if argv is None else argv
    parser = Parser(prog="mrwarp verify", description=main.__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/verify"), help="output folder (default: runs/verify)")
    parser.add_argument("--policy", type=Path, help="exported policy for the walking checks (.onnx)")
    parser.add_argument("--seed", type=seed, default=0, help="seed of random states (default: 0)")
    args = parser.parse_args(argv)
    quiet_libraries()
    from mrwarp.rl.policy import OnnxPolicy, PolicyError
    from mrwarp.verify import physics

    try:
        policy = OnnxPolicy(args.policy) if args.policy else None
        check_writable(args.out)
    except (PolicyError, OSError) as error:
        print(f"mrwarp verify: {one_line(error)}", file=sys.stderr)
        return 2
    started = time.perf_counter()

    def progress(text: str) -> None:
        print(f"[{time.perf_counter() - started:5.0f} s] {text}", flush=True)

    figures = physics.run_all(args.out, seed=args.seed, policy=policy, progress=progress)
    write_result(args.out, figures, seed=args.seed, command="mrwarp verify " + shlex.join(argv))
    rows = figures["checks"]
    width = max(len(row["name"]) for row in rows)
    print(f"\n{'check':{width}s}  {'measured':>12s}  limit")
    for row in rows:
        mark = "ok" if row["holds"] else "MISSED"
        print(f"{row['name']:{width}s}  {row['value']:12.4g}  {row['limit']:24s} {row['unit']:10s} {mark}")
    print(f"\nfigures and pictures in {args.out}")
    return 0 if all(row["holds"] for row in rows) else 1
