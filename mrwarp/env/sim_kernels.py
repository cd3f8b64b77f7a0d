"""Kernels between the solver's state (float32 or float64, MuJoCo layout) and the arrays the rest of mrwarp reads."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false, reportOperatorIssue=false

from typing import Any

import warp as wp

from mrwarp.kernels.brake import constraint_torque


@wp.func
def read_state(
    env: int,
    q_adr: wp.array[int],
    v_adr: wp.array[int],
    floating: int,
    qpos: wp.array2d[Any],
    qvel: wp.array2d[Any],
    q_out: wp.array2d[float],
    qd_out: wp.array2d[float],
    root_pos_out: wp.array2d[float],
    root_quat_out: wp.array2d[float],
    root_vel_out: wp.array2d[float],
    root_ang_out: wp.array2d[float],
) -> None:
    """Joint state and floating base of one environment."""
    for joint in range(q_adr.shape[0]):
        q_out[env, joint] = wp.float32(qpos[env, q_adr[joint]])
        qd_out[env, joint] = wp.float32(qvel[env, v_adr[joint]])
    if floating == 1:
        for k in range(3):
            root_pos_out[env, k] = wp.float32(qpos[env, k])
            root_vel_out[env, k] = wp.float32(qvel[env, k])
            root_ang_out[env, k] = wp.float32(qvel[env, 3 + k])
        for k in range(4):
            root_quat_out[env, k] = wp.float32(qpos[env, 3 + k])


@wp.kernel(enable_backward=False)
def gather_kernel(
    # parameters: addresses, shapes (J,), (J,), (L,); floating base; brake creep [rad/s per N·m]
    q_adr: wp.array[int],
    v_adr: wp.array[int],
    foot_adr: wp.array[int],
    floating: int,
    creep: float,
    # in, shape (E, nq), (E, nv), (E, nsensordata), (E, J)
    qpos_in: wp.array2d[Any],
    qvel_in: wp.array2d[Any],
    sensordata_in: wp.array2d[Any],
    bound_in: wp.array2d[float],
    # out, shape (E, J) [rad, rad/s, N·m], (E, L) [N], (E, 3) [m], (E, 4), (E, 3) [m/s], (E, 3) [rad/s]
    q_out: wp.array2d[float],
    qd_out: wp.array2d[float],
    friction_out: wp.array2d[float],
    f_foot_out: wp.array2d[float],
    root_pos_out: wp.array2d[float],
    root_quat_out: wp.array2d[float],
    root_vel_out: wp.array2d[float],
    root_ang_out: wp.array2d[float],
):
    """Joint state, brake torque, foot force norms and the floating base of one environment."""
    env = wp.tid()
    read_state(
        env,
        q_adr,
        v_adr,
        floating,
        qpos_in,
        qvel_in,
        q_out,
        qd_out,
        root_pos_out,
        root_quat_out,
        root_vel_out,
        root_ang_out,
    )
    for joint in range(q_adr.shape[0]):
        qd, bound = wp.float64(qvel_in[env, v_adr[joint]]), wp.float64(bound_in[env, joint])
        friction_out[env, joint] = wp.float32(constraint_torque(qd, bound, wp.float64(creep)))
    for leg in range(foot_adr.shape[0]):
        adr = foot_adr[leg]
        x = wp.float32(sensordata_in[env, adr])
        y = wp.float32(sensordata_in[env, adr + 1])
        z = wp.float32(sensordata_in[env, adr + 2])
        f_foot_out[env, leg] = wp.sqrt(x * x + y * y + z * z)


@wp.kernel(enable_backward=False)
def apply_kernel(
    # parameters: joints of a thread have this stride (a GPU: J threads, a CPU: one); dof addresses, friction
    # [N·m] and damping [N·m·s/rad] of the joints, shape (J,); 1 = write the brake bounds
    lanes: int,
    v_adr: wp.array[int],
    friction: wp.array[float],
    damping: wp.array[float],
    constraint: int,
    # in, shape (E, J) [N·m, N·m, rad/s]
    tau_in: wp.array2d[float],
    bound_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    # out, shape (E, nv) [N·m]
    qfrc_applied_out: wp.array2d[Any],
    frictionloss_out: wp.array2d[Any],
):
    """Joint torques and brake bounds to the solver, with the joints' own damping and dry friction."""
    env, lane = wp.tid()
    for joint in range(lane, v_adr.shape[0], lanes):
        dof = v_adr[joint]
        tau = tau_in[env, joint] - damping[joint] * qd_in[env, joint]
        qfrc_applied_out[env, dof] = qfrc_applied_out.dtype(tau)
        if constraint == 1:
            frictionloss_out[env, dof] = frictionloss_out.dtype(bound_in[env, joint] + friction[joint])


