"""A sweep from beginning to end: what is finished is kept, the rest runs, and what came out is laid side by side."""

from __future__ import annotations

import os
import shlex
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path

from mrwarp.run_dir import claim, write_result
from mrwarp.sweep import compare
from mrwarp.sweep.grid import GridError, Trial
from mrwarp.sweep.runners import LocalRunner, RayRunner
from mrwarp.sweep.trial import FINISHED, State, Status, last_lines, read_status, write_status

EVERY = 30.0
"""Time between two lines on all running trials [s]."""


class Session:
    """The trials of one call.

    Args:
        trials: What is run.
        out: Folder of the sweep; each trial has one of its own in it.

    Raises:
        GridError: a trial's folder holds a run with other arguments.
    """

    def __init__(self, trials: Sequence[Trial], out: Path) -> None:
        self._out = out
        self._trials = {(out / trial.name).absolute(): trial for trial in trials}
        self._seen = {folder: read_status(folder) for folder in self._trials}
        for folder, trial in self._trials.items():
            found = self._seen[folder].args
            if found and found != [trial.command, *trial.args]:
                raise GridError(f"{folder}: holds '{shlex.join(found)}'; name another --out or remove it")

    def run(self, runner: LocalRunner | RayRunner, *, retries: int, figures: Sequence[str], command: str) -> int:
        """Run what has no result yet, and compare what there is.

        Args:
            runner: Where; closed at the end.
            retries: Most new starts of a trial that is killed.
            figures: Names of the figures to show; empty takes the command's own.
            command: Command line, for the record.

        Returns:
            0 when every trial has a result, 1 when one failed, 130 after Ctrl-C.

        Raises:
            FolderError: another sweep writes into the folder.
            OSError: the disk takes no more; the running trials have saved and ended.
        """
        with claim(self._out):
            # a scheduler that takes the machine away says so by SIGTERM: as Ctrl-C
            previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
            try:
                interrupted = self._run(runner, retries)
                return self._report(figures, command, interrupted)
            finally:
                signal.signal(signal.SIGTERM, previous)
                runner.close()

    def _run(self, runner: LocalRunner | RayRunner, retries: int) -> bool:
        """Run the trials that are left; whether Ctrl-C ended them."""
        left = {
            folder: trial
            for folder, trial in self._trials.items()
            if self._seen[folder].state not in FINISHED or not (folder / "result.json").is_file()
        }
        kept = len(self._trials) - len(left)
        known = f", {kept} of them finished before" if kept else ""
        swept = next(iter(self._trials.values())).command
        print(f"{len(self._trials)} trials of mrwarp {swept}{known}; output in {self._out}", flush=True)
        for folder, trial in left.items():
            self._seen[folder] = Status(args=[trial.command, *trial.args], seconds=self._seen[folder].seconds)
            write_status(folder, self._seen[folder])
        stop, pool = threading.Event(), ThreadPoolExecutor(runner.workers, thread_name_prefix="trial")
        try:
            running = {pool.submit(runner.run, trial, folder, retries, stop.is_set) for folder, trial in left.items()}
            printed = time.monotonic()
            while running:
                done, running = wait(running, timeout=0.2)
                for future in done:
                    future.result()  # an error that is none of a trial's comes out here
                self._log_changes(left)
                if time.monotonic() - printed >= EVERY:
                    printed = time.monotonic()
                    for folder, trial in left.items():
                        if self._seen[folder].state is State.RUNNING:
                            print(f"    {trial.name}: {''.join(last_lines(folder, 1)).strip()[:140]}", flush=True)
            return False
        except KeyboardInterrupt:
            print("\nstopping: trainings save a checkpoint; a second Ctrl-C does not wait", file=sys.stderr, flush=True)
            return True
        finally:
            stop.set()
            try:
                pool.shutdown(cancel_futures=True)
            except KeyboardInterrupt:
                os._exit(130)  # the kernel ends the trials with their parent
            self._log_changes(left)

    def _log_changes(self, left: dict[Path, Trial]) -> None:
        """A line for each trial that began, was begun again or ended."""
        for folder, trial in left.items():
            now, before = read_status(folder), self._seen[folder]
            if (now.state, now.attempts) == (before.state, before.attempts):
                continue
            self._seen[folder] = now
            ended = sum(status.state not in (State.WAITING, State.RUNNING) for status in self._seen.values())
            text = str(now.state)
            if now.state is State.RUNNING:
                text = f"started again ({now.why})" if now.attempts > 1 else "started"
            elif now.state in FINISHED:
                text = f"{now.state} after {now.seconds:.0f} s"
            elif now.state is State.FAILED:
                text = "\n    ".join([f"FAILED ({now.why}); its last lines:", *now.lines])
            print(f"[{ended}/{len(self._trials)}] {trial.name}: {text}", flush=True)

    def _report(self, figures: Sequence[str], command: str, interrupted: bool) -> int:
        """Table, CSV, picture and result of what there is; returns the exit code."""
        rows = [compare.read_row(trial, folder) for folder, trial in self._trials.items()]
        swept = rows[0].trial.command
        try:
            names = compare.choose(rows, swept, figures)
        except ValueError as error:
            print(f"mrwarp sweep: {error}", file=sys.stderr)
            names = compare.choose(rows, swept, [])
        print("\n" + "\n".join(compare.lines(rows, names)))
        compare.write_csv(rows, self._out / "trials.csv")
        if names:
            compare.plot(rows, names, self._out / "trials.png")
        states = Counter(row.status.state.value for row in rows)
        content = {"swept": swept, "states": dict(states), "conditions": compare.summary(rows, names)}
        content["trials"] = [row.as_result() for row in rows]
        write_result(self._out, content, seed=0, command=command)
        finished = sum(states[state.value] for state in FINISHED)
        print(
            f"\n{finished} of {len(rows)} trials have a result; trials.csv, trials.png and result.json in {self._out}"
        )
        if interrupted:
            print("stopped; the same command goes on")
            return 130
        if finished < len(rows):
            print("the same command runs the failed ones again")
        return int(finished < len(rows))
