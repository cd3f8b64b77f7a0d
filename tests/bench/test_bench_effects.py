"""The virtual joint: eq. 14 with all effects off, and each effect does what its law says."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mrwarp.bench.bench_effects import EFFECTS, LOG_DT, SUBSTEPS, Drive, Effects, Log, simulate
from mrwarp.params import MrParams

P = MrParams()
BW = P.bouc_wen
DT = LOG_DT / SUBSTEPS
SAMPLES = 350
TIME = np.arange(SAMPLES * SUBSTEPS) * DT
T = TIME[::SUBSTEPS]
OMEGA, AMPLITUDE = 2.0 * np.pi * 1.25, 0.5
Q = AMPLITUDE * (1.0 - np.cos(OMEGA * TIME))
"""A joint that starts at rest and swings over 1 rad at up to 3.9 rad/s."""


def drive(q: np.ndarray = Q, current: np.ndarray | float = 1.0, session: float = 0.5, count: int = 2) -> Drive:
    """One motion and current repeated for ``count`` trajectories."""
    command = np.broadcast_to(np.asarray(current, dtype=float), len(q) // SUBSTEPS)
    return Drive(
        q=np.repeat(q[:, None], count, 1),
        command=np.repeat(command[:, None], count, 1),
        session=np.full(count, session),
    )


def run(effects: dict[str, float] | None = None, params: MrParams = P, *, seed: int = 0, **how: Any) -> Log:
    """One short session with only the given effects."""
    return simulate(drive(**how), Effects(effects), params, np.random.default_rng(seed))


BASE = run()
QD = np.gradient(Q, DT)[::SUBSTEPS]
SIGN = np.tanh(QD / 0.02)
RUBBING = np.empty(len(Q))
"""Stretch of bristles that slip after 0.2 mrad, -1 to 1."""
bent = 0.0
for k, step in enumerate(np.gradient(Q)):
    bent = min(max(bent + step / 2e-4, -1.0), 1.0) if k else 0.0
    RUBBING[k] = bent
RUBBING = RUBBING[::SUBSTEPS]
LINEAR = BW.D + BW.B * QD + BW.C * (Q[::SUBSTEPS] - BW.q_offset - BW.q_center) + BW.I1 * 1.0
HYSTERETIC = BASE.torque[:, 0] - LINEAR
"""The z term of eq. 14 at 1 A."""


# --- the base law ---


def test_with_all_effects_off_it_is_eq_14_and_15():
    """Against Runge-Kutta 4 in time with analytic velocity at 20 kHz: another scheme, variable and step.

    The bench sees a reversal only at its samples: up to qdd*dt^2/4 of the path is lost there, and z follows the path
    with a slope of at most 1 + (beta - gamma)*|z|. Its velocity is a central difference, wrong by omega^2*dt^2/6.
    """
    h = DT / 10.0
    current = np.where(T < 1.0, 0.5, 1.5)

    def velocity(t: float) -> float:
        return AMPLITUDE * OMEGA * float(np.sin(OMEGA * t))

    def rate(t: float, z: float) -> float:
        v = velocity(t)
        return v - BW.beta * abs(v) * z - BW.gamma * v * abs(z)

    z, out = 0.0, []
    for k in range(SAMPLES * SUBSTEPS * 10):
        t = k * h
        if k % (10 * SUBSTEPS) == 0:
            out.append(z)
        k1 = rate(t, z)
        k2 = rate(t + h / 2, z + h / 2 * k1)
        k3 = rate(t + h / 2, z + h / 2 * k2)
        z += h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(t + h, z + h * k3))
    v = AMPLITUDE * OMEGA * np.sin(OMEGA * T)
    q_c = AMPLITUDE * (1.0 - np.cos(OMEGA * T)) - BW.q_offset - BW.q_center
    gain = (BW.K0 + BW.K1 * current) / (1.0 + BW.alpha * np.abs(v))
    want = BW.D + BW.B * v + BW.C * q_c + BW.I1 * current + gain * np.array(out)

    slope = 1.0 + (BW.beta - BW.gamma) * BW.z_bound
    lost = AMPLITUDE * OMEGA**2 * DT**2 / 4.0
    tolerance = gain.max() * slope * lost + (BW.B + BW.alpha * gain.max() * BW.z_bound) * np.abs(v).max() * (
        OMEGA**2 * DT**2 / 6.0
    )
    # the first sample's velocity is one-sided: qdd*dt/2
    error = np.abs(run(current=current).torque[1:, 0] - want[1:])
    assert error.max() < tolerance
    assert tolerance < 1e-3


def test_monotonic_loading_has_the_closed_form():
    """From rest z = (1 - exp(-(beta + gamma)*s))/(beta + gamma), exactly, for any step."""
    only_z = P.replace(alpha=0.0, B=0.0, C=0.0, D=0.0, I1=0.0)
    ramp = 2.0 * TIME
    z = run(params=only_z, q=ramp).torque[:, 0] / (BW.K0 + BW.K1)
    rate = BW.beta + BW.gamma
    assert np.abs(z - (1.0 - np.exp(-rate * ramp[::SUBSTEPS])) / rate).max() < 1e-13


# --- each effect by its law; what is logged otherwise stays the same ---

ADDITIVE: dict[str, tuple[float, Callable[[float], np.ndarray]]] = {
    "current_viscosity": (0.05, lambda x: x * 1.0 * QD),
    "coulomb_friction": (0.1, lambda x: x * RUBBING),
    "load_friction": (0.1, lambda x: x * 1.0 * RUBBING),
    "position_friction": (2.0, lambda x: x * (Q[::SUBSTEPS] - BW.q_offset - BW.q_center) ** 2 * RUBBING),
    "friction_asymmetry": (0.1, lambda x: x * np.abs(SIGN)),
    "viscous_asymmetry": (0.02, lambda x: x * np.abs(QD)),
    "stribeck": (0.2, lambda x: x * RUBBING / (1.0 + (QD / 0.4) ** 2)),
    "cogging": (0.05, lambda x: x * (np.sin(24 * Q) + 0.2 * np.sin(48 * Q))[::SUBSTEPS]),
    "compliance_with_backlash": (
        0.5, lambda x: x * (Q[::SUBSTEPS] - BW.q_offset - np.clip(Q[::SUBSTEPS] - BW.q_offset, -0.05, 0.05)),
    ),
    "rotor_inertia": (0.004, lambda x: x * AMPLITUDE * OMEGA**2 * np.cos(OMEGA * T)),
    "torque_bias": (0.1, lambda x: np.full(SAMPLES, x)),
    "torque_gain": (1.1, lambda x: (x - 1.0) * (LINEAR + HYSTERETIC)),
    "speed_weakening": (1.25, lambda x: HYSTERETIC * ((1.0 + BW.alpha * np.abs(QD)) ** (1.0 - x) - 1.0)),
    "loop_asymmetry": (0.2, lambda x: HYSTERETIC * x * SIGN),
    "position_gain": (0.2, lambda x: HYSTERETIC * x * np.sin(2 * (Q[::SUBSTEPS] - BW.q_offset) + 0.6)),
    "wear": (0.4, lambda x: -0.5 * x * HYSTERETIC),
    "current_saturation": (
        0.8, lambda x: HYSTERETIC * BW.K1 / (BW.K0 + BW.K1) * (1.0 / np.sqrt(1.0 + x**2) - 1.0),
    ),
    "current_gain": (1.2, lambda x: (x - 1.0) * (BW.I1 + HYSTERETIC * BW.K1 / (BW.K0 + BW.K1))),
}  # fmt: skip
"""Effects with a closed form of what they add: value used here, and the added torque."""


@pytest.mark.parametrize("name", list(ADDITIVE))
def test_effect_adds_what_its_law_says(name: str):
    """Difference to the base law, sample by sample; angle and velocity stay as they were."""
    value, law = ADDITIVE[name]
    log = run({name: value})
    # the second difference that makes qdd is wrong by omega^2*dt^2/3 in the middle and one-sided at the ends
    middle = slice(1, -1)
    assert np.abs((log.torque[:, 0] - BASE.torque[:, 0]) - law(value))[middle].max() < 1e-5 * max(1.0, OMEGA**4 * DT)
    assert np.abs(law(value)).max() > 0.01
    assert np.array_equal(log.q, BASE.q)
    assert np.array_equal(log.qd, BASE.qd)


STEP = np.where(T < 1.0, 0.0, 1.0)
"""The current is switched on after a second."""


def _steady(effects: dict[str, float], current: np.ndarray = STEP) -> np.ndarray:
    """Hysteretic torque of the current at constant speed, where z has long reached its bound [A]."""
    only_z = P.replace(alpha=0.0, B=0.0, C=0.0, D=0.0, I1=0.0, K0=0.0)
    torque = run(effects, only_z, q=8.0 * TIME, current=current).torque[:, 0]
    return torque / (BW.K1 * BW.z_bound)


@pytest.mark.parametrize("delay", [0.0, 0.01, 0.0101])
def test_coil_lag_is_a_first_order_rise(delay: float):
    """After a step, delayed by whole integration steps or not, the torque rises as 1 - exp(-t/T), exactly."""
    lag = 0.012
    rise = _steady({"coil_lag": lag, "command_delay": delay})[200:]
    since = np.maximum(T[200:] - 1.0 - delay, 0.0)
    assert np.abs(rise - (1.0 - np.exp(-since / lag))).max() < 1e-9


def test_two_lags_of_the_coil_follow_each_other():
    """The joint's own lag and the effect: 1 - (a*exp(-t/a) - b*exp(-t/b))/(a - b), to the step squared."""
    only_z = P.replace(alpha=0.0, B=0.0, C=0.0, D=0.0, I1=0.0, K0=0.0, coil_time_constant=0.02)
    torque = run({"coil_lag": 0.005}, only_z, q=8.0 * TIME, current=STEP).torque[200:, 0] / (BW.K1 * BW.z_bound)
    since, a, b = T[200:] - 1.0, 0.02, 0.005
    want = 1.0 - (a * np.exp(-since / a) - b * np.exp(-since / b)) / (a - b)
    assert np.abs(torque - want).max() < DT**2 / (a * b)


