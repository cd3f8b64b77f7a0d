"""The virtual bench: eq. 14 with all effects off, each effect does what its law says, and sessions are reproducible."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrwarp.params import MrParams
from mrwarp.sysid import bench_cli, excitation
from mrwarp.sysid.bench import BenchCfg, run_bench
from mrwarp.sysid.bench_effects import EFFECTS, LOG_DT, SUBSTEPS, Drive, EffectError, Effects, Log, simulate
from mrwarp.sysid.recording import COLUMNS, load_holding, load_recording

P = MrParams()
BW = P.bouc_wen
DT = LOG_DT / SUBSTEPS
SAMPLES = 500
TIME = np.arange(SAMPLES * SUBSTEPS) * DT
T = TIME[::SUBSTEPS]
OMEGA, AMPLITUDE = 2.0 * np.pi * 1.25, 0.5
Q = AMPLITUDE * (1.0 - np.cos(OMEGA * TIME))
"""A joint that starts at rest and swings over 1 rad at up to 3.9 rad/s."""


def drive(q: np.ndarray = Q, current: np.ndarray | float = 1.0, session: float = 0.5, count: int = 2) -> Drive:
    """The same motion and current for ``count`` trajectories."""
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


def test_hysteresis_depends_on_the_path_only():
    """Slow and fast runs over the same path give the same z (rate independence of eq. 15)."""
    only_z = P.replace(alpha=0.0, B=0.0, C=0.0, D=0.0, I1=0.0)
    slow = run(params=only_z).torque[::2]
    fast = run(params=only_z, q=Q[::2]).torque
    # twice the sampling step: the path lost at reversals is four times as long
    tolerance = (BW.K0 + BW.K1) * (1 + (BW.beta - BW.gamma) * BW.z_bound) * AMPLITUDE * OMEGA**2 * DT**2
    assert np.abs(slow - fast).max() < tolerance


def test_monotonic_loading_has_the_closed_form():
    """From rest z = (1 - exp(-(beta + gamma)*s))/(beta + gamma), exactly, whatever the step."""
    only_z = P.replace(alpha=0.0, B=0.0, C=0.0, D=0.0, I1=0.0)
    ramp = 2.0 * TIME
    z = run(params=only_z, q=ramp).torque[:, 0] / (BW.K0 + BW.K1)
    rate = BW.beta + BW.gamma
    assert np.abs(z - (1.0 - np.exp(-rate * ramp[::SUBSTEPS])) / rate).max() < 1e-13


# --- each effect by its law; what is logged otherwise stays the same ---

ADDITIVE: dict[str, tuple[float, Callable[[float], np.ndarray]]] = {
    "current_viscosity": (0.05, lambda x: x * 1.0 * QD),
    "coulomb_friction": (0.1, lambda x: x * SIGN),
    "friction_asymmetry": (0.1, lambda x: x * np.abs(SIGN)),
    "viscous_asymmetry": (0.02, lambda x: x * np.abs(QD)),
    "stribeck": (0.2, lambda x: x * SIGN / (1.0 + (QD / 0.4) ** 2)),
    "cogging": (0.05, lambda x: x * (np.sin(24 * Q) + 0.2 * np.sin(48 * Q))[::SUBSTEPS]),
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


def test_coil_lag_is_a_first_order_rise():
    """After the step the torque rises as 1 - exp(-t/T)."""
    lag = 0.02
    rise = _steady({"coil_lag": lag})[200:]
    # the step falls between two integration steps
    assert np.abs(rise - (1.0 - np.exp(-(T[200:] - 1.0) / lag))).max() < DT / lag


def test_command_delay_shifts_the_command():
    """10 ms are two samples."""
    assert np.array_equal(_steady({"command_delay": 0.01})[202:], _steady({})[200:-2])


def test_remanence_keeps_part_of_the_field():
    """With the current off again, the mean half-width of the plays is left; going up it is missing."""
    current = np.where((T > 0.5) & (T < 1.0), 1.0, 0.0)
    field = _steady({"remanence": 0.1}, current)
    assert field[190] == pytest.approx(0.9, abs=1e-6)
    assert field[-1] == pytest.approx(0.1, abs=1e-6)
    assert field[50] == 0.0


def test_torque_sensor_lag_trails_a_ramp_by_its_time_constant():
    """The reading of a steadily rising torque is late by T."""
    only_c = P.replace(B=0.0, D=0.0, I1=0.0, K0=0.0, K1=0.0, C=1.0, q_offset=0.0, q_center=0.0)
    log = run({"torque_sensor_lag": 0.01}, only_c, q=2.0 * TIME)
    assert log.torque[-1, 0] == pytest.approx(2.0 * (T[-1] - 0.01), abs=2.0 * DT)


def test_velocity_lag_delays_qd_and_nothing_else():
    """The logged velocity of a sine is late by T; torque and angle are untouched."""
    log = run({"velocity_lag": 0.008})
    want = AMPLITUDE * OMEGA / np.sqrt(1 + (0.008 * OMEGA) ** 2) * np.sin(OMEGA * T - np.arctan(0.008 * OMEGA))
    assert np.abs(log.qd[100:-1, 0] - want[100:-1]).max() < AMPLITUDE * OMEGA**2 * DT
    assert np.array_equal(log.torque, BASE.torque)


def test_encoder_offset_and_steps_change_the_logged_angle_only():
    """An offset is subtracted; a coarse encoder reads multiples of its step."""
    assert np.abs(run({"encoder_offset": 0.1}).q - (BASE.q - 0.1)).max() < 1e-15
    coarse = run({"encoder_step": 0.01})
    assert np.abs(coarse.q - BASE.q).max() <= 0.005 + 1e-12
    assert np.abs(coarse.q / 0.01 - np.round(coarse.q / 0.01)).max() < 1e-9
    assert np.array_equal(coarse.torque, BASE.torque)


def test_backlash_lets_the_encoder_move_alone_at_a_reversal():
    """The device trails by the half-gap and rests after a reversal until the gap is crossed."""
    only_c = P.replace(B=0.0, D=0.0, I1=0.0, K0=0.0, K1=0.0, C=1.0, q_offset=0.0, q_center=0.0)
    log = run({"backlash": 0.02}, only_c)
    behind = log.q[:, 0] - log.torque[:, 0]
    top = np.abs(behind).max()
    assert top == pytest.approx(0.02, abs=1e-12)
    rising, falling = (T > 0.2) & (T < 0.35), (T > 0.6) & (T < 0.75)
    assert np.abs(behind[rising] - 0.02).max() < 1e-12
    assert np.abs(behind[falling] + 0.02).max() < 1e-12


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
        "backlash", "breakaway", "temperature_drift", "run_bias", "run_gain", "torque_noise", "velocity_noise",
        "coloured_noise",
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


def test_unknown_and_impossible_effects_are_refused():
    """The message proposes a name or says the range."""
    with pytest.raises(EffectError, match="did you mean 'coil_lag'"):
        Effects({"coil_lagg": 0.1})
    for value in (-1.0, 2.0, float("nan")):
        with pytest.raises(EffectError, match="allowed: 0 to 1 s"):
            Effects({"coil_lag": value})


# --- sessions ---

SMALL = BenchCfg(trajectories=12, samples=12 * 700, evaluation_samples=600, seed=5)


@pytest.fixture(scope="module")
def small_session():
    """A short session of every kind of trajectory."""
    return run_bench(SMALL)


def test_same_seed_same_bits_and_another_seed_another_session(small_session):
    """Every logged value of both parts and the break-away tests."""
    again = run_bench(SMALL)
    other = run_bench(BenchCfg(trajectories=12, samples=12 * 700, evaluation_samples=600, seed=6))
    for part in ("fit", "evaluation"):
        runs, same, differ = (getattr(x, part).trajectories for x in (small_session, again, other))
        for a, b in zip(runs, same, strict=True):
            assert all(np.array_equal(getattr(a, key), getattr(b, key)) for key in COLUMNS)
        assert not any(np.array_equal(a.q, b.q) for a, b in zip(runs, differ, strict=True))
    assert np.array_equal(small_session.holding.torque, again.holding.torque)


def test_effects_do_not_change_the_motion():
    """Sessions with different effects run the same motions and currents: they can be compared pairwise."""
    off = run_bench(BenchCfg(trajectories=3, samples=600, evaluation_samples=0, effects=Effects()))
    on = run_bench(BenchCfg(trajectories=3, samples=600, evaluation_samples=0, effects=Effects({"torque_noise": 0.1})))
    for a, b in zip(off.fit.trajectories, on.fit.trajectories, strict=True):
        assert np.array_equal(a.q, b.q)
        assert np.array_equal(a.current, b.current)
    assert off.evaluation is None


def test_session_keeps_the_currents_apart(small_session):
    """Fitting at 0, 0.5, 1.0, 1.5 A; 1.2 A in the evaluation only; ten motions at three currents, three on-sections."""
    fit = {float(x) for run in small_session.fit.trajectories for x in np.unique(run.current)}
    assert fit == set(excitation.FIT_CURRENTS)
    assert small_session.fit.samples == SMALL.samples
    runs = small_session.evaluation.trajectories
    assert len(runs) == 30
    for k, run_ in enumerate(runs):
        assert set(np.unique(run_.current)) == {0.0, excitation.EVALUATION_CURRENTS[k % 3]}
        assert np.count_nonzero(np.diff(run_.current) > 0.0) == 3
        # the logged angles differ by nothing: the motion is the same at each current
        assert np.array_equal(run_.q, runs[k - k % 3].q)


def test_motions_stay_within_the_papers_limits():
    """1 rad and 10 rad/s over many seeds, without jumps; all kinds."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        motions = excitation.fit_excitations(9, 9 * 2000, rng) + excitation.evaluation_excitations(1500, rng)
        for x in motions:
            qd = np.diff(x.q) / DT
            assert np.abs(x.q).max() <= excitation.Q_MAX
            assert np.abs(qd).max() <= excitation.QD_MAX
            # a jump of the velocity would be an acceleration of 1/DT
            assert np.abs(np.diff(qd)).max() < 0.75
            assert x.q[0] == pytest.approx(0.0, abs=1e-12)


