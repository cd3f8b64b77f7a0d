"""Runs experiments in the order of their needs; only what changed is made again, and one failure loses nothing else.

Each experiment has a folder below the output folder: its pictures and data, ``findings.json`` written last, atomically,
with the key of everything it depends on. A run that was stopped goes on with what is missing.
"""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mrwarp.reproduce import fingerprint, store
from mrwarp.reproduce.experiment import Experiment, Findings, Job, NotYet
from mrwarp.reproduce.settings import Settings
from mrwarp.run_dir import one_line, plain, write_text

KEPT = "findings.json"
"""What an experiment leaves in its folder."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How one experiment ended."""

    name: str
    status: str
    """``made``, ``kept``, ``waiting`` (what it needs is not there yet), ``failed`` or ``not run``."""
    findings: Findings | None = None
    seconds: float = 0.0
    """What it took when it was made."""
    message: str = ""
    """Why there are no findings."""


class Runner:
    """One run of some experiments.

    Args:
        catalogue: All experiments by name.
        settings: Choices of the run.
        out: Output folder.
        report: Called with what runs and the share of it that is done.

    Attributes:
        outcomes: How each experiment ended, by name, in the order in which they were run.
    """

    def __init__(
        self,
        catalogue: Mapping[str, Experiment],
        settings: Settings,
        out: Path,
        report: Callable[[str, float], None] = lambda text, share: None,
    ) -> None:
        self.catalogue, self.settings, self.out, self._report = catalogue, settings, out, report
        self.outcomes: dict[str, Outcome] = {}
        self._keys: dict[str, dict[str, Any]] = {}

    def run(self, wanted: Sequence[str]) -> None:
        """Make or keep the experiments, each after what it needs; ``outcomes`` grows as they end.

        Raises:
            KeyboardInterrupt: the run was stopped; what is done is kept.
            KeyError: there is no experiment of that name.
        """
        for name in wanted:
            if name not in self.outcomes:
                self.run(self.catalogue[name].needs)
                self.outcomes[name] = self._make(self.catalogue[name])

    def _make(self, experiment: Experiment) -> Outcome:
        name, folder = experiment.name, self.out / experiment.name
        for need in experiment.needs:
            if (outcome := self.outcomes[need]).findings is None:
                status = "waiting" if outcome.status == "waiting" else "failed"
                return Outcome(name=name, status=status, message=f"needs {need}: {outcome.message}")
        try:
            self._keys[name] = key = fingerprint.key(experiment, self.settings, self._keys)
            if (kept := _read(folder / KEPT, key)) is not None:
                return kept
            folder.mkdir(parents=True, exist_ok=True)
            for stale in (KEPT, "error.txt"):  # what follows may be cut short, and its data are another key's
                (folder / stale).unlink(missing_ok=True)
            started = time.perf_counter()
            job = Job(
                settings=self.settings,
                out=folder,
                folders={need: self.out / need for need in experiment.needs},
                report=lambda text, share: self._report(f"{name}: {text}" if text else name, share),
            )
            job.report("", 0.0)
            findings = experiment.compute(job)
            seconds = time.perf_counter() - started
            content = plain({"key": key, "seconds": seconds, "findings": asdict(findings)})
            write_text(folder / KEPT, json.dumps(content, indent=1, allow_nan=False))
        except NotYet as error:
            return Outcome(name=name, status="waiting", message=str(error))
        except Exception as error:  # whatever one experiment meets, the others go on
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "error.txt").write_text(traceback.format_exc(), encoding="utf-8")
            return Outcome(name=name, status="failed", message=one_line(error) or type(error).__name__)
        return Outcome(name=name, status="made", findings=findings, seconds=seconds)


def _read(path: Path, key: dict[str, Any]) -> Outcome | None:
    """What was made under the same key; None if there is none, or what is there is damaged or of another layout."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["key"] == json.loads(json.dumps(key)):
            findings = store.typed(content["findings"], Findings)
            return Outcome(name=path.parent.name, status="kept", findings=findings, seconds=float(content["seconds"]))
    except (OSError, LookupError, TypeError, ValueError, RecursionError):
        pass
    return None
