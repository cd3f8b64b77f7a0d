"""Entries on impacts beside table 4: figures 6 and 7, table 5, and the gates' thresholds of section 3.2."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mrwarp import paper
from mrwarp.enums import ZStep
from mrwarp.reproduce import impacts
from mrwarp.reproduce.cache import Job
from mrwarp.reproduce.comparison import Findings, compare, over_seeds, seeds_of
from mrwarp.reproduce.settings import Ensemble, study_files
from mrwarp.runtime import drawing, panels
from mrwarp.study.plan import AWARE, CONVENTIONAL
from mrwarp.trials.impact import ImpactCfg, ImpactKind, ImpactSweep, ImpactTrace, fixed_current_env
from mrwarp.trials.impact_figures import plot_thresholds, threshold_reductions, threshold_variants
from mrwarp.trials.walk_pictures import PAPER_MARK
from mrwarp.usd.robot import CURRENT_GROUPS, LEGS
from mrwarp.viewing.robot_pictures import COLORS

TORQUE = ("calf motor torque", "N·m", 2)
"""Quantity, unit and digits."""

LAST = -1
"""Place of the largest current, 1.5 A; the first is 0 A."""

STRIKES = (("eq. 14", 0.0), ("eq. 14", 1.5), ("required", 1.5))
"""Sliding torque, of ``impacts.TORQUES``, and current [A] in table 5: SAL off, on, on with the required one."""

CONFIGURATIONS = {"A": (CONVENTIONAL, 0), "B": (CONVENTIONAL, 1), "C": (AWARE, 0), "D": (AWARE, 1)}
"""Training of table 2's configurations, and the place in :data:`STRIKES`."""

STRUCK = {
    "acceleration": ("mean |a_z - g|", "m/s^2", 3),
    "FR": ("FR calf motor torque", "N·m", 3),
    "RL": ("RL calf motor torque", "N·m", 3),
}
"""Columns of table 5, their units and digits."""

THRESHOLDS = {
    "f_th": ("contact threshold", "N"),
    "eps_e": ("error threshold", "rad"),
    "eps_v": ("speed threshold", "rad/s"),
}
"""Thresholds and their units."""

REDUCED = {"drop": ("reduction of CoM drop", "%", 2), "motor": ("reduction of motor torque", "%", 2)}
"""What 1.5 A reduce against no current."""


def fig6(job: Job) -> Findings:
    """Calf motor torque of the push: mean and peak while the damping gate is open at 1.5 A, and the paired change."""
    found = impacts.read_pushes(job)
    adopted = found.adopted.reading
    pairs = {leg: same_load(leg, impacts.STANCES[adopted.stance]) for leg in paper.FIGURE_6_PUSH}
    rows, lower = [], {}
    for law, trace in found.traces.items():
        torque, gate = np.abs(trace["tau_motor"]), trace["m_dyn"][LAST] > 0.0
        beside = "" if law == adopted.torque else f", {law} torque"
        for leg, theirs in paper.FIGURE_6_PUSH.items():
            k, name = LEGS.index(pairs[leg]), leg if pairs[leg] == leg else f"{pairs[leg]} for the paper's {leg}"
            on, off = (_while_open(torque[place, :, :, k], gate[:, :, k]) for place in (LAST, adopted.zero))
            damped = ~np.isnan(on["mean"])
            seeds = seeds_of(np.flatnonzero(damped), found.policies)
            for kind in ("mean", "peak"):
                with_current, without = on[kind][damped], off[kind][damped]
                change = with_current / without - 1.0
                lower.setdefault(beside, []).append(float(change.mean()) < 0.0)
                reference = float(without.mean()) if len(without) else float("nan")
                why = (
                    f"Without current ours is {reference:.1f} N·m, the paper's "
                    f"{theirs[kind] / (1.0 + theirs[f'{kind}_change']):.1f} N·m; its gains are not stated."
                )
                taken = "The device takes over what its sliding torque can carry, see the readings of table 4."
                change_theirs, changes = 100.0 * theirs[f"{kind}_change"], over_seeds(100.0 * change, seeds)
                rows += [
                    compare(
                        f"{name}, {kind}, 1.5 A{beside}", TORQUE, theirs[kind], over_seeds(with_current, seeds), why
                    ),
                    compare(f"{name}, {kind}, 0 to 1.5 A{beside}", ("change", "%", 1), change_theirs, changes, taken),
                ]
    notes = [f"Push of table 4, reading: {adopted.name}."]
    if any(leg != ours for leg, ours in pairs.items()):
        notes.append(
            f"This push meets the robot while {' and '.join(pairs.values())} stand, the paper's while "
            f"{' and '.join(pairs)} do: the mirrored legs are compared."
        )
    shown = found.traces[adopted.torque]
    with drawing("torque.png"):
        _plot_push(shown, adopted.zero, job)
    return Findings(
        rows=rows,
        claims={f"current lowers the motor's torque on the loaded pair{law}": all(each) for law, each in lower.items()},
        notes=[*notes, *impacts.fallen(shown["fell"], "pushes")],
        pictures={"torque.png": "Calf motor torque of the first trial at 0 and 1.5 A; damping gate open where shaded"},
    )


