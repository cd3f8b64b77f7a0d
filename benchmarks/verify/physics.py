"""Checks of the simulator's physics: measured, judged by limits, and drawn. The command is ``mrwarp verify``.

One question per file: is the brake passive (``passivity``), does it hold (``held_joint``), is 5 ms accurate
(``accuracy``; of the hysteresis alone: ``hysteresis``), does the robot's motion converge (``order``), is all energy
accounted for (``energy_ledger``), do the engines agree and repeat (``engines``).
``tests/benchmarks/verify`` measures by the same functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.verify import physics_pictures as pictures
from benchmarks.verify.accuracy import Accuracy, accuracy
from benchmarks.verify.energy_ledger import LedgerRun, ledger_runs
from benchmarks.verify.engines import Agreement, StateAgreement, agreement, bit_figures, state_agreement
from benchmarks.verify.held_joint import (
    BREAKAWAY_LIMITS,
    CREEP_LIMITS,
    DT,
    LOADS,
    HoldRun,
    StandRun,
    hold_runs,
    holding_figures,
    line_search_trap,
    stand_runs,
)
from benchmarks.verify.hysteresis import Hysteresis, hysteresis
from benchmarks.verify.order import Order, orders
from benchmarks.verify.passivity import ROUNDING, PassivityRun, passivity, passivity_figures
from mrwarp.actuator import brake_constraint
from mrwarp.enums import Coupling
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy
from mrwarp.trials.walking import Policy

UNSOLVED_SHARE = 0.005
"""Largest share of steps that may end unsolved in a run with impacts and moving joints."""

ORDER = (0.8, 1.2)
"""Order of convergence of the constraint coupling: first, as semi-implicit Euler; stick events scatter it."""

LEDGER_GAP = 1e-5
"""Largest part of the turned-over energy that no source explains; the ledger is summed in float32."""

HYSTERESIS_ORDER = {"euler": (0.9, 1.1), "exact": (0.95, 1.05), "exact, interpolated": (1.9, 2.1)}
"""Order of the replayed torque: first with the newest velocity held, second with it interpolated."""

Check = dict[str, Any]
"""One limit: ``name``, ``value``, ``limit`` (text), ``unit``, ``holds``."""


def run_all(out: Path, *, seed: int, policy: Policy | None, progress: Callable[[str], None]) -> dict[str, Any]:
    """Run every check and write its picture.

    Args:
        out: Folder of the pictures; made if missing.
        seed: Seed of all random draws.
        policy: What walks; None stands under random joint targets where passivity is checked, and the shipped policy
            walks where energy is booked.
        progress: Called with one line before each part.

    Returns:
        ``checks``: one :data:`Check` per limit; ``passed``: all hold; plain figures by part (``passivity``,
        ``holding``, ``accuracy``, ``hysteresis``, ``order``, ``ledger``, ``engines``, ``states``, ``bits``);
        ``pictures``: names of the files.
    """
    out.mkdir(parents=True, exist_ok=True)
    progress("passivity: falling link, drop, walking; both couplings")
    runs = passivity(seed=seed, policy=policy)
    pictures.passivity_picture(runs, out / "passivity.png")

    progress("holding: creep, break-away, standing on brakes, line search")
    holds, stands, trap = hold_runs(), stand_runs(), line_search_trap()
    pictures.holding_picture(holds, stands, trap, out / "holding.png")

    progress("accuracy: 5 ms against a 50 µs reference")
    result = accuracy(seed=seed)
    pictures.accuracy_picture(result, out / "accuracy.png")

    progress("engines: float32 against float64, captured against eager, batch against alone, threads")
    cases, bits = agreement(seed=seed), bit_figures(seed=seed)
    pictures.engines_picture(cases, out / "engines.png")

    progress("engines at 1,000 random states; order of the robot's motion; hysteresis against the closed form")
    states, order, replayed = state_agreement(seed=seed), orders(seed=seed), hysteresis(seed=seed)

    progress("energy: free fall, standing, drop, walking")
    booked = ledger_runs(policy or OnnxPolicy(DEFAULT_POLICY), seed=seed)

    checks = [
        *passivity_checks(runs),
        *holding_checks(holds, stands, trap),
        *accuracy_checks(result),
        *hysteresis_checks(replayed),
        *order_checks(order),
        *ledger_checks(booked),
        *engine_checks(cases, bits),
        *state_checks(states),
    ]
    return {
        "checks": checks,
        "passed": all(check["holds"] for check in checks),
        "passivity": passivity_figures(runs),
        "holding": holding_figures(holds, stands, trap),
        "accuracy": result.figures(),
        "hysteresis": replayed.figures(),
        "order": {case.name: case.figures() for case in order},
        "ledger": {run.name: run.figures() for run in booked},
        "engines": {case.name: case.figures() for case in cases},
        "states": {group.name: group.figures() for group in states},
        "bits": bits,
        "pictures": [f"{part}.png" for part in ("passivity", "holding", "accuracy", "engines")],
    }


def passivity_checks(runs: list[PassivityRun]) -> Iterator[Check]:
    """No step of a constraint run does positive work, and nearly all steps are solved."""
    for run in runs:
        if run.coupling is Coupling.CONSTRAINT:
            name, found = f"{run.name} ({run.backend.value})", run.figures
            yield check(f"{name}: largest work of a step", found["largest_step_work"], "J", high=ROUNDING[run.backend])
            yield check(f"{name}: unsolved steps", found["unsolved_share"], "share", high=UNSOLVED_SHARE)


def holding_checks(holds: list[HoldRun], stands: list[StandRun], trap: list[StandRun]) -> Iterator[Check]:
    """Creep, break-away, the robot on its brakes, and a counter that reveals a starved solver."""
    for run in holds:
        if run.brake:
            name = f"{run.name} ({run.backend.value})"
            for load, creep, limit in zip(LOADS, run.creep, CREEP_LIMITS, strict=True):
                yield check(f"{name}: creep at {load:.0%} of tau_y", abs(creep), "rad/s", high=limit)
            low, high = BREAKAWAY_LIMITS
            yield check(f"{name}: break-away", run.breakaway, "tau_y", low=low, high=high)
    for run in stands:
        name = f"robot on its brakes ({run.backend.value}{', stiff feet' if run.stiff_feet else ''})"
        drift = float(np.abs(run.calf[-1] - run.calf[0]).max())
        limit = float((run.expected_drift + run.drift_tolerance).max())
        yield check(f"{name}: calf drift in {len(run.calf) * DT:g} s", drift, "rad", high=limit)
    for run in trap:
        enough = run.ls_iterations >= brake_constraint.MIN_LS_ITERATIONS
        limits = {"high": 0.0} if enough else {"low": 1.0}
        yield check(f"{run.ls_iterations} line-search iterations: counted", run.unsolved, "steps", **limits)


def accuracy_checks(result: Accuracy) -> Iterator[Check]:
    """At 5 ms the constraint is closer to the reference than explicit torques, and converges in first order."""
    for i, name in enumerate(("angle", "velocity")):
        constraint, explicit = (result.rms[c]["0.005"][i] for c in ("constraint", "explicit"))
        yield check(f"5 ms {name} error, constraint/explicit", constraint / explicit, "ratio", high=1.0)
        order = result.order(Coupling.CONSTRAINT)[i]
        yield check(f"order of the {name} error, constraint", order, low=ORDER[0], high=ORDER[1])


def hysteresis_checks(result: Hysteresis) -> Iterator[Check]:
    """The replayed torque converges to eqs. 14 and 15 in the order of its step."""
    for method, (low, high) in HYSTERESIS_ORDER.items():
        yield check(f"order of the hysteretic torque, {method}", result.order(method), low=low, high=high)


def order_checks(results: list[Order]) -> Iterator[Check]:
    """The robot's motion converges in first order."""
    for result in results:
        for order, quantity in zip(result.order, ("positions", "velocities"), strict=True):
            name = f"order of the robot's {quantity}, {result.name}"
            yield check(name, float(order), low=ORDER[0], high=ORDER[1])


