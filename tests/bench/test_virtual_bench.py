"""The virtual bench: sessions are reproducible and what the paper's were, and the command records them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mrwarp.bench import excitation, session_report
from mrwarp.bench.bench_effects import LOG_DT, SUBSTEPS, Effects
from mrwarp.bench.virtual_bench import BenchCfg, bench_device, run_bench
from mrwarp.cli import main
from mrwarp.params import MrParams
from mrwarp.recording.load import COLUMNS, load_holding, load_recording

DT = LOG_DT / SUBSTEPS
SMALL = BenchCfg(trajectories=12, samples=12 * 700, evaluation_samples=600, seed=5)


@pytest.fixture(scope="module")
def small_session():
    """A short session of every kind of trajectory."""
    return run_bench(SMALL)


def test_same_seed_same_bits_and_another_seed_another_session():
    """Every logged value of both parts and the break-away tests."""
    cfg = BenchCfg(trajectories=3, samples=3 * 200, evaluation_samples=300, seed=5)
    first, again, other = (run_bench(replace(cfg, seed=seed)) for seed in (5, 5, 6))
    for part in ("fit", "evaluation"):
        runs, same, differ = (getattr(x, part).trajectories for x in (first, again, other))
        for a, b in zip(runs, same, strict=True):
            assert all(np.array_equal(getattr(a, key), getattr(b, key)) for key in COLUMNS)
        assert not any(np.array_equal(a.q, b.q) for a, b in zip(runs, differ, strict=True))
    assert np.array_equal(first.holding.torque, again.holding.torque)


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
    h = MrParams().hold
    want = h.T_max * plain.current**h.n / (h.K**h.n + plain.current**h.n)
    assert np.abs(plain.torque - want).max() < 1e-6
    noisy = run_bench(BenchCfg(trajectories=1, samples=50, evaluation_samples=0)).holding
    assert np.abs(noisy.torque - want).max() < 4.5 * (0.04 * h.T_max) and np.abs(noisy.torque - want).max() > 0.1


def test_default_effects_leave_what_fig_4_says():
    """Plain eq. 14 with the paper's coefficients: the order of Fig. 4, growing with current (0.42, 0.64, 0.78 N·m)."""
    cfg = BenchCfg(trajectories=1, samples=50, evaluation_samples=2000)
    figures = session_report.measure(run_bench(cfg), cfg)["plain_rmse"]
    means = [figures[amps]["mean"] for amps in ("1", "1.2", "1.5")]
    assert means == sorted(means)
    assert 0.35 < means[0] and means[2] < 0.8


def test_clean_bench_is_what_the_simulator_replays():
    """Bench and simulator share no code, and agree: 2 kHz truth against the kernels at 200 Hz."""
    cfg = BenchCfg(trajectories=1, samples=50, evaluation_samples=1000, effects=Effects())
    figures = session_report.measure(run_bench(cfg), cfg)
    for amps in ("1", "1.2", "1.5"):
        # 200 Hz is ten times coarser: 1 % of the torque
        assert figures["plain_rmse"][amps]["mean"] < 0.01 * figures["torque_rms"][amps]["mean"]


# --- the command ---


@pytest.mark.usefixtures("drawn")
def test_command_writes_what_it_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Recordings that load, header with effects, strength and seed, result, picture, table."""
    out = tmp_path / "bench"
    given = f"--out {out} --seed 7 --trajectories 4 --samples 1200 --evaluation-samples 240".split()
    assert main(["bench", *given, "--scale-effects", "0", "--effect", "coil_lag=0.03", "--no-progress"]) == 0
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

    assert main(["bench", *given, "--no-progress"]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main(["bench", *given, "--no-progress", "--overwrite", "--format", "parquet"]) == 0
    assert {p.suffix for p in (out / "fit").iterdir()} == {".parquet"}


def test_stopping_leaves_no_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Ctrl-C during the simulation: exit code 130, nothing recorded."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mrwarp.bench.virtual_bench.run_bench", stop)
    assert main(["bench", "--out", str(tmp_path / "bench")]) == 130
    assert not list(tmp_path.rglob("*.*"))


def test_recorded_gait_that_is_too_short_is_refused():
    """A pool of calf motion has to be as long as the trajectories."""
    pool = [np.sin(np.arange(500 * SUBSTEPS) * DT)]
    with pytest.raises(ValueError, match="record a longer one"):
        excitation.fit_excitations(3, 3 * 600, np.random.default_rng(0), pool)


def test_a_device_that_takes_less_is_recorded_with_what_flows() -> None:
    """Of 0.9 A the same shares as of 1.5 A: no command above it, and no two currents that are one."""
    cfg = BenchCfg(
        params=bench_device().replace(current_max=0.9), trajectories=12, samples=12 * 400, evaluation_samples=400
    )
    data = run_bench(cfg)
    assert data.evaluation is not None
    constant = {float(run.current.max()) for run in data.fit.trajectories if run.id.endswith("_sine")}
    assert sorted(constant) == pytest.approx([0.0, 0.3, 0.6, 0.9])
    assert {run.id.rpartition("_")[2] for run in data.evaluation.trajectories} == {"0.6A", "0.72A", "0.9A"}
    assert data.holding.current.max() == pytest.approx(0.9)
    figures = session_report.measure(data, cfg)
    assert list(figures["plain_rmse"]) == ["0.6", "0.72", "0.9"]
    assert BenchCfg().share == BenchCfg(params=bench_device().replace(current_max=3.0)).share == 1.0
