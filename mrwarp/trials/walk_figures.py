"""Figures of walks (tables 6 and 7, figure 8(c)) and missions (figures 10 and 11), ours and the paper's."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from mrwarp import paper
from mrwarp.energy import consistency, model_numbers
from mrwarp.energy.model_numbers import MeasuredPower
from mrwarp.energy.power import ElectricalCfg, JointLoad, battery_power, copper, cost_of_transport
from mrwarp.params import MrParams
from mrwarp.trials.mission import MissionTrace, PhaseLoad
from mrwarp.trials.power_meter import SHOWN, torque_of_bins
from mrwarp.trials.statistics import ratio_sd, spread
from mrwarp.trials.walk_trials import WalkResult
from mrwarp.usd.robot import CALF_COLUMNS, JOINTS, LEGS

COIL_RESISTANCES = (2.0, 10.0)
"""Plausible range of the coil's resistance [Ohm], see :class:`mrwarp.params.CoilParams`."""

MISSION_GROUPS = ("electrical", "thermal", "battery")
"""Groups of numbers that Go1's figures fixed: its way out the arm's mass, its way back the speed of both ways and that
arm and item are the 3 kg of table 6, its standby the electrical model, its calves the thermal model, its depletion the
capacity. Every figure of the other robots is a prediction."""

STANCE_SHARE = 0.5
"""Share of a stride in which the trot's clock has a leg on the ground."""


def row(result: WalkResult, cfg: ElectricalCfg, *, calibrated: bool = True) -> dict[str, Any]:
    """All figures of one condition; spreads are over its trials. Another device is compared with no row of the paper.

    ``calibrated``: whether the numbers were fitted to Go1's rows, which are then marked.
    """
    reference = paper.TABLE_6.get(result.key) if result.paper_device else None
    power, cots = battery_power(result.joints, cfg), cot(result, cfg)
    activation = paper.TABLE_7.get(result.cell) if result.paper_device and result.robot == "mr_go_sal" else None
    return {
        "robot": result.robot, "payload": result.payload, "command": result.command, "mass": result.mass,
        "calibrated": calibrated and result.robot == "go1" and reference is not None,
        "trials": len(result.speed), "fell": result.fell, "late": result.late,
        "power": spread(power.total), "parts": parts(result.joints, cfg),
        "cot": spread(cots), "paper": None if reference is None else {
            **asdict(reference), "power": reference.power, "power_sd": reference.power_sd,
        },
        "difference": None if reference is None else _difference(cots, reference.cot, reference.sd),
        **{"roll_pitch_rms" if name == "tilt_rms" else name: spread(x) for name, x in result.motion.items()},
        "hold_share": dict(zip(LEGS, map(spread, result.hold.T), strict=False)),
        "hold_mean": spread(result.hold.mean(-1)) if result.hold.size else None,
        "dynamic_share": dict(zip(LEGS, map(spread, result.dynamic.T), strict=False)),
        "gate_switches": spread(result.switches.mean(-1)) if result.switches.size else None,
        "paper_hold_mean": activation,
        "torque": torques(result),
    }  # fmt: skip


def cot(result: WalkResult, cfg: ElectricalCfg) -> np.ndarray:
    """Cost of transport (eq. 21) of each trial, shape (n,)."""
    return cost_of_transport(battery_power(result.joints, cfg).total, result.mass, result.speed)


def mean_power(result: WalkResult, cfg: ElectricalCfg) -> float:
    """Battery power over the trials [W]; NaN where nobody arrived."""
    return mean(battery_power(result.joints, cfg).total)


def mean(values: np.ndarray) -> float:
    """Mean over the trials; NaN where nobody arrived."""
    return spread(values)["mean"]


def parts(joints: JointLoad, cfg: ElectricalCfg) -> dict[str, float]:
    """Mean power by part [W], the copper loss split into calves and the other joints; NaN where nobody arrived."""
    calf = mean(np.ravel(copper(joints, cfg)[..., list(CALF_COLUMNS)].sum(-1)))
    named = {name: mean(np.ravel(value)) for name, value in battery_power(joints, cfg).parts().items()}
    total = named.pop("copper")
    return {"copper_calves": calf, "copper_hips_thighs": total - calf, **named}


