"""The recording that a diagnosis asks for, made on the same device and appended: does it settle what was left open?

The motion is drawn here from the sentence and the settings of the proposal, as somebody at the bench would set it up;
nothing is taken from the diagnosis' own idea of it. Commands step between samples, as they do on a bench.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.confusion.case import Case
from benchmarks.confusion.current import Current
from benchmarks.confusion.effects import Effect
from benchmarks.confusion.motion import Motion, started
from benchmarks.confusion.truth import Device
from mrwarp.recording.load import Recording

MOST_SECONDS = 900.0
"""Longest motion that is carried out [s]; of a longer proposal this much."""

CURRENTS = {
    "current steps": "steps", "current steps, slow swing": "steps", "current staircase": "staircase",
    "slow swings": "levels", "wide swings": "levels", "wide swings without current": "none",
    "middling swings": "levels", "small swings": "levels",
}  # fmt: skip
"""Programmes of the current in the experiments with a motion of their own."""

RESULTS = ("resolved", "ambiguous", "missed", "wrong", "other", "failed", "not proposed")
"""Outcomes of an experiment: right now, or the outcome that is left, or there was no proposal."""

_STREAM = 6
"""The seed's stream for the noise of experiments; the next one is for their motion."""


@dataclass(frozen=True)
class Proposal:
    """The experiment that a diagnosis asked for."""

    kind: str
    seconds: float
    settings: Mapping[str, float]

    @classmethod
    def of(cls, result: Any) -> Proposal | None:
        """The proposal of a diagnosis, or None."""
        wanted = result.next_experiment
        if wanted is None or not (wanted.kind in CURRENTS or wanted.kind == "rest and repeat"):
            return None
        return cls(kind=wanted.kind, seconds=float(wanted.seconds), settings=dict(wanted.settings))


def with_experiment(case: Case, proposal: Proposal) -> Recording:
    """The case's recording with the proposed one behind it, from the same device in the same session."""
    first = case.motion
    rng = np.random.default_rng(np.random.SeedSequence([case.seed, _STREAM + 1]))
    following = _repeated(first, proposal) if proposal.kind == "rest and repeat" else _moved(case, proposal, rng)
    both = joined(first, following)
    later = replace(case, device=_goes_on(case.device, first, both))
    runs = later.record(both, stream=_STREAM).trajectories[len(first.kind) :]
    named = tuple(replace(run, id=f"next-{k:02d}") for k, run in enumerate(runs))
    return replace(case.recording, trajectories=(*case.recording.trajectories, *named))


def joined(a: Motion, b: Motion) -> Motion:
    """Two parts of one session; ``b.start`` counts from the session's begin, and trajectories are equally long."""
    most = max(a.command.edge.shape[1], b.command.edge.shape[1])

    def wide(x: np.ndarray, **how: Any) -> np.ndarray:
        return np.pad(x, ((0, 0), (0, most - x.shape[1])), **how)

    edge = np.concatenate([wide(m.command.edge, constant_values=np.inf) for m in (a, b)])
    level = np.concatenate([wide(m.command.target, mode="edge") for m in (a, b)])
    return Motion(
        kind=(*a.kind, *b.kind),
        rate=a.rate,
        substeps=a.substeps,
        q=np.concatenate([a.q, b.q]),
        qd=np.concatenate([a.qd, b.qd]),
        command=Current(edge=edge, target=level, start=level),
        start=np.concatenate([a.start, b.start]),
    )


def _goes_on(device: Device, first: Motion, both: Motion) -> Device:
    """The device in a longer session: the same wear per way, which its law counts by the session's end."""
    wear = device.effects.get("wear")
    if wear is None:
        return device
    longer = float(both.slid[-1, -1] / first.slid[-1, -1])
    return device.with_effects({**device.effects, "wear": Effect(strength=wear.strength * longer, draws=wear.draws)})


def _repeated(first: Motion, proposal: Proposal) -> Motion:
    """The first trajectories once more, with the same rests between them, after a long one."""
    count = int(proposal.settings["runs"])
    ends = float(first.start[-1] + first.t[-1])
    return Motion(
        kind=("again",) * count,
        rate=first.rate,
        substeps=first.substeps,
        q=first.q[:count],
        qd=first.qd[:count],
        command=replace(
            first.command,
            edge=first.command.edge[:count],
            target=first.command.target[:count],
            start=first.command.start[:count],
        ),
        start=ends + proposal.settings["rest_seconds"] + first.start[:count] - first.start[0],
    )


def _moved(case: Case, proposal: Proposal, rng: np.random.Generator) -> Motion:
    """Runs of the proposed motion, as long as those of the case, with short rests."""
    first, settings, t = case.motion, proposal.settings, case.motion.t
    seconds = float(t[-1])
    count = max(3, round(min(proposal.seconds, MOST_SECONDS) / seconds))
    size = settings["amplitude"] / case.rendering.motion
    top = settings["current_max"] / case.rendering.current
    low, high = settings["frequency_low"], settings["frequency_high"]
    faster = (high - low) / seconds
    q, qd, edges, levels = [], [], [], []
    for k in range(count):
        turn = 2.0 * np.pi * (low * t + 0.5 * faster * t * t) + rng.uniform(0.0, 2.0 * np.pi)
        x, xd = np.sin(turn), 2.0 * np.pi * (low + faster * t) * np.cos(turn)
        x, xd = started(t, x, xd, size, rng, peak=1.0)
        edge, level = _current(CURRENTS[proposal.kind], k / max(count - 1, 1), seconds, rng)
        q.append(x)
        qd.append(xd)
        edges.append(edge)
        levels.append(top * level)
    rest = rng.uniform(5.0, 30.0, count)
    ends = float(first.start[-1] + first.t[-1])
    return Motion(
        kind=("experiment",) * count,
        rate=first.rate,
        substeps=first.substeps,
        q=np.stack(q),
        qd=np.stack(qd),
        command=Current.steps(edges, levels),
        start=ends + np.cumsum(rest + seconds) - seconds,
    )


def _current(how: str, share: float, seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Edges [s] and levels [1] of the current in one run; ``share`` runs from 0 to 1 over the runs."""
    if how == "none":
        return np.zeros(1), np.zeros(1)
    if how == "levels":
        return np.zeros(1), np.array([share])
    if how == "staircase":
        up = np.arange(9) / 8.0
        level = np.concatenate([up, up[-2::-1]])
        edge = np.arange(len(level)) * seconds / len(level) + rng.uniform(-0.01, 0.01, len(level))
        return np.concatenate([[0.0], edge[1:]]), level
    edge = np.cumsum(rng.uniform(0.2, 0.5, int(seconds / 0.2) + 1))
    edge = np.concatenate([[0.0], edge[edge < seconds]])
    upper = (np.arange(len(edge)) + rng.integers(2)) % 2
    return edge, rng.uniform(0.0, 1.0 / 3.0, len(edge)) + upper * 2.0 / 3.0
