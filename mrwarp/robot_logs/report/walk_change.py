"""Effect of a verdict on a policy: the same walks on the robot as it is described and on the extended one."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.energy.power import ElectricalCfg
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.natural_units import scales_of
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.rl.policy_file import check_robot
from mrwarp.robot_logs.extended_robot import write_extended
from mrwarp.robot_logs.robot_log import LogError
from mrwarp.robot_logs.robot_verdict import RobotDiagnosis
from mrwarp.trials.own_robot import walk_currents
from mrwarp.usd.asset import ROBOT_SUFFIXES, load_robot

SPEEDS, DISTANCE = (0.3, 0.5), 4.0
"""Commands [m/s] and distance [m] of a robot of Go1's size; those of another go with its own."""

HEAD = ("speed", "falls", "too slow", "speed's RMSE", "power", "cost of transport")


@dataclass(frozen=True, kw_only=True)
class WalkChange:
    """Walks of one policy on both robots."""

    policy: str
    trials: int
    described: Sequence[Mapping[str, Any]]
    """Per command: ``command`` [m/s], ``fell`` and ``late`` of the trials, and means over those that arrived:
    ``v_x_rmse`` [m/s], ``power`` [W], ``cot`` [1]; None where none arrived."""
    extended: Sequence[Mapping[str, Any]]

    def rows(self) -> list[tuple[str, ...]]:
        """Figures of :data:`HEAD`, described and extended, a row per command."""
        return [
            (
                f"{old['command']:g} m/s",
                *(f"{old[name]} → {new[name]} of {self.trials}" for name in ("fell", "late")),
                *(f"{_shown(old[name])} → {_shown(new[name])}{unit}" for name, unit in _MEANS.items()),
            )
            for old, new in zip(self.described, self.extended, strict=True)
        ]


_MEANS = {"v_x_rmse": " m/s", "power": " W", "cot": ""}


def check_walker(policy: Path, robot: Path, base: str) -> None:
    """Refuse before a diagnosis what could not walk after it.

    Raises:
        PolicyError: the policy's file cannot be used, or not with this robot.
        LogError: the log's robot does not walk.
    """
    if base != "free":
        raise LogError(f"--policy {policy}: the robot of this log hangs or stands fixed; leave --policy out")
    OnnxPolicy(policy)
    if robot.suffix in ROBOT_SUFFIXES or not robot.suffix:
        check_robot(policy, str(robot) if robot.suffix else robot.name)


def walk_change(
    d: RobotDiagnosis, policy: Path, *, trials: int = 8, seed: int = 0, progress: Callable[[str], None]
) -> WalkChange | None:
    """Walk with both robots from the same poses and gait phases; None: their files cannot walk.

    Both have the dry friction and damping of the replay. Devices may use all their current.

    Raises:
        PolicyError: the policy is of a robot with other joints.
    """
    found, walker = [], OnnxPolicy(policy)
    with tempfile.TemporaryDirectory() as folder:
        for name, theta in (("described", np.zeros_like(d.theta)), ("extended", d.theta)):
            out = Path(folder, name)
            out.mkdir()
            if "robot.usda" not in write_extended(replace(d, theta=theta), out)[0]:
                return None
            robot = str(out / "robot.usda")
            check_robot(policy, robot)
            by = scales_of(robot)
            currents = [a.mr.coil.current_max for a in load_robot(robot=robot).actuators if a.mr is not None]
            progress(f"walking on the {name} robot")
            rows = walk_currents(
                TaskCfg(robot=robot),
                walker,
                trials=trials,
                distance=DISTANCE * by.length,
                seed=seed,
                currents=[min(currents, default=0.0)],
                speeds=[round(v * by.speed, 3) for v in SPEEDS],
                payload=0.0,
                cfg=ElectricalCfg(),
            )
            found.append(
                [
                    {n: row[n] for n in ("command", "fell", "late")}
                    | {n: row[n]["mean"] if row["trials"] else None for n in _MEANS}
                    for row in rows
                ]
            )
    return WalkChange(policy=str(policy), trials=trials, described=found[0], extended=found[1])


def _shown(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"
