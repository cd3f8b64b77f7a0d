"""Current-aware Bouc-Wen torque (eq. 14) and its hysteresis state (eq. 15): Euler's step, the exact one, release."""

import warp as wp

from mrwarp.kernels.clip import clip


@wp.func
def bouc_wen_rate(qd: float, z: float, beta: float, gamma: float) -> float:
    """dz/dt = qd - beta*|qd|*z - gamma*qd*|z| [rad/s], eq. 15."""
    return qd - beta * wp.abs(qd) * z - gamma * qd * wp.abs(z)


@wp.func
def bouc_wen_euler(qd: float, z: float, beta: float, gamma: float, z_max: float, dt: float) -> float:
    """z after one explicit Euler step, clipped to ``[-z_max, z_max]`` (paper section 4.3) [rad].

    Keeps ``|z| <= 1/(beta + gamma)`` only while ``max(beta, beta + gamma)*|qd|*dt <= 1``.
    """
    return clip(z + dt * bouc_wen_rate(qd, z, beta, gamma), z_max)


@wp.func
def _relax(u: float, rate: float, path: float) -> float:
    """Solution of du/ds = 1 - rate*u after the path length ``path`` [rad]."""
    x = rate * path
    if wp.abs(x) < 0.05:
        # (1 - exp(-x))/rate to fourth order, relative error x^4/120 = 5e-8: the difference would cancel for slow motion
        return u + (1.0 - rate * u) * path * (1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0)))
    return u + (1.0 - rate * u) * (1.0 - wp.exp(-x)) / rate


@wp.func
def bouc_wen_exact(qd: float, z: float, beta: float, gamma: float, dt: float) -> float:
    """z after ``dt`` at constant qd, exactly [rad].

    With u = sgn(qd)*z and the path s = |qd|*dt, eq. 15 reads du/ds = 1 - beta*u - gamma*|u|: linear on each side of
    u = 0, and u only crosses zero upwards. Rate independent, and |z| never passes its bound 1/(beta + gamma).
    """
    path = wp.abs(qd) * dt
    direction = wp.sign(qd)
    u = direction * z
    if u < 0.0:
        rate = beta - gamma
        to_zero = -u
        if wp.abs(rate * u) > 1.0e-4:
            # log(1 - rate*u)/rate; for 1 - rate*u <= 0 the origin is never reached
            to_zero = wp.where(1.0 - rate * u > 0.0, wp.log(wp.max(1.0 - rate * u, 1.0e-30)) / rate, path + 1.0)
        else:
            to_zero = -u * (1.0 + 0.5 * rate * u)
        if path < to_zero:
            return direction * _relax(u, rate, path)
        path = path - to_zero
        u = float(0.0)
    return direction * _relax(u, beta + gamma, path)


@wp.func
def bouc_wen_release(z: float, rate: float, stiffness: float, viscosity: float, alpha: float, dt: float) -> float:
    """Signed path of a shaft without mass that nothing holds, in ``dt`` [rad].

    With K the ``stiffness`` of the hysteresis [N·m/rad] and B the ``viscosity`` it moves so that
    ``K*z/(1 + alpha*|qd|) + B*qd = 0``: to where its stress is gone, at once for B = 0. ``rate`` is beta - gamma, by
    which eq. 15 unloads.
    """
    left = float(0.0)
    if viscosity > 0.0 and stiffness > 0.0:
        speed = stiffness * wp.abs(z) / viscosity
        speed = 2.0 * speed / (1.0 + wp.sqrt(1.0 + 4.0 * alpha * speed))
        left = wp.exp(-dt * stiffness / viscosity / (1.0 + alpha * speed))
    size = (1.0 - left) * wp.abs(z)
    path = size * (1.0 - 0.5 * rate * size)
    if wp.abs(rate * size) > 1.0e-3:
        path = wp.log(wp.max(1.0 + rate * size, 1.0e-6)) / rate
    return -wp.sign(z) * path


@wp.func
def bouc_wen_slope(qd: float, z: float, beta: float, gamma: float) -> float:
    """dz/ds of eq. 15 along the path in the direction of qd, at least 0 [1]."""
    u = wp.where(qd < 0.0, -z, z)
    return wp.max(1.0 - beta * u - gamma * wp.abs(u), 0.0)


