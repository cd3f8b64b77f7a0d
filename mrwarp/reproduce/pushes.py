"""The simulated pushes behind table 4 and figure 6: every reading of what the paper leaves open."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.reproduce import readings, store, studied
from mrwarp.reproduce.ensemble import Ensemble
from mrwarp.reproduce.experiment import Experiment, Findings, Job, seeds_of

DATA = "pushes.npz"
"""File with the data."""

SERIES = ("t", "height", "velocity", "tau_motor", "tau_mr", "m_dyn", "fell")
"""What is kept of the adopted reading's trace."""


@dataclass(frozen=True, kw_only=True)
class Pushes:
    """What was simulated."""

    readings: list[dict[str, Any]]
    """Figures of every reading, see :func:`readings.summary`."""
    cells: list[dict[str, np.ndarray]]
    """Both columns of table 4 of every reading, shape (C, N)."""
    trace: dict[str, np.ndarray]
    """Series of the adopted reading, see :class:`mrwarp.trials.impact.ImpactTrace`."""
    policies: int
    """Policies; trial i was walked by policy ``i % policies``."""

    def place(self, reading: readings.Reading) -> int:
        """Index of a reading."""
        return next(i for i, entry in enumerate(self.readings) if entry["reading"] == reading.name)

    def seeds(self) -> np.ndarray | None:
        """Policy of each trial, shape (N,); None with a single policy."""
        return seeds_of(np.arange(self.cells[0]["min_height"].shape[1]), self.policies)


def simulate(job: Job) -> Findings:
    """Calibrate the duration of every reading on the 0 A row and push at all currents."""
    settings = job.settings
    done, trace = [], None
    for k, reading in enumerate(readings.READINGS):
        job.report(reading.name, k / len(readings.READINGS))
        pushed = readings.push(
            reading, Ensemble(settings.struck(reading.gains)), trials=len(settings.impacted) * settings.impacts,
            seed=settings.seed, threads=settings.threads,
        )  # fmt: skip
        done.append(pushed)
        if reading is readings.ADOPTED:
            trace = {name: getattr(pushed.trace, name) for name in SERIES}
    store.save(
        job.out / DATA,
        {"readings": readings.summary(done), "cells": [p.cells for p in done], "trace": trace,
         "policies": len(settings.impacted)},
    )  # fmt: skip
    return Findings()


def read(folder: Path) -> Pushes:
    """The data of :func:`simulate`."""
    return Pushes(**store.load(folder / DATA))


EXPERIMENT = Experiment(
    name="pushes", compute=simulate, shown=False,
    settings=("impacted", "aware", "impacts", "seed"),
    files=lambda settings: studied.networks(dict.fromkeys(reading.torque for reading in readings.READINGS)),
)  # fmt: skip
