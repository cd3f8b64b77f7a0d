"""The kernels' view of :class:`mrwarp.params.MrParams`: one struct of float32 per joint, shape (E or 1, M)."""

import warp as wp


@wp.struct
class JointParams:
    """Parameters of one MR joint; names, units and sources as in ``mrwarp.params``."""

    q_neutral: wp.float32
    q_offset: wp.float32
    q_center: wp.float32
    D: wp.float32
    B: wp.float32
    C: wp.float32
    I1: wp.float32
    K0: wp.float32
    K1: wp.float32
    alpha: wp.float32
    beta: wp.float32
    gamma: wp.float32
    z_max: wp.float32
    T_max: wp.float32
    K: wp.float32
    n: wp.float32
    safety_factor: wp.float32
    f_th: wp.float32
    eps_e: wp.float32
    eps_v: wp.float32
    eps_hold: wp.float32
    kp_base: wp.float32
    kp_low: wp.float32
    kd: wp.float32
    tau_limit: wp.float32
    coil_time_constant: wp.float32
    coil_resistance: wp.float32
    current_max: wp.float32


FIELDS: tuple[str, ...] = tuple(JointParams.vars)
"""Field names in memory order; an (E, M, len(FIELDS)) float view of a parameter array is indexed by them."""