def same_load(leg: str, phases: tuple[float, float] | None) -> str:
    """The leg that is loaded here where ``leg`` of the paper's pair is: the one that stands at the same end.

    Gait ``phases`` at onset; None is any, and every leg stands for itself.
    """
    return next((stands for stands in impacts.stance_legs(phases) if stands[0] == leg[0]), leg)


def _while_open(torque: np.ndarray, gate: np.ndarray) -> dict[str, np.ndarray]:
    """Mean and peak per trial over the samples in which the gate is open; NaN where it never is. Shapes (N, T)."""
    open_ = gate.any(axis=1)
    masked = np.where(gate, torque, np.nan)[open_]
    found = {"mean": np.full(len(gate), np.nan), "peak": np.full(len(gate), np.nan)}
    found["mean"][open_], found["peak"][open_] = np.nanmean(masked, axis=1), np.nanmax(masked, axis=1)
    return found


def _plot_push(trace: dict[str, np.ndarray], zero: int, job: Job) -> None:
    figure, axes = panels((11, 5.2), 2, 2, sharex=True, sharey=True)
    for k, (leg, axis) in enumerate(zip(LEGS, axes.flat, strict=True)):
        axis.plot(trace["t"], trace["tau_motor"][zero, 0, :, k], color="0.5", label="0 A")
        axis.plot(trace["t"], trace["tau_motor"][LAST, 0, :, k], color="#1f6fb4", label="1.5 A")
        axis.fill_between(trace["t"], 0, 1, where=trace["m_dyn"][LAST, 0, :, k] > 0.0, color="#e08a1e", alpha=0.2,
                          linewidth=0, transform=axis.get_xaxis_transform())  # fmt: skip
        axis.set_title(f"{leg} calf", fontsize=9)
    for axis in axes[1]:
        axis.set_xlabel("time after the push began [s]")
    for axis in axes[:, 0]:
        axis.set_ylabel("motor torque [N·m]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    handles, labels = [*handles, Patch(color="#e08a1e", alpha=0.2)], [*labels, "damping gate open at 1.5 A"]
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=8)
    figure.savefig(job.out / "torque.png", dpi=110)


def fig7(job: Job) -> Findings:
    """Mean calf motor torque over 0.1 s of the falling mass; the paper hit FR and RL in stance, and states those."""
    dropped = impacts.read_drops(job)
    found, seeds = dropped.figures, dropped.seeds()
    rows, lower = [], {}
    for name, values in found.items():
        for leg, theirs in paper.FIGURE_7.items():
            fall = values[leg][-1].mean() / values[leg][0].mean() - 1.0
            lower.setdefault(name, []).append(bool(values[leg][-1].mean() < values[leg][0].mean()))
            paired = theirs[1.5].mean / theirs[0.0].mean - 1.0
            why = (
                "The gains behind the hardware's torques are not stated; current changes ours by "
                f"{100.0 * fall:+.1f} %, the paper's by {100.0 * paired:+.1f} %."
            )
            for amps, cell in theirs.items():
                ours = over_seeds(values[leg][CURRENT_GROUPS.index(amps)], seeds)
                rows.append(compare(f"{leg}, {amps:g} A, {name}", TORQUE, cell, ours, why))
    with drawing("torque.png"):
        _plot_drop(found, seeds, job)
    return Findings(
        rows=rows,
        claims={f"1.5 A lower the torque of FR and RL, {name}": all(each) for name, each in lower.items()},
        notes=impacts.lost(found.values()),
        pictures={
            "torque.png": "Mean calf motor torque over 0.1 s by leg and current; diamonds: the paper's FR and RL"
        },
    )


