"""``mrwarp perf``: result, pictures and table of tiny sizes, the regression check, and one line for bad input."""

import json
from pathlib import Path

import pytest

from benchmarks.perf import measure
from benchmarks.perf.measure import LIMITS, limit_of
from benchmarks.perf.perf_cfg import PerfCfg
from mrwarp.cli import main

TINY = "--num-envs 2 --rounds 2 --steps 25 --parts walking --threads 1 --mjwarp-up-to 0".split()
"""Without MuJoCo-Warp: a compilation that says nothing about this command."""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory, drawn: None) -> Path:
    """Folder of a run with two robots."""
    out = tmp_path_factory.mktemp("perf")
    assert main(["perf", *TINY, "--out", str(out)]) == 0
    return out


def test_the_time_of_all_parts_is_told_beforehand() -> None:
    """A part left out costs nothing; more turns and more robots cost more; the quick run is about a minute."""
    quick = PerfCfg(num_envs=(64, 256), rounds=15, updates=0).estimate()
    assert list(quick) == ["start", "walking, 64 robots", "walking, 256 robots", "joint"]
    assert 30.0 < sum(quick.values()) < 90.0
    assert 200.0 < sum(PerfCfg().estimate().values()) < 600.0
    assert set(PerfCfg(parts=("joint",)).estimate()) == {"start", "joint"}


def test_result_holds_medians_ratios_checks_and_device(result: Path) -> None:
    """Figures of every part, ratios above 0 with quartiles in order, what walked, and on what."""
    found = json.loads((result / "result.json").read_text())
    assert {"device", "walking", "ratios", "date", "seed", "versions", "command"} <= set(found)
    assert {"bouc_wen/pd @2", "env/plain @2", "lstm env/plain @2"} <= set(found["ratios"])
    assert all(0.0 < row["low"] <= row["median"] <= row["high"] for row in found["ratios"].values())
    parts = found["walking"]["2"]["breakdown"]["bouc_wen"]
    assert set(parts) == set(measure.PARTS) and parts["physics"] > 0.0
    assert found["walking"]["2"]["checks"]["lstm"]["falls_per_second"] == 0.0
    assert (result / "cost.png").stat().st_size > 5000 and (result / "breakdown.png").stat().st_size > 5000


def test_compare_passes_against_itself_and_fails_when_slowed(
    result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Equal ratios pass; ratios that are twice an earlier file's end with 1 and are named."""
    earlier = json.loads((result / "result.json").read_text())
    figures = {key: earlier[key] for key in ("device", "walking", "ratios")}
    monkeypatch.setattr("benchmarks.perf.measure.run_all", lambda *_: json.loads(json.dumps(figures)))
    again = ["--out", str(tmp_path), "--compare", str(result / "result.json")]
    assert main(["perf", *again]) == 0
    for row in figures["ratios"].values():
        for key in ("median", "low", "high"):
            row[key] *= 4.0
    assert main(["perf", *again]) == 1
    said = capsys.readouterr().out
    assert "REGRESSED env/plain @2" in said


def test_limits_hold_where_they_are_aimed_at() -> None:
    """64 and 256 robots have limits, other numbers none; ratios without a number have theirs."""
    assert limit_of("env/plain @64") == LIMITS["env/plain"] and limit_of("env/plain @1024") is None
    assert limit_of("kernels/c") == 1.5 and limit_of("lstm window env/plain @64") is None
