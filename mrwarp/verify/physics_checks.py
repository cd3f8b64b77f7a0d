"""The limits of the physics checks, one row each: what was measured, what is allowed, and whether it holds."""

from __future__ import annotations

from typing import Any

import numpy as np

from mrwarp.actuator import brake_constraint
from mrwarp.actuator.mr_actuator import Coupling
from mrwarp.verify.accuracy import Accuracy
from mrwarp.verify.energy_ledger import LedgerRun
from mrwarp.verify.engines import Agreement
from mrwarp.verify.held_joint import (
    BREAKAWAY_LIMITS,
    CREEP_LIMITS,
    DT,
    LOADS,
    HoldRun,
    StandRun,
    drift_tolerance,
    expected_drift,
)
from mrwarp.verify.hysteresis import Hysteresis
from mrwarp.verify.order import Order
from mrwarp.verify.passivity import ROUNDING, PassivityRun
from mrwarp.verify.states import StateAgreement

UNSOLVED_SHARE = 0.005
"""Largest share of steps that may end unsolved in a run with impacts and moving joints."""

ORDER = (0.8, 1.2)
"""Order of convergence of the constraint coupling: first, as semi-implicit Euler; stick events scatter it."""

LEDGER_GAP = 1e-5
"""Largest part of the turned-over energy that no source explains; the ledger is summed in float32."""

HYSTERESIS_ORDER = {"euler": (0.9, 1.1), "exact": (0.95, 1.05), "exact, interpolated": (1.9, 2.1)}
"""Order of the replayed torque: first with the newest velocity held, second with it interpolated."""

Row = dict[str, Any]
"""One check: ``name``, ``value``, ``limit`` (text), ``unit``, ``holds``."""


def passivity_checks(runs: list[PassivityRun]) -> list[Row]:
    """No step of a constraint run does positive work, and nearly all steps are solved."""
    rows = []
    for run in runs:
        if run.coupling is Coupling.CONSTRAINT:
            name = f"{run.name} ({run.backend.value})"
            work = run.figures["largest_step_work"]
            rows.append(_row(f"{name}: largest work of a step", work, high=ROUNDING[run.backend], unit="J"))
            share = run.figures["unsolved_share"]
            rows.append(_row(f"{name}: unsolved steps", share, high=UNSOLVED_SHARE, unit="share"))
    return rows


def holding_checks(holds: list[HoldRun], stands: list[StandRun], trap: list[StandRun]) -> list[Row]:
    """Creep, break-away, the robot on its brakes, and a counter that tells a starved solver."""
    rows = []
    for run in holds:
        if run.brake:
            name = f"{run.name} ({run.backend.value})"
            for load, creep, limit in zip(LOADS, run.creep, CREEP_LIMITS, strict=True):
                rows.append(_row(f"{name}: creep at {load:.0%} of tau_y", abs(creep), high=limit, unit="rad/s"))
            low, high = BREAKAWAY_LIMITS
            rows.append(_row(f"{name}: break-away", run.breakaway, low=low, high=high, unit="tau_y"))
    for run in stands:
        name = f"robot on its brakes ({run.backend.value}{', stiff feet' if run.stiff_feet else ''})"
        drift = float(np.abs(run.calf[-1] - run.calf[0]).max())
        limit = float((expected_drift(run) + drift_tolerance(run)).max())
        rows.append(_row(f"{name}: calf drift in {len(run.calf) * DT:g} s", drift, high=limit, unit="rad"))
    for run in trap:
        enough = run.ls_iterations >= brake_constraint.MIN_LS_ITERATIONS
        limit = {"high": 0.0} if enough else {"low": 1.0}
        rows.append(_row(f"{run.ls_iterations} line-search iterations: counted", run.unsolved, unit="steps", **limit))
    return rows


def accuracy_checks(result: Accuracy) -> list[Row]:
    """At 5 ms the constraint is closer to the reference than explicit torques, and converges in first order."""
    rows = []
    for i, name in enumerate(("angle", "velocity")):
        constraint, explicit = (result.rms[c]["0.005"][i] for c in ("constraint", "explicit"))
        rows.append(_row(f"5 ms {name} error, constraint/explicit", constraint / explicit, high=1.0, unit="ratio"))
        order = result.order(Coupling.CONSTRAINT)[i]
        rows.append(_row(f"order of the {name} error, constraint", order, low=ORDER[0], high=ORDER[1], unit=""))
    return rows


def engine_checks(cases: list[Agreement], bits: dict[str, Any]) -> list[Row]:
    """Float32 against float64, and sameness of bits."""
    rows = []
    for case in cases:
        for step, when in ((0, "1 step"), (-1, "100 ms")):
            for i, (name, unit) in enumerate((("q", "m, rad"), ("qd", "m/s, rad/s"))):
                difference, limit = float(case.difference[step, i]), float(case.tolerance[step, i])
                rows.append(_row(f"engines {case.name}: {name} after {when}", difference, high=limit, unit=unit))
    changed = [count for count, same in bits["captured_equals_eager"].items() if not same]
    rows.append(_row("captured steps (1, 2, 3, 5) unlike eager", len(changed), high=0.0, unit="of 4"))
    for engine, difference in bits["alone_minus_batch"].items():
        rows.append(_row(f"environment alone minus in a batch ({engine})", difference, high=0.0, unit="any"))
    threads = 0.0 if bits["same_at_1_and_2_threads"] else 1.0
    rows.append(_row("1 and 2 threads differ", threads, high=0.0, unit="yes/no"))
    return rows


def ledger_checks(runs: list[LedgerRun]) -> list[Row]:
    """Motor, device, contact, limits, gravity and the step itself explain the change of kinetic energy."""
    rows = []
    for run in runs:
        gap = run.figures()["largest_gap_share"]
        rows.append(_row(f"energy, {run.name}: unexplained part of the turnover", gap, high=LEDGER_GAP, unit="share"))
    return rows


def order_checks(results: list[Order]) -> list[Row]:
    """The robot's motion converges in first order."""
    rows = []
    for result in results:
        for order, quantity in zip(result.order, ("positions", "velocities"), strict=True):
            name = f"order of the robot's {quantity}, {result.name}"
            rows.append(_row(name, float(order), low=ORDER[0], high=ORDER[1], unit=""))
    return rows


def state_checks(groups: list[StateAgreement]) -> list[Row]:
    """One step of both engines from random states differs by no more than rounding."""
    rows = []
    for group in groups:
        name = f"engines at {len(group.steep)} random states {group.name}: velocity difference"
        rows.append(_row(name, group.share, high=1.0, unit="of rounding"))
    return rows


def hysteresis_checks(result: Hysteresis) -> list[Row]:
    """The replayed torque converges to eqs. 14 and 15 in the order of its step."""
    rows = []
    for method, (low, high) in HYSTERESIS_ORDER.items():
        order = result.order(method)
        rows.append(_row(f"order of the hysteretic torque, {method}", order, low=low, high=high, unit=""))
    return rows


def _row(name: str, value: float, *, low: float | None = None, high: float | None = None, unit: str) -> Row:
    above, below = low is None or value >= low, high is None or value <= high
    if low is None:
        limit = f"<= {high:.3g}"
    elif high is None:
        limit = f">= {low:.3g}"
    else:
        limit = f"{low:.3g} to {high:.3g}"
    # a run that blew up fails every comparison; JSON and the table hold finite numbers only
    return {
        "name": name,
        "value": float(np.nan_to_num(value, nan=np.finfo(float).max)),
        "limit": limit,
        "unit": unit,
        "holds": bool(above and below),
    }