def torques(result: WalkResult) -> dict[str, dict[str, float]]:
    """Figures of the distribution of |motor torque| of the front-right joints [N·m]; to half a bin, 0.25 N·m."""
    centres, percents = torque_of_bins(), (5, 25, 50, 75, 95, 99)
    found = {}
    for joint, counts in zip(SHOWN, result.counts, strict=True):
        if not counts.any():
            found[JOINTS[joint]] = dict.fromkeys(("mean", *(f"p{q}" for q in percents)), float("nan"))
            continue
        at = np.percentile(centres, percents, weights=counts, method="inverted_cdf")
        quantiles = {f"p{q}": float(value) for q, value in zip(percents, at, strict=True)}
        found[JOINTS[joint]] = {"mean": float(np.average(centres, weights=counts)), **quantiles}
    return found


def calibration_rows(results: Sequence[WalkResult], standing: JointLoad) -> list[MeasuredPower]:
    """Go1's rows of table 6 and its standby power with what the simulated robot does there."""
    rows = []
    for result in results:
        reference = paper.TABLE_6.get(result.key)
        if result.robot == "go1" and len(result.speed) and reference is not None:
            name = f"Go1 {result.condition}"
            rows.append(MeasuredPower(name=name, joints=result.joints.mean(), measured=reference.power))
    standby = paper.MISSION_POWER["go1"]["standby"]
    return [*rows, MeasuredPower(name="Go1 standby", joints=standing, measured=standby)]


@dataclass(frozen=True, kw_only=True)
class Saving:
    """Saving by SAL against MR_Go in one condition: simulated, the paper's, and by closed form."""

    payload: float
    """[kg]"""
    command: float
    """[m/s]"""
    calibrated: bool = False
    """No saving takes part in a calibration."""
    hold_share: float
    """Mean share of time with the holding gate open [1]."""
    saving: float
    """Battery power [W]."""
    cot_reduction: float
    """Relative reduction of the cost of transport [1]."""
    power_reduction: float
    """Relative reduction of the power [1]."""
    saving_by_part: dict[str, float]
    """:func:`parts` of MR_Go less those of MR_Go-SAL [W]."""
    bound: dict[str, float]
    """Most that holding can save [W]: ``paper_standing`` and ``our_standing`` by :func:`consistency.holding_bound`, and
    ``walking_copper``, the calves' copper loss of MR_Go times the share of the stance that is held."""
    paper: dict[str, float] | None
    """``saving`` [W], ``cot_reduction`` and ``cot_reduction_sd`` [1] of table 6; None where it has no such row."""

    @property
    def cell(self) -> tuple[float, float]:
        """Payload [kg] and commanded speed [m/s]."""
        return self.payload, self.command

    @property
    def name(self) -> str:
        """Name of the condition."""
        return paper.condition_name(self.payload, self.command)


def savings(results: Sequence[WalkResult], cfg: ElectricalCfg, standing: float | None = None) -> list[Saving]:
    """Saving by SAL in each condition in which both robots arrived; without the paper's for another device.

    ``standing``: power that holding saves standing robots, as the paper's 39.8 W of section 6.5 [W].
    """
    arrived = {r.key: r for r in results if len(r.speed)}
    found = []
    for (robot, payload, command), on in arrived.items():
        off = arrived.get(("mr_go", payload, command))
        if robot != "mr_go_sal" or off is None:
            continue
        before, after = parts(off.joints, cfg), parts(on.joints, cfg)
        powers = [float(battery_power(r.joints, cfg).total.mean()) for r in (off, on)]
        cots = [float(cot(r, cfg).mean()) for r in (off, on)]
        share = float(on.hold.mean())
        stance = float(np.clip(share / STANCE_SHARE, 0.0, 1.0))
        bound = {"walking_copper": stance * before["copper_calves"]}
        if on.paper_device:
            bound["paper_standing"] = consistency.holding_bound(share, on.mass)
        if standing is not None:
            bound["our_standing"] = consistency.holding_bound(share, on.mass, standing=standing)
        saving = Saving(
            payload=payload,
            command=command,
            hold_share=share,
            saving=powers[0] - powers[1],
            cot_reduction=1.0 - cots[1] / cots[0],
            power_reduction=1.0 - powers[1] / powers[0],
            saving_by_part={name: before[name] - after[name] for name in before},
            bound=bound,
            paper=_paper_saving(payload, command) if on.paper_device else None,
        )
        found.append(saving)
    return found


def _paper_saving(payload: float, command: float) -> dict[str, float] | None:
    keys = [(robot, payload, command) for robot in ("mr_go", "mr_go_sal")]
    if not all(key in paper.TABLE_6 for key in keys):
        return None
    off, on = (paper.TABLE_6[key] for key in keys)
    reduction, sd = paper.cot_reduction(payload, command)
    return {"saving": off.power - on.power, "cot_reduction": reduction, "cot_reduction_sd": sd}


