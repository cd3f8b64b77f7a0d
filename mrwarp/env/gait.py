"""The gait clock, where the feet are, and what rewards, terminations and observations share of a robot's motion.

Laws of one leg take legs in the order of ``robot.LEGS``.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

import mujoco
import warp as wp

from mrwarp.env.sim_model import named
from mrwarp.env.state import WalkState
from mrwarp.kernels.launch import Launch, record
from mrwarp.usd.robot import LEGS, TROT_PHASE


@wp.struct
class LegLengths:
    """Lengths of a leg [m], see :func:`leg_lengths`."""

    hip_x: float
    """Trunk centre to hip joint along x."""
    hip_y: float
    """Trunk centre to hip joint along y."""
    offset: float
    """Hip joint to thigh joint along y."""
    thigh: float
    """Thigh joint to calf joint."""
    calf: float
    """Calf joint to foot centre."""
    foot_radius: float
    """Radius of the foot's sphere."""


def leg_lengths(model: mujoco.MjModel) -> LegLengths:
    """Lengths of the robot's first leg; the others are its mirror images.

    Raises:
        ValueError: the model has no such leg.
    """
    bodies = [model.body(i).name for i in range(model.nbody)]
    hip, thigh, calf = (model.body_pos[named(bodies, f"{LEGS[0]}_{part}", "body")] for part in ("hip", "thigh", "calf"))
    foot = next(i for i in range(model.ngeom) if f"/{LEGS[0]}_foot" in model.geom(i).name)
    lengths = LegLengths()
    lengths.hip_x, lengths.hip_y, lengths.offset = float(hip[0]), float(hip[1]), float(thigh[1])
    lengths.thigh, lengths.calf = -float(calf[2]), -float(model.geom_pos[foot][2])
    lengths.foot_radius = float(model.geom_size[foot][0])
    return lengths


LEG_PHASES = wp.constant(wp.vec4(*TROT_PHASE))
"""Phase offset of each leg, ``robot.TROT_PHASE``."""


@wp.func
def leg_phase(phase: float, leg: int) -> float:
    """Phase of a leg in [0, 1) from the clock's phase: stance in the first half, swing in the second."""
    shifted = phase + LEG_PHASES[leg]
    return shifted - wp.floor(shifted)


@wp.func
def swing_clearance(leg: float, height: float) -> float:
    """Wanted clearance over the ground of a leg of this phase [m]: a half sine over the swing, 0 in stance."""
    return height * wp.sin(wp.pi * wp.max(2.0 * leg - 1.0, 0.0))


@wp.func
def foot_point(lengths: LegLengths, leg: int, hip: float, thigh: float, calf: float) -> wp.vec3:
    """Centre of a foot in the trunk frame [m], by forward kinematics of hip, thigh and calf [rad]."""
    front, side = wp.where(leg < 2, 1.0, -1.0), wp.where(leg % 2 == 0, 1.0, -1.0)
    x = -lengths.thigh * wp.sin(thigh) - lengths.calf * wp.sin(thigh + calf)
    down = -lengths.thigh * wp.cos(thigh) - lengths.calf * wp.cos(thigh + calf)
    c, s = wp.cos(hip), wp.sin(hip)
    y = side * lengths.offset * c - down * s
    z = side * lengths.offset * s + down * c
    return wp.vec3(front * lengths.hip_x + x, side * lengths.hip_y + y, z)


@wp.func
def foot_height(
    lengths: LegLengths, leg: int, hip: float, thigh: float, calf: float, root_z: float, up: wp.vec3
) -> float:
    """Height of a foot's lowest point over z = 0 [m].

    ``root_z`` is the trunk's height [m], ``up`` the world's vertical in the trunk frame.
    """
    foot = foot_point(lengths, leg, hip, thigh, calf)
    return root_z + foot[0] * up[0] + foot[1] * up[1] + foot[2] * up[2] - lengths.foot_radius


@wp.kernel(enable_backward=False)
def derived_kernel(
    # parameters: foot force above which a foot touches the ground [N]
    contact_force: float,
    # in, shapes (E,) where to compute, (E, 3) [m], (E, 4), (E, 3) [m/s], (E,), (E, 4) [N]; height of the ground below
    # the trunk, (E,) [m]
    mask_in: wp.array[wp.bool],
    root_pos_in: wp.array2d[float],
    root_quat_in: wp.array2d[float],
    root_vel_in: wp.array2d[float],
    phase_in: wp.array[float],
    f_foot_in: wp.array2d[float],
    ground_in: wp.array[float],
    # out, shapes (E,) [m], (E, 3), (E, 3) [m/s], (E, 4), (E, 4)
    height_out: wp.array[float],
    gravity_out: wp.array2d[float],
    body_velocity_out: wp.array2d[float],
    leg_phase_out: wp.array2d[float],
    clock_match_out: wp.array2d[wp.bool],
):
    """Height, gravity in the trunk frame, velocity in the heading frame, and the legs on the gait clock."""
    env = wp.tid()
    if not mask_in[env]:
        return
    height_out[env] = root_pos_in[env, 2] - ground_in[env]
    w, x = root_quat_in[env, 0], root_quat_in[env, 1]
    y, z = root_quat_in[env, 2], root_quat_in[env, 3]
    # third row of the rotation matrix: the world's vertical in the trunk frame, negated
    gravity_out[env, 0] = -2.0 * (x * z - w * y)
    gravity_out[env, 1] = -2.0 * (y * z + w * x)
    gravity_out[env, 2] = 2.0 * (x * x + y * y) - 1.0
    yaw = wp.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    c, s = wp.cos(yaw), wp.sin(yaw)
    v_x, v_y = root_vel_in[env, 0], root_vel_in[env, 1]
    body_velocity_out[env, 0] = c * v_x + s * v_y
    body_velocity_out[env, 1] = c * v_y - s * v_x
    body_velocity_out[env, 2] = root_vel_in[env, 2]
    for leg in range(4):
        phase = leg_phase(phase_in[env], leg)
        leg_phase_out[env, leg] = phase
        clock_match_out[env, leg] = (f_foot_in[env, leg] > contact_force) == (phase < 0.5)


def derive(s: WalkState, mask: wp.array, contact_force: float) -> Launch:
    """What writes height, gravity, velocity, leg phases and contacts that match the clock, where the mask (E,) is set.

    A foot touches the ground above ``contact_force`` [N].
    """
    return record(
        derived_kernel,
        len(s.q),
        [contact_force, mask, s.root_pos, s.root_quat, s.root_vel, s.phase, s.f_foot, s.ground],
        [s.height, s.gravity, s.body_velocity, s.leg_phase, s.clock_match],
    )