def test_command_delay_shifts_the_command():
    """10 ms are two samples; a delay that ends between two samples shows at the later one."""
    assert np.array_equal(_steady({"command_delay": 0.01})[202:], _steady({})[200:-2])
    assert np.array_equal(_steady({"command_delay": 0.0101})[203:], _steady({})[200:-3])


@pytest.mark.parametrize("delay", [0.0, 0.01, 0.0101])
def test_torque_sensor_lag_trails_a_jump_as_a_first_order_rise(delay: float):
    """Without a lag of the coil the torque jumps with the command; the reading rises as 1 - exp(-t/T) from there."""
    lag = 0.008
    rise = _steady({"torque_sensor_lag": lag, "command_delay": delay})[200:]
    since = np.maximum(T[200:] - 1.0 - delay, 0.0)
    assert np.abs(rise - (1.0 - np.exp(-since / lag))).max() < 1e-9


def test_remanence_keeps_part_of_the_field():
    """With the current off again, the mean half-width of the plays is left; going up it is missing."""
    current = np.where((T > 0.5) & (T < 1.0), 1.0, 0.0)
    field = _steady({"remanence": 0.1}, current)
    assert field[190] == pytest.approx(0.9, abs=1e-6)
    assert field[-1] == pytest.approx(0.1, abs=1e-6)
    assert field[50] == 0.0


