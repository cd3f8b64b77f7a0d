"""Section 3.2: the gates' thresholds, varied one at a time under the push of table 4."""

from __future__ import annotations

from dataclasses import replace

from mrwarp import paper
from mrwarp.evaluate import thresholds
from mrwarp.evaluate.impact import ImpactSweep, Variant
from mrwarp.paper import Measured
from mrwarp.reproduce import pushes, readings
from mrwarp.reproduce.experiment import Experiment, Findings, Job, Row

TITLES = {
    "f_th": ("contact threshold", "N"),
    "eps_e": ("error threshold", "rad"),
    "eps_v": ("speed threshold", "rad/s"),
}
"""Thresholds and their units."""

QUANTITIES = {"drop": "reduction of CoM drop", "motor": "reduction of motor torque"}
"""What 1.5 A reduce against no current."""


def compute(job: Job) -> Findings:
    """Reductions at both ends of each threshold's range beside the paper's."""
    settings, found = job.settings, pushes.read(job.folders["pushes"])
    duration = found.readings[found.place(readings.ADOPTED)]["duration"]
    cfg = readings.config(
        readings.ADOPTED, trials=len(settings.impacted) * settings.impacts, seed=settings.seed, threads=settings.threads
    )
    off, on = cfg.variants[0], cfg.variants[-1]
    variants = tuple(
        Variant(current=off.current if v.current == 0.0 else on.current,
                params={**(off if v.current == 0.0 else on).params, **v.params})
        for v in thresholds.variants(on.current)
    )  # fmt: skip
    sweep = ImpactSweep(replace(cfg, variants=variants, duration=duration), settings.struck(readings.ADOPTED.gains))
    reductions = thresholds.reductions(sweep.run())
    thresholds.plot(reductions, job.out / "thresholds.png")
    rows, claims = [], {}
    for name, entries in reductions.items():
        title, unit = TITLES[name]
        for quantity, ends in paper.THRESHOLDS[name].items():
            for entry, theirs in zip((entries[0], entries[-1]), ends, strict=True):
                cell = entry[quantity]
                rows.append(
                    Row(condition=f"{title} {entry['value']:g} {unit}", quantity=QUANTITIES[quantity], unit="%",
                        paper=Measured(mean=theirs), ours=cell["mean"], sd=cell["sd"], n=sweep.cfg.trials, digits=2,
                        why="The damping torque sets the level, see table 4; the threshold changes it.")
                )  # fmt: skip
            if name != "f_th":
                claims[f"a larger {title} weakens the {QUANTITIES[quantity]}"] = (
                    entries[-1][quantity]["mean"] < entries[0][quantity]["mean"]
                )
    span = [abs(reductions[name][-1]["drop"]["mean"] - reductions[name][0]["drop"]["mean"]) for name in TITLES]
    claims["the contact threshold matters least for the drop"] = span[0] <= min(span)
    return Findings(
        rows=rows, claims=claims, notes=[f"Push of table 4 ({duration:.2f} s), reading: {readings.ADOPTED.name}."],
        pictures={"thresholds.png": "Reduction of drop and motor torque by 1.5 A over each threshold"},
    )  # fmt: skip


EXPERIMENT = Experiment(
    name="sensitivity", title="Section 3.2: sensitivity to the gates' thresholds", compute=compute, needs=("pushes",),
    settings=("impacted", "aware", "impacts", "seed"),
)  # fmt: skip
