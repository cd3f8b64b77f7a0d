"""Motors of a MuJoCo model's joints: their torque and their rotors, of all actuators of a joint together."""

from __future__ import annotations

import math

import mujoco
import numpy as np


def motors_of(model: mujoco.MjModel, joint: int) -> list[int]:
    """Actuators of a joint."""
    kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    own = np.isin(model.actuator_trntype, kinds) & (model.actuator_trnid[:, 0] == joint)
    return np.flatnonzero(own).tolist()


def force_range(model: mujoco.MjModel, actuator: int) -> tuple[float, float]:
    """Least and largest force of an actuator before its gear [N·m]; infinite without a limit."""
    gain, found = model.actuator_gainprm[actuator], (-math.inf, math.inf)
    direct = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_DCMOTOR
    servo = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
    if model.actuator_ctrllimited[actuator] and (direct or not servo):
        force = gain[1] / gain[0] if direct else gain[0]
        ends = sorted(float(force * end) for end in model.actuator_ctrlrange[actuator])
        found = ends[0], ends[1]
    if model.actuator_forcelimited[actuator]:
        low, high = (float(end) for end in model.actuator_forcerange[actuator])
        found = max(found[0], low), min(found[1], high)
    return found


def torque_range(model: mujoco.MjModel, joint: int) -> tuple[float, float]:
    """Least and largest torque of a joint's motors [N·m]; infinite without a limit."""
    own = motors_of(model, joint)
    low, high = (0.0, 0.0) if own else (-math.inf, math.inf)
    for k in own:
        gear = float(model.actuator_gear[k, 0])
        ends = sorted(gear * end for end in force_range(model, k)) if gear else (0.0, 0.0)
        low, high = low + ends[0], high + ends[1]
    if model.jnt_actfrclimited[joint]:
        low, high = max(low, float(model.jnt_actfrcrange[joint, 0])), min(high, float(model.jnt_actfrcrange[joint, 1]))
    return low, high


def rotor(model: mujoco.MjModel, joint: int) -> float:
    """Inertia of the rotors of a joint's motors at the joint [kg·m²], without the joint's own armature."""
    own = motors_of(model, joint)
    return float(sum(model.actuator_armature[k] * model.actuator_gear[k, 0] ** 2 for k in own))
