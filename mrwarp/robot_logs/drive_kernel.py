"""Drives and MR devices of replayed robots: what acts in a physics step, by joint, and what is recorded of it."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false, reportOperatorIssue=false

from typing import Any

import warp as wp

from mrwarp.kernels.bouc_wen import bouc_wen_exact, bouc_wen_torque
from mrwarp.kernels.brake import yield_torque
from mrwarp.kernels.coil import coil_current
from mrwarp.kernels.mr_joint import JointParams, displacement

STRIBECK_SPEED = 0.15
"""Speed at which Stribeck's friction has faded [rad/s]."""

_STRIBECK = wp.constant(STRIBECK_SPEED)


@wp.struct
class Commands:
    """Commands of a log in each of W windows at T steps, some of them before and after the window."""

    ask_kp: wp.array3d[float]
    """Torque ``kp*q_des`` [N·m], shape (W, T, J)."""
    ask_kd: wp.array3d[float]
    """Torque ``kd*qd_des`` [N·m]."""
    ask: wp.array3d[float]
    """Further torque [N·m]."""
    kp: wp.array3d[float]
    """[N·m/rad]"""
    kd: wp.array2d[float]
    """[N·m·s/rad], shape (W, J)."""
    coil: wp.array3d[float]
    """Coil current [A], shape (W, T, J)."""
    start_coil: wp.array2d[float]
    """Coil current at the start [A], shape (W, J)."""
    gravity: wp.array3d[float]
    """Torque that holds the links at rest [N·m], shape (W, T, J)."""
    hidden: wp.array3d[float]
    """Torque of a motion that the log does not have [N·m], shape (W, T, J)."""
    memory: wp.array2d[float]
    """Hysteresis of each joint's device at the start [rad], shape (W, J)."""


@wp.struct
class Drives:
    """Drives, friction and devices of E robots with J joints, shape (E, J) each."""

    kp: wp.array2d[float]
    """Times Kp [1]."""
    kd: wp.array2d[float]
    """Times Kd [1]."""
    strength: wp.array2d[float]
    """Torque given for one asked [1]."""
    shift: wp.array2d[float]
    """Error of the drive's own angle [rad]."""
    faded: wp.array2d[float]
    """Share of the drive's last velocity that is left after a step [1]: its filter's lag."""
    gravity: wp.array2d[float]
    """Share of gravity's torque that the drive adds by itself [1]."""
    hidden: wp.array2d[float]
    """Size of the hidden motion [1]."""
    sluggish: wp.array2d[float]
    """Share of the drive's last torque that is left after a step [1]: its lag."""
    smoothed: wp.array2d[float]
    """Share of the last command that is left after a step [1]: its lag."""
    dry: wp.array2d[float]
    """Dry friction [N·m]."""
    stribeck: wp.array2d[float]
    """Stribeck's addition to it at rest [N·m]."""
    alive: wp.array2d[float]
    """Coil current for one commanded [1]."""
    device: wp.array2d[float]
    """Strength of the device's field-dependent torque [1]."""
    lag: wp.array2d[float]
    """Time constant of the coil [s]."""
    drag: wp.array2d[float]
    """Torque that the device adds at any current [N·m]."""


@wp.func
def late(values: wp.array3d[float], window: int, joint: int, at: int, share: float) -> float:
    """Command between two steps: at ``at`` and, in proportion, at the one before."""
    top = values.shape[1] - 1
    now = values[window, wp.clamp(at, 0, top), joint]
    return now + share * (values[window, wp.clamp(at - 1, 0, top), joint] - now)


@wp.func
def asked(commands: Commands, drives: Drives, env: int, window: int, joint: int, at: int, share: float) -> float:
    """Torque that commands ask for, without feedback [N·m]."""
    ask = late(commands.ask, window, joint, at, share)
    ask += drives.kp[env, joint] * late(commands.ask_kp, window, joint, at, share)
    ask += drives.kd[env, joint] * late(commands.ask_kd, window, joint, at, share)
    return ask


