"""A robot as legged tasks see it: its trunk, legs, joints in their order, neutral stance and gait.

A :class:`Layout` says it of any robot; one stands in the USD file (:mod:`mrwarp.usd.robot_layout`). The constants are
those of the shipped one, whose geometry, masses, limits and gains live in ``assets/usd/mr_go.usda``. Angle signs follow
the public Go1 description (unitree_go1 of MuJoCo Menagerie).
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property


@dataclass(frozen=True, kw_only=True)
class Leg:
    """A leg, from the trunk to the ground."""

    name: str
    joints: tuple[str, ...]
    """Its joints, from the trunk to the foot."""
    foot: str
    """Name of the collision shape that touches the ground, a sphere."""
    phase: float
    """Offset on the gait clock, 0 to 1: the leg stands in the first half of its own cycle."""
    sole: bool = False
    """Whether all shapes of the foot's body bear its load, as a biped's sole; else the sphere alone."""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Trunk, legs and driven joints of a robot."""

    trunk: str
    """Name of the body that floats."""
    legs: tuple[Leg, ...]
    """In the order of every array with a leg axis."""
    neutral: dict[str, float]
    """Neutral stance [rad] of every driven joint, in the order of every array with a joint axis."""

    @property
    def joints(self) -> tuple[str, ...]:
        """The driven joints."""
        return tuple(self.neutral)

    @property
    def default_q(self) -> tuple[float, ...]:
        """Neutral stance [rad]."""
        return tuple(self.neutral.values())

    @property
    def leg_names(self) -> tuple[str, ...]:
        """Names of the legs."""
        return tuple(leg.name for leg in self.legs)

    @cached_property
    def columns(self) -> tuple[tuple[int, ...], ...]:
        """Places of each leg's joints on the joint axis, from the trunk to the foot."""
        return tuple(tuple(self.joints.index(joint) for joint in leg.joints) for leg in self.legs)

    def watched(self, devices: Collection[str]) -> tuple[int, ...]:
        """Of each leg, the joint that trials follow: its last one with a device, else its last."""
        with_device = [[column for column in leg if self.joints[column] in devices] for leg in self.columns]
        return tuple((found or leg)[-1] for found, leg in zip(with_device, self.columns, strict=True))

    def leg_of(self, joint: str) -> int:
        """Place of a joint's leg; -1 for a joint of no leg. A bench's joint counts as the first leg's."""
        return next((k for k, leg in enumerate(self.legs) if joint in leg.joints), -1 if joint in self.neutral else 0)


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

FALL_HEIGHT = 0.16
"""Height of the shipped robot's trunk below which it has fallen [m]."""

MASS = 12.6
"""Mass of the shipped robot with its devices [kg], paper section 6.4."""

GAIT_FREQUENCY = 1.5
"""Stride frequency [Hz], paper section 5.1."""

TROT_PHASE = (0.0, 0.5, 0.5, 0.0)
"""Phase offset of each leg in a diagonal trot (FL with RR, FR with RL), in the order of :data:`LEGS`."""

PUBLIC_GAINS = (20.0, 0.5)
"""Kp [N·m/rad] and Kd [N·m·s/rad] of public policies for such robots trained in Isaac Gym: walk-these-ways (Go1),
legged_gym (A1). The asset's are stiffer, see ``assets/usd``."""


class CurrentShares(tuple[float, ...]):
    """Currents of the paper's device [A] that stand for shares of the largest current which another device takes."""

    def of(self, most: float) -> tuple[float, ...]:
        """Currents of a device that takes so much [A]; the paper's where that is infinite: there is no device."""
        return tuple(most * (current / self[-1]) for current in self) if most < math.inf else tuple(self)


CURRENT_GROUPS = CurrentShares((0.0, 0.5, 1.0, 1.5))
"""Fixed currents I_e over the environments [A], eq. 20."""


MR_GO = Layout(
    trunk="trunk",
    legs=tuple(
        Leg(name=leg, joints=tuple(f"{leg}_{segment}" for segment in SEGMENTS), foot=f"{leg}_foot", phase=phase)
        for leg, phase in zip(LEGS, TROT_PHASE, strict=True)
    ),
    neutral=dict(zip(JOINTS, DEFAULT_Q, strict=True)),
)
"""The shipped robot."""


def leg_of(joint: str) -> int:
    """Index into :data:`LEGS` of the leg that a joint belongs to."""
    return LEGS.index(joint.split("_")[0])