def sensitivity(
    results: Sequence[WalkResult], rows: Sequence[MeasuredPower], cfg: ElectricalCfg
) -> dict[str, list[dict[str, float]]]:
    """Reduction of COT per condition, with each assumed number at the ends of its range.

    The coil's resistance is the asset's; its loss is taken in proportion to the nominal one, for the paper's device,
    whose resistance is assumed. That of another device is stated or not known.
    """

    def reductions(results: Sequence[WalkResult], cfg: ElectricalCfg) -> dict[str, float]:
        return {saving.name: saving.cot_reduction for saving in savings(results, cfg)}

    found = model_numbers.sensitivity(rows, lambda varied: reductions(results, varied), cfg)
    if not all(r.paper_device for r in results):
        return found
    nominal = MrParams().coil.coil_resistance
    found["coil_resistance"] = []
    for value in COIL_RESISTANCES:
        scaled = [replace(r, joints=replace(r.joints, coil=r.joints.coil * value / nominal)) for r in results]
        found["coil_resistance"].append({"value": value, **reductions(scaled, cfg)})
    return found


def _difference(ours: np.ndarray, theirs: float, sd: float) -> dict[str, float]:
    """Ours minus the paper's: absolute, relative, and in units of the joint spread."""
    mine = spread(ours)
    joint = float(np.hypot(mine["sd"], sd))
    delta = mine["mean"] - theirs
    return {"absolute": delta, "relative": delta / theirs, "in_sd": delta / joint}


def mission_row(robot: str, trace: MissionTrace, *, calibrated: Collection[str] = MISSION_GROUPS) -> dict[str, Any]:
    """One robot's figures, with the paper's where its devices are the paper's, else with None.

    Figures of the ``calibrated`` groups, whose numbers come from Go1's figures, are marked; none where the task is not
    the paper's.
    """
    own = {name: robot == "go1" and name in calibrated for name in MISSION_GROUPS}
    theirs = paper.MISSION_POWER[robot] if trace.paper_device else {}
    mean, sd = paper.MISSION_DEPLETION[robot] if trace.paper_device else (None, None)
    rises = {**paper.MISSION_RISE[robot], "proximal": paper.proximal_rise(robot)} if trace.paper_device else {}
    return {
        "power": {name: {**spread(values), "paper": theirs.get(name), "calibrated": own["electrical"]}
                  for name, values in trace.power.items()},
        "seconds": {name: spread(values) for name, values in trace.seconds.items()},
        "depletion": {**spread(trace.depletion), "paper": mean, "paper_sd": sd, "calibrated": own["battery"]},
        "rise": {name: {**spread(values), "paper": rises.get(name),
                        "calibrated": own["thermal"] and name in ("calf_walking", "calf_standby")}
                 for name, values in trace.rise.items()},
    }  # fmt: skip


def mission_windows(phases: Mapping[str, Mapping[str, PhaseLoad]]) -> dict[str, Any]:
    """How many windows of each robot's walks began, fell or came too late, and how many count: those of both ways."""
    return {
        robot: {
            name: {"tried": phase.tried, "fell": phase.fell, "late": phase.late, "counted": len(phase.seconds)}
            for name, phase in found.items()
            if phase.trial is not None
        }
        for robot, found in phases.items()
    }


def mission_changes(rows: dict[str, Any]) -> dict[str, Any]:
    """Relative change from MR_Go to MR_Go-SAL, ours and the paper's; predictions.

    ``sd`` and ``paper_sd`` are those of the ratio of two independent figures; the latter is None where the paper states
    no spread. Another device than the paper's is not compared with the paper.
    """
    if not {"mr_go", "mr_go_sal"} <= set(rows):
        return {}
    picks = {
        "outbound_power": lambda row: row["power"]["outbound"], "return_power": lambda row: row["power"]["return"],
        "depletion": lambda row: row["depletion"], "calf_walking_rise": lambda row: row["rise"]["calf_walking"],
        "all_rise": lambda row: row["rise"]["all"],
    }  # fmt: skip
    found = {}
    for name, pick in picks.items():
        before, after = pick(rows["mr_go"]), pick(rows["mr_go_sal"])
        found[name] = {
            "ours": after["mean"] / before["mean"] - 1.0,
            "sd": ratio_sd((after["mean"], after["sd"]), (before["mean"], before["sd"])),
            "paper": None, "paper_sd": None, "calibrated": False,
        }  # fmt: skip
        if before["paper"] is not None:
            found[name]["paper"] = after["paper"] / before["paper"] - 1.0
            if "paper_sd" in after:
                theirs = ((row["paper"], row["paper_sd"]) for row in (after, before))
                found[name]["paper_sd"] = ratio_sd(*theirs)
    return found