@wp.func
def smoothed(
    commands: Commands,
    drives: Drives,
    env: int,
    window: int,
    joint: int,
    at: int,
    share: float,
    step: int,
    before: int,
    ask: float,
    memory: wp.array2d[float],
) -> float:
    """Commanded torque ``ask`` behind a first-order lag [N·m]; ``memory`` (E, J) holds it from step to step."""
    kept = drives.smoothed[env, joint]
    if kept <= 0.0:
        return ask
    behind = memory[env, joint]
    if step == 0:
        behind = asked(commands, drives, env, window, joint, at - before, share)
        for k in range(1, before):
            behind += (1.0 - kept) * (asked(commands, drives, env, window, joint, at - before + k, share) - behind)
    behind += (1.0 - kept) * (ask - behind)
    memory[env, joint] = behind
    return behind


@wp.func
def device_bound(p: JointParams, strength: float, qd: float, q: float, current: float, z: float, held: int) -> float:
    """Largest torque of a device that is ``strength`` times as strong [N·m]: eq. 14, or eq. 18 where it holds more."""
    amps = wp.abs(current)
    stiffness = strength * p.K1
    sliding = bouc_wen_torque(qd, displacement(p, q), amps, z, p.D, p.B, p.C, p.I1, p.K0, stiffness, p.alpha)
    bound = wp.abs(sliding)
    if held == 1:
        bound = wp.max(bound, strength * yield_torque(amps, p.T_max, p.K, p.n))
    return bound


@wp.kernel(enable_backward=False)
def memory_kernel(
    # parameters, shape (M,)
    devices: wp.array[JointParams],
    # in, shapes (N,) [s], (N, M) [rad/s]: time until the next sample and the mean velocity until then
    seconds_in: wp.array[float],
    qd_in: wp.array2d[float],
    # out, shape (N, M) [rad]
    z_out: wp.array2d[float],
):
    """Hysteresis of a device along a run, 0 at its first sample."""
    slot = wp.tid()
    p = devices[slot]
    z = float(0.0)
    for k in range(qd_in.shape[0]):
        z_out[k, slot] = z
        z = bouc_wen_exact(qd_in[k, slot], z, p.beta, p.gamma, seconds_in[k])


@wp.kernel(enable_backward=False)
def begin_kernel(
    # parameters: addresses in qvel, shape (J,)
    v_adr: wp.array[int],
    commands: Commands,
    # in, shapes (E,), (E, nv)
    window_in: wp.array[int],
    qvel_in: wp.array2d[Any],
    # out, shape (E, J): filtered velocity [rad/s], coil current [A], z [rad]
    slow_out: wp.array2d[float],
    coil_out: wp.array2d[float],
    z_out: wp.array2d[float],
):
    """States at a window's start, the coil's as it was logged."""
    env, joint = wp.tid()
    window = window_in[env]
    slow_out[env, joint] = wp.float32(qvel_in[env, v_adr[joint]])
    coil_out[env, joint] = commands.start_coil[window, joint]
    z_out[env, joint] = commands.memory[window, joint]


