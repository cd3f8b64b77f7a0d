"""``mrwarp reproduce``: the paper's tables and figures, ours beside theirs."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict

from mrwarp.options.command_line import CommandLine
from mrwarp.options.paper_options import TITLES, Reproduce
from mrwarp.paper import ROBOTS
from mrwarp.reproduce import report_page
from mrwarp.reproduce.cache import Outcome, Runner
from mrwarp.reproduce.registry import CATALOGUE
from mrwarp.reproduce.settings import Settings
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.run_dir import check_writable, claim, plain, write_result
from mrwarp.runtime import ProgressLine, duration


def run(options: Reproduce, line: CommandLine) -> int:
    """Make the parts; 0 made, 1 when one failed, 2 on bad input, 130 when stopped."""
    settings = make_settings(options)
    for path in settings.files():
        OnnxPolicy(path)
    check_writable(options.out)
    wanted = list(dict.fromkeys(name for part in options.part for name in (TITLES if part == "all" else (part,))))
    progress = ProgressLine(sys.stdout)
    runner = Runner(catalogue=CATALOGUE, settings=settings, out=options.out, report=progress)
    if left := runner.estimate(wanted):
        parts = ", ".join(f"{name} {duration(seconds)}" for name, seconds in left.items())
        print(f"to make: {parts}; about {duration(sum(left.values()))} on two idle cores", flush=True)
    started, stopped = time.perf_counter(), False
    try:
        with claim(options.out):
            try:
                runner.run(wanted)
            except KeyboardInterrupt:
                stopped = True
            progress.done()
            _finish(runner, wanted, options, line, time.perf_counter() - started)
    finally:
        progress.done()
    if stopped:
        print(f"\nstopped; the same command goes on in {options.out}", file=sys.stderr)
        return 130
    return 1 if any(outcome.findings is None for outcome in runner.outcomes.values()) else 0


def make_settings(options: Reproduce) -> Settings:
    """The settings that the options ask for."""
    default, every = Settings(), options.policy
    return Settings(
        policies={robot: getattr(options, f"policy_{robot}") or every or default.policies[robot] for robot in ROBOTS},
        impacted=options.policy_impacted or every or default.impacted,
        aware=options.policy_aware or every or default.aware,
        sticking=options.policy_sticking or every or default.sticking,
        high={robot: every or default.high[robot] for robot in ROBOTS},
        rollouts=options.rollouts,
        impacts=options.impacts,
        distance=options.distance,
        window=options.window,
        seed=options.seed,
        threads=options.threads,
    )


def _finish(runner: Runner, wanted: list[str], options: Reproduce, line: CommandLine, seconds: float) -> None:
    """Write report and ``result.json`` of everything that ended, and print the tables."""
    outcomes = dict(runner.outcomes)
    outcomes |= {name: Outcome(name=name, status="not run") for name in wanted if name not in outcomes}
    page, _ = report_page.write(outcomes, options.out, str(line))
    found = {
        name: {
            "status": outcome.status,
            "seconds": outcome.seconds,
            "message": outcome.message,
            **(asdict(outcome.findings) if outcome.findings else {}),
        }
        for name, outcome in outcomes.items()
    }
    content = plain({"parts": found, "wall_seconds": seconds})
    write_result(options.out, content, seed=options.seed, command=str(line))
    for outcome in outcomes.values():
        if outcome.name in TITLES:
            _print(outcome, TITLES[outcome.name])
    print(f"\nreport in {page}")


def _print(outcome: Outcome, title: str) -> None:
    """The rows of one part without their reasons, which the report has."""
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
