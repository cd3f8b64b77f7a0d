"""``mrwarp reproduce``: the paper's tables and figures, compared with ours; ``fig4 --train`` trains its models."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from tyro.conf import Positional

from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.paper import ROBOTS
from mrwarp.run_dir import check_writable, plain, write_result
from mrwarp.runtime import duration
from paper.reproduce.contents import TITLES

if TYPE_CHECKING:
    from paper.reproduce.cache import Runner
    from paper.reproduce.settings import Settings

Policies = Annotated[tuple[Path, ...] | None, opt.some(Path, "P")]


@dataclass(frozen=True, kw_only=True)
class Reproduce(Options):  # noqa: D101  (its docstring lists the titles)
    __doc__ = (
        "Tables and figures of the paper with our row next to each, as report.html and report.md.\n\n"
        + "\n".join(f"- {name}: {title}" for name, title in TITLES.items())
        + "\n\nOnly what changed since the last run into the same folder is made again. 'mrwarp reproduce fig4 "
        "--train' trains its models again and has options of its own."
    )

    part: Positional[Annotated[tuple[str, ...], opt.some(str, "PART", (*TITLES, "all"))]]
    """tables and figures, or all"""
    out: opt.Folder = Path("runs/report")
    """output folder"""
    policy: Policies = None
    """policies of all robots, one per training seed"""
    policy_go1: Policies = None
    """of go1's walks alone"""
    policy_mr_go: Policies = None
    """of mr_go's walks alone"""
    policy_mr_go_sal: Policies = None
    """of mr_go_sal's walks alone"""
    policy_impacted: Policies = None
    """of pushes and falling masses alone, all trained with the same gains (default: public_gains of the studies)"""
    policy_aware: Policies = None
    """of walks without a price on power (default: the aware ones of table 2)"""
    policy_sticking: Policies = None
    """of MR_Go-SAL's walks on devices that stick (default: those trained with them)"""
    rollouts: opt.Count = 3
    """walks per policy and condition"""
    impacts: opt.Count = 12
    """impacts per policy and current"""
    distance: opt.Positive = 30.0
    """walk of table 6 [m]"""
    window: opt.Positive = 10.0
    """simulated walk of the mission [m]"""
    seed: opt.Seed = 0
    """seed of poses and gait phases"""
    threads: opt.Whole = 0
    """CPU threads; 0 = all, the figures are the same for any number"""

    def run(self, line: CommandLine) -> int:
        """0 made, 1 when one failed, 2 on bad input, 130 when stopped."""
        check_writable(self.out)

        from mrwarp.rl.policy import OnnxPolicy
        from paper.reproduce.cache import Runner
        from paper.reproduce.registry import CATALOGUE

        settings = self._settings()
        for path in settings.files():
            OnnxPolicy(path)
        wanted = list(dict.fromkeys(name for part in self.part for name in (TITLES if part == "all" else (part,))))
        progress = ProgressBar()
        runner = Runner(catalogue=CATALOGUE, settings=settings, out=self.out, report=progress)
        if left := runner.estimate(wanted):
            parts = ", ".join(f"{name} {duration(seconds)}" for name, seconds in left.items())
            print(f"to make: {parts}; about {duration(sum(left.values()))} on two idle cores", flush=True)
        started, stopped = time.perf_counter(), False
        try:
            try:
                runner.run(wanted)
            except KeyboardInterrupt:
                stopped = True
            progress.done()
            self._finish(runner, wanted, line, time.perf_counter() - started)
        finally:
            progress.done()
        if stopped:
            print(f"\nstopped; the same command goes on in {self.out}", file=sys.stderr)
            return 130
        return 1 if any(outcome.findings is None for outcome in runner.outcomes.values()) else 0

    def _settings(self) -> Settings:
        from paper.reproduce.settings import Settings

        default, every = Settings(), self.policy

        def own(name: str) -> Any:
            return getattr(self, f"policy_{name}") or every

        return Settings(
            **self.chosen("rollouts", "impacts", "distance", "window", "seed", "threads"),
            **{name: own(name) or getattr(default, name) for name in ("impacted", "aware", "sticking")},
            policies={robot: own(robot) or default.policies[robot] for robot in ROBOTS},
        )

    def _finish(self, runner: Runner, wanted: list[str], line: CommandLine, seconds: float) -> None:
        """Write report and ``result.json`` of everything that ended, and print the tables."""
        from paper.reproduce import report_page
        from paper.reproduce.cache import Outcome

        outcomes = dict(runner.outcomes)
        outcomes |= {name: Outcome(name=name, status="not run") for name in wanted if name not in outcomes}
        page, _ = report_page.write(outcomes, self.out, str(line))
        found = {
            name: {
                **{key: getattr(outcome, key) for key in ("status", "seconds", "processor", "message")},
                **{key: getattr(outcome, key) for key in ("made", "rests_on")},
                **(asdict(outcome.findings) if outcome.findings else {}),
            }
            for name, outcome in outcomes.items()
        }
        content = plain({"parts": found, "wall_seconds": seconds})
        write_result(self.out, content, seed=self.seed, command=str(line))
        for outcome in outcomes.values():
            if outcome.name in TITLES:
                print("\n".join(report_page.lines(outcome)))
        wall, processor = (sum(getattr(o, name) for o in outcomes.values()) for name in ("seconds", "processor"))
        print(f"\nreport in {page}; from nothing {duration(wall)}, {duration(processor)} of one core")


