"""Where a policy's velocity error comes from: the plant is changed step by step from Go1 to MR_Go with SAL on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from mrwarp.env.cfg import EnvCfg, make_walk_cfg
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.study.paper_tables import CURRENT, Row, make_row
from mrwarp.study.plan import policy_file
from mrwarp.study.rollouts import EvaluationCfg, roll_out

STEPS = {
    "go1": "Go1",
    "mass": "MR_Go's masses, no devices",
    "drag": "with devices at 0 A: off-current drag (table 2 on this plant: SAL off)",
    "damping": f"SAL at {CURRENT:g} A, damping branch alone",
    "holding": f"SAL at {CURRENT:g} A, holding branch alone",
    "both": f"SAL at {CURRENT:g} A, both branches (table 2 on this plant: SAL on)",
}
"""Plants by name, in order, and what each is."""


def causes(
    cfg: EvaluationCfg, plants: Sequence[str], report: Callable[[float], None] | None = None
) -> dict[str, dict[str, Row]]:
    """Roll the policies of some trainings out on every plant, with the Bouc-Wen device.

    Args:
        cfg: Which policies, and how they are rolled out, on flat ground; its ``plant`` and ``terrain`` are not used.
        plants: Training plants.
        report: Called with the share that is done.

    Returns:
        Rows by training plant and step of :data:`STEPS`.

    Raises:
        PolicyError: a policy is missing or unreadable.
    """
    policies = [OnnxPolicy(policy_file(cfg.folder, plant, seed)) for plant in plants for seed in cfg.seeds]
    rows: dict[str, dict[str, Row]] = {plant: {} for plant in plants}
    for k, step in enumerate(STEPS):
        env, current = _plant(step, cfg.threads)
        found = roll_out(cfg, env, policies, [current] * len(policies))
        for i, plant in enumerate(plants):
            own = slice(i * len(cfg.seeds), (i + 1) * len(cfg.seeds))
            rows[plant][step] = make_row(plant, current, found, own)
        if report:
            report((k + 1) / len(STEPS))
    return rows


def _plant(step: str, threads: int) -> tuple[EnvCfg, float]:
    """The task on a plant, and the current its devices may use [A]."""
    if step == "go1":
        return make_walk_cfg(robot="go1", actuator_model="none", sal=False, threads=threads), 0.0
    if step == "mass":
        return make_walk_cfg(actuator_model="none", sal=False, threads=threads), 0.0
    env = make_walk_cfg(threads=threads)
    if step == "drag":
        return env, 0.0
    branches = replace(env.actuator, damping=step != "holding", holding=step != "damping")
    return replace(env, actuator=branches), CURRENT