@wp.kernel(enable_backward=False)
def reset_kernel(
    # parameters: environments of a thread have this stride; addresses, shapes (J,) twice; floating base
    rows: int,
    q_adr: wp.array[int],
    v_adr: wp.array[int],
    floating: int,
    # in, shapes (E,), (E, nq), (E, nv)
    mask_in: wp.array[wp.bool],
    qpos_in: wp.array2d[float],
    qvel_in: wp.array2d[float],
    # out, shapes (E, nq), (E, nv) three times, (E, 6*nbody), (E, L), (E, J) three times, (E, 3), (E, 4), (E, 3) twice
    qpos_out: wp.array2d[Any],
    qvel_out: wp.array2d[Any],
    warmstart_out: wp.array2d[Any],
    qfrc_applied_out: wp.array2d[Any],
    xfrc_applied_out: wp.array2d[Any],
    f_foot_out: wp.array2d[float],
    friction_out: wp.array2d[float],
    q_out: wp.array2d[float],
    qd_out: wp.array2d[float],
    root_pos_out: wp.array2d[float],
    root_quat_out: wp.array2d[float],
    root_vel_out: wp.array2d[float],
    root_ang_out: wp.array2d[float],
):
    """Put masked environments into a state; the solver's last solution, foot forces, brake torques, pushes are gone."""
    first = wp.tid()
    for env in range(first, mask_in.shape[0], rows):
        if mask_in[env]:
            for k in range(qpos_out.shape[1]):
                qpos_out[env, k] = qpos_out.dtype(qpos_in[env, k])
            for k in range(qvel_out.shape[1]):
                qvel_out[env, k] = qvel_out.dtype(qvel_in[env, k])
                warmstart_out[env, k] = warmstart_out.dtype(0.0)
                qfrc_applied_out[env, k] = qfrc_applied_out.dtype(0.0)
            for k in range(xfrc_applied_out.shape[1]):
                xfrc_applied_out[env, k] = xfrc_applied_out.dtype(0.0)
            for leg in range(f_foot_out.shape[1]):
                f_foot_out[env, leg] = 0.0
            for joint in range(friction_out.shape[1]):
                friction_out[env, joint] = 0.0
            read_state(
                env,
                q_adr,
                v_adr,
                floating,
                qpos_out,
                qvel_out,
                q_out,
                qd_out,
                root_pos_out,
                root_quat_out,
                root_vel_out,
                root_ang_out,
            )


_LARGEST = """
const int nv = rowadr.shape[0];
const auto* inertia = (const decltype(M.data))((const char*)M.data + size_t(env) * M.strides[0]);
const auto* a = (const decltype(qacc.data))((const char*)qacc.data + size_t(env) * qacc.strides[0]);
const auto* free = (const decltype(qacc.data))((const char*)qacc_smooth.data + size_t(env) * qacc_smooth.strides[0]);
const auto* pull = (const decltype(qacc.data))((const char*)qfrc.data + size_t(env) * qfrc.strides[0]);
double* delta = scratch.data + size_t(env) * 2 * nv;
double* force = delta + nv;
for (int row = 0; row < nv; ++row) {
    force[row] = -(double)pull[row];
    delta[row] = (double)a[row] - (double)free[row];
}
for (int row = 0; row < nv; ++row) {
    // the lower triangle is stored, the diagonal last: each entry off it acts twice
    const int last = rowadr.data[row] + rownnz.data[row] - 1;
    const double own = delta[row];
    double sum = force[row] + (double)inertia[last] * own;
    for (int k = rowadr.data[row]; k < last; ++k) {
        const int col = colind.data[k];
        const double m = inertia[k];
        sum += m * delta[col];
        force[col] += m * own;
    }
    force[row] = sum;
}
double worst = 0.0;
// NaN fails every comparison: test for "small", so that a diverged solve counts as unsolved
for (int row = 0; row < nv; ++row) if (!(fabs(force[row]) <= worst)) worst = fabs(force[row]);
return (float)worst;
"""


@wp.func_native(_LARGEST)
def largest_residual(  # pyright: ignore[reportRedeclaration]
    rowadr: wp.array[int],
    rownnz: wp.array[int],
    colind: wp.array[int],
    env: int,
    M: wp.array2d[wp.float64],
    qacc: wp.array2d[wp.float64],
    qacc_smooth: wp.array2d[wp.float64],
    qfrc: wp.array2d[wp.float64],
    scratch: wp.array2d[wp.float64],
) -> float:
    """Largest component of M*(qacc - qacc_smooth) - qfrc of an environment [N·m]; the scratch has 2 nv columns."""
    ...


@wp.func_native(_LARGEST)
def largest_residual(  # noqa: F811 - Warp takes the one whose types fit
    rowadr: wp.array[int],
    rownnz: wp.array[int],
    colind: wp.array[int],
    env: int,
    M: wp.array2d[float],
    qacc: wp.array2d[float],
    qacc_smooth: wp.array2d[float],
    qfrc: wp.array2d[float],
    scratch: wp.array2d[wp.float64],
) -> float:
    """Largest component of M*(qacc - qacc_smooth) - qfrc [N·m] in single precision; the scratch has 2 nv columns."""
    ...


@wp.kernel(enable_backward=False)
def residual_kernel(
    # parameters: sparse pattern of the inertia matrix, shapes (nv,), (nv,), (nM,); largest residual [N·m]
    M_rowadr: wp.array[int],
    M_rownnz: wp.array[int],
    M_colind: wp.array[int],
    largest: float,
    # in, shape (E, nM), (E, nv); columns without gaps
    M_in: wp.array2d[Any],
    qacc_in: wp.array2d[Any],
    qacc_smooth_in: wp.array2d[Any],
    qfrc_constraint_in: wp.array2d[Any],
    # out, scratch, shape (E, 2*nv), (E,) [N·m], (E,) counted steps
    scratch_out: wp.array2d[wp.float64],
    residual_out: wp.array[float],
    unsolved_out: wp.array[int],
):
    """Largest component of M*(qacc - qacc_smooth) - qfrc_constraint [N·m]: 0 where the constraint solver converged."""
    env = wp.tid()
    worst = largest_residual(
        M_rowadr, M_rownnz, M_colind, env, M_in, qacc_in, qacc_smooth_in, qfrc_constraint_in, scratch_out
    )
    residual_out[env] = worst
    if not (worst <= largest):
        unsolved_out[env] = unsolved_out[env] + 1