@dataclass(frozen=True, kw_only=True)
class TrainFigure4(Options):
    """Train and evaluate the models of figure 4; those of ``models/`` are made so."""

    out: opt.Folder
    """output folder; a stopped run goes on there"""
    epochs: opt.Count = 20
    """most epochs per network"""
    windows_per_epoch: opt.Count = 65_536
    """training windows drawn per epoch"""
    samples: opt.Count = 665_442
    """samples of the fitting data"""
    trajectories: opt.Count = 120
    """trajectories of the fitting data"""
    seed: opt.Seed = 0
    """seed of the bench and of the training"""

    def run(self, line: CommandLine) -> int:
        """0 when every claim holds, 1 when one does not, 2 on bad input."""
        check_writable(self.out)

        from mrwarp.bench.virtual_bench import BenchCfg
        from mrwarp.nn.training import FitCfg
        from paper.reproduce import fig4

        bench = BenchCfg(**self.chosen("samples", "trajectories", "seed"))
        recipe = FitCfg(**self.chosen("epochs", "windows_per_epoch", "seed"))
        result = fig4.train(bench, recipe, self.out)
        write_result(self.out, result, seed=self.seed, command=str(line))
        for name, holds in result["verdicts"].items():
            print(f"{name:34s} {'holds' if holds else 'MISSED'}")
        return 0 if all(result["verdicts"].values()) else 1


@dataclass(frozen=True, kw_only=True)
class FillPages(Options):
    """Fill the figures of README and docs from docs/results/paper.json, in a checkout.

    Below each block stands when and by what code it was made, and "stale" where that has changed since.
    """

    engines: ClassVar[bool] = False

    results: Annotated[tuple[Path, ...], opt.some(Path, "DIR")] = ()
    """output folders of reports, whose entries replace those of docs/results/paper.json first"""
    only_check: opt.Flag = False
    """write nothing; exit code 1 where a page differs, or does not say that its figures are stale"""
    stale: opt.Flag = False
    """list the entries whose code, settings or policies have changed since, and how long each takes; write nothing"""
    rerun: opt.Flag = False
    """make the stale entries again first, in --out"""
    out: opt.Folder = Path("runs/report")
    """folder of --rerun; what is kept there is not made again"""

    def run(self, line: CommandLine) -> int:
        """0 filled or equal, 1 when a page differs under ``--only-check`` or a rerun failed, 2 on bad input."""
        from paper.reproduce import age, pages
        from paper.reproduce.registry import CATALOGUE
        from paper.reproduce.settings import Settings

        if not (pages.ROOT / "docs").is_dir():
            raise ValueError(f"{pages.ROOT}: has no docs; run it in a checkout")
        if self.results:
            print(f"figures in {pages.collect(self.results)}")
        parts = pages.read()["parts"]
        old = age.stale(parts)
        for name in old:
            needs = {*CATALOGUE[name].needs, name}
            seconds = sum(CATALOGUE[need].seconds(Settings()) for need in needs)
            made = parts.get(name, {}).get("made", "not made")
            print(f"stale: {name} ({made}), about {duration(seconds)} on two idle cores")
        if self.stale:
            return 0
        if self.rerun and old:
            again = CommandLine(line.prog.replace(" docs", ""), (*old, "--out", str(self.out)))
            if code := Reproduce(part=tuple(old), out=self.out).run(again):
                return code
            print(f"figures in {pages.collect((self.out,))}")
        differing = pages.fill(check=self.only_check)
        state = "differs; run mrwarp reproduce docs" if self.only_check else "filled"
        for path in differing:
            print(f"{path.relative_to(pages.ROOT)}: {state}")
        return 1 if self.only_check and differing else 0
