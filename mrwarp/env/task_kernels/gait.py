"""The gait clock, and the feet's place in it: laws of one leg, legs in the order of ``robot.LEGS``."""

import warp as wp

from mrwarp.usd.robot import TROT_PHASE

THIGH_LENGTH = wp.constant(0.213)
"""Thigh joint to calf joint [m], Go1."""
CALF_LENGTH = wp.constant(0.213)
"""Calf joint to foot centre [m], Go1."""
HIP_OFFSET = wp.constant(0.08)
"""Hip joint to thigh joint along y [m], Go1."""
HIP_X = wp.constant(0.1881)
"""Trunk centre to hip joint along x [m], Go1."""
HIP_Y = wp.constant(0.04675)
"""Trunk centre to hip joint along y [m], Go1."""
FOOT_RADIUS = wp.constant(0.023)
"""Foot sphere [m], Go1."""

LEG_PHASES = wp.constant(wp.vec4(*TROT_PHASE))
"""Phase offset of each leg, ``robot.TROT_PHASE``."""


@wp.func
def leg_phase(phase: float, leg: int) -> float:
    """Phase of a leg in [0, 1) from the clock's phase: stance in the first half, swing in the second."""
    shifted = phase + LEG_PHASES[leg]
    return shifted - wp.floor(shifted)


@wp.func
def clock_stance(leg: float) -> bool:
    """Whether the clock wants a leg of this phase on the ground."""
    return leg < 0.5


@wp.func
def swing_clearance(leg: float, height: float) -> float:
    """Wanted clearance over the ground of a leg of this phase [m]: a half sine over the swing, 0 in stance."""
    return height * wp.sin(wp.pi * wp.max(2.0 * leg - 1.0, 0.0))


@wp.func
def foot_point(leg: int, hip: float, thigh: float, calf: float) -> wp.vec3:
    """Centre of a foot in the trunk frame [m], by forward kinematics of hip, thigh and calf [rad]."""
    front, side = wp.where(leg < 2, 1.0, -1.0), wp.where(leg % 2 == 0, 1.0, -1.0)
    x = -THIGH_LENGTH * wp.sin(thigh) - CALF_LENGTH * wp.sin(thigh + calf)
    down = -THIGH_LENGTH * wp.cos(thigh) - CALF_LENGTH * wp.cos(thigh + calf)
    c, s = wp.cos(hip), wp.sin(hip)
    y = side * HIP_OFFSET * c - down * s
    z = side * HIP_OFFSET * s + down * c
    return wp.vec3(front * HIP_X + x, side * HIP_Y + y, z)


@wp.func
def foot_height(leg: int, hip: float, thigh: float, calf: float, root_z: float, up: wp.vec3) -> float:
    """Height of a foot's lowest point over z = 0 [m].

    ``root_z`` is the trunk's height [m], ``up`` the world's vertical in the trunk frame.
    """
    foot = foot_point(leg, hip, thigh, calf)
    return root_z + foot[0] * up[0] + foot[1] * up[1] + foot[2] * up[2] - FOOT_RADIUS