def test_velocity_lag_delays_qd_and_nothing_else():
    """The logged velocity of a sine is late by T; torque and angle are untouched."""
    log = run({"velocity_lag": 0.008})
    want = AMPLITUDE * OMEGA / np.sqrt(1 + (0.008 * OMEGA) ** 2) * np.sin(OMEGA * T - np.arctan(0.008 * OMEGA))
    # a central difference, and straight lines between the steps: both wrong by their square
    assert np.abs(log.qd[100:-1, 0] - want[100:-1]).max() < AMPLITUDE * OMEGA**3 * DT**2
    assert np.array_equal(log.torque, BASE.torque)


def test_encoder_offset_and_steps_change_the_logged_angle_only():
    """An offset is subtracted; a coarse encoder reads multiples of its step."""
    assert np.abs(run({"encoder_offset": 0.1}).q - (BASE.q - 0.1)).max() < 1e-15
    coarse = run({"encoder_step": 0.01})
    assert np.abs(coarse.q - BASE.q).max() <= 0.005 + 1e-12
    assert np.abs(coarse.q / 0.01 - np.round(coarse.q / 0.01)).max() < 1e-9
    assert np.array_equal(coarse.torque, BASE.torque)


def test_backlash_lets_the_encoder_move_alone_at_a_reversal():
    """The loop of the hysteresis alone, with steep flanks: zero along the gap's whole width after each reversal."""
    steep = P.replace(B=0.0, D=0.0, I1=0.0, C=0.0, alpha=0.0, beta=400.0, gamma=0.0)
    gap = 0.02
    log = run({"backlash": gap}, steep)
    q, torque = log.q[:, 0], log.torque[:, 0]
    last = T > T[-1] - 0.8  # a whole period
    full = np.abs(torque[last]).max()
    open_ = last & (np.abs(torque) < 0.01 * full)
    for rising in (True, False):
        side = open_ & ((np.gradient(q) > 0.0) == rising)
        assert np.ptp(q[side]) == pytest.approx(2.0 * gap, abs=np.abs(np.diff(q)).max() + 2.0 / 400.0)
    assert np.abs(torque[last & ~open_]).min() > 0.0 and full == pytest.approx((P.bouc_wen.K0 + P.bouc_wen.K1) / 400.0)


