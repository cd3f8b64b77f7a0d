"""What the simulator must show of its physics: measured, judged and drawn. The command is ``mrwarp verify``.

One question per file: is the brake passive (``physics_passivity``), does it hold (``physics_holding``), is 5 ms
accurate (``physics_accuracy``; of the hysteresis alone: ``physics_hysteresis``), does the robot's motion converge
(``physics_order``), is all energy accounted for (``physics_ledger``), do the engines agree and repeat
(``physics_engines``; at random states: ``physics_states``). The limits stand in ``physics_checks``; the tests assert
the same figures.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mrwarp.trials.walking import Policy
from mrwarp.verify import physics_checks as checks
from mrwarp.verify import physics_pictures as pictures
from mrwarp.verify.accuracy import accuracy
from mrwarp.verify.energy_ledger import ledger_runs
from mrwarp.verify.engines import agreement, bit_figures
from mrwarp.verify.held_joint import hold_runs, holding_figures, line_search_trap, stand_runs
from mrwarp.verify.hysteresis import hysteresis
from mrwarp.verify.order import orders
from mrwarp.verify.passivity import passivity, passivity_figures
from mrwarp.verify.states import state_agreement

__all__ = ["run_all"]


def run_all(out: Path, *, seed: int, policy: Policy | None, progress: Callable[[str], None]) -> dict[str, Any]:
    """Run every check and write its picture.

    Args:
        out: Folder of the pictures; made if missing.
        seed: Seed of all random draws.
        policy: What walks; None stands under random joint targets where passivity is checked, and the shipped policy
            walks where energy is booked.
        progress: Called with one line before each part.

    Returns:
        ``checks``: one row per limit with ``name``, ``value``, ``limit`` (text), ``unit``, ``holds``; ``passed``: all
        hold; plain figures by part (``passivity``, ``holding``, ``accuracy``, ``hysteresis``, ``order``, ``ledger``,
        ``engines``, ``states``, ``bits``); ``pictures``.
    """
    from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy

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

    rows = [
        *checks.passivity_checks(runs),
        *checks.holding_checks(holds, stands, trap),
        *checks.accuracy_checks(result),
        *checks.hysteresis_checks(replayed),
        *checks.order_checks(order),
        *checks.ledger_checks(booked),
        *checks.engine_checks(cases, bits),
        *checks.state_checks(states),
    ]
    return {
        "checks": rows,
        "passed": all(row["holds"] for row in rows),
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
