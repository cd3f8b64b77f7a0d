"""The Go1-like quadruped: names, order, default pose and gait of everything that is indexed by joint or leg.

Geometry, masses, limits and gains live in ``assets/usd/mr_go.usda``; this file holds what Python needs to know about
their order and the neutral stance. Angle signs follow the public Go1 description (unitree_go1 of MuJoCo Menagerie).
"""

from __future__ import annotations

LEGS = ("FL", "FR", "RL", "RR")
"""Leg order of every array with a leg axis."""

SEGMENTS = ("hip", "thigh", "calf")
"""Joint order within a leg."""

JOINTS = tuple(f"{leg}_{segment}" for leg in LEGS for segment in SEGMENTS)
"""Joint order of every array with a joint axis: FL hip, thigh, calf, FR hip, ..."""

CALVES = tuple(f"{leg}_calf" for leg in LEGS)
"""The joints that carry an MR device on ``mr_go``."""

CALF_COLUMNS = tuple(JOINTS.index(calf) for calf in CALVES)
"""Columns of the calves on the joint axis."""

DEFAULT_POSE = {"hip": 0.0, "thigh": 0.8, "calf": -1.5}
"""Neutral stance angles [rad]. Go1 practice (thigh 0.8, calf -1.5); puts the trunk 0.334 m above flat ground."""

DEFAULT_Q = tuple(DEFAULT_POSE[segment] for _ in LEGS for segment in SEGMENTS)
"""Neutral stance angles in the order of :data:`JOINTS` [rad]."""

STAND_HEIGHT = 0.334
"""Trunk height of the shipped robot in the neutral stance [m]: 0.213 (cos 0.8 + cos 0.7) + foot radius 0.023.

Another robot's follows from its links, see ``Scene.stand_height``."""

GAIT_FREQUENCY = 1.5
"""Stride frequency [Hz], paper section 5.1."""

TROT_PHASE = (0.0, 0.5, 0.5, 0.0)
"""Phase offset of each leg in a diagonal trot (FL with RR, FR with RL), in the order of :data:`LEGS`."""

PUBLIC_GAINS = (20.0, 0.5)
"""Kp [N·m/rad] and Kd [N·m·s/rad] of public policies for such robots trained in Isaac Gym: walk-these-ways (Go1),
legged_gym (A1). The asset's are stiffer, see ``assets/usd``."""

CURRENT_GROUPS = (0.0, 0.5, 1.0, 1.5)
"""Fixed currents I_e over the environments [A], eq. 20."""


def leg_of(joint: str) -> int:
    """Index into :data:`LEGS` of the leg that a joint belongs to."""
    return LEGS.index(joint.split("_")[0])
