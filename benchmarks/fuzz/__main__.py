"""Command line of the fuzzers, see :mod:`benchmarks.fuzz`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import benchmarks.fuzz
from benchmarks.fuzz.kinds import KINDS
from benchmarks.fuzz.runner import run


def main(argv: list[str] | None = None) -> int:
    """Fuzz; 0 without failures, 1 with."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.fuzz", description=(benchmarks.fuzz.__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--kind", choices=[*KINDS, "cli", "all"], nargs="+", default=["all"], help="what is read")
    parser.add_argument("--cases", type=int, default=100_000, help="cases per kind (default: 100000)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the mutations (default: 0)")
    parser.add_argument("--seconds", type=float, default=1e9, help="longest time per kind [s]; goes on when run again")
    parser.add_argument("--coverage", action="store_true", help="keep inputs that reach new lines (slower)")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"), help="state and failures (default: out/fuzz)")
    args = parser.parse_args(argv)
    from mrwarp.runtime import quiet_libraries

    quiet_libraries(gpu=False)
    failed = 0
    for kind in [*KINDS, "cli"] if "all" in args.kind else args.kind:
        state = run(
            kind, args.cases, seed=args.seed, out=args.out.absolute(), seconds=args.seconds, coverage=args.coverage
        )
        failed += state["failures"]
        print(f"\n{kind}: {state['cases']} cases, peak {state.get('peak_mib', 0)} MiB")
        for text, count in sorted(state["counts"].items(), key=lambda item: -item[1])[:25]:
            print(f"  {count:7d}  {text}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
