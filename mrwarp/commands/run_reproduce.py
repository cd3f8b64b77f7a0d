"""``mrwarp reproduce``: the paper's tables and figures, ours beside theirs."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from pathlib import Path
from typing import Any

from mrwarp.options.arguments import Parser, count, positive, seed, whole
from mrwarp.paper import ROBOTS
from mrwarp.run_dir import FolderError, check_writable, claim, one_line, plain, write_result
from mrwarp.runtime import quiet_libraries


def make_parser() -> argparse.ArgumentParser:
    """The options of ``mrwarp reproduce``."""
    from mrwarp.reproduce.settings import TITLES, Settings

    default = Settings()
    parser = Parser(
        prog="mrwarp reproduce", formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Tables and figures of the paper with our row beside each, as report.html and report.md.\n\n"
        + "\n".join(f"  {name:12s} {title}" for name, title in TITLES.items()),
        epilog="Only what changed since the last run into the same folder is made again. 'mrwarp reproduce fig4 "
        "--train' trains figure 4's models anew and has options of its own.",
    )  # fmt: skip
    add = parser.add_argument
    add("part", nargs="+", choices=(*TITLES, "all"), metavar="PART", help="tables and figures, or all")
    add("--out", type=Path, default=Path("runs/report"), help="output folder (default: runs/report)")
    add("--policy", type=Path, nargs="+", metavar="P", help="policies of all robots, one per training seed")
    for robot in ROBOTS:
        add(f"--policy-{robot.replace('_', '-')}", type=Path, nargs="+", metavar="P", help=f"of {robot}'s walks alone")
    struck = "of pushes and falling masses alone, trained with the public gains (default: public_gains of the studies)"
    add("--policy-impacted", type=Path, nargs="+", metavar="P", help=struck)
    aware = (
        "of those with the asset's gains, and of walks without a price on power (default: the aware ones of table 2)"
    )
    add("--policy-aware", type=Path, nargs="+", metavar="P", help=aware)
    sticking = "of MR_Go-SAL's walks on devices that stick (default: those trained with them)"
    add("--policy-sticking", type=Path, nargs="+", metavar="P", help=sticking)
    for name, text in (("rollouts", "walks per policy and condition"), ("impacts", "impacts per policy and current")):
        add(f"--{name}", type=count, default=getattr(default, name), help=f"{text} ({getattr(default, name)})")
    for name, text in (("distance", "walk of table 6 [m]"), ("window", "simulated walk of the mission [m]")):
        add(f"--{name}", type=positive, default=getattr(default, name), help=f"{text} ({getattr(default, name):g})")
    add("--seed", type=seed, default=0, help="seed of poses and gait phases (default: 0)")
    add("--threads", type=whole, default=0, help="CPU threads; 0 = all, the figures are the same for any number")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Make the parts; 0 made, 1 when one failed, 2 on bad input, 130 when stopped."""
    argv = sys.argv[1:] if argv is None else argv
    if argv[:1] == ["fig4"] and "--train" in argv:
        from mrwarp.commands import run_fig4_training

        return run_fig4_training.main([word for word in argv[1:] if word != "--train"])
    args = make_parser().parse_args(argv)
    quiet_libraries()
    from mrwarp.reproduce.registry import CATALOGUE
    from mrwarp.reproduce.runner import Runner
    from mrwarp.reproduce.settings import TITLES
    from mrwarp.rl.policy import OnnxPolicy, PolicyError
    from mrwarp.runtime import ProgressLine

    try:
        settings = _settings(args)
        for path in settings.files():
            OnnxPolicy(path)
        check_writable(args.out)
    except (PolicyError, ValueError, OSError) as error:
        print(f"mrwarp reproduce: {error}", file=sys.stderr)
        return 2
    wanted = list(dict.fromkeys(name for part in args.part for name in (TITLES if part == "all" else (part,))))
    progress = ProgressLine(sys.stdout)
    runner = Runner(CATALOGUE, settings, args.out, progress)
    started, stopped = time.perf_counter(), False
    try:
        with claim(args.out):
            try:
                runner.run(wanted)
            except KeyboardInterrupt:
                stopped = True
            progress.done()
            _finish(runner, wanted, args, "mrwarp reproduce " + shlex.join(argv), time.perf_counter() - started)
    except FolderError as error:
        progress.done()
        print(f"mrwarp reproduce: {error}", file=sys.stderr)
        return 2
    except OSError as error:  # a full disk: what is finished stays
        progress.done()
        print(f"mrwarp reproduce: {one_line(error)}; the same command goes on", file=sys.stderr)
        return 1
    if stopped:
        print(f"\nstopped; the same command goes on in {args.out}", file=sys.stderr)
        return 130
    return 1 if any(outcome.findings is None for outcome in runner.outcomes.values()) else 0


def _settings(args: argparse.Namespace) -> Any:
    from mrwarp.reproduce.settings import Settings

    default = Settings()
    policies = {
        robot: tuple(getattr(args, f"policy_{robot}") or args.policy or default.policies[robot]) for robot in ROBOTS
    }
    return Settings(
        policies=policies, impacted=tuple(args.policy_impacted or args.policy or default.impacted),
        aware=tuple(args.policy_aware or args.policy or default.aware),
        sticking=tuple(args.policy_sticking or args.policy or default.sticking),
        high={robot: tuple(args.policy or default.high[robot]) for robot in ROBOTS},
        rollouts=args.rollouts, impacts=args.impacts, distance=args.distance, window=args.window,
        seed=args.seed, threads=args.threads,
    )  # fmt: skip


def _finish(runner: Any, wanted: list[str], args: argparse.Namespace, command: str, seconds: float) -> None:
    """Write report and ``result.json`` of everything that ended, and print the tables."""
    from mrwarp.reproduce import report_page as report
    from mrwarp.reproduce.runner import Outcome
    from mrwarp.reproduce.settings import TITLES

    outcomes = dict(runner.outcomes)
    outcomes |= {name: Outcome(name=name, status="not run") for name in wanted if name not in outcomes}
    page, _ = report.write(outcomes, args.out, command)
    found = {
        name: {
            "status": outcome.status, "seconds": outcome.seconds, "message": outcome.message,
            **(outcome.findings.to_json() if outcome.findings else {}),
        }
        for name, outcome in outcomes.items()
    }  # fmt: skip
    write_result(
        args.out, plain({"parts": found, "wall_seconds": seconds}), seed=args.seed, command=command
    )  # fmt: skip
    for outcome in outcomes.values():
        if outcome.name in TITLES:
            _print(outcome, TITLES[outcome.name])
    print(f"\nreport in {page}")


def _print(outcome: Any, title: str) -> None:
    """The rows of one part without their reasons, which the report has."""
    from mrwarp.reproduce import report_page

    print(f"\n{title}: {outcome.status}{f' ({outcome.seconds:.0f} s)' if outcome.seconds else ''}")
    if outcome.findings is None:
        print(f"  {outcome.message}" if outcome.message else "")
        return
    rows = [report_page.cells(row)[:-1] for row in outcome.findings.rows]
    if rows:
        widths = [max(len(row[i]) for row in (*rows, report_page.HEAD[:-1])) for i in range(len(rows[0]))]
        for row in (report_page.HEAD[:-1], *rows):
            print("  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    for text, holds in outcome.findings.claims.items():
        print(f"  {'holds ' if holds else 'MISSED'}  {text}")
