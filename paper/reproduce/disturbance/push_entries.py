"""Entries of the push next to table 4: figure 6, and the gates' thresholds of section 3.2."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.patches import Patch

from mrwarp import paper
from mrwarp.runtime import drawing, panels
from mrwarp.trials.impact import ImpactTrace, Variant
from mrwarp.trials.impact_figures import plot_thresholds, threshold_reductions, threshold_variants
from mrwarp.usd.robot import CURRENT_GROUPS, LEGS
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import Findings, compare
from paper.reproduce.disturbance import push_rule
from paper.reproduce.disturbance.push_rule import DERIVED, JOINT, LITERAL, PAIR, SHORT, by_policy
from paper.reproduce.settings import IMPACTS, impacts_time, over_seeds
from paper.reproduce.verdicts import Claim, Measure, rows

TORQUE = ("calf motor torque", "N·m", 2)
"""Quantity, unit and digits."""

LAST = -1
"""Place of the largest current, 1.5 A; the first is 0 A."""

THRESHOLDS = {
    "f_th": ("contact threshold", "N"),
    "eps_e": ("error threshold", "rad"),
    "eps_v": ("speed threshold", "rad/s"),
}
"""Thresholds and their units."""

REDUCED = {
    "drop": ("reduction of CoM drop", "%", 2),
    "peak": ("reduction of motor torque", "%", 2),
    "motor": ("reduction of mean motor torque in 0.1 s", "%", 2),
}
"""Reductions by 1.5 A against no current; the motor's torque is the peak of the loaded calves, or the mean over all."""

PAPERS = {"drop": "drop", "peak": "motor", "motor": "motor"}
"""Which figure of ``paper.THRESHOLDS`` each stands next to."""


def fig6(job: Job) -> Findings:
    """Calf motor torque of the push while the damping gate is first open at 1.5 A, and its change from no current.

    Changes are ratios of means: over the pushes of a policy first, then the ratio, then the mean over policies.
    """
    found = push_rule.read(job)
    rows, lower = [], {}
    for reading in (LITERAL, JOINT):
        trace = found.traces[reading.name]
        for leg, theirs in paper.FIGURE_6_PUSH.items():
            k = LEGS.index(leg)
            gate = first_opening(trace["m_dyn"][LAST, :, :, k] > 0.0)
            on, off = (while_open(np.abs(trace["tau_motor"][place, :, :, k]), gate) for place in (LAST, 0))
            for kind in ("mean", "peak"):
                with_current, without = (policy_means(each[kind], found.policies) for each in (on, off))
                change = over_seeds(100.0 * (with_current / without - 1.0))
                lower.setdefault(reading.column, []).append(change["ours"] < 0.0)
                reference = theirs[kind] / (1.0 + theirs[f"{kind}_change"])
                why = f"Without current ours is {np.nanmean(without):.1f} N·m, the paper's {reference:.1f} N·m."
                taken = "The device takes over what it has beyond its own drag, see the readings of table 4."
                name = f"{leg}, {kind}"
                rows += [
                    compare(f"{name}, 1.5 A{reading.column}", TORQUE, theirs[kind], over_seeds(with_current), why),
                    compare(
                        f"{name}, 0 to 1.5 A{reading.column}",
                        ("change", "%", 1),
                        round(100.0 * theirs[f"{kind}_change"], 1),
                        change,
                        taken,
                    ),
                ]
    shown = found.traces[LITERAL.name]
    with drawing("torque.png"):
        _plot_push(shown, job)
    return Findings(
        rows=rows,
        claims={f"current lowers the motor's torque on the loaded pair{law}": all(each) for law, each in lower.items()},
        notes=push_rule.fallen(shown["fell"], "pushes"),
        pictures={"torque.png": "Calf motor torque of the first trial at 0 and 1.5 A; damping gate open where shaded"},
    )


def first_opening(gate: np.ndarray) -> np.ndarray:
    """The samples of each trial in which its gate is open for the first time, shapes (N, T)."""
    begun = np.maximum.accumulate(gate, axis=1)
    ended = np.maximum.accumulate(begun & ~gate, axis=1)
    return gate & ~ended


def while_open(torque: np.ndarray, gate: np.ndarray) -> dict[str, np.ndarray]:
    """Mean and peak per trial over the samples in which the gate is open; NaN where it never is. Shapes (N, T)."""
    count = gate.sum(axis=1)
    opened = np.where(count > 0, 1.0, np.nan)
    mean = np.where(gate, torque, 0.0).sum(axis=1) / np.maximum(count, 1)
    return {"mean": mean * opened, "peak": np.where(gate, torque, 0.0).max(axis=1) * opened}


