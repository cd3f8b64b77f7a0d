"""mjlab's own walking tasks of a Go1 with MR devices at the calves, by their entry point ``mjlab.tasks``.

Motor and device of a calf are the paper's, gates included. All else is mjlab's: robot, rewards, events, PPO.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

# pyright: reportMissingImports=false
import torch
from mjlab.managers.event_manager import EventTermCfg
from mjlab.tasks.registry import register_mjlab_task
from mjlab.tasks.velocity.config.go1.env_cfgs import unitree_go1_flat_env_cfg, unitree_go1_rough_env_cfg
from mjlab.tasks.velocity.config.go1.rl_cfg import unitree_go1_ppo_runner_cfg
from mjlab.tasks.velocity.rl import VelocityOnPolicyRunner

from mrwarp.integrations.mjlab.joint_actuator import MrJointActuatorCfg, brakes, mr_actuators
from mrwarp.params import MrParams

CURRENT = 1.0
"""Coil current while a gate is open [A], the middle of the paper's three (0.5, 1 and 1.5 A)."""

FEET = "feet_ground_contact"
"""mjlab's sensor of the feet."""


def foot_loads(env: Any, env_ids: torch.Tensor | None, sensor_name: str) -> None:
    """Give the gates the force [N] at the foot of each joint's leg: names of both begin with the leg's (FR, FL, ...).

    An event of every environment step; ``env_ids`` does not matter.
    """
    sensor = env.scene[sensor_name]
    load = torch.linalg.vector_norm(sensor.data.force, dim=-1)
    column = {name.rpartition("/")[2].partition("_")[0]: k for k, name in enumerate(sensor.primary_names)}
    for actuator in mr_actuators(env):
        actuator.foot_load[:] = load[:, [column[name.partition("_")[0]] for name in actuator.target_names]]


def with_mr_calves(cfg: Any, current: float = CURRENT) -> Any:
    """A task of mjlab's Go1, changed in place: calves with motor and device of the paper.

    Args:
        cfg: ``ManagerBasedRlEnvCfg`` with a Go1 named ``robot`` and the sensor :data:`FEET`.
        current: Coil current while a gate is open [A].
    """
    robot, motor, neutral = cfg.scene.entities["robot"], MrParams().motor, MrParams().bouc_wen.q_neutral
    (knees,) = (a for a in robot.articulation.actuators if ".*_calf_joint" in a.target_names_expr)
    calves = MrJointActuatorCfg(
        target_names_expr=knees.target_names_expr,
        armature=knees.armature,
        stiffness=motor.kp_base,
        damping=motor.kd,
        effort_limit=motor.tau_limit,
        current=current,
        parameters={"q_neutral": neutral},  # where the paper's calves stand
        gated=True,
    )
    others = tuple(a for a in robot.articulation.actuators if a is not knees)
    robot.articulation = replace(robot.articulation, actuators=(*others, calves))
    cfg.events["mr_brakes"] = EventTermCfg(func=brakes, mode="startup")
    cfg.events["mr_foot_loads"] = EventTermCfg(func=foot_loads, mode="step", params={"sensor_name": FEET})
    return cfg


for _ground, _make in (("Flat", unitree_go1_flat_env_cfg), ("Rough", unitree_go1_rough_env_cfg)):
    register_mjlab_task(
        task_id=f"Mrwarp-Velocity-{_ground}-MR-Go1",
        env_cfg=with_mr_calves(_make()),
        play_env_cfg=with_mr_calves(_make(play=True)),
        rl_cfg=replace(unitree_go1_ppo_runner_cfg(), experiment_name="mr_go1_velocity"),
        runner_cls=VelocityOnPolicyRunner,
    )
