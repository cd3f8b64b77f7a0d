"""The simulated pushes behind table 4 and figure 6: every reading of what the paper leaves open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrwarp.reproduce import readings
from mrwarp.reproduce.experiment import Findings, Job, seeds_of
from mrwarp.reproduce.policies import Ensemble
from mrwarp.reproduce.readings import Reading, ReadingResult

SERIES = ("t", "height", "velocity", "tau_motor", "tau_mr", "m_dyn", "fell")
"""What is kept of the adopted reading's trace."""


@dataclass(frozen=True, kw_only=True)
class Pushes:
    """What was simulated."""

    readings: list[ReadingResult]
    trace: dict[str, np.ndarray]
    """Series of the adopted reading, see :class:`mrwarp.trials.impact.ImpactTrace`."""
    policies: int
    """Policies; trial i was walked by policy ``i % policies``."""

    def of(self, reading: Reading) -> ReadingResult:
        """Result of a reading."""
        return next(found for found in self.readings if found.reading == reading.name)

    def seeds(self) -> np.ndarray | None:
        """Policy of each trial, shape (N,); None with a single policy."""
        return seeds_of(np.arange(self.readings[0].cells["min_height"].shape[1]), self.policies)


def simulate(job: Job) -> Findings:
    """Calibrate the duration of every reading on the 0 A row and push at all currents."""
    settings, policies = job.settings, len(job.settings.impacted)
    done, kept = [], {}
    for k, reading in enumerate(readings.READINGS):
        job.report(reading.name, k / len(readings.READINGS))
        found, trace = readings.push(
            reading,
            Ensemble(settings.struck(reading.gains)),
            trials=policies * settings.impacts,
            seed=settings.seed,
            threads=settings.threads,
        )
        done.append(found)
        if reading is readings.ADOPTED:
            kept = {name: getattr(trace, name) for name in SERIES}
    return job.save(Pushes(readings=done, trace=kept, policies=policies))


def read(job: Job) -> Pushes:
    """Data of :func:`simulate`."""
    return job.load("pushes", Pushes)
