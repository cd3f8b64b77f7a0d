"""The gait clock, where the feet are, and what rewards, terminations and observations share of a robot's motion."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

import mujoco
import numpy as np
import warp as wp

from mrwarp.env.sim_model import Scene
from mrwarp.env.state import WalkState
from mrwarp.kernels.launch import Launch, record


@wp.struct
class Legs:
    """Kinematics and gait of a robot's legs, see :func:`legs_of`.

    Any chain of hinges is followed joint by joint. Legs of the usual kind (``planar``: the hip turns about x, thigh and
    calf about y, mirror images of each other) have a closed form.
    """

    phases: wp.array[float]
    """Phase offset of each leg, shape (L,)."""
    columns: wp.array2d[int]
    """Joints of each leg from the trunk on, shape (L, K); -1 behind the last."""
    axes: wp.array2d[wp.vec3]
    """Their axes in the trunk frame with all joints at 0, shape (L, K)."""
    anchors: wp.array2d[wp.vec3]
    """A point on each axis [m], in the same order."""
    feet: wp.array[wp.vec3]
    """Centres of the feet [m], by leg, shape (L,)."""
    radii: wp.array[float]
    """Radius of each foot's sphere [m], shape (L,)."""
    hips: wp.array[float]
    """1 where a joint turns about the trunk's x axis, as hips do; shape (J,)."""
    planar: int
    """1 where the closed form holds, with the lengths that follow."""
    hip_x: float
    """Trunk centre to hip joint along x [m]."""
    hip_y: float
    """Trunk centre to hip joint along y [m]."""
    offset: float
    """Hip joint to thigh joint along y [m]."""
    thigh: float
    """Thigh joint to calf joint [m]."""
    calf: float
    """Calf joint to foot centre [m]."""


def legs_of(scene: Scene, device: str = "cpu") -> Legs:
    """The legs of a scene's robot, on a device."""
    model, layout = scene.model, scene.layout
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    data.qpos[:7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    data.qpos[scene.q_adr] = 0.0
    mujoco.mj_kinematics(model, data)
    joints = model.dof_jntid[scene.v_adr]
    axes, anchors = data.xaxis[joints], data.xanchor[joints]
    width = max(map(len, layout.columns))
    columns = np.array([[*row, *[-1] * (width - len(row))] for row in layout.columns])
    legs = Legs()
    legs.phases = wp.array([leg.phase for leg in layout.legs], dtype=float, device=device)
    legs.columns = wp.array(columns, dtype=int, device=device)
    legs.axes = wp.array(axes[columns], dtype=wp.vec3, device=device)
    legs.anchors = wp.array(anchors[columns], dtype=wp.vec3, device=device)
    legs.feet = wp.array(data.geom_xpos[scene.feet], dtype=wp.vec3, device=device)
    legs.radii = wp.array(model.geom_size[scene.feet, 0], dtype=float, device=device)
    legs.hips = wp.array(np.abs(axes[:, 0]) > 0.99, dtype=float, device=device)
    body = model.jnt_bodyid[joints]
    if columns.tolist() == [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]]:
        hip, thigh, calf = (model.body_pos[body[k]] for k in range(3))
        legs.hip_x, legs.hip_y, legs.offset = float(hip[0]), float(hip[1]), float(thigh[1])
        legs.thigh, legs.calf = -float(calf[2]), -float(model.geom_pos[scene.feet[0]][2])
        front, side = np.array([1.0, 1.0, -1.0, -1.0]), np.array([1.0, -1.0, 1.0, -1.0])
        zero = np.stack([front * hip[0], side * (hip[1] + thigh[1]), np.full(4, -legs.thigh - legs.calf)], axis=1)
        mirrored = np.stack([[front * hip[0], side * hip[1], 0.0 * side], zero.T * [[1.0], [1.0], [0.0]]])
        axes, anchors = axes[:12], anchors[:12]  # joints of no leg come after those of the legs
        equal = np.allclose(axes, np.tile([[1, 0, 0], [0, 1, 0], [0, 1, 0]], (4, 1)), atol=1e-6)
        equal = equal and np.allclose(data.geom_xpos[scene.feet], zero, atol=1e-6)
        equal = equal and np.allclose(np.stack([anchors[0::3], anchors[1::3]]), mirrored.transpose(0, 2, 1), atol=1e-6)
        legs.planar = int(equal and np.allclose(anchors[2::3], zero + [0.0, 0.0, legs.calf], atol=1e-6))
    return legs


