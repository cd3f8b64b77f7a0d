"""Actions: a policy's joint targets, and what the motors and coils spent on following them."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

import warp as wp

from mrwarp.energy.power import ElectricalCfg, copper_factor
from mrwarp.env.rng import STEP
from mrwarp.env.state import WalkState
from mrwarp.kernels.launch import Launch, record
from mrwarp.kernels.ledger import COIL, MOTOR, MOTOR_SQUARE


@wp.func
def spent(ledger: wp.array3d[float], copper: wp.array[float], env: int) -> wp.vec2:
    """What all joints spent since the reset: integral of the squared motor torques [(N·m)^2 s]; electrical energy [J].

    The energy is the motors' copper loss and mechanical work, given-back work counted in full, and the coils' loss.

    Args:
        ledger: Energy ledger, shape (E, J, entries).
        copper: Copper loss per torque squared, shape (J,) [W/(N·m)^2].
        env: Environment.
    """
    square, energy = float(0.0), float(0.0)
    for joint in range(ledger.shape[1]):
        square += ledger[env, joint, MOTOR_SQUARE]
        energy += (
            copper[joint] * ledger[env, joint, MOTOR_SQUARE] + ledger[env, joint, MOTOR] + ledger[env, joint, COIL]
        )
    return wp.vec2(square, energy)


@wp.kernel(enable_backward=False)
def action_kernel(
    # parameters: action scale [rad]; neutral stance [rad], shape (A,); copper loss [W/(N·m)^2], shape (J,)
    action_scale: float,
    default_q: wp.array[float],
    copper: wp.array[float],
    # in, shapes (E, A), (E, J) [rad/s], (E, J, entries)
    actions_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    ledger_in: wp.array3d[float],
    # out, shapes (E, A), (E, A), (E, J) [rad], (E, J) [rad/s], (E, 2) [(N·m)^2 s, J]
    action_out: wp.array2d[float],
    last_action_out: wp.array2d[float],
    q_des_out: wp.array2d[float],
    last_qd_out: wp.array2d[float],
    spent_out: wp.array2d[float],
):
    """Take the new action, and remember what the coming policy step is compared with."""
    env = wp.tid()
    for k in range(actions_in.shape[1]):
        last_action_out[env, k] = action_out[env, k]
        action_out[env, k] = actions_in[env, k]
        q_des_out[env, k] = default_q[k] + action_scale * actions_in[env, k]
        last_qd_out[env, k] = qd_in[env, k]
    before = spent(ledger_in, copper, env)
    spent_out[env, 0] = before[0]
    spent_out[env, 1] = before[1]


@wp.kernel(enable_backward=False)
def effort_kernel(
    # parameters: clock advance per policy step [1], policy step [s]; copper loss [W/(N·m)^2], shape (J,)
    advance: float,
    step_dt: float,
    copper: wp.array[float],
    # in, shapes (E, J, entries), (E, 2) [(N·m)^2 s, J], (E,)
    ledger_in: wp.array3d[float],
    spent_in: wp.array2d[float],
    phase_in: wp.array[float],
    # out, shapes (E,) [(N·m)^2], (E,) [W], (E,), (2,)
    effort_out: wp.array[float],
    power_out: wp.array[float],
    phase_out: wp.array[float],
    key_out: wp.array[wp.int64],
):
    """Squared motor torques and electrical power, means over the policy step; the gait clock at its end; count it."""
    env = wp.tid()
    if env == 0:
        key_out[STEP] = key_out[STEP] + wp.int64(1)  # nothing is drawn in this launch
    mean = (spent(ledger_in, copper, env) - wp.vec2(spent_in[env, 0], spent_in[env, 1])) / step_dt
    effort_out[env] = mean[0]
    power_out[env] = mean[1]
    phase = phase_in[env] + advance
    phase_out[env] = phase - wp.floor(phase)


class Actions:
    """The begin and the end of a policy step's torque steps.

    Args:
        s: The task's arrays.
        scale: Joint target per action [rad].
        winding_resistance: Phase resistance of the motors [Ohm].
        step_dt: Policy step [s].
        gait_frequency: Stride frequency of the clock [Hz].

    Attributes:
        take: Writes joint targets from ``s.actions``.
        account: Writes effort and power, and advances the gait clock and the count of policy steps.
    """

    def __init__(
        self, s: WalkState, scale: float, winding_resistance: float, step_dt: float, gait_frequency: float
    ) -> None:
        factor = copper_factor(ElectricalCfg(winding_resistance=winding_resistance))
        copper = wp.array(factor, dtype=float, device=str(s.q.device))
        self.take: Launch = record(
            action_kernel,
            len(s.q),
            [scale, s.default_q, copper, s.actions, s.qd, s.ledger],
            [s.action, s.last_action, s.q_des, s.last_qd, s.spent],
        )
        self.account: Launch = record(
            effort_kernel,
            len(s.q),
            [gait_frequency * step_dt, step_dt, copper, s.ledger, s.spent, s.phase],
            [s.effort, s.power, s.phase, s.key],
        )