def ledger_checks(runs: list[LedgerRun]) -> Iterator[Check]:
    """Motor, device, contact, limits, gravity and the step itself explain the change of kinetic energy."""
    for run in runs:
        gap = run.figures()["largest_gap_share"]
        yield check(f"energy, {run.name}: unexplained part of the turnover", gap, "share", high=LEDGER_GAP)


def engine_checks(cases: list[Agreement], bits: dict[str, Any]) -> Iterator[Check]:
    """The engines differ by no more than float32 allows, and runs repeat to the bit."""
    for case in cases:
        for step, when in ((0, "1 step"), (-1, "100 ms")):
            for i, (name, unit) in enumerate((("q", "m, rad"), ("qd", "m/s, rad/s"))):
                difference, limit = float(case.difference[step, i]), float(case.tolerance[step, i])
                yield check(f"engines {case.name}: {name} after {when}", difference, unit, high=limit)
    changed = [count for count, same in bits["captured_equals_eager"].items() if not same]
    yield check("captured steps (1, 2, 3, 5) unlike eager", len(changed), "of 4", high=0.0)
    for engine, difference in bits["alone_minus_batch"].items():
        yield check(f"environment alone minus in a batch ({engine})", difference, "any", high=0.0)
    threads = 0.0 if bits["same_at_1_and_2_threads"] else 1.0
    yield check("1 and 2 threads differ", threads, "yes/no", high=0.0)


def state_checks(groups: list[StateAgreement]) -> Iterator[Check]:
    """One step of both engines from random states differs by no more than rounding."""
    for group in groups:
        name = f"engines at {len(group.steep)} random states {group.name}: velocity difference"
        yield check(name, group.share, "of rounding", high=1.0)


def check(name: str, value: float, unit: str = "", *, low: float | None = None, high: float | None = None) -> Check:
    """Judge a value by closed limits, at least one of them; NaN holds none and is written as the largest float."""
    holds = (low is None or value >= low) and (high is None or value <= high)
    if low is None:
        limit = f"<= {high:.3g}"
    else:
        limit = f">= {low:.3g}" if high is None else f"{low:.3g} to {high:.3g}"
    finite = float(np.nan_to_num(value, nan=np.finfo(float).max))
    return {"name": name, "value": finite, "limit": limit, "unit": unit, "holds": bool(holds)}