def test_a_spring_delays_the_loop_by_its_winding():
    """The spring is wound by c times the torque: the same torque, that much later along the way."""
    plain, compliance = P.replace(B=0.0, D=0.0, I1=0.0, C=0.0, alpha=0.0, gamma=0.0), 0.01
    q = 0.3 * TIME
    there, here = (run(effects, plain, q=q).torque[:, 0] for effects in ({"series_compliance": compliance}, {}))
    way = q[::SUBSTEPS] - compliance * there
    np.testing.assert_allclose(there, np.interp(way, q[::SUBSTEPS], here), rtol=0, atol=2e-3 * here.max())
    assert (here - there).max() > 0.02 * here.max() and there[-1] == pytest.approx(here[-1], rel=1e-3)


def test_a_spring_behind_play_unwinds_before_the_play_opens():
    """Steep flanks: the way of a reversal is that of the open play and twice the spring's, c times the torque."""
    steep = P.replace(B=0.0, D=0.0, I1=0.0, C=0.0, alpha=0.0, beta=400.0, gamma=0.0)
    gap, compliance = 0.02, 1.0
    log = run({"backlash": gap, "series_compliance": compliance}, steep)
    q, torque = log.q[:, 0], log.torque[:, 0]
    last = T > T[-1] - 0.8  # a whole period
    full = np.abs(torque[last]).max()
    for rising in (True, False):
        side = last & ((np.gradient(q) > 0.0) == rising)
        within = 2.0 * np.abs(np.diff(q)).max() + 2.0 / 400.0
        assert np.ptp(q[side & (np.abs(torque) < 1e-9)]) == pytest.approx(2.0 * gap, abs=within)
        turned = side & (np.abs(torque) < 0.9 * full)
        assert np.ptp(q[turned]) == pytest.approx(2.0 * gap + 1.8 * compliance * full, abs=within)