def _plot_drop(found: dict[str, dict[str, np.ndarray]], seeds: np.ndarray | None, job: Job) -> None:
    figure, (axes,) = panels((11, 4.2), 1, len(found), grid="y", sharey=True)
    width = 0.8 / len(CURRENT_GROUPS)
    for axis, (name, values) in zip(axes, found.items(), strict=True):
        for i, amps in enumerate(CURRENT_GROUPS):
            x = np.arange(len(LEGS)) + (i - 1.5) * width
            ours = [over_seeds(values[leg][i], seeds) for leg in LEGS]
            axis.bar(x, [o["ours"] for o in ours], width, color=COLORS[i], label=f"{amps:g} A",
                     yerr=[o["sd"] or 0.0 for o in ours], capsize=2)  # fmt: skip
            for leg, theirs in paper.FIGURE_7.items():
                if amps in theirs:
                    place = x[LEGS.index(leg)] + 0.25 * width
                    axis.errorbar(place, theirs[amps].mean, theirs[amps].sd, capsize=2, **PAPER_MARK)
        axis.set_xticks(range(len(LEGS)), LEGS)
        axis.set_title(name, fontsize=9)
    axes[0].set_ylabel("mean |calf motor torque| over 0.1 s [N·m]")
    handles, labels = axes[0].get_legend_handles_labels()
    handles, labels = [*handles, Line2D([], [], **PAPER_MARK)], [*labels, "paper, FR and RL"]
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), fontsize=8)
    figure.savefig(job.out / "torque.png", dpi=110)


def table5(job: Job) -> Findings:
    """The falling mass by training, SAL off and on: means over 0.1 s from the contact on."""
    settings, rows = job.settings, []
    found: dict[str, dict[str, np.ndarray]] = {}
    seeds: np.ndarray | None = None
    for k, training in enumerate((CONVENTIONAL, AWARE)):
        job.report(training, k / 2.0)
        paths = study_files((training,))
        cfg = ImpactCfg(
            kind=ImpactKind.DROP,
            trials=len(paths) * settings.impacts,
            env=fixed_current_env(z_step=ZStep.EULER, threads=settings.threads),
            seed=settings.seed,
            phases=impacts.FR_RL_STANCE,
            variants=tuple(impacts.device_variant(torque, amps) for torque, amps in STRIKES),
        )
        found[training] = impacts.measured(ImpactSweep(cfg, Ensemble(paths)).run())
        seeds = seeds_of(np.arange(cfg.trials), len(paths))
    means = {
        name: {q: found[training][q][sal].mean() for q in STRUCK} for name, (training, sal) in CONFIGURATIONS.items()
    }
    for name, (training, sal) in CONFIGURATIONS.items():
        off, on = ("A", "B") if training == CONVENTIONAL else ("C", "D")
        for quantity, shown in STRUCK.items():
            ours = means[on][quantity] / means[off][quantity] - 1.0
            hardware = paper.TABLE_5[on][quantity].mean / paper.TABLE_5[off][quantity].mean - 1.0
            why = (
                f"SAL changes it by {100.0 * ours:+.1f} % here and by {100.0 * hardware:+.1f} % on hardware, whose "
                "mass and sensors differ."
            )
            condition, figures = f"{name}: {training}, SAL {'on' if sal else 'off'}", found[training][quantity]
            theirs = paper.TABLE_5[name][quantity]
            rows.append(compare(condition, shown, theirs, over_seeds(figures[sal], seeds), why))
            if sal:
                torque, reason = f"{condition}, required torque", "With the torque that table 4's rows require."
                rows.append(compare(torque, shown, theirs, over_seeds(figures[-1], seeds), reason))

    def lower(quantity: str, first: str, second: str) -> bool:
        return bool(means[second][quantity] < means[first][quantity])

    return Findings(
        rows=rows,
        claims={
            "with SAL on, actuator-aware training lowers |a_z - g| (B to D)": lower("acceleration", "B", "D"),
            "and both motors' torque": lower("FR", "B", "D") and lower("RL", "B", "D"),
            "SAL lowers |a_z - g| of both": all(lower("acceleration", *pair) for pair in ("AB", "CD")),
        },
        notes=[
            "The paper's rows are hardware's: an estimate from its sensors, ours the simulated trunk's motion.",
            *impacts.lost(found.values()),
        ],
    )


