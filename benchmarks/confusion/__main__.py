"""Command of the benchmark: hide effects, diagnose, print the confusion matrix."""

from __future__ import annotations

import argparse
import json
import math
from typing import Any

from benchmarks.confusion.case import NOISES, write_case
from benchmarks.confusion.families import FAMILIES, Plan
from benchmarks.confusion.motion import MOTIONS, SIZES
from benchmarks.confusion.suite import SuiteError, read_cases, run_case, run_suite
from benchmarks.confusion.tables import report
from mrwarp.runtime import quiet_libraries


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.confusion", description=__doc__)
    parser.add_argument("--family", choices=FAMILIES, default="single", help="what is hidden (default: single)")
    parser.add_argument("--level", type=float, default=0.4, help="RMS of what refitting leaves over the noise's RMS")
    parser.add_argument("--sets", type=int, default=16, help="number of data sets")
    parser.add_argument("--seed", type=int, default=0, help="seed of the suite")
    parser.add_argument("--kinds", nargs="+", default=[], metavar="EFFECT", help="only these; a pair as a+b")
    parser.add_argument("--size", choices=SIZES, help="size of every data set (default: large; none: both in turn)")
    parser.add_argument("--noise", choices=NOISES, help="noise of every data set (default: realistic; none: in turn)")
    parser.add_argument("--spread", type=float, help="spread of the base coefficients (default: 0.02; none: and 0.2)")
    parser.add_argument("--truth-rate", type=float, help="lowest rate of the truth's steps in 1/s (default: 2000)")
    parser.add_argument("--motion", choices=MOTIONS, help="motion of every data set (default: mixed)")
    parser.add_argument(
        "--strengths",
        nargs="+",
        default=[],
        type=_strength,
        metavar="EFFECT=SIZE",
        help="hide these together, with strengths within a factor of 1.25; in place of --kinds and --level",
    )
    parser.add_argument("--joined", action="store_true", help="each session as one run, without a stop")
    parser.add_argument("--jobs", type=int, default=2, help="processes; 0 runs in this one")
    parser.add_argument("--known", action="store_true", help="what is hidden is known: ask for its size only")
    parser.add_argument("--method", choices=("proof", "evidence"), default="proof", help="how causes are searched")
    parser.add_argument("--out", metavar="DIR", help="folder of cases.jsonl; cases in it are not run again")
    parser.add_argument("--report", action="store_true", help="print the tables of --out without running anything")
    parser.add_argument("--only", type=int, metavar="INDEX", help="run this case alone and print what was found")
    parser.add_argument("--keep", metavar="DIR", help="with --only: write the case's files instead of running it")
    args = parser.parse_args()
    quiet_libraries(gpu=False)
    try:
        plan = Plan(
            family=args.family,
            level=args.level,
            seed=args.seed,
            size=args.size,
            noise=args.noise,
            base_spread=args.spread,
            truth_rate=args.truth_rate,
            motion=args.motion,
            strengths=tuple(args.strengths),
            joined=args.joined,
            kinds=tuple(args.kinds),
        )
        if args.only is not None:
            _one(plan, args)
            return 0
        if args.keep:
            parser.error("--keep needs --only INDEX")
        if not args.out:
            parser.error("--out DIR is needed")
        cases = read_cases(args.out) if args.report else _run(plan, args)
    except (SuiteError, ValueError) as error:
        parser.error(str(error))
    print(f"\n{report(cases)}")
    return 0


def _strength(text: str) -> tuple[str, float]:
    name, _, size = text.partition("=")
    try:
        value = float(size)
    except ValueError:
        value = 0.0
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}: give an effect and a size, as in backlash=0.001")
    return name, value


def _run(plan: Plan, args: argparse.Namespace) -> list[dict[str, Any]]:
    def report(line: str) -> None:
        print(line, flush=True)

    return run_suite(
        plan,
        args.sets,
        args.out,
        jobs=args.jobs,
        known=args.known,
        method=args.method,
        report=report,
    )


def _one(plan: Plan, args: argparse.Namespace) -> None:
    if args.keep:
        case = plan.make(args.only)
        write_case(case, args.keep)
        print(f"{args.keep}: {len(case.recording.trajectories)} trajectories, {'+'.join(case.truth.kinds) or 'none'}")
        return
    found = run_case(plan, args.only, known=args.known, method=args.method)
    print(json.dumps(found, indent=1, default=float, ensure_ascii=False))


if __name__ == "__main__":
    raise SystemExit(main())
