"""What the simulator must show of its physics: measured, judged and drawn. The command is ``mrwarp verify``.

Four questions, one file each: is the brake passive (``physics_passivity``), does it hold (``physics_holding``), is 5 ms
accurate (``physics_accuracy``), do the engines agree and repeat (``physics_engines``). The limits stand in
``physics_checks``; the tests assert the same figures.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mrwarp.evaluate import physics_checks as checks
from mrwarp.evaluate import physics_pictures as pictures
from mrwarp.evaluate.physics_accuracy import accuracy
from mrwarp.evaluate.physics_engines import agreement, bit_figures
from mrwarp.evaluate.physics_holding import hold_runs, holding_figures, line_search_trap, stand_runs
from mrwarp.evaluate.physics_passivity import passivity, passivity_figures
from mrwarp.evaluate.walking import Policy

__all__ = ["run_all"]


def run_all(out: Path, *, seed: int, policy: Policy | None, progress: Callable[[str], None]) -> dict[str, Any]:
    """Run every check and write its picture.

    Args:
        out: Folder of the pictures; made if missing.
        seed: Seed of all random draws.
        policy: What walks in the passivity check; None stands under random joint targets.
        progress: Called with one line before each part.

    Returns:
        ``checks``: one row per limit with ``name``, ``value``, ``limit`` (text), ``unit``, ``holds``; ``passed``: all
        hold; plain figures by part (``passivity``, ``holding``, ``accuracy``, ``engines``, ``bits``); ``pictures``.
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

    rows = [
        *checks.passivity_checks(runs),
        *checks.holding_checks(holds, stands, trap),
        *checks.accuracy_checks(result),
        *checks.engine_checks(cases, bits),
    ]
    return {
        "checks": rows,
        "passed": all(row["holds"] for row in rows),
        "passivity": passivity_figures(runs),
        "holding": holding_figures(holds, stands, trap),
        "accuracy": result.figures(),
        "engines": {case.name: case.figures() for case in cases},
        "bits": bits,
        "pictures": [f"{part}.png" for part in ("passivity", "holding", "accuracy", "engines")],
    }