def test_breakaway_resists_at_rest_and_vanishes_with_speed():
    """Slow motion meets the given share of eq. 18; fast motion does not."""
    tau_y = P.hold.T_max / (P.hold.K**P.hold.n + 1.0)
    for speed, share in ((0.05, np.exp(-0.1)), (5.0, np.exp(-10.0))):
        q = speed * TIME
        added = run({"breakaway": 0.05}, q=q).torque[-2, 0] - run(q=q).torque[-2, 0]
        assert added == pytest.approx(0.05 * tau_y * share, rel=1e-6)


def test_temperature_drift_weakens_with_work():
    """A warmer fluid resists less; from the same start, work makes it weaker over time."""
    log = run({"temperature_drift": 0.02})
    ratio = (log.torque[:, 0] - LINEAR + BW.B * QD) / (HYSTERETIC + BW.B * QD)
    moving = np.abs(HYSTERETIC + BW.B * QD) > 0.3
    assert (ratio[moving] < 1.0).all()
    second = ratio[moving & (T > 1.25)].mean(), ratio[moving & (T < 1.25)].mean()
    assert second[0] < second[1]


def test_runs_differ_between_trajectories_only():
    """run_bias is constant within a trajectory and differs between them; run_gain scales the hysteretic part."""
    bias = run({"run_bias": 0.1}).torque - BASE.torque
    assert np.ptp(bias, axis=0).max() < 1e-12
    assert abs(bias[0, 0] - bias[0, 1]) > 1e-3
    gain = run({"run_gain": 0.1}).torque - BASE.torque
    factor = gain[100:, :] / HYSTERETIC[100:, None]
    assert np.ptp(factor, axis=0).max() < 1e-8
    assert abs(factor[0, 0] - factor[0, 1]) > 1e-3


@pytest.mark.parametrize(("name", "channel"), [("torque_noise", "torque"), ("velocity_noise", "qd")])
def test_white_noise_has_its_size_and_no_memory(name: str, channel: str):
    """SD within four of its standard errors; neighbours uncorrelated."""
    noise = getattr(run({name: 0.1}), channel)[:, 0] - getattr(BASE, channel)[:, 0]
    assert noise.std() == pytest.approx(0.1, rel=4.0 / np.sqrt(2.0 * SAMPLES))
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 4.0 / np.sqrt(SAMPLES)


def test_coloured_noise_remembers_50_ms():
    """Correlation of neighbours exp(-5/50), within four standard errors over many trajectories."""
    noise = run({"coloured_noise": 0.1}, count=20).torque - run(count=20).torque
    correlation = np.mean(noise[1:] * noise[:-1]) / np.mean(noise**2)
    assert correlation == pytest.approx(np.exp(-0.1), abs=4.0 * np.sqrt((1 - np.exp(-0.2)) / noise.size))


def test_every_effect_has_a_test():
    """No effect of the table is left out above."""
    tested = set(ADDITIVE) | {
        "coil_lag", "command_delay", "remanence", "torque_sensor_lag", "velocity_lag", "encoder_offset", "encoder_step",
        "backlash", "series_compliance", "breakaway", "temperature_drift", "run_bias", "run_gain", "torque_noise",
        "velocity_noise", "coloured_noise",
    }  # fmt: skip
    assert tested == set(EFFECTS)


@pytest.mark.parametrize("name", list(EFFECTS))
def test_effect_can_be_hidden_alone(name: str):
    """Scale 0 leaves nothing, one effect is set, the others stay absent; the default lies in the allowed range."""
    spec = EFFECTS[name]
    value = spec.default if spec.default != spec.null else 0.5 * (spec.null + spec.high)
    effects = Effects.defaults(0.0).replace(**{name: value})
    assert [n for n in EFFECTS if effects.acts(n)] == [name]
    assert spec.law and spec.why
    assert Effects.defaults(2.0)[name] == pytest.approx(2.0 * spec.default - spec.null)