def test_holding_tests_follow_eq_18():
    """Without effects they are eq. 18; with the default ones the scatter is a few per cent."""
    plain = run_bench(BenchCfg(trajectories=1, samples=50, evaluation_samples=0, effects=Effects())).holding
    h = P.hold
    want = h.T_max * plain.current**h.n / (h.K**h.n + plain.current**h.n)
    assert np.abs(plain.torque - want).max() < 1e-6
    noisy = run_bench(BenchCfg(trajectories=1, samples=50, evaluation_samples=0)).holding
    assert np.abs(noisy.torque - want).max() < 4.5 * (0.04 * h.T_max) and np.abs(noisy.torque - want).max() > 0.1


def test_recorded_gait_is_interpolated_through_its_samples():
    """Hermite interpolation meets values and slopes of a 50 Hz recording and a cubic between them exactly."""
    t = np.arange(6) * 0.02
    x, v = 1.0 + t - 3.0 * t**2 + 40.0 * t**3, 1.0 - 6.0 * t + 120.0 * t**2
    fine = np.arange(5 * 40) * DT
    got = excitation._hermite(x, v, 0.02, 40)
    assert np.abs(got - (1.0 + fine - 3.0 * fine**2 + 40.0 * fine**3)).max() < 1e-14
    pool = [np.sin(TIME)]
    with pytest.raises(ValueError, match="record a longer one"):
        excitation.fit_excitations(3, 3 * 600, np.random.default_rng(0), pool)