def policy_means(values: np.ndarray, policies: int) -> np.ndarray:
    """Means over the trials of each policy that have a figure, shape (policies,); NaN where none has."""
    rows = values.reshape(-1, policies)
    there = ~np.isnan(rows)
    count = there.sum(axis=0)
    return np.where(count > 0, np.where(there, rows, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def _plot_push(trace: dict[str, np.ndarray], job: Job) -> None:
    figure, axes = panels((11, 5.2), 2, 2, sharex=True, sharey=True)
    for k, (leg, axis) in enumerate(zip(LEGS, axes.flat, strict=True)):
        axis.plot(trace["t"], trace["tau_motor"][0, 0, :, k], color="0.5", label="0 A")
        axis.plot(trace["t"], trace["tau_motor"][LAST, 0, :, k], color="#1f6fb4", label="1.5 A")
        axis.fill_between(
            trace["t"],
            0,
            1,
            where=trace["m_dyn"][LAST, 0, :, k] > 0.0,
            color="#e08a1e",
            alpha=0.2,
            linewidth=0,
            transform=axis.get_xaxis_transform(),
        )
        axis.set_title(f"{leg} calf", fontsize=9)
    for axis in axes[1]:
        axis.set_xlabel("time after the push began [s]")
    for axis in axes[:, 0]:
        axis.set_ylabel("motor torque [N·m]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    handles, labels = [*handles, Patch(color="#e08a1e", alpha=0.2)], [*labels, "damping gate open at 1.5 A"]
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=8)
    figure.savefig(job.out / "torque.png", dpi=110)


def sensitivity(job: Job) -> Findings:
    """The push of table 4 with one of the gates' thresholds at a time varied: reductions at both ends of its range."""
    settings, policies = job.settings, len(job.settings.impacted)
    by_rule = push_rule.chosen(push_rule.read(job).zeros).duration
    pusher, rows, claims, ids, notes = push_rule.Pusher(settings), [], {}, {}, []
    variants = tuple(Variant(current=v.current, params=v.params) for v in threshold_variants(CURRENT_GROUPS[-1]))
    for k, reading in enumerate((LITERAL, JOINT, SHORT)):
        job.report(reading.name, k / 3.0)
        trace = pusher.push(reading, variants, DERIVED if reading.derived else by_rule)
        column = reading.column
        notes += push_rule.fallen(trace.fell, f"pushes{column}")
        if reading == SHORT:
            with drawing("thresholds.png"):
                plot_thresholds(threshold_reductions(trace), job.out / "thresholds.png")
        reductions, span = by_seed(trace, policies), {}
        for name, (title, unit) in THRESHOLDS.items():
            first, last = reductions[name][0], reductions[name][-1]
            for quantity, shown in REDUCED.items():
                if PAPERS[quantity] not in paper.THRESHOLDS[name]:
                    continue
                ends = paper.THRESHOLDS[name][PAPERS[quantity]]
                why = "The damping torque sets the level, see table 4; the threshold changes it."
                rows += [
                    compare(
                        f"{title} {entry['value']:g} {unit}{column}", shown, theirs, over_seeds(entry[quantity]), why
                    )
                    for entry, theirs in zip((first, last), ends, strict=True)
                ]
                changed = over_seeds(last[quantity] - first[quantity])
                span[name, quantity] = changed["ours"]
                condition = f"{title} {first['value']:g} to {last['value']:g} {unit}{column}"
                quantity_of_change = (f"change of the {shown[0]}", "points", 2)
                rows.append(compare(condition, quantity_of_change, round(ends[1] - ends[0], 2), changed, why))
            if name != "f_th":
                claims[f"a larger {title} weakens the {REDUCED['drop'][0]}{column}"] = span[name, "drop"] < 0.0
        drops = {name: abs(value) for (name, quantity), value in span.items() if quantity == "drop"}
        least = f"the contact threshold matters least for the drop{column}"
        claims[least] = drops["f_th"] <= min(drops.values())
        if reading == SHORT:
            ids["contact_threshold_matters_least"] = least
    return Findings(
        rows=rows,
        claims=claims,
        claim_ids=ids,
        notes=[
            f"Push of table 4 ({by_rule:.2f} and {DERIVED:g} s), {settings.impacts} pushes per policy. Each policy's "
            "reductions are relative to its own drop and torque without current; changes over a range are paired.",
            *notes,
        ],
        pictures={"thresholds.png": "Reduction of drop and motor torque by 1.5 A over each threshold, over all trials"},
    )


def by_seed(trace: ImpactTrace, policies: int) -> dict[str, list[Mapping[str, Any]]]:
    """Reductions [%] of each policy's own pushes, by the names of :data:`REDUCED`, shape (policies,).

    The trace is that of a sweep over ``threshold_variants``; trial i was walked by policy ``i % policies``. Of a single
    policy the trials stand for themselves.
    """
    own = [slice(k, None, policies) for k in range(policies)] if policies > 1 else [slice(None)]
    loaded = [LEGS.index(leg) for leg in PAIR]
    peak = np.abs(trace.tau_motor[:, :, :, loaded]).max(axis=2).mean(axis=2)  # settings, trials
    parts = [
        threshold_reductions(replace(trace, height=trace.height[:, k], tau_motor=trace.tau_motor[:, k])) for k in own
    ]
    peaks = np.stack([by_policy(row, policies) for row in peak])
    found: dict[str, list[Mapping[str, Any]]] = {}
    place = 0
    for name, entries in parts[0].items():
        found[name] = []
        for i, entry in enumerate(entries):
            place += 1
            means = {q: np.array([part[name][i][q]["mean"] for part in parts]) for q in ("drop", "motor")}
            taken = 100.0 * (1.0 - peaks[place] / peaks[0])
            found[name].append(
                {"value": entry["value"], **means, "peak": taken if policies > 1 else taken.mean()[None]}
            )
    return found


EXPERIMENTS = (
    Experiment(name="sensitivity", compute=sensitivity, needs=("pushes",), settings=IMPACTS, seconds=impacts_time(9.0)),
    Experiment(name="fig6", compute=fig6, needs=("pushes",)),
)


def _reductions(quantity: str, *conditions: str) -> Measure:
    """Rows of the push that the paper's own row of 0 A asks for."""
    return rows("sensitivity", quantity, *(condition + SHORT.column for condition in conditions))


CLAIMS = (
    Claim(
        id="push.thresholds/f_th",
        place="Section 3.2",
        says="reduction of drop with a contact threshold of 3, 13 N [%]",
        measure=_reductions("reduction of CoM drop", "contact threshold 3 N", "contact threshold 13 N"),
        effect=True,
        why="1.5 A add half of the torque that the paper's rows require (table 4).",
    ),
    Claim(
        id="push.thresholds/eps_e",
        place="Section 3.2",
        says="eps_e 0.01 to 0.09 rad: change of the reduction of drop [points]",
        measure=_reductions("change of the reduction of CoM drop", "error threshold 0.01 to 0.09 rad"),
        effect=True,
        why="Right after the push begins a loaded calf has passed this range.",
    ),
    Claim(
        id="push.motor_torque/eps_e",
        place="Section 3.2",
        says="eps_e 0.01 to 0.09 rad: change of the reduction of motor torque [points]",
        measure=_reductions("change of the reduction of motor torque", "error threshold 0.01 to 0.09 rad"),
        effect=True,
        why="Right after the push begins a loaded calf has passed this range.",
    ),
    Claim(
        id="push.thresholds/eps_v",
        place="Section 3.2",
        says="eps_v 0.1 to 0.3 rad/s: change of the reduction of drop [points]",
        measure=_reductions("change of the reduction of CoM drop", "speed threshold 0.1 to 0.3 rad/s"),
        effect=True,
        why="Right after the push begins a loaded calf is faster than this range.",
    ),
    Claim(
        id="push.motor_torque/mean",
        place="Figure 6, simulation",
        says="0 to 1.5 A: mean motor torque of the front and the rear stance leg [%]",
        measure=rows("fig6", "change", "FL, mean, 0 to 1.5 A", "RR, mean, 0 to 1.5 A"),
        effect=True,
        why="Half of the paper's on both legs, as in section 3.2.",
    ),
    Claim(
        id="push.motor_torque/peak",
        place="Figure 6, simulation",
        says="0 to 1.5 A: peak motor torque, same legs [%]",
        measure=rows("fig6", "change", "FL, peak, 0 to 1.5 A", "RR, peak, 0 to 1.5 A"),
        effect=True,
        why="A quarter of the paper's on both legs.",
    ),
)
