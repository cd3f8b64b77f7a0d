"""Runs experiments in the order of their needs; only what changed is made again, and one failure loses nothing else.

Each experiment has a folder below the output folder: its pictures and data, ``findings.json`` written last and in one
piece with the key of everything it depends on. A run that was stopped goes on with what is missing.
"""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrwarp.model_file import ModelFileError, read_json_file
from mrwarp.reproduce import fingerprint
from mrwarp.reproduce.experiment import Experiment, Findings, Job, NotYet
from mrwarp.reproduce.settings import Settings
from mrwarp.run_dir import plain, write_text

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
        report: Told what runs and the share of it that is done.

    Attributes:
        outcomes: How each experiment ended, by name, in the order in which they were run.
    """

    def __init__(
        self,
        catalogue: Mapping[str, Experiment],
        settings: Settings,
        out: Path,
        report: Callable[[str, float], None] | None = None,
    ) -> None:
        self.catalogue, self.settings, self.out = catalogue, settings, out
        self.outcomes: dict[str, Outcome] = {}
        self._keys: dict[str, dict[str, Any]] = {}
        self._report = report or (lambda text, share: None)

    def run(self, wanted: Sequence[str]) -> None:
        """Make or keep the experiments and what they need; ``outcomes`` grows as they end.

        Raises:
            KeyboardInterrupt: the run was stopped; what is done is kept.
        """
        for name in in_order(self.catalogue, wanted):
            self.outcomes[name] = self._one(self.catalogue[name])

    def _one(self, experiment: Experiment) -> Outcome:
        name, folder = experiment.name, self.out / experiment.name
        for need in experiment.needs:
            if (outcome := self.outcomes[need]).findings is None:
                status = "waiting" if outcome.status == "waiting" else "failed"
                return Outcome(name=name, status=status, message=f"needs {need}: {outcome.message}")
        try:
            key = fingerprint.key(experiment, self.settings, self._keys)
            self._keys[name] = key
            if (kept := _read(folder / KEPT, key)) is not None:
                return Outcome(name=name, status="kept", findings=kept[0], seconds=kept[1])
            folder.mkdir(parents=True, exist_ok=True)
            for stale in (KEPT, "error.txt"):  # what follows may be cut short, and its data are another key's
                (folder / stale).unlink(missing_ok=True)
            started = time.perf_counter()
            job = Job(
                settings=self.settings, out=folder, folders={need: self.out / need for need in experiment.needs},
                report=lambda text, share: self._report(f"{name}: {text}" if text else name, share),
            )  # fmt: skip
            job.report("", 0.0)
            findings = experiment.compute(job)
            seconds = time.perf_counter() - started
            content = plain({"key": key, "seconds": seconds, "findings": findings.to_json()})
            write_text(folder / KEPT, json.dumps(content, indent=1, allow_nan=False))
        except NotYet as error:
            return Outcome(name=name, status="waiting", message=str(error))
        except Exception as error:  # whatever one experiment meets, the others go on
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "error.txt").write_text(traceback.format_exc(), encoding="utf-8")
            line = " ".join(str(error).split()) or type(error).__name__
            return Outcome(name=name, status="failed", message=line)
        return Outcome(name=name, status="made", findings=findings, seconds=seconds)


def in_order(catalogue: Mapping[str, Experiment], wanted: Sequence[str]) -> list[str]:
    """The wanted experiments and all they need, each after its needs.

    Raises:
        KeyError: there is no experiment of that name.
    """
    ordered: list[str] = []

    def visit(name: str) -> None:
        if name not in ordered:
            for need in catalogue[name].needs:
                visit(need)
            ordered.append(name)

    for name in wanted:
        visit(name)
    return ordered


def _read(path: Path, key: dict[str, Any]) -> tuple[Findings, float] | None:
    """Findings that were made under the same key and the seconds they took; None if there are none such."""
    if not path.is_file():
        return None
    try:
        content = read_json_file(path)
        if content["key"] != json.loads(json.dumps(key)):
            return None
        return Findings.from_json(content["findings"]), float(content["seconds"])
    except (ModelFileError, KeyError, TypeError, ValueError):  # damaged or of another layout: made again
        return None
