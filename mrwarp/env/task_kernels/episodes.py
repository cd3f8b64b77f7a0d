"""How an episode begins, in the masked environments; the others stay bit-equal."""

import warp as wp

from mrwarp.env.task_kernels.draws import DEVICE, POSE, between, place

JOINT_SPREAD = wp.constant(0.1)
"""Largest distance of a joint from the neutral stance at the start [rad]."""
SPEED_SPREAD = wp.constant(0.1)
"""Largest component of the trunk's velocity [m/s] and angular velocity [rad/s] at the start."""


@wp.kernel
def begin_episode_kernel(
    # parameters: environments that a thread takes are this far apart; height of the trunk over the ground [m]; joint
    # addresses, shape (J,); neutral stance [rad], shape (J,); middles of the tiles [m], shape (levels, kinds, 3)
    rows: int,
    height: float,
    q_adr: wp.array[int],
    default_q: wp.array[float],
    origins: wp.array3d[float],
    # in, shapes (2,), (E,), tile of each environment, (E,) twice
    key_in: wp.array[wp.int64],
    mask_in: wp.array[wp.bool],
    level_in: wp.array[wp.int64],
    kind_in: wp.array[wp.int64],
    # out, shapes (E, nq), (E, nv), (E,), (E,) [policy steps], (E, A) three times, (E, J) [rad], (E, J) [N·m]
    qpos_out: wp.array2d[float],
    qvel_out: wp.array2d[float],
    phase_out: wp.array[float],
    episode_length_out: wp.array[wp.int64],
    action_out: wp.array2d[float],
    last_action_out: wp.array2d[float],
    last_qd_out: wp.array2d[float],
    q_des_out: wp.array2d[float],
    tau_motor_out: wp.array2d[float],
):
    """Draw pose, velocity and phase near the neutral stance, and forget the last episode's actions and torques."""
    first = wp.tid()
    for env in range(first, mask_in.shape[0], rows):
        if mask_in[env]:
            joints = q_adr.shape[0]
            begin = place(key_in, env, POSE)
            level, kind = int(level_in[env]), int(kind_in[env])
            for k in range(qpos_out.shape[1]):
                qpos_out[env, k] = 0.0
            for k in range(qvel_out.shape[1]):
                qvel_out[env, k] = 0.0
            for k in range(3):
                qpos_out[env, k] = origins[level, kind, k]
            qpos_out[env, 2] = qpos_out[env, 2] + height
            qpos_out[env, 3] = 1.0
            for joint in range(joints):
                spread = between(-JOINT_SPREAD, JOINT_SPREAD, begin, joint)
                qpos_out[env, q_adr[joint]] = default_q[joint] + spread
                action_out[env, joint] = 0.0
                last_action_out[env, joint] = 0.0
                last_qd_out[env, joint] = 0.0
                q_des_out[env, joint] = default_q[joint]
                tau_motor_out[env, joint] = 0.0
            for k in range(6):
                qvel_out[env, k] = between(-SPEED_SPREAD, SPEED_SPREAD, begin, joints + k)
            phase_out[env] = between(0.0, 1.0, begin, joints + 6)
            episode_length_out[env] = wp.int64(0)


@wp.kernel
def device_kernel(
    # parameters: environments that a thread takes are this far apart; number of the parameter among the drawn ones;
    # least and largest factor [1]
    rows: int,
    number: int,
    low: float,
    high: float,
    # in, shapes (2,), (E,), (E, M) the asset's values
    key_in: wp.array[wp.int64],
    mask_in: wp.array[wp.bool],
    nominal_in: wp.array2d[float],
    # out, shape (E, M)
    value_out: wp.array2d[float],
):
    """Draw one parameter of the devices around its nominal value."""
    first = wp.tid()
    for env in range(first, mask_in.shape[0], rows):
        if mask_in[env]:
            begin = place(key_in, env, DEVICE)
            devices = value_out.shape[1]
            for slot in range(devices):
                factor = between(low, high, begin, number * devices + slot)
                value_out[env, slot] = nominal_in[env, slot] * factor