@wp.func
def leg_phase(phase: float, offset: float) -> float:
    """Phase of a leg in [0, 1) from the clock's phase and its offset: stance in the first half, swing in the second."""
    shifted = phase + offset
    return shifted - wp.floor(shifted)


@wp.func
def swing_clearance(leg: float, height: float) -> float:
    """Wanted clearance over the ground of a leg of this phase [m]: a half sine over the swing, 0 in stance."""
    return height * wp.sin(wp.pi * wp.max(2.0 * leg - 1.0, 0.0))


@wp.func
def foot_point(legs: Legs, leg: int, q: wp.array2d[float], env: int) -> wp.vec3:
    """Centre of a foot in the trunk frame [m], by forward kinematics of an environment's joints [rad]."""
    if legs.planar == 1:
        hip, thigh, calf = q[env, 3 * leg], q[env, 3 * leg + 1], q[env, 3 * leg + 2]
        front, side = wp.where(leg < 2, 1.0, -1.0), wp.where(leg % 2 == 0, 1.0, -1.0)
        x = -legs.thigh * wp.sin(thigh) - legs.calf * wp.sin(thigh + calf)
        down = -legs.thigh * wp.cos(thigh) - legs.calf * wp.cos(thigh + calf)
        c, s = wp.cos(hip), wp.sin(hip)
        y = side * legs.offset * c - down * s
        z = side * legs.offset * s + down * c
        return wp.vec3(front * legs.hip_x + x, side * legs.hip_y + y, z)
    point = legs.feet[leg]
    for i in range(legs.columns.shape[1]):
        k = legs.columns.shape[1] - 1 - i
        joint = legs.columns[leg, k]
        if joint >= 0:
            turn = wp.quat_from_axis_angle(legs.axes[leg, k], q[env, joint])
            point = legs.anchors[leg, k] + wp.quat_rotate(turn, point - legs.anchors[leg, k])
    return point


@wp.func
def foot_height(legs: Legs, leg: int, q: wp.array2d[float], env: int, root_z: float, up: wp.vec3) -> float:
    """Height of a foot's lowest point over z = 0 [m].

    ``root_z`` is the trunk's height [m], ``up`` the world's vertical in the trunk frame.
    """
    foot = foot_point(legs, leg, q, env)
    return root_z + foot[0] * up[0] + foot[1] * up[1] + foot[2] * up[2] - legs.radii[leg]


@wp.kernel(enable_backward=False)
def derived_kernel(
    # parameters: foot force above which a foot touches the ground [N]; phase offset of each leg, shape (L,)
    contact_force: float,
    phases: wp.array[float],
    # in, shapes (E,) where to compute, (E, 3) [m], (E, 4), (E, 3) [m/s], (E,), (E, L) [N]; height of the ground below
    # the trunk, (E,) [m]
    mask_in: wp.array[wp.bool],
    root_pos_in: wp.array2d[float],
    root_quat_in: wp.array2d[float],
    root_vel_in: wp.array2d[float],
    phase_in: wp.array[float],
    f_foot_in: wp.array2d[float],
    ground_in: wp.array[float],
    # out, shapes (E,) [m], (E, 3), (E, 3) [m/s], (E, L), (E, L)
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
    for leg in range(phases.shape[0]):
        phase = leg_phase(phase_in[env], phases[leg])
        leg_phase_out[env, leg] = phase
        clock_match_out[env, leg] = (f_foot_in[env, leg] > contact_force) == (phase < 0.5)


def derive(s: WalkState, mask: wp.array, contact_force: float, legs: Legs) -> Launch:
    """Launch that writes height, gravity, velocity, leg phases and matching contacts where the mask (E,) is set.

    A foot touches the ground above ``contact_force`` [N].
    """
    return record(
        derived_kernel,
        len(s.q),
        [contact_force, legs.phases, mask, s.root_pos, s.root_quat, s.root_vel, s.phase, s.f_foot, s.ground],
        [s.height, s.gravity, s.body_velocity, s.leg_phase, s.clock_match],
    )
