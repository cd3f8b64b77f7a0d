/* The MR joint's stages of one torque step (gates, coil, history, Bouc-Wen, hold, motor) as one plain loop in C:
 * what mrwarp/kernels/mr_stages.py is timed against. Equation numbers are the paper's. `mrwarp perf` compiles it with
 * cc -O3 and checks that its numbers are those of the kernels. Arrays are float32 and contiguous, environments first. */
#include <math.h>

enum { WINDOW = 50, FEATURES = 3 };

/* The order of mrwarp/kernels/mr_joint.py. */
typedef struct {
    float q_neutral, q_offset, q_center, D, B, C, I1, K0, K1, alpha, beta, gamma, z_max, T_max, K, n, safety_factor;
    float f_th, eps_e, eps_v, eps_hold, kp_base, kp_low, kd, tau_limit, coil_time_constant, coil_resistance;
    float current_max;
} Device;

static float clip(float value, float limit) {
    return isnan(value) ? value : fminf(fmaxf(value, -limit), limit);
}

static float yield_torque(float current, const Device* p) { /* eq. 18 */
    const float ratio = powf(fabsf(current) / p->K, p->n);
    return p->T_max * ratio / (1.0f + ratio);
}

static float support_current(float tau, float limit, const Device* p) { /* its inverse */
    const float wanted = p->safety_factor * fabsf(tau);
    if (wanted >= p->T_max) return limit;
    return fminf(p->K * powf(wanted / (p->T_max - wanted), 1.0f / p->n), limit);
}

/* One step of `envs` robots with `joints` joints, `devices` of them with a device; the brake-constraint coupling. */
void mr_loop(
    int envs, int joints, int devices, int legs, const Device* params, const int* slot_of, const int* leg_of,
    const float* kp, const float* kd, const float* tau_limit, float dt, int head, const float* q_des, const float* q,
    const float* qd, const float* f_foot, const float* current_e, float* m_dyn, float* m_hold, float* z_state,
    float* current_state, float* tau_dyn, float* ring, float* tau_motor, float* tau_mr, float* tau, float* bound) {
    for (int env = 0; env < envs; ++env) {
        for (int joint = 0; joint < joints; ++joint) {
            const int at = env * joints + joint, slot = slot_of[joint];
            const float speed = qd[at], e = q_des[at] - q[at];
            float gain = kp[at], damping = kd[at], largest = tau_limit[at], friction = 0.0f;
            if (slot >= 0) {
                const int k = env * devices + slot;
                const Device* p = &params[k];
                const float load = f_foot[env * legs + leg_of[slot]], limit = fminf(current_e[env], p->current_max);
                /* eqs. 5 and 8 */
                const float dyn =
                    load > p->f_th && fabsf(e) > p->eps_e && fabsf(speed) > p->eps_v && e * speed < 0.0f ? 1.0f : 0.0f;
                const float hold =
                    limit > 0.0f && load > p->f_th && fabsf(speed) < p->eps_hold && dyn == 0.0f ? 1.0f : 0.0f;
                const float command =
                    hold > 0.0f ? support_current((p->kp_base - p->kp_low) * e, limit, p) : dyn * limit;
                float current = command;
                if (p->coil_time_constant > 0.0f)
                    current += (current_state[k] - command) * expf(-dt / p->coil_time_constant);
                const float q_c = q[at] - p->q_neutral - (p->q_offset + p->q_center);
                float* row = &ring[(k * WINDOW + head) * FEATURES];
                row[0] = q_c, row[1] = speed, row[2] = current;
                /* eqs. 15 and 14 */
                float z = z_state[k];
                z = clip(z + dt * (speed - p->beta * fabsf(speed) * z - p->gamma * speed * fabsf(z)), p->z_max);
                const float sliding = p->D + p->B * speed + p->C * q_c + p->I1 * current +
                                      (p->K0 + p->K1 * current) / (1.0f + p->alpha * fabsf(speed)) * z;
                m_dyn[k] = dyn, m_hold[k] = hold, z_state[k] = z, current_state[k] = current, tau_dyn[k] = sliding;
                friction = fabsf(sliding);
                if (hold > 0.0f) friction = fmaxf(friction, yield_torque(current, p));
                tau_mr[k] = NAN; /* known after the physics */
                gain = hold > 0.0f ? p->kp_low : p->kp_base, damping = p->kd, largest = p->tau_limit; /* eq. 9 */
            }
            const float motor = clip(gain * e - damping * speed, largest);
            tau_motor[at] = motor, tau[at] = motor, bound[at] = friction;
        }
    }
}