def test_default_effects_leave_what_fig_4_says():
    """Plain eq. 14 with the paper's coefficients: the order of Fig. 4, growing with current (0.42, 0.64, 0.78 N·m)."""
    cfg = BenchCfg(trajectories=1, samples=50, evaluation_samples=2000)
    figures = bench_cli.measure(run_bench(cfg), cfg)["plain_rmse"]
    means = [figures[amps]["mean"] for amps in ("1", "1.2", "1.5")]
    assert means == sorted(means)
    assert 0.4 < means[0] and means[2] < 0.8


def test_clean_bench_is_what_the_simulator_replays():
    """Bench and simulator share no code, and agree: 2 kHz truth against the kernels at 200 Hz."""
    cfg = BenchCfg(trajectories=1, samples=50, evaluation_samples=1000, effects=Effects())
    figures = bench_cli.measure(run_bench(cfg), cfg)
    for amps in ("1", "1.2", "1.5"):
        # 200 Hz is ten times coarser: 1 % of the torque
        assert figures["plain_rmse"][amps]["mean"] < 0.01 * figures["torque_rms"][amps]["mean"]


# --- the command ---


def test_command_writes_what_it_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Recordings that load, header with effects, strength and seed, result, picture, table."""
    out = tmp_path / "bench"
    given = [
        "--out",
        str(out),
        "--seed",
        "7",
        "--trajectories",
        "4",
        "--samples",
        "1200",
        "--evaluation-samples",
        "240",
    ]
    assert bench_cli.main([*given, "--scale-effects", "0", "--effect", "coil_lag=0.03", "--no-progress"]) == 0
    assert "coil_lag" in capsys.readouterr().out
    fit, evaluation = load_recording(out / "fit"), load_recording(out / "evaluation")
    assert fit.samples == 1200
    assert len(evaluation.trajectories) == 30
    assert fit.header["seed"] == 7
    assert fit.header["effects"] == dict(Effects({"coil_lag": 0.03}))
    assert load_holding(out).header["part"] == "holding"
    result = json.loads((out / "result.json").read_text())
    assert result["seed"] == 7
    assert result["effects"]["coil_lag"] == {"value": 0.03, "unit": "s"}
    assert set(result["plain_rmse"]) == {"1", "1.2", "1.5"}
    assert (out / "bench.png").stat().st_size > 10_000

    assert bench_cli.main([*given, "--no-progress"]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert bench_cli.main([*given, "--no-progress", "--overwrite", "--format", "parquet"]) == 0
    assert {p.suffix for p in (out / "fit").iterdir()} == {".parquet"}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--effect", "nonsense=1"], "known: coil_lag"),
        (["--effect", "coil_lag=fast"], "'fast' is not a number"),
        (["--effect", "coil_lag"], "not NAME=VALUE"),
        (["--effect", "coil_lag=9"], "allowed: 0 to 1 s"),
        (["--scale-effects", "-1"], "allowed: 0 to 10"),
        (["--samples", "100"], "fewer than 50 for each of 120"),
        (["--trajectories", "0"], "at least 1"),
        (["--evaluation-samples", "10"], "0 or at least 200"),
        (["--seed", "-1"], "must not be negative"),
        (["--policy", "/nowhere.onnx"], "no such policy"),
    ],
)
def test_bad_input_is_refused_and_nothing_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], given: list[str], message: str
):
    """Exit code 2, a message with the remedy, no recordings."""
    out = tmp_path / "bench"
    assert bench_cli.main(["--out", str(out), "--no-progress", *given]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.*"))


def test_stopping_leaves_no_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Ctrl-C during the simulation: exit code 130, nothing recorded."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(bench_cli, "run_bench", stop)
    assert bench_cli.main(["--out", str(tmp_path / "bench")]) == 130
    assert not list(tmp_path.rglob("*.*"))
