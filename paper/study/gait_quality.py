"""How well policies walk, by rules written before they were trained: attitude, left against right, foot slip."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import torch

from mrwarp.env.vec_env import WalkEnv
from mrwarp.resources import policy_file
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.runtime import text_table
from mrwarp.trials.gait_rules import Rules, broken
from mrwarp.usd.robot import CURRENT_GROUPS
from paper.study.plan import plant_cfg
from paper.study.rollouts import EvaluationCfg, roll_out

UNITS = {"tilt_rms": "deg", "roll": "deg", "pitch": "deg", "sides": "%", "slip": "m/s", "v_x_rmse": "m/s", "fell": ""}
"""Figures of a policy and their units."""


class FootMeter:
    """Mean speed of standing feet over the ground, and the calves' mean torques; after every policy step.

    Args:
        env: The environments, on the CPU.
    """

    def __init__(self, env: WalkEnv) -> None:
        self._env, self._scene = env, env.sim.scene
        self._data = mujoco.MjData(env.sim.scene.model)
        count, legs = env.num_envs, len(env.layout.legs)
        self._slip, self._steps = np.zeros(count), np.zeros(count)
        self._torque, self._attitude = np.zeros((count, legs)), np.zeros((count, 2))
        self._counted = np.zeros(count)
        self._standing = np.zeros((count, legs), dtype=bool)

    def add(self, counted: torch.Tensor) -> None:
        """Add the policy step that has just been simulated, of these environments; bool, shape (E,)."""
        env, on = self._env, counted.cpu().numpy()
        standing = (env.f_foot > env.contact_force).cpu().numpy()
        lasting = standing & self._standing & on[:, None]  # touch-down itself is no slip
        self._standing = standing
        for row in np.flatnonzero(lasting.any(axis=1)):
            speeds = self._sole_speeds(int(row))[lasting[row]]
            self._slip[row] += speeds.sum()
            self._steps[row] += len(speeds)
        torque = env.view(env.actuator.tau_motor)[:, list(self._scene.watched)].abs().cpu().numpy()
        gravity = env.gravity.cpu().numpy().astype(float)
        roll, pitch = np.arctan2(-gravity[:, 1], -gravity[:, 2]), np.arcsin(np.clip(gravity[:, 0], -1.0, 1.0))
        self._torque += np.where(on[:, None], torque, 0.0)
        self._attitude += np.where(on[:, None], np.degrees(np.stack([roll, pitch], axis=1)), 0.0)
        self._counted += on

    def _sole_speeds(self, row: int) -> np.ndarray:
        """Horizontal speed of the lowest point of each foot [m/s], shape (L,)."""
        env, scene, data = self._env, self._scene, self._data
        data.qpos[:3], data.qpos[3:7] = env.root_pos[row].cpu().numpy(), env.root_quat[row].cpu().numpy()
        data.qpos[scene.q_adr] = env.q[row].cpu().numpy()
        data.qvel[:] = env.qvel[row].cpu().numpy()
        mujoco.mj_kinematics(scene.model, data)
        mujoco.mj_comPos(scene.model, data)
        mujoco.mj_comVel(scene.model, data)
        found, velocity = np.zeros(len(scene.feet)), np.zeros(6)
        for k, (geom, radius) in enumerate(zip(scene.feet, scene.model.geom_size[scene.feet, 0], strict=True)):
            mujoco.mj_objectVelocity(scene.model, data, mujoco.mjtObj.mjOBJ_GEOM, geom, velocity, 0)
            sole = velocity[3:] + np.cross(velocity[:3], [0.0, 0.0, -radius])
            found[k] = np.hypot(sole[0], sole[1])
        return found

    def figures(self) -> dict[str, np.ndarray]:
        """``roll`` and ``pitch``, means [deg]; ``sides`` left against right [%]; ``slip`` [m/s]; each of shape (E,)."""
        roll, pitch = (self._attitude / np.maximum(self._counted, 1.0)[:, None]).T
        left = np.array([leg.name.endswith("L") for leg in self._env.layout.legs])
        of_left, of_right = (self._torque[:, side].mean(axis=1) for side in (left, ~left))
        sides = 200.0 * (of_left - of_right) / np.maximum(of_left + of_right, 1e-9)
        return {"roll": roll, "pitch": pitch, "sides": sides, "slip": self._slip / np.maximum(self._steps, 1.0)}


def evaluate(
    cfg: EvaluationCfg, plants: Sequence[str], report: Callable[[float], None] | None = None
) -> list[dict[str, Any]]:
    """Figures of :data:`UNITS` of each policy of some trainings, at full current, and the rules that it breaks.

    Args:
        cfg: Which policies, and how they are rolled out; every policy walks on the plant that it was trained on.
        plants: The trainings.
        report: Called with the share that is done.
    """
    rows = []
    for k, plant in enumerate(plants):
        policies = [OnnxPolicy(policy_file(cfg.folder, plant, seed)) for seed in cfg.seeds]
        env = plant_cfg(plant, threads=cfg.threads, coupling=cfg.coupling)
        found = roll_out(cfg, env, policies, [CURRENT_GROUPS[-1]] * len(policies), further=FootMeter)
        means = {name: values.mean(axis=1) for name, values in {**found.figures, "fell": found.fell}.items()}
        for place, seed in enumerate(cfg.seeds):
            figures = {name: float(means[name][place]) for name in UNITS}
            rows.append({"plant": plant, "seed": seed, **figures, "broken": broken(figures)})
        if report:
            report((k + 1) / len(plants))
    return rows


def lines(rows: Sequence[Mapping[str, Any]]) -> tuple[list[str], bool]:
    """Every policy as a line, the spread of each plant, and whether all rules are kept."""
    head = ("", "seed", *(f"{name} [{unit}]" if unit else name for name, unit in UNITS.items()), "breaks")
    cells = [
        (row["plant"], str(row["seed"]), *(f"{row[name]:.3g}" for name in UNITS), ", ".join(row["broken"]))
        for row in rows
    ]
    wide = [plant for plant in dict.fromkeys(row["plant"] for row in rows) if not spread_kept(_of(rows, plant))]
    kept = not wide and not any(row["broken"] for row in rows)
    counted = f"{sum(not row['broken'] for row in rows)} of {len(rows)} policies keep every rule"
    spread = f"v_x RMSE spreads by more than {Rules().spread:.0%} of its mean over the seeds of: {', '.join(wide)}"
    return [*text_table(head, cells, left=1), counted, *([spread] if wide else [])], kept


def _of(rows: Sequence[Mapping[str, Any]], plant: str) -> list[Mapping[str, Any]]:
    return [row for row in rows if row["plant"] == plant]


def spread_kept(rows: Sequence[Mapping[str, Any]], rules: Rules | None = None) -> bool:
    """Whether the v_x RMSE of a plant's policies spreads little enough over its seeds."""
    errors = np.array([row["v_x_rmse"] for row in rows])
    return len(errors) < 2 or float(errors.std(ddof=1)) <= (rules or Rules()).spread * float(errors.mean())