@wp.kernel(enable_backward=False)
def drive_kernel(
    # parameters: physics step [s]; steps of commands before a window; addresses in qpos and qvel, device of each joint
    # (-1: none), shape (J,); the devices, (M,)
    h: float,
    before: int,
    q_adr: wp.array[int],
    v_adr: wp.array[int],
    device: wp.array[int],
    devices: wp.array[JointParams],
    commands: Commands,
    drives: Drives,
    # in, shapes (1,), (E,) four times, (E, nq), (E, nv): step; window; delay in whole steps and the share of one more;
    # latency of the feedback [s]; state
    step_in: wp.array[int],
    window_in: wp.array[int],
    whole_in: wp.array[int],
    share_in: wp.array[float],
    latency_in: wp.array[float],
    qpos_in: wp.array2d[Any],
    qvel_in: wp.array2d[Any],
    # out, shapes (E, J) six times, (E, J, 10), (E, nv): as begin_kernel's; lagged command and torque; commands of the
    # drives, how they answer the state, friction [N·m]
    slow_out: wp.array2d[float],
    coil_out: wp.array2d[float],
    z_out: wp.array2d[float],
    ask_out: wp.array2d[float],
    torque_out: wp.array2d[float],
    ctrl_out: wp.array2d[Any],
    bias_out: wp.array3d[Any],
    frictionloss_out: wp.array2d[Any],
):
    """Commands, friction and devices of one joint for the next physics step."""
    env, joint = wp.tid()
    window, share = window_in[env], share_in[env]
    at = before + step_in[0] - whole_in[env]
    qd = wp.float32(qvel_in[env, v_adr[joint]])
    slow = qd + drives.faded[env, joint] * (slow_out[env, joint] - qd)
    slow_out[env, joint] = slow
    more, strength = drives.kp[env, joint], wp.max(drives.strength[env, joint], 1.0e-3)
    kp = more * late(commands.kp, window, joint, at, share)
    kd = drives.kd[env, joint] * commands.kd[window, joint]
    ask = asked(commands, drives, env, window, joint, at, share)
    ctrl = smoothed(commands, drives, env, window, joint, at, share, step_in[0], before, ask, ask_out)
    ctrl += drives.gravity[env, joint] * late(commands.gravity, window, joint, before + step_in[0], 0.0) / strength
    ctrl -= drives.hidden[env, joint] * late(commands.hidden, window, joint, before + step_in[0], 0.0) / strength
    ctrl += kp * drives.shift[env, joint] + kd * (qd - slow)
    left = drives.sluggish[env, joint]
    if left > 0.0:
        angle = wp.float32(qpos_in[env, q_adr[joint]])
        torque = strength * (ctrl - kp * angle - (kd - latency_in[env] * kp) * qd)
        behind = torque_out[env, joint]
        if step_in[0] == 0:  # what was asked for as long ago as the lag, of a joint that kept its speed
            ago = left / (1.0 - left)
            then = asked(commands, drives, env, window, joint, at - int(ago), share)
            behind = torque + strength * (then - ask + kp * qd * ago * h)
        behind += (1.0 - left) * (torque - behind)
        torque_out[env, joint] = behind
        ctrl += (behind - torque) / strength
    ctrl_out[env, joint] = ctrl_out.dtype(ctrl)
    bias_out[env, joint, 1] = bias_out.dtype(-strength * kp)
    bias_out[env, joint, 2] = bias_out.dtype(-strength * (kd - latency_in[env] * kp))
    ratio = qd / _STRIBECK
    bound = drives.dry[env, joint] + drives.stribeck[env, joint] * wp.exp(-ratio * ratio)
    if device[joint] >= 0:
        p = devices[device[joint]]
        wanted = drives.alive[env, joint] * late(commands.coil, window, joint, at, share)
        coil = coil_current(coil_out[env, joint], wanted, drives.lag[env, joint], h)
        z = bouc_wen_exact(qd, z_out[env, joint], p.beta, p.gamma, h)
        held = int(0)
        if kp < 0.5 * (p.kp_base + p.kp_low) * more:  # eq. 9: the low gain while it holds
            held = 1
        q = wp.float32(qpos_in[env, q_adr[joint]])
        bound += device_bound(p, drives.device[env, joint], qd, q, coil, z, held) + drives.drag[env, joint]
        coil_out[env, joint] = coil
        z_out[env, joint] = z
    frictionloss_out[env, v_adr[joint]] = frictionloss_out.dtype(wp.max(bound, 0.0))


@wp.kernel(enable_backward=False)
def record_kernel(
    # parameters: addresses in qvel, shape (J,)
    v_adr: wp.array[int],
    # in, shapes (1,), (E, nq), (E, nv), (E, nv): step; state; torque of the drives in the step before [N·m]
    step_in: wp.array[int],
    qpos_in: wp.array2d[Any],
    qvel_in: wp.array2d[Any],
    force_in: wp.array2d[Any],
    # out, shapes (E, K + 1, nq), (E, K + 1, nv), (E, K + 1, J)
    pos_out: wp.array3d[Any],
    vel_out: wp.array3d[Any],
    torque_out: wp.array3d[Any],
):
    """State of a robot at a step, and what its drives gave until then."""
    env = wp.tid()
    k = step_in[0]
    for i in range(qpos_in.shape[1]):
        pos_out[env, k, i] = pos_out.dtype(qpos_in[env, i])
    for i in range(qvel_in.shape[1]):
        vel_out[env, k, i] = vel_out.dtype(qvel_in[env, i])
    for joint in range(v_adr.shape[0]):
        torque_out[env, k, joint] = torque_out.dtype(force_in[env, v_adr[joint]])


@wp.kernel(enable_backward=False)
def next_kernel(
    # in
    by: int,
    # out, shape (1,)
    step_out: wp.array[int],
):
    """Count a step."""
    step_out[0] = step_out[0] + by
