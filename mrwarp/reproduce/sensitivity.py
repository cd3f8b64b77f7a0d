"""Section 3.2: the gates' thresholds, varied one at a time under the push of table 4."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mrwarp import paper
from mrwarp.reproduce import pushes
from mrwarp.reproduce.experiment import Findings, Job, compare, over_seeds
from mrwarp.reproduce.policies import Ensemble
from mrwarp.trials import thresholds
from mrwarp.trials.impact import ImpactSweep, ImpactTrace

TITLES = {
    "f_th": ("contact threshold", "N"),
    "eps_e": ("error threshold", "rad"),
    "eps_v": ("speed threshold", "rad/s"),
}
"""Thresholds and their units."""

QUANTITIES = {"drop": ("reduction of CoM drop", "%", 2), "motor": ("reduction of motor torque", "%", 2)}
"""What 1.5 A reduce against no current."""


def compute(job: Job) -> Findings:
    """Reductions at both ends of each threshold's range beside the paper's."""
    settings, policies = job.settings, len(job.settings.impacted)
    duration = pushes.read(job).of(pushes.ADOPTED).duration
    cfg = pushes.config(
        pushes.ADOPTED, trials=policies * settings.impacts, seed=settings.seed, threads=settings.threads
    )
    off, on = cfg.variants[0], cfg.variants[-1]
    varied = [(off if v.current == 0.0 else on, v.params) for v in thresholds.variants(on.current)]
    variants = tuple(replace(base, params={**base.params, **params}) for base, params in varied)
    ensemble = Ensemble(settings.struck(pushes.ADOPTED.gains))
    trace = ImpactSweep(replace(cfg, variants=variants, duration=duration), ensemble).run()
    thresholds.plot(thresholds.reductions(trace), job.out / "thresholds.png")
    reductions = by_seed(trace, policies)
    rows, claims = [], {}
    for name, entries in reductions.items():
        title, unit = TITLES[name]
        first, last = entries[0], entries[-1]
        for quantity, ends in paper.THRESHOLDS[name].items():
            why = "The damping torque sets the level, see table 4; the threshold changes it."
            rows += [
                compare(f"{title} {entry['value']:g} {unit}", QUANTITIES[quantity], theirs, entry[quantity], why)
                for entry, theirs in zip((first, last), ends, strict=True)
            ]
            if name != "f_th":
                weaker = last[quantity]["ours"] < first[quantity]["ours"]
                claims[f"a larger {title} weakens the {QUANTITIES[quantity][0]}"] = weaker
    span = [abs(reductions[name][-1]["drop"]["ours"] - reductions[name][0]["drop"]["ours"]) for name in TITLES]
    claims["the contact threshold matters least for the drop"] = span[0] <= min(span)
    return Findings(
        rows=rows,
        claims=claims,
        notes=[
            f"Push of table 4 ({duration:.2f} s), reading: {pushes.ADOPTED.name}. Each policy's reductions are "
            "relative to its own drop and torque without current.",
            *pushes.fallen(trace.fell, "pushes"),
        ],
        pictures={"thresholds.png": "Reduction of drop and motor torque by 1.5 A over each threshold, over all trials"},
    )


def by_seed(trace: ImpactTrace, policies: int) -> dict[str, list[dict[str, Any]]]:
    """:func:`thresholds.reductions` with ``ours``, ``sd`` and ``n`` of a :class:`Comparison` over policies.

    A policy's reductions are relative to its own drop and torque without current.

    Args:
        trace: Trace of a sweep over :func:`thresholds.variants`; trial i was walked by policy ``i % policies``.
        policies: Policies; of a single one the trials stand for themselves.
    """
    parts = [
        thresholds.reductions(
            replace(trace, height=trace.height[:, k::policies], tau_motor=trace.tau_motor[:, k::policies])
        )
        for k in range(policies)
    ]

    def cell(name: str, i: int, quantity: str) -> dict[str, Any]:
        """One quantity at value i of a threshold."""
        values = [part[name][i][quantity] for part in parts]
        if policies > 1:
            return over_seeds(np.array([value["mean"] for value in values]))
        n = trace.height.shape[1]
        return {"ours": values[0]["mean"], "sd": values[0]["sd"] if n > 1 else None, "n": n}

    return {
        name: [
            {"value": entry["value"], **{q: cell(name, i, q) for q in QUANTITIES}} for i, entry in enumerate(entries)
        ]
        for name, entries in parts[0].items()
    }