def sensitivity(job: Job) -> Findings:
    """The push of table 4 with one of the gates' thresholds at a time varied: reductions at both ends of its range."""
    settings, policies = job.settings, len(job.settings.impacted)
    chosen = impacts.read_pushes(job).adopted
    reading, duration = chosen.reading, chosen.duration
    cfg = impacts.config(reading, settings, duration=duration)
    off, on = cfg.variants[reading.zero], cfg.variants[-1]
    varied = [(off if v.current == 0.0 else on, v.params) for v in threshold_variants(on.current)]
    variants = tuple(replace(base, params={**base.params, **params}) for base, params in varied)
    trace = impacts.sweep(reading, settings, lift=chosen.lift, cfg=replace(cfg, variants=variants))
    with drawing("thresholds.png"):
        plot_thresholds(threshold_reductions(trace), job.out / "thresholds.png")
    reductions = by_seed(trace, policies)
    rows, claims, span = [], {}, []
    for name, (title, unit) in THRESHOLDS.items():
        first, last = reductions[name][0], reductions[name][-1]
        for quantity, ends in paper.THRESHOLDS[name].items():
            why = "The damping torque sets the level, see table 4; the threshold changes it."
            rows += [
                compare(f"{title} {entry['value']:g} {unit}", REDUCED[quantity], theirs, entry[quantity], why)
                for entry, theirs in zip((first, last), ends, strict=True)
            ]
            if name != "f_th":
                weaker = last[quantity]["ours"] < first[quantity]["ours"]
                claims[f"a larger {title} weakens the {REDUCED[quantity][0]}"] = weaker
        span.append(abs(last["drop"]["ours"] - first["drop"]["ours"]))
    claims["the contact threshold matters least for the drop"] = span[0] <= min(span)
    return Findings(
        rows=rows,
        claims=claims,
        notes=[
            f"Push of table 4 ({duration:.2f} s), reading: {reading.name}. Each policy's reductions are "
            "relative to its own drop and torque without current.",
            *impacts.fallen(trace.fell, "pushes"),
        ],
        pictures={"thresholds.png": "Reduction of drop and motor torque by 1.5 A over each threshold, over all trials"},
    )


def by_seed(trace: ImpactTrace, policies: int) -> dict[str, list[Mapping[str, Any]]]:
    """:func:`threshold_reductions` of each policy's own pushes: ``ours``, ``sd`` and ``n`` of a row over policies.

    Trial i was walked by policy ``i % policies``; of a single policy the trials stand for themselves.
    """
    own = [slice(k, None, policies) for k in range(policies)]
    parts = [
        threshold_reductions(replace(trace, height=trace.height[:, k], tau_motor=trace.tau_motor[:, k])) for k in own
    ]

    def cell(name: str, i: int, quantity: str) -> dict[str, Any]:
        values = [part[name][i][quantity] for part in parts]
        if policies > 1:
            return over_seeds(np.array([value["mean"] for value in values]))
        n = trace.height.shape[1]
        return {"ours": values[0]["mean"], "sd": values[0]["sd"] if n > 1 else None, "n": n}

    return {
        name: [{"value": entry["value"], **{q: cell(name, i, q) for q in REDUCED}} for i, entry in enumerate(entries)]
        for name, entries in parts[0].items()
    }
