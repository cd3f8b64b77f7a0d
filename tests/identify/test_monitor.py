"""A device's health over calibration records: the share that is left, false alarms, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from mrwarp.bench.bench_effects import LOG_DT, SUBSTEPS
from mrwarp.bench.excitation import FIT_CURRENTS, Excitation
from mrwarp.bench.virtual_bench import BenchCfg, record
from mrwarp.cli import main
from mrwarp.identify.monitor import MonitorCfg, judge, monitor
from mrwarp.params import MrParams
from mrwarp.recording.load import Recording, RecordingError, save_recording

MOVES = ((0.15, 0.6), (0.10, 1.3))
"""Amplitudes [rad] and frequencies [Hz] of the sines that a move of 5 s adds up: what a standing knee can do."""


def calibrations(count: int, loss: float, rng: np.random.Generator) -> list[Recording]:
    """Calibrations of a device that has lost so much of its yield: the same move at each current, on the bench."""
    samples = round(5.0 / LOG_DT)
    time = np.arange(samples * SUBSTEPS) * LOG_DT / SUBSTEPS
    q = np.clip(time / 0.5, 0.0, 1.0) ** 2 * sum(a * np.sin(2.0 * np.pi * f * time) for a, f in MOVES)
    move = [Excitation(id=f"{amps:g}A", kind="sine", q=q, command=np.full(samples, amps)) for amps in FIT_CURRENTS]
    mr = MrParams()
    worn = mr.replace(K0=(1.0 - loss) * mr.bouc_wen.K0, K1=(1.0 - loss) * mr.bouc_wen.K1)
    runs = record(move * count, BenchCfg(params=worn), rng, {"made_by": "a test"}).trajectories
    size = len(move)
    return [Recording(trajectories=runs[k * size : (k + 1) * size], header={}) for k in range(count)]


NAMES = tuple(f"day-{k:03d}" for k in range(240))


def test_healthy_devices_rarely_alarm_and_losses_are_noticed_the_sooner_the_larger() -> None:
    """Normal scatter of 3 %, 200 devices: at most 5 % alarm in 200 days, within the test's own error."""
    rng, cfg = np.random.default_rng(2), MonitorCfg()
    error = np.zeros(240)

    def alarm(loss: float) -> int | None:
        series = 1.0 + 0.03 * rng.standard_normal(240)
        series[cfg.baseline :] -= loss
        found = judge(NAMES, {"yield": series, "viscosity": np.ones(240) + 0.01 * rng.standard_normal(240)}, error, cfg)
        return found.alarms["yield"]["number"] - cfg.baseline if "yield" in found.alarms else None

    false = sum(alarm(0.0) is not None for _ in range(200))
    assert false <= 18  # 10 expected at most; 99 % of such counts
    delays = [np.median([alarm(loss) or np.inf for _ in range(20)]) for loss in (0.05, 0.1, 0.2)]
    assert delays[0] > delays[1] > delays[2] == 1.0


def test_a_loss_of_yield_shows_in_full(tmp_path: Path) -> None:
    """Recordings of the virtual bench: a fifth less yield is reported as a fifth; the command says it and returns 1."""
    rng = np.random.default_rng(5)
    for k, recording in enumerate([*calibrations(10, 0.0, rng), *calibrations(4, 0.2, rng)]):
        save_recording(recording, tmp_path / "records" / f"d{k:02d}")
    out = tmp_path / "out"
    line = ["monitor", str(tmp_path / "records"), "--out", str(out), "--baseline", "10", "--horizon", "20"]
    assert main(line) == 1
    found = json.loads((out / "result.json").read_text())
    assert (out / "health.png").is_file() and found["records"] == [f"d{k:02d}" for k in range(14)]
    assert np.mean(found["yield"][10:]) == pytest.approx(0.8, abs=0.06)
    assert found["alarms"]["yield"]["change"] < -0.05


def test_no_more_records_than_the_baseline_are_refused() -> None:
    """Nothing could differ from it."""
    with pytest.raises(RecordingError, match="lower --baseline"):
        monitor({"a": Recording(trajectories=())}, MonitorCfg(baseline=5))