@wp.func
def bouc_wen_behind_spring(wound: float, z: float, ratio: float, beta: float, gamma: float) -> float:
    """Signed path of a shaft without mass behind a spring, at whose end ``wound - path = ratio*z`` [rad].

    z never falls along a forward path, so the path lies between 0 and where the spring would stand with z as it is:
    Newton's steps that leave this bracket halve it.

    Args:
        wound: How far the spring would be wound if the shaft stood still [rad].
        z: z of eq. 15 before the step [rad].
        ratio: Stiffness of the hysteresis over that of the spring [1].
        beta: Of eq. 15 [1/rad].
        gamma: Of eq. 15 [1/rad].
    """
    ahead = wound - ratio * z
    low, high = wp.min(ahead, 0.0), wp.max(ahead, 0.0)
    rounding = 3.0e-7 * (ratio * wp.abs(z) + wp.abs(wound))
    path = ahead / (1.0 + ratio * bouc_wen_slope(ahead, z, beta, gamma))
    for _ in range(12):
        reached = bouc_wen_exact(path, z, beta, gamma, 1.0)
        miss = wound - path - ratio * reached
        if wp.abs(miss) <= rounding:
            return path
        if miss > 0.0:
            low = path
        else:
            high = path
        path += miss / (1.0 + ratio * bouc_wen_slope(path, reached, beta, gamma))
        if path <= low or path >= high:
            path = 0.5 * (low + high)
    return path


@wp.func
def bouc_wen_behind_play(
    wound: float, z: float, ratio: float, drag: float, half_gap: float, beta: float, gamma: float
) -> float:
    """Signed path of a shaft without mass behind play and a spring in series [rad].

    With ``w = wound - path`` the spring bears ``w - clip(w, half_gap)``, which the device's ``ratio*z + drag*path``
    balances. The former falls along the path and the latter rises, so the path is one, between 0 and where the spring
    would stand with z as it is, on the far side of the gap: Newton's steps that leave this bracket halve it.

    Args:
        wound: Way from the shaft to the joint if the shaft stood still [rad].
        z: z of eq. 15 before the step [rad].
        ratio: Stiffness of the hysteresis over that of the spring [1].
        drag: Viscosity over the spring's stiffness and the step [1].
        half_gap: Half of the play [rad].
        beta: Of eq. 15 [1/rad].
        gamma: Of eq. 15 [1/rad].
    """
    miss = wound - clip(wound, half_gap) - ratio * z
    ahead = wp.where(miss < 0.0, wound - ratio * z - half_gap, wound - ratio * z + half_gap)
    low, high = wp.min(ahead, 0.0), wp.max(ahead, 0.0)
    rounding = 3.0e-7 * (ratio * wp.abs(z) + wp.abs(wound))
    path, reached = float(0.0), float(z)
    for _ in range(24):
        if wp.abs(miss) <= rounding:
            return path
        if miss > 0.0:
            low = path
        else:
            high = path
        closed = wp.where(wp.abs(wound - path) > half_gap, 1.0, 0.0)
        path += miss / wp.max(closed + ratio * bouc_wen_slope(miss, reached, beta, gamma) + drag, 1.0e-6)
        if path <= low or path >= high:
            path = 0.5 * (low + high)
        reached = bouc_wen_exact(path, z, beta, gamma, 1.0)
        left = wound - path
        miss = left - clip(left, half_gap) - ratio * reached - drag * path
    return path


@wp.func
def bouc_wen_torque(
    qd: float,
    q_c: float,
    current: float,
    z: float,
    D: float,
    B: float,
    C: float,
    I1: float,
    K0: float,
    K1: float,
    alpha: float,
) -> float:
    """tau_BW of eq. 14 [N·m]: what a bench sensor reads, positive against positive velocity.

    ``D + B*qd + C*q_c + I1*I + (K0 + K1*I)/(1 + alpha*|qd|) * z``.
    """
    return D + B * qd + C * q_c + I1 * current + (K0 + K1 * current) / (1.0 + alpha * wp.abs(qd)) * z
